"""Discontinuity: impacts, stops, friction that holds, steps and switches of forces."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model
from tests.accuracyscenes import SCENES
from tests.hard.case import METHODS, Hard, largest

G = 9.81
FINE = {
    "auto": {}, "generalized-alpha": {"accuracy": None, "step": 1e-4}, "explicit-rk": {},
    "radau": {},
}  # fmt: skip


def off_truth(name):
    """Largest departure from the closed form of a scene, over the motion."""
    truth = SCENES[name].truth

    def judge(run):
        return max(largest(run[c] - v) / np.ptp(v) for c, v in truth(run.time).items())

    return judge


def falling_ball():
    made = Model("ball", gravity=[0, 0, -G])
    made.add_body("ball", mass=1, inertia=[0.004] * 3, position=[0, 0, 0.6])
    made.add_force("floor", "contact", between=["ball", "ground"], stiffness=1e8, restitution=0.5,
                   shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}])  # fmt: skip
    made.add_sensor("ball", "position", of="ball")
    return made


def on_a_slope(tilt):
    """A block on a guide that rises by an angle, with dry friction of 0.3."""
    made = Model("slope", gravity=[-G * np.sin(tilt), -G * np.cos(tilt), 0])
    made.add_body("block", mass=2, inertia=[1, 1, 1])
    made.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    made.add_force("rub", "joint-friction", joint="guide", static=0.3, dynamic=0.3,
                   stiffness=1e6, damping=1e3)  # fmt: skip
    made.add_sensor("way", "stroke", joint="guide")
    return made


def pushed():
    """A mass on a guide, pushed with 3 N for 0.1 s and pulled back by a switch of the sign."""
    made = Model("pushed")
    made.add_body("m", mass=1, inertia=[1, 1, 1])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("push", "force", at="m", value=["3*sign(0.1 - t)", 0, 0])
    made.add_sensor("m", "position", of="m")
    return made


def off_push(run):
    t = run.time
    late = 0.015 + 0.3 * (t - 0.1) - 1.5 * (t - 0.1) ** 2
    return largest(run["m.x"] - np.where(t < 0.1, 1.5 * t**2, late))


CASES = {
    "a ball that bounces without losses": Hard(
        "Impacts of 10 ms between flights of 0.6 s.",
        "Five bounces follow the closed form to 1e-3 of the height: ten times the accuracy.",
        1e-3, lambda: SCENES["bouncing ball"].make(1.0), off_truth("bouncing ball"),
        {"duration": 3.0, "outputs": 300, "accuracy": 1e-4}, FINE,
    ),
    "steps too long for an impact": Hard(
        "A step of 10 ms crosses the depth of an impact of 1 ms.",
        "The run ends, and says that energy appeared in its steps.",
        np.inf, falling_ball, run={"duration": 0.6, "outputs": 60, "step": 1e-2},
        methods={method: {} for method in METHODS}, warns="energy balance is off",
    ),
    "a mass between stops": Hard(
        "Stops of 1e4 N/m, met again and again.",
        "The closed form to 1e-3 of the way.",
        1e-3, lambda: SCENES["mass between stops"].make(1.0), off_truth("mass between stops"),
        {"duration": 2.0, "outputs": 300, "accuracy": 1e-4}, FINE,
    ),
    "a block that friction holds on a slope": Hard(
        "Its weight along the slope is two thirds of what friction can hold.",
        "Once the bristles bear it, it creeps by less than 1e-9 m in nine seconds.",
        1e-9, lambda: on_a_slope(np.arctan(0.2)),
        lambda run: np.ptp(run["way"][run.time >= 1.0]),
        {"duration": 10.0, "outputs": 100, "accuracy": 1e-4}, FINE,
    ),
    "a force that changes its sign": Hard(
        "The force jumps from 3 N to -3 N at t = 0.1 s.",
        "The parabolas to 1e-6 m in controlled steps, to the order in fixed ones.",
        1e-6, pushed, off_push, {"duration": 0.4, "outputs": 80, "accuracy": 1e-6}, FINE,
    ),
}  # fmt: skip
