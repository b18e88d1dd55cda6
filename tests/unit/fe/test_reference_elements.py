"""Reference elements against VTK's own, whose node order meshes have; rules on monomials."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from femeshes import SOLIDS
from vtkmodules import vtkCommonDataModel as vtk

from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.fe.elements.element_family import extrapolation

CELLS = {
    "tetra": vtk.vtkTetra,
    "tetra10": vtk.vtkQuadraticTetra,
    "hexahedron": vtk.vtkHexahedron,
    "hexahedron20": vtk.vtkQuadraticHexahedron,
    "hexahedron27": vtk.vtkTriQuadraticHexahedron,
    "wedge15": vtk.vtkQuadraticWedge,
}
POINTS = np.random.default_rng(0).uniform(0.05, 0.3, (6, 3))


def integral(kind, powers):
    """Of r^i s^j t^k over the reference domain."""
    i, j, k = powers
    if kind.startswith("tetra"):
        return factorial(i) * factorial(j) * factorial(k) / factorial(i + j + k + 3)
    if kind.startswith("wedge"):
        return factorial(i) * factorial(j) / factorial(i + j + 2) / (k + 1)
    return 1 / ((i + 1) * (j + 1) * (k + 1))


@pytest.mark.parametrize("kind", SOLIDS)
def test_nodes_shape_functions_and_faces_are_those_of_vtk(kind):
    family, cell = FAMILIES[kind], CELLS[kind]()
    k = cell.GetNumberOfPoints()
    places = cell.GetParametricCoords()
    nodes = np.array([places[i] for i in range(3 * k)]).reshape(k, 3)
    np.testing.assert_array_equal(family.reference.nodes, nodes)
    N, dN = family.reference.shapes(POINTS)
    for point, values, slopes in zip(POINTS, N, dN, strict=True):
        wanted, along = [0.0] * k, [0.0] * 3 * k
        cell.InterpolateFunctions(point.tolist(), wanted)
        cell.InterpolateDerivs(point.tolist(), along)
        np.testing.assert_allclose(values, wanted, atol=1e-14)
        np.testing.assert_allclose(slopes.ravel(), along, atol=1e-13)
    for node in range(k):
        cell.GetPointIds().SetId(node, node)
    wanted = set()
    for number in range(cell.GetNumberOfFaces()):
        face = cell.GetFace(number).GetPointIds()  # one object for all faces
        wanted.add(frozenset(face.GetId(i) for i in range(face.GetNumberOfIds())))
    assert {frozenset(face) for face in family.faces} == wanted


@pytest.mark.parametrize("kind", SOLIDS)
def test_faces_are_ordered_round_and_turned_outwards(kind):
    """Mid-side nodes lie between the corners before and after them; the last one in the middle."""
    family = FAMILIES[kind]
    nodes = family.reference.nodes
    for face in family.faces:
        corners = [node for node in face if node < family.reference.corners]
        assert list(face[: len(corners)]) == corners
        x = nodes[corners]
        middles = [(x[i] + x[(i + 1) % len(x)]) / 2 for i in range(len(x))] + [x.mean(axis=0)]
        rest = face[len(corners) :]
        np.testing.assert_allclose(nodes[list(rest)], np.array(middles[: len(rest)]).reshape(-1, 3))
        outwards = x.mean(axis=0) - nodes[: family.reference.corners].mean(axis=0)
        assert np.cross(x[1] - x[0], x[2] - x[0]) @ outwards > 0
    for a, b in family.edges:
        assert max(a, b) < family.reference.corners


@pytest.mark.parametrize("kind", SOLIDS)
def test_rules_are_positive_and_exact(kind):
    """Mass to the order of products of shape functions on parallelepipeds."""
    family = FAMILIES[kind]
    order = 1 if kind in ("tetra", "hexahedron") else 2
    box = kind.startswith("hexahedron")
    exponents = [p for p in np.ndindex(5, 5, 5) if (max(p) if box else sum(p)) <= 2 * order]
    for rule in (family.rule, family.mass_rule, family.stress_rule):
        assert (rule.w > 0).all()
        assert rule.w.sum() == pytest.approx(integral(kind, (0, 0, 0)), rel=1e-14)
    for powers in exponents:
        found = family.mass_rule.w @ np.prod(family.mass_rule.X ** np.array(powers), axis=1)
        assert found == pytest.approx(integral(kind, powers), rel=1e-12)


@pytest.mark.parametrize("kind", SOLIDS)
def test_stress_is_extrapolated_exactly_as_far_as_its_points_go(kind):
    family = FAMILIES[kind]
    X, nodes = family.stress_rule.X, family.reference.nodes
    fields = {
        "tetra": [],
        "tetra10": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
        "wedge15": [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
    }.get(kind, list(np.ndindex(2, 2, 2)))
    to_nodes = extrapolation(nodes, X)
    for powers in [(0, 0, 0), *fields]:
        found = to_nodes @ np.prod(X ** np.array(powers), axis=1)
        np.testing.assert_allclose(found, np.prod(nodes ** np.array(powers), axis=1), atol=1e-14)
