"""What is in a file: a result, a flexible body, a mesh or a scene, told by its content."""

from __future__ import annotations

from pathlib import Path

from flexmb.cli import show
from flexmb.cli.bars import Bars
from flexmb.errors import FlexmbError

__all__ = ["show_file"]


def show_file(path: Path) -> None:
    """Show what a file holds.

    Raises
    ------
    FlexmbError
        No such file, or none that flexmb knows.
    """
    if not path.exists():
        raise FlexmbError(f"{path}: there is no such file")
    if path.is_dir() and (path / "result.h5").is_file():
        path = path / "result.h5"
    if path.is_dir():
        raise FlexmbError(
            f"{path}: is a folder without a result.h5; give a result, flexible body, mesh or scene"
        )
    if path.suffix == ".toml":
        from flexmb import workflow
        from flexmb.cli import checking

        checking.check_report(workflow.check_scene(path, {}))
    elif path.suffix in (".h5", ".hdf5"):
        _show_h5(path)
    else:
        _show_mesh(path)


def _show_h5(path: Path) -> None:
    from flexmb.results import Result, file_format

    if file_format(path) == "flexmb-flexbody":
        from flexmb.flexbody import load

        body = load(path)
        show.flexible_body(body)
        rows = sorted(body.provenance.items())
        show.table(("where it comes from", ""), rows)
        return
    run = Result(path)
    show.result(run)
    bodies = [
        (body.name, str(body.m), str(run.flexbodies.get(body.name, "rigid")))
        for body in run.layout.bodies
    ]
    show.table(("body", "modes", "file"), bodies, right=(1,))
    units = [(channel, run.unit(channel)) for channel in run.channels()]
    show.table(("channel", "unit"), units)
    stored, whole = run.row_bytes
    show.line(f"{stored} bytes a row" + (f", {whole} with everything" if stored < whole else ""))
    show.line(f"started {run.created}")


def _show_mesh(path: Path) -> None:
    from flexmb.fe import mesh_report, read_mesh

    with Bars() as progress:
        progress("read", 0.0)
        mesh = read_mesh(path)
        progress("read", 1.0)
    show.heading(f"mesh {path}")
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    size = " x ".join(f"{extent:.6g}" for extent in high - low)
    rows = [("nodes", str(len(mesh.points))), ("size, in the mesh's own unit", size)]
    rows += [(f"{kind} elements", str(len(cells))) for kind, cells in mesh.blocks.items()]
    show.table(("", ""), rows, right=(1,))
    groups = [
        (name, ", ".join(f"{len(ids)} {kind}" for kind, ids in found.items()), str(len(nodes)))
        for name, nodes in mesh.node_sets.items()
        for found in [mesh.element_sets.get(name, {})]
    ]
    show.table(("group", "elements", "nodes"), groups, right=(2,))
    for finding in mesh_report(mesh, unit=""):
        show.line(f"{finding.level}: {finding.sentence}")
