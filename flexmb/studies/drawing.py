"""The plots of a study: which numbers go into them; how they are drawn is the view's business."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from flexmb.errors import ViewError
from flexmb.studies.conclusions import series, swept_knob
from flexmb.studies.machine import machine
from flexmb.studies.plan import is_numerical
from flexmb.studies.words import label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmb.studies.report import Row, Study
    from flexmb.view.work_precision import Curve

__all__ = ["pareto", "save_plots", "work_precision"]


def work_precision(study: Study, output: str | Path | None) -> Figure:
    """Error against wall time, a line for each series of settings."""
    from flexmb.view import work_precision_figure

    lines = series(study)
    panels = {name: _curves(lines, name) for name in study.quantities}
    along = study.knobs[swept_knob(study)]
    figure = work_precision_figure(
        panels, _floors(study), target=study.target, title=study.title,
        note=_note(study, f"along each line: {along}"),
    )  # fmt: skip
    return _kept(figure, output)


def pareto(study: Study, output: str | Path | None) -> Figure:
    """Error against wall time over the models, the front drawn through."""
    from flexmb.view import pareto_figure

    models: dict[str, list[Row]] = {}
    for row in study.rows:
        coarse = {k: v for k, v in row.values.items() if not is_numerical(k)}
        models.setdefault(label(coarse), []).append(row)
    panels = {name: _curves(models, name) for name in study.compared}
    figure = pareto_figure(
        panels, _floors(study), target=study.target, title=study.title,
        note=_note(study, "the front: no other setting is cheaper and better"),
    )  # fmt: skip
    return _kept(figure, output)


def save_plots(study: Study) -> list[Path]:
    """Write work_precision.png and, where models differ, pareto.png; nothing if no run ended."""
    files = []
    folder = study.folder
    if any(math.isfinite(row.time) for row in study.rows):
        files.append(folder / "work_precision.png")
        work_precision(study, files[-1])
    if study.compared and any(_several_models(rows) for rows in study.groups().values()):
        files.append(folder / "pareto.png")
        pareto(study, files[-1])
    return files


def _several_models(rows: Sequence[Row]) -> bool:
    return len({row.physics for row in rows if row.physics}) > 1


def _curves(lines: dict[str, list[Row]], quantity: str) -> list[Curve]:
    from flexmb.view import Curve

    curves = []
    for name, rows in lines.items():
        known = [row for row in rows if quantity in row.errors and row.errors[quantity].shown]
        short = [label({k: v for k, v in row.values.items() if is_numerical(k)}) for row in known]
        curves.append(
            Curve(
                name,
                [row.time for row in known],
                [row.errors[quantity].bound for row in known],
                short,
            )
        )
    return curves


def _floors(study: Study) -> dict[str, float]:
    """Errors below these are not shown, whatever the machine."""
    floors: dict[str, float] = {}
    for row in study.rows:
        for name in study.compared:
            if name in row.errors and row.errors[name].shown:
                floors[name] = max(floors.get(name, 0.0), row.errors[name].floor)
    return floors


def _note(study: Study, first: str) -> str:
    failed = sum(row.status != "finished" for row in study.rows)
    lost = f"; ✗ {failed} of {len(study.rows)} settings failed" if failed else ""
    times = f"median of {study.repeats}, {study.workers} at a time"
    return f"{first}; wall time: {times}{lost}\n{machine()}"


def _kept(figure: Figure, output: str | Path | None) -> Figure:
    from flexmb.view import save_figure

    if not figure.axes:
        raise ViewError("no run has an error to draw")
    if output is not None:
        save_figure(figure, output)
    return figure
