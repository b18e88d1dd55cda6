"""Progress on the screen: a bar for every phase of the library, gone when the work is done.

In: the library's progress calls. Out: bars on the error stream of a terminal; where that is a file
or a pipe, one line for each phase that took longer than a second.
"""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

__all__ = ["Bars"]

_LONG = 1.0  # seconds from which a phase is worth a line


class Bars:
    """A progress callback to be used in a ``with`` statement."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=28),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[detail]}"),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._tasks: dict[str, TaskID] = {}
        self._started: dict[str, float] = {}

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        """Show how far a phase is; a phase that begins again gets a new bar."""
        if phase not in self._tasks:
            self._tasks[phase] = self._bars.add_task(phase, total=1.0, detail=detail)
            self._started[phase] = time.perf_counter()
        self._bars.update(self._tasks[phase], completed=fraction, detail=detail)
        if fraction >= 1.0:
            self._finish(phase)

    def _finish(self, phase: str) -> None:
        self._bars.update(self._tasks.pop(phase), visible=False)
        seconds = time.perf_counter() - self._started.pop(phase)
        if not self._console.is_terminal and seconds >= _LONG:
            sys.stderr.write(f"{phase}: {seconds:.1f} s\n")
            sys.stderr.flush()
