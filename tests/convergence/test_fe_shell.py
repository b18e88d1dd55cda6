"""Frequencies of plates and membranes on distorted meshes converge at order two in element size."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import held_frequencies, slope
from shellkit import KINDS, REFERENCE, SIMPLE, bending_frequencies, held, model, sheet

from flexmb.fe.sections.shell_section import shell
from flexmb.materials import Material

STEEL = Material("steel", 210e9, 0.3, 7850.0)
SIZES = (8, 12, 18)
ORDER = -1.7  # two, less the scatter of random meshes


def plate(n, kind, h, material=STEEL):
    return model(sheet((n, n), kind, 0.25), shell(h), material)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("h", [1e-3, 0.1])
def test_bending(kind, h):
    """Kirchhoff where thin, Mindlin where thick: the rate does not depend on the thickness."""
    references = REFERENCE["mindlin_square"]["values"]["0.1"]
    exact = (
        references["SSSS"][:2] if h == 0.1 else REFERENCE["kirchhoff_square"]["values"]["SSSS"][:2]
    )
    unit = h * np.sqrt(STEEL.E / 12 / (1 - STEEL.nu**2) / STEEL.density)
    errors = [bending_frequencies(plate(n, kind, h), SIMPLE, 2) / unit / exact - 1 for n in SIZES]
    for error in np.transpose(errors):
        assert slope(SIZES, error) < ORDER
    assert np.abs(errors[-1]).max() < 6e-3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("moving", [0, 1])
def test_waves_in_the_plane(kind, moving):
    """Quarter waves of stretch and of shear from the held edge to the free one, nu = 0."""
    material = Material("no contraction", 210e9, 0.0, 7850.0)
    modulus = material.E if moving == 0 else material.G
    exact = np.pi / 2 * np.sqrt(modulus / material.density)
    still = 1 - moving
    errors = []
    for n in SIZES:
        fe = plate(n, kind, 0.1, material)
        out = fe.numbering.table[:, [2, 3, 4, still]].ravel()
        root = held(fe, {"x0": (0, 1)})
        errors.append(held_frequencies(fe, np.union1d(out, root), 1)[0] / exact - 1)
    assert slope(SIZES, np.array(errors)) < ORDER
    assert abs(errors[-1]) < 2e-3
