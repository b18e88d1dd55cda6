"""Small motions between bodies that are far away, or come there: round-off is told and named."""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import AWAY, SCENES, beside_a_large_motion, far_apart, moved, truth_of
from accuracyscenes.judging import METHODS, judged
from scipy.spatial.transform import Rotation

from flexmb.model import Model

SWING = 1e-6  # m, once a second
TILT = Rotation.from_rotvec([1.0, -0.3, 0.4])


def swing(made, first, place, speed, **force):
    """A body on a spring beside a carriage."""
    made.add_body("load", mass=1, inertia=[1, 1, 1], position=[place + 1 + SWING, 0, 0],
                  velocity=[speed, 0, 0])  # fmt: skip
    made.add_joint("slide", "prismatic", between=[first, "load"], axis="x")
    made.add_force("spring", "translational-spring-damper", joint="slide", free=1.0,
                   stiffness=(2 * np.pi) ** 2, **force)  # fmt: skip


def train():
    """Both travel 3 km from the origin; the stroke between them is seen."""
    made = Model("train")
    made.add_body("carriage", mass=1, inertia=[1, 1, 1])
    made.add_joint("rail", "prismatic", between=["ground", "carriage"], axis="x")
    made.add_driver("motor", joint="rail", stroke="300*t")
    swing(made, "carriage", 0.0, 300.0)
    made.add_sensor("apart", "stroke", joint="slide")
    return made


def shuttle():
    """1 km from a mast a carriage goes to and fro; the difference of two positions is seen."""
    made = Model("shuttle")
    made.add_body("mast", mass=1, inertia=[1, 1, 1])
    made.add_joint("foot", "fixed", between=["ground", "mast"])
    made.add_marker("ground.there", position=[1000, 0, 0])
    made.add_body("carriage", mass=1, inertia=[1, 1, 1], position=[1000, 0, 0])
    made.add_joint("rail", "prismatic", between=["ground.there", "carriage"], axis="x")
    made.add_driver("motor", joint="rail", stroke="100*sin(0.3*t)")
    swing(made, "carriage", 1000.0, 30.0, value="-9*sin(0.3*t)")
    made.add_sensor("load", "position", of="load")
    made.add_sensor("carriage", "position", of="carriage")
    made.add_sensor("apart", "expression", value="load.x - carriage.x", unit="m")
    return made


@pytest.mark.parametrize("method", ["auto", "radau"])
@pytest.mark.parametrize("make", [pytest.param(train, marks=pytest.mark.slow), shuttle])
def test_round_off_between_far_bodies_is_part_of_the_error(make, method):
    shares = []  # of a walk at random no single one tells
    for accuracy in (1e-6, 5e-7, 1e-7):
        knobs = {"duration": 10.0, "outputs": 100, "accuracy": accuracy, "method": method}
        found = judged(make(), lambda t: {"apart": 1 + SWING * np.cos(2 * np.pi * t)}, **knobs)
        shares.append(found.share)
        # up to 39 600 where they fight round-off; below its floor it depends on the last digits
        assert found.steps < 10_000 or (accuracy == 1e-7 and found.steps < 30_000)
    assert 1 / 3 <= np.prod(shares) ** (1 / 3) <= 3
    (sentence,) = [note for note in found.notes if "was asked for" in note]
    assert "the floor that round-off leaves" in sentence


def wheel_on_a_spring(center):
    """A wheel on a skew axis, 1.4 m from the origin, and a spring that turns it to and fro."""
    made = Model("wheel on a spring", gravity=[0, 0, 0])
    made.add_marker("ground.bearing", position=[0.7, 0.5, -1.1])
    made.add_body("wheel", mass=1, inertia=[0.4] * 3, center=center, position=[0.7, 0.5, -1.1],
                  orientation=TILT.as_matrix().tolist())  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground.bearing", "wheel"], axis=[1, 1, 1])
    made.add_force("spring", "rotational-spring-damper", joint="pin", stiffness=40, free=0.2)
    made.add_sensor("turn", "angle", joint="pin")
    return made


@pytest.mark.parametrize("accuracy", [1e-4, 1e-5])
def test_round_off_of_the_angle_in_a_joint_is_that_of_its_bodies_beside_a_large_model(accuracy):
    center = TILT.inv().apply([0.1, 0.2, -0.3])  # across the axis
    frequency = np.sqrt(40 / (0.4 + center @ center))
    knobs = {"duration": 2.0, "outputs": 20, "method": "generalized-alpha"}
    found = judged(
        beside_a_large_motion(wheel_on_a_spring(center)),
        lambda t: {"turn": 0.2 * (1 - np.cos(frequency * t))},
        accuracy=accuracy, **knobs,
    )  # fmt: skip
    assert not found.message
    assert found.is_reached(accuracy)
    assert 1 / 3 <= found.share <= 3


def held_arm():
    """An arm at rest where its controller wants it, and no load."""
    made = Model("held", gravity=[0, 0, 0])
    place = [0.7, 0.5, -1.1]
    made.add_marker("ground.there", position=place)
    made.add_body("arm", mass=1, center=[0.1, 0.2, -0.3], inertia=[0.1, 0.2, 0.3], position=place)
    made.add_joint("pin", "revolute", between=["ground.there", "arm"], axis=[1, 1, 1])
    made.add_sensor("turn", "angle", joint="pin")
    made.add_controller("servo", "pid", input="-turn", kp=30, ki=8, kd=3, filter=0.05)
    made.add_force("motor", "rotational-spring-damper", joint="pin", value="servo")
    return made


@pytest.mark.parametrize("place", ["plain", "moved", "beside"])
@pytest.mark.parametrize("method", ["generalized-alpha", "radau", "explicit-rk"])
def test_what_rests_takes_few_steps(method, place):
    """27 000 by `generalized-alpha`, where round-off of its corrections counts as an error."""
    made = held_arm()
    made = {"plain": made, "moved": moved(made), "beside": beside_a_large_motion(made)}[place]
    found = judged(made, duration=2.0, outputs=20, accuracy=1e-5, method=method)
    assert not found.message
    assert found.steps < 120
    assert not found.notes


@pytest.mark.parametrize("method", ["auto", "order 5", "radau"])
def test_round_off_of_a_far_place_is_part_of_the_error(method):
    """1 µm at the far end of a model of 1 km: no steps lessen what the place leaves."""
    scene = SCENES["swing of 1 µm at 1 m"]
    knobs = {"duration": scene.duration, "outputs": scene.outputs, **METHODS[method]}
    shares = []
    for accuracy in (1e-7, 1e-8):  # of a walk at random no single one tells
        knobs["accuracy"] = accuracy
        found = judged(far_apart(scene.make(1.0)), lambda t: truth_of(scene, t, away=AWAY), **knobs)
        assert found.achieved > 1e-7  # an ulp there is a ten-millionth of the swing
        shares.append(found.share)
    assert 1 / 3 <= np.sqrt(np.prod(shares)) <= 3
    (sentence,) = [note for note in found.notes if "was asked for" in note]
    assert "the floor that round-off leaves" in sentence


@pytest.mark.parametrize("method", ["auto", "order 5", "radau"])
def test_a_small_motion_a_kilometre_away_is_known_but_for_its_values(method):
    """1 µm, 1 km from the origin: half a unit in the last place of the sensor is the error."""
    scene = SCENES["swing of 1 µm at 1 m"]
    knobs = {"duration": scene.duration, "outputs": scene.outputs, **METHODS[method]}
    found = judged(
        moved(scene.make(1.0)), lambda t: truth_of(scene, t, away=AWAY), accuracy=1e-8, **knobs
    )
    last_place = 0.5 * np.spacing(np.linalg.norm(AWAY)) / 2e-6
    assert found.achieved <= 2.0 * last_place
    assert 1 / 3 <= found.told / last_place <= 3
    (sentence,) = [note for note in found.notes if "was asked for" in note]
    assert "relative_to = a marker on ground near the model" in sentence
