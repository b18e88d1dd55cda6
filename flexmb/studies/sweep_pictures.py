"""The pictures of a sweep: which columns each of them shows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmb.studies.study_settings import headings
from flexmb.studies.sweep_rows import SweepRows
from flexmb.view.sweep_plots import (
    Axis,
    Bar,
    SurfacePicture,
    histogram_figure,
    parallel_figure,
    scatter_figure,
    sensitivity_figure,
    surface_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_PANELS = 9
_GRID = 4  # knobs and scalars of the scatter, each
_SURFACES = 3
_AXES = 10  # of parallel coordinates
_EXPLAINED = 0.5  # of the variance, below which a surface is not worth a picture


def _knobs(sweep: SweepRows) -> list[Axis]:
    """All knobs, the values of choices as numbers with words."""
    axes = []
    for knob, label in headings(tuple(sweep.design.knobs)).items():
        values = sweep[knob]
        if np.issubdtype(values.dtype, np.number):
            axes.append(Axis(label, values.astype(float)))
            continue
        words = tuple(map(str, sweep.design.knobs[knob].choices))
        places = np.array([float(words.index(str(value))) for value in values])
        axes.append(Axis(label, places, words))
    return axes


def _scalars(sweep: SweepRows, count: int) -> list[Axis]:
    """The first scalars that vary."""
    axes = []
    for name, unit in sweep.units.items():
        values = np.asarray(sweep[name], float)
        finite = values[np.isfinite(values)]
        if len(finite) > 1 and np.ptp(finite) > 1e-12 * np.abs(finite).max():
            axes.append(Axis(f"{name} [{unit}]" if unit else name, values))
    return axes[:count]


def _histograms(sweep: SweepRows) -> Figure | None:
    names = [name for name in sweep.scalars if sweep.statistics(name).deviation > 0.0][:_PANELS]
    if sweep.answer is not None or not names or sweep.design.method in ("grid", "derivatives"):
        return None
    axes = [
        Axis(f"{n} [{sweep.units[n]}]" if sweep.units[n] else n, sweep.sample(n)) for n in names
    ]
    marks = [[q.value for q in sweep.statistics(n).quantiles] for n in names]
    note = "dashed: " + ", ".join(f"{100 * share:g} %" for share in sweep.shares)
    return histogram_figure(axes, marks, f"{sweep.title}: histograms", note)


def _scatter(sweep: SweepRows) -> Figure | None:
    knobs, scalars = _knobs(sweep)[:_GRID], _scalars(sweep, _GRID)
    if not scalars or sweep.design.method == "derivatives":
        return None
    joined = len(sweep.design.knobs) == 1 and not knobs[0].words and len(sweep) < 200
    return scatter_figure(knobs, scalars, f"{sweep.title}: runs", joined)


def _surfaces(sweep: SweepRows) -> Figure | None:
    pictures = []
    for axis in _scalars(sweep, _SURFACES):
        scalar = axis.label.partition(" [")[0]
        names, surface = sweep.surface(scalar)
        if surface is None or len(names) < 2 or surface.explained < _EXPLAINED:
            continue
        influence = sweep.correlations(scalar)
        i, j = sorted(range(len(names)), key=lambda k: -abs(influence[names[k]]))[:2]
        labels = headings(tuple(sweep.design.knobs))
        x, y = (Axis(labels[names[k]], sweep[names[k]].astype(float)) for k in (i, j))
        fixed = np.array([np.median(sweep[name].astype(float)) for name in names])

        def fit(u: Array, v: Array, at: tuple[int, int], base: Array, surface=surface) -> Array:  # type: ignore[no-untyped-def]
            points = np.tile(base, (len(u), 1))
            points[:, at[0]], points[:, at[1]] = u, v
            return np.asarray(surface(points))

        others = ", others at their medians" if len(names) > 2 else ""
        note = f"fit of degree 2 explains {100 * surface.explained:.3g} % of the variance{others}"
        pictures.append(SurfacePicture(x, y, axis, partial(fit, at=(i, j), base=fixed), note))
    return surface_figure(pictures, f"{sweep.title}: response surfaces") if pictures else None


def _sensitivities(sweep: SweepRows) -> Figure | None:
    short = headings(tuple(sweep.design.knobs))
    panels = []
    if sweep.design.method == "saltelli":
        for name in sweep.scalars:
            indices = sweep.sobol_indices(name)
            if indices:
                first = [Bar(short[i.knob], i.first, *i.first_interval) for i in indices]
                total = [Bar(short[i.knob], i.total, *i.total_interval) for i in indices]
                panels.append((name, [("first order", first), ("total", total)]))
        ordinate = "share of the variance"
    elif sweep.design.method == "derivatives":
        for name in sweep.scalars:
            bars = []
            for one in sweep.derivatives(name):
                effect, off = one.value * one.deviation, one.error * one.deviation
                bars.append(Bar(short[one.knob], effect, effect - off, effect + off))
            if any(np.isfinite(bar.value) and bar.value for bar in bars):
                panels.append((name, [("", bars)]))
        ordinate = "derivative times deviation of the knob"
    if not panels:
        return None
    return sensitivity_figure(panels[:_PANELS], f"{sweep.title}: sensitivities", ordinate)


def _parallel(sweep: SweepRows) -> Figure | None:
    scalars = _scalars(sweep, _AXES)
    if len(sweep.design.knobs) + len(scalars) < 3 or not scalars:
        return None
    axes = [*_knobs(sweep), *scalars[: max(1, _AXES - len(sweep.design.knobs))]]
    return parallel_figure(axes, scalars[0], f"{sweep.title}: parallel coordinates")


PICTURES: dict[str, Callable[[SweepRows], Figure | None]] = {
    "histograms": _histograms,
    "scatter": _scatter,
    "surfaces": _surfaces,
    "sensitivities": _sensitivities,
    "parallel": _parallel,
}
"""The pictures by kind; None where a sweep has nothing for one."""
