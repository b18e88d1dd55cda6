"""How the library reports its progress.

Every part that may take longer than a second takes a ``progress`` callback and calls it with the
phase, the fraction done (0 to 1) and, where it helps, a detail such as the simulated time. The
library never prints; the command line shows a bar, ``silent`` shows nothing.
"""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """A callback with the phase, the fraction of it that is done, and a detail to show."""

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None: ...


def silent(phase: str, fraction: float, detail: str = "") -> None:
    """The progress that shows nothing."""
