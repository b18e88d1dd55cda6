"""Functions of time: each form against its formula."""

from __future__ import annotations

import math

import pytest

from flexmb.errors import SceneError
from flexmb.model.functions.function import FUNCTION_FORMS, read_function

FORMS = [
    (3, "3"),
    ("speed*t", "2*t"),
    ("90 deg", "pi/2"),
    ({"type": "constant", "value": "speed"}, "2"),
    ({"type": "polynomial", "coefficients": [1, "speed", 3]}, "1 + 2*t + 3*t**2"),
    ({"type": "polynomial", "coefficients": [5]}, "5"),
    (
        {"type": "harmonic", "amplitude": 2, "frequency": 3, "phase": "30 deg", "offset": 1},
        "1 + 2*sin(6*pi*t + pi/6)",
    ),
    ({"type": "step", "t1": 2, "y1": 5}, "step(t, 0, 0, 2, 5)"),
    (
        {"type": "fourier", "frequency": 0.5, "cosine": [1, 3], "sine": [2], "offset": 4},
        "4 + cos(pi*t) + 3*cos(2*pi*t) + 2*sin(pi*t)",
    ),
    ({"type": "fourier", "frequency": 2, "sine": [0, 1], "phase": "20 deg"}, "sin(8*pi*t + pi/9)"),
    ({"type": "step5", "t1": 2, "y1": 5}, "step5(t, 0, 0, 2, 5)"),
    ({"type": "step5", "t1": 4, "y1": 5}, "5*(t/4)**3*(10 - 15*t/4 + 6*(t/4)**2)"),
    ({"type": "havsin", "t0": 0.5, "y0": 1, "t1": 2, "y1": 5}, "havsin(t, 0.5, 1, 2, 5)"),
    ({"type": "havsin", "t0": -1, "t1": 4, "y1": 1}, "(1 - cos(pi*(t + 1)/5))/2"),
    ({"type": "cycloidal", "t0": 0.1, "t1": 2, "y1": 5}, "cycloidal(t, 0.1, 0, 2, 5)"),
    ({"type": "cycloidal", "t1": 4, "y1": 1}, "t/4 - sin(pi*t/2)/(2*pi)"),
    ({"type": "modified-sine", "t1": 2, "y1": 5}, "modsine(t, 0, 0, 2, 5)"),
    (
        {"type": "trapezoidal", "t0": -1, "t1": 5, "y1": 16},
        "(t + 1)**2 - max(t - 1, 0)**2 - max(t - 3, 0)**2",
    ),
    ({"type": "spline", "points": [[0, 2], [4, 10]]}, "2 + 2*t"),
    ({"type": "akima", "points": [[0, 2], [1, 4], [4, 10]]}, "2 + 2*t"),
    ({"type": "table", "points": [[0, 2], [1, 3], [5, -1]]}, "2 + min(t, 2 - t)"),
]


@pytest.mark.parametrize(("given", "formula"), FORMS)
@pytest.mark.parametrize("t", [0.0, 0.7, 3.1])
def test_forms_are_their_formula(given, formula, t):
    function = read_function(given, {"speed": 2.0}, "rad")
    assert function.value(t) == pytest.approx(read_function(formula).value(t), rel=1e-13, abs=1e-13)


def test_every_form_is_tried():
    assert {given["type"] for given, _ in FORMS if isinstance(given, dict)} == set(FUNCTION_FORMS)


def test_a_constant_knows_that_it_is_one():
    assert read_function("pi").constant == math.pi
    assert read_function("t").constant is None


def test_what_was_given_is_kept():
    table = {"type": "step", "t1": "2*a", "y1": 5}
    assert read_function(table, {"a": 1.0}).source == table


def test_all_mistakes_of_a_form_at_once():
    with pytest.raises(SceneError) as caught:
        read_function({"type": "harmonic", "amplitud": 1, "frequency": "1 +", "phase": "x"})
    places = {problem.where for problem in caught.value.problems}
    assert places == {"amplitud", "frequency", "phase"}


@pytest.mark.parametrize("given", [True, None, [1, 2], math.sin, {"value": 1}, math.inf])
def test_anything_else_is_no_function(given):
    with pytest.raises(SceneError):
        read_function(given)
