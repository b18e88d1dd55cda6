"""``flexmb info``, ``export`` and ``render``: results, bodies, meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    RunFile,
    command,
    parse_direction,
    parse_exaggeration,
    parse_names,
    parse_numbers,
    parse_size,
    refuse_options,
)
from flexmb.cli.check import show_check
from flexmb.cli.reduce import modes_picture, show_body
from flexmb.cli.run import show_result
from flexmb.errors import FlexmbError


@command()
def info(
    file: Annotated[
        Path, typer.Argument(help="Result, flexible body, mesh or scene.", show_default=False)
    ],
) -> None:
    """Show the content of a file: a result, a flexible body, a mesh or a scene.

    Example: flexmb info meshes/connecting_rod.msh
    """
    if not file.exists():
        raise FlexmbError(f"{file}: there is no such file")
    if file.is_dir() and (file / "result.h5").is_file():
        file = file / "result.h5"
    if file.is_dir():
        raise FlexmbError(
            f"{file}: is a folder without a result.h5; give a result, flexible body, mesh or scene"
        )
    if file.suffix == ".toml":
        from flexmb import workflow

        show_check(workflow.check_scene(file, {}))
    elif file.suffix in (".h5", ".hdf5"):
        _show_h5(file)
    else:
        _show_mesh(file)


def _show_h5(path: Path) -> None:
    from flexmb.results import Result, file_format

    if file_format(path) == "flexmb-flexbody":
        from flexmb.flexbody import load

        body = load(path)
        show_body(body)
        screen.table(("where it comes from", ""), sorted(body.provenance.items()))
        return
    run = Result(path)
    show_result(run)
    bodies = [
        (body.name, str(body.m), str(run.flexbodies.get(body.name, "rigid")))
        for body in run.layout.bodies
    ]
    screen.table(("body", "modes", "file"), bodies, right=(1,))
    dampings = [
        (f"{one.body or 'together'} {k + 1}", f"{f:.6g}", f"{100 * ratio:.4g} %")
        for one in run.damping.values()
        for k, (f, ratio) in enumerate(zip(one.frequencies, one.ratios, strict=True))
    ]
    if dampings:
        screen.table(("mode as joined", "f [Hz]", "damping ratio"), dampings, right=(1, 2))
    screen.table(("channel", "unit"), [(channel, run.unit(channel)) for channel in run.channels()])
    stored, whole = run.row_bytes
    screen.line(f"{stored} bytes a row" + (f", {whole} with everything" if stored < whole else ""))
    screen.line(f"started {run.created}")


def _show_mesh(path: Path) -> None:
    from flexmb.fe import mesh_report, read_mesh

    with screen.Bars() as progress:
        progress("read", 0.0)
        mesh = read_mesh(path)
        progress("read", 1.0)
    screen.heading(f"mesh {path}")
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    size = " x ".join(f"{extent:.6g}" for extent in high - low)
    rows = [("nodes", str(len(mesh.points))), ("size, in the mesh's own unit", size)]
    rows += [(f"{kind} elements", str(len(cells))) for kind, cells in mesh.blocks.items()]
    screen.table(("", ""), rows, right=(1,))
    groups = []
    for name, nodes in mesh.node_sets.items():
        elements = mesh.element_sets.get(name, {}).items()
        groups.append(
            (name, ", ".join(f"{len(k)} {kind}" for kind, k in elements), str(len(nodes)))
        )
    screen.table(("group", "elements", "nodes"), groups, right=(2,))
    for finding in mesh_report(mesh, unit=""):
        screen.line(f"{finding.level}: {finding.sentence}")


@command()
def export(
    result: RunFile,
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
            "accelerations, motion or stress; sensors by default.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Write channels over time to a table (.csv), with their units in the header.

    Reactions are forces and moments on the named body, in the joint's axes there (z: its axis).

    Example: flexmb export out/slider_crank --what reactions --output reactions.csv
    """
    from flexmb.results import Result

    if channels is not None and what is not None:
        raise FlexmbError("give either --channels or --what: names of channels, or all of a kind")
    run = Result(result)
    names, kind = parse_names(channels), what or "sensors"
    written = run.export(output or run.path.with_suffix(".csv"), names, what=kind)
    columns = len(names) or len(run.channels(kind))
    of = "1 channel" if columns == 1 else f"{columns} channels"
    screen.line(f"written: {written} ({len(run.time)} rows of {of})")


@command()
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
    supports: Annotated[
        str | None,
        typer.Option(
            "--held",
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
            help="PNG file; by default picture.png or <body>.modes.png in the same folder.",
        ),
    ] = None,
) -> None:
    """Draw the mechanism at a time of a run, or mode shapes of a flexible body, off-screen.

    Example: flexmb render out/slider_crank/result.h5 --time 0.013 --color von_mises

    Example: flexmb render out/slider_crank/rod.flexbody.h5 --modes 1..6 --held big_end
    """
    from flexmb.results import Result, file_format
    from flexmb.view import render as render_run
    from flexmb.view import render_modes, vtk_renderer

    look: dict[str, Any] = {
        "exaggeration": parse_exaggeration(exaggeration),
        "direction": parse_direction(direction),
        "size": parse_size(size),
    }
    with screen.Bars() as progress:
        progress("picture", 0.0)
        if file_format(file) == "flexmb-flexbody":
            of_run = {"time": time, "color": color, "layer": layer}
            refuse_options(of_run, "belongs to the picture of a run; this is a flexible body")
            look["exaggeration"] = look["exaggeration"] or "auto"
            output = output or modes_picture(file)
            numbers, names = parse_numbers(modes, "--modes"), parse_names(supports)
            written = render_modes(file, numbers, held=names, output=output, **look)
        else:
            of_body = {"modes": modes, "held": supports}
            refuse_options(of_body, "belongs to the picture of a flexible body (.flexbody.h5)")
            result = Result(file)
            look |= {"color": color or "displacement", "layer": layer}
            output = output or result.path.parent / "picture.png"
            written = render_run(result, time, output=output, **look)
        progress("picture", 1.0)
    verdict = vtk_renderer.probe()
    if not verdict.works:
        screen.line(f"note: {verdict.how}; a simple picture was drawn instead. {verdict.advice}")
    screen.line(f"written: {written}")
