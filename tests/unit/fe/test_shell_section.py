"""Sections of shells: closed forms of laminates and refused values."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.errors import ReductionError
from flexmb.fe.sections.shell_section import Layer, layered, shell
from flexmb.materials import LIBRARY, Material, OrthotropicMaterial

STEEL = Material("steel", 210e9, 0.3, 7850.0)
GRAPHITE = OrthotropicMaterial(
    "graphite", (25e9, 1e9, 1e9), (0.25, 0.25, 0.25), (0.5e9, 0.2e9, 0.5e9), 1500.0
)


def test_one_layer():
    h = 0.02
    found = shell(h, material=STEEL, nonstructural=5.0).laminate
    C = STEEL.plane_stress()
    assert found.ABD[:3, :3] == pytest.approx(C * h, rel=1e-14)
    assert found.ABD[3:, 3:] == pytest.approx(C * h**3 / 12, rel=1e-14)
    assert (found.ABD[:3, 3:] == 0).all()
    assert found.S == pytest.approx(5 / 6 * STEEL.G * h * np.eye(2), rel=1e-13)
    assert found.mass == pytest.approx([7850 * h + 5, 0.0, 7850 * h**3 / 12], rel=1e-14)


def test_unsymmetric_cross_ply():
    """Two plies 0/90: B11 = -B22 = (Q22 - Q11) h^2/8 and nothing else (Reddy, section 3.5)."""
    h = 0.004
    layers = [Layer(h / 2, GRAPHITE), Layer(h / 2, GRAPHITE, np.pi / 2)]
    ABD = layered(layers).laminate.ABD
    Q = GRAPHITE.plane_stress()
    B = np.zeros((3, 3))
    B[0, 0] = (Q[1, 1] - Q[0, 0]) * h**2 / 8
    B[1, 1] = -B[0, 0]
    assert ABD[:3, 3:] == pytest.approx(B, abs=1e-12 * abs(B[0, 0]))
    mean = (Q[0, 0] + Q[1, 1]) / 2
    assert ABD[0, 0] == pytest.approx(mean * h, rel=1e-13)
    assert ABD[4, 4] == pytest.approx(mean * h**3 / 12, rel=1e-13)
    assert ABD[0, 2] == pytest.approx(0.0, abs=1e-12 * mean * h)


def test_mass_of_layers_of_two_materials():
    """The heavier half on top: (rho_2 - rho_1) h^2/8 about the middle, the rest as of one layer."""
    h, light = 0.02, Material("light", 70e9, 0.3, 2700.0)
    mass = layered([Layer(h / 2, light), Layer(h / 2, STEEL)], nonstructural=5.0).laminate.mass
    mean = (2700 + 7850) / 2
    wanted = [mean * h + 5, (7850 - 2700) * h**2 / 8, mean * h**3 / 12]
    assert mass == pytest.approx(wanted, rel=1e-13)


def test_shear_stiffness_turns_with_a_layer():
    """S = k h R diag(G13, G23) R^T: a layer at 30 degrees shears more easily across its fibres."""
    h, angle = 0.004, np.pi / 6
    S = layered([Layer(h, GRAPHITE, angle)]).laminate.S
    c, s = np.cos(angle), np.sin(angle)
    wanted = np.array([[0.5 * c * c + 0.2 * s * s, 0.3 * c * s], [0.0, 0.5 * s * s + 0.2 * c * c]])
    wanted[1, 0] = wanted[0, 1]
    share = S / (1e9 * h * wanted)  # the corrections of both directions
    assert S[0, 1] > 0
    assert share[0, 1] ** 2 == pytest.approx(share[0, 0] * share[1, 1], rel=1e-12)


def test_angle_plies_couple_stretch_and_twist():
    """Plies at +45 and -45 degrees: B16 = B26 = -Q16(45) h^2/4, the other couplings vanish."""
    h, Q = 0.004, GRAPHITE.plane_stress()
    layers = [Layer(h / 2, GRAPHITE, np.pi / 4), Layer(h / 2, GRAPHITE, -np.pi / 4)]
    B = layered(layers).laminate.ABD[:3, 3:]
    Q16 = (Q[0, 0] - Q[1, 1]) / 4
    assert B[0, 2] == pytest.approx(-Q16 * h**2 / 4, rel=1e-12)
    assert B[1, 2] == pytest.approx(B[0, 2], rel=1e-12)
    assert np.abs(B[[0, 0, 1, 2], [0, 1, 1, 2]]).max() < 1e-12 * Q16 * h**2


def test_shear_correction_of_three_plies():
    """0/90/0 of equal plies, against the energy of the shear stress summed over thin slices."""
    t = 1e-3
    layers = [Layer(t, GRAPHITE), Layer(t, GRAPHITE, np.pi / 2), Layer(t, GRAPHITE)]
    S = layered(layers).laminate.S
    uncorrected = t * np.array([0.5 + 0.2 + 0.5, 0.2 + 0.5 + 0.2]) * 1e9
    z = (np.arange(60000) + 0.5) / 60000 * 3 * t - 1.5 * t
    inner = np.abs(z) < t / 2
    Q = GRAPHITE.plane_stress()
    for i, (C, G) in enumerate(
        ((np.where(inner, Q[1, 1], Q[0, 0]), np.where(inner, 0.2e9, 0.5e9)),
         (np.where(inner, Q[0, 0], Q[1, 1]), np.where(inner, 0.5e9, 0.2e9)))
    ):  # fmt: skip
        dz = z[1] - z[0]
        flow = np.cumsum(C * z) * dz
        k = (np.sum(C * z**2) * dz) ** 2 / (np.sum(flow**2 / G) * dz) / uncorrected[i]
        assert S[i, i] / uncorrected[i] == pytest.approx(k, rel=1e-3)  # of the midpoint rule


SOFT = Material("soft", 30e9, 0.0, 2000.0)
HARD = Material("hard", 210e9, 0.0, 7800.0)


def test_bending_about_the_neutral_axis():
    """A strip of two materials: sum of E (h^3/12 + h (z - z0)^2), z0 the mean of z by E h."""
    h = np.array([0.01, 0.004])
    z, E = np.array([-0.002, 0.005]), np.array([30e9, 210e9])
    z0 = (E * h) @ z / (E @ h)
    wanted = E @ (h**3 / 12 + h * (z - z0) ** 2)
    found = layered([Layer(h[0], SOFT), Layer(h[1], HARD)]).laminate.bending()
    np.testing.assert_allclose(np.diag(found)[:2], wanted, rtol=1e-12)


def test_shear_correction_of_two_materials():
    """Against the energy of the shear stress of the strip, whose neutral axis is off the middle."""
    h = np.array([0.01, 0.004])
    S = layered([Layer(h[0], SOFT), Layer(h[1], HARD)]).laminate.S
    z = (np.arange(70000) + 0.5) / 70000 * 0.014 - 0.007
    E = np.where(z < 0.003, 30e9, 210e9)
    G, dz = E / 2, z[1] - z[0]
    z0 = E @ z / E.sum()
    flow = np.cumsum(E * (z - z0)) * dz
    wanted = (E @ (z - z0) ** 2 * dz) ** 2 / (np.sum(flow**2 / G) * dz)
    assert S[0, 0] == pytest.approx(wanted, rel=1e-3)  # of the midpoint rule


def test_shear_stiffness_of_a_sandwich():
    """Thin stiff faces on a core that carries shear only: G d^2/c with d between the faces' middles
    (Allen, Analysis and Design of Structural Sandwich Panels, 1969, chapter 2)."""
    core = OrthotropicMaterial("core", (1e3,) * 3, (0.3,) * 3, (1e3, 40e6, 60e6), 50.0)
    f, c = 0.2e-3, 20e-3
    S = layered([Layer(f, STEEL), Layer(c, core), Layer(f, STEEL)]).laminate.S
    exact = np.array([60e6, 40e6]) * (c + f) ** 2 / c
    assert S.diagonal() == pytest.approx(exact, rel=1e-4)  # shear of the faces: G_core f/(G_face c)


def test_materials_are_filled_in():
    other = LIBRARY["aluminium"]
    filled = layered([Layer(1e-3), Layer(2e-3, other, 1.0)]).with_material(STEEL)
    assert [layer.material.name for layer in filled.layers] == ["steel", "aluminium"]
    own = shell(1e-3, material=other).with_material(STEEL)
    assert own.layers[0].material is other
    assert filled.thickness == 3e-3


@pytest.mark.parametrize(
    "words, told",
    [
        ({"thickness": 0.0}, r"section.thickness: must be positive, in m, given 0"),
        ({"thickness": float("nan")}, "section.thickness: must be positive"),
        ({"thickness": "2 mm"}, "section.thickness: must be positive, in m, given 2 mm"),
        ({"layers": []}, "section.layers: has no layers"),
        ({"layers": [Layer(1.0), Layer(-1.0)]}, r"layers\[1\].thickness: must be positive"),
        ({"layers": [Layer(1.0, None, float("inf"))]}, "angle: must be a number"),
        ({"thickness": 1.0, "offset": float("nan")}, "offset: must be a number"),
        ({"thickness": 1.0, "nonstructural": -1.0}, "nonstructural: must not be negative"),
        ({"thickness": 1.0, "orientation": (0, 0, 0)}, "three numbers, not all zero"),
        ({"thickness": 1.0, "orientation": ("x", 0, 1)}, "three numbers, not all zero"),
    ],
)
def test_impossible_sections_are_refused(words, told):
    with pytest.raises(ReductionError, match=told):
        (layered if "layers" in words else shell)(**words)


def test_all_mistakes_are_told_at_once():
    with pytest.raises(ReductionError) as caught:
        layered([Layer(0.0), Layer(-1.0)], nonstructural=-2.0)
    assert len(caught.value.problems) == 3


def test_a_layer_without_material_is_named():
    with pytest.raises(ReductionError, match=r"layers\[1\].material: is missing"):
        _ = layered([Layer(1.0, STEEL), Layer(1.0)]).laminate
