"""Decks of Abaqus: surfaces are groups; parts, instances and the assembly; encodings."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmb
from flexmb.errors import MeshError
from flexmb.fe import read_mesh
from flexmb.fe.meshes import mesh_file
from flexmb.fe.meshes.mesh import group_centroid
from flexmb.fe.meshes.mesh_refinement import refine_mesh

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
    monkeypatch.setattr(mesh_file, "check_reading", lambda *_: None)


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


CAE = """*Heading
*Part, name=Rod
*Node
{nodes}
*Element, type=C3D8
 1, 1, 2, 3, 4, 5, 6, 7, 8
*Nset, nset=Set-1, generate
 1, 4, 1
*Elset, elset=Set-1
 1,
*Nset, nset=tip
 7
*Solid Section, elset=Set-1, material=steel
,
*End Part
*Assembly, name=Assembly
{instances}*Node
 1, 0.5, 0.5, 2.
{rest}*End Assembly
"""
NODES = "\n".join(f" {k}, {x}, {y}, {2 * z}" for k, (x, y, z) in enumerate(CUBE, 1))
ALONE = "*Instance, name=Rod-1, part=ROD\n*End Instance\n"


def assembly(instances=ALONE, rest="", nodes=NODES):
    return CAE.format(nodes=nodes, instances=instances, rest=rest)


def groups(mesh):
    return {name: nodes.tolist() for name, nodes in mesh.node_sets.items()}


def test_numbers_and_sets_of_a_part_are_not_those_of_the_assembly(tmp_path):
    """As Abaqus/CAE writes them: both have a node 1 and a set "Set-1"."""
    rest = (
        "*Nset, nset=Set-1, instance=Rod-1\n 5, 6, 7, 8\n*Nset, nset=RP-1\n 1,\n"
        "*Nset, nset=some, instance=rod-1, generate\n 2, 6, 2\n*Nset, nset=ends\nRod-1.tip, 1\n"
        "*Nset, nset=low\nRod-1.Set-1, Rod-1.8\n"
        "*Elset, elset=_top_S2, internal, instance=Rod-1\n 1,\n*Surface, type=ELEMENT, name=top\n"
        "_top_S2, S2\n*Coupling, constraint name=c, ref node=RP-1, surface=top\n*Kinematic\n"
    )
    mesh = read(tmp_path, assembly(rest=rest))
    assert groups(mesh) == {
        "Rod-1.Set-1": [0, 1, 2, 3], "tip": [6], "Set-1": [4, 5, 6, 7], "RP-1": [8],
        "some": [1, 3, 5], "ends": [6, 8], "low": [0, 1, 2, 3, 7], "_top_S2": [*range(8)],
        "top": [4, 5, 6, 7],
    }  # fmt: skip
    np.testing.assert_array_equal(mesh.points[8], [0.5, 0.5, 2])
    assert mesh.numbers.tolist() == [*range(1, 10)]
    assert "has 1 COUPLING, 1 KINEMATIC, not read: the body takes its own ties" in mesh.note


def test_the_nodes_of_a_face_are_not_those_of_the_solids_behind_it(tmp_path):
    """Abaqus/CAE writes the set of a face as nodes, and as elements under the same name."""
    face = "*NSET, NSET=foot\n1, 2, 3, 4\n*ELSET, ELSET=foot\n7\n"
    mesh = read(tmp_path, solid("C3D8") + face)
    np.testing.assert_array_equal(mesh.group_nodes("foot"), [0, 1, 2, 3])
    np.testing.assert_array_equal(mesh.group_elements("foot")["hexahedron"], [0])
    fine = refine_mesh(mesh, 1)
    ours = fine.group_nodes("foot")
    np.testing.assert_array_equal(ours, np.flatnonzero(np.abs(fine.points[:, 2]) < 1e-12))
    assert len(ours) == 9
    np.testing.assert_allclose(group_centroid(mesh, "foot", np.arange(4)), [0.5, 0.5, 0])


MOTIONS = {  # lines of an instance, and what they do by scipy
    "": lambda x: x,
    " 3., -1., 0.5\n": lambda x: x + [3, -1, 0.5],
    " 0., 0., 0.\n 0., 0., 0., 0., 0., 2., 30.\n": Rotation.from_euler("z", 30, True).apply,
    " 1., 2., 3.\n 4., 5., 6., 4., 5., 6.5, 90.\n": lambda x: np.array([4, 5, 6])
    + Rotation.from_euler("z", 90, True).apply(x + [1, 2, 3] - np.array([4, 5, 6])),
    " 1., 2., 3.\n 4., 5., 6., 5., 6., 7., 240.\n": lambda x: np.array([4, 5, 6])
    + (x + [1, 2, 3] - np.array([4, 5, 6]))[:, [2, 0, 1]][:, [2, 0, 1]],
}  # fmt: skip


@pytest.mark.parametrize("lines", MOTIONS)
def test_an_instance_is_translated_then_turned(tmp_path, lines):
    """The last one: a third of a turn about the diagonal exchanges the axes; two thirds twice."""
    mesh = read(tmp_path, assembly(ALONE.replace("*End", f"{lines}*End")))
    expected = MOTIONS[lines](np.array(CUBE) * [1, 1, 2])
    np.testing.assert_allclose(mesh.points[:8], expected, atol=1e-12)
    assert groups(mesh) == {"Set-1": [0, 1, 2, 3], "tip": [6]}


TWO = (
    "*Instance, name=low, part=Rod\n*End Instance\n"
    "*Instance, name=High, part=Rod\n 0., 0., 2.\n*End Instance\n"
)


def test_instances_keep_apart_what_is_theirs(tmp_path):
    rest = (
        "*Nset, nset=seam, instance=high\n 1, 2, 3, 4\n*Nset, nset=seam, instance=low, generate\n"
        "5, 99\n*Elset, elset=both\nlow.1, High.1\n*Surface, name=face\nlow.Set-1, S2\n"
        "high.1, S1\n*Nset, nset=RP\n1,\n"
    )
    mesh = read(tmp_path, assembly(TWO, rest))
    assert groups(mesh) == {
        "low.Set-1": [0, 1, 2, 3], "low.tip": [6], "High.Set-1": [8, 9, 10, 11], "High.tip": [14],
        "low": [*range(8)], "High": [*range(8, 16)], "seam": [*range(4, 12)],
        "both": [*range(16)], "face": [*range(4, 12)], "RP": [16],
    }  # fmt: skip
    assert mesh.blocks["hexahedron"].tolist() == [[*range(8)], [*range(8, 16)]]
    np.testing.assert_array_equal(mesh.points[8:16], mesh.points[:8] + [0, 0, 2])
    assert mesh.numbers is None


def test_two_instances_tied_at_a_reference_point_stretch_as_one(tmp_path):
    """Two bars that are rigid where they meet: twice the extension of one, F L/E A without nu."""
    path = tmp_path / "two.inp"
    sets = "*Nset, nset=head, instance=low\n5, 6, 7, 8\n*Surface, name=top\nHigh.1, S2\n"
    path.write_text(assembly(TWO, "*Nset, nset=RP\n1,\n" + sets))
    seat = {"type": "rbe2", "reference": "RP"}
    part = flexmb.part(
        path,
        material={"E": 2e11, "nu": 0.0, "density": 7800},
        ties={"low": {**seat, "nodes": "head"}, "high": {**seat, "nodes": "High.Set-1"}},
        supports={"foot": {"group": "low.Set-1", "type": "clamped"}},
        loads={"pull": {"type": "force", "group": "top", "force": [0, 0, 1e6]}},
    )
    top = part.displacements()[np.isin(part.nodes.ids, [12, 13, 14, 15]), 2]
    np.testing.assert_allclose(top, 1e6 * 4 / 2e11, rtol=1e-9)


@pytest.mark.parametrize(
    ("instances", "rest", "sentence"),
    [
        ("*Instance, name=a, part=Rot\n*End Instance\n", "", 'part "Rot", which .* nearest: "Rod"'),
        ("*Instance, library=old, instance=b\n*End Instance\n", "", "from another analysis: write"),
        (ALONE * 2, "", 'instance "Rod-1" is given twice'),
        (ALONE.replace("*End", "0,0,0\n0,0,0,0,0,0,9\n*End"), "", "rotation .* has no axis"),
        (ALONE.replace("*End", "0,0,0\n0,0,1\n*End"), "", "rotation .* has no axis"),
        (ALONE.replace("*End", "0,one,0\n*End"), "", 'has "ONE" for a number'),
        (ALONE, "*Nset, nset=s, instance=Rod-2\n1\n", 'the instance "Rod-2", which the deck'),
        (ALONE, "*Nset, nset=s, instance=Rod-1\n9\n", 'number 9 of the instance "Rod-1", which'),
        (ALONE, "*Nset, nset=s\nRod-1.foot\n", 'member "Rod-1.foot", which is neither'),
        ("", "*Part, name=second\n*End Part\n", "2 parts and no .INSTANCE that says where they"),
        (ALONE, "*Node, system=S\n2, 1, 90, 0\n", "spherical coordinates"),
    ],
)  # fmt: skip
def test_assemblies_that_cannot_be_are_refused(tmp_path, instances, rest, sentence):
    with pytest.raises(MeshError, match=sentence):
        read(tmp_path, assembly(instances, rest))


def test_cylindrical_coordinates_of_nodes(tmp_path):
    mesh = read(tmp_path, "*NODE, SYSTEM=C\n1, 2., 90., 5.\n2, 2., 210.\n")
    expected = [[0, 2, 5], [-np.sqrt(3), -1, 0]]
    np.testing.assert_allclose(mesh.points, expected, atol=1e-15)


def test_a_set_of_an_instance_takes_nothing_of_the_next_one(tmp_path):
    """Element 2 is a mass, which a mesh does not have; the next instance has a number there."""
    mass = "*Element, type=MASS, elset=ball\n 2, 7\n*Elset, elset=every\n 1, 2\n*Nset, nset=tip"
    text = assembly(TWO).replace("*Nset, nset=tip", mass)
    assert groups(read(tmp_path, text))["low.every"] == [*range(8)]
    with pytest.raises(MeshError, match='node set "tip" names node 9, which is absent'):
        read(tmp_path, assembly(TWO).replace("nset=tip\n 7", "nset=tip\n 9"))


def test_a_set_of_masses_is_a_member_of_another(tmp_path):
    rest = "*ELEMENT, TYPE=MASS, ELSET=ball\n50, 1\n*ELSET, ELSET=every\nall, ball\n"
    mesh = read(tmp_path, solid("C3D8") + rest)
    np.testing.assert_array_equal(mesh.element_sets["every"]["hexahedron"], [0])


@pytest.mark.parametrize("name", ["Top", "TOP"])
def test_a_surface_with_the_name_of_a_set_is_another_group(tmp_path, name):
    """Abaqus/CAE names sets and surfaces independently."""
    sets = f"*NSET, NSET=Top\n5\n*ELSET, ELSET=Top\n7\n*SURFACE, NAME={name}\nall, S2\n"
    mesh = read(tmp_path, solid("C3D8") + sets)
    assert list(mesh.element_sets["Top"]) == ["hexahedron"]
    np.testing.assert_array_equal(mesh.node_sets["Top"], [4])
    np.testing.assert_array_equal(mesh.node_sets[f"{name}.surface"], [4, 5, 6, 7])
    assert list(mesh.element_sets[f"{name}.surface"]) == ["quad"]
    assert not mesh.note


def test_nodes_of_elements_of_an_instance_and_names_in_quotes(tmp_path):
    rest = '*Nset, nset=own, elset=Set-1, instance=low\n*Nset, nset="some"\n"High".1, low."tip"\n'
    found = groups(read(tmp_path, assembly(TWO, rest)))
    assert (found["own"], found["some"]) == ([*range(8)], [6, 8])


@pytest.mark.parametrize(
    ("rest", "nodes"),
    [
        ("*Nset, nset=s, generate\n5, 7, 2\n", [4, 6]),
        ("*Nset, nset=s\n5, 7\n", [4, 6]),
        ("*Nset, nset=s\n1,\n", [8]),  # the assembly has a node 1 too
        ("*Nset, nset=s\ntip\n", [6]),
        ("*Elset, elset=s\n1,\n", [*range(8)]),
        ("*Nset, nset=s, elset=Set-1\n", [*range(8)]),
    ],
)
def test_sets_of_the_assembly_without_an_instance_are_of_the_only_one(tmp_path, rest, nodes):
    assert groups(read(tmp_path, assembly(rest=rest)))["s"] == nodes


@pytest.mark.parametrize(
    ("rest", "nodes"),
    [
        ("*Surface, name=s\n1, S2\n", [4, 5, 6, 7]),
        ("*Surface, name=s, type=node\n5\n", [4]),
        ("*Surface, name=s, type=node\n1\n", [8]),  # the assembly has a node 1 too
        ("*Surface, name=s\n2, S2\n", None),  # neither has an element 2,
        ("*Surface, name=s, type=node\n9\n", None),  # nor a node 9, though there are nine
        ("*Element, type=MASS, elset=ball\n 1, 1\n*Surface, name=s\n1, S2\n", None),
    ],
)
def test_numbers_of_surfaces_of_the_assembly_are_of_the_only_instance(tmp_path, rest, nodes):
    mesh = read(tmp_path, assembly(rest=rest))
    assert groups(mesh).get("s") == nodes
    assert ("1 SURFACE" in mesh.note) == (nodes is None)


def test_a_number_of_a_surface_is_of_none_of_several_instances(tmp_path):
    mesh = read(tmp_path, assembly(TWO, "*Surface, name=s\n1, S2\n"))
    assert "s" not in groups(mesh)
    assert "1 SURFACE, not read" in mesh.note


def test_a_set_of_a_mass_of_the_assembly_is_none_of_an_instance(tmp_path):
    rest = "*Element, type=MASS, elset=ball\n 1, 1\n*Elset, elset=all\n 1\n"
    assert groups(read(tmp_path, assembly(TWO, rest))).keys().isdisjoint(["all", "ball"])


@pytest.mark.parametrize(
    ("rest", "sentence"),
    [
        ("*Nset, nset=s\n3\n", "node 3, which the assembly does .* INSTANCE=low or INSTANCE=High"),
        ("*Nset, nset=s, generate\n3, 5\n", 'set "s" names node 3, which .* INSTANCE=low or'),
        ("*Elset, elset=s, generate\n1, 1\n", 'set "s" names element 1, which the'),
        ("*Element, type=T3D2\n 5, 1, 3\n", "element 5 names node 3, which"),
        (
            "*Nset, nset=s, elset=Set-1\n",
            'set "s" is that of the element set "Set-1", which is not',
        ),
        ("*Node\n 1, 0., 0., 0.\n", "node 1 is given twice"),
    ],
)
def test_numbers_of_the_assembly_are_told_as_it_has_them(tmp_path, rest, sentence):
    with pytest.raises(MeshError, match=sentence):
        read(tmp_path, assembly(TWO, rest))


def test_many_generated_sets_do_not_each_go_through_all_nodes(tmp_path):
    """A second for 4000 lines and 40 000 nodes; through all nodes each it would be minutes."""
    nodes = "".join(f"{k}, {k}., 0., 0.\n" for k in range(1, 40_001))
    lines = "".join(f"{k}, {k + 4}, 2\n" for k in range(1, 40_001, 10))
    begin = process_time()
    mesh = read(tmp_path, f"*NODE\n{nodes}*NSET, NSET=some, GENERATE\n{lines}")
    assert process_time() - begin < 5.0
    assert len(mesh.node_sets["some"]) == 12_000


@pytest.mark.parametrize(
    "begin", ["*Node, input=far.txt, nset=all", "*NODE,NSET=all,\n INPUT='far.txt'"]
)
def test_lines_of_a_card_in_a_file_are_read(tmp_path, begin):
    """Only of cards that are read: tables of amplitudes need not be there."""
    (tmp_path / "far.txt").write_text(
        "1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n"
    )
    (tmp_path / "solids.txt").write_text("7, 1, 2, 3, 4\n")
    (tmp_path / "foot.txt").write_text("1, 3\n")
    text = f"{begin}\n*ELEMENT, TYPE=C3D4, INPUT=solids.txt, ELSET=one\n"
    text += "*NSET, NSET=foot,INPUT=foot.txt\n"
    mesh = read(tmp_path, f"{text}*AMPLITUDE, NAME=a, INPUT=missing.txt\n")
    assert mesh.blocks["tetra"].tolist() == [[0, 1, 2, 3]]
    assert groups(mesh) == {"one": [0, 1, 2, 3], "all": [0, 1, 2, 3], "foot": [0, 2]}
    (tmp_path / "foot.txt").unlink()
    with pytest.raises(MeshError, match="no such file, named by an include of"):
        read(tmp_path, text)
