"""NAFEMS free-vibration tests of plates on distorted meshes.

The published targets of the rhombic plates are themselves coarse finite-element results: a Ritz
solution stands beside them.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import eigh
from shellkit import CLAMPED, KINDS, REFERENCE, SIMPLE, bending_frequencies, model, rectangle, sheet

from flexmb.fe.sections.shell_section import shell
from flexmb.materials import Material

MATERIAL = Material("NAFEMS", 200e9, 0.3, 8000.0)
SIDE, ANGLE = 10.0, np.pi / 4
TARGETS = REFERENCE["nafems"]


def rhombus(st):
    slant = np.array([[1.0, 0.0], [np.cos(ANGLE), np.sin(ANGLE)]]) * SIDE
    return np.pad(st @ slant, ((0, 0), (0, 1)))


def frequencies(n, kind, shape, h, supports, count):
    fe = model(sheet((n, n), kind, 0.25, shape), shell(h), MATERIAL)
    return bending_frequencies(fe, supports, count) / (2 * np.pi)


@cache
def ritz(h, n=14):
    """Frequencies [Hz] of the clamped rhombus by Mindlin's theory, kappa = 5/6: w, beta_x, beta_y
    each by n x n Legendre polynomials times (1 - s^2)(1 - t^2) in oblique coordinates s, t."""
    s, weight = legendre.leggauss(n + 6)
    P = legendre.legval(s, np.eye(n))
    slope = np.array([legendre.legval(s, legendre.legder(row)) for row in np.eye(n)])
    f, df = (1 - s**2) * P, (1 - s**2) * slope - 2 * s * P
    N, along, across = (
        np.einsum("ip,jq->ijpq", a, b).reshape(n * n, -1) for a, b in ((f, f), (df, f), (f, df))
    )
    Nx = along * 2 / SIDE
    Ny = (across * 2 / SIDE - np.cos(ANGLE) * Nx) / np.sin(ANGLE)
    area = np.outer(weight, weight).ravel() * SIDE**2 / 4 * np.sin(ANGLE)
    none = np.zeros_like(N)
    kx, ky, kxy = (np.vstack(rows) for rows in ((none, Nx, none), (none, none, Ny), (none, Ny, Nx)))
    gx, gy = np.vstack([Nx, N, none]), np.vstack([Ny, none, N])

    def product(a, b):
        return (a * area) @ b.T

    E, nu = MATERIAL.E, MATERIAL.nu
    K = product(kx, kx) + product(ky, ky) + nu * (product(kx, ky) + product(ky, kx))
    K = E * h**3 / 12 / (1 - nu**2) * (K + (1 - nu) / 2 * product(kxy, kxy))
    K += 5 / 6 * MATERIAL.G * h * (product(gx, gx) + product(gy, gy))
    M = MATERIAL.density * np.kron(np.diag([h, h**3 / 12, h**3 / 12]), product(N, N))
    return np.sqrt(eigh(K, M, eigvals_only=True)[:6]) / (2 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "test, h, edges",
    [("FV13", 0.05, SIMPLE), ("FV16", 0.05, {"x0": range(6)}), ("FV21", 1.0, SIMPLE)],
)
def test_square_plates(kind, test, h, edges):
    exact = np.array(TARGETS[test]["target"])
    found = frequencies(32, kind, rectangle(10.0, 10.0), h, edges, len(exact))
    assert np.abs(found / exact - 1).max() < 0.006


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("test, h", [("FV15", 0.05), ("FV22", 1.0)])
def test_rhombic_plates(kind, test, h):
    """Errors fall to a quarter from a mesh to one of half the size, towards the Ritz solution."""
    coarse, fine = (frequencies(n, kind, rhombus, h, CLAMPED, 6) / ritz(h) - 1 for n in (24, 48))
    assert np.abs(fine).max() < 0.01
    assert np.abs(fine).max() < 0.35 * np.abs(coarse).max()


@pytest.mark.slow
@pytest.mark.parametrize("test, h", [("FV15", 0.05), ("FV22", 1.0)])
def test_targets_of_rhombic_plates(test, h):
    """The Ritz solution has settled, and the published targets lie within 2.5 % of it."""
    assert np.abs(ritz(h, 11) / ritz(h) - 1).max() < 1e-3
    assert np.abs(np.array(TARGETS[test]["target"]) / ritz(h) - 1).max() < 0.025
