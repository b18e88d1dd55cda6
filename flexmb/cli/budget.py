"""`flexmb budget`: what contributes to the error of each sensor."""

from __future__ import annotations

from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    Fresh,
    JudgedSensors,
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
    from flexmb import studies

    with repeatable_runs() as progress:
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
    screen.heading(f"{result.title}: error budget")
    columns, rows = result.table()
    screen.table(columns, rows, right=tuple(range(1, len(columns))), whole=True)
    for sentence in (*result.summary(), *result.notes):
        screen.line(sentence)
    screen.files(files)
