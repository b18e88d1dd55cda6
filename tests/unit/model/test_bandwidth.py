"""The frequency that drives a scene, from closed forms."""

from __future__ import annotations

import math

import pytest

from flexmb.model import Model
from flexmb.model.excitation import BAND_FACTOR, cutoff_frequency


def driven(**driver):
    made = Model("shaft")
    made.add_body("shaft", mass=1.0, inertia=[1.0] * 3)
    made.add_joint("pin", "revolute", between=["ground", "shaft"], axis="z")
    made.add_driver("motor", joint="pin", **driver)
    made.set_dynamics(duration=2.0, outputs=10)
    return made


@pytest.mark.parametrize(
    ("angle", "frequency", "error"),
    [
        ("2*pi*5*t", 5.0, 1e-6),  # turns a second
        ("0.01*sin(2*pi*3*t)", 3.0, 0.01),  # whole periods, and the mean of the samples
        ("1000 + 0.01*sin(2*pi*3*t)", 3.0, 0.01),  # wherever it swings
    ],
)
def test_the_cutoff_is_ten_times_what_drives(angle, frequency, error):
    assert cutoff_frequency(driven(angle=angle)) == pytest.approx(
        BAND_FACTOR * frequency, rel=error
    )


def test_an_initial_spin_drives_and_nothing_drives_not():
    made = Model("top")
    made.add_body("top", mass=1.0, inertia=[1.0] * 3, angular_velocity=[0, 0, 30.0])
    made.set_dynamics(duration=1.0, outputs=10)
    assert cutoff_frequency(made) == pytest.approx(BAND_FACTOR * 30.0 / (2 * math.pi))
    still = Model("still")
    still.add_body("block", mass=1.0, inertia=[1.0] * 3)
    still.set_dynamics(duration=1.0, outputs=10)
    assert cutoff_frequency(still) == math.inf
