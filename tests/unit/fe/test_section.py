"""Sections of beams: closed forms and refused values."""

from __future__ import annotations

import math

import pytest

from flexmb.errors import FlexmbError, ReductionError
from flexmb.fe import (
    BeamSection,
    Layer,
    angle_section,
    box_section,
    circle,
    general,
    i_section,
    layered,
    rectangle,
    resolve,
    section_from,
    shell,
    tapered,
    tube,
)


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
        (
            {"type": "tube", "radius": 1, "inner": 1},
            "s.inner: must be less than the outer radius 1 m",
        ),
    ],
)
def test_refused_data(given, sentence):
    with pytest.raises(ReductionError, match=sentence):
        section_from(given, "s")


def test_a_section_in_python_takes_a_material_not_its_name():
    sentence = "section.material: expects a material, given 'steel'; .*resolve makes one"
    for make in (lambda m: rectangle(0.1, 0.1, material=m), lambda m: shell(0.1, material=m)):
        with pytest.raises(ReductionError, match=sentence):
            make("steel")
    with pytest.raises(ReductionError, match="layers.1..material: expects a material"):
        layered([Layer(0.1), Layer(0.2, {"E": 1e9})])


def test_refused_values():
    with pytest.raises(ReductionError, match="section.Iy: must be positive"):
        BeamSection(1, -1, 1, 1)
    with pytest.raises(ReductionError, match="section.orientation: must be three numbers"):
        BeamSection(1, 1, 1, 1, orientation=(0, 0, 0))


def test_tables_of_all_types():
    """A table says the same as the function of its type."""
    wide = {"type": "I", "height": 0.3, "width": 0.15, "web": 0.008, "flange": 0.012}
    assert section_from(wide) == i_section(0.3, 0.15, 0.008, 0.012)
    box = {"type": "box", "y": 0.1, "z": 0.2, "web": 0.004, "offset": [0.0, 0.1]}
    assert section_from(box) == box_section(0.1, 0.2, 0.004, offset=(0.0, 0.1))
    corner = {"type": "L", "y": 0.1, "z": 0.2, "web": 0.01, "nonstructural": 2.0}
    assert section_from(corner) == angle_section(0.1, 0.2, 0.01, nonstructural=2.0)
    cone = {
        "type": "tapered",
        "start": {"type": "circle", "radius": 0.2},
        "end": {"type": "circle", "radius": 0.1},
        "releases": {"start": ["ry", "rz"]},
        "material": "steel",
    }
    found = section_from(cone)
    assert found == tapered(
        circle(0.2), circle(0.1), releases={"start": ["ry", "rz"]}, material=resolve("steel")
    )
    assert found.at(0.5).A == pytest.approx(math.pi * 0.15**2)


def test_principal_axes_of_given_moments():
    """A rectangle b by h turned by 30 degrees has its own moments and that angle."""
    b, h, t = 0.02, 0.05, math.radians(30)
    Iy, Iz = b * h**3 / 12, h * b**3 / 12
    c, s = math.cos(t), math.sin(t)
    turned = general(
        b * h,
        Iy * c * c + Iz * s * s,
        Iy * s * s + Iz * c * c,
        1e-9,
        Iyz=s * c * (Iz - Iy),
        points={"corner": (c * b / 2 - s * h / 2, s * b / 2 + c * h / 2)},
    )
    assert (turned.Iy, turned.Iz, turned.angle) == pytest.approx((Iy, Iz, t))
    assert (turned.points[0].y, turned.points[0].z) == pytest.approx((b / 2, h / 2))


ROUND = {"type": "circle", "radius": 0.1}


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            {"type": "I", "height": 0.1, "width": 0.1, "web": 0.2, "flange": 0.06},
            "s.flange: the flanges must leave room.*\ns.web: must not exceed the width",
        ),
        ({"type": "box", "y": 0.1, "z": 0.1, "web": 0.05}, "s.web: must be less than half of 0.1"),
        ({"type": "L", "y": 0.1, "z": 0.1, "web": 0.2}, "s.web: must be less than 0.1 m"),
        (ROUND | {"offset": [1, 2, 3]}, "s.offset: must be two finite numbers"),
        (ROUND | {"offset": [0.0, float("nan")]}, "s.offset: must be two finite numbers"),
        (ROUND | {"nonstructural": -1}, "s.nonstructural: must not be negative"),
        (ROUND | {"ky": 0}, "s.ky: must be positive"),
        (ROUND | {"releases": {"start": ["rr"]}}, 's.releases.start: unknown "rr"'),
        (ROUND | {"releases": {"begin": ["rx"]}}, "s.releases.begin: unknown key"),
        (ROUND | {"material": "stel"}, 'unknown material "stel"; nearest: steel'),
        ({"type": "tapered", "start": ROUND}, "s.end: is missing"),
        ({"type": "tapered", "start": ROUND, "end": {"type": "crcle"}}, "s.end.type: unknown sect"),
        (
            {"type": "tapered", "start": ROUND, "end": ROUND | {"orientation": [1, 0, 0]}},
            "s.orientation: must be the same at both ends",
        ),
        (
            {"type": "tapered", "start": ROUND, "end": ROUND | {"releases": {"end": ["rx"]}}},
            "s.releases: belong to the tapered section as a whole",
        ),
        (
            {
                "type": "tapered",
                "start": {"type": "L", "y": 0.1, "z": 0.2, "web": 0.01},
                "end": {"type": "L", "y": 0.1, "z": 0.1, "web": 0.01},
            },
            "s: the principal axes must not turn along the beam",
        ),
        (3.0, "s: a table such as {type = ...} is expected, given 3.0"),
    ],
)
def test_refused_shapes(given, sentence):
    with pytest.raises(FlexmbError, match=sentence):
        section_from(given, "s")
