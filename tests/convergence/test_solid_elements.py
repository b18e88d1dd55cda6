"""Solid elements against closed forms: slopes on distorted meshes, bending, spinning."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import held_frequencies, slope, solid_box
from scipy.sparse.linalg import eigsh
from solidkit import clamped_block, held, nodal_stress, solve
from truthkit import reference

from flexmb.fe import SolidSection, assemble, geometric_stiffness, resolve
from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.fe.elements.solid_elements import Solid

STEEL = resolve("steel")
NO_POISSON = resolve({"E": 200e9, "nu": 0.0, "density": 8000})
SECOND_ORDER = ("tetra10", "hexahedron20", "hexahedron27", "wedge15")
pytestmark = pytest.mark.filterwarnings("ignore:.*first-order tetrahedra", "ignore:.*bulk modulus")


@pytest.mark.parametrize(
    ("kind", "order", "finest"),
    [
        ("tetra", 2, 9e-4),
        ("hexahedron", 2, 9e-4),
        ("tetra10", 4, 3e-7),
        ("hexahedron27", 4, 3e-7),
        # serendipity: not all quadratic fields on distorted elements, so between 2 and 4
        ("hexahedron20", 3, 4e-7),
        ("wedge15", 3, 4e-7),
    ],
)
def test_axial_frequency_converges_on_distorted_meshes(kind, order, finest):
    """Without Poisson's ratio u_x = sin(pi x/2L) is an exact three-dimensional mode.

    The finest errors are near those of undistorted meshes, (k h)^2/24 and (k h)^4/1440 for k h =
    pi/24: 7.1e-4 and 2.0e-7.
    """
    sizes, errors = (2, 4, 6), []
    for n in sizes:
        fe = assemble(solid_box(kind, (2 * n, n, n), (1, 0.5, 0.5), 0.2), NO_POISSON)
        table = fe.numbering.table
        fixed = np.concatenate([table[:, 1], table[:, 2], table[fe.mesh.node_sets["x0"], 0]])
        exact = np.pi / 2 * np.sqrt(NO_POISSON.E / NO_POISSON.density)
        errors.append(held_frequencies(fe, fixed, 1)[0] / exact - 1)
    assert -4.3 < slope(sizes, errors) < -order + 0.3
    assert 0 < errors[-1] < finest


@pytest.mark.parametrize("kind", SECOND_ORDER)
def test_a_mode_of_a_free_block_is_exact_for_any_poisson_ratio(kind):
    """Lame's mode: u = (cos x sin y, -sin x cos y, 0) with omega = pi sqrt(2 G/rho)/L.

    Second-order elements have an error of 2 per cent or less with four to the half wave.
    """
    fe = assemble(solid_box(kind, (4, 4, 2), (1, 1, 0.6), 0.2), STEEL)
    x, y, _ = (np.pi * fe.mesh.points).T
    u = np.stack([np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y), 0 * x], axis=1).ravel()
    exact = np.pi * np.sqrt(2 * STEEL.G / STEEL.density)
    values, V = eigsh(fe.K.tocsc(), 6, fe.M.tocsc(), sigma=exact**2)
    share = (V.T @ (fe.M @ u)) ** 2 / (u @ (fe.M @ u))
    assert share.max() > 0.98
    assert np.sqrt(values[share.argmax()]) == pytest.approx(exact, rel=3e-3)


@pytest.fixture(scope="module")
def cantilever():
    """Clamped block 10 x 1 x 1, by the method of Ritz: 1e-3 too high at most."""
    return clamped_block((10, 1, 1), (14, 5, 5), STEEL, 6)


@pytest.mark.parametrize(
    ("kind", "divisions", "bending", "torsion"),
    [
        ("hexahedron", (20, 2, 2), 0.015, 0.09),
        ("hexahedron", (40, 4, 4), 0.005, 0.03),
        ("tetra10", (20, 2, 2), 0.004, 0.02),
        ("hexahedron20", (20, 2, 2), 0.003, 0.01),
        ("hexahedron27", (20, 2, 2), 0.002, 0.01),
        ("wedge15", (20, 2, 2), 0.003, 0.01),
    ],
)
def test_cantilever_block(cantilever, kind, divisions, bending, torsion):
    """Two pairs of bending modes, torsion and tension; plain first order would be 2 to 40 % off."""
    fe = assemble(solid_box(kind, divisions, (10, 1, 1)), STEEL)
    errors = held_frequencies(fe, held(fe, ("x0", "xyz")), 6) / cantilever - 1
    assert (errors > -1e-3).all()
    assert (errors[:4] < bending).all()
    assert errors[4] < torsion
    assert errors[5] < 0.002


def test_incompatible_modes_bend_without_shear():
    """One row of elements under end load: 0.75 (1 - 1/4 n^2) + shear, against a locked element.

    A plain trilinear element of length a and height c bends stiffer by 1 + G (a/c)^2/E', that is
    by 1 + (a/c)^2/2 without Poisson's ratio: 3 times for a = 2 c.
    """
    mesh = solid_box("hexahedron", (5, 1, 1), (10, 1, 1))
    section = SolidSection(NO_POISSON)
    soft = FAMILIES["hexahedron"]
    words = ("kind", "about", "reference", "rule", "mass_rule", "stress_rule", "faces", "edges")
    plain = Solid(**{word: getattr(soft, word) for word in words})
    x = mesh.points[mesh.blocks["hexahedron"]][:1]
    u = np.zeros((8, 3))  # pure bending of the first element, 2 long
    u[:, 0] = (x[0, :, 0] - 1) * (x[0, :, 2] - 0.5)
    energy = [u.ravel() @ family.stiffness(x, section)[0] @ u.ravel() for family in (soft, plain)]
    exact = NO_POISSON.E * 2 / 12  # E I kappa^2 L with unit curvature
    assert energy[0] == pytest.approx(exact, rel=1e-12)
    assert energy[1] == pytest.approx(3 * exact, rel=1e-12)
    fe = assemble(mesh, NO_POISSON)
    tip, f = mesh.node_sets["x1"], np.zeros(fe.numbering.n)
    f[fe.numbering.table[tip, 2]] = 0.25
    found = solve(fe, f, held(fe, ("x0", "xyz")))[fe.numbering.table[tip, 2]].mean()
    # curvature is constant in each element: the deflection lacks 1/4n^2; shear angle 1/(G A)
    E, G = NO_POISSON.E, NO_POISSON.G
    wanted = 12 * 1000 / (3 * E) * (1 - 1 / (4 * 25)) + 10 / G
    assert found == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(
    ("kind", "divisions", "tolerance"),
    [
        ("hexahedron20", (50, 1, 1), 5e-5),
        ("hexahedron27", (50, 1, 1), 5e-5),
        ("hexahedron", (100, 1, 1), 3e-4),
        ("tetra10", (50, 1, 1), 3e-4),
        ("wedge15", (50, 1, 1), 3e-4),
    ],
)
def test_spinning_cantilever(kind, divisions, tolerance):
    """K + K_g - W^2 M_spin of a slender block (h/L = 0.01) that turns about z at the root.

    The block is real: shear and rotary inertia lower the frequencies at rest by 3e-5.
    """
    flap = reference("solids", "spinning_cantilever")["value"]
    h, matter = 0.01, NO_POISSON
    fe = assemble(
        solid_box(kind, divisions, (1, h, h), shape=lambda x: x - [0, h / 2, h / 2]), matter
    )
    unit = np.sqrt(matter.E * h**2 / 12 / matter.density)
    speed, level = 12 * unit, np.ones(fe.numbering.n)
    level[fe.numbering.table[:, 2]] = 0  # the centrifugal force has no part along the axis
    centrifugal = speed**2 * (fe.M * level[:, None] * level)
    fixed = held(fe, ("x0", "xyz"))
    free = np.setdiff1d(np.arange(fe.numbering.n), fixed)
    u = solve(fe, centrifugal @ fe.mesh.points[:, :3].ravel(), fixed)
    K = (fe.K + geometric_stiffness(fe, u) - centrifugal).tocsc()[free][:, free]
    values = eigsh(K, 2, fe.M.tocsc()[free][:, free], sigma=0, return_eigenvectors=False)
    found = np.sqrt(np.sort(values)) / unit
    np.testing.assert_allclose(found, [np.sqrt(flap**2 - 144), flap], rtol=tolerance)


@pytest.mark.parametrize(
    ("kind", "distort", "tolerance"),
    [
        ("hexahedron27", 0.0, 1e-5),
        ("hexahedron20", 0.0, 2e-4),
        ("wedge15", 0.0, 5e-4),
        ("hexahedron", 0.0, 2e-4),
        ("tetra10", 0.0, 1e-2),
        ("hexahedron27", 0.2, 2e-3),
        ("hexahedron20", 0.2, 2e-3),
        ("wedge15", 0.2, 2e-3),
        ("tetra10", 0.2, 1e-2),
        ("hexahedron", 0.2, 4e-2),
    ],
)
def test_bending_stress_of_a_cantilever(kind, distort, tolerance):
    """sigma = M c/I at a quarter of the length, away from both ends (Saint-Venant).

    Two elements over the height. Second-order tetrahedra keep linear stress less well than
    hexahedra (0.6 %); 4 elements leave a quarter of that.
    """
    fe = assemble(solid_box(kind, (20, 2, 2), (10, 1, 1), distort), STEEL)
    points, tip, f = fe.mesh.points, fe.mesh.node_sets["x1"], np.zeros(fe.numbering.n)
    f[fe.numbering.table[tip, 2]] = 1e3 / len(tip)
    stress = nodal_stress(fe, solve(fe, f, held(fe, ("x0", "xyz"))))
    top = (np.abs(points[:, 0] - 2.5) < 1e-9) & (np.abs(points[:, 2] - 1) < 1e-9)
    np.testing.assert_allclose(stress[top, 0], -1e3 * 7.5 * 0.5 * 12, rtol=tolerance)
