"""Frequencies of a reduced body with interfaces held: the beam's own, and the reduction's."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line

from flexmb.errors import ReductionError
from flexmb.fe import rectangle, reduce
from flexmb.flexbody.natural_modes import natural_frequencies

BETA = {  # (beta L)^2; Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1
    ("root",): (3.516015268500151, 22.03449156466677),
    ("root", "tip"): (22.37328544806132, 61.67282286792025),
    (): (22.37328544806132, 61.67282286792025),
}


@pytest.fixture(scope="module")
def beam():
    material = {"E": 200e9, "nu": 0.3, "density": 8000}
    section = {"all": rectangle(0.01, 0.0101, shear=False)}
    ends = {"root": "root", "tip": "tip"}
    return reduce(line(20), material=material, sections=section, interfaces=ends, modes=10)


@pytest.mark.parametrize("held", BETA)
def test_bending_frequencies_of_a_slender_beam(beam, held):
    """Rotary inertia lowers the second by (2.2 h/L)^2: 1e-3; two planes alternate."""
    EI_rhoA = 200e9 / 8000 * 0.01**2 / 12
    wanted = np.array(BETA[held]) * np.sqrt(EI_rhoA) / (2 * np.pi)
    found = natural_frequencies(beam, held)
    np.testing.assert_allclose(found[[0, 2]], wanted, rtol=1e-3)
    np.testing.assert_allclose(found[[1, 3]], 1.01 * found[[0, 2]], rtol=1e-3)


def test_holding_all_interfaces_gives_the_fixed_interface_modes(beam):
    """Six coordinates for each interface are taken away."""
    assert len(natural_frequencies(beam, ("root", "tip"))) == beam.m + 6 - 12


def test_an_unknown_interface_is_told(beam):
    with pytest.raises(ReductionError, match='no interface "tap".*nearest: tip'):
        natural_frequencies(beam, ("tap",))
