"""Estimates of the vibration of one flexible body beside others that vibrate, against runs."""

from __future__ import annotations

import numpy as np
import pytest
from truth.test_audit import share_between
from truth.test_audit_machines import load, slender

import flexmb
from flexmb.model import Model
from flexmb.model.scenes.effects import with_words
from flexmb.workflow.effect_estimates import Estimates
from flexmb.workflow.neighbours import ModelVariants

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")


def arm_in_space():
    """Two links whose shoulder and elbow turn about axes across one another, with a load."""
    model, T = Model("arm in space"), 1.0 / 3.0
    model.add_body("upper", **slender(1.0, 0.028, modes=3))
    model.add_body("lower", **slender(0.7, 0.02, modes=3), position=[1.0, 0, 0])
    load(model, "load", 1.0, [1.7, 0, 0.05])
    model.add_marker("load.grip", position=[0, 0, -0.05])
    model.add_joint("shoulder", "revolute", between=["ground", "upper.root"], axis="z")
    model.add_joint("elbow", "revolute", between=["upper.tip", "lower.root"], axis="y")
    model.add_joint("grip", "fixed", between=["lower.tip", "load.grip"])
    for joint, t0, t1, angle in (("shoulder", 0.1, 0.9, 1.2), ("elbow", 0.05, 0.6, -0.9)):
        turn = {"type": "step", "t0": t0 * T, "t1": t1 * T, "y1": angle}
        model.add_driver(f"turn_{joint}", joint=joint, angle=turn)
    model.add_sensor("elbow", "reaction", joint="elbow")
    model.set_dynamics(duration=T, outputs=400, accuracy=1e-6, start="quasi-static", verify=False)
    return model


@pytest.mark.parametrize("body", ["upper", "lower"])
@pytest.mark.parametrize("off", [False, True])
@pytest.mark.slow
def test_the_vibration_of_one_link_beside_another(body, off, tmp_path):
    """Of dynamic links the difference of two estimates along a rigid motion told 8.5 % for 1.6 %;
    of quasi-static ones accelerations of modes without mass, which a run does not know, 6 %."""
    model, slow = arm_in_space(), {"deformation": "quasi-static"}
    without = with_words(model, {body: slow})
    run = flexmb.simulate(without if off else model, output=tmp_path)
    true = share_between(run, flexmb.simulate(model if off else without), "elbow")
    neighbours = ModelVariants.of(run, 600)
    one = next(one for one in neighbours.effects() if (one.name, one.body) == ("vibration", body))
    (found,) = Estimates(neighbours).estimate(one)[0]
    assert one.on != off
    assert true > 0.01
    assert found.share == pytest.approx(true, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [200.0, 800.0])
def test_a_wheel_that_spins_on_a_swinging_arm(speed, tmp_path):
    """Its axes turn beside those of the arm, by up to a radian from row to row. Splines of its tilt
    in these axes told a vibration of 20 times the range of the moment for 3.4 %."""
    model = Model("wheel on an arm")
    model.add_body("arm", **slender(0.5, 0.01, modes=3))
    load(model, "wheel", 1.0, [0.5, 0, 0], size=0.063)
    model.add_joint("swing", "revolute", between=["ground", "arm.root"], axis="z")
    model.add_joint("spin", "revolute", between=["arm.tip", "wheel"], axis="x")
    model.add_driver("swinging", joint="swing", angle="0.5*sin(4*t)")
    model.add_driver("spinning", joint="spin", angle=f"{speed}*t")
    model.add_sensor("moment", "reaction", joint="swing", quantity="moment")
    model.set_dynamics(duration=1.0, outputs=600, accuracy=1e-6, start="quasi-static", verify=False)
    run = flexmb.simulate(with_words(model, {"arm": {"deformation": "rigid"}}), output=tmp_path)
    slow = with_words(model, {"arm": {"deformation": "quasi-static"}})
    flexible = flexmb.simulate(model)
    true = {
        "deformation": share_between(run, flexible, "moment"),
        "vibration": share_between(flexmb.simulate(slow), flexible, "moment"),
    }
    neighbours = ModelVariants.of(run, 600)
    estimates = Estimates(neighbours)
    for one in neighbours.effects():
        (found,) = estimates.estimate(one)[0]
        assert found.share == pytest.approx(true[one.name], rel=0.1)


def mast(**words):
    """A mast on a cart, with a jib that follows its loads and carries a load on a rope."""
    made = Model("mast", plane="xy", gravity=[0, -9.81, 0])
    made.add_body("cart", mass=6.0, inertia=[0.1] * 3)
    made.add_body("load", mass=0.4, inertia=[1e-4] * 3, position=[0.5, 0.6, 0])
    up, slow = {"axis": "z", "angle": np.pi / 2}, {"deformation": "quasi-static"}
    made.add_marker("cart.seat", orientation=up)
    made.add_marker("ground.wall", position=[-1.0, 0, 0])
    for name, length, width, fields in (
        ("mast", 1.0, 0.008, {"orientation": up, **words}),
        ("jib", 0.5, 0.006, {"position": [0, 1.0, 0], "inertia_coupling": "constant", **slow}),
    ):
        made.add_body(
            name, mesh={"type": "beam", "length": length, "divisions": 8}, material="steel",
            sections={"all": {"type": "rectangle", "y": width, "z": 0.03, "orientation": "y"}},
            interfaces={"a": "start", "b": "end"}, modes=4, **fields,
        )  # fmt: skip
    made.add_marker("mast.top", node=8, orientation={"axis": "z", "angle": -np.pi / 2})
    made.add_joint("lane", "prismatic", between=["ground", "cart"], axis="x")
    made.add_joint("foot", "fixed", between=["cart.seat", "mast.a"])
    made.add_joint("corner", "fixed", between=["mast.top", "jib.a"])
    made.add_joint("rope", "distance", between=["jib.b", "load"])
    made.add_force("spring", "spring-damper", between=["ground.wall", "cart"], stiffness=400.0,
                   damping=2.0, free_length=1.0)  # fmt: skip
    made.add_force("push", "force", at="cart", value=["20*step(t, 0, 0, 0.3, 1)", 0, 0])
    made.add_sensor("root", "reaction", joint="foot", quantity="moment", axes="global")
    made.set_dynamics(duration=2.0, accuracy=1e-6, outputs=300, start="quasi-static")
    return made


@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
@pytest.mark.slow
def test_a_body_that_vibrates_beside_one_that_follows_its_loads(tmp_path):
    """What stiffening does to the frequency of the mast grows with time; it was left out."""
    run = flexmb.simulate(mast(inertia_coupling="constant"), output=tmp_path / "without")
    more = flexmb.simulate(mast(geometric_stiffening="full"), output=tmp_path / "with")
    true = np.abs(run["root.z"] - more["root.z"]).max() / np.ptp(run["root.z"])
    assert true > 5e-3
    kind = ("coupling and stiffening", "mast")
    (one,) = (one for one in flexmb.audit(run).effects if (one.effect, one.body) == kind)
    assert one.share == pytest.approx(true, rel=0.1)


def planar_arm(word):
    """Two rigid or flexible links, the first on a spring at its shoulder, with a load."""
    length, mass, speed = 1.0, 2700.0 * 0.03 * 0.05, 31.0
    model = Model("planar arm", plane="xy", gravity=[0, -9.81, 0])
    words = {"inertia_coupling": "full", "geometric_stiffening": "none"} if word != "rigid" else {}
    for name, x in (("upper", 0.0), ("fore", length)):
        model.add_body(
            name, mesh={"type": "beam", "length": length - 0.2 * x, "divisions": 4}, modes=2,
            material={"E": 7e10, "nu": 0.33, "density": 2700.0}, stress="none", deformation=word,
            sections={"all": {"type": "rectangle", "y": 0.03, "z": 0.05}}, position=[x, 0, 0],
            interfaces={"root": "start", "tip": "end"}, **words,
        )  # fmt: skip
    load(model, "load", 0.5 * mass, [1.8, 0, 0])
    model.add_joint("shoulder", "revolute", between=["ground", "upper.root"], axis="z")
    model.add_joint("elbow", "revolute", between=["upper.tip", "fore.root"], axis="z")
    model.add_joint("grip", "fixed", between=["fore.tip", "load"])
    inertia = 3.0 * mass * length**2
    model.add_force(
        "spring", "rotational-spring-damper", joint="shoulder", stiffness=inertia * speed**2,
        damping=0.3 * inertia * speed, free=0.5,
    )  # fmt: skip
    turn = 2.0 * np.pi / speed
    model.add_driver("bend", joint="elbow", angle={"type": "step", "t1": turn, "y1": -0.9})
    model.add_sensor("angle", "angle", joint="shoulder")
    model.set_dynamics(duration=1.5 * turn, outputs=150, accuracy=1e-4, verify=False)
    return model


@pytest.mark.seconds
def test_motions_without_inertia_that_frequencies_do_not_show(tmp_path):
    """As the elbow bends, a direction without inertia in each row has some in the mean of the rows.

    It counted as a vibration: the audit ended with a traceback, "Singular matrix".
    """
    run = flexmb.simulate(planar_arm("rigid"), output=tmp_path)
    slow, fast = (flexmb.simulate(planar_arm(word)) for word in ("quasi-static", "dynamic"))
    estimates = Estimates(ModelVariants.of(run, 600))
    shares = [
        estimates.estimate(one)[0][0].share
        for one in estimates.of.effects() if one.name == "vibration"
    ]  # fmt: skip
    assert sum(shares) == pytest.approx(share_between(slow, fast, "angle"), rel=0.3)
