"""Stress at nodes from displacements: patches, bending, folds, sections side by side, beams."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, line, solid_box
from scipy.sparse.linalg import spsolve

from flexmb.errors import ReductionError
from flexmb.fe import Mesh, assemble, part, rectangle, reduce, resolve
from flexmb.fe import stress as recovery
from flexmb.fe.elements.element_blocks import skin_triangles
from flexmb.fe.recovery import _turned
from flexmb.fe.sections.section_tables import SolidSection
from flexmb.fe.sections.shell_section import shell
from flexmb.fe.stress import section_force_modes, stress_modes, stress_option
from flexmb.flexbody import von_mises
from flexmb.flexbody.stress_modes import principal_stresses

STEEL, ALUMINIUM = resolve("steel"), resolve("aluminium")
H = np.array([[2.0, 0.3, -0.7], [0.4, -1.0, 0.2], [0.1, 0.5, 1.5]]) * 1e-4  # displacement gradient
STRAIN = np.array(
    [H[0, 0], H[1, 1], H[2, 2], H[1, 2] + H[2, 1], H[2, 0] + H[0, 2], H[0, 1] + H[1, 0]]
)
SINGLE = 1e-6  # single precision: 6e-8, and the sums of a few terms


def displaced(fe, u, turn=None):
    """(n, 1) degrees of freedom from displacements (nodes, 3) and rotations (nodes, 3)."""
    U, table = np.zeros((fe.numbering.n_all, 1)), fe.numbering.table
    for values, columns in ((u, slice(0, 3)), (turn, slice(3, 6))):
        if values is not None:
            has = table[:, columns] >= 0
            U[table[:, columns][has], 0] = values[has]
    return U[: fe.numbering.n]


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron20", "wedge15"])
def test_a_uniform_strain_gives_its_stress_at_every_node(kind):
    """Hooke's law by hand; every family holds a linear displacement exactly, also distorted."""
    fe = assemble(solid_box(kind, (2, 2, 2), distort=0.2), STEEL)
    found = stress_modes(fe, displaced(fe, fe.mesh.points @ H.T))
    G, lam = STEEL.G, STEEL.E * STEEL.nu / ((1 + STEEL.nu) * (1 - 2 * STEEL.nu))
    wanted = np.concatenate([2 * G * STRAIN[:3] + lam * STRAIN[:3].sum(), G * STRAIN[3:]])
    np.testing.assert_allclose(
        found.modes[:, :, 0], np.tile(wanted, (len(found.ids), 1)), atol=SINGLE * wanted.max()
    )
    np.testing.assert_array_equal(found.ids, fe.numbering.nodes)
    assert found.layers == ("solid",)


def halves():
    """A box whose halves are groups of their own."""
    box = block((2, 1, 1), (2.0, 1.0, 1.0))
    left = box.points[box.blocks["tetra10"]].mean(axis=1)[:, 0] < 1
    sets = {"left": {"tetra10": np.flatnonzero(left)}, "right": {"tetra10": np.flatnonzero(~left)}}
    return Mesh(box.points, box.blocks, {}, sets)


def test_sections_side_by_side_keep_their_own_stress():
    sections = {"left": SolidSection(STEEL), "right": SolidSection(ALUMINIUM)}
    fe = assemble(halves(), STEEL, sections)
    u = np.zeros_like(fe.mesh.points)
    u[:, 1] = 1e-3 * fe.mesh.points[:, 0]  # shear of 1e-3
    found = stress_modes(fe, displaced(fe, u))
    middle = np.flatnonzero(fe.mesh.points[:, 0] == 1.0)
    for node in middle:
        rows = found.rows(node=int(node))
        told = {found.parts[found.part[k]]: found.modes[k, 5, 0] for k in rows}
        assert told == pytest.approx(
            {"left": 1e-3 * STEEL.G, "right": 1e-3 * ALUMINIUM.G}, rel=SINGLE
        )


def test_the_skin_alone_has_the_stress_of_all_nodes(monkeypatch):
    fe = assemble(block((3, 3, 2), distort=0.1), STEEL)
    Phi = np.random.default_rng(1).normal(size=(fe.numbering.n, 3))
    whole = stress_modes(fe, Phi)
    skin = np.unique(skin_triangles(fe.blocks, fe.mesh.points))
    monkeypatch.setattr(recovery, "_CHUNK", 1)  # one element at a time
    part = stress_modes(fe, Phi, skin)
    assert len(skin) < len(fe.mesh.points)
    np.testing.assert_array_equal(part.ids, skin)
    rows = np.searchsorted(whole.ids, skin)
    largest = np.abs(whole.modes).max()
    np.testing.assert_allclose(part.modes, whole.modes[rows], atol=SINGLE * largest)


def plate(fold=0.0):
    """Two by one square metres of quads in the xy plane, its right half turned up by ``fold``."""
    grid = np.indices((5, 3)).reshape(2, -1).T * 0.5
    x = np.minimum(grid[:, 0], 1.0) + np.cos(fold) * np.maximum(grid[:, 0] - 1.0, 0.0)
    z = np.sin(fold) * np.maximum(grid[:, 0] - 1.0, 0.0)
    points = np.stack([x, grid[:, 1], z], axis=1)
    quads = [
        [3 * i + j, 3 * i + j + 3, 3 * i + j + 4, 3 * i + j + 1] for i in range(4) for j in (0, 1)
    ]
    return Mesh(points, {"quad": np.array(quads)})


def test_a_bent_plate_has_opposite_stress_at_top_and_bottom():
    """Cylindrical bending w = -k x^2/2: sigma_xx = E z k/(1 - nu^2), sigma_yy = nu sigma_xx."""
    k, h = 0.01, 0.02
    fe = assemble(plate(), STEEL, {"all": shell(h)})
    x = fe.mesh.points[:, 0]
    u, turn = np.zeros((len(x), 3)), np.zeros((len(x), 3))
    u[:, 2], turn[:, 1] = -k * x**2 / 2, k * x  # theta_y = -dw/dx
    found = stress_modes(fe, displaced(fe, u, turn))
    xx = STEEL.E * k * h / 2 / (1 - STEEL.nu**2)
    for layer, sign in (("top", 1), ("bottom", -1)):
        values = found.modes[found.rows(layer=layer), :, 0]
        wanted = np.tile(sign * xx * np.array([1, STEEL.nu, 0, 0, 0, 0]), (len(values), 1))
        np.testing.assert_allclose(values, wanted, atol=1e-5 * xx)


@pytest.mark.parametrize(("degrees", "places"), [(20.0, 2), (90.0, 4)])
def test_a_fold_parts_top_from_top(degrees, places):
    """A coarse curved shell goes on; over a right angle each wall has its own stress."""
    fe = assemble(plate(np.radians(degrees)), STEEL, {"all": shell(0.01)})
    found = stress_modes(fe, np.ones((fe.numbering.n, 1)))
    on_fold = np.flatnonzero(fe.mesh.points[:, 0] == 1.0)[0]
    assert len(found.rows(node=int(on_fold))) == places
    assert set(found.layers) == {"bottom", "top"}


def test_shells_with_opposite_normals_are_not_averaged():
    flat = plate()
    quads = flat.blocks["quad"].copy()
    quads[4:] = quads[4:, ::-1]
    fe = assemble(Mesh(flat.points, {"quad": quads}), STEEL, {"all": shell(0.01)})
    found = stress_modes(fe, np.ones((fe.numbering.n, 1)))
    assert len(found.rows(node=7)) == 4


@pytest.fixture(scope="module")
def cantilever():
    """A steel beam along the y axis, 2 m, held at its root, with a force at its tip."""
    section = rectangle(0.02, 0.03, shear=False)
    fe = assemble(line(4, end=(0.0, 2.0, 0.0)), STEEL, {"all": section})
    force = np.array([30.0, 500.0, 100.0])
    f = np.zeros(fe.numbering.n)
    f[fe.numbering.table[4, :3]] = force
    free = fe.numbering.table[1:].ravel()
    U = np.zeros((fe.numbering.n, 1))
    U[free, 0] = spsolve(fe.K.tocsc()[free][:, free], f[free])
    return fe, U, force


def test_section_forces_of_a_cantilever_by_statics(cantilever):
    """N = Fy along the beam; V = F; M = F times the distance to the tip; no torque."""
    fe, U, force = cantilever
    found = section_force_modes(fe, U)
    axes = found.axes[0]
    np.testing.assert_allclose(axes[:, 0], [0, 1, 0], atol=1e-15)
    local = axes.T @ force
    for k in range(4):
        for end in (0, 1):
            arm = 2.0 - 0.5 * (k + end)
            moment = axes.T @ np.cross([0.0, arm, 0.0], force)
            np.testing.assert_allclose(found.ends[k, end, :3, 0], local, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(found.ends[k, end, 3:, 0], moment, rtol=1e-6, atol=1e-6)


def test_stress_points_of_a_cantilever_by_hand(cantilever):
    """sigma = N/A + My z/Iy - Mz y/Iz along the beam, in body axes its yy component."""
    fe, U, _ = cantilever
    forces, found = section_force_modes(fe, U), stress_modes(fe, U)
    N, _, _, _, My, Mz = forces.ends[0, 0, :, 0]
    for a, y in (("+", 0.01), ("-", -0.01)):
        for b, z in (("+", 0.015), ("-", -0.015)):
            (row,) = found.rows(node=0, layer=f"{a}y{b}z")
            wanted = N / 6e-4 + My * z / (0.02 * 0.03**3 / 12) - Mz * y / (0.03 * 0.02**3 / 12)
            assert found.modes[row, 1, 0] == pytest.approx(wanted, rel=1e-5)
            assert abs(found.modes[row, [0, 2, 4], 0]).max() < 1e-5 * abs(wanted)


def test_von_mises_of_known_states():
    """Uniaxial: itself; hydrostatic: 0; pure shear: sqrt(3) of it (Timoshenko)."""
    states = np.array(
        [[7.0, 0, 0, 0, 0, 0], [5, 5, 5, 0, 0, 0], [0, 0, 0, 2, 0, 0], [3, -3, 0, 0, 0, 0]]
    )
    np.testing.assert_allclose(von_mises(states), [7, 0, 2 * 3**0.5, 3 * 3**0.5], atol=1e-12)


def test_a_reduced_body_has_the_stress_of_its_modes():
    """Clamped-free bar stretched at its end: the interface's unit motion gives E/L everywhere."""
    box = block((4, 1, 1), (1.0, 0.1, 0.1))
    loose = {"E": 1e9, "nu": 0.0, "density": 1000.0}  # no lateral contraction: the ends stay plane
    body = reduce(box, material=loose, interfaces={"a": "x0", "b": "x1"}, modes=0)
    q = np.concatenate([np.concatenate([part.Phi_t, part.Phi_r]) for part in body.interfaces])
    stretch = np.zeros(12)
    stretch[[0, 6]] = -0.5e-3, 0.5e-3
    eta = np.linalg.lstsq(q, stretch, rcond=None)[0]
    np.testing.assert_allclose(q @ eta, stretch, atol=1e-9)
    stress = body.stress.at(eta)
    np.testing.assert_allclose(stress[:, 0], 1e6, rtol=1e-4)
    np.testing.assert_allclose(von_mises(stress), 1e6, rtol=1e-4)
    np.testing.assert_array_equal(np.unique(body.stress.ids), np.unique(body.surface.node_ids))


def test_stress_can_be_left_out_and_mistakes_are_told():
    box = block((2, 1, 1))
    assert reduce(box, material="steel", modes=2, stress=False).stress is None
    assert stress_option(True) == "surface"
    with pytest.raises(ReductionError, match='unknown "surfase"; nearest: surface'):
        reduce(box, material="steel", modes=2, stress="surfase")


def test_principal_stresses_are_those_of_the_tensor():
    """Components in the order xx, yy, zz, yz, zx, xy."""
    xx, yy, zz, yz, zx, xy = stress = np.random.default_rng(6).normal(size=6)
    tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    wanted = np.linalg.eigvalsh(tensor)[::-1]
    np.testing.assert_allclose(principal_stresses(stress), wanted, rtol=1e-12)


def test_resultants_turn_as_a_tensor():
    """N' = R' N R in axes turned about the normal, the moments alike."""
    angle, N = 0.4, np.array([[3.0, 1.5], [1.5, -2.0]])
    c, s = np.cos(angle), np.sin(angle)
    axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    R = axes[:2, :2]
    turned = R.T @ N @ R
    values = np.array([N[0, 0], N[1, 1], N[0, 1]] * 2)[None, None, :, None]
    found = _turned(values, np.eye(3)[None], axes[None, None])[0, 0, :, 0]
    np.testing.assert_allclose(found, [turned[0, 0], turned[1, 1], turned[0, 1]] * 2, rtol=1e-12)


@pytest.mark.parametrize("orientation", [None, (1.0, 0.0, 0.0)])
def test_a_bent_arch_carries_one_moment_wherever_its_normal_points(orientation):
    """Half a ring round z under a moment at its free edge: M along the arch, nothing across."""
    n, width, moment = 24, 0.05, 0.3
    angle = np.repeat(np.pi / n * np.arange(n + 1), 2)
    points = np.stack([np.cos(angle), np.sin(angle), np.tile([0.0, width], n + 1)], axis=1)
    quads = 2 * np.arange(n)[:, None] + [0, 2, 3, 1]
    ends = {"root": np.array([0, 1]), "tip": np.array([2 * n, 2 * n + 1])}
    arch = part(
        Mesh(points, {"quad": quads}, ends),
        material={"E": 70e9, "nu": 0.0, "density": 2700.0},
        sections={"all": shell(2e-3, orientation=orientation)},
        supports={"root": {"group": "root", "type": "clamped"}},
        loads={"turn": {"type": "force", "group": "tip", "moment": [0.0, 0.0, moment]}},
    )
    along = [arch.quantity(f"shell_force.{node}.Mx") for node in range(2 * n + 2)]
    others = [
        arch.quantity(f"shell_force.{node}.{name}")
        for node in range(2 * n + 2)
        for name in ("My", "Mxy")
    ]
    np.testing.assert_allclose(np.abs(along), moment / width, rtol=5e-3)
    np.testing.assert_allclose(others, 0.0, atol=5e-3 * moment / width)
