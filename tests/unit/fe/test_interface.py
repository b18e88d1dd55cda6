"""Interfaces: reference points, rigid ties, and groups that cannot carry six motions."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import cross_matrix
from femeshes import block, line
from scipy.sparse.linalg import spsolve

from flexmb.errors import MeshError
from flexmb.fe import Mesh, assemble, make_interfaces, rectangle, resolve
from flexmb.fe.meshes import mesh_shapes
from flexmb.fe.meshes.mesh import facet_moments

STEEL = resolve("steel")


def test_reference_point_is_the_area_centroid_not_the_mean_of_nodes():
    """A face graded towards one side keeps its centroid."""
    box = block((1, 3, 2), (1, 2, 4))
    points = box.points.copy()
    points[:, 1] = points[:, 1] / 2 + points[:, 1] ** 2 / 4
    fe = assemble(Mesh(points, box.blocks, {}, box.element_sets), STEEL)
    found = make_interfaces(fe, {"end": "x1"})[0]
    np.testing.assert_allclose(found.position, [1, 1, 2], atol=1e-12)
    assert abs(points[found.nodes, 1].mean() - 1) > 0.05


def test_curved_facets_are_integrated_as_curved():
    """Six-node triangles on a half cylinder: area pi r h, centroid at 2 r/pi."""
    n, r, h = 16, 2.0, 3.0
    angle = np.pi * np.arange(2 * n + 1) / (2 * n) - np.pi / 2
    at = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    x = np.array([[[*at[k], z] for k in range(2 * n + 1)] for z in (0, h / 2, h)])
    facets = []
    for k in range(0, 2 * n, 2):
        a, b, c, d = x[0, k], x[0, k + 2], x[2, k], x[2, k + 2]
        middle = x[1, k + 1]
        facets += [
            [a, b, c, x[0, k + 1], middle, x[1, k]],
            [b, d, c, x[1, k + 2], x[2, k + 1], middle],
        ]
    area, moment = facet_moments("triangle6", np.array(facets))
    assert area == pytest.approx(np.pi * r * h, rel=1e-5)
    np.testing.assert_allclose(moment / area, [2 * r / np.pi, 0, h / 2], rtol=1e-5, atol=1e-12)


def test_the_connecting_rods_interfaces_lie_on_the_bore_axes(project):
    from flexmb.fe import read_mesh

    mesh = read_mesh(project / "meshes" / "connecting_rod.msh").scaled(1e-3)
    big, small = make_interfaces(assemble(mesh, STEEL), {"a": "bore_big", "b": "bore_small"})
    np.testing.assert_allclose(big.position, 0, atol=1e-14)
    np.testing.assert_allclose(small.position, [0.45, 0, 0], atol=1e-14)


def test_ties_reproduce_rigid_motions():
    fe = assemble(block((2, 2, 1)), STEEL)
    for part in make_interfaces(fe, {"a": "x0", "b": "x1"}):
        q = np.eye(6)
        arm = part.position - fe.center
        q[:3, 3:] = [[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]]
        np.testing.assert_allclose(part.T @ q, fe.rigid[part.dofs], atol=1e-15)


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_a_unit_wrench_at_an_interface_is_that_wrench_on_its_nodes(kind):
    """Forces spread over the nodes have the resultant and the moment about the reference point."""
    fe = assemble(block((2, 2, 1)), STEEL)
    part = make_interfaces(fe, {"a": {"group": "x1", "type": kind}})[0]
    dofs, values = part.loads()
    force = np.zeros((fe.numbering.n, 6))
    force[dofs] = values
    R = fe.rigid.copy()
    R[:, 3:] += R[:, :3] @ cross_matrix(part.position - fe.center)  # about the reference point
    np.testing.assert_allclose(R.T @ force, np.eye(6), atol=1e-13)


def test_a_mean_of_beam_nodes_on_a_line_does_not_depend_on_the_unit_of_length():
    """Turns of the nodes count about the line, of which their displacements tell nothing."""
    u, found = np.random.default_rng(5).normal(size=(5, 6)), []
    for unit in (1.0, 1000.0):
        fe = assemble(line(4, end=(unit, 0, 0)), STEEL, {"all": rectangle(0.1 * unit, 0.1 * unit)})
        words = {"nodes": [0, 2, 3], "type": "rbe3"}
        (part,) = make_interfaces(fe, {"a": words})
        scale = np.array([unit] * 3 + [1.0] * 3)
        field = np.zeros(fe.numbering.n)
        field[fe.numbering.table] = u * scale
        found.append(part.motion(field) / scale)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)


def test_a_single_beam_node_is_an_interface():
    fe = assemble(line(2), STEEL, {"all": rectangle(0.1, 0.1)})
    tip = make_interfaces(fe, {"tip": "tip"})[0]
    np.testing.assert_allclose(tip.position, [1, 0, 0])
    np.testing.assert_array_equal(tip.T, np.eye(6))


def with_node_groups(**groups):
    box = block((2, 2, 2))
    groups = {name: np.array(nodes, dtype=int) for name, nodes in groups.items()}
    points = np.vstack([box.points, [[9, 9, 9], [9, 9, 8]]])
    return assemble(Mesh(points, box.blocks, groups, box.element_sets), STEEL)


@pytest.mark.parametrize(
    ("groups", "asked", "sentence"),
    [
        ({"bore": [0]}, {"a": "bohr"}, 'interfaces.a: .* no group "bohr"; nearest: bore; allowed'),
        (
            {"far": [125, 126]},
            {"a": "far"},
            'interfaces.a: the group "far" has no nodes of the body',
        ),
        ({"one": [3]}, {"a": "one"}, "interfaces.a: node 3 belongs to solids.*choose a surface"),
        ({"edge": [0, 1, 2]}, {"a": "edge"}, "the 3 nodes .* lie on a line"),
        ({"also": [0, 1, 4]}, {"a": "x0", "b": "also"}, 'interfaces.b: shares 3 nodes .* "a"'),
    ],
)
def test_refused(groups, asked, sentence):
    with pytest.raises(MeshError, match=sentence):
        make_interfaces(with_node_groups(**groups), asked)


NO_POISSON = resolve({"E": 2e11, "nu": 0.0, "density": 7800})


def held_and_loaded(kind, wrench):
    """Motion of the end x1 of a box that is held at x0, by a wrench spread over its face."""
    size = (0.6, 0.2, 0.1)
    fe = assemble(mesh_shapes.box(size, (3, 2, 2), kind), NO_POISSON)
    (end,) = make_interfaces(fe, {"end": {"group": "x1", "type": "rbe3"}})
    dofs, values = end.loads()
    force = np.zeros(fe.numbering.n)
    np.add.at(force, dofs, values @ wrench)
    free = np.setdiff1d(np.arange(fe.numbering.n), fe.numbering.table[fe.mesh.points[:, 0] < 1e-9])
    u = np.zeros(fe.numbering.n)
    u[free] = spsolve(fe.K.tocsc()[free][:, free], force[free])
    return end.motion(u), u.reshape(-1, 3), fe.mesh.points


SOLIDS = ["tetra", "tetra10", "wedge15", "hexahedron", "hexahedron20", "hexahedron27"]


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_force_spread_over_a_face_is_a_uniform_traction(kind):
    """Without Poisson's ratio the box extends by F L/(E A), every node in proportion to x."""
    motion, u, points = held_and_loaded(kind, np.array([1e5, 0, 0, 0, 0, 0]))
    extension = 1e5 * 0.6 / (2e11 * 0.02)
    np.testing.assert_allclose(motion, [extension, 0, 0, 0, 0, 0], atol=1e-11 * extension)
    np.testing.assert_allclose(u[:, 0], extension * points[:, 0] / 0.6, atol=1e-11 * extension)


@pytest.mark.parametrize("kind", ["tetra10", "wedge15", "hexahedron20", "hexahedron27"])
def test_a_moment_spread_over_a_face_is_a_linear_traction(kind):
    """Quadratic elements have pure bending exactly: the end turns by M L/(E I)."""
    motion, u, points = held_and_loaded(kind, np.array([0, 0, 0, 0, 0, 300.0]))
    turn = 300.0 * 0.6 / (2e11 * 0.1 * 0.2**3 / 12)
    np.testing.assert_allclose(motion[5], turn, rtol=1e-10)
    np.testing.assert_allclose(motion[1], turn * 0.6 / 2, rtol=1e-10)
    np.testing.assert_allclose(
        u[:, 0], -turn * points[:, 0] / 0.6 * points[:, 1], atol=1e-10 * turn
    )
