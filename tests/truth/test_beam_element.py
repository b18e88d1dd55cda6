"""Massless beams between bodies: cantilever, own finite element, Euler's column, vibration."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from scipy.optimize import brentq
from truthkit import order, stiffness_and_mass

from flexmb.fe import assemble, general, resolve
from flexmb.model import Model

E, G, A, IY, IZ, J, L = 70e9, 27e9, 4e-4, 2e-8, 5e-8, 6e-8, 0.8
SECTION = {"E": E, "G": G, "A": A, "Iy": IY, "Iz": IZ, "J": J, "orientation": "y"}


def cantilever(**section):
    made = Model("cantilever")
    made.add_body("tip", mass=1, inertia=[1, 1, 1], position=[L, 0, 0])
    made.add_force("beam", "beam", between=["ground", "tip"], **{**SECTION, **section})
    return made


def test_the_cantilever():
    """Force, moment, torque and pull at the tip (Timoshenko, Strength of Materials, 1955)."""
    K, _ = stiffness_and_mass(cantilever())
    F = np.linalg.inv(K)  # displacements (r, φ) by unit loads
    wanted = {
        (0, 0): L / (E * A), (3, 3): L / (G * J),
        (1, 1): L**3 / (3 * E * IZ), (5, 1): L**2 / (2 * E * IZ), (5, 5): L / (E * IZ),
        (2, 2): L**3 / (3 * E * IY), (4, 2): -(L**2) / (2 * E * IY), (4, 4): L / (E * IY),
    }  # fmt: skip
    for (i, j), value in wanted.items():
        assert F[i, j] == pytest.approx(value, rel=1e-8), (i, j)
    rest = F.copy()
    for i, j in wanted:
        rest[i, j] = rest[j, i] = 0.0
    assert np.abs(rest).max() < 1e-12 * np.abs(F).max()


def test_shear_adds_to_the_deflection():
    """F L / (k G A) in y and nothing in z, where no coefficient is given."""
    F = np.linalg.inv(stiffness_and_mass(cantilever(ky=0.5))[0])
    assert F[1, 1] == pytest.approx(L**3 / (3 * E * IZ) + L / (0.5 * G * A), rel=1e-8)
    assert F[2, 2] == pytest.approx(L**3 / (3 * E * IY), rel=1e-8)


def test_it_is_the_finite_element():
    """K of the far end of a skew beam, from the own beam element of the mesh half."""
    start, end, up = [0.1, -0.2, 0.3], [0.7, 0.5, 0.9], [0.1, 0.3, 1.0]
    section = {"A": A, "Iy": IY, "Iz": IZ, "J": J, "ky": 0.8, "kz": 0.7, "orientation": up}
    matter = {"E": E, "nu": 0.3, "density": 1.0}
    fe = assemble(line(1, start, end), resolve(matter), {"all": general(**section)})
    made = Model("skew")
    made.add_body("tip", mass=1, inertia=[1, 1, 1], position=end)
    made.add_marker("ground.root", position=start)
    made.add_force("beam", "beam", between=["ground.root", "tip"], material=matter, **section)
    wanted = fe.K.toarray()[6:, 6:]
    K, _ = stiffness_and_mass(made)
    np.testing.assert_allclose(K, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


def chain(n, load=0.0, slender=1e-5):
    """A cantilever of n beam elements with a node body at the end of each, a dead load at the tip.

    E = I = L = mass per length = 1; placed shortened by the load, which is then in equilibrium.
    """
    made = Model("column")
    area = 1.0 / slender
    h = 1.0 / n
    section = {"E": 1, "G": 1, "A": area, "Iy": 1, "Iz": 1, "J": 1, "length": h}
    before = "ground"
    for k in range(n):
        share = 0.5 if k == n - 1 else 1.0
        made.add_body(f"b{k}", mass=share * h, inertia=[1e-6] * 3,
                      position=[(k + 1) * h * (1.0 - load / area), 0, 0])  # fmt: skip
        made.add_force(f"beam{k}", "beam", between=[before, f"b{k}"], **section)
        before = f"b{k}"
    made.add_force("load", "force", at=before, value=[-load, 0, 0])
    return made


def test_eulers_column_buckles():
    """The least eigenvalue of the tangent stiffness passes zero at π²/4; the error is of order h².

    Euler 1744: P = π² E I / (4 L²) of a column fixed at its foot.
    """
    wanted, errors = np.pi**2 / 4.0, []
    for n in (4, 8):

        def least(load, n=n):
            return np.linalg.eigvals(stiffness_and_mass(chain(n, load))[0]).real.min()

        found = brentq(least, 0.9 * wanted, 1.1 * wanted, xtol=1e-4)
        errors.append(found / wanted - 1.0)
    assert errors[-1] < 0.02
    assert 1.9 < order([2.0, 1.0], errors) < 2.2


def test_the_vibrating_cantilever():
    """ω = 3.5160, 22.0345; lumped masses leave an error of order h².

    Blevins, Formulas for Natural Frequency and Mode Shape, 1979, table 8-1.
    """
    wanted, errors = np.array([1.87510407, 4.69409113]) ** 2, []
    for n in (5, 10, 20):
        K, M = stiffness_and_mass(chain(n))
        found = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)[[0, 2]])
        errors.append(np.abs(found / wanted - 1.0))
    assert np.all(errors[-1] < [2e-3, 1e-2])
    for k in range(2):
        assert 1.8 < order([4.0, 2.0, 1.0], [e[k] for e in errors]) < 2.2
