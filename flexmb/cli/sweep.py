"""`flexmb sweep`: samples of any knobs, statistics, sensitivities, and a designer's questions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    MISTAKE,
    Dashboard,
    Fresh,
    Limit,
    Overrides,
    RunsFolder,
    Scene,
    Scheduler,
    Workers,
    command,
    parse_pairs,
    repeatable_runs,
)


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
    from flexmb import studies

    with repeatable_runs() as progress:
        result = studies.sweep(
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
