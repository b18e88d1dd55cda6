"""``flexmb run`` and ``flexmb resume``, and the summary of a run: its cost and its accuracy.

A statistic that a run does not have is left out; one without words here is shown under its name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    FAILED_CHECK,
    INTERRUPTED,
    NoPicture,
    Overrides,
    RunFile,
    Scene,
    command,
    parse_pairs,
)
from flexmb.units import SI, UnitSystem

Number = float | int | str
Row = tuple[str, str, str]

_SECONDS = "seconds_"  # statistics of this prefix are wall times by phase
_ITERATIONS = {"newton_iterations": "Newton iterations", "factorisations": "factorisations"}
_ALL_CONSTRAINTS, _UNPROJECTED = "the largest of any constraint", "before the projection"
_WITHOUT_PROJECTION = "baumgarte"  # the method that does not project velocities
_MEASURED, _WORST = "measured_error_of_", "worst_of_"
_QUANTITIES = ("positions", "velocities", "reactions")
_ERRORS = {
    "estimated_error": ("estimated error", "sum of the local errors over the motion; not verified"),
    "energy_balance_error": ("energy balance error", "over the energy that moved"),
    "largest_position_drift": ("position drift", f"m or rad, {_ALL_CONSTRAINTS}"),
    "largest_velocity_drift": ("velocity drift", f"m/s or rad/s, {_UNPROJECTED}"),
}
_OF_STEPS = ("steps", "rejected_steps", "failed_steps", "step_s", "smallest_step_s",
             "largest_step_s", "method", "reason_of_method", "passes", "scout_steps",
             "accuracy_asked")  # fmt: skip
_OF_POINTS = ("points", "increments", "halved_increments", "singular_poses_passed")
_TEN_TIMES = "ten_times_more_accuracy_costs"
_RESUMED = "resumed_at_s"
_PIVOTS = "replaced_pivots"
_WITH_WORDS = {
    *_OF_STEPS, *_OF_POINTS, *_ITERATIONS, *_ERRORS, _PIVOTS, _RESUMED, _TEN_TIMES,
    *(prefix + name for prefix in (_MEASURED, _WORST) for name in _QUANTITIES),
    "reactions_not_unique",
}  # fmt: skip


@command()
def run(
    scene: Scene,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder for everything that is written; out/<scene> by default."
        ),
    ] = None,
    overrides: Overrides = None,
    analysis: Annotated[
        str | None,
        typer.Option(
            help="dynamics, kinematics or statics, for a scene that has several; statics needs no "
            "section.",
            show_default=False,
        ),
    ] = None,
    start_from: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Another result to begin with the end of: bodies matched by name, time from 0.",
            show_default=False,
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Reduce meshes again, even if nothing changed.")
    ] = False,
    no_picture: NoPicture = False,
) -> None:
    """Run a scene: reduce its meshes, simulate, draw.

    [dynamics] of the scene integrates the motion, [kinematics] finds the one that joints and
    drivers prescribe, [statics] an equilibrium at rest.

    Leaves result.h5, one flexbody file per flexible body, a picture of the mechanism and a plot of
    its sensors. A flexible body whose mesh, material and options are unchanged is not reduced
    again. Ctrl-C stops the run and keeps what was computed; `flexmb resume` continues it.

    Example: flexmb run cases/slider_crank/scene.toml --set r=0.12
    """
    from flexmb import workflow

    with screen.Bars() as progress:
        report = workflow.run_scene(
            scene,
            output=output,
            overrides=parse_pairs(overrides, "--set"),
            analysis=analysis,
            start_from=start_from,
            fresh=fresh,
            pictures=not no_picture,
            progress=progress,
        )
    _show_run(report)


@command()
def resume(
    result: RunFile,
    duration: Annotated[
        float | None,
        typer.Option(
            help="A new duration of the run as a whole, in the scene's units, a whole number of "
            "its output intervals; a finished run is extended.",
            show_default=False,
        ),
    ] = None,
    as_begun: Annotated[
        bool,
        typer.Option("--as-begun", help="Resume even if the scene file has changed since."),
    ] = False,
    no_picture: NoPicture = False,
) -> None:
    """Resume a run that was stopped or killed, or extend a finished one.

    Continues from the last state in the result file, with the scene in it and the flexible bodies
    in its folder. The result is that of the uninterrupted run, to the last bit; rows after that
    state are computed again.

    Example: flexmb resume out/slider_crank
    """
    from flexmb import workflow

    with screen.Bars() as progress:
        report = workflow.resume_run(
            result,
            duration=duration,
            as_begun=as_begun,
            pictures=not no_picture,
            progress=progress,
        )
    _show_run(report)


@command()
def inverse(
    scene: Scene,
    along: Annotated[
        Path | None,
        typer.Option(
            help="A run with the same bodies whose motion is taken, in place of what the drivers "
            "prescribe.",
            show_default=False,
        ),
    ] = None,
    drive: Annotated[
        list[str] | None,
        typer.Option(
            help="With --along: a joint that gets a driver in addition, elbow or elbow.stroke; may "
            "be repeated.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder for everything that is written; out/<scene> by default."
        ),
    ] = None,
    overrides: Overrides = None,
    no_picture: NoPicture = False,
) -> None:
    """Find driver forces and all reactions of a motion, without integration (inverse dynamics).

    The drivers of the scene fix the motion, or it is that of another run (--along), such as one
    with torques in place of drivers. Leaves a result, a picture and a plot like `flexmb run`.

    Example: flexmb inverse cases/planar_manipulator/scene.toml

    Example: flexmb inverse arm.toml --along out/arm --drive shoulder --drive elbow
    """
    from flexmb import workflow

    with screen.Bars() as progress:
        report = workflow.inverse_scene(
            scene,
            along=along,
            drives=drive or (),
            output=output,
            overrides=parse_pairs(overrides, "--set"),
            pictures=not no_picture,
            progress=progress,
        )
    _show_run(report)


def _show_run(report: Any) -> None:
    """Show the summary of a run, and end in the exit code that belongs to it."""
    from flexmb.results import Result

    result = Result(report.result)
    show_result(result)
    for columns, rows in report.tables:
        screen.table(columns, rows, whole=True)
    for note in report.notes:
        screen.line(f"note: {note}")
    if report.checks:
        screen.known_answers(report.checks, result.units.label("s"))
    files = [*report.flexbodies.values(), report.result, report.picture, report.history]
    screen.heading("files")
    for path in files:
        if path is not None:
            screen.line(f"  {path}")
    sentence = summary_sentence(result.statistics)
    if sentence:
        screen.line(sentence)
    if result.status == "stopped":
        if report.resumable:
            screen.line(f"resume with: flexmb resume {report.output}")
        raise typer.Exit(INTERRUPTED)
    if any(not outcome.passed for outcome in report.checks):
        raise typer.Exit(FAILED_CHECK)


def show_result(result: Any) -> None:
    """Show how a run ended, its statistics, times, energies and drift."""
    from flexmb.model.scenes.conversion import gravity_in_words

    screen.heading(result.title or str(result.path))
    rows, statistics = len(result.time), result.statistics
    unit = result.units.label("s")
    span = f", {rows} rows to t = {result.time[-1]:g} {unit}" if rows else ", no rows"
    screen.line(f"{result.status}{span}" + (f": {result.message}" if result.message else ""))
    screen.line(gravity_in_words(result.model.get("gravity"), result.units))
    if result.status == "running":
        screen.line("note: the run is still in progress, or it was killed; its rows are complete")
        screen.line(f"if it was killed, resume with: flexmb resume {result.path.parent}")
    screen.table(("the run", "", ""), work_rows(statistics, result.units), right=(1,))
    screen.table(("wall time by phase", "s", ""), time_rows(statistics), right=(1,))
    dampings = result.damping.values()
    if dampings:
        table = [(one.body or "together", one.words, one.summary()) for one in dampings]
        screen.table(("damping of", "as the scene says", "as joined"), table)
    if rows:
        screen.table(
            (f"energy [{result.units.label('J')}]", "at the end", "least", "greatest"),
            _energy_rows(result),
            right=(1, 2, 3),
        )
    if result.reactions_not_unique:
        screen.line(f"reactions not unique at: {', '.join(result.reactions_not_unique)}")
    if rows and "largest_position_drift" not in statistics:
        position, velocity = result.drift.max(axis=0)
        screen.line(f"largest constraint drift: position {position:.2g}, velocity {velocity:.2g}")


def _energy_rows(result: Any) -> list[tuple[str, ...]]:
    """Energies and works that are not zero all along, and the error of their balance."""
    histories = dict(result.energy)
    if result.has_columns("balance") and "inverse_dynamics" not in result.seconds:  # has no work
        histories["energy balance error"] = result.balance
    return [
        (name.replace("_", " "), *(f"{x:.6g}" for x in (values[-1], values.min(), values.max())))
        for name, values in histories.items()
        if values.any()
    ]


def work_rows(statistics: Mapping[str, Number], units: UnitSystem = SI) -> list[Row]:
    """Rows on steps, iterations and errors: name, value, meaning."""
    rows: list[Row] = []
    of = "step" if "steps" in statistics else "point"
    if "steps" in statistics:
        meaning = "; ".join(_about_steps(statistics, units))
        rows.append(("steps", _number_text(statistics["steps"]), meaning))
    if "points" in statistics:
        meaning = "; ".join(_about_points(statistics))
        rows.append(("points", _number_text(statistics["points"]), meaning))
    for key, name in _ITERATIONS.items():
        if key in statistics:
            ratio = float(statistics[key]) / max(float(statistics.get(f"{of}s", 0)), 1.0)
            rows.append((name, _number_text(statistics[key]), f"{ratio:.3g} per {of}"))
    if statistics.get(_PIVOTS):
        meaning = "regularised: long steps, or inertia is missing somewhere"
        rows.append(("ill-conditioned pivots", _number_text(statistics[_PIVOTS]), meaning))
    rows += _measured_errors(statistics)
    for key, (name, meaning) in _ERRORS.items():
        if key in statistics:
            exact = "points" in statistics or statistics.get("method") == _WITHOUT_PROJECTION
            text = meaning.replace(_UNPROJECTED, _ALL_CONSTRAINTS) if exact else meaning
            rows.append((name, f"{float(statistics[key]):.2g}", text))
    if _RESUMED in statistics:
        time = f"{float(statistics[_RESUMED]):.6g} s"
        rows.append(("resumed at", time, "wall times count from there"))
    rows += [
        (key.replace("_", " "), _number_text(value), "")
        for key, value in statistics.items()
        if key not in _WITH_WORDS and not key.startswith(_SECONDS)
    ]
    return rows


def _measured_errors(statistics: Mapping[str, Number]) -> Iterator[Row]:
    """Rows on the errors that a scout has measured."""
    for name in _QUANTITIES:
        key = f"{_MEASURED}{name}"
        if key in statistics:
            meaning = f"measured, over the peak-to-peak: {statistics.get(f'{_WORST}{name}', '')}"
            if name == "positions" and "accuracy_asked" in statistics:
                meaning += f"; {float(statistics['accuracy_asked']):.1g} asked"
            yield f"error of {name}", f"{float(statistics[key]):.2g}", meaning


def _about_steps(statistics: Mapping[str, Number], units: UnitSystem) -> Iterator[str]:
    if "step_s" in statistics:
        yield f"of {units.say(float(statistics['step_s']), 's')}"
    if "smallest_step_s" in statistics and "largest_step_s" in statistics:
        least = units.outward(float(statistics["smallest_step_s"]), "s")
        yield f"of {least:.3g} to {units.say(float(statistics['largest_step_s']), 's', 3)}"
    if "method" in statistics:
        reason = statistics.get("reason_of_method")
        yield f"by {statistics['method']}" + (f" ({reason})" if reason is not None else "")
    if "scout_steps" in statistics:
        passes = int(statistics.get("passes", 1))
        last = f" in the last of {passes} passes" if passes > 1 else ""
        yield f"{_number_text(statistics['scout_steps'])} of its scout{last}"
    if "rejected_steps" in statistics:
        yield f"{_number_text(statistics['rejected_steps'])} rejected"
    if statistics.get("failed_steps"):
        yield f"{_number_text(statistics['failed_steps'])} failed and tried shorter"


def _about_points(statistics: Mapping[str, Number]) -> Iterator[str]:
    more = int(statistics.get("increments", 0)) - int(statistics["points"])
    if more > 0:
        yield f"{_number_text(more)} more between them"
    if statistics.get("halved_increments"):
        yield f"{_number_text(statistics['halved_increments'])} increments failed and were halved"


def time_rows(statistics: Mapping[str, Number]) -> list[Row]:
    """Rows on wall time: phase, seconds, and the time of a step or point."""
    rows = []
    for key, value in statistics.items():
        if key.startswith(_SECONDS):
            phase = key.removeprefix(_SECONDS)
            of = {"integrate": "steps", "kinematics": "points", "statics": "points"}.get(phase, "")
            meaning = ""
            if statistics.get(of) and _RESUMED not in statistics:
                microseconds = 1e6 * float(value) / float(statistics[of])
                meaning = f"{microseconds:.3g} µs per {of.removesuffix('s')}"
            rows.append((phase.replace("_", " "), f"{float(value):.3g}", meaning))
    return rows


def summary_sentence(statistics: Mapping[str, Number]) -> str:
    """The run in one line; empty for a run without steps and points."""
    what, phase = ("steps", "integrate") if "steps" in statistics else ("points", "kinematics")
    phase = "statics" if f"{_SECONDS}statics" in statistics else phase
    if what not in statistics:
        return ""
    text = f"{_number_text(statistics[what])} {what}"
    if f"{_SECONDS}{phase}" in statistics and _RESUMED not in statistics:
        text += f" in {float(statistics[f'{_SECONDS}{phase}']):.3g} s"
    errors = [
        f"{name} {float(statistics[key]):.1g}"
        for key, name in (
            ("measured_error_of_positions", "measured error"),
            ("estimated_error", "estimated error"),
            ("energy_balance_error", "energy balance"),
            ("largest_position_drift", "drift"),
        )
        if key in statistics
    ]
    if errors:
        text += f": {', '.join(errors)}"
    if _TEN_TIMES in statistics:
        factor = float(statistics[_TEN_TIMES])
        text += f"; ten times more accuracy would cost about {factor:.2g} times the time"
    return text


def _number_text(value: Number) -> str:
    """A number as tables show it: spaces between thousands, six digits."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:_}".replace("_", " ") if isinstance(value, int) else str(value)
