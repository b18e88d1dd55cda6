"""Beams with released ends, and the chains that taper and releases go along."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import held_frequencies, line

from flexmb.errors import MeshError
from flexmb.fe import Mesh, assemble, circle, part, rectangle, reduce, resolve, tapered

MATTER = resolve({"E": 1e9, "nu": 0.3, "density": 2000.0})


def test_released_ends_are_hinges():
    """Clamped nodes, hinged elements: pinned-pinned and clamped-pinned roots pi^2, 15.4182."""
    for releases, root in (
        ({"start": ["rz"], "end": ["rz"]}, np.pi**2),
        ({"end": ["rz"]}, 15.41820571698),
    ):
        section = rectangle(1e-3, 2e-3, shear=False, releases=releases)
        fe = assemble(line(12), MATTER, {"all": section})
        table = fe.numbering.table
        held = np.union1d(np.union1d(table[0], table[-1]), table[:, (0, 2, 3, 4)].ravel())
        found = held_frequencies(fe, held, 1)[0]
        scale = np.sqrt(MATTER.E * section.Iz / (MATTER.density * section.A))
        assert found / scale == pytest.approx(root, rel=2e-5)


def test_a_hinge_between_two_groups_transmits_force_and_no_moment():
    """Cantilever of 1 m and a bar of 1 m hinged on it, its far end on a roller: P/2 each."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1.5, 0, 0], [2, 0, 0]], dtype=float)
    cells = {"line": np.array([[0, 1], [1, 2], [2, 3]])}
    sets = {"arm": {"line": np.array([0])}, "bar": {"line": np.array([1, 2])}}
    section = rectangle(0.02, 0.02, shear=False)
    bar = rectangle(0.02, 0.02, shear=False, releases={"start": ["ry", "rz"]})
    fe = assemble(Mesh(points, cells, {}, sets), MATTER, {"arm": section, "bar": bar})
    table, force = fe.numbering.table, np.zeros(fe.numbering.n)
    force[table[2, 1]] = 1.0
    free = np.setdiff1d(
        np.arange(fe.numbering.n), [*table[0], table[3, 1], table[3, 2], table[3, 3]]
    )
    u = np.zeros(fe.numbering.n)
    u[free] = np.linalg.solve(fe.K.toarray()[np.ix_(free, free)], force[free])
    EI = MATTER.E * section.Iz
    assert u[table[1, 1]] == pytest.approx(0.5 / (3 * EI), rel=1e-9)
    assert u[table[2, 1]] == pytest.approx(0.25 / (3 * EI) + 1 / (48 * EI), rel=1e-9)


def test_a_line_load_on_a_hinged_beam_leaves_no_moment_at_the_hinge():
    """A cantilever carries X = 3/16 q L of a clamped bar of length L that is hinged on its tip."""
    length, q, EI = 0.5, 1000.0, MATTER.E * circle(0.02).Iy
    rod = circle(0.02, shear=False)
    bar = circle(0.02, shear=False, releases={"start": ["ry", "rz"]})
    sets = {"a": {"line": np.array([0, 1])}, "b": {"line": np.array([2, 3])}}
    mesh = Mesh(line(4).points, line(4).blocks, {}, sets)
    ends = {name: {"node": node, "type": "clamped"} for name, node in (("root", 0), ("wall", 4))}
    hinged = part(
        mesh,
        material=MATTER,
        sections={"a": rod, "b": bar},
        supports=ends,
        loads={"q": {"type": "line", "group": "b", "force": [0.0, 0.0, -q]}},
    )
    X = 3 / 16 * q * length
    sag = -X * length**3 / (3 * EI)
    assert hinged.quantity("displacement.2.z") == pytest.approx(sag, rel=1e-9)
    assert hinged.quantity("reaction.root.My") == pytest.approx(-X * length, rel=1e-9)
    wall = q * length**2 / 2 - X * length
    assert hinged.quantity("reaction.wall.My") == pytest.approx(wall, rel=1e-9)


RING = Mesh(np.eye(3), {"line": np.array([[0, 1], [1, 2], [2, 0]])})
FORK = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]], dtype=float),
    {"line": np.array([[0, 1], [1, 2], [1, 3]])},
)
TWO = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], dtype=float),
    {"line": np.array([[0, 1], [2, 3]])},
)
CONE = tapered(circle(0.2), circle(0.1))


@pytest.mark.parametrize(
    ("mesh", "section", "sentence"),
    [
        (RING, CONE, "form one chain from end to end, but they form a ring"),
        (FORK, CONE, "they branch at node 1: give each chain a group"),
        (TWO, CONE, "they have 4 ends"),
        (
            line(3),
            circle(0.1, releases={"start": ["rx"], "end": ["rx"]}),
            "rx at node 0 and rx at node 3 let the elements between move on their own",
        ),
        (line(1), circle(0.1, releases={"start": ["uy", "rz"], "end": ["rz"]}), "a mechanism"),
    ],
)
def test_refused_chains(mesh, section, sentence):
    with pytest.raises(MeshError, match=sentence):
        assemble(mesh, MATTER, {"all": section})


@pytest.mark.parametrize("interfaces", [{"a": "root"}, {"a": "root", "b": "tip"}])
def test_a_hinge_that_nothing_holds_is_refused_with_its_node(interfaces):
    """At a free tip a released turn has no stiffness, nor at an interface of that node alone."""
    hinged = {"all": rectangle(0.01, 0.02, releases={"end": ["rz"]})}
    with pytest.raises(MeshError, match=r"node 4 turns about \(0, 0, 1\) without any stiffness"):
        reduce(line(4), material=MATTER, sections=hinged, interfaces=interfaces, modes=2)


def test_a_hinge_inside_a_body_is_reduced():
    """Three beams in a triangle, one of them hinged at a corner: softer than welded."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.4, 0.8, 0.0]])
    cells = {"line": np.array([[0, 1], [1, 2], [2, 0]])}
    sets = {"base": {"line": np.array([0])}, "sides": {"line": np.array([1, 2])}}
    nodes = {"left": np.array([0]), "top": np.array([2])}
    hinged = rectangle(0.02, 0.02, releases={"start": ["ry", "rz"]})
    sections = {"base": hinged, "sides": rectangle(0.02, 0.02)}
    mesh = Mesh(points, cells, nodes, sets)
    ends = {"a": "left", "b": "top"}
    body = reduce(mesh, material=MATTER, sections=sections, interfaces=ends, modes=2)
    sections["base"] = rectangle(0.02, 0.02)
    welded = reduce(mesh, material=MATTER, sections=sections, interfaces=ends, modes=2)
    assert 0 < body.K[0, 0] < welded.K[0, 0]


@pytest.mark.parametrize("flipped", [[1], [3], [0, 2], [0, 1, 2, 3]])
def test_a_chain_runs_on_over_elements_drawn_the_other_way(flipped):
    """Round sections: the matrices are the same; the chain still starts at the same end."""
    way = np.array([1.0, 0.4, 0.2])
    ends = {"start": ["ry", "rz"], "end": ["rx"]}
    cone = tapered(circle(0.1), circle(0.05), releases=ends)
    mesh = line(4, end=way)
    cells = mesh.blocks["line"].copy()
    cells[flipped] = cells[flipped, ::-1]
    if len(flipped) == 4:
        cone = tapered(circle(0.05), circle(0.1), releases={"start": ["rx"], "end": ["ry", "rz"]})
    plain = assemble(mesh, MATTER, {"all": tapered(circle(0.1), circle(0.05), releases=ends)})
    turned = assemble(Mesh(mesh.points, {"line": cells}), MATTER, {"all": cone})
    for name in ("K", "M"):
        first, second = (getattr(fe, name).toarray() for fe in (plain, turned))
        # the hinges' axes y, z of a flipped end element are others of the same plane
        np.testing.assert_allclose(first, second, atol=1e-12 * np.abs(first).max())


def test_a_support_holds_what_a_release_lets_go():
    """A shaft fixed at one end twists by T L/(G J); its other end is hinged at a support."""
    shaft = Mesh(line(4).points, line(4).blocks, {}, {"shaft": {"line": np.arange(4)}})
    section = circle(0.02, releases={"end": ["rx"]})
    words = {"material": MATTER, "sections": {"shaft": section}, "frequencies": 1}
    words["loads"] = {"T": {"type": "force", "node": 2, "moment": [10.0, 0.0, 0.0]}}
    wall = {"wall": {"node": 0, "type": "clamped"}}
    held = part(shaft, supports={**wall, "end": {"node": 4, "type": "clamped"}}, **words)
    GJ = MATTER.G * section.J
    assert held.quantity("rotation.2.x") == pytest.approx(10.0 * 0.5 / GJ, rel=1e-9)
    loose = {**wall, "end": {"node": 4, "hold": ["ux", "uy", "uz", "ry", "rz"]}}
    with pytest.raises(MeshError, match=r"node 4 turns about \(1, 0, 0\) without any stiffness"):
        part(shaft, supports=loose, **words)
