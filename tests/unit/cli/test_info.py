"""What `flexmb info` says of a mesh: its contents, and what is wrong with it."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from typer.testing import CliRunner

from flexmb.cli.app import app
from flexmb.fe.meshes.mesh_shapes import mesh_from


def shown(path: Path, points: np.ndarray, cells: np.ndarray) -> str:
    meshio.write(path, meshio.Mesh(points, [("hexahedron20", cells)]))
    done = CliRunner().invoke(app, ["info", str(path)])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_mesh_is_counted_and_its_defects_are_told(tmp_path: Path) -> None:
    box = mesh_from({"type": "box", "size": [200.0, 20.0, 10.0], "divisions": [4, 1, 1]})
    cells = box.blocks["hexahedron20"]
    good = shown(tmp_path / "good.vtu", box.points, cells)
    assert "hexahedron20 elements" in good and "200 x 20 x 10" in good
    assert "warning" not in good and "error" not in good and "note" not in good
    points = np.vstack([box.points, box.points[:1], [[0.0, 0.0, 99.0]]])
    cut = cells.copy()
    cut[cut == 0] = len(box.points)
    cut[-1, 6] = 0  # a corner of the last element pulled to the other end, and left behind
    bad = shown(tmp_path / "bad.vtu", points, cut)
    assert "note: 2 nodes belong to no element of the body and are left out" in bad
    assert "error: 1 of 4 elements of kind" in bad
    assert "warning: 1 pair of nodes coincides, the first node 0 at (0, -10, -5)" in bad


def test_reduce_shows_bodies_of_a_scene_in_its_units(tmp_path: Path, monkeypatch) -> None:
    """A steel bar of 500 x 20 x 10 mm has 785 g, in a scene in mm, t and s and in SI."""
    monkeypatch.chdir(tmp_path)
    scene = """title = "a bar"\nunits = "{}"\n[bodies.bar]\nmaterial = "steel"\nmodes = 2
interfaces = {{ a = "start" }}
mesh = {{ type = "beam", length = "500 mm", divisions = 4 }}
sections.all = {{ type = "rectangle", y = "20 mm", z = "10 mm" }}\n"""
    for units, mass, center in (("mm-t-s", "0.000785 t", "(250, 0, 0) mm"),
                                ("SI", "0.785 kg", "(0.25, 0, 0) m")):  # fmt: skip
        (tmp_path / "bar.toml").write_text(scene.format(units))
        done = CliRunner().invoke(app, ["reduce", "bar.toml"])
        assert done.exit_code == 0, done.output
        assert mass in done.stdout and center in done.stdout
