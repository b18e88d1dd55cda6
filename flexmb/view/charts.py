"""Charts of channels: over other channels, phase, spectrum, Campbell, hodograph, energies.

In: results, names of channels as for :func:`flexmb.history_figure`. Out: matplotlib figures.
Spectra are one-sided amplitudes with a Hann window and without the mean, so that a long sine of
amplitude a has the amplitude a; outputs at unequal times are interpolated to as many equal ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import ResultFileError, ViewError
from flexmb.flexbody.arrays import Array
from flexmb.results import Result
from flexmb.units import UnitSystem
from flexmb.view.history import (
    Line,
    Results,
    Series,
    draw_panels,
    envelope,
    figure_title,
    history_figure,
    open_results,
    select_series,
    time_span,
)
from flexmb.view.plot import COLORMAP, INK, LINES, WIDTH, new_figure, prefixed, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Times = tuple[float, float] | None

_EVEN_SPACING = 1e-6  # relative deviation of intervals up to which times are equally spaced
_MIN_OUTPUTS = 16  # number of outputs needed for a spectrum
_WINDOWS = 24  # windows of a Campbell diagram, with half overlap
_ORDERS = (1, 2, 3, 4)
_DECADES = 4.0  # decades of amplitude that a Campbell diagram colours
# a path that leaves its plane by more than this fraction of its extent gets a second view
_PLANAR_EXTENT = 0.05
_PARTICIPATING = 8  # number of modes shown
_NEGLIGIBLE = 1e-4  # channels below this fraction of the largest are left out unless they are named
_RATES = {
    "position": "velocity", "velocity": "acceleration", "angular_velocity": "angular_acceleration",
    "angle": "angle_rate", "second_angle": "second_angle_rate", "stroke": "stroke_rate",
    "r": "r_dot", "eta": "eta_dot", "r_dot": "r_ddot", "eta_dot": "eta_ddot", "w": "w_dot",
}  # fmt: skip
_RATE_UNITS = {"m/s": "m/s^2", "rad/s": "rad/s^2"}


def xy_figure(
    results: Results, channels: Sequence[str], against: str, times: Times = None
) -> Figure:
    """Channels over another channel of the same result.

    Raises
    ------
    ResultFileError
        No such channel.
    ViewError
        Nothing to draw, or several channels to draw against.
    """
    runs = open_results(results)
    units, lines, x_axis = runs[0].units, [], ""
    series = select_series(runs, channels)
    for one in series:
        over = select_series([one.result], [against])
        if len(over) > 1:
            names = ", ".join(other.channel for other in over[:3])
            raise ViewError(f'"{against}" means {len(over)} channels ({names}, ...); give one')
        rows = time_span(one, units, times)
        lines.append(Line(one, over[0].values(units)[rows], one.values(units)[rows], one.unit))
        x_axis = over[0].unit
    return _over(lines, units, runs, against, x_axis)


def phase_figure(results: Results, channels: Sequence[str], times: Times = None) -> Figure:
    """Rates of channels over the channels; channels without a rate are differentiated.

    Parameters and errors as of :func:`xy_figure`.
    """
    from scipy.interpolate import CubicSpline  # importing takes 0.2 s

    runs = open_results(results)
    units, series = runs[0].units, select_series(runs, channels)
    if len({one.unit for one in series}) > 1:
        names = ", ".join(f"{one.channel} [{units.label(one.unit)}]" for one in series)
        raise ViewError(f"a phase plot has one unit on its axis; draw one at a time: {names}")
    lines = []
    for one in series:
        rows = time_span(one, units, times)
        t, x = one.time(units), one.values(units)
        name = _rate_of(one)
        if name is None:
            x_dot, unit = CubicSpline(t, x)(t, 1), _RATE_UNITS.get(one.unit, f"{one.unit or 1}/s")
        else:
            rate = Series(one.result, name, one.run)
            x_dot, unit = rate.values(units), rate.unit
        lines.append(Line(one, x[rows], x_dot[rows], unit))
    names = ", ".join(dict.fromkeys(one.channel for one in series))
    return _over(lines, units, runs, names, series[0].unit)


def _rate_of(one: Series) -> str | None:
    """The channel that is the rate of another one; None if there is none."""
    parts = one.channel.split(".")
    for k in (len(parts) - 1, len(parts) - 2):
        if k > 0 and parts[k] in _RATES:
            name = ".".join((*parts[:k], _RATES[parts[k]], *parts[k + 1 :]))
            if name in one.result:
                return name
    return None


def spectrum_figure(
    results: Results, channels: Sequence[str] = (), times: Times = None, *, log: bool = False
) -> Figure:
    """Amplitudes of channels over frequency; `log`: on a logarithmic scale.

    Raises
    ------
    ResultFileError
        No such channel.
    ViewError
        Too few outputs for a spectrum.
    """
    runs = open_results(results)
    units, lines = runs[0].units, []
    for one in select_series(runs, channels):
        rows = time_span(one, units, times)
        t, x = even_samples(one, one.time(units)[rows], one.values(units)[rows], units)
        lines.append(Line(one, *amplitudes(t, x), one.unit))
    top = _largest(line.x for line in lines)
    figure, grid = draw_panels(lines, units, figure_title(runs), what="amplitude of ")
    for axes in grid:
        axes.set_xlim(0.0, top)
        if log:
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0.0)
    grid[-1].set_xlabel("frequency [Hz]", color=INK)
    return figure


def even_samples(one: Series, t: Array, x: Array, units: UnitSystem) -> tuple[Array, Array]:
    """Equally spaced times [s] and the values there, interpolated if the run's times are not
    equally spaced.

    Raises
    ------
    ViewError
        Too few outputs.
    """
    if len(t) < _MIN_OUTPUTS:
        what = f"a spectrum needs {_MIN_OUTPUTS} outputs at least, there are {len(t)}"
        raise ViewError(f"{one.result.path}: {what}")
    seconds = t * units.scale("s")
    even = np.linspace(seconds[0], seconds[-1], len(t))
    if np.abs(even - seconds).max() <= _EVEN_SPACING * (even[1] - even[0]):
        return even, x
    from scipy.interpolate import CubicSpline  # importing takes 0.2 s

    return even, CubicSpline(seconds, x)(even)


def amplitudes(t: Array, x: Array) -> tuple[Array, Array]:
    """Frequencies [Hz] and one-sided amplitudes of equally spaced samples without their mean."""
    window = np.hanning(len(x) + 1)[:-1]
    spectrum = np.abs(np.fft.rfft((x - x.mean()) * window)) / window.sum()
    spectrum[1:] *= 2.0
    return np.fft.rfftfreq(len(x), t[1] - t[0]), spectrum


def campbell_of_run(
    results: Results, channels: Sequence[str], against: str | None = None, times: Times = None
) -> Figure:
    """Amplitude of one channel over frequency and time, or over a speed given by a channel.

    For a speed in rad/s its first multiples are drawn as lines: the orders of a run-up.

    Raises
    ------
    ResultFileError
        No such channel.
    ViewError
        More than one channel or result, or too few outputs.
    """
    from matplotlib.colors import LogNorm

    runs = open_results(results)
    series = select_series(runs, channels)
    if len(series) != 1:
        what = f"{len(series)} channels" if len(runs) == 1 else f"{len(series)} lines"
        raise ViewError(f"a Campbell diagram shows one channel of one result, given {what}")
    one, units = series[0], runs[0].units
    rows = time_span(one, units, times)
    t, x = even_samples(one, one.time(units)[rows], one.values(units)[rows], units)
    length = max(_MIN_OUTPUTS, 2 * len(t) // (_WINDOWS + 1))
    starts = range(0, len(t) - length + 1, max(1, length // 2))
    tables = [amplitudes(t[i : i + length], x[i : i + length])[1] for i in starts]
    frequencies = np.fft.rfftfreq(length, t[1] - t[0])
    middle = np.array([t[i : i + length].mean() for i in starts])
    name, unit = "time", "s"
    if against is not None:
        over = select_series([one.result], [against])[0]
        name, unit = over.channel, over.unit
        seconds = one.time(units)[rows] * units.scale("s")
        middle = np.interp(middle, seconds, over.values(units)[rows])
        order = np.argsort(middle)
        middle, tables = middle[order], [tables[k] for k in order]
        if np.ptp(middle) <= _EVEN_SPACING * np.abs(middle).max(initial=0.0):
            what = f"stays at {middle[0]:.4g} {units.label(unit)}"
            raise ViewError(f"{against} {what}; a Campbell diagram needs a speed that changes")
    if len(tables) < 3:
        raise ViewError(f"{one.result.path}: {len(t)} outputs are too few for a Campbell diagram")
    figure = new_figure(WIDTH, 4.8, figure_title(runs))
    axes = figure.subplots()
    table = np.array(tables).T
    top = float(table.max(initial=0.0)) or 1.0
    least = top * 10**-_DECADES
    norm = LogNorm(least, top)
    drawn = axes.pcolormesh(
        middle, frequencies, np.maximum(table, least), norm=norm, cmap=COLORMAP,
        shading="nearest", rasterized=True,
    )  # fmt: skip
    label = f"amplitude of {one.label} [{_label(one.unit, units)}]"
    figure.colorbar(drawn, ax=axes).set_label(label, color=INK)
    if unit == "rad/s":
        turns = np.abs(middle) * units.scale("rad/s") / (2 * np.pi)
        for n in _ORDERS:
            inside = np.flatnonzero(n * turns <= frequencies[-1])
            if len(inside):
                axes.plot(middle[inside], n * turns[inside], color="white", lw=0.9, ls=":")
                at = middle[inside[-1]], n * turns[inside[-1]]
                axes.annotate(f"{n}x", at, color="white", ha="right", va="bottom")
    axes.set_ylim(0.0, frequencies[-1])
    axes.set_xlabel(f"{name} [{units.label(unit, raised=True)}]", color=INK)
    axes.set_ylabel("frequency [Hz]", color=INK)
    style_axes(axes)
    axes.grid(False)
    return figure


def hodograph_figure(results: Results, channels: Sequence[str], times: Times = None) -> Figure:
    """The path of the tip of a vector: a force, a velocity, the position of a marker.

    Parameters
    ----------
    channels : sequence of str
        Names of vectors without their component, such as ``"crank_pin.rod.force"``.

    Raises
    ------
    ResultFileError
        No such vector.
    ViewError
        Vectors of different units, or nothing to draw.
    """
    runs = open_results(results)
    units, series = runs[0].units, select_series(runs, channels, vectors=True)
    if len({one.unit for one in series}) > 1:
        names = ", ".join(f"{one.channel} [{units.label(one.unit)}]" for one in series)
        raise ViewError(f"a hodograph has one unit on its axes; draw one at a time: {names}")
    paths = []
    for one in series:
        rows = time_span(one, units, times)
        parts = [Series(one.result, f"{one.channel}.{axis}", one.run) for axis in "xyz"]
        paths.append(np.stack([part.values(units)[rows] for part in parts]))
    extent = np.max([np.ptp(path, axis=1) for path in paths], axis=0)
    a, b = sorted(np.argsort(-extent, kind="stable")[:2])
    (c,) = {0, 1, 2} - {int(a), int(b)}
    views = [(a, b), (a, c)] if extent[c] > _PLANAR_EXTENT * extent.max() else [(a, b)]
    factor, unit = prefixed(_largest(paths), _label(series[0].unit, units), units)
    figure = new_figure(WIDTH, 5.4 if len(views) == 1 else 4.6, figure_title(runs))
    grid = figure.subplots(1, len(views), squeeze=False)[0]
    for axes, (i, j) in zip(grid, views, strict=True):
        for k, (one, path) in enumerate(zip(series, paths, strict=True)):
            x, y = envelope(path[i] / factor, path[j] / factor, False)
            color = LINES[k % len(LINES)]
            label = one.label.replace("|", "")
            axes.plot(x, y, color=color, lw=1.5, label=label)
            axes.plot(x[:1], y[:1], color=color, marker="o", ms=6, mfc="white", ls="")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"{'xyz'[i]} [{unit}]" if unit else "xyz"[i], color=INK)
        axes.set_ylabel(f"{'xyz'[j]} [{unit}]" if unit else "xyz"[j], color=INK)
        style_axes(axes)
    grid[0].legend(
        loc="lower left", bbox_to_anchor=(-0.01, 1.0), frameon=False, labelcolor=INK, fontsize=9
    )
    return figure


def energy_names(results: Sequence[Result]) -> tuple[str, ...]:
    """Channels of the energies and works that are not always zero, and of the balance."""
    names = (n for run in results for n in run.channels("energy") if run[n].any())
    return tuple(dict.fromkeys(names))


def energy_figure(results: Results, channels: Sequence[str] = (), times: Times = None) -> Figure:
    """Energies and works that are not always zero, and the error of their balance."""
    runs = open_results(results)
    return history_figure(runs, channels or energy_names(runs) or ("energy.*",), times)


def loaded_reactions(results: Sequence[Result], names: Sequence[str] = ()) -> tuple[str, ...]:
    """Vectors of the forces and moments at joints and drivers, one for each action-reaction pair.

    Without names those of all joints and drivers, except those too small to be seen.

    Raises
    ------
    ResultFileError
        No such joint or driver.
    """
    vectors = []
    for run in results:
        for name in names or run.reactions:
            components = run.channels("reactions")
            stems = [one.removesuffix(".x") for one in components if one.endswith(".x")]
            own = [stem for stem in stems if stem.startswith(f"{name}.")]
            if not own and names:
                what = f'the result has no reaction of "{name}"'
                raise ResultFileError.unknown(what, name, run.reactions)
            for quantity in ("force", "moment"):
                vectors += [stem for stem in own if stem.endswith(quantity)][:1]
    unique = tuple(dict.fromkeys(vectors))
    return unique if names else tuple(v for v in unique if any(_is_loaded(r, v) for r in results))


def reactions_figure(results: Results, channels: Sequence[str] = (), times: Times = None) -> Figure:
    """Magnitudes of the forces and moments at joints and drivers; `channels`: their names."""
    runs = open_results(results)
    names = tuple(dict.fromkeys(name for run in runs for name in run.reactions))
    vectors = loaded_reactions(runs, channels)
    if not vectors and names:
        vectors = loaded_reactions(runs, names)  # all reactions are zero
    if not vectors:
        raise ViewError(f"{runs[0].path}: the result has no reactions, or did not store them")
    return history_figure(runs, vectors, times)


def _is_loaded(run: Result, vector: str) -> bool:
    """Whether a reaction is more than round-off, compared with others of its unit."""
    names = [f"{vector}.{axis}" for axis in "xyz"]
    if not all(name in run for name in names):
        return False
    kind = vector.rpartition(".")[2]
    alike = (n for n in run.channels("reactions") if f".{kind}." in n)
    scale = max((float(np.abs(run[n]).max(initial=0.0)) for n in alike), default=0.0)
    return max(float(np.abs(run[n]).max(initial=0.0)) for n in names) > _NEGLIGIBLE * scale


def participating_modes(results: Sequence[Result], bodies: Sequence[str] = ()) -> tuple[str, ...]:
    """Channels of the modes of flexible bodies that have the most strain energy.

    Raises
    ------
    ResultFileError
        No such flexible body.
    """
    names: dict[str, float] = {}
    for run in results:
        for body in bodies or run.flexbodies:
            if body not in run.flexbodies:
                what = f'the result has no flexible body "{body}"'
                raise ResultFileError.unknown(what, body, run.flexbodies)
            for mode in range(run.layout.body(body).m):
                name = f"{body}.mode_energy.{mode}"
                if name in run:
                    names[name] = max(names.get(name, 0.0), float(run[name].max(initial=0.0)))
    least = _NEGLIGIBLE * max(names.values(), default=0.0)
    seen = (name for name in names if names[name] > least)
    return tuple(sorted(seen, key=lambda name: -names[name])[:_PARTICIPATING])


def participation_figure(
    results: Results, channels: Sequence[str] = (), times: Times = None
) -> Figure:
    """Strain energy of the modes of flexible bodies that have the most; `channels`: names of
    bodies."""
    runs = open_results(results)
    modes = participating_modes(runs, channels)
    if not modes:
        what = "no body of the run deforms, or its modal coordinates were not stored"
        raise ViewError(f"{runs[0].path}: {what}")
    return history_figure(runs, modes, times)


CHARTS: dict[str, Callable[..., Figure]] = {
    "history": history_figure,
    "phase": phase_figure,
    "spectrum": spectrum_figure,
    "campbell": campbell_of_run,
    "hodograph": hodograph_figure,
    "energy": energy_figure,
    "reactions": reactions_figure,
    "modes": participation_figure,
}
"""Functions of plots by kind; a history over another channel is an x-y plot."""


def _over(
    lines: Sequence[Line], units: UnitSystem, runs: Sequence[Result], name: str, si_unit: str
) -> Figure:
    """Draw lines over a channel instead of time."""
    factor, shown = prefixed(_largest(line.x for line in lines), _label(si_unit, units), units)
    scaled = [line._replace(x=line.x / factor) for line in lines]
    figure, grid = draw_panels(scaled, units, figure_title(runs), is_function=False)
    grid[-1].set_xlabel(f"{name} [{shown}]" if shown else name, color=INK)
    return figure


def _largest(arrays: Any) -> float:
    return max(float(np.abs(x).max(initial=0.0)) for x in arrays)


def _label(si_unit: str, units: UnitSystem) -> str:
    return units.label(si_unit, raised=True)
