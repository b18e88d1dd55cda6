"""Kinematic analyses that end early or pass something, what they say, and what they keep."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from enginekit import executed
from linkages import four_bar_angles

from flexmb.analysis import kinematics
from flexmb.analysis.singular_poses import KinematicPose
from flexmb.model import Model

CODE = """
import numpy as np
from flexmb.analysis import kinematics as module
from flexmb.analysis.kinematics import prepare_kinematics, run_kinematics
from flexmb.engine.compile import compile_system
from flexmb.errors import FlexmbError
from flexmb.flexbody import Interface
from flexmb.model import Model
from generators import cloud
from linkages import Kept, bar, four_bar, four_bar_angles, slider_crank, swept

BARS = (1.0, 2.0, 1.5, 2.2)

def keep(name, made, **fields):
    made.set_kinematics(**{"duration": 1.0, "outputs": 10, **fields})
    try:
        outcome, rows, _ = swept(made)
    except FlexmbError as error:
        found[name] = np.array(["refused", str(error)])
        return None
    found[name] = np.array([outcome.status, outcome.message, *outcome.notes])
    found[name + ".t"] = rows["t"] if rows.blocks else np.zeros(0)
    return rows

def linkage(driver="left", angle="2*pi*t", bars=BARS, crank=0.6, branch=1):
    made = four_bar(bars, (crank, *four_bar_angles(bars, crank, branch)))
    made.add_driver("motor", joint=driver, angle=angle)
    return made

keep("rocker", linkage("right"), outputs=20)

made = slider_crank(0.15, 0.45)
placed = 0.15 * np.cos(0.5) + np.sqrt(0.45**2 - (0.15 * np.sin(0.5)) ** 2)
made.add_driver("push", joint="guide", stroke=f"{float(placed)!r} + 0.1*t")
keep("dead point", made)

arm = Model("arm", plane="xy")
bar(arm, "upper", 1.0, (0, 0), 0.3)
bar(arm, "fore", 0.8, (np.cos(0.3), np.sin(0.3)), 1.1)
arm.add_joint("shoulder", "revolute", between=["ground", "upper"], axis="z")
arm.add_joint("elbow", "revolute", between=["upper.end", "fore"], axis="z")
arm.add_driver("reach", marker="fore.end", position=["1.2 + t", 0.3])
keep("reach", arm)

keep("passed", linkage(bars=(1, 2, 1, 2), angle="2*pi*t"), outputs=21)
keep("hit", linkage(bars=(1, 2, 1, 2), angle="t*(pi - 0.6)"), duration=2.0)

tied = Model("triangle", plane="xy")
tied.add_marker("ground.right", position=[1, 0, 0])
bar(tied, "one", 1.0, (0, 0), np.pi / 3)
bar(tied, "two", 1.0, (1, 0), 2 * np.pi / 3)
tied.add_joint("a", "revolute", between=["ground", "one"], axis="z")
tied.add_joint("b", "revolute", between=["ground.right", "two"], axis="z")
tied.add_joint("c", "revolute", between=["one.end", "two.end"], axis="z")
tied.add_driver("motor", joint="a", angle="0.1*t")
keep("locked", tied)
del tied.drivers["motor"]
tied.add_driver("motor", joint="a", angle="0.5*max(0, (t - 0.4)*(0.5 - t))")
keep("locked later", tied, outputs=20)

free = linkage()
del free.drivers["motor"]
keep("no driver", free)
loose = linkage()
loose.add_body("stone", mass=1.0, inertia=[1, 1, 1])
keep("free body", loose)

stated = linkage()
stated.add_state("warmth", rate="1 - warmth", start=0)
keep("states", stated)

twice = linkage(angle="t")
twice.add_driver("other", joint="right", angle="t")
keep("rates apart", twice)
twice = linkage(angle="t**2")
twice.add_driver("other", joint="right", angle="t**2")
keep("drift apart", twice)
twice = linkage(bars=(1, 2, 1, 2), angle="0.3*t")
bump = "0.3*t + 0.5*max(0, (t - 0.4)*(0.5 - t))"  # agrees at most times
twice.add_driver("other", joint="right", angle=bump)
keep("bump apart", twice, outputs=20)

keep("leap", linkage(angle="0.3*t + 0.1*(1 + sign(t - 0.55))"))
keep("root", linkage(angle="sqrt(0.55 - t)*0.2"))
rows = keep("kink", linkage(angle="max(0, 2*(t - 0.55))"))
found["kink.v"] = rows["v"][:, 5]
rows = keep("coarse", linkage(angle="2*pi*t"), outputs=2)
found["coarse.crank"] = rows["q"][:, [3, 6]]

flexible = Model("flexible")
rng = np.random.default_rng(5)
body = cloud(rng, 3).flexbody("beam", [Interface("root", np.zeros(3), *rng.normal(size=(2, 3, 3)))])
flexible.add_body("beam", body)
flexible.add_joint("hinge", "revolute", between=["ground", "beam.root"], axis="z")
flexible.add_driver("motor", joint="hinge", angle="3*t")
rows = keep("flexible", flexible, outputs=2)
found["flexible.q"], found["flexible.v"] = rows["q"], rows["v"]

wheel = Model("wheel", gravity=[0, -10, 0])
wheel.add_body("wheel", mass=2, inertia=[1, 1, 1])
wheel.add_joint("hinge", "revolute", between=["ground", "wheel"], axis="z")
wheel.add_driver("motor", joint="hinge", angle="20*t")
wheel.add_sensor("bearing", "reaction", joint="hinge", axes="global")
wheel.add_sensor("torque", "reaction", driver="motor", quantity="moment")
wheel.add_sensor("turned", "orientation", of="wheel")
wheel.add_sensor("load", "expression", value="hypot(bearing.x, bearing.y)", unit="N")
wheel.add_force("drag", "torque", at="wheel", value=[0, 0, "-0.05*load"])
keep("wheel", wheel)
_, _, columns = swept(wheel)
for name in ("torque.z", "load", "turned.gamma"):
    found[name] = columns[name]

sled = Model("sled", plane="xy", gravity=[0, -10, 0])
sled.add_body("sled", mass=2, inertia=[1, 1, 1])
sled.add_joint("guide", "prismatic", between=["ground", "sled"], axis="x")
sled.add_driver("push", joint="guide", stroke="0.5*t - 0.4*t**2")
sled.add_force("rubbing", "joint-friction", joint="guide", dynamic=0.3, stiffness=1e7)
rows = keep("sled", sled)
push = compile_system(sled).layout.reactions.index("drivers.push")
found["sled.push"], found["sled.v"] = rows["reactions"][:, 12 * push], rows["v"][:, 0]

module._CHUNK_WORK = 4 * 18  # four points of a four-bar
made = linkage()
made.set_kinematics(duration=1.0, outputs=10)
compiled, sink = compile_system(made), Kept(interrupt_at=2)
outcome = run_kinematics(prepare_kinematics(compiled, made), sink)
found["stopped"] = np.array([outcome.status, outcome.message])
found["stopped.t"] = sink["t"]

ready = prepare_kinematics(compiled, made)
sink = Kept()

def switched(block):
    "After the first chunk the linkage finds itself in its other pose, moving as before."
    sink.blocks.append(block)
    ready.pose.state.q[:] = placed_other(float(ready.pose.state.t[0]))

def placed_other(t):
    crank = 0.6 + 2 * np.pi * t
    return compile_system(four_bar(BARS, (crank, *four_bar_angles(BARS, crank, -1)))).initial_q

sink.append = switched
outcome = run_kinematics(ready, sink)
found["branch"] = np.array([outcome.status, outcome.message])
"""


@pytest.fixture(scope="module")
def runs():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kinematics, "_CHUNK_WORK", kinematics._CHUNK_WORK)  # set in between
        return executed(CODE)


def said(runs, name, status, *words):
    """The message of a run, which must contain these words."""
    assert runs[name][0] == status, runs[name]
    for word in words:
        assert word in runs[name][1], runs[name][1]
    return str(runs[name][1])


def test_a_rocker_driven_beyond_its_limit_is_a_singular_pose(runs):
    """At the limit crank and coupler lie upon each other: cos φ = ((b − a)² − c² − d²)/(2cd)."""
    text = said(
        runs, "rocker", "failed", "singular pose", "joints.crank_pin: place", "drivers.motor",
        "drive joints.left.angle",
    )  # fmt: skip
    limit = np.arccos((1.0 - 1.5**2 - 2.2**2) / (2 * 1.5 * 2.2))
    turn = (limit - four_bar_angles((1.0, 2.0, 1.5, 2.2), 0.6)[1]) % (2 * np.pi)
    assert float(text.split()[3]) == pytest.approx(turn / (2 * np.pi), abs=1e-4)
    assert len(runs["rocker.t"]) == 1 + int(turn / (2 * np.pi) * 20)


def test_a_slider_pushed_beyond_its_dead_point(runs):
    text = said(runs, "dead point", "failed", "dead point", "drivers.push cannot lead it")
    assert "drive joints.main.angle, which moves most there, instead of drivers.push" in text
    reach = 0.6 - (0.15 * np.cos(0.5) + np.sqrt(0.45**2 - (0.15 * np.sin(0.5)) ** 2))
    assert float(text.split()[3]) == pytest.approx(reach / 0.1, abs=1e-4)


def test_an_arm_led_beyond_its_reach(runs):
    """Stretched: the hand is where both links are in line, at √(1.8² − 0.3²)."""
    out = np.sqrt(1.8**2 - 0.3**2) - 1.2
    text = said(runs, "reach", "failed", "limit of its reach", "drivers.reach cannot lead it")
    assert float(text.split()[3]) == pytest.approx(out, abs=1e-4)


def test_a_parallelogram_passes_the_flat_pose_and_says_so(runs):
    assert runs["passed"][0] == "finished"
    notes = [note for note in runs["passed"][2:] if "passed a singular pose" in note]
    assert len(notes) == 2
    for note, flat in zip(notes, (np.pi - 0.6, 2 * np.pi - 0.6), strict=True):
        before, after = float(note.split()[3]), float(note.split()[6])
        assert before < flat / (2 * np.pi) < after
        assert "joints.rocker_pin" in note and "two ways" in note


def test_a_point_in_the_flat_pose_has_no_motion(runs):
    said(runs, "hit", "failed", "at t = 0.99", "singular pose", "drive joints.right.angle")
    assert len(runs["hit.t"]) == 5


def test_a_locked_mechanism_names_driver_and_joints(runs):
    words = ("drivers.motor: has nothing to drive", "locked", "joints a, b, c prevent")
    said(runs, "locked", "refused", *words)


def test_a_driver_that_rests_at_first_in_a_locked_mechanism(runs):
    words = ("drivers.motor asks", "joints.c", "do not allow: the mechanism is locked")
    said(runs, "locked later", "failed", "at t = 0.4", *words)


def test_motions_without_driver_are_named(runs):
    said(runs, "no driver", "refused", "leave 1 motion free", "add a driver of joints.left.angle")
    said(runs, "free body", "refused", "leave 3 motions free", "bodies.stone")


def test_states_are_refused(runs):
    said(runs, "states", "refused", "states.warmth: is integrated", "[dynamics]")


@pytest.mark.parametrize("name", ["rates apart", "drift apart"])
def test_conflicting_drivers_are_both_named(runs, name):
    said(runs, name, "refused", "drivers.motor and drivers.other", "contradict each other")


def test_drivers_that_agree_at_first_are_both_named(runs):
    said(runs, "bump apart", "failed", "at t = 0.4", "drivers.motor and drivers.other ask")
    assert len(runs["bump apart.t"]) == 8  # at 0.4 max begins to rise: its rate is the mean


def test_a_driver_that_jumps_is_named(runs):
    said(runs, "leap", "refused", "drivers.motor.angle", "jumps at t = 0.55 s", "a step")


def test_a_function_that_ends_is_named(runs):
    said(runs, "root", "refused", "drivers.motor.angle", "not finite at t = 0.55 s")


def test_a_kink_in_a_driver_is_followed(runs):
    assert runs["kink"][0] == "finished"
    np.testing.assert_allclose(runs["kink.v"], 2.0 * (runs["kink.t"] > 0.55), atol=1e-12)


def test_coarse_outputs_follow_the_same_motion(runs):
    assert runs["coarse"][0] == "finished"
    half = 0.5 * (0.6 + 2 * np.pi * runs["coarse.t"])
    turned = np.column_stack([np.cos(half), np.sin(half)])
    np.testing.assert_allclose(runs["coarse.crank"], turned, atol=1e-12)


def test_flexible_bodies_are_held_undeformed(runs):
    assert runs["flexible"][0] == "finished"
    assert any("keeps bodies.beam undeformed" in note for note in runs["flexible"][2:])
    assert not runs["flexible.q"][:, 7:].any() and not runs["flexible.v"][:, 6:].any()
    np.testing.assert_allclose(runs["flexible.v"][:, 5], 3.0, atol=1e-12)


def test_an_interruption_keeps_the_points_until_then(runs):
    assert tuple(runs["stopped"]) == ("stopped", "stopped by the user at t = 0.7 s")
    np.testing.assert_allclose(runs["stopped.t"], np.arange(8) / 10, atol=1e-15)


def test_a_change_of_branch_is_an_error(runs):
    said(runs, "branch", "failed", "changed its branch between t = 0.3", "assembly.guess")


def test_forces_over_reactions_and_all_sensors(runs):
    """A wheel of 20 N whose bearing drags with a twentieth of its load, turned ten times 20 rad."""
    assert runs["wheel"][0] == "finished"
    np.testing.assert_allclose(runs["load"], 20.0, rtol=1e-12)
    np.testing.assert_allclose(runs["torque.z"], 1.0, rtol=1e-12)
    np.testing.assert_allclose(runs["turned.gamma"], np.linspace(0.0, 20.0, 11), atol=1e-9)


def test_friction_in_a_joint_is_pushed_against(runs):
    """m v̇ = F − μ m g sign v, along x, which is the joint's own axis in a plane; the first point
    is that of the free bristle."""
    assert runs["sled"][0] == "finished"
    force = 2.0 * -0.8 + 0.3 * 20.0 * np.sign(runs["sled.v"])
    np.testing.assert_allclose(runs["sled.push"][1:], force[1:], rtol=1e-9)


def test_the_rate_of_a_stroke_is_that_of_the_distance_along_the_axis():
    """Over the size of the model; both ends move."""
    R = np.eye(3)[:, [1, 2, 0]]  # the axis z of the marker along x
    ends = [{"R": R, "vx": np.array([v, 5.0, 0.0]), "om": np.zeros(3)} for v in (2.0, 3.5)]
    pose = SimpleNamespace(model=Model("any"), compiled=SimpleNamespace(length=10.0))
    assert KinematicPose._joint_rate(pose, *ends, "stroke") == pytest.approx(0.15)
