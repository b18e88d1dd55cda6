"""``flexmb render``, ``film`` and ``view``: pictures, films and windows of runs and modes."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    RunFile,
    command,
    output_option,
    parse_direction,
    parse_exaggeration,
    parse_names,
    parse_numbers,
    parse_size,
    refuse_options,
)
from flexmb.cli.reduce import modes_picture
from flexmb.errors import FlexmbError

Exaggeration = Annotated[
    str | None, typer.Option(help="Factor on deformations, or auto; the scene's own, else auto.")
]
Color = Annotated[
    str | None,
    typer.Option(
        help="Flexible bodies by displacement (by default), von_mises or principal stress, or "
        "strain_energy, or each by its own: body."
    ),
]
Layer = Annotated[
    str | None,
    typer.Option(help="Layer whose stress is shown, such as top; by default the largest of all."),
]
CameraNames = Annotated[
    str | None,
    typer.Option(
        help="auto, front, back, left, right, top, bottom or isometric; several with commas, side "
        "by side. By default along the joint axes, from where bodies hide each other least."
    ),
]
Direction = Annotated[
    str | None,
    typer.Option(
        help="From the scene towards the eye, in place of a camera: x, y, z, -x, -y, -z or numbers "
        "such as 1,-1,0.5."
    ),
]
ViewWords = Annotated[
    list[str] | None,
    typer.Option(
        "--view",
        metavar="WORD=VALUE",
        help="Any other word of the scene's [view], such as labels=bodies, forces=reactions, "
        "reference=rod.big_end, zoom=2, follow=car, font_scale=1.5; may be repeated.",
    ),
]
Size = Annotated[str | None, typer.Option(help="Width x height in pixels; 1280x720 by default.")]
Pictured = Annotated[Path, typer.Argument(help="Result file or its folder, or a flexible body.")]
Modes = Annotated[
    str | None,
    typer.Option(
        "--modes",
        "--mode",
        metavar="NUMBERS",
        help="Of a flexible body: 7, 1..6 or 1,3,5; the first six by default.",
    ),
]
Supports = Annotated[
    str | None,
    typer.Option(
        "--held",
        metavar="NAMES",
        help="Of a flexible body: interfaces that are held, with commas; free by default.",
    ),
]
Traces = Annotated[
    str | None,
    typer.Option(
        "--trace",
        metavar="POINTS",
        help="Paths of points, with commas: bodies, whose centre is meant, or markers such as "
        "rod.big_end.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists.")]


def view_words(
    exaggeration: str | None,
    color: str | None,
    layer: str | None,
    camera: str | None,
    direction: str | None,
    size: str | None,
    others: list[str] | None,
) -> dict[str, Any]:
    """What the options say of the view, by words of ``[view]``; those without a value left out."""
    words: dict[str, Any] = {
        "exaggeration": parse_exaggeration(exaggeration),
        "color": color,
        "layer": layer,
        "camera": parse_names(camera) or None,
        "direction": parse_direction(direction),
        "size": parse_size(size),
    }
    from flexmb.model.scenes.study import read_value

    words = {key: value for key, value in words.items() if value is not None}
    for text in others or []:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (key and equals and value):
            raise typer.BadParameter(f'"{text}" is not of the form word=value', param_hint="--view")
        words[key] = read_value(value)
    return words


def refuse_existing(output: Path | None, force: bool) -> None:
    """Refuse to replace a file that was named, unless forced."""
    if output is not None and output.is_file() and not force:
        raise FlexmbError(f"{output}: exists; --force replaces it")


@command()
def render(
    file: Pictured,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="TIMES",
            help="Time of the picture, 0.013 in the scene's units or '13 ms', or several with "
            "commas for a panel each; its own, else the end.",
        ),
    ] = None,
    exaggeration: Exaggeration = None,
    color: Color = None,
    layer: Layer = None,
    camera: CameraNames = None,
    modes: Modes = None,
    supports: Supports = None,
    direction: Direction = None,
    view: ViewWords = None,
    size: Size = None,
    ghosts: Annotated[
        int, typer.Option(help="So many poses of the whole run, shown faintly (stroboscope).")
    ] = 0,
    traces: Traces = None,
    force: Force = False,
    output: Annotated[
        Path | None,
        output_option("PNG file; by default picture.png or <body>.modes.png in the same folder."),
    ] = None,
) -> None:
    """Draw the mechanism at a time of a run, or mode shapes of a flexible body, off-screen.

    Example: flexmb render out/slider_crank/result.h5 --time 0.013 --color von_mises

    Example: flexmb render out/slider_crank/result.h5 --time 0.01,0.02,0.03,0.04 --force

    Example: flexmb render out/slider_crank --camera front,top --view forces=reactions

    Example: flexmb render out/slider_crank --ghosts 12 --trace rod,slider --output strobe.png

    Example: flexmb render out/slider_crank/rod.flexbody.h5 --modes 1..6 --held big_end
    """
    from flexmb.flexbody import load_part
    from flexmb.results import Result
    from flexmb.results.result_file import file_format
    from flexmb.units import unit_system
    from flexmb.view import vtk_renderer
    from flexmb.view.modes import render_modes
    from flexmb.view.part_pictures import render_part
    from flexmb.view.picture import render as render_run

    look = view_words(exaggeration, color, layer, camera, direction, size, view)
    with screen.Bars() as progress:
        progress("picture", 0.0)
        refuse_existing(output, force)
        if not file.is_dir() and file_format(file) == "flexmb-flexbody":
            of_run: dict[str, Any] = {"time": time, "color": color, "layer": layer}
            of_run |= {"ghosts": ghosts or None, "trace": traces, "camera": camera, "view": view}
            refuse_options(of_run, "belongs to the picture of a run; this is a flexible body")
            output = output or modes_picture(file)
            numbers, names = parse_numbers(modes, "--modes"), parse_names(supports)
            written = render_modes(file, numbers, held=names, output=output, **look)
        elif not file.is_dir() and file_format(file) == "flexmb-part":
            of_run = {"time": time, "modes": modes, "held": supports, "camera": camera}
            of_run |= {"ghosts": ghosts or None, "trace": traces, "view": view}
            refuse_options(of_run, "belongs to another picture; this is the result of a part")
            part = load_part(file)
            look["units"] = unit_system(part.provenance.get("scene units", "SI"))
            output = output or file.with_suffix(".png")
            written, *others = render_part(part, output=output, **look)
            for other in others:
                screen.line(f"written: {other}")
        else:
            of_body = {"modes": modes, "held": supports}
            refuse_options(of_body, "belongs to the picture of a flexible body (.flexbody.h5)")
            result = Result(file)
            look |= {"ghosts": ghosts, "traces": parse_names(traces)}
            output = output or result.path.parent / "picture.png"
            written = render_run(result, time, output=output, **look)
        progress("picture", 1.0)
    verdict = vtk_renderer.probe()
    if not verdict.works:
        screen.line(f"note: {verdict.how}; a simple picture was drawn instead. {verdict.advice}")
    screen.line(f"written: {written}")


@command()
def film(
    file: Pictured,
    output: Annotated[
        Path | None,
        output_option(
            "File .mp4 or .gif, or a folder for PNG pictures; film.mp4 beside the result, or "
            "film.gif without an encoder."
        ),
    ] = None,
    fps: Annotated[float, typer.Option(help="Frames per second.")] = 25.0,
    speed: Annotated[
        float | None,
        typer.Option(
            help="Simulated seconds in a second of the film: 0.1 is ten times slower; by default "
            "real time for 2 to 20 s, else for a film of some 6 s."
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Time of the first frame, such as 0.1 or '100 ms'."),
    ] = None,
    end: Annotated[str | None, typer.Option(metavar="TIME", help="Time of the last frame.")] = None,
    exaggeration: Exaggeration = None,
    color: Color = None,
    layer: Layer = None,
    camera: CameraNames = None,
    direction: Direction = None,
    view: ViewWords = None,
    size: Size = None,
    follow: Annotated[
        str | None,
        typer.Option(metavar="BODY", help="A body that stays in place while the camera moves."),
    ] = None,
    traces: Traces = None,
    modes: Modes = None,
    supports: Supports = None,
    processes: Annotated[int | None, typer.Option(help="That draw; the cores by default.")] = None,
    force: Force = False,
) -> None:
    """Make a film of a run, or of mode shapes of a flexible body.

    View, colours and exaggeration suit the whole motion and do not change.

    Example: flexmb film out/slider_crank --speed 0.02 --output crank.gif

    Example: flexmb film out/slider_crank/rod.flexbody.h5 --modes 1..4 --held big_end
    """
    from flexmb.results.result_file import file_format
    from flexmb.view import vtk_renderer
    from flexmb.view.film import film as film_run
    from flexmb.view.modes import film_modes

    look: dict[str, Any] = {
        **view_words(exaggeration, color, layer, camera, direction, size, view),
        "fps": fps,
        "processes": processes,
        "force": force,
    }
    with screen.Bars() as progress:
        if not file.is_dir() and file_format(file) == "flexmb-flexbody":
            of_run: dict[str, Any] = {
                "speed": speed,
                "start": start,
                "end": end,
                "color": color,
                "layer": layer,
            }
            of_run |= {"follow": follow, "trace": traces, "camera": camera, "view": view}
            refuse_options(of_run, "belongs to the film of a run; this is a flexible body")
            numbers, names = parse_numbers(modes, "--modes"), parse_names(supports)
            written = film_modes(
                file, numbers, held=names, output=output, progress=progress, **look
            )
        else:
            of_body = {"modes": modes, "held": supports}
            refuse_options(of_body, "belongs to the film of a flexible body (.flexbody.h5)")
            look |= {"speed": speed, "start": start, "end": end, "follow": follow}
            points = parse_names(traces)
            written = film_run(file, output, traces=points, progress=progress, **look)
    verdict = vtk_renderer.probe()
    if not verdict.works:
        screen.line(f"note: {verdict.how}; simple pictures were drawn instead. {verdict.advice}")
    screen.line(f"written: {written}")


@command()
def view(
    result: RunFile,
    output: Annotated[
        Path | None,
        output_option(
            "Write a web page there, a file .html; a window opens on a desktop, and "
            "view.html is written beside the result where there is none."
        ),
    ] = None,
    page: Annotated[bool, typer.Option("--page", help="A web page also on a desktop.")] = False,
    speed: Annotated[
        float | None,
        typer.Option(help="In the window: simulated seconds in a second, as for film."),
    ] = None,
    exaggeration: Exaggeration = None,
    color: Color = None,
    layer: Layer = None,
    camera: CameraNames = None,
    direction: Direction = None,
    words: ViewWords = None,
    size: Size = None,
    force: Force = False,
) -> None:
    """Show a run that plays while you turn and zoom it: in a window, or in the browser.

    In the window the space bar plays and stops, and the options say how it looks. The web page
    needs no network; it shows what the scene's [view] says.

    Example: flexmb view out/slider_crank
    """
    from flexmb.results import Result
    from flexmb.view.window import has_desktop, has_display, open_window, write_page_of_motion

    run = Result(result)
    look = view_words(exaggeration, color, layer, camera, direction, size, words)
    if output is None and not page and has_desktop():
        open_window(run, speed, **look)
        return
    refuse_existing(output, force)
    of_window = {**look, "speed": speed}
    refuse_options(of_window, "belongs to the window on a desktop; this is a web page")
    with screen.Bars() as progress:
        written = write_page_of_motion(run, output, progress)
    if has_display() and output is None:
        webbrowser.open(written.resolve().as_uri())
    elif not has_display():
        screen.line("there is no desktop here: open the page in any browser, it needs no network")
    screen.line(f"written: {written} ({written.stat().st_size / 1e6:.1f} MB)")
