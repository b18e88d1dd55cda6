"""The commands and their options; what they do is in `actions`, what they show in `show`."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli import continuing, drawing, reducing
from flexmb.cli.guard import guarded, settings

__all__ = ["app", "main"]

_ABOUT = """
Flexible multibody dynamics: from a finite-element mesh to a moving, deforming machine.

A scene file (TOML) names bodies, joints, drivers, forces and sensors; `flexmb run` reduces the
meshes it names, simulates it and leaves a result file, a picture and a plot.
"""

_EXAMPLES = """
Examples:

flexmb new my_pendulum

flexmb run cases/slider_crank/scene.toml

flexmb run scene.toml --set speed="2*pi*50" --output out/fast

flexmb resume out/slider_crank

flexmb render out/slider_crank/result.h5 --time 0.013 --output rod.png

flexmb export out/slider_crank --channels slider.x,energy.kinetic --output slider.csv

flexmb reduce cases/slider_crank/scene.toml --body rod --report

flexmb render out/slider_crank/rod.flexbody.h5 --modes 1..6

flexmb list joints

Exit codes: 0 done, 1 a fault of flexmb, 2 a mistake in the input, 3 a check failed, 130 Ctrl-C.
"""

app = typer.Typer(
    name="flexmb",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help=_ABOUT,
    epilog=_EXAMPLES,
)

Scene = Annotated[Path, typer.Argument(help="Scene file (TOML).", show_default=False)]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        "-s",
        metavar="NAME=VALUE",
        help="A new value for a parameter of the scene or for any entry by its path, such as "
        "dynamics.step=1e-5; may be repeated.",
    ),
]


def _show_version(given: bool) -> None:
    if given:
        from flexmb import __version__

        typer.echo(f"flexmb {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an unexpected failure.")
    ] = False,
) -> None:
    settings.debug = debug


@app.command()
@guarded
def run(
    scene: Scene,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder for everything that is written; out/<scene> by default."
        ),
    ] = None,
    overrides: Overrides = None,
    analysis: Annotated[
        str | None,
        typer.Option(help="dynamics or kinematics, for a scene that has both.", show_default=False),
    ] = None,
    start_from: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Another result to begin with the end of: bodies matched by name, time from 0.",
            show_default=False,
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Reduce meshes anew, even if nothing changed.")
    ] = False,
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="Leave out the picture and the plot.")
    ] = False,
) -> None:
    """Run a scene: reduce its meshes, simulate, draw.

    Runs what the scene says: [dynamics] integrates the motion, [kinematics] finds the one that
    joints and drivers fix.

    Leaves result.h5, one flexbody file per flexible body, a picture of the mechanism and a plot of
    its sensors. A flexible body whose mesh, material and options are unchanged is not reduced
    again. Ctrl-C stops the run and keeps what was computed; `flexmb resume` goes on from there.

    Example: flexmb run cases/slider_crank/scene.toml --set r=0.12
    """
    from flexmb.cli.actions import run_scene

    options = {
        "analysis": analysis,
        "start_from": start_from,
        "fresh": fresh,
        "pictures": not no_picture,
    }
    run_scene(scene, output, overrides or [], options)


@app.command()
@guarded
def check(
    scene: Scene,
    overrides: Overrides = None,
    tables: Annotated[
        bool,
        typer.Option("--tables", help="Show the tables that define the model."),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write the report as JSON.")] = False,
) -> None:
    """Validate a scene, count what is in it and what can move, without running it.

    Reports all mistakes at once: where, what was given, what is allowed, and the nearest name. Of a
    valid scene it tells coordinates, equations, their rank and the degrees of freedom; which joints
    share redundant equations and the exchange of joints that removes them; which reactions are then
    not unique; and the motions that are left free.

    Example: flexmb check cases/slider_crank/scene.toml --tables
    """
    from flexmb.cli.actions import check_scene

    check_scene(scene, overrides or [], tables, as_json)


@app.command()
@guarded
def info(
    file: Annotated[
        Path, typer.Argument(help="Result, flexible body, mesh or scene.", show_default=False)
    ],
) -> None:
    """Say what is in a file: a result, a flexible body, a mesh or a scene.

    Example: flexmb info meshes/connecting_rod.msh
    """
    from flexmb.cli.inspect import show_file

    show_file(file)


@app.command()
@guarded
def doctor() -> None:
    """Say what works on this machine and what to install: versions, rendering, cache, compiler."""
    from flexmb.cli.doctor import examine

    examine()


reducing.register(app)
drawing.register(app)
continuing.register(app)


def main() -> None:
    """The entry point of the command ``flexmb``."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a pipe on Windows may lack the letters we use
            stream.reconfigure(errors="replace")
    try:
        app(prog_name="flexmb")
    except KeyboardInterrupt:
        sys.exit(130)
