"""Errors that all rooms share.

In: what is wrong, as a sentence or as a list of :class:`Problem`. Out: one exception whose text
holds one line per problem: *where, what was given, nearest names, what is allowed*. The library
raises these and never prints; the command line turns them into exit codes.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self
from unicodedata import category

_MIN_LIKENESS = 0.65  # share of common letters; below it names only look alike by chance
_MIN_BEGINNING = 3  # letters that must agree for names that begin alike
_MAX_NAMES = 20  # a longer list of allowed names is cut: nobody reads a thousand mesh groups


@dataclass(frozen=True)
class Problem:
    """One mistake: where it is, what it is, and what would have been right.

    Parameters
    ----------
    where : str
        Scene path such as ``joints.crank_pin.between[0]``, or a file, or empty.
    what : str
        The sentence, including the value that was given. May have further lines.
    allowed : tuple of str
        The names or values that are accepted here.
    nearest : tuple of str
        Those of the allowed names that resemble the given one, best first.
    """

    where: str
    what: str
    allowed: tuple[str, ...] = ()
    nearest: tuple[str, ...] = ()

    def __str__(self) -> str:
        first, _, rest = self.what.partition("\n")
        line = f"{self.where}: {first}" if self.where else first
        if self.nearest:
            line += f"; nearest: {', '.join(self.nearest)}"
        if self.allowed:
            line += f"; allowed: {_listed(self.allowed)}"
        return f"{line}\n{rest}" if rest else line


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_MAX_NAMES])
    more = len(names) - _MAX_NAMES
    return f"{shown} and {more} more" if more > 0 else shown


def printable(text: str) -> str:
    """The text with control characters as escapes: what a file says moves no cursor."""
    return "".join(c if category(c)[0] != "C" or c in "\n\t" else ascii(c)[1:-1] for c in text)


class FlexmbError(Exception):
    """Base of all errors of flexmb; ``problems`` holds the mistakes of its text one by one."""

    def __init__(self, message: str, problems: Sequence[Problem] = ()) -> None:
        super().__init__(message)
        self.problems: tuple[Problem, ...] = tuple(problems) or (Problem("", message),)

    @classmethod
    def from_problems(cls, problems: Iterable[Problem]) -> Self:
        """Build the error from a list of mistakes; its text has one line for each."""
        problems = tuple(problems)
        return cls("\n".join(str(problem) for problem in problems), problems)

    @classmethod
    def unknown_name(cls, kind: str, name: str, names: Iterable[str], where: str = "") -> Self:
        """The error ``unknown <kind> "<name>"`` with the nearest and all allowed names."""
        return cls.unknown(f'unknown {kind} "{name}"', name, names, where)

    @classmethod
    def unknown(cls, what: str, name: str, names: Iterable[str], where: str = "") -> Self:
        """The error `what` for a name that is none of `names`, with the nearest and all of them."""
        names = tuple(names)
        return cls.from_problems([Problem(where, what, names, nearest(name, names))])

    def __reduce__(self) -> tuple[type[Self], tuple[str, tuple[Problem, ...]]]:
        return type(self), (str(self), self.problems)


class SceneError(FlexmbError):
    """A scene, or a model built from Python, is invalid."""


class MeshError(FlexmbError):
    """A mesh file cannot be read, or lacks a requested group."""


class MaterialError(FlexmbError):
    """An unknown material, or material values that cannot be."""


class ReductionError(FlexmbError):
    """A mesh cannot be reduced to a flexible body."""


class BodyFileError(FlexmbError):
    """A flexible-body file is not readable, not ours, or of another version."""


class ResultFileError(FlexmbError):
    """A result file is not readable, not ours, or of another version."""


class AssemblyError(FlexmbError):
    """The mechanism cannot be put together, or a name is unknown to its flexible bodies."""


class SolverError(FlexmbError):
    """The run cannot continue; names the time, the joint or body, and the likely cause."""


class OutputError(FlexmbError):
    """An output folder or file cannot be written."""


class ViewError(FlexmbError):
    """A picture or plot cannot be made."""


class CompilationError(FlexmbError):
    """A part of the time loop cannot be compiled on this machine."""


class FlexmbWarning(UserWarning):
    """Something allowed but suspicious, such as an implausible wave speed."""


def nearest(name: str, names: Iterable[str], n: int = 3) -> tuple[str, ...]:
    """Names that resemble ``name``, else that begin with it, best first, in any case of letters.

    Parameters
    ----------
    name : str
        What was given.
    names : iterable of str
        What there is.
    n : int
        How many to return at most.
    """
    word = name.casefold()
    spellings = [word, *([word[:-1] + "ies"] if word.endswith("y") else [])]  # body: bodies
    matchers = [difflib.SequenceMatcher(b=spelling) for spelling in spellings]
    scored = []
    for candidate in names:
        for matcher in matchers:
            matcher.set_seq1(candidate.casefold())
        scored.append((max(matcher.ratio() for matcher in matchers), candidate))
    scored.sort(key=lambda pair: -pair[0])
    similar = [candidate for score, candidate in scored if score >= _MIN_LIKENESS]
    if not similar and len(name) >= _MIN_BEGINNING:
        similar = [other for _, other in scored if other.casefold().startswith(name.casefold())]
    return tuple(similar[:n])
