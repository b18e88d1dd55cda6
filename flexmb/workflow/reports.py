"""What the workflow hands back: files, statistics, notes, known answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexmb.analysis.mobility.degrees_of_freedom import Mobility
    from flexmb.workflow.listings import Table

__all__ = ["CheckOutcome", "CheckReport", "RunReport"]


@dataclass(frozen=True)
class CheckOutcome:
    """One known answer of a scene and what came out, in the scene's units.

    ``sensor`` is the channel, or says which natural frequency of which body it is; a frequency has
    no time.
    """

    sensor: str
    time: float | None
    value: float
    expected: float
    tolerance: float
    source: str

    @property
    def passed(self) -> bool:
        """Whether the value lies within the tolerance."""
        return abs(self.value - self.expected) <= self.tolerance

    def place(self, unit: str) -> str:
        """The sensor and its time, for a sentence."""
        return self.sensor if self.time is None else f"{self.sensor} at t = {self.time:g} {unit}"


@dataclass(frozen=True)
class RunReport:
    """What a run left behind."""

    output: Path
    result: Path
    flexbodies: dict[str, Path]
    picture: Path | None = None
    history: Path | None = None
    statistics: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    checks: list[CheckOutcome] = field(default_factory=list)
    resumable: bool = True


@dataclass(frozen=True)
class CheckReport:
    """What `flexmb check` tells of a valid scene."""

    title: str
    counts: dict[str, int]
    notes: list[str]
    bodies: dict[str, dict[str, str]] = field(default_factory=dict)
    """What the reduction of each flexible body will keep, in words."""
    mobility: Mobility | None = None
    """Coordinates, equations, rank and what follows; None for what is too large or never moves."""
    definition: tuple[tuple[str, Table], ...] = ()
    """The tables that define the model, each with its title, if they were asked for."""
