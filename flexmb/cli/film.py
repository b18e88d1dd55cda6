"""``flexmb film`` and ``view``: the motion as a film, and in a window or a page that turns.

The options that say how a run looks are shared with ``flexmb render``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    command,
    parse_direction,
    parse_exaggeration,
    parse_names,
    parse_numbers,
    parse_size,
    refuse_options,
)
from flexmb.errors import FlexmbError

Pictured = Annotated[
    Path, typer.Argument(help="Result file or its folder, or a flexible body.", show_default=False)
]
Exaggeration = Annotated[
    str | None,
    typer.Option(help="Factor on deformations, or auto; the scene's own, else auto."),
]
Color = Annotated[
    str | None,
    typer.Option(
        help="Flexible bodies by displacement (by default) or von_mises stress, or each by its "
        "own: body."
    ),
]
Layer = Annotated[
    str | None,
    typer.Option(
        help="Layer whose stress is shown, such as top; by default the largest of all.",
        show_default=False,
    ),
]
Modes = Annotated[
    str | None,
    typer.Option(
        "--modes",
        "--mode",
        metavar="NUMBERS",
        help="Of a flexible body: 7, 1..6 or 1,3,5; the first six by default.",
        show_default=False,
    ),
]
Supports = Annotated[
    str | None,
    typer.Option(
        "--held",
        metavar="NAMES",
        help="Of a flexible body: interfaces that are held, with commas; free by default.",
        show_default=False,
    ),
]
Direction = Annotated[
    str | None,
    typer.Option(
        help="From the scene towards the eye: x, y, z, -x, -y, -z or numbers such as 1,-1,0.5; "
        "along the joint axes by default."
    ),
]
Size = Annotated[str | None, typer.Option(help="Width x height in pixels; 1280x720 by default.")]
Traces = Annotated[
    str | None,
    typer.Option(
        "--trace",
        metavar="POINTS",
        help="Paths of points, with commas: bodies, whose centre is meant, or markers such as "
        "rod.big_end.",
        show_default=False,
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists.")]


def refuse_existing(output: Path | None, force: bool) -> None:
    """Refuse to replace a file that was named, unless forced."""
    if output is not None and output.is_file() and not force:
        raise FlexmbError(f"{output}: exists; --force replaces it")


@command()
def film(
    file: Pictured,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File .mp4 or .gif, or a folder for PNG pictures; film.mp4 beside the result, or "
            "film.gif without an encoder.",
        ),
    ] = None,
    fps: Annotated[float, typer.Option(help="Frames per second.")] = 25.0,
    speed: Annotated[
        float | None,
        typer.Option(
            help="Simulated seconds in a second of the film: 0.1 is ten times slower; by default "
            "real time for 2 to 20 s, else for a film of some 6 s.",
            show_default=False,
        ),
    ] = None,
    start: Annotated[
        float | None, typer.Option(help="Time of the first frame.", show_default=False)
    ] = None,
    end: Annotated[
        float | None, typer.Option(help="Time of the last frame.", show_default=False)
    ] = None,
    exaggeration: Exaggeration = None,
    color: Color = None,
    layer: Layer = None,
    direction: Direction = None,
    size: Size = None,
    follow: Annotated[
        str | None,
        typer.Option(
            metavar="BODY",
            help="A body that stays in place while the camera moves.",
            show_default=False,
        ),
    ] = None,
    traces: Traces = None,
    modes: Modes = None,
    supports: Supports = None,
    processes: Annotated[
        int | None, typer.Option(help="That draw; the cores by default.", show_default=False)
    ] = None,
    force: Force = False,
) -> None:
    """Make a film of a run, or of mode shapes of a flexible body.

    View, colours and exaggeration suit the whole motion and do not change.

    Example: flexmb film out/slider_crank --speed 0.02 --output crank.gif

    Example: flexmb film out/slider_crank/rod.flexbody.h5 --modes 1..4 --held big_end
    """
    from flexmb.results import file_format
    from flexmb.view import film as film_run
    from flexmb.view import film_modes, vtk_renderer

    look: dict[str, Any] = {
        "exaggeration": parse_exaggeration(exaggeration),
        "direction": parse_direction(direction),
        "size": parse_size(size),
        "fps": fps,
        "processes": processes,
        "force": force,
    }
    with screen.Bars() as progress:
        if not file.is_dir() and file_format(file) == "flexmb-flexbody":
            of_run = {"speed": speed, "start": start, "end": end, "color": color, "layer": layer}
            of_run |= {"follow": follow, "trace": traces}
            refuse_options(of_run, "belongs to the film of a run; this is a flexible body")
            look["exaggeration"] = look["exaggeration"] or "auto"
            numbers, names = parse_numbers(modes, "--modes"), parse_names(supports)
            written = film_modes(
                file, numbers, held=names, output=output, progress=progress, **look
            )
        else:
            of_body = {"modes": modes, "held": supports}
            refuse_options(of_body, "belongs to the film of a flexible body (.flexbody.h5)")
            look |= {"color": color or "displacement", "layer": layer}
            look |= {"speed": speed, "start": start, "end": end, "follow": follow}
            points = parse_names(traces)
            written = film_run(file, output, traces=points, progress=progress, **look)
    verdict = vtk_renderer.probe()
    if not verdict.works:
        screen.line(f"note: {verdict.how}; simple pictures were drawn instead. {verdict.advice}")
    screen.line(f"written: {written}")
