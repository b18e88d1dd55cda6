"""Elements of plates and shells: patch tests, rigid motions, mass, stress, geometric stiffness."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shellkit import (
    KINDS,
    LAYUP,
    SECTIONS,
    SKEW,
    STEEL,
    corners,
    held,
    model,
    rectangle,
    rigid_motions,
    sheet,
    static,
)

from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.fe.elements.shell_fields import make_fields, make_points, shell_functions
from flexmb.fe.sections.shell_section import Layer, layered, shell
from flexmb.materials import OrthotropicMaterial

ROUND = 1e-12  # rounding of sums of a few hundred products, relative to the largest


def patch(kind, section, fields):
    """Displacements (nodes, 6) of a distorted plate in skew orientation whose edge follows fields
    (u, theta) given in the plate's axes, and the same of all nodes; the model."""
    flat = sheet((4, 3), kind, 0.35, rectangle(1.0, 0.8))
    wanted = fields(flat.points)
    mesh = sheet((4, 3), kind, 0.35, lambda st: rectangle(1.0, 0.8)(st) @ SKEW.T + 1.0)
    fe = model(mesh, section, STEEL)
    wanted = np.hstack([wanted[:, :3] @ SKEW.T, wanted[:, 3:] @ SKEW.T])
    edge = np.unique(np.concatenate(list(mesh.node_sets.values())))
    dofs = fe.numbering.table[edge].ravel()
    u = np.zeros(fe.numbering.n)
    u[dofs] = wanted[edge].ravel()
    return static(fe, -fe.K @ u, dofs) + u[fe.numbering.table], wanted, fe


def face_stress(fe, u):
    """(elements, corners, 2, 6) stress turned into the plate's axes: xx, yy, xy of both faces."""
    (block,) = fe.blocks
    x = fe.mesh.points[block.nodes]
    rows = block.family.stress(x, block.section)
    s = np.einsum("eklid,ed->ekli", rows, u[block.nodes].reshape(len(x), -1))
    full = s[..., [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    return SKEW.T @ full @ SKEW


@pytest.mark.parametrize("kind", KINDS)
def test_constant_membrane_strain(kind):
    grad = np.array([[1.0, -0.4], [0.7, 0.5]]) * 1e-3
    spin = 0.5 * (grad[1, 0] - grad[0, 1])

    def fields(p):
        return np.column_stack([p[:, :2] @ grad.T, np.zeros((len(p), 3)), np.full(len(p), spin)])

    u, wanted, fe = patch(kind, shell(0.2), fields)
    assert np.abs(u - wanted).max() < ROUND * np.abs(wanted).max()
    exact = STEEL.plane_stress() @ [grad[0, 0], grad[1, 1], grad[0, 1] + grad[1, 0]]
    found = face_stress(fe, u)[..., [0, 1, 0], [0, 1, 1]]
    assert found == pytest.approx(np.broadcast_to(exact, found.shape), rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("h", [1e-3, 0.2])
def test_constant_curvature(kind, h):
    """w = -(a x^2 + b y^2 + c x y)/2 without shear strain: theta_x = w,y and theta_y = -w,x."""
    a, b, c = 1.0, -0.5, 0.8

    def fields(p):
        x, y, none = p[:, 0], p[:, 1], 0 * p[:, 0]
        w = -0.5 * (a * x**2 + b * y**2 + c * x * y)
        return np.column_stack([none, none, w, -(b * y + c * x / 2), a * x + c * y / 2, none])

    u, wanted, fe = patch(kind, shell(h), fields)
    condition = 1e-15 / h**2  # of membrane and bending in one matrix
    assert np.abs(u - wanted).max() < (ROUND + condition) * np.abs(wanted).max()
    exact = STEEL.plane_stress() @ [a, b, c] * h / 2
    found = face_stress(fe, u)[..., [0, 1, 0], [0, 1, 1]]
    assert found[:, :, 1] == pytest.approx(np.broadcast_to(exact, found[:, :, 1].shape), rel=1e-7)
    assert found[:, :, 0] == pytest.approx(-found[:, :, 1], rel=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_constant_shear(kind):
    """Where shear is soft, phi -> infinity, elements have exactly the strain of their nodes."""
    soft = OrthotropicMaterial("soft", (1e9,) * 3, (0.3,) * 3, (4e8, 1e-6, 1e-6), 1000.0)
    x = corners(kind)
    gamma = SKEW[:, :2] @ [0.3, -0.7]
    u = np.zeros((x.shape[1], 6))
    u[:, :3] = np.outer((x[0] - x[0, 0]) @ gamma, SKEW[:, 2])
    fields = make_fields(kind, x, shell(0.1, material=soft))
    rows = make_points(fields.flat, shell_functions(kind, "stiffness")).shear_strains(fields)[0]
    found = rows @ u.ravel() @ fields.flat.axes[0, :, :2].T
    assert found == pytest.approx(np.tile(gamma, (len(found), 1)), abs=ROUND)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SECTIONS)
@pytest.mark.parametrize("warped", [0.0, 0.05])
def test_rigid_motions_and_nothing_else_are_free(kind, name, warped):
    x, section = corners(kind, warped), SECTIONS[name]
    K = FAMILIES[kind].stiffness(x, section)[0]
    assert (K == K.T).all()
    assert np.abs(K @ rigid_motions(x[0])).max() < ROUND * np.abs(K).max()
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:6]).max() < ROUND * values[-1]
    assert values[6] > 1e3 * np.abs(values[:6]).max()


@pytest.mark.parametrize("sides", [(1.0, 1.0), (3.0, 1.0)])
def test_rectangles_have_six_free_motions(sides):
    """The 2 x 2 rule alone lets them warp in their plane."""
    x = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * [*sides, 1.0]
    values = np.linalg.eigvalsh(FAMILIES["quad"].stiffness(x[None], SECTIONS["thick"])[0])
    assert values[6] > 1e-5 * values[-1]
    assert np.abs(values[:6]).max() < ROUND * values[-1]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SECTIONS)
def test_mass_of_rigid_motions(kind, name):
    x, section = corners(kind, 0.05), SECTIONS[name]
    mass = FAMILIES[kind].mass(x, section)
    R = rigid_motions(x[0])
    M = np.einsum("aaij->ij", mass.Mab[0])
    found = R.T @ M @ R
    S1, S0 = mass.S1[0], mass.S0[0]
    wanted = np.zeros((6, 6))
    wanted[:3, :3] = mass.mass[0] * np.eye(3)
    wanted[3:, 3:] = np.trace(S0) * np.eye(3) - S0
    wanted[3:, :3] = np.cross(S1, np.eye(3)).T
    wanted[:3, 3:] = wanted[3:, :3].T
    assert np.abs(found - wanted).max() < 1e-14 * np.abs(wanted).max()
    assert np.linalg.eigvalsh(M)[0] > 0
    for b in range(3):  # N_b of a unit translation along b is 1
        assert mass.p[0, b] @ R[:, b] == pytest.approx(mass.mass[0], rel=1e-14)
        assert mass.P[0, :, b] @ R[:, b] == pytest.approx(S1, rel=1e-13)
    per_area = sum(
        (layer.material or section.material).density * layer.thickness for layer in section.layers
    )
    area = FAMILIES[kind].measure(x, section)[0]
    assert mass.mass[0] == pytest.approx((per_area + section.nonstructural) * area, rel=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_inertia_of_a_plate_is_that_of_a_brick(kind):
    """A plate of size a, b, h, off its mesh by an offset, in skew orientation."""
    a, b, h, offset = 1.0, 0.8, 0.1, 0.07
    mesh = sheet((3, 4), kind, 0.3, lambda st: rectangle(a, b)(st) @ SKEW.T + [0.3, -0.2, 0.5])
    fe = model(mesh, shell(h, offset=offset), STEEL)
    mass = STEEL.density * a * b * h
    center = SKEW @ [a / 2, b / 2, offset] + [0.3, -0.2, 0.5]
    own = SKEW @ np.diag([a * a, b * b, h * h]) @ SKEW.T / 12
    assert fe.inertia.mass == pytest.approx(mass, rel=1e-14)
    assert fe.center == pytest.approx(center, rel=1e-14)
    assert fe.inertia.S0 == pytest.approx(mass * (own + np.outer(center, center)), rel=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_offset_is_a_rigid_link(kind):
    """A plate off its nodes is the plate at its mid-surface, moved by rigid arms."""
    x, offset = corners(kind), 0.04
    arm = offset * SKEW[:, 2]
    middle = FAMILIES[kind].stiffness(x + arm, SECTIONS["thick"])[0]
    section = shell(0.2, material=STEEL, offset=offset)
    T = np.eye(len(middle))
    for node in range(x.shape[1]):
        T[6 * node : 6 * node + 3, 6 * node + 3 : 6 * node + 6] = -np.cross(arm, np.eye(3)).T
    K = FAMILIES[kind].stiffness(x, section)[0]
    assert K == pytest.approx(T.T @ middle @ T, abs=ROUND * np.abs(K).max())
    M = FAMILIES[kind].mass(x, section)
    moved = FAMILIES[kind].mass(x + arm, SECTIONS["thick"])
    assert M.Mab[0] == pytest.approx(T.T @ moved.Mab[0] @ T, abs=ROUND * M.Mab.max())
    assert M.S0 == pytest.approx(moved.S0, rel=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_turned_stress_turns_its_forces(kind):
    """A rigid rotation of a membrane under stress turns the nodal forces: Kg R = omega x f."""
    x, section = corners(kind), SECTIONS["thick"]
    k = x.shape[1]
    strain = np.array([[1.0, 0.3, 0], [0.3, -0.6, 0], [0, 0, 0]]) * 1e-3
    u = np.zeros((k, 6))
    u[:, :3] = (x[0] - x[0, 0]) @ (SKEW @ strain @ SKEW.T)
    f = (FAMILIES[kind].stiffness(x, section)[0] @ u.ravel()).reshape(k, 6)
    Kg = FAMILIES[kind].geometric_stiffness(x, section, u.reshape(1, -1))[0]
    assert (Kg == Kg.T).all()
    R = rigid_motions(x[0])
    for axis in range(3):
        turned = (Kg @ R[:, 3 + axis]).reshape(k, 6)[:, :3]
        wanted = np.cross(np.eye(3)[axis], f[:, :3])
        assert turned == pytest.approx(wanted, abs=ROUND * np.abs(f).max())
    assert np.abs(Kg @ R[:, :3]).max() < ROUND * np.abs(Kg).max()


@pytest.mark.parametrize("kind", KINDS)
def test_rotations_are_the_nodes_own(kind):
    rows = FAMILIES[kind].rotation(corners(kind))
    k = rows.shape[1]
    u = np.arange(6.0 * k)
    assert (rows[0] @ u == u.reshape(k, 6)[:, 3:]).all()


def test_layers_of_one_material_are_one_layer():
    whole = FAMILIES["quad"].stiffness(corners("quad"), SECTIONS["thick"])[0]
    layers = [Layer(0.05, STEEL), Layer(0.1, STEEL, 0.7), Layer(0.05, STEEL)]
    parts = FAMILIES["quad"].stiffness(corners("quad"), layered(layers))[0]
    assert parts == pytest.approx(whole, abs=ROUND * whole.max())


def test_stress_of_layers_is_that_of_the_outermost():
    """Uniaxial strain of a laminate: each face has the stress of its own turned layer."""
    section, x = layered(LAYUP, orientation=SKEW[:, 0]), corners("quad")
    u = np.zeros((4, 6))
    u[:, :3] = np.outer((x[0] - x[0, 0]) @ SKEW[:, 0], SKEW[:, 0]) * 1e-3
    s = np.einsum("klid,d->kli", FAMILIES["quad"].stress(x, section)[0], u.ravel())
    for face, layer in ((0, LAYUP[0]), (1, LAYUP[2])):
        c, s_ = np.cos(layer.angle), np.sin(layer.angle)
        strain = 1e-3 * np.array([c * c, s_ * s_, -2 * c * s_])
        p, q, r = layer.material.plane_stress() @ strain
        Q = SKEW @ Rotation.from_rotvec([0, 0, layer.angle]).as_matrix()
        full = Q @ np.array([[p, r, 0], [r, q, 0], [0, 0, 0]]) @ Q.T
        wanted = full[[0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]]
        assert s[:, face] == pytest.approx(np.tile(wanted, (4, 1)), abs=1e-9 * np.abs(full).max())


def test_a_sheet_held_at_an_edge_stands():
    """Every dof of a shell has stiffness and mass: no drilling motion is free."""
    fe = model(sheet((2, 2)), shell(1e-3), STEEL)
    free = np.setdiff1d(np.arange(fe.numbering.n), held(fe, {"x0": range(6)}))
    assert np.linalg.eigvalsh(fe.K[free][:, free].toarray())[0] > 0
    assert np.linalg.eigvalsh(fe.M.toarray())[0] > 0
