"""Time and memory of a computation by phase.

In: the calls a :class:`flexmb.progress.Progress` gets. Out: :class:`Stopwatch`, itself such a
callback, with wall time, processor time and the process's peak memory for each phase.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

from flexmb.progress import Progress, silent

try:
    import resource
except ImportError:  # no such module on Windows
    resource = None  # type: ignore[assignment]

__all__ = ["Phase", "Stopwatch"]

_BETWEEN = "other"


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
        self._found: dict[str, Phase] = {}

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        """Charge the time since the last call to ``phase``, or to what lay between two phases."""
        now = time.perf_counter(), time.process_time()
        entry = self._found.setdefault(phase, Phase(phase))
        charged = entry
        if fraction == 0.0:
            charged = self._found.setdefault(_BETWEEN, Phase(_BETWEEN))
        charged.wall += now[0] - self._last[0]
        charged.cpu += now[1] - self._last[1]
        charged.peak = _peak()
        self._last = now
        self._progress(phase, fraction, detail)

    def lap(self) -> tuple[Phase, ...]:
        """The phases so far; the next ones begin anew."""
        phases, self._found = self.phases, {}
        return phases

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases in the order they were first told of, what lay between them last."""
        found = [part for name, part in self._found.items() if name != _BETWEEN]
        between = self._found.get(_BETWEEN)
        return (*found, between) if between is not None else tuple(found)


def _peak() -> int:
    if resource is None:
        return 0
    size = int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return size if sys.platform == "darwin" else 1024 * size
