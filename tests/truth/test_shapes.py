"""Bodies of simple shapes against closed forms: that the mesh of each shape is fit to compute with.

Sources: clamped circular plate, Leissa (1969), Vibration of Plates, NASA SP-160, table 2.1 (zeros
of J_n I_n+1 + I_n J_n+1, found here); bar and ring, Timoshenko, Young, Weaver (1974), Vibration
Problems in Engineering, 4th ed., sections 5.2 and 5.17.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from femeshes import held_frequencies
from scipy.optimize import brentq
from scipy.special import iv, jv

from flexmb.fe import assemble, resolve, section_from
from flexmb.fe.meshes.lattice import KINDS
from flexmb.fe.meshes.mesh_shapes import mesh_from

STEEL = resolve("steel")


def held(mesh, group, sections=None, count=3):
    """Lowest frequencies [rad/s] with all motions of a group held."""
    given = {key: section_from(words) for key, words in (sections or {}).items()}
    fe = assemble(mesh_from(mesh), STEEL, given)
    dofs = fe.numbering.table[fe.mesh.node_sets[group]]
    return held_frequencies(fe, np.unique(dofs[dofs >= 0]), count)


def clamped_disk(n):
    """First root of the clamped circular plate with n nodal diameters."""
    return brentq(lambda x: jv(n, x) * iv(n + 1, x) + iv(n, x) * jv(n + 1, x), 2 + n, 4 + 1.5 * n)


@pytest.mark.parametrize("kind", KINDS[2])
def test_clamped_disk_of_shells(kind):
    """To 1.2 %: the rim's polygon of 32 sides has 0.6 % less area, the elements err by as much."""
    assert clamped_disk(0) ** 2 == pytest.approx(10.2158, abs=1e-4)  # Leissa
    a, h = 1.0, 0.005
    found = held(
        {"type": "disk", "radius": a, "divisions": [8, 32], "elements": kind},
        "outer",
        {"all": {"type": "shell", "thickness": h}},
    )
    D = STEEL.E * h**3 / (12 * (1 - STEEL.nu**2))
    scale = math.sqrt(D / (STEEL.density * h)) / a**2
    wanted = [clamped_disk(n) ** 2 * scale for n in (0, 1, 1)]
    assert found == pytest.approx(wanted, rel=0.012)
    assert found[2] == pytest.approx(found[1], rel=1e-3)  # the pair of one nodal diameter


@pytest.mark.parametrize("kind", [kind for kind in KINDS[3] if kind not in ("tetra",)])
def test_torsion_of_a_tube_of_solids(kind):
    """A tube held at one end twists at pi/(2 L) sqrt(G/rho): exact for a circular section."""
    tube = {"type": "tube", "length": 1.0, "radius": 0.2, "inner": 0.1}
    found = held(tube | {"divisions": [1, 16, 8], "elements": kind}, "start", count=4)
    wanted = math.pi / 2 * math.sqrt(STEEL.G / STEEL.density)
    error = np.abs(found / wanted - 1).min()
    assert error < (0.02 if kind == "hexahedron" else 2e-3)


def test_longitudinal_waves_in_a_beam_along_a_polyline():
    """Straight legs in one line are one bar: pi/(2 L) sqrt(E/rho) fixed and free."""
    points = [[0, 0, 0], [1, 2, 2], [2, 4, 4]]
    beam = {"type": "beam", "points": points, "divisions": [20, 20]}
    stiff = {"type": "general", "A": 1e-4, "Iy": 1.0, "Iz": 1.0, "J": 1.0}
    found = held(beam, "start", {"leg1": stiff, "leg2": stiff})
    wanted = math.pi / (2 * 6.0) * math.sqrt(STEEL.E / STEEL.density)
    assert np.abs(found / wanted - 1).min() < 1e-3  # (k h)^2/24 = 6e-5
