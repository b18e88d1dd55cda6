"""The screen: progress bars on the error stream, lines and tables on the standard output."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from flexmb.errors import printable

_WIDTH = 100  # columns where the output is a file or a pipe
_MAX_NAME = 24  # letters of names in the first column that are not folded
_UNLIMITED = 10_000  # columns that no table fills
_LONG_PHASE = 1.0  # seconds from which a phase is worth a line


def line(text: str) -> None:
    """One line, never wrapped or coloured: paths can be copied."""
    console().print(printable(text), markup=False, highlight=False, soft_wrap=True)


def heading(text: str) -> None:
    """The title of what follows."""
    console().print(printable(text), style="bold", markup=False, highlight=False, soft_wrap=True)


def files(paths: Iterable[Path | None]) -> None:
    """Print the files that a command has written."""
    heading("files")
    for path in paths:
        if path is not None:
            line(f"  {path}")


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    right: Sequence[int] = (),
    *,
    whole: bool = False,
) -> None:
    """A table; the columns numbered in `right` are set flush right.

    A `whole` one is as wide as it needs to be where the output is a file or a pipe.
    """
    named = any(columns)
    shown = Table(
        box=SIMPLE_HEAD if named else None, show_header=named, pad_edge=False, header_style="bold"
    )
    rows = list(rows)
    short = max((len(row[0]) for row in rows), default=0) <= _MAX_NAME
    for i, name in enumerate(columns):
        justify: Literal["left", "right"] = "right" if i in right else "left"
        shown.add_column(
            escape(printable(name)), justify=justify, overflow="fold", no_wrap=i == 0 and short
        )
    for row in rows:
        shown.add_row(*(escape(printable(cell)) for cell in row))
    screen = console()
    if whole and not screen.is_terminal:
        screen.width = max(screen.width, Console(width=_UNLIMITED).measure(shown).maximum)
    if shown.row_count:
        screen.print(shown)


OUTCOME_FIGURES = ("value", "expected", "off by", "allowed")


def outcome_figures(o: Any) -> tuple[str, ...]:
    """Cells of a known answer under `OUTCOME_FIGURES`."""
    error = f"{abs(o.value - o.expected):.2g}"
    return f"{o.value:.12g}", f"{o.expected:.12g}", error, f"{o.tolerance:.2g}"


def verdict(o: Any) -> str:
    """Of a known answer."""
    return "open" if o.is_open else "ok" if o.passed else "FAILED"


def failed_outcomes(outcomes: Sequence[Any], unit: str, where: str = "") -> None:
    """A line for each known answer that failed; `where` stands before it."""
    for o in outcomes:
        if o.is_open:
            what = f"lies between outputs, which leave it open by {o.uncertainty:.2g}"
            line(f"not decided: {where}{o.place(unit)} {what}; add the time to outputs")
        elif not o.passed:
            line(f"failed: {where}{o.place(unit)}; the expected value is from: {o.source}")


def known_answers(outcomes: Sequence[Any], unit: str) -> None:
    """Show known answers of a scene with the computed values; times if any has one."""
    timed = any(o.time is not None for o in outcomes)
    rows = [
        (
            verdict(o),
            o.sensor,
            *(("" if o.time is None else f"{o.time:g}",) if timed else ()),
            *outcome_figures(o),
        )
        for o in outcomes
    ]
    when = (f"t [{unit}]",) if timed else ()
    columns = ("check", "of", *when, *OUTCOME_FIGURES)
    table(columns, rows, right=range(2, len(columns)), whole=True)
    failed_outcomes(outcomes, unit)


def console() -> Console:
    """The standard output, of a fixed width where it is a file or a pipe."""
    screen = Console()
    return screen if screen.is_terminal else Console(width=_WIDTH)


class Bars:
    """A progress callback for a ``with`` statement: a bar for every phase while it is under way.

    Where the error stream is a file or a pipe, one line for each phase that took longer than a
    second.
    """

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
        """Show the fraction of a phase that is done; a phase that begins again gets a new bar."""
        if phase not in self._tasks:
            self._tasks[phase] = self._bars.add_task(
                escape(printable(phase)), total=1.0, detail=detail
            )
            self._started[phase] = time.perf_counter()
        self._bars.update(self._tasks[phase], completed=fraction, detail=escape(printable(detail)))
        if fraction >= 1.0:
            self._finish(phase)

    def _finish(self, phase: str) -> None:
        self._bars.update(self._tasks.pop(phase), visible=False)
        seconds = time.perf_counter() - self._started.pop(phase)
        if not self._console.is_terminal and seconds >= _LONG_PHASE:
            sys.stderr.write(f"{phase}: {seconds:.1f} s\n")
            sys.stderr.flush()
