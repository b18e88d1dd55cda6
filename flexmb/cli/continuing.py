"""Commands for results that are there: go on with a run, write its channels to a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli.guard import guarded
from flexmb.errors import FlexmbError

__all__ = ["register"]

Given = Annotated[
    Path,
    typer.Argument(help="Result file, or the folder it is in.", show_default=False),
]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command()(guarded(resume))
    app.command()(guarded(export))


def resume(
    result: Given,
    duration: Annotated[
        float | None,
        typer.Option(
            help="A new duration of the run as a whole, in the scene's units, a whole number of "
            "its output intervals; also a finished run goes on then.",
            show_default=False,
        ),
    ] = None,
    as_begun: Annotated[
        bool,
        typer.Option("--as-begun", help="Go on even if the scene file has changed since."),
    ] = False,
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="Leave out the picture and the plot.")
    ] = False,
) -> None:
    """Go on with a run that was stopped or killed, or extend a finished one.

    Goes on from the last state in the result file, with the scene kept there and the flexible
    bodies beside it; what comes out is what the uninterrupted run would have given, to the last
    bit. Rows after that state are computed again.

    Example: flexmb resume out/slider_crank
    """
    from flexmb.cli.actions import show_run
    from flexmb.cli.bars import Bars
    from flexmb.workflow import resume_run

    with Bars() as progress:
        report = resume_run(
            result,
            duration=duration,
            as_begun=as_begun,
            pictures=not no_picture,
            progress=progress,
        )
    show_run(report)


def export(
    result: Given,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File to write, its format by its ending; <result>.csv by default.",
        ),
    ] = None,
    channels: Annotated[
        str | None,
        typer.Option(
            help="Names with commas between them, of any kind: slider.x,energy.kinetic,"
            "crank_pin.rod.force.x,rod.von_mises",
            show_default=False,
        ),
    ] = None,
    what: Annotated[
        str | None,
        typer.Option(
            help="All channels of a kind: sensors, reactions, energy, drift, coordinates, "
            "accelerations or stress; sensors by default.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Write channels over time to a table (.csv), with their units in the header.

    Reactions are forces and moments on the named body, in the joint's axes there (z: its axis).

    Example: flexmb export out/slider_crank --what reactions --output reactions.csv
    """
    from flexmb.cli import show
    from flexmb.results import Result

    if channels is not None and what is not None:
        raise FlexmbError("give either --channels or --what: names of channels, or all of a kind")
    run = Result(result)
    names = [name.strip() for name in (channels or "").split(",") if name.strip()]
    kind = what or "sensors"
    written = run.export(output or run.path.with_suffix(".csv"), names, what=kind)
    columns = len(names) or len(run.channels(kind))
    of = "1 channel" if columns == 1 else f"{columns} channels"
    show.line(f"written: {written} ({len(run.time)} rows of {of})")
