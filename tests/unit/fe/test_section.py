"""Sections of beams: closed forms and refused values."""

from __future__ import annotations

import math

import pytest

from flexmb.errors import ReductionError
from flexmb.fe import BeamSection, circle, rectangle, section_from, tube


def test_rectangle():
    s = rectangle(0.02, 0.03)
    assert s.A == pytest.approx(6e-4)
    assert s.Iy == pytest.approx(0.02 * 0.03**3 / 12)
    assert s.Iz == pytest.approx(0.03 * 0.02**3 / 12)
    assert s.ky == s.kz == 5 / 6


def test_torsion_constants():
    """Square 0.140577 a^4 and 2:1 rectangle 0.228682 a^4: Timoshenko and Goodier, section 109."""
    assert rectangle(1, 1).J == pytest.approx(0.140577, abs=1e-6)
    assert rectangle(2, 1).J == pytest.approx(2 * 0.228682, abs=2e-6)
    assert rectangle(1, 2).J == rectangle(2, 1).J
    assert circle(1).J == pytest.approx(math.pi / 2)


def test_shear_coefficients_of_round_sections():
    """Cowper (1966) at nu = 0: solid 6/7, thin-walled 1/2."""
    assert circle(1).ky == pytest.approx(6 / 7)
    assert tube(1, 0.9999).kz == pytest.approx(0.5, abs=1e-4)
    assert circle(1, shear=False).ky == math.inf


def test_from_plain_data():
    assert section_from({"type": "rectangle", "y": 0.1, "z": 0.2}) == rectangle(0.1, 0.2)
    oriented = section_from({"type": "rectangle", "y": 1, "z": 2, "orientation": [0, 1, 0]})
    assert oriented.orientation == (0, 1, 0)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"type": "rectangel", "y": 1, "z": 1}, 'unknown section "rectangel"; nearest: rectangle'),
        ({"type": "circle", "radus": 1}, "s.radus: unknown key; nearest: radius"),
        ({"type": "rectangle", "y": 1}, "s.z: is missing"),
        ({"type": "rectangle", "y": "wide", "z": 1}, "s.y: must be a number, given 'wide'"),
        ({"type": "rectangle", "y": 1, "z": -1}, "s.z: must be positive"),
        ({"type": "tube", "radius": 1, "inner": 1}, "s.inner: must lie between 0 and"),
    ],
)
def test_refused_data(given, sentence):
    with pytest.raises(ReductionError, match=sentence):
        section_from(given, "s")


def test_refused_values():
    with pytest.raises(ReductionError, match="section.Iy: must be positive"):
        BeamSection(1, -1, 1, 1)
    with pytest.raises(ReductionError, match="section.orientation: must be three numbers"):
        BeamSection(1, 1, 1, 1, orientation=(0, 0, 0))
