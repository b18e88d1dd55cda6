"""Springs and dampers on joint coordinates, and the scalar coordinates behind them.

A spring on a joint acts on a coordinate without mass that follows the joint; a coordinate with mass
and damping and no row is a first-order state in its velocity.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from truthkit import order, run

from flexmb.engine import ordering
from flexmb.engine.joints import coordinate
from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.functions.expression import parse

K, D, J = 10.0, 0.2, 0.1


def rotor():
    made = Model("rotor")
    made.add_body("rotor", mass=1, inertia=[0.3, 0.3, J])
    made.add_joint("hinge", "revolute", between=["ground", "rotor"], axis="z")
    made.add_force(
        "coil", "rotational-spring-damper", joint="hinge", stiffness=K, damping=D, free="720 deg",
        value="0.5*sin(3*t)",
    )  # fmt: skip
    made.add_sensor("angle", "angle", joint="hinge")
    return made


def angle(t):
    """J φ'' + D φ' + K (φ − 4π) = ½ sin 3t from rest."""
    found = solve_ivp(
        lambda s, y: [y[1], (0.5 * np.sin(3 * s) - D * y[1] - K * (y[0] - 4 * np.pi)) / J],
        (0, t[-1]), [0, 0], t_eval=t, rtol=1e-11, atol=1e-12, method="DOP853",
    )  # fmt: skip
    return found.y[0]


@pytest.fixture(scope="module")
def runs():
    return [run(rotor(), duration=2.0, step=h, outputs=20) for h in (4e-3, 2e-3, 1e-3)]


def test_the_angle_of_a_joint_spring_counts_turns(runs):
    """Free at two turns, swinging between none and four; slope 2."""
    truth = angle(runs[0].t)
    assert truth.max() > 3.5 * np.pi * 2 * 0.9
    errors = [np.abs(one["angle"] - truth).max() for one in runs]
    assert errors[-1] < 2e-3
    assert 1.9 < order([4.0, 2.0, 1.0], errors) < 2.1
    # the coordinate itself, behind the body in q
    name = runs[-1].layout.coordinates
    assert name == ("forces.coil",)
    np.testing.assert_allclose(runs[-1].q[:, -1], runs[-1]["angle"], rtol=0, atol=1e-9)


def test_its_reaction_is_the_moment_of_spring_damper_and_actuator(runs):
    """On marker J about the axis: ½ sin 3t − K (s − free) − D s', the opposite on marker I."""
    found = runs[-1]
    at = 12 * found.layout.reactions.index("forces.coil")
    s, rate = found.q[:, -1], found.v[:, -1]
    moment = 0.5 * np.sin(3 * found.t) - K * (s - 4 * np.pi) - D * rate
    size = np.abs(moment).max()
    np.testing.assert_allclose(found.reactions[:, at + 5], moment, rtol=0, atol=1e-8 * size)
    np.testing.assert_allclose(found.reactions[:, at + 11], -moment, rtol=0, atol=1e-8 * size)
    others = np.delete(found.reactions[:, at : at + 12], [5, 11], axis=1)
    assert np.abs(others).max() < 1e-9 * size


def test_energy_and_works_balance(runs):
    imbalance = [
        np.ptp(one.energy[:, :4].sum(axis=1) - one.energy[:, 4:].sum(axis=1)) for one in runs
    ]
    assert imbalance[-1] < 1e-4 * runs[-1].energy[:, 3].max()
    assert order([4.0, 2.0, 1.0], imbalance) > 1.8
    assert np.ptp(runs[-1].energy[:, 5]) > 1  # the damper's work is no zero


def test_the_explicit_method_agrees():
    """Its system has a coordinate without mass."""
    found = run(rotor(), duration=1.0, outputs=10, accuracy=1e-6, method="explicit-rk")
    np.testing.assert_allclose(found["angle"], angle(found.t), rtol=0, atol=1e-4)


def test_a_stroke_spring_is_the_spring_between_points_on_the_axis():
    def slider(kind, **fields):
        made = Model("slider", gravity=[-9.81, 0, 0])
        made.add_body("m", mass=2, inertia=[1, 1, 1], position=[0.5, 0, 0])
        made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
        made.add_force("spring", kind, stiffness=200, damping=3, **fields)
        made.add_sensor("m", "position", of="m")
        return run(made, duration=1.0, step=1e-3, outputs=20, newton_tolerance=1e-11)

    along = slider("spring-damper", between=["ground", "m"], free_length=0.4)
    joint = slider("translational-spring-damper", joint="guide", free=0.4)
    np.testing.assert_allclose(joint.sensors, along.sensors, rtol=0, atol=1e-9)
    np.testing.assert_allclose(joint.energy, along.energy, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("p", "h", "knobs"),
    [
        (2, 0.02, {"method": "generalized-alpha"}),
        (5, 0.05, {"method": "explicit-rk", "order": 5}),
        (5, 0.1, {"method": "radau", "newton_tolerance": 1e-12}),
        (8, 0.2, {"method": "explicit-rk", "order": 8}),
    ],
)
def test_a_first_order_state_follows_its_law(p, h, knobs, monkeypatch):
    """T z' + z = sin 5t, z the rate of a coordinate with mass T and damping 1."""
    T = 0.3

    def scalars(model, functions, states):
        return [coordinate.Scalar("lag", mass=T, damping=1.0,
                                   function=functions.add(parse("sin(5*t)", {})))]  # fmt: skip

    monkeypatch.setattr(ordering, "scalar_coordinates", scalars)
    made = Model("state")
    made.add_body("idle", mass=1, inertia=[1, 1, 1])
    w = 5.0
    errors = []
    for step in (h, h / 2, h / 4):
        found = run(made, duration=1.0, step=step, outputs=5, **knobs)
        t = found.t
        truth = (np.sin(w * t) - w * T * np.cos(w * t) + w * T * np.exp(-t / T)) / (
            1 + (w * T) ** 2
        )
        errors.append(np.abs(found.v[:, -1] - truth).max())
    assert errors[-1] < 1e-4
    assert p - 0.15 < order([4.0, 2.0, 1.0], errors) < p + (0.2 if p == 2 else 0.5), errors


BAD = [
    ({"joint": "hing"}, 'forces.f.joint: unknown joint "hing"; nearest: hinge; allowed: hinge'),
    ({"joint": "hinge"}, "forces.f: needs stiffness, damping or value"),
    ({"joint": "hinge", "stiffness": -1}, "forces.f.stiffness: must be zero or positive"),
]


@pytest.mark.parametrize(("fields", "sentence"), BAD)
def test_mistakes_are_told(fields, sentence):
    made = rotor()
    with pytest.raises(SceneError) as caught:
        made.add_force("f", "rotational-spring-damper", **fields)
        made.validate()
    assert str(caught.value).startswith(sentence)


def test_a_hinge_has_no_stroke():
    made = rotor()
    made.add_force("f", "translational-spring-damper", joint="hinge", stiffness=1)
    assert "has no stroke; it has: angle" in str(made.problems()[0])
