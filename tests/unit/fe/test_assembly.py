"""Mass properties of meshes against closed forms, and meshes that cannot be assembled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from femeshes import block, line

from flexmb.errors import MeshError
from flexmb.fe import Mesh, assemble, rectangle, resolve
from flexmb.fe.displacements import extruded_beams
from flexmb.flexbody import NodeModes

MATTER = resolve({"E": 1e9, "nu": 0.3, "density": 2000.0})
TIGHT = {"rtol": 1e-12, "atol": 1e-12}
AFFINE = np.array([[1.0, 0.3, 0.1], [0.0, 1.2, -0.2], [0.4, 0.0, 0.9]])


def test_mass_of_a_skewed_box_is_exact():
    """Unit box under x -> F x: mass rho det F, S0 = mass F (I/12 + 1/4) F^T."""
    inertia = assemble(block((3, 2, 2), distort=0.3, affine=AFFINE), MATTER).inertia
    mass = 2000 * np.linalg.det(AFFINE)
    second = AFFINE @ (np.eye(3) / 12 + np.full((3, 3), 0.25)) @ AFFINE.T
    np.testing.assert_allclose(inertia.mass, mass, **TIGHT)
    np.testing.assert_allclose(inertia.S1, mass * AFFINE @ np.full(3, 0.5), **TIGHT)
    np.testing.assert_allclose(inertia.S0, mass * second, **TIGHT)


def test_loads_of_an_angular_acceleration():
    """A force per mass α × s has the moment J α about the origin, and the force m α × c."""
    fe, alpha = assemble(block((3, 2, 2), distort=0.3, affine=AFFINE), MATTER), np.array([3, -2, 5])
    turning = np.cross(alpha, np.eye(3)).T
    load = fe.load_per_mass(np.column_stack([turning, np.zeros(3)]))
    inertia, c = fe.inertia, fe.center
    force, moment = np.split(fe.rigid.T @ load, 2)
    J = np.trace(inertia.S0) * np.eye(3) - inertia.S0
    np.testing.assert_allclose(force, inertia.mass * np.cross(alpha, c), **TIGHT)
    np.testing.assert_allclose(moment + np.cross(c, force), J @ alpha, rtol=1e-10)


def test_mass_of_a_skew_beam_is_exact():
    """Prism of length L: S0 = m (c c^T + R diag(L^2, y^2, z^2)/12 R^T)."""
    start, end = np.array([0.1, -0.2, 0.3]), np.array([0.7, 0.5, 0.9])
    section = rectangle(0.05, 0.08, orientation=(0.0, 0.3, 1.0))
    fe = assemble(line(5, start, end), MATTER, {"all": section})
    L = np.linalg.norm(end - start)
    x = (end - start) / L
    y = np.array([0, 0.3, 1.0]) - x * (x @ [0, 0.3, 1.0])
    y /= np.linalg.norm(y)
    R = np.stack([x, y, np.cross(x, y)], axis=1)
    mass, c = 2000 * 0.004 * L, (start + end) / 2
    S0 = mass * (np.outer(c, c) + R @ np.diag([L**2, 0.05**2, 0.08**2]) @ R.T / 12)
    np.testing.assert_allclose(fe.inertia.mass, mass, **TIGHT)
    np.testing.assert_allclose(fe.center, c, **TIGHT)
    np.testing.assert_allclose(fe.inertia.S0, S0, **TIGHT)


@pytest.mark.parametrize(
    ("mesh", "sections"),
    [
        (block((2, 1, 1), distort=0.2), None),
        (line(4, (0, 0, 0), (1, 2, 2)), {"all": rectangle(0.1, 0.2)}),
    ],
)
def test_rigid_motions_carry_the_rigid_inertia(mesh, sections):
    """R^T M R is the 6x6 rigid mass matrix about the centre, and K R vanishes."""
    fe = assemble(mesh, MATTER, sections)
    R, inertia = fe.rigid, fe.inertia
    S = inertia.S0 - np.outer(inertia.S1, inertia.S1) / inertia.mass
    wanted = np.zeros((6, 6))
    wanted[:3, :3] = inertia.mass * np.eye(3)
    wanted[3:, 3:] = np.trace(S) * np.eye(3) - S
    np.testing.assert_allclose(R.T @ (fe.M @ R), wanted, atol=1e-12 * inertia.mass)
    assert np.abs(fe.K @ R).max() < 1e-13 * np.abs(fe.K).max()
    values = np.linalg.eigvalsh(fe.K.toarray())
    assert np.abs(values[:6]).max() < 1e-11 * values[-1] < values[6]
    assert np.linalg.eigvalsh(fe.M.toarray())[0] > 0


def test_solids_and_beams_share_a_node():
    """A beam on the corner of a box adds its mass; the node has six degrees of freedom."""
    box = block((1, 1, 1))
    corner = int(np.flatnonzero((box.points == 1).all(axis=1))[0])
    points = np.vstack([box.points, [2, 1, 1]])
    mesh = Mesh(points, dict(box.blocks) | {"line": np.array([[corner, len(points) - 1]])})
    fe = assemble(mesh, MATTER, {"all": rectangle(0.1, 0.1)})
    assert fe.inertia.mass == pytest.approx(2000 * 1.01)
    assert (fe.numbering.table[corner] >= 0).all()
    assert fe.numbering.n == 3 * len(box.points) + 3 + 6
    np.testing.assert_allclose(fe.center * 1.01, [0.5 + 0.015, 0.51, 0.51], atol=1e-12)


def test_nodes_outside_the_body_are_left_out():
    box = block((1, 1, 1))
    fe = assemble(replace(box, points=np.vstack([box.points, [9, 9, 9]])), MATTER)
    assert fe.numbering.n == 3 * len(box.points)


def pyramids():
    box = block((1, 1, 1))
    return Mesh(box.points, {"pyramid": box.blocks["tetra10"][:, :5]}, source="box.msh")


def turned_inside_out():
    box = block((1, 1, 1))
    points = box.points.copy()
    points[box.blocks["tetra10"][0, 4]] += [5.0, 5.0, 5.0]
    return replace(box, points=points)


@pytest.mark.parametrize(
    ("mesh", "sections", "sentence"),
    [
        (pyramids(), None, 'box.msh: has 6 elements of kind "pyramid".*mesh with tetrahedra'),
        (line(2), None, "no volume elements, and no lines or surfaces with a section; it has 2"),
        (turned_inside_out(), None, "flat, folded or turned inside out"),
        (line(2), {"rot": rectangle(1, 1)}, 'sections.rot: .* no group "rot"; nearest: root'),
        (line(2), {"root": rectangle(1, 1)}, "sections.root: the group has no line elements"),
        (
            line(2),
            {"all": rectangle(1, 1, orientation=(1, 0, 0))},
            "parallel to its section.orientation",
        ),
        (
            Mesh(np.zeros((2, 3)), {"line": np.array([[0, 1]])}),
            {"all": rectangle(1, 1)},
            "without length",
        ),
        (
            Mesh(np.eye(3), {"line3": np.array([[0, 1, 2]])}),
            {"all": rectangle(1, 1)},
            "beams have two nodes",
        ),
    ],
)
def test_refused_meshes(mesh, sections, sentence):
    with pytest.raises(MeshError, match=sentence):
        assemble(mesh, MATTER, sections)


def test_mixed_meshes_are_refused_by_name_not_truncated():
    box = block((1, 1, 1))
    blocks = dict(box.blocks) | {"wedge18": np.arange(18)[None]}
    with pytest.raises(MeshError, match='1 elements of kind "wedge18", which cannot be used'):
        assemble(Mesh(box.points, blocks), MATTER)


def test_corners_of_an_extruded_beam_turn_with_its_nodes():
    """Under a rigid rotation every corner at x moves by ω × x."""
    fe = assemble(line(3, end=(1, 1, 0)), MATTER, {"all": rectangle(0.2, 0.1)})
    ids, turn = np.arange(4), np.array([1.0, -2.0, 3.0])
    places = fe.mesh.points
    moved = np.cross(turn, places)[:, :, None]
    modes = NodeModes(ids, places, moved, np.tile(turn[:, None], (4, 1, 1)))
    solid = extruded_beams(fe, modes)
    assert np.ptp(solid.points[:, 2]) > 0.09
    np.testing.assert_allclose(solid.modes[:, :, 0], np.cross(turn, solid.points), atol=1e-12)
