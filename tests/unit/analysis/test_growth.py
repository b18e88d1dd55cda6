"""Motions that grow exponentially are told with name and rate; other large ones are not."""

from __future__ import annotations

import re

import numpy as np
import pytest
from truthkit import Memory

from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.engine.compile import compile_system
from flexmb.model import Model


def outcome_of(model, **knobs):
    """How a run ends."""
    model.set_dynamics(**{"outputs": 200, "accuracy": 1e-3, "verify": False, **knobs})
    memory = Memory()
    return dynamics(compile_system(model), model, memory), memory


def slider(**body):
    model = Model("slider")
    model.add_body("b", **{"mass": 2, "inertia": [1, 1, 1], **body})
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    model.add_sensor("x", "position", of="b")
    return model


def rotor():
    model = Model("rotor")
    model.add_body("b", mass=1, inertia=[1, 1, 0.5])
    model.add_joint("shaft", "revolute", between=["ground", "b"], axis="z")
    model.add_sensor("angle", "angle", joint="shaft")
    return model


def wrong_sign():
    """A body that is pushed away from where it should be: x'' = 50 x, λ = ±√50."""
    model = slider(position=[0.01, 0, 0])
    model.add_force("hold", "force", at="b", value=["100*x.x", 0, 0])
    return model, "bodies.b", np.sqrt(50)


def wrong_pid():
    """A speed is fed back with the wrong sign: ω' = 2 (1 + 3 ω)."""
    model = rotor()
    model.add_sensor("speed", "angle", joint="shaft", derivative=1)
    model.add_controller("pid", "pid", input="1 + 3*speed", kp=1.0)
    model.add_force("motor", "rotational-spring-damper", joint="shaft", value="pid")
    return model, "the angular velocity of bodies.b", 6.0


def wrong_state():
    """A filter with its pole on the wrong side."""
    model = slider()
    model.add_state("y", rate="4*y + 1e-3")
    model.add_force("push", "force", at="b", value=["1e-9*y", 0, 0])
    return model, "states.y", 4.0


def growing_swing():
    """Negative damping: an oscillation whose size grows by exp(2 t)."""
    model = slider(velocity=[0.01, 0, 0])
    model.add_sensor("v", "velocity", of="b")
    model.add_force("spring", "translational-spring-damper", joint="rail", stiffness=200.0)
    model.add_force("hold", "force", at="b", value=["8*v.x", 0, 0])
    return model, "bodies.b", 2.0


@pytest.mark.parametrize("make", [wrong_sign, wrong_pid, wrong_state, growing_swing])
def test_what_grows_is_named_with_its_rate(make):
    model, name, rate = make()
    outcome, memory = outcome_of(model, duration=30.0 / rate, outputs=400)
    assert outcome.status == "failed"
    assert outcome.message.startswith(f"{name} grows without bound at t = ")
    tenfold = float(re.search(r"every ([-+.e\d]+) s", outcome.message).group(1))
    assert tenfold == pytest.approx(np.log(10) / rate, rel=0.12)
    assert len(memory.tables()[0]) > 10


def test_without_feedback_it_is_a_note():
    model = slider(position=[0.01, 0, 0])
    model.add_force("hold", "translational-spring-damper", joint="rail", spring_force="-100*x - 1")
    outcome, _ = outcome_of(model, duration=4.0)
    assert outcome.status == "finished", outcome.message
    assert any("bodies.b grows without bound" in note for note in outcome.notes)


def falling():
    model = Model("fall", gravity="earth -z")
    model.add_body("b", mass=1, inertia=[1, 1, 1])
    return model, 1000.0


def spinning_up():
    model = rotor()
    model.add_force("motor", "rotational-spring-damper", joint="shaft", value="5 + 0*angle")
    return model, 20.0


def quickening():
    """A torque that grows as t³: the angle as t⁵."""
    model = rotor()
    model.add_force("motor", "rotational-spring-damper", joint="shaft", value="t**3 + 0*angle")
    return model, 7.0


def rocket():
    model = slider(mass=1)
    model.add_force("thrust", "force", at="b", value=["30/(1.001 - t/100) + 0*x.x", 0, 0])
    return model, 100.0


def planned():
    """A kilometre in a second, after a long rest."""
    model = slider()
    profile = {"type": "step5", "t0": 9.0, "t1": 10.0, "y0": 0.0, "y1": 1000.0}
    model.add_driver("pull", joint="rail", stroke=profile)
    model.add_state("y", rate="x.x")
    return model, 12.0


def leaving_the_top():
    model = Model("pendulum", gravity="earth -y")
    model.add_body("b", mass=1, inertia=[0.01, 0.01, 0.01], position=[1e-7, 1, 0])
    model.add_marker("b.pivot", position=[-1e-7, -1, 0])
    model.add_joint("pin", "revolute", between=["ground", "b.pivot"], axis="z")
    model.add_sensor("angle", "angle", joint="pin")
    model.add_force("rub", "rotational-spring-damper", joint="pin", value="0*angle")
    return model, 20.0


def resonance():
    model = slider()
    model.add_force("spring", "translational-spring-damper", joint="rail", stiffness=200.0)
    model.add_force("push", "force", at="b", value=["1000*sin(10*t) + 0*x.x", 0, 0])
    return model, 60.0


def growing_state():
    """A state that is meant to grow, by e¹⁰."""
    model = slider()
    model.add_state("y", rate="y", start=1.0)
    model.add_force("push", "force", at="b", value=["1e-9*y", 0, 0])
    return model, 10.0


def summed_up():
    """Integrals of integrals of integrals."""
    model = slider()
    model.add_state("a", rate="1e3 + 0*x.x")
    model.add_state("b1", rate="a")
    model.add_state("c", rate="b1")
    model.add_force("push", "force", at="b", value=["1e-9*c", 0, 0])
    return model, 1000.0


@pytest.mark.parametrize(
    "make",
    [
        falling, spinning_up, quickening, rocket, planned, leaving_the_top, resonance,
        growing_state, summed_up,
    ],
)  # fmt: skip
def test_what_is_large_without_growing_so_is_not_told(make):
    model, duration = make()
    outcome, _ = outcome_of(model, duration=duration, outputs=500)
    assert outcome.status == "finished", outcome.message
    assert not any("grows" in note for note in outcome.notes)
