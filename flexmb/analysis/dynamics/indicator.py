"""How far a flexible body is from a limit of its equations: what monitors of a run report."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from flexmb.results import OutputBlock


@dataclass(frozen=True)
class Indicator:
    """How far a body is from a limit of its equations.

    Parameters
    ----------
    body : str
        Its name.
    quantity : str
        What it is: a field of `[validity]`, or another word where no bound is set.
    value, time : float
        The largest value so far, and its moment [s].
    warning : float
        Value from which on the user is told.
    text : callable
        The sentence.
    """

    body: str
    quantity: str
    value: float
    time: float
    warning: float
    text: Callable[[], str]


class Monitor(Protocol):
    """Something that takes rows and has indicators."""

    def add(self, rows: OutputBlock) -> None:
        """Take the next rows."""

    def indicators(self) -> Iterable[Indicator]:
        """What the rows so far say."""
