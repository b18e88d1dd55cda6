"""Known answers at times between outputs: the value there, and how far off it may be."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.workflow.run_report import CheckOutcome, check_sensors, value_at


@pytest.mark.parametrize("at", [0.013, 0.371, 0.985])
def test_between_outputs_the_value_is_that_of_a_smooth_motion(at: float) -> None:
    t = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 41))
    t[0], t[-1] = 0.0, 1.0
    value, doubt = value_at(at, t, np.sin(9 * t))
    assert abs(value - np.sin(9 * at)) < 1e-4
    assert abs(value - np.sin(9 * at)) < doubt < 5e-3


def test_at_an_output_it_is_the_output() -> None:
    t = np.linspace(0.0, 0.3, 4)
    x = np.array([1.0, -2.0, 3.0, 7.0])
    for k in range(4):
        assert value_at(float(t[k]) * (1 + 1e-12), t, x) == (x[k], 0.0)
    assert value_at(0.0, t[:1], x[:1]) == (1.0, 0.0)
    value, doubt = value_at(0.05, t[:2], x[:2])
    assert value == pytest.approx(-0.5) and doubt == 0.0


def test_outputs_too_far_apart_leave_it_open_and_it_is_said() -> None:
    t = np.linspace(0.0, 10.0, 11)
    value, doubt = value_at(4.2, t, np.sin(1.9 * t))
    outcome = CheckOutcome("x", 4.2, value, float(np.sin(1.9 * 4.2)), 1e-3, "sine", doubt)
    assert outcome.is_open and not outcome.passed  # no run ends green by what is not known
    wrong = CheckOutcome("x", 4.2, value, value + doubt + 0.1, 1e-3, "sine", doubt)
    assert not wrong.passed and not wrong.is_open


def test_a_check_of_a_run_between_rare_outputs_does_not_fail_by_interpolation() -> None:
    """A free fall of 2 s with outputs each 0.5 s, checked at 0.7 s."""
    made = flexmb.Model("fall", gravity=[0, 0, -10.0])
    made.add_body("ball", mass=1.0, inertia=[0.1] * 3)
    made.add_sensor("ball", "position", of="ball")
    made.add_check(sensor="ball.z", time=0.7, value=-2.45, tolerance=1e-9, source="g t^2 / 2")
    made.add_check(sensor="ball.z", time=0.7, value=-2.5, tolerance=1e-3, source="wrong")
    run = flexmb.simulate(made, duration=2.0, outputs=4, step=0.1)
    right, wrong = check_sensors(made, run)
    assert right.passed and not right.is_open
    assert not wrong.passed
