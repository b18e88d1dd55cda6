"""A finished error budget: one line, a table, sentences with settings to paste, a picture."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.folders import write_text_file
from flexmb.studies.budgets.error_shares import (
    CONVERGED,
    INTEGRATION,
    INTERFACE,
    MESH,
    MODES,
    NONE,
    NOT_CONVERGED,
    ONE,
    UNKNOWN,
    Share,
)  # fmt: skip
from flexmb.studies.study_settings import label, markdown_table, run_command

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DECIMAL = 1e-6  # texts of smaller percentages are powers of ten
_MIN_LISTED = 0.01  # shares below this fraction of the sum are not listed in the line


def percent(share: float) -> str:
    """A share with two digits, ``0.31 %``."""
    if share >= 0.995:
        return f"{100 * share:.0f} %"
    return f"{100 * share:.2g} %" if share == 0.0 or share >= _DECIMAL else f"{100 * share:.0e} %"


@dataclass(frozen=True, repr=False)
class Budget:
    """The error budget of a scene.

    Attributes
    ----------
    title, source : str
        Of the scene; the scene file is empty for a model from Python.
    folder : Path
        Folder of all its files.
    target : float
        Error over the peak-to-peak that each share is to meet.
    shares : tuple of Share
        Contribution of each knob, by sensor.
    sensors : tuple of str
        The sensors that are judged.
    notes : tuple of str
        Notes for the user.
    cpu : float
        Processor time of the integration of the unchanged scene [s].
    changes : dict
        The cheapest settings of all knobs that have one.
    together : (str, float)
        Error of a run with them, and its processor time [s].
    """

    title: str
    source: str
    folder: Path
    target: float
    shares: tuple[Share, ...]
    sensors: tuple[str, ...]
    notes: tuple[str, ...]
    cpu: float
    changes: dict[str, Any] = field(default_factory=dict)
    together: tuple[str, float] = ("", 0.0)

    def __repr__(self) -> str:
        return f"<Budget {self.sentence()}>"

    @property
    def columns(self) -> tuple[Share, ...]:
        """The shares with known values."""
        return tuple(share for share in self.shares if share.values)

    def total(self, sensor: str) -> float:
        """Sum of the shares of a sensor: an upper bound of its error, as far as the shares are
        known."""
        return sum(share.values.get(sensor, 0.0) for share in self.columns)

    @property
    def open(self) -> tuple[Share, ...]:
        """Shares that are not known or not converged."""
        return tuple(s for s in self.shares if s.state in (UNKNOWN, NOT_CONVERGED))

    def sentence(self) -> str:
        """The budget of the worst sensor in one line."""
        moving = [name for name in self.sensors if any(name in s.values for s in self.columns)]
        if not moving:
            return "no share of the error is known"
        worst = max(moving, key=self.total)
        total = self.total(worst)
        parts = sorted(self.columns, key=lambda s: -s.values.get(worst, 0.0))
        listed = [
            f"{s.name} {percent(s.values.get(worst, 0.0))}"
            for s in parts
            if s.values.get(worst, 0.0) >= _MIN_LISTED * total
        ]
        least = "at least " if any(worst in s.rising for s in self.columns) else ""
        text = f"error of {worst}: {least}{percent(total)} = {' + '.join(listed)}"
        unknown = [share.name for share in self.shares if share.state == UNKNOWN]
        if unknown:
            text += f"; not known: {', '.join(unknown)}"
        return f"{text}; the largest share is {parts[0].name}"

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Headings, and a row for each sensor that moves."""
        heads = ("sensor", *(share.name for share in self.columns), "sum")
        rows = []
        for name in self.sensors:
            if any(name in share.values for share in self.columns):
                cells = [_cell(share, name) for share in self.columns]
                least = "> " if any(name in s.rising for s in self.columns) else ""
                rows.append((name, *cells, least + percent(self.total(name))))
        return heads, rows

    def summary(self) -> list[str]:
        """The line, a sentence for each share, the cheapest settings together."""
        return [self.sentence(), *map(self._share_sentence, self.shares), *self._cheapest()]

    def _share_sentence(self, share: Share) -> str:
        value, sensor = share.worst
        if share.state == NONE:
            return f"{share.name}: none is left out"
        if not share.values:
            return f"{share.name}: {share.state}" * (share.note == "") + (
                f"{share.name}: {share.note}" if share.note else ""
            )
        words = [] if share.kind == INTERFACE else [share.state]
        if share.tried:
            words = [f"{' → '.join(share.tried)}: {share.state}"]
        if share.ratio is not None and share.state in (CONVERGED, NOT_CONVERGED):
            words[0] += f", differences fall by {share.ratio:.3g}"
            if share.kind == MESH and share.state == CONVERGED:
                words[0] += f" (order {math.log2(share.ratio):.1f})"
        if share.state == ONE:
            words[0] += ", its order is not confirmed"
        if share.note:
            words.append(share.note)
        if share.cost is not None:
            words.append(f"takes {share.cost:.2g} times the time")
        verdict = {True: "meets", False: "misses", None: ""}[value <= self.target]
        text = f"{share.name}: {percent(value)} at {sensor} ({'; '.join(words)})"
        text += f"; {verdict} {percent(self.target)}"
        if share.cheapest:
            text += f"; cheapest tried that meets it: {label(share.cheapest)}"
        elif share.met is False and share.kind != INTERFACE:
            text += "; nothing tried meets it"
        elif share.met and share.kind in (MESH, MODES, INTEGRATION) and value <= self.target:
            text += "; the scene's own setting is the cheapest tried"
        return text

    def _cheapest(self) -> Iterator[str]:
        target = percent(self.target)
        missed = [share.name for share in self.shares if share.met is False]
        if missed:
            yield f"no setting tried meets {target} in {', '.join(missed)}"
        if not self.changes:
            if not missed:
                yield f"no cheaper setting than the scene's own was tried that meets {target}"
            return
        text = (
            f"cheapest settings that meet {target} in each other share"
            if missed
            else (f"cheapest settings that meet {target} in each share")
        )
        what, cpu = self.together
        if what:
            text += f" ({what} together, {cpu:.2g} s for {self.cpu:.2g} s)"
        yield f"{text}: {self.command()}"

    def command(self) -> str:
        """The command that runs the cheapest settings."""
        return run_command(self.source or "SCENE", self.changes)

    def markdown(self) -> str:
        """Table and sentences in Markdown."""
        heads, rows = self.table()
        lines = [
            f"### {self.title}: error budget", "",
            *markdown_table(heads, rows, range(1, len(heads))), "",
            "Shares are over the peak-to-peak of each sensor.", "",
            *(f"- {sentence}" for sentence in (*self.summary(), *self.notes)),
        ]  # fmt: skip
        return "\n".join(lines) + "\n"

    def plot(self, output: str | Path | None = None) -> Figure:
        """The shares of each sensor on a logarithmic axis.

        Raises
        ------
        ViewError
            There is nothing to draw, or the file cannot be written.
        """
        from flexmb.view.plot import save_figure
        from flexmb.view.work_precision import budget_figure

        moving = [name for name in self.sensors if any(name in s.values for s in self.columns)]
        points = {share.name: share.values for share in self.columns}
        hollow = {share.name for share in self.open}
        figure = budget_figure(moving, points, hollow, target=self.target, title=self.title)
        if output is not None:
            save_figure(figure, output)
        return figure

    def save(self) -> list[Path]:
        """Write budget.json, budget.md and budget.png into the folder; their paths.

        Raises
        ------
        OutputError
            A file cannot be written.
        """
        files = [self.folder / "budget.json", self.folder / "budget.md"]
        data = {**asdict(self), "folder": "", "sentences": self.summary(), "table": self.table()}
        for file, text in zip(files, (json.dumps(data, indent=1), self.markdown()), strict=True):
            write_text_file(file, text)
        if self.columns:
            files.append(self.folder / "budget.png")
            self.plot(files[-1])
        return files


def _cell(share: Share, sensor: str) -> str:
    if sensor not in share.values:
        return "-"
    return ("> " if sensor in share.rising else "") + percent(share.values[sensor])
