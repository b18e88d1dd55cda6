"""The command that draws: a mechanism at a time of a run, or mode shapes of a flexible body."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import show, words
from flexmb.cli.bars import Bars
from flexmb.cli.guard import guarded

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(guarded(render))


def render(
    file: Annotated[
        Path, typer.Argument(help="Result file, or a flexible body's.", show_default=False)
    ],
    time: Annotated[
        float | None,
        typer.Option(
            help="Time of the picture, in the scene's units; its own, else the end.", min=0.0
        ),
    ] = None,
    exaggeration: Annotated[
        str | None,
        typer.Option(help="Factor on deformations, or auto; the scene's own, else auto."),
    ] = None,
    color: Annotated[
        str | None,
        typer.Option(
            help="Flexible bodies by displacement (by default) or von_mises stress, or each by "
            "its own: body."
        ),
    ] = None,
    layer: Annotated[
        str | None,
        typer.Option(
            help="Layer whose stress is shown, such as top; by default the largest of all.",
            show_default=False,
        ),
    ] = None,
    modes: Annotated[
        str | None,
        typer.Option(
            "--modes",
            "--mode",
            metavar="NUMBERS",
            help="Of a flexible body: 7, 1..6 or 1,3,5; the first six by default.",
            show_default=False,
        ),
    ] = None,
    held: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Of a flexible body: interfaces that are held, with commas; free by default.",
            show_default=False,
        ),
    ] = None,
    direction: Annotated[
        str | None,
        typer.Option(
            help="From the scene towards the eye: x, y, z, -x, -y, -z or numbers such as "
            "1,-1,0.5; along the joint axes by default."
        ),
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="Width x height in pixels; 1280x720 by default.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="PNG file; by default picture.png beside the result, <body>.modes.png beside the "
            "body.",
        ),
    ] = None,
) -> None:
    """Draw the mechanism at a time of a run, or mode shapes of a flexible body, off-screen.

    Example: flexmb render out/slider_crank/result.h5 --time 0.013 --color von_mises

    Example: flexmb render out/slider_crank/rod.flexbody.h5 --modes 1..6 --held big_end
    """
    from flexmb.results import file_format

    look = {
        "exaggeration": words.exaggeration(exaggeration),
        "direction": words.direction(direction),
        "size": words.size(size),
    }
    of_run = {"time": time, "color": color, "layer": layer}
    of_body = {"modes": modes, "held": held}
    if file_format(file) == "flexmb-flexbody":
        _refuse(of_run, "belongs to the picture of a run; this is a flexible body")
        _draw_modes(file, words.numbers(modes, "--modes"), words.names(held), look, output)
    else:
        _refuse(of_body, "belongs to the picture of a flexible body (.flexbody.h5)")
        _draw_run(file, time, {**look, "color": color or "displacement", "layer": layer}, output)


def _refuse(options: dict[str, Any], why: str) -> None:
    for name, given in options.items():
        if given is not None:
            raise typer.BadParameter(why, param_hint=f"--{name}")


def _draw_run(path: Path, time: float | None, look: dict[str, Any], output: Path | None) -> None:
    from flexmb.results import Result
    from flexmb.view import render as draw

    result = Result(path)
    with Bars() as progress:
        progress("picture", 0.0)
        written = draw(result, time, output=output or result.path.parent / "picture.png", **look)
        progress("picture", 1.0)
    _tell(written)


def _draw_modes(
    path: Path,
    modes: list[int] | None,
    held: list[str],
    look: dict[str, Any],
    output: Path | None,
) -> None:
    from flexmb.view import render_modes

    stem = path.name.removesuffix(".h5").removesuffix(".flexbody")
    with Bars() as progress:
        progress("picture", 0.0)
        written = render_modes(
            path,
            modes,
            held=held,
            exaggeration=look["exaggeration"] or "auto",
            direction=look["direction"],
            size=look["size"],
            output=output or path.with_name(f"{stem}.modes.png"),
        )
        progress("picture", 1.0)
    _tell(written)


def _tell(written: Path) -> None:
    from flexmb.view import vtk_renderer

    verdict = vtk_renderer.probe()
    if not verdict.works:
        show.line(f"note: {verdict.how}; a simple picture was drawn instead. {verdict.advice}")
    show.line(f"written: {written}")
