"""Meshes of simple shapes: sizes in closed form, conforming elements, outward groups."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexmb.errors import MeshError
from flexmb.fe import mesh_report, meshes
from flexmb.fe.elements.element_blocks import FAMILIES, outer_faces, select_elements
from flexmb.fe.mesh_checks import scaled_jacobian
from flexmb.fe.meshes.lattice import KINDS
from flexmb.fe.meshes.mesh import dimension, facet_moments, group_centroid
from flexmb.fe.meshes.mesh_shapes import SHAPES, mesh_from

SOLIDS, SURFACES = KINDS[3], KINDS[2]
STRAIGHT = ("hexahedron", "tetra", "quad", "triangle")  # first order: circles become polygons


def made(kind=None, **words):
    """The mesh of a table, its elements and their sizes."""
    mesh = mesh_from(words if kind is None else words | {"elements": kind})
    kind = next(iter(mesh.blocks))
    x = mesh.points[mesh.blocks[kind]]
    assert not len(FAMILIES[kind].defects(x))
    return mesh, kind, x, FAMILIES[kind].measure(x, None)


def polygon(n):
    """Area of a regular n-gon over that of its circle."""
    return n * math.sin(2 * math.pi / n) / (2 * math.pi)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_box_is_filled_and_its_faces_look_outwards(kind):
    mesh, kind, x, size = made(kind, type="box", size=[2.0, 0.6, 0.3], divisions=[4, 3, 2])
    assert size.sum() == pytest.approx(2.0 * 0.6 * 0.3, rel=1e-13)
    assert (scaled_jacobian(kind, x) > 0.1).all()
    assert mesh_report(mesh) == []
    for axis, letter in enumerate("xyz"):
        low, high = (mesh.points[:, axis].min(), mesh.points[:, axis].max())
        for end, value in enumerate((low, high)):
            name = f"{letter}{end}"
            assert np.ptp(mesh.points[mesh.node_sets[name]][:, axis]) == 0.0
            place = group_centroid(mesh, name, mesh.node_sets[name])
            assert place[axis] == pytest.approx(value, abs=1e-14)
            area = 0.0
            for facet, rows in mesh.element_sets[name].items():
                corners = mesh.points[mesh.blocks[facet][rows]][:, :4]
                normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
                assert (np.sign(normal[:, axis]) == 2 * end - 1).all()
                area += facet_moments(facet, mesh.points[mesh.blocks[facet][rows]])[0]
            others = np.delete([2.0, 0.6, 0.3], axis)
            assert area == pytest.approx(np.prod(others), rel=1e-13)


@pytest.mark.parametrize("kind", SOLIDS)
@pytest.mark.parametrize(
    "words",
    [
        {"type": "box", "size": [2.0, 0.6, 0.3], "divisions": [3, 2, 2]},
        {"type": "tube", "length": 1.0, "radius": 0.3, "inner": 0.2, "divisions": [1, 8, 3]},
        {"type": "disk", "radius": 1.0, "thickness": 0.1, "divisions": [2, 8, 1]},
        {"type": "disk", "radius": 1.0, "inner": 0.3, "thickness": 0.1, "divisions": [2, 9, 2]},
    ],
    ids=["box", "tube", "full disk", "annulus"],
)
def test_elements_meet_face_to_face(kind, words):
    """Every outer face of the elements is a facet of a named side, and there are no others: a
    gap or two diagonals that cross would leave faces inside."""
    mesh, kind, *_ = made(kind, **words)
    outer = {
        frozenset(face)
        for faces in outer_faces(select_elements(mesh, None), mesh.points)
        for face in faces.tolist()
    }
    named = {
        frozenset(facet)
        for name, cells in mesh.blocks.items()
        if dimension(name) == 2
        for facet in cells.tolist()
    }
    assert outer == named


@pytest.mark.parametrize("kind", SOLIDS)
def test_tubes_and_disks_of_solids_are_round(kind):
    """Curved second-order elements miss the circle by 1e-4; straight ones are prisms of 16 sides,
    whose area is known (the polygon also cuts the hole)."""
    exact = polygon(16) if kind in STRAIGHT else 1.0
    close = 1e-12 if kind in STRAIGHT else 2e-4
    words = {"length": 0.5, "radius": 0.2, "inner": 0.15, "divisions": [2, 16, 4]}
    mesh, kind, x, size = made(kind, type="tube", **words)
    wanted = math.pi * (0.2**2 - 0.15**2) * 0.5 * exact
    assert size.sum() == pytest.approx(wanted, rel=close)
    r = np.hypot(mesh.points[:, 1], mesh.points[:, 2])
    for name, radius in (("inner", 0.15), ("outer", 0.2)):
        assert r[mesh.node_sets[name]] == pytest.approx(radius, rel=1e-14)
    assert mesh.points[mesh.node_sets["start"], 0] == pytest.approx(0.0)
    assert mesh.points[mesh.node_sets["end"], 0] == pytest.approx(0.5)
    for hole in (0.0, 0.4):
        words = {"radius": 1.0, "inner": hole, "thickness": 0.3, "divisions": [3, 16, 2]}
        mesh, kind, x, size = made(kind, type="disk", **words)
        wanted = math.pi * (1 - hole**2) * 0.3 * exact
        assert size.sum() == pytest.approx(wanted, rel=close)
        r = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
        assert r[mesh.node_sets["outer"]] == pytest.approx(1.0, rel=1e-14)
        assert mesh.points[mesh.node_sets["top"], 2] == pytest.approx(0.15)
        assert mesh.points[mesh.node_sets["bottom"], 2] == pytest.approx(-0.15)
        assert (scaled_jacobian(kind, x) > 0.05).all()


@pytest.mark.parametrize("kind", SURFACES)
def test_plates_tubes_and_disks_of_surfaces(kind):
    mesh, _, x, size = made(kind, type="plate", length=2.0, width=1.0, skew=math.radians(30))
    assert size.sum() == pytest.approx(2.0 * math.cos(math.radians(30)), rel=1e-13)
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    assert (normal[:, 2] > 0).all() and np.abs(normal[:, :2]).max() == 0.0
    a, b = mesh.points[mesh.node_sets["x0y0"][0]], mesh.points[mesh.node_sets["x0y1"][0]]
    assert b - a == pytest.approx([math.sin(math.radians(30)), math.cos(math.radians(30)), 0])
    assert set(mesh.node_sets["corners"]) <= set(mesh.node_sets["edges"])
    around = np.unique(np.concatenate([mesh.node_sets[name] for name in ("x0", "x1", "y0", "y1")]))
    np.testing.assert_array_equal(mesh.node_sets["edges"], around)
    assert len(mesh.blocks["line"]) == sum(len(mesh.node_sets[n]) - 1 for n in ("x0", "x1")) + sum(
        len(mesh.node_sets[n]) - 1 for n in ("y0", "y1")
    )
    _, _, x, size = made(kind, type="tube", length=2.0, radius=0.5, divisions=[12, 8])
    assert size.sum() == pytest.approx(2.0 * 12 * 2 * 0.5 * math.sin(math.pi / 12), rel=1e-13)
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    assert (np.einsum("ec,ec->e", normal, x.mean(axis=1) * [0, 1, 1]) > 0).all()
    for hole in (0.0, 0.4):
        words = {"radius": 1.0, "inner": hole, "divisions": [3, 16]}
        mesh, _, x, size = made(kind, type="disk", **words)
        assert size.sum() == pytest.approx(math.pi * (1 - hole**2) * polygon(16), rel=1e-12)
        assert len(mesh.blocks["line"]) == 16 * (2 if hole else 1)
        assert mesh_report(mesh) == []


def test_meshes_of_even_divisions_are_symmetric():
    """About both middle planes, element by element, so that planar scenes can use them."""
    for words in (
        {"type": "box", "size": [1.0, 0.4, 0.2], "elements": "tetra10", "divisions": [4, 2, 2]},
        {"type": "plate", "length": 1.0, "width": 0.4, "elements": "triangle", "divisions": [4, 2]},
    ):
        mesh, _, x, _ = made(**words)
        middle = x.mean(axis=1)
        for mirror in ([1, -1, 1], [-1, 1, 1]):
            other = middle * mirror + (np.array([1.0, 0, 0]) if mirror[0] < 0 else 0)
            gaps = np.linalg.norm(middle[:, None] - other[None], axis=2).min(axis=1)
            assert gaps.max() < 1e-12


def test_beams_along_x_and_along_points():
    mesh = mesh_from({"type": "beam", "length": 2.0, "divisions": 4})
    assert mesh.points[:, 0] == pytest.approx([0, 0.5, 1, 1.5, 2])
    assert (mesh.node_sets["start"][0], mesh.node_sets["end"][0]) == (0, 4)
    points = [[0, 0, 0], [0, 0, 1], [1, 0, 1]]
    mesh = mesh_from({"type": "beam", "points": points, "divisions": [2, 5]})
    assert len(mesh.blocks["line"]) == 7
    assert mesh.points[mesh.node_sets["corner1"]] == pytest.approx(np.array([[0, 0, 1]]))
    assert len(mesh.element_sets["leg2"]["line"]) == 5
    assert mesh.points[mesh.node_sets["end"]] == pytest.approx(np.array([[1, 0, 1]]))


def test_divisions_that_are_not_given_follow_the_rule():
    """Ten elements along the longest edge, twenty of first order; cubes, but at least two."""
    counts = {
        kind: len(made(kind, type="box", size=[1.0, 0.5, 0.01])[3])
        for kind in ("hexahedron20", "hexahedron")
    }
    assert counts == {"hexahedron20": 10 * 5 * 2, "hexahedron": 20 * 10 * 4}
    assert len(made(type="plate", length=1.0, width=0.5)[3]) == 20 * 10
    assert len(made(type="tube", length=0.1, radius=0.05, inner=0.04)[3]) == 16 * 5


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"type": "bx"}, 'mesh.type: unknown shape of a mesh "bx"; nearest: box'),
        ({}, "mesh.type: is missing; allowed: beam, plate, box, tube, disk"),
        ({"type": "box"}, "mesh.size: is missing"),
        ({"type": "box", "size": [1, 2]}, "mesh.size: must be three finite numbers"),
        ({"type": "box", "size": [1, 2, float("nan")]}, "mesh.size: must be three finite numbers"),
        (
            {"type": "box", "size": [1, 1, 1], "elements": "hexahedron21"},
            'mesh.elements: unknown "hexahedron21"; nearest: hexahedron20',
        ),
        (
            {"type": "box", "size": [1, 1, 1], "divisions": [2, 2]},
            "mesh.divisions: must be whole numbers from 1 on, x, y, z; given [2, 2]",
        ),
        ({"type": "box", "size": [1, 1, 1], "divisions": 1000}, "nodes, more than 1e+07"),
        ({"type": "beam"}, 'give either "length" or "points", given neither'),
        ({"type": "beam", "points": [[0, 0, 0], [0, 0, 0]]}, "points 1 and 2 coincide"),
        ({"type": "beam", "lenght": 1}, "mesh.lenght: unknown key; nearest: length"),
        ({"type": "plate", "length": 1, "width": -1}, "mesh.width: must be positive, given -1 m"),
        ({"type": "plate", "length": 1, "width": 1, "skew": 2.0}, "below a right angle"),
        (
            {"type": "tube", "length": 1, "radius": 1, "inner": 2},
            "mesh.inner: must be less than the outer radius 1 m, given 2",
        ),
        (
            {"type": "tube", "length": 1, "radius": 1, "divisions": [2, 2]},
            "must be three or more around, given [2, 2]; they are around, along",
        ),
        (
            {"type": "disk", "radius": 1, "divisions": [2, 10]},
            "mesh.divisions: must be a multiple of 4 around a full disk, given 10",
        ),
        (
            {"type": "disk", "radius": 1, "thickness": 1, "elements": "tetra", "divisions": 12},
            "mesh.divisions: must be a multiple of 8 around a full disk, given 12",
        ),
        ({"type": "disk", "radius": 1, "elements": "tetra"}, "allowed: quad, triangle"),
    ],
)
def test_refused_shapes(words, told):
    with pytest.raises(MeshError) as caught:
        mesh_from(words)
    assert told in str(caught.value)


def test_shapes_are_functions_too():
    mesh = meshes.tube(1.0, 0.2, inner=0.1, divisions=(1, 8, 2))
    table = {"type": "tube", "length": 1.0, "radius": 0.2, "inner": 0.1, "divisions": [1, 8, 2]}
    assert np.array_equal(mesh.points, mesh_from(table).points)
    with pytest.raises(MeshError, match="mesh.length: must be positive, given -1 m"):
        meshes.plate(-1.0, 1.0)


def test_all_mistakes_of_a_shape_at_once():
    with pytest.raises(MeshError) as caught:
        mesh_from({"type": "tube", "length": "a", "radios": 1, "shear": 2})
    places = [problem.where for problem in caught.value.problems]
    assert places == ["mesh.radios", "mesh.shear", "mesh.length"]
    assert set(SHAPES) == {"beam", "plate", "box", "tube", "disk"}
