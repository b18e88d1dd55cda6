"""Modes without inertia where a scene moves faster than its drivers, against all modes dynamic."""

from __future__ import annotations

import numpy as np
import pytest
from flexiblescenes import rod

import flexmb
from flexmb.model import Model

STIFFNESS, MASS = 4e3, 0.3


def sprung(deformation):
    """A slow driver turns a beam; a weight in a slot at its tip vibrates on a spring."""
    model = Model("sprung weight")
    model.add_body("beam", rod(0.02, 1.0, 20, 8), deformation=deformation)
    model.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    model.add_driver("slow", joint="hub", angle="0.3*sin(2*t)")
    model.add_body("weight", mass=MASS, inertia=[1e-3] * 3, position=[1.0, 0.2, 0],
                   velocity=[0, -1.0, 0])  # fmt: skip
    model.add_joint("slot", "prismatic", between=["beam.tip", "weight"], axis="y")
    model.add_force("spring", "spring-damper", between=["beam.tip", "weight"],
                    stiffness=STIFFNESS, free_length=0.2)  # fmt: skip
    model.add_sensor("tip", "position", of="beam.tip", relative_to="beam.root", axes="beam.root")
    model.set_dynamics(duration=0.4, outputs=150, accuracy=1e-4, method="radau",
                       start="quasi-static", verify=False)  # fmt: skip
    return model


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")
def test_a_weight_on_a_spring_moves_faster_than_the_driver(tmp_path):
    """The band goes by the motion; that of the driver is too narrow, as the audit estimates."""
    bands = {"dynamic": "dynamic", "driver": {"band": [0, 25 / np.pi]}, "automatic": "automatic"}
    runs = {
        name: flexmb.simulate(sprung(words), output=tmp_path / name)
        for name, words in bands.items()
    }
    complete = runs.pop("dynamic")["tip.y"]
    errors = {
        k: np.abs(run["tip.y"] - complete).max() / np.ptp(complete) for k, run in runs.items()
    }
    assert errors["automatic"] < 0.002 and errors["driver"] > 0.03
    band = runs["automatic"].model["bodies"]["beam"]["deformation"]["band"]
    hertz = np.sqrt(STIFFNESS / MASS) / (2 * np.pi)  # and somewhat more on the beam's mass
    assert 25 * hertz < band[1] < 3 * 25 * hertz
    made = flexmb.audit(runs["driver"])
    (one,) = [one for one in made.effects if one.effect == "vibration of quasi-static modes"]
    assert one.verdict == "missing"
    assert one.share == pytest.approx(errors["driver"], rel=0.3)


def test_what_does_not_move_has_the_band_of_its_drivers():
    """Clamped, with a load at the tip: with rigid bodies there is no motion to go by."""
    model = Model("clamped")
    model.add_body("beam", rod(0.02, 1.0, 20, 8), deformation="automatic")
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    model.add_force("load", "force", at="beam.tip", value=[0, "10*sin(2*pi*4*t)", 0])
    model.add_sensor("tip", "position", of="beam.tip")
    run = flexmb.simulate(model, duration=1.0, outputs=50, accuracy=1e-3, verify=False)
    words = run.model["bodies"]["beam"]["deformation"]
    assert words == "automatic" or words["band"][1] == pytest.approx(100.0, rel=0.02)


def test_round_off_at_rest_points_is_no_motion():
    """The root of a beam on a hub does not move: only its turning has a frequency."""
    model = Model("turned beam")
    model.add_body("beam", rod(0.01, 1.0, 10, 6), deformation="automatic")
    model.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    model.add_driver("motor", joint="hub", angle="sin(6*t)-6*t")
    model.add_sensor("tip", "position", of="beam.tip")
    run = flexmb.simulate(model, duration=1.0, outputs=20, accuracy=1e-3, verify=False)
    assert 25 * 6 / (2 * np.pi) < run.model["bodies"]["beam"]["deformation"]["band"][1] < 150
