"""``flexmb study``, ``sweep`` and ``budget``: many runs of one scene; ``flexmb audit``: effects."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    FAILED_CHECK,
    MISTAKE,
    Dashboard,
    Fresh,
    JudgedSensors,
    Limit,
    Overrides,
    RunFile,
    RunsFolder,
    Scene,
    Scheduler,
    Workers,
    command,
    parse_pairs,
    repeatable_runs,
)


@command()
def study(
    scene: Scene,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            "-v",
            metavar="KNOB=VALUES",
            help="A parameter, a path such as bodies.rod.modes, or accuracy, step, method, ... of "
            "[dynamics]; values as 4,8,16, as 1e-2..1e-6 (by factors of ten) or as 1e-3..1e-5:5 "
            "(five at equal ratios); may be repeated: all combinations are run. By default what "
            "[study] of the scene has.",
        ),
    ] = None,
    overrides: Overrides = None,
    repeats: Annotated[
        int | None, typer.Option(help="Runs of each setting, for the median time; 3.", min=1)
    ] = None,
    target: Annotated[
        float | None, typer.Option(help="Error the cheapest setting must meet; 0.01 is 1 %.")
    ] = None,
    sensor: JudgedSensors = None,
    workers: Workers = 2,
    scheduler: Scheduler = "",
    limit: Limit = 0.0,
    dashboard: Dashboard = False,
    output: RunsFolder = None,
    fresh: Fresh = False,
) -> None:
    """Show what accuracy costs: errors and processor times over any knobs of a scene.

    Errors are the largest over the outputs, over the peak-to-peak, against a tighter run of the
    finest model that a second one confirms. Writes study.csv, study.md and plots. An interrupted
    study continues when the same command is given again.

    Example: flexmb study cases/pendulum/scene.toml --vary step=1e-2..1e-4:5
    """
    from flexmb.studies.accuracy import runner

    with repeatable_runs() as progress:
        result = runner.study(
            scene,
            parse_pairs(vary, "--vary"),
            overrides=parse_pairs(overrides, "--set"),
            output=output,
            workers=workers,
            scheduler=scheduler,
            limit=limit,
            dashboard=screen.line if dashboard else None,
            fresh=fresh,
            progress=progress,
            repeats=repeats,
            target=target,
            sensors=sensor,
        )
        progress("plots", 0.0)
        files = result.save()
        progress("plots", 1.0)
    _show_study(result, files)
    if all(row.status != "finished" for row in result.rows):
        raise typer.Exit(MISTAKE)


def _show_study(study: Any, files: list[Path]) -> None:
    screen.heading(f"{study.title}: what accuracy costs")
    if study.reused:
        screen.line(f"{study.reused} runs were there already (--fresh runs them again)")
    columns, rows = study.table()
    screen.table(columns, rows, right=tuple(range(len(study.knobs), len(columns))), whole=True)
    for sentence in study.summary():
        screen.line(sentence)
    screen.files(files)


@command()
def audit(
    result: RunFile,
    budget: Annotated[
        float | None,
        typer.Option(
            help="Largest share of a sensor's peak-to-peak that an effect which is left out may "
            "contribute; that of the scene, or 0.01, by default.",
            min=0.0,
        ),
    ] = None,
) -> None:
    """Show what each effect contributes to the sensors of a finished run, on or left out.

    Deformation, vibration, geometric stiffening, further modes, damping, gravity, friction: the
    scene with the effect switched is linearised about the computed motion and driven by what that
    motion leaves out of balance in it. The table is kept in the result. Exit code 3 if an effect
    that is left out contributes more than the budget.

    Example: flexmb audit out/slider_crank --budget 0.001
    """
    from flexmb.workflow import audit

    with screen.Bars() as progress:
        made = audit.audit(result, budget=budget, progress=progress)
    show_audit(made)
    if not made.passed:
        raise typer.Exit(FAILED_CHECK)


def show_audit(made: object) -> None:
    """Show the table of an audit, its notes and its outcome."""
    from flexmb.workflow.audit import Audit

    assert isinstance(made, Audit)
    screen.heading(f"{made.title}: effects")
    columns, rows = made.table()
    screen.table(columns, rows, right=(4, 7), whole=True)
    for note in made.notes:
        screen.line(f"note: {note}")
    screen.line(made.sentence())


@command()
def sweep(
    scene: Scene,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            "-v",
            metavar="KNOB=DISTRIBUTION",
            help="A parameter, a path such as bodies.rod.modes, or a field of [dynamics]; as "
            "normal(0.15, 1e-4), uniform(low, high), log-uniform(low, high), triangular(low, mode, "
            "high), low..high (uniform), low..high:5 (five values of a grid) or values a,b,c; may "
            "be repeated. By default what [sweep] of the scene has.",
        ),
    ] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option(
            help="Channel and scalar, such as slider.x:max; one of min, max, peak, peak-to-peak, "
            "rms, mean, final; may be repeated; least and largest of all sensors by default."
        ),
    ] = None,
    find: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUESTION",
            help='Such as "crank_pin.rod.force:max <= 5 kN", "slider.x:max = 0.6" or "minimise '
            'lift.y:rms"; may be repeated. Knobs that meet it are sought in their ranges.',
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="grid, random, latin-hypercube, sobol, saltelli (sensitivities of Sobol) or "
            "derivatives; by default a grid where all knobs have values, else sobol."
        ),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(help="Number of samples; 256. Of saltelli that of its base.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of the random numbers; 0.")] = None,
    overrides: Overrides = None,
    workers: Workers = 2,
    scheduler: Scheduler = "",
    limit: Limit = 0.0,
    dashboard: Dashboard = False,
    histories: Annotated[
        bool, typer.Option("--histories", help="Leave the result of each run in a folder.")
    ] = False,
    output: RunsFolder = None,
    fresh: Fresh = False,
) -> None:
    """Run a scene for many values of its knobs: statistics, sensitivities, worst cases, answers.

    Writes runs.parquet (one row a run), sweep.md and pictures: histograms, scatter, response
    surfaces, sensitivities, parallel coordinates. Failed runs are listed with their reasons. An
    interrupted sweep continues when the same command is given again.

    Example: flexmb sweep scene.toml --vary "l=normal(0.45, 1e-4)" --sensor slider.x:max

    Example: flexmb sweep scene.toml --vary l=0.3..0.6 --find "guide.slider.force:max <= 5 kN"
    """
    from flexmb.studies.sweeps import parameter_sweep

    with repeatable_runs() as progress:
        result = parameter_sweep.sweep(
            scene,
            parse_pairs(vary, "--vary"),
            overrides=parse_pairs(overrides, "--set"),
            output=output,
            histories=histories,
            workers=workers,
            scheduler=scheduler,
            limit=limit,
            dashboard=screen.line if dashboard else None,
            fresh=fresh,
            progress=progress,
            method=method,
            samples=samples,
            seed=seed,
            sensors=sensor,
            find=find,
        )
        progress("pictures", 0.0)
        files = result.save()
        progress("pictures", 1.0)
    _show_sweep(result, files)
    if len(result.failures) == len(result):
        raise typer.Exit(MISTAKE)


def _show_sweep(sweep: Any, files: list[Path]) -> None:
    screen.heading(f"{sweep.title}: sweep")
    for table in sweep.tables():
        screen.line(table.title)
        screen.table(table.columns, table.rows, right=table.right, whole=True)
    for sentence in sweep.summary():
        screen.line(sentence)
    screen.files(files)


@command()
def budget(
    scene: Scene,
    overrides: Overrides = None,
    knob: Annotated[
        list[str] | None,
        typer.Option(
            "--knob",
            "-k",
            help="Only this share: mesh, modes, interface model, integration, constraints, "
            "effects; may be repeated; all by default.",
        ),
    ] = None,
    target: Annotated[
        float, typer.Option(help="Error that each share shall meet; 0.01 is 1 %.")
    ] = 0.01,
    sensor: JudgedSensors = None,
    workers: Workers = 2,
    scheduler: Scheduler = "",
    limit: Limit = 0.0,
    output: RunsFolder = None,
    fresh: Fresh = False,
) -> None:
    """Split the error of each sensor: mesh, modes, interface model, integration, effects.

    Refines one knob at a time, twice, and takes the error from how the differences fall. Says what
    the cheapest setting of each knob is that meets the target. Writes budget.json, budget.md and
    budget.png.

    Example: flexmb budget cases/slider_crank/scene.toml --target 0.001
    """
    from flexmb.studies.budgets import error_budget

    with repeatable_runs() as progress:
        result = error_budget.budget(
            scene,
            overrides=parse_pairs(overrides, "--set"),
            knobs=knob or (),
            target=target,
            sensors=sensor or (),
            output=output,
            workers=workers,
            scheduler=scheduler,
            limit=limit,
            fresh=fresh,
            progress=progress,
        )
        files = result.save()
    screen.heading(f"{result.title}: error budget")
    columns, rows = result.table()
    screen.table(columns, rows, right=tuple(range(1, len(columns))), whole=True)
    for sentence in (*result.summary(), *result.notes):
        screen.line(sentence)
    screen.files(files)
