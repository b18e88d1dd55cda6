"""``flexmb compare``: several models or results of one object beside each other."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import FAILED_CHECK, Overrides, command, parse_names, parse_pairs


@command()
def compare(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="Scene files (TOML), results or their folders; the first is what the others are "
            "compared with.",
            show_default=False,
        ),
    ],
    channels: Annotated[
        str | None,
        typer.Option(
            help="What is compared, with commas; the sensors that all have by default.",
            show_default=False,
        ),
    ] = None,
    overrides: Overrides = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Overlaid plot of the channels that differ most (.png, .pdf, .svg).",
            show_default=False,
        ),
    ] = None,
    folder: Annotated[Path, typer.Option(help="Folder for the results of scenes.")] = Path(
        "out/compare"
    ),
    within: Annotated[
        float | None,
        typer.Option(
            help="Largest difference over the peak-to-peak that is allowed; more ends in exit "
            "code 3.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compare several models of one object: counts, sensors, times, a plot.

    Scenes are run; results are taken as they are. Differences are those from the first model, of
    the sensors that all have.

    Example: flexmb compare cases/quick_return/scene.toml cases/quick_return/pin_in_slot.toml
    """
    from flexmb import workflow
    from flexmb.view.plot import writable_file
    from flexmb.workflow.comparison import STILL

    if output is not None:
        writable_file(output, (".png", ".pdf", ".svg"))
    with screen.Bars() as progress:
        made = workflow.compare(
            *sources, channels=parse_names(channels), output=folder,
            overrides=parse_pairs(overrides, "--set"), progress=progress,
        )  # fmt: skip
    _show_counts(made.models)
    unit = made.models[0].result.units.label("s")
    shown = [d for d in made.differences if d.moves or d.relative > STILL]
    rows = [
        (d.channel, d.model, f"{d.largest:.2g} {d.unit}".rstrip(), f"{d.relative:.1e}",
         f"{d.time:.6g}")
        for d in shown
    ]  # fmt: skip
    columns = ("sensor", "model", "largest difference", "over peak-to-peak", f"at t [{unit}]")
    screen.table(columns, rows, right=(2, 3, 4), whole=True)
    moving = {d.channel for d in shown}
    still = [name for name in made.channels if name not in moving]
    if still:
        screen.line(f"still in all models: {', '.join(still)}")
    for note in made.notes:
        screen.line(f"note: {note}")
    screen.line(f"largest difference from {made.models[0].name}: {made.largest:.1e} of the "
                "peak-to-peak of a sensor")  # fmt: skip
    if output is not None:
        made.plot(*parse_names(channels), output=output)
        screen.line(f"written: {output}")
    if within is not None and made.largest > within:
        screen.line(f"more than the {within:g} that --within allows")
        raise typer.Exit(FAILED_CHECK)


def _show_counts(models: Any) -> None:
    rows = []
    for one in models:
        m = one.mobility
        counts: tuple[str, ...] = ("?",) * 6
        if m is not None:
            equations = m.count - m.drivers
            redundant = equations - m.joint_rank
            figures = (
                m.coordinates,
                m.modes,
                equations,
                redundant,
                m.delta_without_drivers,
                m.drivers,
            )
            counts = tuple(str(n) for n in figures)
        times = (f"{s:.3g}" if isfinite(s) else "" for s in (one.seconds, one.cpu_seconds))
        rows.append((one.name, str(len(one.result.layout.bodies)), *counts, *times))
    columns = ("model", "bodies", "coordinates", "of modes", "equations", "redundant", "freedom",
               "driven", "analysis [s]", "CPU, whole run [s]")  # fmt: skip
    screen.table(columns, rows, right=range(1, 10), whole=True)
