"""Kinetic energy from the inertia integrals equals the energy summed over the finite elements.

The body turns, translates and deforms at random. One route uses the reduced integrals; the other
integrates half the density times the squared velocity over every element, with shape functions and
Gauss points written here.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, line

from flexmb.fe import assemble, craig_bampton, make_interfaces, orthonormalise, rectangle, resolve
from flexmb.fe.reduction.reduced_basis import integrals

MATTER = resolve({"E": 1e9, "nu": 0.3, "density": 1500.0})


def cross_matrix(s):
    return np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])


def energy_from_integrals(found, r_dot, w, eta, eta_dot):
    """Half v^T M v with v = (r_dot, w, eta_dot) in body axes, by the second-moment form."""
    P, Mab = found.P, found.Mab
    S = found.S0 + (P + P.transpose(1, 0, 2)) @ eta + eta @ Mab @ eta
    J = np.trace(S) * np.eye(3) - S
    first = found.S1 + found.p @ eta
    coupling = np.stack(
        [P[a, b] - P[b, a] + eta @ (Mab[a, b] - Mab[b, a]) for a, b in ((1, 2), (2, 0), (0, 1))]
    )
    modal = np.einsum("bbij->ij", Mab)
    return (
        0.5 * found.mass * r_dot @ r_dot
        + 0.5 * w @ J @ w
        + 0.5 * eta_dot @ modal @ eta_dot
        + r_dot @ cross_matrix(w) @ first
        + r_dot @ found.p @ eta_dot
        + w @ coupling @ eta_dot
    )


def gauss(n):
    points, weights = np.polynomial.legendre.leggauss(n)
    return (points + 1) / 2, weights / 2


def tet_shapes(a, b, c):
    L = np.array([1 - a - b - c, a, b, c])
    corner = L * (2 * L - 1)
    pairs = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
    return np.array([*corner, *(4 * L[i] * L[j] for i, j in pairs)])


def energy_of_solid(fe, u, v, r_dot, w):
    """Gauss points of a cube folded onto straight tetrahedra: exact for these integrands."""
    total = 0.0
    x, weight = gauss(5)
    for tet in fe.mesh.blocks["tetra10"]:
        points = fe.mesh.points[tet]
        volume6 = abs(np.linalg.det(points[1:4] - points[0]))
        for i, j, k in np.ndindex(5, 5, 5):
            a, b, c = x[i], x[j] * (1 - x[i]), x[k] * (1 - x[i]) * (1 - x[j])
            jacobian = (1 - x[i]) ** 2 * (1 - x[j])
            N = tet_shapes(a, b, c)
            speed = r_dot + np.cross(w, N @ (points + u[tet])) + N @ v[tet]
            total += weight[i] * weight[j] * weight[k] * jacobian * volume6 * speed @ speed
    return 0.5 * fe.material.density * total


def beam_field(section, L, R, q, x, y, z):
    """Displacement of the point (x, y, z) of a Timoshenko beam element, body axes; q (12,)."""
    local = np.concatenate([R.T @ q[k : k + 3] for k in (0, 3, 6, 9)])
    u1, v1, w1, p1, b1, c1, u2, v2, w2, p2, b2, c2 = local
    t = x / L
    G = MATTER.E / 2.6

    def bending(d1, s1, d2, s2, inertia, k):
        Phi = 12 * MATTER.E * inertia / (k * G * section.A * L**2)
        g = Phi / (1 + Phi) * ((d2 - d1) / L - (s1 + s2) / 2)
        m1, m2 = s1 + g, s2 + g
        value = (1 - 3 * t**2 + 2 * t**3) * d1 + L * (t - 2 * t**2 + t**3) * m1
        value += (3 * t**2 - 2 * t**3) * d2 + L * (t**3 - t**2) * m2
        slope = (6 * t**2 - 6 * t) / L * (d1 - d2)
        slope += (1 - 4 * t + 3 * t**2) * m1 + (3 * t**2 - 2 * t) * m2
        return value, slope - g

    v, turn_z = bending(v1, c1, v2, c2, section.Iz, section.ky)
    w, minus_turn_y = bending(w1, -b1, w2, -b2, section.Iy, section.kz)
    u, p = (1 - t) * u1 + t * u2, (1 - t) * p1 + t * p2
    return R @ np.array([u - y * turn_z - z * minus_turn_y, v - z * p, w + y * p])


def energy_of_beam(fe, Phi_eta, Phi_eta_dot, r_dot, w, size):
    """Gauss points over the length and over the rectangular section."""
    total, (x, weight) = 0.0, gauss(6)
    half, section_weight = gauss(2)
    for a, b in fe.blocks[0].nodes:
        section = fe.blocks[0].section
        start, end = fe.mesh.points[a], fe.mesh.points[b]
        L = np.linalg.norm(end - start)
        ex = (end - start) / L
        ey = np.cross([0, 0, 1.0], ex)
        ey /= np.linalg.norm(ey)
        R = np.stack([ex, ey, np.cross(ex, ey)], axis=1)
        dofs = fe.numbering.table[[a, b]].ravel()
        for i, j, k in np.ndindex(6, 2, 2):
            y, z = (half[j] - 0.5) * size[0], (half[k] - 0.5) * size[1]
            place = start + R @ [x[i] * L, y, z]
            u, v = (
                beam_field(section, L, R, q[dofs], x[i] * L, y, z) for q in (Phi_eta, Phi_eta_dot)
            )
            speed = r_dot + np.cross(w, place + u) + v
            total += (
                weight[i] * section_weight[j] * section_weight[k] * L * section.A * speed @ speed
            )
    return 0.5 * fe.material.density * total


def reduced(fe, groups):
    modes = orthonormalise(fe, craig_bampton(fe, make_interfaces(fe, groups), 4))
    return modes.Phi, integrals(fe, modes.Phi)


@pytest.mark.parametrize("seed", range(3))
def test_energy_of_a_solid(seed):
    fe = assemble(block((2, 1, 1), (2, 1, 0.7), distort=0.2), MATTER)
    Phi, found = reduced(fe, {"a": "x0", "b": "x1"})
    random = np.random.default_rng(seed)
    r_dot, w = random.normal(size=(2, 3))
    eta, eta_dot = 5.0 * random.normal(size=(2, Phi.shape[1]))
    u, v = ((Phi @ part)[fe.numbering.table[:, :3]] for part in (eta, eta_dot))
    wanted = energy_of_solid(fe, u, v, r_dot, w)
    assert energy_from_integrals(found, r_dot, w, eta, eta_dot) == pytest.approx(wanted, rel=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_energy_of_a_skew_beam(seed):
    size = (0.2, 0.3)
    fe = assemble(line(3, (0.1, 0.2, 0.3), (1.1, 0.9, 0.8)), MATTER, {"all": rectangle(*size)})
    Phi, found = reduced(fe, {"a": "root", "b": "tip"})
    random = np.random.default_rng(seed)
    r_dot, w = random.normal(size=(2, 3))
    eta, eta_dot = random.normal(size=(2, Phi.shape[1]))
    wanted = energy_of_beam(fe, Phi @ eta, Phi @ eta_dot, r_dot, w, size)
    assert energy_from_integrals(found, r_dot, w, eta, eta_dot) == pytest.approx(wanted, rel=1e-11)


def test_energy_of_the_unreduced_model_is_its_mass_matrix():
    """The sum of the diagonal components is the mass matrix itself."""
    fe = assemble(line(3, (0, 0, 0), (1, 1, 1)), MATTER, {"all": rectangle(0.1, 0.2)})
    Mab = fe.reduced_mass(np.eye(fe.numbering.n))
    np.testing.assert_allclose(np.einsum("bbij->ij", Mab), fe.M.toarray(), atol=1e-14)


@pytest.mark.parametrize("kind", ["solid", "beam"])
def test_mean_axis_modes_have_no_linear_or_angular_momentum(kind):
    """p = 0 and P_ab = P_ba: what is left of the coupling is of second order."""
    if kind == "solid":
        fe, groups = assemble(block((2, 1, 1)), MATTER), {"a": "x0", "b": "x1"}
    else:
        fe = assemble(line(4, (0, 0, 0), (1, 1, 0)), MATTER, {"all": rectangle(0.1, 0.2)})
        groups = {"a": "root", "b": "tip"}
    _, found = reduced(fe, groups)
    assert np.abs(found.p).max() < 1e-10 * np.sqrt(found.mass)
    skewness = found.P - found.P.transpose(1, 0, 2)
    assert np.abs(skewness).max() < 1e-9 * np.abs(found.P).max()


@pytest.mark.parametrize("kind", ["solid", "beam"])
def test_first_moments_of_turns_are_second_moments_of_mass(kind):
    """P_ab = int rho s_a N_b of a turn about c through the centre: eps_bcd (S0 - S1 S1^T/m)_ad."""
    mesh = block((2, 1, 1), (2, 1, 0.7), distort=0.2) if kind == "solid" else line(3, (1, 0, 2))
    section = None if kind == "solid" else {"all": rectangle(0.2, 0.3)}
    fe = assemble(mesh, MATTER, section)
    inertia = fe.inertia
    S = inertia.S0 - np.outer(inertia.S1, inertia.S1) / inertia.mass
    turns = np.stack([cross_matrix(axis) for axis in np.eye(3)])  # [c, b, d]: (e_c x s)_b
    found = inertia.P @ fe.rigid[:, 3:]
    np.testing.assert_allclose(found, np.einsum("cbd,ad->abc", turns, S), atol=1e-11 * np.trace(S))
