"""Mistakes in expressions and parameters of a scene point at the character, or name the cycle."""

from __future__ import annotations

import pytest
from goodscene import message


def test_a_syntax_error_points_at_the_character(tmp_path):
    text = message(tmp_path, ('angle = "speed*t"', 'angle = "speed*t + (2*t"'))
    assert text.splitlines() == [
        "drivers.motor.angle: syntax error: '(' was never closed at character 11",
        "    speed*t + (2*t",
        "              ^",
    ]


@pytest.mark.parametrize(
    ("expression", "what", "character"),
    [
        ("sped*t", 'unknown name "sped"', 1),
        ("2*sim(t)", 'unknown function "sim"', 3),
        ("2*t +* 3", "syntax error", 6),
        ("speed t", "syntax error", 7),
        ("2 t", "syntax error: a value or an operator is missing", 3),
        ("120 rpm*t", "syntax error: a number with a unit stands alone", 5),
        ("t^2", 'powers are written "**", not "^"', 3),
        ("t/0", "division by zero", 3),
        ("t*log(-1)", "the value is nan, no finite number", 3),
        ("atan2(t)", "atan2 takes 2 arguments, not 1: atan2(y, x)", 1),
        ("step(t, 1, 0, 1, 5)", "the end x1 of a step must lie after its beginning x0", 15),
        ("t if t else 1", "only numbers, names, + - * / ** and functions may be used", 1),
        ("__import__('os').x", "only numbers, names", 1),
        ("t + 'a'", "'a' is no number", 5),
        ("", "the expression is empty", 1),
        ("\u00e9 + t + sped", 'unknown name "\u00e9"', 1),
        ("t + 1e999", "the number is too large", 5),
    ],
)
def test_mistakes_in_expressions_point_at_the_character(tmp_path, expression, what, character):
    text = message(tmp_path, ('"speed*t"', f'"{expression}"'))
    first, _, caret = text.splitlines()
    assert first.startswith(f"drivers.motor.angle: {what}")
    assert f"at character {character}" in first
    assert caret.index("^") == 4 + character - 1


def test_an_unknown_parameter_lists_the_nearest(tmp_path):
    text = message(tmp_path, ('"speed*t"', '"sped*t"'))
    assert "nearest: speed; allowed: r, speed, t, pi, e, deg" in text


def test_a_cycle_of_parameters_is_named_once(tmp_path):
    text = message(tmp_path, ("r = 0.2", 'r = "2*a"\na = "b + 1"\nb = "r"'))
    assert text == "parameters.r: depends on itself: r -> a -> b -> r"


def test_a_parameter_may_not_hide_a_constant(tmp_path):
    text = message(tmp_path, ("r = 0.2", "r = 0.2\ne = 1"))
    assert text == 'parameters.e: the name "e" is taken: it is a constant of expressions; rename it'


def test_time_in_a_constant(tmp_path):
    text = message(tmp_path, ("duration = 1", 'duration = "2*t"'))
    assert "dynamics.duration: a constant is expected, not the time t" in text
