"""Free and idle motions in words, singular poses, locked mechanisms, drivers in contradiction."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mechanisms import Sketch, X, Z, crank_slider, four_bar, stewart
from rings import bennett

import flexmb
from flexmb.analysis.singular_poses import singular_pose_sentence
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError, FlexmbError
from flexmb.model import Model


def test_idle_spins():
    (spin, rest) = flexmb.mobility(crank_slider("RSST")).motions
    assert spin.idle and spin.bodies == ("rod",)
    assert spin.sentence == "rod can turn about the line through its joints pin and wrist"
    assert (rest.idle, rest.count) == (False, 1)
    idle = [motion for motion in flexmb.mobility(stewart("UCS")).motions if motion.idle]
    assert [motion.bodies for motion in idle] == [(f"upper{k}",) for k in range(6)]
    assert not any(motion.idle for motion in flexmb.mobility(stewart("UTS")).motions)


def test_a_rod_of_two_parts_spins_idly_as_a_pair():
    """Two parts joined by a slide between two ball joints: neither spins alone, both do."""
    sketch = Sketch("strut")
    sketch.body("arm", [0, 0, 0])
    sketch.joint("bearing", "revolute", "ground", "arm", [0, 0, 0], axis=Z)
    sketch.body("lower", [0.3, 0.1, 0.1])
    sketch.body("upper", [0.6, 0.2, 0.2])
    sketch.joint("foot", "spherical", "ground", "lower", [0, 0, 0])
    sketch.joint("slide", "prismatic", "lower", "upper", [0.4, 0.1, 0.1], axis=[3, 1, 1])
    sketch.joint("head", "spherical", "upper", "arm", [0.9, 0.3, 0.3])
    idle = [motion for motion in flexmb.mobility(sketch.model).motions if motion.idle]
    assert [motion.bodies for motion in idle] == [("lower", "upper")]
    assert "lower and upper together can turn about the line through" in idle[0].sentence


def test_free_motions_in_words():
    sketch = Sketch("loose")
    sketch.body("ball", [0, 0, 0])
    sketch.body("bead", [1, 0, 0])
    sketch.body("stone", [2, 0, 0])
    sketch.body("flap", [3, 1, 0])
    sketch.joint("socket", "spherical", "ground", "ball", [0, 0, 1])
    sketch.joint("pin", "revolute", "ground", "flap", [3, 0, 0], axis=Z)
    sketch.joint("wire", "prismatic", "ground", "bead", [1, 0, 0], axis=X)
    assert [motion.sentence for motion in flexmb.mobility(sketch.model).motions] == [
        "ball can move by itself: 3 turns",
        "bead can slide along x",
        "stone has no joint",
        "flap can turn about z through its joint pin",
    ]


def test_a_dead_point_is_no_idle_motion():
    """Crank and rod in line: at this moment the slider stands still while they turn."""
    sketch = Sketch("dead point", plane="xy")
    for name, at in (("crank", [0.1, 0, 0]), ("rod", [0.4, 0, 0]), ("slider", [0.6, 0, 0])):
        sketch.body(name, at)
    sketch.joint("bearing", "revolute", "ground", "crank", [0, 0, 0], axis=Z)
    sketch.joint("pin", "revolute", "crank", "rod", [0.2, 0, 0], axis=Z)
    sketch.joint("wrist", "revolute", "rod", "slider", [0.6, 0, 0], axis=Z)
    sketch.joint("guide", "prismatic", "ground", "slider", [0.6, 0, 0], axis=X)
    (motion,) = flexmb.mobility(sketch.model).motions
    assert not motion.idle and motion.bodies == ("crank", "rod", "slider")


def test_a_driver_at_a_dead_point_is_no_contradiction():
    """A slider that is to pull crank and rod out of line does not say which way they turn."""
    sketch = Sketch("dead point", plane="xy")
    for name, at in (("crank", [0.1, 0, 0]), ("rod", [0.4, 0, 0]), ("slider", [0.6, 0, 0])):
        sketch.body(name, at)
    sketch.joint("bearing", "revolute", "ground", "crank", [0, 0, 0], axis=Z)
    sketch.joint("pin", "revolute", "crank", "rod", [0.2, 0, 0], axis=Z)
    sketch.joint("wrist", "revolute", "rod", "slider", [0.6, 0, 0], axis=Z)
    sketch.joint("guide", "prismatic", "ground", "slider", [0.6, 0, 0], axis=X)
    sketch.model.add_driver("push", joint="guide", stroke="-0.1*t")
    told = flexmb.mobility(sketch.model)
    assert (told.delta_without_drivers, told.rank) == (1, 8)
    assert told.notes[0].startswith("drivers.push cannot lead the mechanism out of the assembled")


def parallelogram(angle, plane=None):
    """Two equal cranks and a coupler as long as the frame."""
    sketch = Sketch("parallelogram", plane=plane)
    arm = np.array([np.cos(angle), np.sin(angle), 0])
    for name, at in (("left", arm / 2), ("coupler", arm + [1, 0, 0]), ("right", arm + [2, 0, 0])):
        sketch.body(name, at)
    for name, first, second, at in (
        ("A", "ground", "left", 0 * arm), ("B", "left", "coupler", arm),
        ("C", "coupler", "right", arm + [2, 0, 0]), ("D", "right", "ground", [2, 0, 0]),
    ):  # fmt: skip
        sketch.joint(name, "revolute", first, second, at, axis=Z)
    return sketch.model


@pytest.mark.parametrize("plane", ["xy", None])
def test_a_singular_pose_is_told_from_redundancy(plane):
    """Folded flat, a parallelogram can go on as a parallelogram or as an antiparallelogram."""
    flat, up = (flexmb.mobility(parallelogram(angle, plane)) for angle in (0.0, 0.5))
    assert flat.singular and not up.singular
    assert flat.joint_rank == flat.generic_rank - 1 == up.joint_rank - 1
    assert flat.redundancies == up.redundancies or plane is None
    assert any("the assembled pose is singular: 1 equation" in note for note in flat.notes)


# --- locked mechanisms and drivers that contradict each other ---


def test_a_locked_mechanism_is_told_with_a_cure():
    told = flexmb.mobility(four_bar(tilt=0.3))
    assert told.delta == 0
    (note,) = told.notes
    assert "locked, its joints A, B, C, D prevent every motion" in note
    assert "exchange B: revolute -> spherical and C: revolute -> cylindrical" in note
    assert "slightly off" not in note
    (note,) = flexmb.mobility(four_bar(tilt=0.01)).notes
    assert "nearly free (to 0.001), so axes or places that should fit may be slightly off" in note
    (note,) = flexmb.mobility(bennett(skewed=0.01)).notes
    assert "locked" in note


@pytest.mark.parametrize("tilt", [1e-7, 1e-6, 1e-5, 1e-3])
def test_a_mechanism_that_a_slight_tilt_locks_does_not_run(tilt):
    made = four_bar(tilt=tilt)
    made.set_dynamics(duration=1.0)
    with pytest.raises(AssemblyError, match=r"the mechanism is locked.* slightly off; .* exchange"):
        flexmb.simulate(made)


def test_equations_that_are_redundant_but_for_a_slight_tilt_do_not_run():
    """Too little to lock it, too much for round-off: 1e-9 rad fits, 1e-8 rad does not."""
    for tilt, runs in ((1e-9, True), (1e-8, False)):
        made = four_bar(tilt=tilt)
        made.set_dynamics(duration=0.1, outputs=2)
        if runs:
            flexmb.simulate(made)
        else:
            with pytest.raises(AssemblyError, match=r"redundant to 1e-09 only.* make them exact"):
                flexmb.simulate(made)


@pytest.mark.parametrize("tilt", [2e-3, 1e-2, 0.3])
def test_a_mechanism_locked_by_its_build_stays_where_it_is(tilt):
    made = four_bar(tilt=tilt)
    made.set_dynamics(duration=0.1, outputs=2)
    with pytest.warns(flexmb.FlexmbWarning, match="the mechanism is locked") as told:
        run = flexmb.simulate(made)
    np.testing.assert_allclose(run.q[-1], run.q[0], atol=1e-9)
    assert any("slightly off" in str(one.message) for one in told) == (tilt < 0.1)


@pytest.mark.slow
def test_a_long_chain_of_welds_is_no_misfit():
    """Its least singular value is small as well, but not beside the next."""
    made = Model("chain", gravity=[0, -10, 0])
    for k in range(80):
        made.add_body(f"b{k}", mass=1, inertia=[1, 1, 1], position=[k, 0, 0])
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        before = f"b{k - 1}.end" if k else "ground"
        made.add_joint(f"weld{k}", "fixed", between=[before, f"b{k}"])
    made.set_dynamics(duration=0.1, outputs=2, accuracy=1e-3)
    with pytest.warns(flexmb.FlexmbWarning, match="the mechanism is locked") as told:
        run = flexmb.simulate(made)
    assert not any("slightly off" in str(one.message) for one in told)
    np.testing.assert_allclose(
        run.reaction("weld0", on="b0").force[-1], [0, 800, 0], rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize(("tilt", "count"), [(0.0, 0), (1e-8, 1), (0.3, 0)])
def test_equations_that_are_nearly_redundant(tilt, count):
    """What a run that fails says of its last pose: 1 of 3 redundant equations feels a tilt."""
    compiled = compile_system(four_bar(tilt=tilt))
    sentence = singular_pose_sentence(compiled, compiled.initial_q, compiled.initial_q)
    assert bool(count) == bool(sentence)
    assert not count or re.match(rf"{count} .* nearly redundant there .* slightly off", sentence)


def test_a_driver_in_a_locked_mechanism():
    with pytest.raises(AssemblyError) as caught:
        flexmb.mobility(four_bar(tilt=0.3, driven=True))
    (problem,) = caught.value.problems
    assert problem.where == "drivers.motor"
    assert problem.what.startswith("has nothing to drive: the mechanism is locked, its joints A, B")
    assert "to free one motion exchange B: revolute -> spherical" in problem.what


def test_drivers_of_one_freedom():
    model = crank_slider("RSUT", driven=True)
    model.add_driver("push", joint="guide", stroke="0.2*t")
    with pytest.raises(AssemblyError) as caught:
        flexmb.mobility(model)
    (problem,) = caught.value.problems
    assert problem.where == "drivers.motor"
    assert problem.what.startswith(
        "drivers.motor and drivers.push, through joints bearing, pin, wrist, guide, prescribe the "
        "same motion, and contradict each other at t = 0.001 s; take one driver out"
    )


def test_drivers_that_agree_are_a_note():
    model = crank_slider("RSUT")
    model.add_driver("hold", joint="bearing", angle=0.0)
    model.add_driver("keep", joint="guide", stroke=0.0)
    told = flexmb.mobility(model)
    assert (told.redundant, told.delta) == (1, 0)
    assert "they agree, but one driver is enough" in told.notes[0]
    assert {u.path for u in told.undetermined} >= {"drivers.hold", "drivers.keep"}


def test_drivers_that_contradict_each_other_at_the_start():
    model = crank_slider("RSUT")
    model.add_driver("hold", joint="bearing", angle=0.0)
    model.add_driver("keep", joint="guide", stroke=-0.1)
    with pytest.raises(AssemblyError, match="contradict each other at t = 0 s"):
        flexmb.mobility(model)


def test_a_driver_that_asks_for_too_much():
    model = crank_slider("RSUT")
    model.add_driver("push", joint="guide", stroke=-2.0)
    with pytest.raises(AssemblyError) as caught:
        flexmb.mobility(model)
    first, *gaps = caught.value.problems
    assert str(first).startswith("drivers.push: the joints close alone, but not in the pose asked")
    assert gaps[1].where == "drivers.push" and "stays open by" in gaps[1].what


def test_what_has_no_joints_and_what_is_too_large():
    model = Model("free")
    model.add_body("stone", mass=1.0, inertia=[1, 1, 1])
    assert flexmb.mobility(model).delta == 6
    for k in range(100):
        model.add_body(f"stone{k}", mass=1.0, inertia=[1, 1, 1])
    with pytest.raises(FlexmbError, match="606 coordinates; the rank .* for up to 600"):
        flexmb.mobility(model)
