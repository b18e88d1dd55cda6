"""Loads and drives that come hundreds of times, with rest between them: none is stepped over."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from truthkit import run

from flexmb.model import Model

SMOOTH = ("exp(-(cos(pi*t)/0.05)**2)", lambda t: np.exp(-((np.cos(np.pi * t) / 0.05) ** 2)))
KINKED = ("max(0, -cos(2*pi*t) - 0.9)", lambda t: max(0.0, -np.cos(2 * np.pi * t) - 0.9))


@pytest.mark.parametrize("outputs", [4, 5, 20])
@pytest.mark.parametrize(
    ("force", "pulses"),
    [
        (SMOOTH, 120), (SMOOTH, 200), (SMOOTH, 1000), (KINKED, 1000), (KINKED, 2000),
        (KINKED, 4000), pytest.param(SMOOTH, 4000, marks=pytest.mark.seconds),
    ],
)  # fmt: skip
def test_each_pulse_of_a_train_gives_its_momentum(force, pulses, outputs):
    """A free mass: nothing but the next pulse changes its speed."""
    made = Model("hit")
    made.add_body("m", mass=2, inertia=[1, 1, 1])
    made.add_force("hit", "force", at="m", value=[force[0], 0, 0])
    made.add_sensor("m", "velocity", of="m")
    found = run(made, duration=float(pulses), outputs=outputs, accuracy=1e-3)
    area = quad(force[1], 0.3, 0.7, points=[0.42, 0.5, 0.58], epsabs=1e-14)[0]
    wanted = np.floor(found.t + 0.5) * area / 2  # half of each comes before the middle
    wanted[(found.t + 0.5) % 1.0 == 0.0] -= area / 4
    assert np.abs(found["m.x"] - wanted).max() < 2e-3 * wanted[-1]


RATIO = float(np.sqrt(0.5))


@pytest.mark.seconds
@pytest.mark.parametrize("turns", [100, 333.3, 1000])
def test_a_geneva_drive_turns_as_long_as_its_crank(turns):
    """A quarter of a turn of the wheel for each of the crank; on its shaft an elastic disk."""
    cosine = "cos(2*pi*t + pi)"
    speed = f"2*pi*{RATIO}*max(0, ({cosine} - {RATIO})/(1 + {RATIO**2} - {2 * RATIO}*{cosine}))"
    made = Model("Geneva drive")
    for name in ("wheel", "disk"):
        made.add_body(name, mass=1, inertia=[0.02] * 3)
    made.add_joint("pin", "revolute", between=["ground", "wheel"], axis="z")
    made.add_joint("shaft", "revolute", between=["wheel", "disk"], axis="z")
    made.add_driver("geneva", joint="pin", prescribes="velocity", angle=speed)
    made.add_force("shaft", "rotational-spring-damper", joint="shaft", stiffness=8, damping=0.4)
    made.add_sensor("wheel", "angle", joint="pin")
    made.add_sensor("twist", "angle", joint="shaft")
    found = run(made, duration=float(turns), outputs=20, accuracy=1e-4)
    a = 2 * np.pi * np.clip(found.t - np.floor(found.t) - 0.5, -0.125, 0.125)
    within = np.arctan2(RATIO * np.sin(a), 1 - RATIO * np.cos(a)) + np.pi / 4
    wheel = np.floor(found.t) * np.pi / 2 + within
    assert np.abs(found["wheel"] - wheel).max() < 1e-11 * turns
    # Of the twist: that of one turn after the other, by its state-space matrices.
    twist = _twist(found.t)
    assert np.abs(found["twist"] - twist).max() < 2e-4 * np.ptp(twist)


def _twist(times):
    """J x'' + c x' + k x = -J times the acceleration of the wheel, by convolution over one turn."""
    J, k, c = 0.02, 8.0, 0.4
    decay = c / (2 * J)
    ring = np.sqrt(k / J - decay**2)

    def speed(t):
        cosine = np.cos(2 * np.pi * t + np.pi)
        return 2 * np.pi * RATIO * max(0, (cosine - RATIO) / (1 + RATIO**2 - 2 * RATIO * cosine))

    def slope(s):
        return np.exp(-decay * s) * (np.cos(ring * s) - decay / ring * np.sin(ring * s))

    def one_turn(begin, t):  # -∫ g(t - s) a(s) ds by parts: the speed is zero at both ends
        last = min(t, begin + 0.625)
        if last <= begin + 0.375:
            return 0.0
        own = quad(lambda s: slope(t - s) * speed(s), begin + 0.375, last, epsabs=1e-13)[0]
        return -own

    return np.array([
        sum(one_turn(begin, t) for begin in range(max(0, int(t) - 3), int(t) + 1)) for t in times
    ])  # fmt: skip
