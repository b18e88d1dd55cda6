"""``flexmb film`` and ``view``: the motion as a film, and in a window or a page that turns."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import RunFile, command, parse_names, parse_numbers, refuse_options
from flexmb.cli.render import (
    CameraNames,
    Color,
    Direction,
    Exaggeration,
    Force,
    Layer,
    Modes,
    Pictured,
    Size,
    Supports,
    Traces,
    ViewWords,
    refuse_existing,
    view_words,
)


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
    camera: CameraNames = None,
    direction: Direction = None,
    view: ViewWords = None,
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
        typer.Option(
            "--output",
            "-o",
            help="Write a web page there, a file .html; a window opens on a desktop, and "
            "view.html is written beside the result where there is none.",
            show_default=False,
        ),
    ] = None,
    page: Annotated[bool, typer.Option("--page", help="A web page also on a desktop.")] = False,
    speed: Annotated[
        float | None,
        typer.Option(
            help="In the window: simulated seconds in a second, as for film.", show_default=False
        ),
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
    from flexmb.view import open_window
    from flexmb.view.window import has_desktop, has_display, write_page_of_motion

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
