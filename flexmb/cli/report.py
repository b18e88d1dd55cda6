"""``flexmb report``: a web page of one file on a run, a comparison or a study."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import command, parse_names
from flexmb.cli.render import ViewWords, view_words
from flexmb.errors import FlexmbError


@command()
def report(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT",
            help="A result file or its folder, the folder of a study or a sweep, or several "
            "results.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File that ends in .html; report.html beside the (first) result by default.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that exists.")] = False,
    no_motion: Annotated[
        bool, typer.Option("--no-motion", help="Leave the moving machine out: a smaller page.")
    ] = False,
    parts: Annotated[
        str | None,
        typer.Option(
            help="Of the page on one run, with commas: summary, motion, pictures, checks, plots, "
            "model, effects, accuracy, hot_spots, modes, provenance; all by default.",
            show_default=False,
        ),
    ] = None,
    view: ViewWords = None,
    show: Annotated[bool, typer.Option("--show", help="Open the page in the browser.")] = False,
) -> None:
    """Write a report: one web page that needs nothing else, to read, print and send on.

    What was simulated, the machine in motion, pictures, plots, effects and their audit, accuracy
    and cost, hot spots, modes, notes, provenance. Several results are put beside each other; the
    folder of a study gives what accuracy costs.

    Example: flexmb report out/slider_crank

    Example: flexmb report out/slow out/fast -o both.html

    Example: flexmb report out/slider_crank --parts motion,plots --view camera=top
    """
    from flexmb.workflow.result_page import report as write_report

    for source in sources:
        if not source.exists():
            raise FlexmbError(f"{source}: there is no such result")
    if output is not None and output.exists() and not force:
        raise FlexmbError(f"{output}: exists; give --force to replace it, or another --output")
    words = view_words(None, None, None, None, None, None, view)
    with screen.Bars() as progress:
        path = write_report(
            *sources,
            output=output,
            parts=parse_names(parts) or None,
            motion=not no_motion,
            view=words,
            progress=progress,
        )
    screen.line(f"written: {path} ({path.stat().st_size / 1e6:.1f} MB)")
    if show:
        webbrowser.open(path.resolve().as_uri())
