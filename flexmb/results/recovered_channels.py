"""Channels of stress and section forces, by name.

In: names such as ``rod.von_mises`` (the largest of the body), ``rod.von_mises.17`` (of mesh node
17), ``rod.von_mises.17.top``, ``rod.stress.17.top.xx`` and ``rod.section_force.3.2.Mz`` (of beam
element 3 at its second end). Out: the channel over time and its unit, or an error that says what
there is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem, ResultFileError, nearest
from flexmb.flexbody import SECTION_FORCES, STRESS

if TYPE_CHECKING:
    from flexmb.results.recovered import Recovered

__all__ = ["KINDS", "Asked", "asked", "largest_stress_names", "values_of"]

Array = NDArray[np.float64]

KINDS = ("von_mises", "stress", "section_force")
_SAME = 1e-12  # relative: places whose stress differs by less are one for who asks


class Asked(NamedTuple):
    """What a channel's name asks for."""

    body: str
    kind: str  # one of KINDS
    words: tuple[str, ...]

    @property
    def unit(self) -> str:
        """In SI."""
        if self.kind != "section_force":
            return "Pa"
        return "N" if self.words[-1:] and self.words[-1] in SECTION_FORCES[:3] else "N m"


def asked(result: Recovered, name: str) -> Asked | None:
    """What the name asks for; None for names of other channels."""
    body, *words = name.split(".")
    if body in result.flexbodies and words and words[0] in KINDS:
        return Asked(body, words[0], tuple(words[1:]))
    return None


def largest_stress_names(result: Recovered) -> tuple[str, ...]:
    """The channels of the largest von Mises stress of each body that has stress."""
    bodies = [name for name in result.flexbodies if result.flexbody(name).stress is not None]
    return tuple(f"{name}.von_mises" for name in bodies)


def values_of(result: Recovered, wanted: Asked) -> Array:
    """The channel over time (n,) in the scene's units.

    Raises
    ------
    ResultFileError
        No such node, layer, component, beam element or end; says which there are.
    """
    if wanted.kind == "section_force":
        values = _section_force(result, wanted)
    elif wanted.kind == "stress":
        values = _component(result, wanted)
    else:
        values = _von_mises(result, wanted)
    values.flags.writeable = False
    return values


def _von_mises(result: Recovered, wanted: Asked) -> Array:
    if len(wanted.words) > 2:
        raise _wrong(wanted, "von_mises.17 or von_mises.17.top")
    node = _number(wanted, wanted.words[0], "node") if wanted.words else None
    layer = wanted.words[1] if len(wanted.words) > 1 else None
    found = result.von_mises(wanted.body, node=node, layer=layer)
    return np.array(found.values.max(axis=1))


def _component(result: Recovered, wanted: Asked) -> Array:
    if len(wanted.words) not in (2, 3):
        raise _wrong(wanted, "stress.17.xx or stress.17.top.xx")
    component = _one_of(wanted, wanted.words[-1], STRESS, "component of stress")
    layer = wanted.words[1] if len(wanted.words) == 3 else None
    node = _number(wanted, wanted.words[0], "node")
    found = result.stress(wanted.body, node=node, layer=layer)
    values = found.values[:, :, component]
    apart = np.ptp(values, axis=1).max(initial=0.0)
    if apart > _SAME * np.abs(values).max(initial=0.0):
        places = zip(found.layer, found.part, strict=True)
        names = ", ".join(sorted({" of ".join(filter(None, place)) for place in places}))
        what = f'the body "{wanted.body}" has {len(found.layer)} stresses at node {node} ({names})'
        raise ResultFileError(f"{what}; name a layer, or ask result.stress for all of them")
    return np.array(values[:, 0])


def _section_force(result: Recovered, wanted: Asked) -> Array:
    if len(wanted.words) != 3:
        raise _wrong(wanted, "section_force.3.1.Mz: element, end 1 or 2, component")
    component = _one_of(wanted, wanted.words[2], SECTION_FORCES, "section force")
    end = _one_of(wanted, wanted.words[1], ("1", "2"), "end of a beam element")
    element = _number(wanted, wanted.words[0], "beam element")
    found = result.section_forces(wanted.body)
    if element >= len(found.elements):
        what = f'the body "{wanted.body}" has no beam element {element}'
        raise ResultFileError(f"{what}; it has those from 0 to {len(found.elements) - 1}")
    table = found.force if component < 3 else found.moment
    return np.array(table[:, element, end, component % 3])


def _one_of(wanted: Asked, word: str, allowed: tuple[str, ...], what: str) -> int:
    if word not in allowed:
        told = f'{_name(wanted)}: "{word}" is no {what}'
        problem = Problem("", told, allowed, nearest(word, allowed))
        raise ResultFileError.from_problems([problem])
    return allowed.index(word)


def _number(wanted: Asked, word: str, what: str) -> int:
    if not word.isdecimal():
        raise ResultFileError(f'{_name(wanted)}: "{word}" is no number of a {what}, from 0')
    return int(word)


def _wrong(wanted: Asked, form: str) -> ResultFileError:
    return ResultFileError(f"{_name(wanted)}: is not of the form {wanted.body}.{form}")


def _name(wanted: Asked) -> str:
    return ".".join((wanted.body, wanted.kind, *wanted.words))
