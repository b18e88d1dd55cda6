"""Ties inside a body: beams on solids, coincident nodes, mean motion; rigid motion stays free."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, line

from flexmb.errors import MeshError
from flexmb.fe import Mesh, assemble, make_interfaces, rectangle, reduce, resolve

MATTER = resolve({"E": 200e9, "nu": 0.3, "density": 8000})


def joined(solid, beam):
    """One mesh of two, with nothing in common."""
    n = len(solid.points)
    sets = {name: nodes + n for name, nodes in beam.node_sets.items()}
    cells = {**solid.blocks, "line": beam.blocks["line"] + n}
    return Mesh(
        np.vstack([solid.points, beam.points]), cells, sets, solid.element_sets, source="joined"
    )


def solid_and_beam(divisions=(4, 1, 1)):
    """A block from x = 0 to 1, then a beam of the same section from x = 1 to 2."""
    solid = block(divisions, (1, 0.1, 0.2))
    beam = line(4, (1, 0.05, 0.1), (2, 0.05, 0.1))
    return joined(solid, beam), {"all": rectangle(0.1, 0.2)}


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_rigid_motion_is_free_and_has_the_mass_of_both_parts(kind):
    mesh, sections = solid_and_beam()
    fe = assemble(
        mesh, MATTER, sections, ties={"seat": {"type": kind, "reference": "root", "nodes": "x1"}}
    )
    R = fe.rigid
    assert np.abs(fe.K @ R).max() < 1e-12 * np.abs(fe.K).max()
    values = np.linalg.eigvalsh(fe.K.toarray())
    assert np.abs(values[:6]).max() < 1e-12 * values[-1] < 1e-4 * values[6]
    M = R.T @ (fe.M @ R)
    inertia = np.diag([fe.inertia.mass] * 3 + [0.0] * 3)
    S = fe.inertia.S0 - np.outer(fe.inertia.S1, fe.inertia.S1) / fe.inertia.mass
    inertia[3:, 3:] = np.trace(S) * np.eye(3) - S
    np.testing.assert_allclose(M, inertia, atol=1e-10)
    assert fe.inertia.mass == pytest.approx(8000 * 0.1 * 0.2 * 2, rel=1e-12)


@pytest.mark.parametrize(("kind", "within"), [("rbe2", 3e-3), ("rbe3", 1.2e-2)])
def test_a_cantilever_half_solid_half_beam_bends_as_one(kind, within):
    """Timoshenko cantilever under a tip force: F L^3/3EI + F L/(k G A).

    The solid part has 0.2 % of discretisation error. An RBE3 seat brings equal forces to all nodes
    instead of stresses as in a beam: softer, by about 1 % with three rows of nodes.
    """
    mesh, sections = solid_and_beam((8, 1, 2))
    matter = resolve({"E": 200e9, "nu": 0.0, "density": 8000})
    fe = assemble(
        mesh, matter, sections, ties={"seat": {"type": kind, "reference": "root", "nodes": "x1"}}
    )
    table = fe.numbering.table
    held = table[fe.mesh.group_nodes("x0"), :3].ravel()
    free = np.setdiff1d(np.arange(fe.numbering.n), held)
    f = np.zeros(fe.numbering.n)
    f[table[fe.mesh.group_nodes("tip")[0], 2]] = 1e3
    u = np.zeros_like(f)
    u[free] = np.linalg.solve(fe.K.toarray()[np.ix_(free, free)], f[free])
    EI, kGA = 200e9 * 0.1 * 0.2**3 / 12, 5 / 6 * 200e9 / 2 * 0.02
    wanted = 1e3 * 8 / (3 * EI) + 1e3 * 2 / kGA
    assert u[f != 0] == pytest.approx(wanted, rel=within)


def test_tying_coincident_nodes_is_merging_them():
    merged = line(4)
    parts = Mesh(
        np.vstack([merged.points, merged.points[2]]),
        {"line": np.array([[0, 1], [1, 2], [5, 3], [3, 4]])},
        {"one": np.array([2]), "other": np.array([5]), "root": np.array([0])},
    )
    section = {"all": rectangle(0.01, 0.02)}
    whole = assemble(merged, MATTER, section)
    tie = {"weld": {"type": "rbe2", "reference": "one", "nodes": "other"}}
    tied = assemble(parts, MATTER, section, ties=tie)
    rows = whole.numbering.table[[0, 1, 2, 3, 4]].ravel()
    same = tied.numbering.table[[0, 1, 2, 3, 4]].ravel()
    for name in ("K", "M"):
        one, other = getattr(whole, name).toarray(), getattr(tied, name).toarray()
        np.testing.assert_allclose(
            other[np.ix_(same, same)], one[np.ix_(rows, rows)], atol=1e-12 * np.abs(one).max()
        )


def test_a_tied_body_reduces_and_every_node_moves_with_its_tie():
    mesh, sections = solid_and_beam()
    tie = {"seat": {"type": "rbe2", "reference": "root", "nodes": "x1"}}
    body = reduce(
        mesh,
        material={"E": 200e9, "nu": 0.3, "density": 8000},
        sections=sections,
        ties=tie,
        interfaces={"left": "x0", "right": "tip"},
        modes=6,
    )
    nodes = body.nodes
    reference = nodes.row(int(mesh.group_nodes("root")[0]))
    turn = nodes.Phi_r[reference]
    for node in mesh.group_nodes("x1"):
        row = nodes.row(int(node))
        arm = nodes.position[row] - nodes.position[reference]
        rigid = nodes.Phi_t[reference] + np.cross(turn, arm, axisa=0, axisb=0, axisc=0)
        np.testing.assert_allclose(nodes.Phi_t[row], rigid, atol=1e-12)
    assert body.m == 12 + 6 - 6


@pytest.mark.parametrize(
    ("tie", "sentence"),
    [
        ({"type": "rbe4", "reference": "root", "nodes": "x1"}, 'unknown "rbe4".*nearest: rbe'),
        ({"type": "rbe2", "reference": "x1", "nodes": "x1"}, "one node is expected, the group"),
        ({"type": "rbe2", "reference": 10**6, "nodes": "x1"}, "there is no node 1000000"),
        ({"type": "rbe2", "reference": "root"}, "ties.seat.nodes: is missing"),
        ({"type": "rbe2", "reference": "root", "nodes": "x2"}, 'no group "x2"'),
        ({"type": "rbe2", "reference": "root", "nodes": "root"}, "no other nodes"),
        ({"type": "rbe3", "reference": "root", "nodes": "tip"}, "lie on a line or a point"),
    ],
)
def test_ties_that_cannot_be(tie, sentence):
    mesh, sections = solid_and_beam()
    with pytest.raises(MeshError, match=sentence):
        assemble(mesh, MATTER, sections, ties={"seat": tie})


def test_a_node_follows_one_tie_only_and_an_interface_takes_no_followers():
    mesh, sections = solid_and_beam()
    seat = {"type": "rbe2", "reference": "root", "nodes": "x1"}
    with pytest.raises(MeshError, match='follows the tie "seat" already'):
        assemble(mesh, MATTER, sections, ties={"seat": seat, "more": {**seat, "reference": "tip"}})
    chain = {"type": "rbe3", "reference": "tip", "nodes": "x1"}
    with pytest.raises(MeshError, match='itself follows the tie "seat"; join'):
        assemble(mesh, MATTER, sections, ties={"seat": seat, "more": chain})
    fe = assemble(mesh, MATTER, sections, ties={"seat": seat})
    with pytest.raises(MeshError, match="follow a tie of the body.*reference node"):
        make_interfaces(fe, {"end": "x1"})
