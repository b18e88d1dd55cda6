"""Coordinate systems of Nastran against rotations by scipy; groups of nodes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmb
from flexmb.errors import MeshError
from flexmb.fe import read_mesh
from flexmb.fe.meshes import mesh_file

ORIGIN = np.array([3.0, -2.0, 5.0])
TURN = Rotation.from_euler("xyz", [20, -35, 70], degrees=True)
X, Y, Z = np.eye(3)


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(mesh_file, "check_reading", lambda *_: None)


def text(*values):
    return ",".join(f"{v:.12g}" if isinstance(v, float) else str(v) for v in values)


def read(tmp_path, *lines):
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join(["BEGIN BULK", *lines, "ENDDATA"]) + "\n")
    return read_mesh(path)


def system(word, number, base, origin, turn, end=2.0):
    """CORD2x of a frame that is turned and moved in its base; its points are not at unit length."""
    a, b, c = origin, origin + turn.apply(end * Z), origin + turn.apply(3 * X + 0.7 * Z)
    return [text(word, number, base, *a, *b) + ",+", text("+", *c)]


def place(kind, a, b, c):
    """Of rectangular, cylindrical or spherical coordinates, by turns of the axes."""
    if kind == "R":
        return np.array([a, b, c])
    if kind == "C":
        return Rotation.from_rotvec(b * Z, degrees=True).apply([a, 0, c])
    tilted = Rotation.from_rotvec(b * Y, degrees=True).apply(a * Z)
    return Rotation.from_rotvec(c * Z, degrees=True).apply(tilted)


@pytest.mark.parametrize("kind", "RCS")
def test_a_system_in_the_basic_one(tmp_path, kind):
    lines = system(f"CORD2{kind}", 7, "", ORIGIN, TURN)
    mesh = read(tmp_path, *lines, "GRID,1,7,1.5,40.,25.", "GRID,2,,1.5,40.,25.")
    expected = ORIGIN + TURN.apply(place(kind, 1.5, 40.0, 25.0))
    np.testing.assert_allclose(mesh.points, [expected, [1.5, 40, 25]], atol=1e-10)
    assert not mesh.note


def test_a_system_in_a_cylindrical_one(tmp_path):
    """The points of the second are given by radius, angle and height in the first."""
    outer = system("CORD2C", 9, 0, ORIGIN, TURN)
    inner = ["CORD2R,2,9,4.,90.,1.,4.,90.,2.", "+,5.,90.,1."]  # its x axis is radial
    mesh = read(tmp_path, *inner, *outer, "GRID,1,2,1.,2.,3.")
    inside = [-2.0, 4 + 1.0, 1 + 3.0]  # x radial (y of the first), y along -x, z as z
    np.testing.assert_allclose(mesh.points[0], ORIGIN + TURN.apply(inside), atol=1e-10)


def test_systems_by_nodes(tmp_path):
    """Two in one entry; their nodes have a system of their own."""
    at = [ORIGIN, ORIGIN + TURN.apply(4 * Z), ORIGIN + TURN.apply(X - Z)]
    outer = system("CORD2R", 5, "", ORIGIN, TURN)
    nodes = ["GRID,11,5,0.,0.,0.", text("GRID", 12, "", *at[1]), text("GRID", 13, "", *at[2])]
    lines = ["CORD1R,1,11,12,13,2,11,13,12", *nodes, "GRID,20,1,1.,2.,3.", "GRID,21,2,1.,0.,0."]
    mesh = read(tmp_path, *outer, *lines)
    np.testing.assert_allclose(mesh.points[3], ORIGIN + TURN.apply([1, 2, 3]), atol=1e-10)
    x = Z - ((X - Z) @ Z) / 2 * (X - Z)  # towards node 12, normal to the axis of the second
    x /= np.linalg.norm(x)
    np.testing.assert_allclose(mesh.points[4], ORIGIN + TURN.apply(x), atol=1e-10)


def test_the_default_system_of_nodes_and_large_fields(tmp_path):
    lines = [
        f"{'CORD2C*':8}{7:<16}{0:<16}{1.0:<16}{0.0:<16}*",
        f"{'*':8}{0.0:<16}{1.0:<16}{0.0:<16}",
    ]
    lines[1] += f"{1.0:<16}*"
    lines += [f"{'*':8}{2.0:<16}{0.0:<16}{0.0:<16}"]
    mesh = read(tmp_path, *lines, "GRDSET,,7", "GRID,1,,2.,90.,.5", "GRID,2,0,2.,90.,.5")
    np.testing.assert_allclose(mesh.points, [[1, 2, 0.5], [2, 90, 0.5]], atol=1e-12)


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (["GRID,1,4,0.,0.,0."], "names the coordinate system 4, which the deck does not have"),
        (
            ["CORD2R,4,4,0.,0.,0.,0.,0.,1.", "+,1.,0.,0.", "GRID,1,4,0.,0.,0."],
            "the coordinate system 4 is defined by itself",
        ),
        (
            ["CORD1R,4,1,2,3", "GRID,1,4,0.,0.,0.", "GRID,2,,0.,0.,1.", "GRID,3,,1.,0.,0."],
            "the coordinate system 4 is defined by itself",
        ),
        (
            ["CORD2R,4,,0.,0.,0.,0.,0.,1.", "+,0.,0.,2.", "GRID,1,4,0.,0.,0."],
            "the three points of the coordinate system 4 lie on a line",
        ),
        (["CORD1R,4,1,2,3", "GRID,9,4,0.,0.,0."], "the coordinate system 4 names node 1, which"),
        (
            [*system("CORD2R", 4, "", ORIGIN, TURN), *system("CORD2C", 4, "", ORIGIN, TURN)],
            "the coordinate system 4 is given twice",
        ),
    ],
)
def test_systems_that_cannot_be_are_refused(tmp_path, lines, sentence):
    with pytest.raises(MeshError, match=sentence):
        read(tmp_path, *lines, "GRID,50,,1.,2.,3.")


GRIDS = [f"GRID,{n},,{n}.,{n * n}.,0." for n in (*range(1, 10), 20)]
GROUPS = {  # entries, and their groups by the numbers of the deck
    "RBE2,12,20,123456,1,2,3,4\n+,5,6.5-6": {"RBE2:12": [*range(1, 6)], "RBE2:12:reference": [20]},
    "RBE3,7,,20,123456,1.,123,1,2\n+,3,2.5,12,4,5,UM,1\n+,1": {
        "RBE3:7": [*range(1, 6)], "RBE3:7:reference": [20],
    },
    "RBE3,7,,20,123,1.0+0,123,8": {"RBE3:7": [8], "RBE3:7:reference": [20]},
    "RBE3,7,,20,123,1.,123,1,THRU\n+,4": {"RBE3:7": [*range(1, 5)], "RBE3:7:reference": [20]},
    "CSET1,,ALL": {"ASET": [*range(1, 10), 20]},
    "ASET,3,123,5,123456\nASET1,3,7,THRU,99\nASET1,0,501,THRU,510\nBSET1,12,1": {
        "ASET": [1, 3, 5, 7, 8, 9, 20],
    },
    "SPC1,4,123,1,2,THRU,6,EXCEPT\n+,5\nSPC,4,9,1,0.,8,2,.5\nSPC1,5,12,2,THRU,9,BY,3": {
        "SPC:4": [1, 2, 3, 4, 6, 8, 9], "SPC:5": [2, 5, 8],
    },
}  # fmt: skip


@pytest.mark.parametrize("default", ["", "456"])
def test_permanent_constraints_of_nodes_are_groups_by_their_components(tmp_path, default):
    """As Patran and HyperMesh write them: no rotations of solids, or a support."""
    supports = ["GRID,31,,0.,0.,0.,,123", "GRID,32,,0.,1.,0.,,123", "GRID,33,,0.,2.,0.,,0"]
    mesh = read(
        tmp_path, f"GRDSET,,,,,,,{default}", *supports, "GRID,34,,9.,9.,9.", "GRID,35,,0.,5.,0.,,3"
    )
    found = {name: mesh.numbers[nodes].tolist() for name, nodes in mesh.node_sets.items()}
    assert found == {"PS:123": [31, 32], "PS:3": [35]} | ({"PS:456": [34]} if default else {})


@pytest.mark.parametrize("entries", GROUPS)
def test_nodes_of_rigid_elements_boundaries_and_supports_are_groups(tmp_path, entries):
    mesh = read(tmp_path, *GRIDS, *entries.split("\n"))
    found = {name: mesh.numbers[nodes].tolist() for name, nodes in mesh.node_sets.items()}
    assert found == GROUPS[entries]


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("RBE2,12,20,123456,1,50", 'the node set "RBE2:12" names node 50, which is absent'),
        ("RBE2,12,50,123456,1", 'the node set "RBE2:12:reference" names node 50'),
        ("RBE2,12,,123456,1", "a line has too few fields"),
        ("SPC1,1,123,1,THRU", "a line has too few fields"),
        ("ASET1,1,x", 'has "X" for a number'),
    ],
)
def test_groups_of_nodes_that_cannot_be_are_refused(tmp_path, entry, sentence):
    with pytest.raises(MeshError, match=sentence):
        read(tmp_path, *GRIDS, entry)


def test_an_interface_at_the_reference_of_a_rigid_element(tmp_path):
    """A bar held by one, pulled at the other: F L/EA between the rigid ends, without nu."""
    points = [(z, x, y) for z in (0, 1, 2) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    grids = [f"GRID,{n},,{x}.,{y}.,{z}." for n, (z, x, y) in enumerate(points, 1)]
    solids = ["CHEXA,1,3,1,2,3,4,5,6,+\n+,7,8", "CHEXA,2,3,5,6,7,8,9,10,+\n+,11,12"]
    ends = ["GRID,91,,.5,.5,-1.", "GRID,92,,.5,.5,3."]
    ends += ["RBE2,5,91,123456,1,2,3,4", "RBE2,6,92,123456,9,10,11,12"]
    read(tmp_path, *grids, *solids, *ends)
    tie = {end: {"reference": f"RBE2:{end}:reference", "nodes": f"RBE2:{end}"} for end in (5, 6)}
    part = flexmb.part(
        tmp_path / "deck.bdf",
        material={"E": 2e11, "nu": 0.0, "density": 7800},
        ties={"foot": tie[5], "head": tie[6]},
        supports={"foot": {"group": "RBE2:5:reference", "type": "clamped"}},
        loads={"pull": {"type": "force", "group": "RBE2:6:reference", "force": [3e3, 0, 4e6]}},
    )
    moved = part.displacements()[np.isin(part.nodes.ids, [8, 9, 10, 11])].mean(axis=0)
    assert moved[2] == pytest.approx(4e6 * 2 / 2e11, rel=1e-9)
    assert part.reactions["foot"].moment[1] == pytest.approx(-3e3 * 4, rel=1e-9)


def test_a_deck_of_nastran_may_end_in_dat(tmp_path):
    """The suffix is Nastran's own as well as Tecplot's; the text tells which it is."""
    path = tmp_path / "deck.dat"
    path.write_text("SOL 103\nCEND\nBEGIN BULK\n" + "\n".join(GRIDS[:4]) + "\nCTETRA,1,1,1,2,3,4\n")
    assert read_mesh(path).blocks["tetra"].tolist() == [[0, 1, 2, 3]]
    path.write_text('TITLE = "x"\nVARIABLES = "X", "Y"\n')
    with pytest.raises(MeshError, match=r"not the \.dat format that its suffix says"):
        read_mesh(path)
