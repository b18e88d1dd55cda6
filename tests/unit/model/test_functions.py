"""Functions of time: each form against its formula."""

from __future__ import annotations

import math

import pytest

from flexmb.errors import SceneError
from flexmb.model.functions import FUNCTION_FORMS, read_function

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
]


@pytest.mark.parametrize(("given", "formula"), FORMS)
@pytest.mark.parametrize("t", [0.0, 0.7, 3.0])
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
    assert read_function(table, {"a": 1.0}).given == table


def test_all_mistakes_of_a_form_at_once():
    with pytest.raises(SceneError) as caught:
        read_function({"type": "harmonic", "amplitud": 1, "frequency": "1 +", "phase": "x"})
    places = {problem.where for problem in caught.value.problems}
    assert places == {"amplitud", "frequency", "phase"}


@pytest.mark.parametrize("given", [True, None, [1, 2], math.sin, {"value": 1}, math.inf])
def test_anything_else_is_no_function(given):
    with pytest.raises(SceneError):
        read_function(given)
