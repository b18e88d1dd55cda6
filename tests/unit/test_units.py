"""Units and unit systems: labels mean what factors say, and numbers survive being written."""

from __future__ import annotations

import math
import random

import pytest

from flexmb.errors import FlexmbError
from flexmb.units import SI, UNIT_SYSTEMS, Dimension, parse_unit, percent, unit_system

QUANTITIES = (
    *("m", "kg", "s", "rad", "Hz", "m/s", "m/s^2", "rad/s", "N", "N m", "N/m", "N s/m", "Pa", "J"),
    *("W", "kg m^2", "kg/m^3", "m^2", "m^4", "N m/rad", "1/s", ""),
)
EXACT = 1e-13  # factors are rounded to fifteen digits


@pytest.mark.parametrize("system", UNIT_SYSTEMS.values(), ids=UNIT_SYSTEMS)
@pytest.mark.parametrize("unit", QUANTITIES)
def test_a_label_is_a_unit_of_the_size_that_is_scaled_by(system, unit):
    """So what is shown can be read: the symbols of each system are consistent."""
    for raised in (False, True):
        shown = parse_unit(system.label(unit, raised=raised))
        assert shown.dimension == parse_unit(unit).dimension
        assert shown.factor == pytest.approx(system.scale(unit), rel=EXACT)
    assert system.scale(unit) == pytest.approx(
        system.factor(*parse_unit(unit).dimension[:3]), rel=EXACT
    )


@pytest.mark.parametrize(
    ("text", "factor", "dimension"),
    [
        ("mm", 1e-3, Dimension(L=1)),
        ("rpm", math.pi / 30, Dimension(T=-1, angle=1)),
        ("rev/min", math.pi / 30, Dimension(T=-1, angle=1)),
        ("deg/s^2", math.pi / 180, Dimension(T=-2, angle=1)),
        ("GPa", 1e9, Dimension(-1, 1, -2)),
        ("N/mm²", 1e6, Dimension(-1, 1, -2)),
        ("kg m**2", 1.0, Dimension(L=2, M=1)),
        ("kg/m/s", 1.0, Dimension(-1, 1, -1)),
        ("N s/m", 1.0, Dimension(0, 1, -1)),
        ("g/cm^3", 1e3, Dimension(-3, 1)),
        ("1/s", 1.0, Dimension(T=-1)),
        ("m/s^-1", 1.0, Dimension(L=1, T=1)),
        ("psi", 6894.757293168361, Dimension(-1, 1, -2)),  # NIST SP 811
        ("lbf/in^2", 6894.757293168361, Dimension(-1, 1, -2)),
        ("slug", 14.59390293720636, Dimension(M=1)),  # NIST SP 811
    ],
)
def test_units_from_texts(text, factor, dimension):
    found = parse_unit(text)
    assert found.factor == pytest.approx(factor, rel=EXACT)
    assert found.dimension == dimension


@pytest.mark.parametrize("text", ["mmm", "m^", "/s", "m//s", "5 m", "m + s", "m s)", "kg m^2x"])
def test_what_is_no_unit(text):
    with pytest.raises(FlexmbError):
        parse_unit(text)


@pytest.mark.parametrize("system", UNIT_SYSTEMS.values(), ids=UNIT_SYSTEMS)
def test_numbers_written_are_read_again_to_the_last_bit(system):
    rng = random.Random(1)
    for unit in ("m", "N s/m", "kg/m^3", "Pa", "s"):
        scale = system.scale(unit)
        for _ in range(500):
            given = rng.choice([rng.uniform(-1e3, 1e3), round(rng.uniform(-100, 100), 3)])
            written = system.written(given * scale, unit)
            assert written * scale == given * scale
            assert written == pytest.approx(given, rel=1e-15)
    assert system.written(0.0, "m") == 0.0 and math.isinf(system.written(math.inf, "m"))


def test_si_changes_nothing():
    values = object()
    assert SI.outward(values, "N/m") is values
    assert SI.label("N s/m") == "N s/m" and SI.label("m/s^2", raised=True) == "m/s²"


def test_saying_a_value():
    assert unit_system("mm-t-s").say(0.03, "m") == "30 mm"
    assert unit_system("mm-kg-ms").say(0.0123456789, "s", 3) == "12.3 ms"
    assert SI.say(2.5, "") == "2.5"


@pytest.mark.parametrize("share", [0.994, 0.9951, 0.9999, 1.0, 1.004])
def test_shares_of_nearly_the_whole_are_no_powers_of_ten(share):
    assert percent(share) in ("99 %", "100 %")
