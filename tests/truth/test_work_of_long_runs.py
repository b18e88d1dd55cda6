"""Long runs: works of which far more passes through than is stored, and rows in phase.

A motor drives a fan for a thousand seconds. The error of the sum of works exceeds 5 % of the energy
stored, while the motion is right, as SciPy says: no reason for an alarm.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from accuracyscenes.judging import judged
from accuracyscenes.mounts import inverted, inverted_truth
from scipy.integrate import solve_ivp

from flexmb.model import Model

J = 1e-3


def fan():
    made = Model("fan")
    made.add_body("rotor", mass=1, inertia=[J] * 3)
    made.add_joint("pin", "revolute", between=["ground", "rotor"], axis="z")
    made.add_sensor("turn", "angle", joint="pin")
    made.add_sensor("w", "angle", joint="pin", derivative=1)
    made.add_force("motor", "torque", at="rotor", value=[0, 0, "0.4 + 0.6*sin(5*t)"])
    made.add_force("fan", "torque", at="rotor",
                   value=[0, 0, "-0.03*w - 0.02*w*abs(w) - 0.3*sin(2*turn)"])  # fmt: skip
    return made


def fan_truth(t):
    def slope(t, y):
        drag = 0.03 * y[1] + 0.02 * y[1] * abs(y[1]) + 0.3 * math.sin(2 * y[0])
        return [y[1], (0.4 + 0.6 * math.sin(5 * t) - drag) / J]

    y = solve_ivp(slope, (0, t[-1]), [0.0, 0.0], "LSODA", t, rtol=1e-9, atol=1e-9).y
    return {"turn": y[0], "w": y[1]}


@pytest.mark.slow
def test_the_work_of_a_long_run_is_no_alarm():
    found = judged(fan(), fan_truth, duration=1000.0, outputs=20, accuracy=1e-3)
    assert found.statistics["energy_balance_error"] > 0.05
    assert found.achieved < 1e-2  # of speeds as well, over their range in the rows
    assert not any("energy balance" in note for note in found.notes), found.notes


def test_works_that_are_not_measured_are_still_reported():
    found = judged(fan(), duration=20.0, outputs=20, step=0.01)
    assert np.any(["energy balance" in note for note in found.notes])


TURN = 2 * math.pi  # rad/s: one period a second


def swinging():
    made = Model("mass on a spring")
    made.add_body("m", mass=1, inertia=[1] * 3, position=[1.3, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_marker("ground.wall", position=[-5, 0, 0])
    made.add_force("spring", "spring-damper", between=["ground.wall", "m"], stiffness=TURN**2,
                   free_length=6)  # fmt: skip
    made.add_sensor("place", "position", of="m")
    made.add_sensor("rate", "velocity", of="m")
    return made


def swinging_truth(t):
    return {"place.x": 1 + 0.3 * np.cos(TURN * t), "rate.x": -0.3 * TURN * np.sin(TURN * t)}


@pytest.mark.parametrize(
    ("method", "accuracy"), [("explicit-rk", 1e-3), ("radau", 1e-3), ("generalized-alpha", 1e-2)]
)
@pytest.mark.parametrize("outputs", [60, 120])
def test_rows_in_phase_with_a_motion_know_its_range(method, accuracy, outputs):
    """Once or twice a period, where it stands still: the same steps, errors over the motion.

    The range was that of the rows, 0 or that of velocities: 4 to 26 times the steps were taken, and
    an error of 300 % was told.
    """
    knobs = {"duration": 60.0, "accuracy": accuracy, "method": method}
    dense = judged(swinging(), swinging_truth, outputs=1999, **knobs)
    found = judged(swinging(), outputs=outputs, **knobs)
    assert found.steps < 1.2 * dense.steps
    assert not any("was asked for" in note for note in found.notes), found.notes
    for quantity in ("positions", "velocities"):
        assert found.statistics[f"measured_error_of_{quantity}"] < accuracy, quantity


def test_multipliers_that_alternate_from_step_to_step_do_no_work():
    """Kapitza's pendulum by order 2: 2.9 % of the energy was missing, with a right motion."""
    found = judged(inverted(), inverted_truth, duration=0.5, outputs=100, accuracy=1e-3,
                   method="generalized-alpha")  # fmt: skip
    assert found.is_reached(1e-3)
    assert found.statistics["energy_balance_error"] < 1e-2
