"""What is said of a mesh: each defect is planted once, and a good mesh is silent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from femeshes import block
from shellkit import PLY

from flexmb.fe import Mesh, assemble, mesh_report, reduce, resolve, section_from, survey
from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.fe.elements.shell_fields import WARP_WARNING, warp
from flexmb.fe.mesh_checks import SLIVER, scaled_jacobian, size_sentence
from flexmb.fe.meshes.mesh_shapes import mesh_from
from flexmb.fe.model_checks import mass_sentence, nominal_mass

BOX = mesh_from({"type": "box", "size": [2.0, 1.0, 1.0], "divisions": [2, 1, 1]})
PLATE = mesh_from({"type": "plate", "length": 2.0, "width": 1.0, "divisions": [2, 1]})
SHELL = section_from({"type": "shell", "thickness": 0.01})


def told(mesh, level=None, **options):
    found = mesh_report(mesh, **options)
    return [f.sentence for f in found if level in (None, f.level)]


def moved(mesh, node, to):
    points = mesh.points.copy()
    points[node] = to
    return replace(mesh, points=points)


def test_a_good_mesh_is_silent():
    assert told(BOX) == told(PLATE) == []


def test_regular_elements_have_quality_one():
    """Verdict's scaled Jacobian: 1 for the regular element, and its closed form elsewhere."""
    h = math.sqrt(3) / 2
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0.5, h, 0]]])
    tetra = np.array([[[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1.0]]])
    cube = mesh_from({"type": "box", "size": [1, 1, 1], "elements": "hexahedron", "divisions": 1})
    wedge = np.concatenate([triangle, triangle + [0, 0, 1]], axis=1)
    assert scaled_jacobian("triangle", triangle) == pytest.approx(1)
    assert scaled_jacobian("tetra10", tetra) == pytest.approx(1)
    assert scaled_jacobian("tetra", tetra[:, [0, 2, 1, 3]]) == pytest.approx(1)  # left-handed
    assert scaled_jacobian("hexahedron", cube.points[cube.blocks["hexahedron"]]) == 1
    assert scaled_jacobian("wedge15", wedge) == pytest.approx(1)
    for angle in (30, 75):  # a rhombus: the sine of its angle
        a = math.radians(angle)
        b = [math.cos(a), math.sin(a), 0]
        rhombus = np.array([[[0, 0, 0], [1, 0, 0], np.add([1, 0, 0], b), b]])
        assert scaled_jacobian("quad", rhombus) == pytest.approx(math.sin(a))
    assert scaled_jacobian("line", np.zeros((1, 2, 3))) is None


def test_warp_is_the_height_over_the_root_of_the_area():
    """A unit square with corners h above and below its plane by turns."""
    h = 0.01
    square = np.array([[[0, 0, h], [1, 0, -h], [1, 1, h], [0, 1, -h]]])
    assert warp(square) == pytest.approx(h, rel=1e-3)
    assert warp(1000 * square) == pytest.approx(h, rel=1e-3)
    assert warp(square * [1, 1, 0]) == 0


def test_orphan_nodes_are_noted():
    more = Mesh(np.vstack([BOX.points, [[9, 9, 9]]]), BOX.blocks, {}, BOX.element_sets)
    assert told(more) == ["1 node belongs to no element of the body and is left out"]
    linked = [np.array([len(BOX.points), 0])]
    assert told(more, "note", linked=linked) == []


def test_coincident_nodes_are_counted_and_placed():
    """Two boxes side by side, not merged: 8 pairs on the face that they share."""
    n = len(BOX.points)
    both = np.vstack([BOX.points, BOX.points + [2.0, 0, 0]])
    cells = BOX.blocks["hexahedron20"]
    mesh = Mesh(both, {"hexahedron20": np.vstack([cells, cells + n])})
    pairs, parts = told(mesh, "warning")
    assert pairs.startswith("8 pairs of nodes coincide, the first node")
    assert "at (2, " in pairs
    assert "falls into 2 parts that share no nodes" in parts
    assert f"has {n} nodes" in parts
    joined = [np.append(BOX.node_sets["x1"], BOX.node_sets["x0"] + n)]
    assert told(mesh, linked=joined) == []


EDGES = FAMILIES["hexahedron20"].edges


def test_nodes_that_hang_on_an_edge_are_named():
    """One square beside two of half its height; then as solids with middle nodes; and a tie."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 0.5, 0], [1, 0.5, 0]]
    points = np.array([*points, [2, 1, 0]], dtype=float)
    cells = np.array([[0, 1, 2, 3], [1, 4, 5, 6], [6, 5, 7, 2]])
    (sentence,) = told(Mesh(points, {"quad": cells}), "warning")
    assert sentence.startswith("hanging nodes, on edges of elements that do not have them: 1, the")
    assert "first node 6 at (1, 0.5, 0) m; the body can open there" in sentence
    assert told(Mesh(points, {"quad": cells}), linked=[np.array([6, 2])]) == []
    assert told(Mesh(points, {"quad": np.vstack([cells[1:], [[0, 1, 6, 3]]])}), "warning") == []
    x = np.vstack([points, points + [0, 0, 1]])[np.hstack([cells, cells + len(points)])]
    x = np.concatenate([x, [[(c[a] + c[b]) / 2 for a, b in EDGES] for c in x]], axis=1)
    places, back = np.unique(x.reshape(-1, 3), axis=0, return_inverse=True)
    (sentence,) = told(Mesh(places, {"hexahedron20": back.reshape(3, 20)}), "warning")
    assert "have them: 4, the first node" in sentence  # middle nodes, at both ends of the solids


def test_inverted_elements_are_errors():
    corner = BOX.node_sets["x0"][0]
    folded = moved(BOX, corner, [5.0, 0.2, 0.3])
    (sentence,) = told(folded, "error")
    assert '1 of 2 elements of kind "hexahedron20" are flat, folded or turned inside' in sentence


def test_slivers_are_told_with_the_least_quality():
    """A tetrahedron of height e over a regular base: quality falls with e."""
    h = math.sqrt(3) / 2
    for height, wanted in ((0.5, False), (0.01, True)):
        points = np.array([[0, 0, 0], [1, 0, 0], [0.5, h, 0], [0.5, h / 3, height]])
        mesh = Mesh(points, {"tetra": np.array([[0, 1, 2, 3]])})
        found = [s for s in told(mesh, "warning") if "slivers" in s]
        assert bool(found) == wanted
        quality = scaled_jacobian("tetra", points[None])[0]
        assert (quality < SLIVER) == wanted
        if wanted:
            assert f"the least {quality:.2g}" in found[0]


def test_warped_quads_are_told_where_they_are_shells():
    lifted = moved(PLATE, PLATE.node_sets["x1y1"][0], [2.0, 0.5, 0.3])
    (sentence,) = told(lifted, "warning")
    assert 'of 2 elements of kind "quad" are warped' in sentence
    assert f"more than {WARP_WARNING:g} of their size" in sentence
    straight = moved(PLATE, PLATE.node_sets["x1y1"][0], [2.0, 0.5, 1e-4])
    assert told(straight) == []
    bent = moved(BOX, BOX.node_sets["x1"][0], BOX.points[BOX.node_sets["x1"][0]] + [0.02, 0, 0])
    assert told(bent) == []  # sides of solids may be warped


def test_a_slip_of_units_shows_in_the_size():
    assert size_sentence(np.array([[0, 0, 0], [0.5, 0, 0]])) == ""
    assert "extends over 450 m" in size_sentence(np.array([[0, 0, 0], [450.0, 0, 0]]))
    micro = np.array([[0, 0, 0], [2e-6, 0, 0]])
    assert "extends over 2e-06 m" in size_sentence(micro) and not size_sentence(micro, 1e-6)


@pytest.mark.parametrize(
    ("mesh", "section", "mass"),
    [
        ({"type": "beam", "length": 2.0}, {"type": "rectangle", "y": 0.1, "z": 0.2}, 0.04 * 7850),
        (
            {"type": "beam", "length": 2.0},
            {"type": "rectangle", "y": 0.1, "z": 0.2, "nonstructural": 3.0},
            0.04 * 7850 + 6.0,
        ),
        (  # a frustum: L (A + sqrt(A B) + B)/3
            {"type": "beam", "length": 3.0},
            {
                "type": "tapered",
                "start": {"type": "circle", "radius": 0.1},
                "end": {"type": "circle", "radius": 0.2},
            },
            math.pi * 0.07 * 7850,
        ),
        (
            {"type": "plate", "length": 2.0, "width": 1.0},
            {
                "type": "layered",
                "nonstructural": 2.0,
                "layers": [
                    {"thickness": 0.01},
                    {"thickness": 0.02, "material": {"E": 1e9, "nu": 0.3, "density": 100.0}},
                ],
            },
            2.0 * (0.01 * 7850 + 0.02 * 100 + 2.0),
        ),
        (
            {"type": "box", "size": [2.0, 1.0, 0.5]},
            {"type": "solid", "material": "aluminium"},
            2700.0,
        ),
    ],
    ids=["beam", "nonstructural", "tapered", "layered", "solid"],
)
def test_the_mass_of_elements_is_that_of_the_matrix(mesh, section, mass):
    fe = assemble(mesh_from(mesh), resolve("steel"), {"all": section_from(section)})
    assert nominal_mass(fe.blocks, fe.mesh.points) == pytest.approx(mass, rel=1e-12)
    assert mass_sentence(fe) == ""
    wrong = replace(fe, M=1.01 * fe.M)
    assert "the mass matrix holds" in mass_sentence(wrong)


def test_a_reduction_warns_and_keeps_what_it_found():
    lifted = moved(PLATE, PLATE.node_sets["x1y1"][0], [2.0, 0.5, 0.3])
    points = np.vstack([lifted.points, [[0, 0, 9]]])
    mesh = Mesh(points, lifted.blocks, lifted.node_sets, lifted.element_sets)
    with pytest.warns(UserWarning, match="are warped"):
        body = reduce(mesh, material="steel", sections={"all": SHELL}, modes=2)
    assert "are warped" in body.provenance["warnings"]
    assert "1 node belongs to no element" in body.provenance["notes"]


def test_elements_that_are_there_twice_are_counted():
    box = block((2, 1, 1))
    twice = np.concatenate([box.blocks["tetra10"], box.blocks["tetra10"][[3, 3]]])
    count = len(twice)
    (finding,) = mesh_report(Mesh(box.points, {"tetra10": twice}))
    assert finding.sentence.startswith(
        f'1 of {count} elements of kind "tetra10" are there more than'
    )


@pytest.mark.parametrize(
    ("material", "orientation", "count"),
    [("ply", None, 1), ("ply", (0.0, 0.0, 1.0), 0), ("steel", None, 0)],
)
def test_default_axes_that_jump_on_a_curved_shell_are_named(material, orientation, count):
    """An arch round z: the projections of x and y on its elements are opposite to each other."""
    angle = np.repeat(np.pi / 24 * np.arange(25), 2)
    points = np.stack([np.cos(angle), np.sin(angle), np.tile([0.0, 0.05], 25)], axis=1)
    arch = Mesh(points, {"quad": 2 * np.arange(24)[:, None] + [0, 2, 3, 1]})
    skin = {"type": "shell", "thickness": 0.01, "orientation": orientation}
    matter = PLY if material == "ply" else resolve("steel")
    findings = survey(arch, material=matter, sections={"all": skin}).findings
    assert sum("material axis 1" in finding.sentence for finding in findings) == count


def test_a_slip_of_units_shows_in_the_mass():
    box = {"type": "box", "size": [90.0, 80.0, 70.0], "divisions": [2, 2, 2]}
    (told,) = [one.sentence for one in survey(box, material="steel").findings]
    assert told.startswith("the mesh extends over 90 m and has a mass of 3.96e+09 kg: is its unit")
    box["size"] = [9.0, 8.0, 7.0]
    assert survey(box, material="steel").findings == []


def test_a_beam_whose_section_is_larger_than_its_length_is_named():
    beam = {"type": "beam", "length": 80.0}
    section = {"all": {"type": "circle", "radius": 2000.0}}
    told = [one.sentence for one in survey(beam, material="steel", sections=section).findings]
    assert any("extend over 80 m: are its sizes in their unit?" in one for one in told)
    section["all"]["radius"] = 2.0
    told = [one.sentence for one in survey(beam, material="steel", sections=section).findings]
    assert not any("in their unit" in one for one in told)


def test_shells_thicker_than_long_and_collapsed_elements_are_named():
    plate = mesh_from({"type": "plate", "length": 1.0, "width": 0.5, "divisions": [2, 1]})
    for thickness, count in ((1.2, 1), (0.9, 0)):
        skin = {"all": {"type": "shell", "thickness": thickness}}
        findings = survey(plate, material="steel", sections=skin).findings
        assert sum("thick and extend over 1 m" in finding.sentence for finding in findings) == count
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    wedge = Mesh(points, {"quad": np.array([[0, 1, 2, 2]])}, numbers=np.array([7, 8, 9]))
    problems = survey(wedge, material="steel", sections=skin).problems
    assert "nodes 0, 1, 2, 2 (numbers 7, 8, 9, 9 of the file), one of them twice" in str(problems)
