"""`flexmb study`: run the combinations of some knobs, show what accuracy costs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import show, words
from flexmb.cli.app import Overrides, Scene, app
from flexmb.cli.bars import Bars
from flexmb.cli.guard import INTERRUPTED, MISTAKE, guarded

__all__ = ["study"]


@app.command()
@guarded
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
            "[study] of the scene says.",
        ),
    ] = None,
    overrides: Overrides = None,
    repeats: Annotated[
        int | None, typer.Option(help="Runs of each setting, for the median time; 3.", min=1)
    ] = None,
    target: Annotated[
        float | None, typer.Option(help="Error the cheapest setting must meet; 0.01 is 1 %.")
    ] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option(help="Sensor or channel to judge by; may be repeated; all by default."),
    ] = None,
    workers: Annotated[
        int, typer.Option(help="Runs at the same time. 1 disturbs the timings least.", min=1)
    ] = 2,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of the study; out/<scene>/study by default."),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Run anew what an earlier study left there.")
    ] = False,
) -> None:
    """Show what accuracy costs: errors and wall times over any knobs of a scene.

    Errors are the largest over the outputs, over the peak-to-peak, against a tighter run of the
    finest model that a second one confirms. Writes study.csv, study.md and plots. An interrupted
    study goes on where it was when the same command is given again.

    Example: flexmb study cases/pendulum/scene.toml --vary step=1e-2..1e-4:5
    """
    criteria = {"repeats": repeats, "target": target, "sensors": sensor}
    options = {"output": output, "workers": workers, "fresh": fresh, **criteria}
    knobs = words.pairs(vary or [], "--vary")
    _run(scene, knobs, words.pairs(overrides or [], "--set"), options)


def _run(
    scene: Path, vary: dict[str, str], changes: dict[str, str], options: dict[str, Any]
) -> None:
    from flexmb import studies

    try:
        with Bars() as progress:
            found = studies.study(scene, vary, overrides=changes, progress=progress, **options)
            progress("plots", 0.0)
            files = found.save()
            progress("plots", 1.0)
    except KeyboardInterrupt:
        show.line("stopped; all runs that had ended are kept: the same command goes on from there")
        raise typer.Exit(INTERRUPTED) from None
    _show(found, files)
    if all(row.status != "finished" for row in found.rows):
        raise typer.Exit(MISTAKE)


def _show(found: Any, files: list[Path]) -> None:
    show.heading(f"{found.title}: what accuracy costs")
    if found.reused:
        show.line(f"{found.reused} runs were there already (--fresh runs them anew)")
    columns, rows = found.table()
    show.table(columns, rows, right=tuple(range(len(found.knobs), len(columns))), whole=True)
    for sentence in found.summary():
        show.line(sentence)
    show.heading("files")
    for path in files:
        show.line(f"  {path}")
