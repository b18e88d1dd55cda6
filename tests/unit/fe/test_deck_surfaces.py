"""Surfaces of Abaqus decks are groups: faces of solids, sides of shells, nodes; and how decks are
encoded."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.errors import MeshError
from flexmb.fe import read_mesh
from flexmb.fe.meshes import mesh as mesh_module

CUBE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
TET = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
WEDGE = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)]
BELOW = [(0, 1), (1, 2), (2, 3), (3, 0)]
TRIANGLE = [(0, 1), (1, 2), (2, 0)]
HEX_EDGES = [*BELOW, *((a + 4, b + 4) for a, b in BELOW), *((k, k + 4) for k in range(4))]
TET_EDGES = [*TRIANGLE, (0, 3), (1, 3), (2, 3)]
WEDGE_EDGES = [*TRIANGLE, *((a + 3, b + 3) for a, b in TRIANGLE), *((k, k + 3) for k in range(3))]
# the plane of each face S1, S2, ...: a x + b y + c z = d, after the Abaqus Elements Guide
HEX_PLANES = [(0, 0, 1, 0), (0, 0, 1, 1), (0, 1, 0, 0), (1, 0, 0, 1), (0, 1, 0, 1), (1, 0, 0, 0)]
TET_PLANES = [(0, 0, 1, 0), (0, 1, 0, 0), (1, 1, 1, 1), (1, 0, 0, 0)]
WEDGE_PLANES = [(0, 0, 1, 0), (0, 0, 1, 1), (0, 1, 0, 0), (1, 1, 0, 1), (1, 0, 0, 0)]
SOLIDS = {
    "C3D4": (TET, [], TET_PLANES),
    "C3D10": (TET, TET_EDGES, TET_PLANES),
    "C3D8": (CUBE, [], HEX_PLANES),
    "C3D20R": (CUBE, HEX_EDGES, HEX_PLANES),
    "C3D15": (WEDGE, WEDGE_EDGES, WEDGE_PLANES),
}


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(mesh_module, "check_reading", lambda *_: None)


def deck_of(points, *rest):
    rows = [f"{k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(points, 1)]
    return "\n".join(["*NODE", *rows, *rest]) + "\n"


def read(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "deck.inp"
    path.write_bytes(text.encode(encoding))
    return read_mesh(path)


def solid(name):
    corners, edges, _ = SOLIDS[name]
    points = np.array(corners, float)
    points = [*points, *((points[a] + points[b]) / 2 for a, b in edges)]
    numbers = ", ".join(map(str, range(1, len(points) + 1)))
    return deck_of(points, f"*ELEMENT, TYPE={name}, ELSET=all", f"7, {numbers}")


@pytest.mark.parametrize("name", SOLIDS)
def test_faces_of_solids(tmp_path, name):
    planes = SOLIDS[name][2]
    faces = [f"*SURFACE, NAME=f{k}, TYPE=ELEMENT\nall, S{k}" for k in range(1, len(planes) + 1)]
    mesh = read(tmp_path, solid(name) + "\n".join(faces) + "\n")
    assert not mesh.note
    for k, (*normal, offset) in enumerate(planes, 1):
        ours = mesh.node_sets[f"f{k}"]
        there = np.flatnonzero(np.abs(mesh.points @ normal - offset) < 1e-12)
        np.testing.assert_array_equal(ours, there)
        ((kind, rows),) = mesh.element_sets[f"f{k}"].items()
        np.testing.assert_array_equal(np.unique(mesh.blocks[kind][rows]), there)


@pytest.mark.parametrize("name", ["C3D10", "C3D20R", "C3D8"])
def test_pressure_on_a_surface_pushes_inwards(tmp_path, name):
    path = tmp_path / "deck.inp"
    path.write_text(solid(name) + "*SURFACE, NAME=foot\n7, S1\n*Surface, type=element, name=Top\n")
    path.write_text(path.read_text() + ("all, S2\n" if name != "C3D10" else "all, S3\n"))
    part = flexmb.part(
        path,
        material="steel",
        supports={"foot": {"group": "foot", "type": "clamped"}},
        loads={"gas": {"type": "pressure", "group": "Top", "pressure": 3.0}},
    )
    held = [0, 0, 3.0] if name != "C3D10" else [1.5, 1.5, 1.5]  # pressure times area
    np.testing.assert_allclose(part.reactions["foot"].force, held, atol=1e-12)


def test_surfaces_of_nodes(tmp_path):
    surface = "*NSET, NSET=ends\n1, 2\n*SURFACE, TYPE=NODE, NAME=s\nends, 1.\n4,\n"
    mesh = read(tmp_path, solid("C3D8") + surface)
    np.testing.assert_array_equal(mesh.node_sets["s"], [0, 1, 3])


def test_sides_of_shells_and_faces_beside_shells(tmp_path):
    """Faces beside shells are nodes: else they would be shells of a section for all."""
    shell = "*ELEMENT, TYPE=S4, ELSET=skin\n8, 5, 6, 7, 8\n*SURFACE, NAME=upper\nskin, SPOS\n"
    mesh = read(tmp_path, solid("C3D8") + shell + "*SURFACE, NAME=low\nall, S1\n")
    assert {kind: len(rows) for kind, rows in mesh.blocks.items()} == {"hexahedron": 1, "quad": 1}
    np.testing.assert_array_equal(mesh.element_sets["upper"]["quad"], [0])
    np.testing.assert_array_equal(mesh.node_sets["low"], [0, 1, 2, 3])
    assert "low" not in mesh.element_sets


@pytest.mark.parametrize("rows", ["all, S9", "elsewhere, S1", "all, SPOS", "all,"])
def test_other_surfaces_are_named(tmp_path, rows):
    mesh = read(tmp_path, solid("C3D8") + f"*SURFACE, NAME=s\n{rows}\n")
    assert "1 SURFACE, not read" in mesh.note
    assert "s" not in mesh.node_sets


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_names_are_read_in_the_encodings_of_editors(tmp_path, encoding):
    mesh = read(tmp_path, solid("C3D8").replace("ELSET=all", "ELSET=Träger"), encoding)
    assert list(mesh.node_sets) == ["Träger"]


@pytest.mark.parametrize(("name", "card"), [("a.inp", r"\*NODE"), ("a.bdf", "GRID")])
def test_a_deck_without_nodes_is_refused(tmp_path, name, card):
    (tmp_path / name).write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n")
    with pytest.raises(MeshError, match=f"there is no {card} in it: the deck is empty, damaged"):
        read_mesh(tmp_path / name)


def test_a_coordinate_that_is_no_number_is_told_with_the_number_of_the_file(tmp_path):
    with pytest.raises(MeshError, match=r"node 3 \(number 4 of the file\) has a coordinate that"):
        read(tmp_path, solid("C3D4").replace("4, 0.0, 0.0, 1.0", "4, nan, 0.0, 1.0"))
