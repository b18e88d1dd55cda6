"""`flexmb budget`: what contributes to the error of each sensor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import INTERRUPTED, Overrides, Scene, command, parse_pairs


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
    sensor: Annotated[
        list[str] | None,
        typer.Option(help="Sensor or channel to judge by; may be repeated; all by default."),
    ] = None,
    workers: Annotated[int, typer.Option(help="Runs at the same time.", min=1)] = 2,
    scheduler: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers do the runs.")
    ] = "",
    limit: Annotated[
        float,
        typer.Option(help="Seconds after which a run is given up; 0: none.", min=0.0),
    ] = 0.0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of the budget; out/<scene>/budget by default."),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Run again what an earlier call left there.")
    ] = False,
) -> None:
    """Split the error of each sensor: mesh, modes, interface model, integration, effects.

    Refines one knob at a time, twice, and takes the error from how the differences fall. Says what
    the cheapest setting of each knob is that meets the target. Writes budget.json, budget.md and
    budget.png.

    Example: flexmb budget cases/slider_crank/scene.toml --target 0.001
    """
    from flexmb import studies

    try:
        with screen.Bars() as progress:
            result = studies.budget(
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
    except KeyboardInterrupt:
        screen.line("stopped; finished runs stay on disk, and the same command continues")
        raise typer.Exit(INTERRUPTED) from None
    screen.heading(f"{result.title}: error budget")
    columns, rows = result.table()
    screen.table(columns, rows, right=tuple(range(1, len(columns))), whole=True)
    for sentence in (*result.summary(), *result.notes):
        screen.line(sentence)
    screen.heading("files")
    for path in files:
        screen.line(f"  {path}")
