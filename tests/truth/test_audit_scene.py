"""The audit of what a whole scene leaves out: stops, contacts, motion out of the plane."""

from __future__ import annotations

import numpy as np
import pytest
from truth.test_audit import beam_fields
from truth.test_audit_machines import UPRIGHT, load, slender

import flexmb
from flexmb.model import Model
from flexmb.workflow.effect import OUT_OF_PLANE
from flexmb.workflow.effect_estimates import Estimates
from flexmb.workflow.neighbours import ModelVariants
from flexmb.workflow.scene_effects import scene_effects


def pendulum(stops, lower=-2.0):
    """A bar that falls from the horizontal: without a stop to -π."""
    model = Model("pendulum", gravity=[0, -9.81, 0], plane="xy")
    model.add_body("bar", mass=1.0, center=[0.5, 0, 0], inertia=[0.01, 0.1, 0.1])
    model.add_joint("hinge", "revolute", between=["ground", "bar"], axis="z")
    model.add_force("stop", "rotational-stop", joint="hinge", lower=lower, stiffness=1e4)
    model.add_sensor("angle", "angle", joint="hinge")
    model.set_effects(stops=stops)
    model.set_dynamics(duration=1.2, outputs=200, accuracy=1e-5)
    return model


def ball(contact, height=0.3):
    """A ball of radius 0.1 m that falls onto a floor."""
    model = Model("ball", gravity=[0, 0, -9.81])
    model.add_body("ball", mass=1.0, inertia=[1e-3] * 3, position=[0, 0, height])
    model.add_force(
        "floor", "contact", between=["ground", "ball"], stiffness=1e5, restitution=0.5,
        shapes=[{"type": "plane", "axis": "z"}, {"type": "sphere", "radius": 0.1}],
    )  # fmt: skip
    model.add_sensor("place", "position", of="ball")
    model.set_effects(contact=contact)
    model.set_dynamics(duration=0.25, outputs=200, accuracy=1e-5)
    return model


def audited(model, effect, folder):
    run = flexmb.simulate(model, output=folder)
    made = flexmb.audit(run)
    return run, made, next(one for one in made.effects if one.effect == effect)


def test_travel_beyond_a_stop_that_is_left_out(tmp_path):
    run, made, one = audited(pendulum(False), "stops", tmp_path)
    beyond = -2.0 - run["angle"].min()
    assert (one.on, one.verdict, one.sensor) == (False, "missing", "forces.stop")
    assert one.indicator == "stop passed by 1.1 rad"
    assert one.share == pytest.approx(beyond / np.ptp(run["angle"]), rel=1e-6)
    assert not made.passed and "stops is left out" in made.sentence()


def test_a_stop_that_is_never_met_may_stay_off(tmp_path):
    _, made, one = audited(pendulum(False, lower=-3.5), "stops", tmp_path)
    assert (one.verdict, one.indicator, one.share) == ("may stay off", "never met", 0.0)
    assert made.passed


@pytest.mark.seconds
def test_a_stop_that_is_hit_is_needed(tmp_path):
    _, _, one = audited(pendulum(True), "stops", tmp_path)
    assert one.on and one.verdict == "needed" and "passed by 0.0" in one.indicator


def test_overlap_in_a_contact_that_is_left_out(tmp_path):
    """It falls by g t²/2, of which what is below 0.1 m is inside the floor."""
    _, made, one = audited(ball(False), "contact", tmp_path)
    fall = 9.81 * 0.25**2 / 2
    assert (one.on, one.verdict) == (False, "missing")
    assert one.share == pytest.approx((fall - 0.2) / fall, rel=1e-3)
    assert not made.passed


def test_a_ball_that_never_lands_needs_no_floor(tmp_path):
    _, made, one = audited(ball(False, height=1.0), "contact", tmp_path)
    assert one.verdict == "may stay off" and made.passed


def tilted(joint, planar=True):
    """A bar whose axes of inertia are tilted turns: J_xz ω² pulls it out of its plane."""
    model = Model("tilted", plane="xy")
    model.add_body("bar", mass=1.0, center=[0.5, 0, 0], angular_velocity=[0, 0, 3],
                   inertia=[[0.02, 0, 0.02], [0, 0.1, 0], [0.02, 0, 0.1]])  # fmt: skip
    model.add_joint("hinge", joint, between=["ground", "bar"],
                    **({"axis": "z"} if joint == "revolute" else {}))  # fmt: skip
    model.add_sensor("end", "position", of="bar.center")
    model.set_effects(planar=planar)
    model.set_dynamics(duration=0.3, outputs=100, accuracy=1e-5)
    return model


def test_a_plane_that_joints_hold_leaves_out_nothing(tmp_path):
    _, made, one = audited(tilted("revolute"), "motion out of the plane", tmp_path)
    assert not one.on and one.verdict == "may stay off"
    assert one.share < 1e-9 and made.passed


def scotch_yoke():
    """A crank pin in the slot of a yoke; in space the pin and the guide both hold it along z."""
    model = Model("Scotch yoke", plane="xy")
    model.add_body("crank", mass=0.5, inertia=[1e-3, 1e-3, 1e-3])
    model.add_marker("crank.pin", position=[0.05, 0, 0])
    model.add_body("yoke", mass=0.6, inertia=[1e-4, 1e-4, 1e-4], position=[0.05, 0, 0])
    model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    model.add_joint("slot", "in-line", between=["yoke", "crank.pin"], axis="y")
    model.add_joint("guide", "prismatic", between=["ground", "yoke"], axis="x")
    model.add_driver("motor", joint="bearing", angle="60*t")
    model.add_force("load", "force", at="yoke", value=[-200, 0, 0])
    model.add_sensor("guide", "reaction", joint="guide")
    model.add_sensor("torque", "reaction", driver="motor", quantity="moment")
    model.set_dynamics(duration=0.2, outputs=100, accuracy=1e-5)
    return model


def test_reactions_that_space_leaves_open_are_not_changed_by_the_plane(tmp_path):
    """The guide does not carry the load: its reaction is round-off in the plane and in space."""
    _, made, one = audited(scotch_yoke(), "motion out of the plane", tmp_path)
    assert one.share < 1e-9 and made.passed


def test_what_a_plane_leaves_out(tmp_path):
    """On a ball joint nothing holds it: against the same scene in space."""
    _, made, one = audited(tilted("spherical"), "motion out of the plane", tmp_path / "plane")
    space = flexmb.simulate(tilted("spherical", planar=False), output=tmp_path / "space")
    size = max(np.ptp(space[f"end.{axis}"]) for axis in "xyz")
    true = np.abs(space["end.z"]).max() / size
    assert true > 0.01
    assert one.share == pytest.approx(true, rel=0.3)
    assert one.verdict == "missing" and not made.passed


@pytest.mark.parametrize(
    ("joint", "verdict"), [("spherical", "needed"), ("revolute", "could be off")]
)
def test_what_a_run_in_space_shows_of_its_plane(joint, verdict, tmp_path):
    """The end of the bar is 1 m/2 from the joint: it rises by half of its length times the tilt."""
    run, _, one = audited(tilted(joint, planar=False), "motion out of the plane", tmp_path)
    assert one.on and one.verdict == verdict
    assert one.share == pytest.approx(2.0 * np.abs(run["end.z"]).max(), rel=0.1, abs=1e-9)


def hammer():
    """A ball that falls onto the middle of a beam on two supports, symmetric about its plane."""
    model = Model("hammer", gravity=[0, -9.81, 0], plane="xy")
    model.add_body("beam", deformation="dynamic", **beam_fields(modes=12))
    model.add_marker("beam.middle", node=10)
    model.add_body("ball", shape={"type": "sphere", "radius": 0.05}, mass=5.0,
                   position=[0.5, 0.11, 0])  # fmt: skip
    model.add_joint("pin", "revolute", between=["ground", "beam.root"], axis="z")
    model.add_joint("roller", "in-plane", between=["ground", "beam.tip"], axis="y")
    model.add_force(
        "blow", "contact", between=["ball", "beam"], stiffness=3e9, restitution=0.6,
        shapes=[{"type": "sphere", "radius": 0.05}, {"type": "points", "nodes": [10]}],
    )  # fmt: skip
    model.add_sensor("middle", "position", of="beam.middle")
    model.add_sensor("force", "reaction", force="blow", on="I", axes="global")
    model.set_dynamics(duration=0.13, outputs=300, accuracy=1e-3)
    return model


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
def test_other_modes_in_the_plane_are_no_motion_out_of_it(tmp_path):
    """Modes in space are others than those in the plane, by which blows come at other times."""
    _, _, one = audited(hammer(), "motion out of the plane", tmp_path)
    assert not one.on and one.verdict == "may stay off"
    assert one.share < 1e-4


def swung(planar=True):
    """A beam that is swung, with a load whose axes of inertia are tilted on its end."""
    model = Model("swung", plane="xy")
    model.add_body("beam", **beam_fields(modes=6, deformation="dynamic"))
    model.add_body("load", mass=0.5, position=[1, 0, 0],
                   inertia=[[0.02, 0, 0.012], [0, 0.03, 0], [0.012, 0, 0.03]])  # fmt: skip
    model.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    model.add_joint("grip", "fixed", between=["beam.tip", "load"])
    model.add_driver("motor", joint="hub", angle={"type": "step", "y1": 1.5, "t1": 0.3})
    model.add_sensor("end", "position", of="load", relative_to="beam.root", axes="beam.root")
    model.set_effects(planar=planar)
    model.set_dynamics(duration=0.4, outputs=200, accuracy=1e-5)
    return model


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
def test_what_a_plane_leaves_out_of_bending(tmp_path):
    """Against the same beam in space."""
    _, _, one = audited(swung(), "motion out of the plane", tmp_path / "plane")
    plane, space = (
        flexmb.simulate(swung(planar=on), output=tmp_path / f"{on}") for on in (True, False)
    )
    size = max(np.ptp(space[f"end.{axis}"]) for axis in "xyz")
    true = max(np.abs(space[f"end.{axis}"] - plane[f"end.{axis}"]).max() for axis in "xyz") / size
    assert true > 0.01
    assert one.share == pytest.approx(true, rel=0.1)


def lift_in_a_plane():
    """A beam of solid elements between a lift and a strut."""
    model = Model("lift in a plane", plane="xy")
    material = {"E": 2.8e9, "nu": 0.38, "density": 1410.0}
    mesh = {"type": "box", "size": [0.6, 0.012, 0.03], "divisions": [10, 1, 1]}
    model.add_body("beam", mesh=mesh, material=material, modes=4,
                   interfaces={"root": "x0", "tip": "x1"})  # fmt: skip
    foot = {"position": [0.6, -0.5, 0]}
    model.add_body("strut", **slender(0.5, 0.006, divisions=6), **foot, orientation=UPRIGHT)
    model.add_marker("ground.foot", **foot)
    load(model, "lift", 0.5, [0, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "lift"], axis="y")
    ends = {"a": "lift beam.root", "b": "beam.tip strut.tip", "c": "ground.foot strut.root"}
    for name, between in ends.items():
        model.add_joint(name, "revolute", between=between.split(), axis="z")
    motion = {"type": "havsin", "t0": 0, "t1": 0.15, "y1": 0.15}
    model.add_driver("motor", joint="rail", stroke=motion)
    model.add_sensor("b", "reaction", joint="b")
    model.set_dynamics(duration=0.2, outputs=200, accuracy=1e-5, verify=False)
    return model


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
def test_modes_that_a_plane_has_no_room_for_are_no_motion_out_of_it(tmp_path):
    """As many modes in space have fewer of them in the plane, which nothing leaves."""
    run = flexmb.simulate(lift_in_a_plane(), output=tmp_path)
    neighbours = ModelVariants.of(run, 200)
    effect = next(one for one in scene_effects(neighbours) if one.name == OUT_OF_PLANE)
    assert Estimates(neighbours).estimate(effect)[0][0].share < 1e-6


@pytest.mark.seconds
@pytest.mark.parametrize("words", [{}, {"deformation": "rigid"}], ids=["on", "off"])
def test_deformation_of_a_plate_that_stretches_is_not_that_of_the_linear_plate(words, tmp_path):
    """A clamped circle deflects by w (1 + 0.488 w²/h²) = p a⁴/(64 D): 2.1 mm, linear 3.3 mm.

    Timoshenko & Woinowsky-Krieger, Theory of Plates and Shells, §97.
    """
    a, h, p, stiffness = 0.2, 0.002, 2e4, 210e9 * 0.002**3 / 12 / (1 - 0.3**2)
    model = Model("diaphragm")
    model.add_body(
        "plate", mesh={"type": "disk", "radius": a, "divisions": [8, 24]}, modes=8,
        material={"E": 210e9, "nu": 0.3, "density": 7850}, interfaces={"rim": "outer"},
        sections={"surface": {"type": "shell", "thickness": h}}, membrane_forces="full",
        loads={"gas": {"type": "pressure", "group": "surface", "pressure": 1.0}}, **words,
    )  # fmt: skip
    model.add_marker("plate.middle", position=[0, 0, 0])
    model.add_joint("rim", "fixed", between=["ground", "plate.rim"])
    push = f"{p / 2}*(1 - cos(10*pi*t))"
    model.add_force("gas", "body-load", body="plate", load="gas", value=push)
    model.add_sensor("middle", "position", of="plate.middle")
    run = flexmb.simulate(
        model, duration=0.2, accuracy=1e-4, outputs=100, verify=False, output=tmp_path
    )
    (row,) = (one for one in flexmb.audit(run).effects if one.effect == "deformation")
    w = np.roots([0.488 / h**2, 0.0, 1.0, -p * a**4 / 64 / stiffness])
    if words:
        assert row.verdict == "missing" and "linear deformations" in row.why
    else:
        wanted = float(w[np.abs(w.imag).argmin()].real)
        assert float(row.value.split()[0]) == pytest.approx(wanted, rel=0.1)


def double_pendulum():
    """Two bars that fall from the horizontal; the frame of the second one is off its pin."""
    model = Model("double pendulum", gravity=[0, -9.81, 0], plane="xy")
    for name, x in (("a", 0.5), ("b", 1.5)):
        model.add_body(name, mass=1.0, inertia=[0.01, 0.1, 0.1], position=[x, 0, 0])
        model.add_marker(f"{name}.in", position=[-0.5, 0, 0])
        model.add_marker(f"{name}.out", position=[0.5, 0, 0])
    model.add_joint("first", "revolute", between=["ground", "a.in"], axis="z")
    model.add_joint("second", "revolute", between=["a.out", "b.in"], axis="z")
    model.add_sensor("tip", "position", of="b.out")
    model.add_sensor("pin", "reaction", joint="first")
    model.set_dynamics(duration=1.5, outputs=200, accuracy=1e-5, verify=False)
    return model


def test_gravity_that_is_the_whole_motion_contributes_all_of_it(tmp_path):
    """Without gravity nothing moves. Small motions about the run tell half of the tip."""
    _, _, one = audited(double_pendulum(), "gravity", tmp_path)
    assert one.shares["tip"] == pytest.approx(
        1.0, abs=0.02
    )  # of the range; the change is from rest
    assert one.shares["pin"] == pytest.approx(1.0, abs=0.1)


@pytest.mark.seconds
def test_a_stop_that_turns_a_pendulum_back_is_told_by_a_run_without(tmp_path):
    model = pendulum(True, lower=-1.0)
    run, _, one = audited(model, "stops", tmp_path)
    model.set_effects(stops=False)
    free = flexmb.simulate(model)
    change = np.abs(free["angle"] - run["angle"]).max() / np.ptp(free["angle"])
    assert one.share == pytest.approx(change, rel=1e-3) and not one.why
