"""``flexmb info`` and ``export``: results, bodies, meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import RunFile, command, output_option, parse_names
from flexmb.cli.check import show_check
from flexmb.cli.part import show_part
from flexmb.cli.reduce import show_body
from flexmb.cli.run import show_result
from flexmb.errors import FlexmbError
from flexmb.units import unit_system


@command()
def info(
    file: Annotated[Path, typer.Argument(help="Result, flexible body, mesh or scene.")],
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
        from flexmb.workflow import check

        show_check(check.check_scene(file, {}))
    elif file.suffix in (".h5", ".hdf5"):
        _show_h5(file)
    else:
        _show_mesh(file)


def _show_h5(path: Path) -> None:
    from flexmb.results import Result
    from flexmb.results.result_file import file_format

    if file_format(path) == "flexmb-flexbody":
        from flexmb.flexbody import load

        body = load(path)
        show_body(body)
        screen.table(("where it comes from", ""), sorted(body.provenance.items()))
        return
    if file_format(path) == "flexmb-part":
        from flexmb.flexbody import load_part

        part = load_part(path)
        show_part(part, unit_system(part.provenance.get("scene units", "SI")))
        screen.table(("where it comes from", ""), sorted(part.provenance.items()))
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
        output_option("File to write, its format by its ending; <result>.csv by default."),
    ] = None,
    channels: Annotated[
        str | None,
        typer.Option(
            help="Names with commas between them, of any kind: slider.x,energy.kinetic,"
            'crank_pin.rod.force,rod.von_mises; also with *, ? and [...]: "slider.*"'
        ),
    ] = None,
    what: Annotated[
        str | None,
        typer.Option(
            help="All channels of a kind: sensors, reactions, energy, drift, coordinates, "
            "accelerations, motion or stress; sensors by default."
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
    names = run.select(parse_names(channels)) if channels else run.channels(what or "sensors")
    written = run.export(output or run.path.with_suffix(".csv"), names, what=what or "sensors")
    columns = len(names)
    of = "1 channel" if columns == 1 else f"{columns} channels"
    screen.line(f"written: {written} ({len(run.time)} rows of {of})")
