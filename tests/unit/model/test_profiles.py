"""Motion profiles: values at their ends, areas, peak factors of the literature, derivatives."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from enginekit import curvature, slope
from scipy.integrate import quad

from flexmb.errors import SceneError
from flexmb.model.functions.function import FUNCTION_FORMS, read_function
from flexmb.model.reading import ReadContext
from flexmb.units import unit_system

RISES = ("step", "step5", "havsin", "cycloidal", "modified-sine")
POINTS = [[0, 1], [0.7, 3], [1.6, 2], [2.9, 2.5], [4, 1]]
SMOOTH = {  # one of every form, smooth near the times below
    "constant": {"value": 3},
    "polynomial": {"coefficients": [1, 2, -1, 0.5]},
    "harmonic": {"amplitude": 2, "frequency": 0.4, "phase": 1, "offset": 1},
    "fourier": {"frequency": 0.3, "cosine": [1, 0.2], "sine": [0.4, 0.3, 0.2], "phase": 0.5},
    "trapezoidal": {"t0": 0.1, "y1": 3, "t1": 3.7, "ramp": 1.0},
    "spline": {"points": POINTS},
    "akima": {"points": POINTS},
    "table": {"points": POINTS},
} | {name: {"t0": 0.1, "y0": 2, "t1": 3.7, "y1": -1} for name in RISES}
TIMES = (0.35, 1.2, 2.2, 3.1)


def form(name):
    return read_function({"type": name, **SMOOTH[name]})


def test_every_form_is_tried():
    assert set(SMOOTH) == set(FUNCTION_FORMS)


@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_are_those_of_the_values(name):
    function = form(name)
    for t in TIMES:
        value = lambda s, t=t: function.value(t + s)[0]  # noqa: E731
        rate = lambda s, t=t: function.value(t + s)[1]  # noqa: E731
        _, first, second = function.value(t)
        assert first == pytest.approx(slope(value), abs=1e-10)
        assert second == pytest.approx(slope(rate), abs=1e-10)
        assert second == pytest.approx(curvature(value), abs=1e-8)


@pytest.mark.parametrize("name", RISES)
def test_rises_begin_and_end_at_rest(name):
    function = form(name)
    for t, wanted in ((0.1, 2.0), (3.7, -1.0), (-5.0, 2.0), (9.0, -1.0)):
        assert function.value(t) == (wanted, 0.0, 0.0)
    near = 1e-7  # what a smooth start does within it, of order near² and near
    for t, wanted in ((0.1 + near, 2.0), (3.7 - near, -1.0)):
        assert function.value(t)[:2] == pytest.approx((wanted, 0.0), abs=1e-6)
    middle = function.value(1.9)
    assert middle[0] == pytest.approx(0.5) and middle[2] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "speed", "acceleration", "first"),
    [
        ("step", 3 / 2, 6.0, 6.0),
        ("step5", 15 / 8, 10 / np.sqrt(3), 0.0),
        ("havsin", np.pi / 2, np.pi**2 / 2, np.pi**2 / 2),
        ("cycloidal", 2.0, 2 * np.pi, 0.0),
        ("modified-sine", 4 * np.pi / (4 + np.pi), 4 * np.pi**2 / (4 + np.pi), 0.0),
    ],
)
def test_peaks_in_closed_form(name, speed, acceleration, first):
    """Maxima of the formulas, found by hand; the acceleration just after the start."""
    function = read_function({"type": name, "t1": 1, "y1": 1})
    jets = np.array([function.value(t) for t in np.linspace(0.0, 1.0, 1001)[1:-1]])
    assert jets[:, 1].max() == pytest.approx(speed, rel=1e-5)
    # 1000 samples miss a peak by (1/2000)² of its curvature, a start by its slope (70) over 1000
    assert jets[:, 2].max() == pytest.approx(acceleration, rel=3e-3)
    assert jets[0, 2] == pytest.approx(first, abs=8e-2)


def test_the_modified_sine_has_the_factors_of_the_literature():
    given = json.loads((Path(__file__).parents[2] / "references" / "cam_curves.json").read_text())
    wanted = given["modified-sine"]
    function = read_function({"type": "modified-sine", "t1": 1, "y1": 1})
    jets = np.array([function.value(t) for t in np.linspace(0.0, 1.0, 1001)[1:-1]])
    last_digit = 0.01  # some of them are rounded, some cut
    assert jets[:, 1].max() == pytest.approx(wanted["velocity"], abs=last_digit)
    assert jets[:, 2].max() == pytest.approx(wanted["acceleration"], abs=last_digit)
    jerk = lambda t: slope(lambda s: function.value(t + s)[2], 1e-5)  # noqa: E731
    assert jerk(1e-4) == pytest.approx(wanted["jerk"], abs=last_digit)
    assert jerk(0.5) == pytest.approx(wanted["jerk_at_crossover"], abs=last_digit)


@pytest.mark.parametrize(
    ("fields", "length", "top"),
    [
        ({"t1": 3.5, "y1": 2}, 3.0, 1.0),
        ({"t1": 3.5, "ramp": 1.5, "y1": 2}, 3.0, 4 / 3),
        ({"t1": 3.5, "ramp": 0.5, "y1": -2}, 3.0, -0.8),
        ({"speed": 1.0, "acceleration": 4.0, "y1": 2}, 2.25, 1.0),
        ({"speed": 5.0, "acceleration": 2.0, "y1": -2}, 2.0, -2.0),  # the speed is not reached
        ({"speed": 1.0, "acceleration": 1.0, "y1": 0.64}, 1.6, 0.8),  # almost
    ],
)
def test_trapezoids_cover_their_way_in_their_time(fields, length, top):
    function = read_function({"type": "trapezoidal", "t0": 0.5, **fields})
    jumps = function.derivative_jumps(4.0)
    way, _ = quad(lambda t: function.value(t)[1], 0.0, 4.0, points=jumps, limit=200)
    assert way == pytest.approx(fields["y1"], rel=1e-12)
    assert function.value(0.5 + length) == pytest.approx((fields["y1"], 0, 0), abs=1e-12)
    assert function.value(0.5 + 0.5 * length)[1] == pytest.approx(top, rel=1e-12)
    assert function.derivative_jumps(9.0)[0] == 0.5
    assert function.derivative_jumps(9.0)[-1] == pytest.approx(0.5 + length)


@pytest.mark.parametrize(
    ("fields", "place", "sentence"),
    [
        ({"y1": 1}, "", 'give "t1" (and perhaps "ramp"), or "speed" and "acceleration"'),
        ({"y1": 1, "t1": 1, "speed": 2}, "", "given: t1, speed"),
        ({"y1": 1, "t1": 0}, "t1", "must lie after t0 = 0 s"),
        ({"y1": 1, "t1": 1, "ramp": 0.6}, "ramp", "longer than half the time, 0.5 s"),
        ({"y1": 0, "speed": 1, "acceleration": 1}, "y1", "the profile has no length"),
    ],
)
def test_mistakes_of_trapezoids_are_told(fields, place, sentence):
    with pytest.raises(SceneError) as caught:
        read_function({"type": "trapezoidal", **fields})
    (problem,) = caught.value.problems
    assert problem.where == place and sentence in problem.what


def test_numbers_are_in_the_units_of_the_scene():
    names = ReadContext({}, unit_system("mm-t-s"))
    given = {"type": "trapezoidal", "y1": 500, "speed": 250, "acceleration": "1 m/s^2"}
    function = read_function(given, names, "m")
    assert function.value(0.25 + 1.0)[1] == pytest.approx(0.25)
    table = read_function({"type": "table", "points": [[0, 0], ["500 ms", "2 cm"]]}, names, "m")
    assert table.value(0.25) == pytest.approx((0.01, 0.04, 0.0))
    angle = read_function({"type": "akima", "points": [[0, 0], [1, "90 deg"]]}, names, "rad")
    assert angle.value(1.0)[0] == pytest.approx(np.pi / 2)
