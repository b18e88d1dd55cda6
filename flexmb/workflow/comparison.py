"""Comparison of several models of one machine: counts, motions, times.

In: scenes, models or results. Out: a `Comparison`: for each model its number of bodies, coordinates
and equations and its cost, and the differences of its sensors from those of the first model. Scenes
and models are run first.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbError, Problem, ResultFileError, SceneError, nearest
from flexmb.flexbody.arrays import Array
from flexmb.folders import output_folder
from flexmb.progress import Progress, silent
from flexmb.workflow.compiled_model import compile_source
from flexmb.workflow.run import select_analysis
from flexmb.workflow.simulate import run_model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmb.analysis.mobility.degrees_of_freedom import Mobility
    from flexmb.model import Model
    from flexmb.results import Result


STILL = 1e-9
"""A channel whose peak-to-peak is less than this fraction of the largest of its unit stands still.
"""

_SAME_TIME = 1e-9  # times that differ by less than this fraction of the duration are equal
_FEW_ROWS = 4  # number of rows needed for cubic interpolation between times
_ANALYSES = ("integrate", "kinematics", "statics", "inverse_dynamics")
_CUBIC = 16.0  # ratio of the errors of a cubic spline with half the rows and with all rows: 2^4


@dataclass(frozen=True)
class ModelRun:
    """One of the models that are compared.

    Attributes
    ----------
    name : str
        That of the scene or folder.
    result : Result
        Its run.
    mobility : Mobility or None
        Bodies, coordinates, equations, degrees of freedom; None for a model that is too large.
    seconds : float
        Wall time of the analysis itself, NaN if the result does not say.
    cpu_seconds : float
        Processor time of the whole run, including reading and loading; NaN for a result.
    """

    name: str
    result: Result
    mobility: Mobility | None
    seconds: float
    cpu_seconds: float


@dataclass(frozen=True)
class ChannelDifference:
    """Difference of a channel of one model from that of the first model.

    Attributes
    ----------
    channel, model : str
        Name of the channel and of the model.
    largest : float
        The largest difference, in the units of the first model.
    relative : float
        `largest` over the peak-to-peak of the channel in the first model; if the channel stands
        still there, over the largest peak-to-peak among channels of its unit. NaN if none moves.
    moves : bool
        Whether the channel moves in the first model.
    time : float
        Time of the largest difference, in the units of the first model.
    unit : str
        Unit of `largest`.
    """

    channel: str
    model: str
    largest: float
    relative: float
    moves: bool
    time: float
    unit: str


@dataclass(frozen=True)
class Comparison:
    """Several models of one object.

    Attributes
    ----------
    models : tuple of ModelRun
        In the order of the sources; the others are compared with the first.
    channels : tuple of str
        Channels that all models have.
    differences : tuple of ChannelDifference
        One for each channel and each model but the first.
    notes : tuple of str
        For example times that not all models cover, or interpolation between rows.
    """

    models: tuple[ModelRun, ...]
    channels: tuple[str, ...]
    differences: tuple[ChannelDifference, ...]
    notes: tuple[str, ...]

    @property
    def largest(self) -> float:
        """Largest difference over the peak-to-peak, among channels that move; 0 if none moves."""
        relative = [d.relative for d in self.differences if np.isfinite(d.relative)]
        return max(relative, default=0.0)

    def plot(self, *channels: str, output: str | Path | None = None) -> Figure:
        """Draw channels of all models over each other.

        Parameters
        ----------
        *channels : str
            Names of channels; none: those that differ most.
        output : path, optional
            A file that ends in .png, .pdf or .svg.

        Raises
        ------
        ViewError
            The file cannot be written.
        """
        from flexmb.view.history import overlay_figure
        from flexmb.view.plot import save_figure

        unknown = [name for name in channels if name not in self.channels]
        if unknown:
            raise ResultFileError.unknown_name("common channel", unknown[0], self.channels)
        worst = dict[str, float]()
        for d in self.differences:
            if d.moves or d.relative > STILL:
                worst[d.channel] = max(worst.get(d.channel, 0.0), d.relative)
        names = channels or tuple(sorted(worst, key=lambda name: -worst[name])) or self.channels
        runs = {one.name: one.result for one in self.models}
        figure = overlay_figure(runs, names)
        if output is not None:
            save_figure(figure, output)
        return figure


def compare(
    *sources: Model | Result | str | Path,
    channels: Sequence[str] = (),
    output: str | Path = "out/compare",
    overrides: Mapping[str, str] | None = None,
    progress: Progress = silent,
) -> Comparison:
    """Compare several models or results of one object.

    Parameters
    ----------
    *sources : Model, Result or path
        Scene files, models, results or their folders; the others are compared with the first.
    channels : sequence of str
        Channels to compare, of any kind; none: the sensor channels that all models have.
    output : path
        Folder for the results of scenes and models, one folder in it for each.
    overrides : mapping of str to str, optional
        Parameters or knobs to change in all scenes.
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong: fewer than two sources, broken files (all of them at once, before
        anything is run), no common channel, no common time.
    """
    if len(sources) < 2:  # noqa: PLR2004
        raise SceneError(f"{len(sources)} model given: comparing needs two or more")
    names = _short_names(sources)
    ready, problems = [], list[Problem]()
    for name, source in zip(names, sources, strict=True):
        try:
            ready.append(_prepare(source, dict(overrides or {})))
        except FlexmbError as error:
            where = "" if isinstance(source, str | Path) and str(source) in str(error) else name
            problems += [
                Problem(": ".join(part for part in (where, p.where) if part), p.what, p.allowed,
                        p.nearest)
                for p in error.problems
            ]  # fmt: skip
    if problems:
        raise FlexmbError.from_problems(problems)
    runs = [_run(name, one, Path(output), progress) for name, one in zip(names, ready, strict=True)]
    common, notes = _common_channels(runs, channels)
    differences, more = _differences(runs, common)
    return Comparison(tuple(runs), common, tuple(differences), (*notes, *more))


def _short_names(sources: Sequence[Any]) -> list[str]:
    """A short name for each source, all different."""
    names = list[str]()
    for number, source in enumerate(sources):
        path = getattr(source, "path", source)
        if not isinstance(path, str | Path):
            names.append(getattr(source, "title", "") or f"model {number + 1}")
            continue
        path = Path(path)
        scene = path.suffix == ".toml"
        run = path.parent if path.name == "result.h5" else path
        names.append(output_folder(path).name if scene else Path(os.path.abspath(run)).name)
    return [name if names.count(name) == 1 else f"{name} ({k + 1})" for k, name in enumerate(names)]


def _prepare(source: Any, overrides: dict[str, str]) -> Model | Result:
    """A result, or a valid model with an analysis."""
    from flexmb.model import Model, load_scene
    from flexmb.results import Result

    if isinstance(source, str | Path) and Path(source).suffix == ".toml":
        source = load_scene(Path(source), overrides)
    if isinstance(source, Model):
        source.validate()
        select_analysis(source, None)
        return source
    run = source if isinstance(source, Result) else Result(source)
    if not len(run.time):
        raise ResultFileError(f"{run.path}: holds no output rows")
    return run


def _run(name: str, source: Any, output: Path, progress: Progress) -> ModelRun:
    """Run a model, or take a result as it is."""
    from flexmb.analysis.assembly.jacobian import MAX_COORDINATES
    from flexmb.analysis.mobility.degrees_of_freedom import mobility_of
    from flexmb.model import Model
    from flexmb.results import Result

    result, cpu = source, np.nan
    if isinstance(source, Model):
        begin = time.process_time()
        result = Result(run_model(source, output / name, pictures=False, progress=progress).result)
        if result.status == "stopped":  # by Ctrl-C
            raise KeyboardInterrupt
        cpu = time.process_time() - begin
    wall = [result.seconds[phase] for phase in _ANALYSES if phase in result.seconds]
    moves = None
    if result.layout.nv <= MAX_COORDINATES:
        try:
            system = compile_source(result)
            moves = mobility_of(system.compiled, system.model)
        except FlexmbError:  # a result of another version, or without its flexible bodies
            moves = None
    return ModelRun(name, result, moves, wall[0] if wall else np.nan, cpu)


def _common_channels(
    runs: Sequence[ModelRun], requested: Sequence[str]
) -> tuple[tuple[str, ...], list[str]]:
    """Channels that all models have in the same kind of unit, and notes on those left out."""
    first = runs[0].result
    if requested:
        problems = [
            Problem(one.name, f'no channel "{name}"', one.result.channels(),
                    nearest(name, one.result.channels()))
            for one in runs for name in requested if name not in one.result
        ]  # fmt: skip
        if problems:
            raise ResultFileError.from_problems(problems)
        names = tuple(dict.fromkeys(requested))
    else:
        names = tuple(
            name for name in first.channels() if all(name in one.result for one in runs[1:])
        )
    fit = [name for name in names if len({one.result.si_unit(name) for one in runs}) == 1]
    if not fit:
        problems = [Problem("", "the models have no common channel of a sensor; they measure")]
        for one in runs:
            mine = one.result.channels()
            near = [n for name in first.channels() for n in nearest(name, mine, 1)]
            words = ", ".join(mine[:12]) + (f" and {len(mine) - 12} more" if len(mine) > 12 else "")  # noqa: PLR2004
            what = f"{words or 'nothing'}"
            likely = tuple(dict.fromkeys(near))[:3] if one is not runs[0] else ()
            problems.append(Problem(one.name, what, (), likely))
        problems.append(Problem("", "give sensors of the same thing the same name, or --channels"))
        raise ResultFileError.from_problems(problems)
    notes = []
    wrong = [name for name in names if name not in fit]
    if wrong:
        notes.append(f"of different units, not compared: {', '.join(wrong)}")
    if not requested:
        for one in runs:
            own = [name for name in one.result.channels() if name not in names]
            if own:
                shown = ", ".join(own[:6]) + (f" and {len(own) - 6} more" if len(own) > 6 else "")  # noqa: PLR2004
                notes.append(f"{one.name}: not in all models: {shown}")
    return tuple(fit), notes


def _differences(
    runs: Sequence[ModelRun], channels: Sequence[str]
) -> tuple[list[ChannelDifference], list[str]]:
    """Differences of all channels from those of the first model, over the common times."""
    first, notes, differences = runs[0].result, list[str](), list[ChannelDifference]()
    say = first.units.say
    mine = first.table("time")
    low = max(float(one.result.table("time")[0]) for one in runs)
    high = min(float(one.result.table("time")[-1]) for one in runs)
    slack = _SAME_TIME * max(float(np.ptp(mine)), high - low)
    if high < low - slack:
        covered = "; ".join(
            f"{one.name}: {say(float(t[0]), 's')} to {say(float(t[-1]), 's')}"
            for one in runs for t in (one.result.table("time"),)
        )  # fmt: skip
        raise ResultFileError(f"the results have no time in common: {covered}")
    inside = (mine >= low - slack) & (mine <= high + slack)
    if not inside.any():
        raise ResultFileError(
            f"{runs[0].name}: no row between {say(low, 's')} and {say(high, 's')}, where all "
            "results are"
        )
    at = mine[inside]
    cut = [
        one.name for one in runs
        if one.result.table("time")[0] < low - slack or one.result.table("time")[-1] > high + slack
    ]  # fmt: skip
    if cut:
        notes.append(
            f"compared from {say(low, 's')} to {say(high, 's')}, where all results are; "
            f"{', '.join(cut)} cover{'s' * (len(cut) == 1)} more"
        )
    spans = {name: float(np.ptp(first.in_units(name, first.units)[inside])) for name in channels}
    largest = dict[str, float]()
    for name, span in spans.items():
        largest[first.unit(name)] = max(span, largest.get(first.unit(name), 0.0))
    for one in runs[1:]:
        values_at, noise = _sampler(one.result.table("time"), at, slack)
        worst = 0.0
        for name in channels:
            a = first.in_units(name, first.units)[inside]
            b = one.result.in_units(name, first.units)
            gap = np.abs(values_at(b) - a)
            k, unit = int(gap.argmax()), first.unit(name)
            moves = spans[name] > STILL * largest[unit]
            span = spans[name] if moves else largest[unit]
            relative = float(gap[k]) / span if span > 0.0 else np.nan
            worst = max(worst, noise(b) / span if span > 0.0 else 0.0)
            differences.append(
                ChannelDifference(
                    name, one.name, float(gap[k]), relative, moves,
                    first.units.outward(float(at[k]), "s"), unit,
                )
            )  # fmt: skip
        if worst > 0.0:
            notes.append(
                f"{one.name}: its rows are at other times than those of {runs[0].name}, and were "
                f"interpolated, with an error of up to about {worst:.1g} of a peak-to-peak; give "
                "both the same outputs to compare closer"
            )
    return differences, notes


def _sampler(
    times: Array, at: Array, slack: float
) -> tuple[Callable[[Array], Array], Callable[[Array], float]]:
    """A function that interpolates rows at other times, and one that estimates its error."""
    after = np.clip(np.searchsorted(times, at), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    near = np.where(np.abs(times[before] - at) < np.abs(times[after] - at), before, after)
    if np.abs(times[near] - at).max(initial=0.0) <= slack:
        return (lambda values: values[near]), (lambda values: 0.0)
    from scipy.interpolate import CubicSpline

    def rows(values: Array) -> Array:
        if len(times) < _FEW_ROWS:
            return np.asarray(np.interp(at, times, values))
        return np.asarray(CubicSpline(times, values)(at))

    def noise(values: Array) -> float:
        if len(times) < 2 * _FEW_ROWS:
            return float(np.ptp(values))
        coarse = CubicSpline(times[::2], values[::2])(times[1:-1])
        return float(np.abs(coarse - values[1:-1]).max()) / _CUBIC

    return rows, noise
