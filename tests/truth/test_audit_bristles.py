"""Estimates of the audit where bristles stick and slide, against the difference of two runs."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.analysis.effects.contribution import estimate
from flexmb.analysis.effects.stored_motion import read_motion
from flexmb.engine.compile import compile_system
from flexmb.model import Model

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
MORE = 1.001  # times the force: small, so that what is left of second order is smaller


def block_on_a_guide(force):
    model = Model("block on a guide", gravity=[0, 0, -9.81])
    model.add_body("block", mass=1.0, inertia=[1e-3] * 3)
    model.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    model.add_force("friction", "joint-friction", joint="guide", dynamic=0.25, static=0.3,
                    stribeck_speed=0.1, stiffness=2e4, damping=100.0)  # fmt: skip
    return pushed(model, force, 0.0)


def block_under_a_load(force):
    """It slides to its stop; the force presses on it, and acts on its motion by friction alone."""
    model = Model("block under a load", gravity=[0, 0, -9.81])
    model.add_body("block", mass=1.0, inertia=[1e-3] * 3, velocity=[1.0, 0, 0])
    model.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    model.add_force("friction", "joint-friction", joint="guide", dynamic=0.25, stiffness=2e4,
                    damping=100.0)  # fmt: skip
    model.add_force("load", "force", at="block", value=[0, 0, f"-{force}*sin(3*t)**2"])
    model.add_sensor("place", "position", of="block")
    model.set_dynamics(duration=0.6, outputs=400, accuracy=1e-8, verify=False)
    return model


def puck_on_a_floor(force, depth=1.02 * 9.81 / 1e5):
    """It is pushed to and fro and across, and does not turn; at that depth it rests."""
    model = Model("puck on a floor", gravity=[0, 0, -9.81])
    for name, mass in (("lift", 0.01), ("carriage", 0.01), ("puck", 1.0)):
        model.add_body(name, mass=mass, inertia=[1e-3] * 3)
    chain = [("ground", "lift", "z"), ("lift", "carriage", "y"), ("carriage", "puck", "x")]
    for before, name, axis in chain:
        model.add_joint(f"guide_{axis}", "prismatic", between=[before, name], axis=axis)
    model.add_marker("ground.floor", position=[0, 0, depth - 0.02])
    shapes = [{"type": "sphere", "radius": 0.02}, {"type": "plane"}]
    friction = {"dynamic": 0.3, "stiffness": 2e4, "damping": 100.0}
    model.add_force("floor", "contact", between=["puck", "ground.floor"], shapes=shapes,
                    stiffness=1e5, exponent=1.0, restitution=1.0, friction=friction)  # fmt: skip
    return pushed(model, force, 0.4)


def pushed(model, force, across):
    body = list(model.bodies)[-1]
    value = [f"{force}*sin(7*t)", f"{across}*{force}*sin(7*t)", 0]
    model.add_force("push", "force", at=body, value=value)
    model.add_sensor("place", "position", of=body)
    model.set_dynamics(duration=1.3, outputs=800, accuracy=1e-8, verify=False)
    return model


def told_and_true(models):
    """Changes of the place from one scene to another, along the rows of a run."""
    run, other = (flexmb.simulate(model) for model in models)
    compiled = [compile_system(model, {}) for model in models]
    made, _ = estimate(*compiled, models[1], read_motion(run, compiled[0]), {})
    k = run.channels().index("place.x")
    return made.channels[:, k], other["place.x"] - run["place.x"]


@pytest.mark.seconds
@pytest.mark.parametrize("scene", [
    block_on_a_guide, pytest.param(puck_on_a_floor, marks=pytest.mark.slow), block_under_a_load,
])  # fmt: skip
def test_what_has_slid_further_sticks_at_another_place(scene):
    """What a larger force adds to its way stays when it sticks, as what friction takes from it."""
    told, true = told_and_true([scene(4.0), scene(4.0 * MORE)])
    assert np.abs(told - true).max() < 0.03 * np.ptp(true)


@pytest.mark.seconds
def test_a_contact_that_is_open_at_first_and_vibrates_faster_than_the_rows():
    models = [puck_on_a_floor(2.0 * f, depth=0.0) for f in (1.0, MORE)]
    for model in models:
        model.dynamics = model.dynamics.model_copy(update={"outputs": 200})
    told, true = told_and_true(models)
    assert 1 / 3 < np.abs(told).max() / np.abs(true).max() < 3
