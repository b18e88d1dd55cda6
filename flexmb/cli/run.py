"""``flexmb run``, ``flexmb resume``, and the summary of a run (`flexmb.results.run_summary`)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shlex import quote
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
    output_option,
    parse_pairs,
)


@command()
def run(
    scene: Scene,
    output: Annotated[
        Path | None, output_option("Folder for everything that is written; out/<scene> by default.")
    ] = None,
    overrides: Overrides = None,
    analysis: Annotated[
        str | None,
        typer.Option(
            help="dynamics, kinematics or statics, for a scene that has several; statics needs no "
            "section."
        ),
    ] = None,
    start_from: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Another result to begin with the end of: bodies matched by name, time from 0.",
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
    from flexmb.workflow import flexible_bodies, simulate

    with screen.Bars() as progress:
        report = simulate.run_scene(
            scene,
            output=output,
            overrides=parse_pairs(overrides, "--set"),
            analysis=analysis,
            start_from=start_from,
            fresh=fresh,
            pictures=not no_picture,
            progress=progress,
        )
    hint = " (--fresh reduces it again)"
    notes = [note + hint if flexible_bodies.REUSED in note else note for note in report.notes]
    _show_run(replace(report, notes=notes))


@command()
def resume(
    result: RunFile,
    duration: Annotated[
        str | None,
        typer.Option(
            help="A new duration of the run as a whole, in the scene's units or as '6 s', a whole "
            "number of its output intervals; a finished run is extended."
        ),
    ] = None,
    as_begun: Annotated[
        bool, typer.Option("--as-begun", help="Resume even if the scene file has changed since.")
    ] = False,
    no_picture: NoPicture = False,
) -> None:
    """Resume a run that was stopped or killed, or extend a finished one.

    Continues from the last state in the result file, with the scene in it and the flexible bodies
    in its folder. The result is that of the uninterrupted run, to the last bit; rows after that
    state are computed again.

    Example: flexmb resume out/slider_crank
    """
    from flexmb.workflow import resume

    with screen.Bars() as progress:
        report = resume.resume_run(
            result, duration=duration, as_begun=as_begun, pictures=not no_picture, progress=progress
        )
    _show_run(report)


@command()
def inverse(
    scene: Scene,
    along: Annotated[
        Path | None,
        typer.Option(
            help="A run with the same bodies whose motion is taken, in place of what the drivers "
            "prescribe."
        ),
    ] = None,
    drive: Annotated[
        list[str] | None,
        typer.Option(
            help="With --along: a joint that gets a driver in addition, elbow or elbow.stroke; may "
            "be repeated."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option("Folder for everything that is written; out/<scene>/inverse by default."),
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
    from flexmb.workflow import drive_forces

    with screen.Bars() as progress:
        report = drive_forces.inverse_scene(
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
    from flexmb.results.run_summary import summary_sentence

    result = Result(report.result)
    show_result(result)
    for columns, rows in report.tables:
        screen.table(columns, rows, whole=True)
    for note in report.notes:
        screen.line(f"note: {note}")
    if report.checks:
        screen.known_answers(report.checks, result.units.label("s"))
    files = [*report.flexbodies.values(), report.result, report.picture, report.history]
    screen.files(files)
    sentence = summary_sentence(result.statistics)
    if sentence:
        screen.line(sentence)
    if result.status == "stopped":
        if report.resumable:
            screen.line(f"resume with: flexmb resume {quote(str(report.output))}")
        raise typer.Exit(INTERRUPTED)
    if any(not outcome.passed for outcome in report.checks):
        raise typer.Exit(FAILED_CHECK)


def show_result(result: Any) -> None:
    """Show how a run ended, its statistics, times, energies and drift."""
    from flexmb.model.scenes.conversion import gravity_in_words
    from flexmb.results.run_summary import energy_rows, time_rows, work_rows

    screen.heading(result.title or str(result.path))
    rows, statistics = len(result.time), result.statistics
    unit = result.units.label("s")
    span = f", {rows} rows to t = {result.time[-1]:g} {unit}" if rows else ", no rows"
    screen.line(f"{result.status}{span}" + (f": {result.message}" if result.message else ""))
    screen.line(gravity_in_words(result.model.get("gravity"), result.units))
    if result.status == "running":
        screen.line("note: the run is still in progress, or it was killed; its rows are complete")
        screen.line(
            f"if it was killed, resume with: flexmb resume {quote(str(result.path.parent))}"
        )
    screen.table(("the run", "", ""), work_rows(statistics, result.units), right=(1,))
    screen.table(("wall time by phase", "s", ""), time_rows(statistics), right=(1,))
    dampings = result.damping.values()
    if dampings:
        table = [(one.body or "together", one.words, one.summary()) for one in dampings]
        screen.table(("damping of", "as the scene says", "as joined"), table)
    if rows:
        screen.table(
            (f"energy [{result.units.label('J')}]", "at the end", "least", "greatest"),
            energy_rows(result),
            right=(1, 2, 3),
        )
    if result.reactions_not_unique:
        screen.line(f"reactions not unique at: {', '.join(result.reactions_not_unique)}")
    if rows and "largest_position_drift" not in statistics:
        position, velocity = result.drift.max(axis=0)
        screen.line(f"largest constraint drift: position {position:.2g}, velocity {velocity:.2g}")
