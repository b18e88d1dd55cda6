"""Plates against known frequencies, deflections and stresses, on distorted meshes.

Tolerances are the errors stated for these elements at the mesh used: they fall with its square.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import held_frequencies
from shellkit import (
    CLAMPED,
    KINDS,
    REFERENCE,
    SIMPLE,
    bending_frequencies,
    held,
    model,
    node_at,
    rectangle,
    sheet,
    static,
)

from flexmb.fe.sections.shell_section import Layer, layered, shell
from flexmb.materials import Material, OrthotropicMaterial

STEEL = Material("steel", 210e9, 0.3, 7850.0)
GRAPHITE = OrthotropicMaterial(
    "graphite", (40e9, 1e9, 1e9), (0.25, 0.25, 0.25), (0.6e9, 0.5e9, 0.6e9), 1500.0
)
DISTORT = 0.25
EDGES = {
    "SSSS": SIMPLE,
    "CCCC": CLAMPED,
    "CFFF": {"x0": range(6)},
    "CCFF": {"x0": range(6), "x1": range(6)},
    "CFCF": {"x0": range(6), "y0": range(6)},
}


def plate(n, kind, section, size=(1.0, 1.0), material=STEEL):
    return model(sheet((n, n), kind, DISTORT, rectangle(*size)), section, material)


def scale(h, material=STEEL):
    """omega a^2 sqrt(rho h/D) of a unit square is omega divided by this."""
    return h * np.sqrt(material.E / 12 / (1 - material.nu**2) / material.density)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("edges", ["CFFF", "CFCF", "CCFF", "SSSS", "CCCC"])
def test_thin_plates_do_not_lock(kind, edges):
    """h/a = 1e-3: shear and rotary inertia count 1e-6."""
    exact = np.array(REFERENCE["kirchhoff_square"]["values"][edges][:4])
    found = bending_frequencies(plate(12, kind, shell(1e-3)), EDGES[edges], 4) / scale(1e-3)
    limit = {"CFFF": 0.004, "CFCF": 0.01, "CCFF": 0.02, "SSSS": 0.025, "CCCC": 0.04}[edges]
    assert np.abs(found / exact - 1).max() < limit


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("edges", ["CFFF", "CFCF", "CCFF", "SSSS", "CCCC"])
def test_thin_plates_on_fine_meshes(kind, edges):
    exact = np.array(REFERENCE["kirchhoff_square"]["values"][edges][:5])
    found = bending_frequencies(plate(32, kind, shell(1e-3)), EDGES[edges], 5) / scale(1e-3)
    limit = {"CFFF": 6e-4, "CFCF": 3e-3, "CCFF": 3e-3, "SSSS": 3.5e-3, "CCCC": 6e-3}[edges]
    assert np.abs(found / exact - 1).max() < limit


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("edges, h", [("SSSS", "0.1"), ("SSSS", "0.2"), ("CFFF", "0.2")])
def test_thick_plates(kind, edges, h):
    exact = np.array(REFERENCE["mindlin_square"]["values"][h][edges][:4])
    fe = plate(12, kind, shell(float(h)))
    found = bending_frequencies(fe, EDGES[edges], 4) / scale(float(h))
    assert np.abs(found / exact - 1).max() < 0.015


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("edges", ["SSSS", "CCCC", "CFFF"])
@pytest.mark.parametrize("h", ["0.1", "0.2"])
def test_thick_plates_on_fine_meshes(kind, edges, h):
    exact = np.array(REFERENCE["mindlin_square"]["values"][h][edges])
    fe = plate(32, kind, shell(float(h)))
    found = bending_frequencies(fe, EDGES[edges], 5) / scale(float(h))
    assert np.abs(found / exact - 1).max() < 5e-3


def navier(n=101):
    """Deflection and moment at the centre of a simply supported square under pressure, in q a^4/D
    and q a^2, nu = 0.3: Navier's series (Timoshenko and Woinowsky-Krieger, section 30)."""
    odd = np.arange(1, n, 2)
    m, k = np.meshgrid(odd, odd)
    sign = (-1.0) ** ((m + k) / 2 - 1)
    w = 16 / np.pi**6 * np.sum(sign / (m * k * (m**2 + k**2) ** 2))
    M = 16 / np.pi**4 * np.sum(sign * (m**2 + 0.3 * k**2) / (m * k * (m**2 + k**2) ** 2))
    return w, M


@pytest.mark.parametrize("kind", KINDS)
def test_deflection_and_stress_under_pressure(kind):
    h, q, n = 1e-3, 1e3, 16
    fe = plate(n, kind, shell(h))
    u = static(fe, fe.inertia.p[2] * q / (STEEL.density * h), held(fe, SIMPLE))
    w, M = navier()
    D = STEEL.E * h**3 / 12 / (1 - STEEL.nu**2)
    middle = node_at(fe.mesh, [0.5, 0.5, 0.0])
    near = 2 * np.linalg.norm(fe.mesh.points[middle] - [0.5, 0.5, 0]) ** 2  # of a sine's crest
    assert u[middle, 2] == pytest.approx(w * q / D, rel=0.01 + 5 * near)
    (block,) = fe.blocks
    x = fe.mesh.points[block.nodes]
    rows = block.family.stress(x, block.section)
    s = np.einsum("eklid,ed->ekli", rows, u[block.nodes].reshape(len(x), -1))
    mean = s[block.nodes == middle].mean(axis=0)
    bent = 6 * M * q / h**2
    assert mean[1, :2] == pytest.approx([bent, bent], rel=0.02 + 5 * near)
    assert mean[0, :2] == pytest.approx(-mean[1, :2], rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_specially_orthotropic_plate(kind):
    """omega^2 = pi^4/(rho h) (D11 m^4/a^4 + 2 (D12 + 2 D66) m^2 n^2/(a b)^2 + D22 n^4/b^4)."""
    h, a, b = 1e-3, 1.0, 0.7
    fe = plate(14, kind, shell(h, material=GRAPHITE), (a, b))
    D = GRAPHITE.plane_stress() * h**3 / 12
    m, k = np.meshgrid(np.arange(1, 6), np.arange(1, 6))
    terms = D[0, 0] * (m / a) ** 4 + D[1, 1] * (k / b) ** 4
    terms = terms + 2 * (D[0, 1] + 2 * D[2, 2]) * (m * k / a / b) ** 2
    exact = np.sort(np.pi**2 * np.sqrt(terms / (GRAPHITE.density * h)).ravel())[:4]
    found = bending_frequencies(fe, SIMPLE, 4)
    assert np.abs(found / exact - 1).max() < 0.03


@pytest.mark.parametrize("kind", KINDS)
def test_turned_fibres_are_a_turned_plate(kind):
    """Fibres along y by orientation, by layer angle, and by turning the plate: the same plate."""
    h = 0.05
    along_y = shell(h, material=GRAPHITE, orientation=(0.0, 1.0, 0.0))
    by_angle = layered([Layer(h, GRAPHITE, np.pi / 2)])
    turned = sheet((6, 6), kind, DISTORT, lambda st: np.pad(st[:, ::-1], ((0, 0), (0, 1))))
    clamped = EDGES["CFFF"]
    first = bending_frequencies(plate(6, kind, along_y), clamped, 3)
    second = bending_frequencies(plate(6, kind, by_angle), clamped, 3)
    third = bending_frequencies(model(turned, shell(h), GRAPHITE), clamped, 3)
    assert second == pytest.approx(first, rel=1e-9)
    assert third == pytest.approx(first, rel=1e-9)


def cross_ply_frequency(C, rho, h, S):
    """Lowest frequency of a simply supported unit square of two plies 0/90, by Navier's solution of
    the shear deformation theory without in-plane and rotary inertia (Reddy, section 7.3)."""
    A, D = (C[0, 0] + C[1, 1]) / 2 * h, (C[0, 0] + C[1, 1]) / 2 * h**3 / 12
    A12, D12, A66, D66 = C[0, 1] * h, C[0, 1] * h**3 / 12, C[2, 2] * h, C[2, 2] * h**3 / 12
    B, p = (C[1, 1] - C[0, 0]) * h**2 / 8, np.pi
    K = np.zeros((5, 5))  # u cos sin, v sin cos, w sin sin, beta_x cos sin, beta_y sin cos
    K[0, 0] = K[1, 1] = (A + A66) * p**2
    K[0, 1] = K[1, 0] = (A12 + A66) * p**2
    K[0, 3] = K[3, 0] = B * p**2
    K[1, 4] = K[4, 1] = -B * p**2
    K[3, 3] = K[4, 4] = (D + D66) * p**2 + S
    K[3, 4] = K[4, 3] = (D12 + D66) * p**2
    K[2, 2] = 2 * S * p**2
    K[2, 3:] = K[3:, 2] = S * p
    rest = [0, 1, 3, 4]
    stiff = K[2, 2] - K[2, rest] @ np.linalg.solve(K[np.ix_(rest, rest)], K[rest, 2])
    return np.sqrt(stiff / (rho * h))


@pytest.mark.parametrize("kind", KINDS)
def test_unsymmetric_cross_ply_plate(kind):
    """Bending and membrane are coupled by two plies at 0 and 90 degrees, h/a = 0.01."""
    h = 0.01
    section = layered([Layer(h / 2, GRAPHITE), Layer(h / 2, GRAPHITE, np.pi / 2)])
    S = section.laminate.S
    assert S[0, 0] == pytest.approx(S[1, 1], rel=1e-12)
    exact = cross_ply_frequency(GRAPHITE.plane_stress(), GRAPHITE.density, h, S[0, 0])
    fe = plate(14, kind, section)
    free_membrane = {"x0": (1, 2, 3), "x1": (1, 2, 3), "y0": (0, 2, 4), "y1": (0, 2, 4)}
    found = held_frequencies(fe, held(fe, free_membrane), 1)
    assert found == pytest.approx([exact], rel=0.01)
