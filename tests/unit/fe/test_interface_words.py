"""Interfaces by group, node, nodes and radius, rigid and weighted, and what is refused of them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from femeshes import block, line
from solidkit import held, nodal_stress, solve

from flexmb.errors import MeshError
from flexmb.fe import (
    Mesh,
    WeightedInterface,
    assemble,
    make_interfaces,
    mesh_from,
    rectangle,
    resolve,
)
from flexmb.fe.meshes.mesh_shapes import KINDS

STEEL = resolve("steel")


@pytest.fixture(scope="module")
def box():
    return assemble(block((2, 2, 1), (2, 1, 0.5)), STEEL)


@pytest.fixture(scope="module")
def bar():
    return assemble(line(4), STEEL, {"all": rectangle(0.02, 0.03)})


def one(fe, words):
    return make_interfaces(fe, {"a": words})[0]


@pytest.mark.parametrize("weights", [None, "uniform", "area"])
def test_a_weighted_point_follows_rigid_motions(box, weights):
    words = {"group": "x1", "type": "rbe3"} | ({} if weights is None else {"weights": weights})
    part = one(box, words)
    q = np.eye(6)
    arm = part.position - box.center
    q[:3, 3:] = [[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]]
    np.testing.assert_allclose(part.motion(box.rigid), q, atol=1e-13)


def test_forces_at_a_weighted_point_keep_resultant_and_moment(box):
    """f = W^T F has the force and moment of F about the point: W G = 1 transposed."""
    part = one(box, {"group": "x1", "type": "rbe3", "position": [2.5, 0.2, -0.1]})
    F = np.array([1.0, -2.0, 3.0, 0.4, 0.5, -0.6])
    f = (part.W.T @ F).reshape(-1, 3)
    arms = box.mesh.points[part.nodes] - part.position
    np.testing.assert_allclose(f.sum(axis=0), F[:3], atol=1e-12)
    np.testing.assert_allclose(np.cross(arms, f).sum(axis=0), F[3:], atol=1e-12)


def test_weights_are_those_of_a_least_squares_fit(box):
    """W u is the rigid motion nearest to u: its residual has no weighted resultant."""
    w = np.random.default_rng(0).uniform(1, 2, len(box.mesh.group_nodes("x1")))
    part = one(box, {"group": "x1", "type": "rbe3", "weights": list(w)})
    u = np.random.default_rng(1).normal(size=(box.numbering.n, 1))
    q = part.motion(u)[:, 0]
    arms = box.mesh.points[part.nodes] - part.position
    left = u[box.numbering.table[part.nodes, :3], 0] - q[:3] - np.cross(q[3:], arms)
    np.testing.assert_allclose(w @ left, 0, atol=1e-12)
    np.testing.assert_allclose(w @ np.cross(arms, left), 0, atol=1e-12)


@pytest.mark.parametrize("nodes", [False, True])
@pytest.mark.parametrize("kind", KINDS[3])
def test_ties_and_groups_of_nodes_bring_a_uniform_traction(kind, nodes):
    """A block under 6 N on 6 mm^2 has 1e6 Pa all over: group of faces or of nodes, and a tie."""
    size = np.array([1e-3, 2e-3, 3e-3])
    box = mesh_from({"type": "box", "size": size, "divisions": [1, 2, 2], "elements": kind})
    points = np.vstack([box.points, [1e-3, 0, 0]])
    groups = dict(box.node_sets), {} if nodes else box.element_sets
    mesh = Mesh(points, box.blocks, groups[0] | {"point": np.array([len(box.points)])}, groups[1])
    weighted = {"type": "rbe3", "position": [1e-3, 0, 0]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fe = assemble(mesh, STEEL)
        tied = assemble(
            mesh, STEEL, ties={"a": {"type": "rbe3", "reference": "point", "nodes": "x1"}}
        )
    part = one(fe, {**weighted, "group": "x1"})
    fixed = held(fe, ("x0", "x"), ("y0", "y"), ("z0", "z"))
    f = np.zeros(fe.numbering.n)
    f[part.dofs] = 6.0 * part.W[0]
    row = tied.numbering.table[-1, 0] - tied.numbering.n
    np.testing.assert_allclose(6.0 * tied.follow[[row]].toarray()[0], f, atol=1e-12)
    stress = nodal_stress(fe, solve(fe, f, fixed))[: len(box.points)]
    np.testing.assert_allclose(stress, np.broadcast_to([1e6, 0, 0, 0, 0, 0], stress.shape), atol=1)
    arms = mesh.points[part.nodes] - part.position
    np.testing.assert_allclose(
        np.cross(arms, f[part.dofs].reshape(-1, 3)).sum(axis=0), 0, atol=1e-15
    )


def test_weights_by_area_do_not_ask_how_finely_a_side_is_meshed():
    """A face meshed finer towards y = 0 bulges by y^2: its mean is 1/3, whatever the mesh."""
    coarse = block((1, 4, 1), (1, 1, 1))
    points = coarse.points.copy()
    points[:, 1] **= 1.7
    fe = assemble(Mesh(points, coarse.blocks, {}, coarse.element_sets), STEEL)
    u = np.zeros((fe.numbering.n, 1))
    u[fe.numbering.table[:, 0], 0] = points[:, 1] ** 2
    found = {w: one(fe, {"group": "x1", "type": "rbe3", "weights": w}) for w in ("area", "uniform")}
    error = {w: abs(part.motion(u)[0, 0] - 1 / 3) for w, part in found.items()}
    assert error["area"] < 0.02 < 0.03 < error["uniform"]


def test_all_nodes_within_a_radius_take_the_centre_as_their_point(box):
    part = one(box, {"center": [2, 0.5, 0.25], "radius": 0.4})
    gap = np.linalg.norm(box.mesh.points - [2, 0.5, 0.25], axis=1)
    np.testing.assert_array_equal(part.nodes, np.flatnonzero(gap <= 0.4))
    np.testing.assert_array_equal(part.position, [2, 0.5, 0.25])


def test_a_given_position_is_kept_and_nodes_may_be_listed(box):
    nodes = [int(n) for n in box.mesh.group_nodes("x0")[:5]]
    part = one(box, {"nodes": nodes[::-1], "position": [0.1, 0.2, 0.3]})
    np.testing.assert_array_equal(part.nodes, nodes)
    np.testing.assert_array_equal(part.position, [0.1, 0.2, 0.3])


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_a_single_node_with_rotations(bar, kind):
    part = one(bar, {"node": 4, "type": kind})
    rows = bar.numbering.table[4]
    np.testing.assert_allclose(part.motion(np.eye(bar.numbering.n))[:, rows], np.eye(6), atol=1e-15)


def test_nodes_on_a_line_hold_by_their_own_rotations(bar):
    """Beam nodes along x: the twist about x comes from the nodes' rotations alone."""
    part = one(bar, {"nodes": [0, 1, 2], "type": "rbe3"})
    twist = np.zeros((bar.numbering.n, 1))
    twist[bar.numbering.table[:3, 3]] = 1.0
    np.testing.assert_allclose(part.motion(twist)[:, 0], [0, 0, 0, 1, 0, 0], atol=1e-14)
    assert isinstance(part, WeightedInterface)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"group": "x1", "tpye": "rbe3"}, "interfaces.a.tpye: unknown key; nearest: type"),
        ({"group": "x1", "type": "rbe4"}, 'interfaces.a.type: unknown "rbe4"; nearest: rbe'),
        ({"type": "rbe3"}, "has no nodes; give one of group, node, nodes, or center"),
        ({"group": "x1", "node": 3}, "has group and node; give one of"),
        ({"center": [0, 0, 0]}, '"center" and "radius" go together'),
        ({"center": [0, 0], "radius": 1}, "center: must be three finite numbers"),
        ({"center": [0, 0, 0], "radius": -1}, "radius: must be positive, given -1 m"),
        ({"center": [9, 9, 9], "radius": 1}, "the nearest is node .* m away"),
        ({"node": 12345}, "12345 is no node: numbers run from 0"),
        ({"nodes": [3, 3, 4]}, "names a node twice"),
        ({"node": 3}, "node 3 belongs to solids, which have no rotations: .* choose a surface"),
        ({"nodes": [0, 2, 4], "type": "rbe3"}, "lie on a line or a point"),
        ({"group": "x1", "position": [0, float("nan"), 1]}, "position: must be three finite"),
        ({"group": "x1", "weights": "area"}, "weights: are for type = .rbe3."),
        ({"group": "x1", "type": "rbe3", "weights": "mass"}, 'unknown weights "mass"'),
        ({"group": "x1", "type": "rbe3", "weights": [1.0, 2.0]}, "must be 15 positive numbers"),
        ({"nodes": [0, 5, 9, 12], "type": "rbe3", "weights": "area"}, "have no facets"),
    ],
)
def test_words_that_cannot_be(box, words, sentence):
    with pytest.raises(MeshError, match=sentence):
        one(box, words)


def test_all_mistakes_are_told_at_once_and_shared_nodes_are_named(box):
    with pytest.raises(MeshError) as told:
        make_interfaces(box, {"a": {"group": "nowhere"}, "b": {"node": 3}})
    assert len(told.value.problems) == 2
    shared = {"a": "x1", "b": {"center": [2, 0, 0], "radius": 0.6, "type": "rbe3"}}
    with pytest.raises(MeshError, match=r'b: shares \d+ nodes \(\d+, \d+.*\) with .* "a"'):
        make_interfaces(box, shared)
