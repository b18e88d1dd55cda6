"""Notes on fixed steps: pulses between their stages, and rotations that they do not resolve."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import flexmb
from flexmb.errors import FlexmbWarning
from flexmb.model import Model

METHODS = ("generalized-alpha", "radau", "explicit-rk")
RISE = "(step(t, 0.6, 0, 0.6001, 1) - step(t, 0.6002, 0, 0.6003, 1))"
NEEDLE = [[0, 0], [0.601, 0], [0.6015, 1], [0.602, 0], [1, 0]]
NOISE = np.random.default_rng(1).normal(size=401)


def hit(force, **knobs):
    """Notes of a run of a free body of 2 kg on which a force acts, and its last velocity."""
    made = Model("hit")
    made.add_body("b", mass=2, inertia=[1, 1, 1])
    made.add_force("push", "force", at="b", value=[force, 0, 0])
    made.add_sensor("b", "velocity", of="b")
    with warnings.catch_warnings(action="ignore", category=FlexmbWarning):
        found = flexmb.simulate(made, duration=1.0, outputs=10, **knobs)
    return [note for note in found.notes if "pulse" in note], found["b.x"][-1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("verify", [False, True])
@pytest.mark.parametrize(
    "force", [f"30*{RISE}", "30*exp(-((t - 0.6037)/2e-5)**2)", {"type": "table", "points": NEEDLE}]
)
def test_a_pulse_between_the_stages_is_told(force, method, verify):
    """The body stays where it is, to the last bit: a half step sees no more."""
    step = 0.02
    (note,), speed = hit(force, method=method, step=step, verify=verify)
    assert abs(speed) < 1e-9
    assert ("and half of them" in note) == verify
    assert "steps of 0.02 s" in note and "at t = 0.6" in note and "misses it" in note


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("force", [
    "30*step(t, 0.603, 0, 0.604, 1)",  # stays
    "30*(step(t, 0.6, 0, 0.61, 1) - step(t, 0.65, 0, 0.66, 1))",  # wide
    "30*abs(sin(7*t))", "30*sin(50*t)", "3", "30*max(sin(9*t), 0.2)",
    {"type": "table", "points": [[t, np.sin(5 * t)] for t in np.linspace(0, 1, 401).tolist()]},
    {"type": "spline", "points": [[t, np.sin(5 * t)] for t in np.linspace(0, 1, 401).tolist()]},
])  # fmt: skip
def test_what_the_steps_see_is_not_told(force, method):
    assert hit(force, method=method, step=0.01, verify=True)[0] == []


def test_controlled_steps_end_at_pulses():
    """By hand: 30 N for 0.2 ms."""
    told, speed = hit(f"30*{RISE}", accuracy=1e-6)
    assert told == [] and speed == pytest.approx(30 * 2e-4 / 2, rel=1e-6)


def test_many_pulses_are_one_sentence():
    table = {"type": "table", "points": np.column_stack([np.linspace(0, 1, 401), NOISE]).tolist()}
    (note,), _ = hit(table, method="generalized-alpha", step=0.02)
    assert "others between the times" in note and "misses them" in note
    assert len(note) < 400


@pytest.mark.parametrize("at", [0.1035, 0.9035])
def test_a_pulse_in_thousands_of_noisy_points_is_told_wherever_it_is(at):
    times = np.linspace(0, 1, 4001)
    force = 0.01 * np.random.default_rng(2).normal(size=4001)
    force[np.abs(times - at).argmin()] = 30.0
    table = {"type": "table", "points": np.column_stack([times, force]).tolist()}
    (note,), _ = hit(table, method="generalized-alpha", step=0.02)
    assert f"at t = {str(at)[:5]}" in note


@pytest.mark.parametrize(("speed", "advised"), [(100.0, None), (103.0, 0.0092), (101.0, 0.0094)])
def test_steps_that_are_advised_for_a_turn_are_short_enough(speed, advised):
    """1 rad in a step is the limit: it is no fault, and an advised step is below it."""
    made = Model("wheel")
    made.add_body("w", mass=1, inertia=[1, 1, 1], angular_velocity=[0, 0, speed])
    made.add_joint("axle", "revolute", between=["ground", "w"], axis="z")
    made.add_sensor("turn", "angle", joint="axle")
    with warnings.catch_warnings(action="ignore", category=FlexmbWarning):
        found = flexmb.simulate(made, duration=0.2, outputs=20, step=0.01, method="radau")
    notes = [note for note in found.notes if "rad in a step" in note]
    assert len(notes) == (advised is not None)
    assert all(f"take steps of {advised:g} s at most" in note for note in notes)
    assert advised is None or speed * advised < 1.0


def test_a_pulse_that_half_steps_see_is_in_the_stated_error():
    """In the middle of a step: told where nothing measures the error, and measured else."""
    middle = "30*exp(-((t - 0.61)/1e-4)**2)"
    knobs = {"method": "generalized-alpha", "step": 0.02}
    assert len(hit(middle, **knobs)[0]) == 1
    told, speed = hit(middle, verify=True, **knobs)
    assert told == [] and abs(speed) < 1e-9


def test_a_step_that_is_shortened_is_told_in_the_units_of_the_scene():
    made = Model("cart", units="mm-kg-ms")
    made.add_body("cart", mass=1, inertia=[1, 1, 1])
    made.add_sensor("x", "position", of="cart")
    with warnings.catch_warnings(action="ignore", category=FlexmbWarning):
        found = flexmb.simulate(made, duration=10.0, step=3.0, outputs=4)
    assert "step shortened from 3 ms to 2.5 ms to meet the outputs" in found.notes
