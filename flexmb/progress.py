"""How the library reports its progress.

Every part that may take longer than a second takes a ``progress`` callback and calls it with the
phase, the fraction done (0 to 1) and, where it helps, a detail such as the simulated time. The
library never prints; the command line shows a bar, ``silent`` shows nothing,
:class:`Stopwatch` measures wall time, processor time and peak memory of each phase.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import Protocol

try:
    import resource
except ImportError:  # no such module on Windows
    resource = None  # type: ignore[assignment]


_BETWEEN = "other"


class Progress(Protocol):
    """A callback with the phase, the fraction of it that is done, and a detail to show."""

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None: ...


def silent(phase: str, fraction: float, detail: str = "") -> None:
    """The progress that shows nothing."""


@dataclass
class Phase:
    """What one phase took: wall and processor time [s], and peak memory until its end [bytes].

    Memory is zero where the system does not tell it.
    """

    name: str
    wall: float = 0.0
    cpu: float = 0.0
    peak: int = 0


class Stopwatch:
    """A progress that measures, and passes every call on to another one."""

    def __init__(self, progress: Progress = silent) -> None:
        self._progress = progress
        self._last = time.perf_counter(), time.process_time()
        self._phases: dict[str, Phase] = {}

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        """Charge the time since the last call to ``phase``, or to what lay between two phases."""
        now = time.perf_counter(), time.process_time()
        entry = self._phases.setdefault(phase, Phase(phase))
        charged = entry
        if fraction == 0.0:
            charged = self._phases.setdefault(_BETWEEN, Phase(_BETWEEN))
        charged.wall += now[0] - self._last[0]
        charged.cpu += now[1] - self._last[1]
        charged.peak = _peak()
        self._last = now
        self._progress(phase, fraction, detail)

    def lap(self) -> tuple[Phase, ...]:
        """The phases so far; the next ones start from zero."""
        phases, self._phases = self.phases, {}
        return phases

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases in the order of their first call, the time between phases last."""
        phases = [part for name, part in self._phases.items() if name != _BETWEEN]
        between = self._phases.get(_BETWEEN)
        return (*phases, between) if between is not None else tuple(phases)


def _peak() -> int:
    if resource is None:
        return 0
    size = int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return size if sys.platform == "darwin" else 1024 * size
