"""Counts, rank and freedoms of known mechanisms; cures by trying them; what drivers contradict.

Counts: Hong & Liu 2011, sections 1.6, 2.6-2.8, as the rank of the Jacobian gives them; the rings of
Bricard, Bennett and Sarrus have one freedom each (J. M. McCarthy, G. S. Soh, Geometric Design of
Linkages, 2nd ed., 2011, ch. 1: overconstrained linkages).
"""

from __future__ import annotations

import numpy as np
import pytest
from generators import cloud, interface
from mechanisms import (
    Sketch,
    X,
    Z,
    bennett,
    bricard,
    crank_slider,
    excavator,
    four_bar,
    quick_return,
    sarrus,
    stewart,
)

import flexmb
from flexmb.analysis.rows import rows_at
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError, FlexmbError
from flexmb.model import Model
from flexmb.model.joints import JOINT_TYPES

# name: model, coordinates, equations, freedoms, redundant equations
KNOWN = {
    "R-S-U-T": (lambda: crank_slider("RSUT"), 18, 17, 1, 0),
    "R-S-S-T": (lambda: crank_slider("RSST"), 18, 16, 2, 0),
    "massless rod": (lambda: crank_slider("R-T"), 12, 11, 1, 0),
    "R-R-R-T": (lambda: crank_slider("RRRT"), 18, 20, 1, 3),
    "R-S-C-T": (lambda: crank_slider("RSCT"), 18, 17, 1, 0),
    "excavator": (lambda: excavator("RTR"), 72, 80, 4, 12),
    "excavator, U-C-U": (lambda: excavator("UCU"), 72, 68, 4, 0),
    "excavator, lengths held": (lambda: excavator("distance"), 36, 35, 1, 0),
    "excavator, lengths free": (lambda: excavator("none"), 36, 32, 4, 0),
    "Stewart 6-UTS": (lambda: stewart("UTS"), 78, 72, 6, 0),
    "Stewart 6-UCS": (lambda: stewart("UCS"), 78, 66, 12, 0),
    "platform, lengths held": (lambda: stewart("distance"), 6, 6, 0, 0),
    "quick-return A": (lambda: quick_return("A"), 15, 14, 1, 0),
    "quick-return B": (lambda: quick_return("B"), 12, 11, 1, 0),
    "quick-return C": (lambda: quick_return("C"), 9, 8, 1, 0),
    "Bricard": (bricard, 30, 30, 1, 1),
    "Bennett": (bennett, 18, 20, 1, 3),
    "Sarrus": (sarrus, 30, 30, 1, 1),
    "four-bar": (four_bar, 18, 20, 1, 3),
    "four-bar in its plane": (lambda: four_bar(plane="xy"), 9, 8, 1, 0),
}


@pytest.fixture(scope="module")
def found():
    return {name: flexmb.mobility(make()) for name, (make, *_) in KNOWN.items()}


@pytest.mark.parametrize("name", KNOWN)
def test_counts(found, name):
    _, coordinates, equations, freedoms, redundant = KNOWN[name]
    told = found[name]
    assert (told.coordinates, told.count) == (coordinates, equations)
    assert (told.delta, told.redundant) == (freedoms, redundant)
    assert sum(group.count for group in told.redundancies) == redundant
    assert not told.singular


def exchanged(model, cure):
    """The model after the exchanges that are told."""
    for exchange in cure:
        name = exchange.joint.removeprefix("joints.")
        old = model.joints.pop(name)
        axes = {
            word: given or getattr(old, word)
            for word, given in (("axis", exchange.axis), ("second_axis", exchange.second_axis))
        }
        if exchange.new == "spherical":
            axes = {}
        axes = {word: list(axis) for word, axis in axes.items() if axis is not None}
        model.add_joint(name, exchange.new, between=list(old.between), **axes)
    return model


@pytest.mark.parametrize("name", [name for name, row in KNOWN.items() if row[4]])
def test_every_cure_removes_the_redundancy_and_no_freedom_is_added(found, name):
    """The proposed exchanges are made, one cure of each group, and the new model is counted."""
    groups = found[name].redundancies
    assert all(group.cures for group in groups)
    for which in range(max(len(group.cures) for group in groups)):
        model = KNOWN[name][0]()
        for group in groups:
            model = exchanged(model, group.cures[min(which, len(group.cures) - 1)])
        told = flexmb.mobility(model)
        assert (told.redundant, told.delta) == (0, KNOWN[name][3])


def test_the_planar_crank_slider_is_cured_by_a_ball_and_a_cylindrical_pin(found):
    (group,) = found["R-R-R-T"].redundancies
    assert group.joints == ("joints.bearing", "joints.pin", "joints.wrist", "joints.guide")
    assert [[(e.joint, e.new) for e in cure] for cure in group.cures] == [
        [("joints.pin", "in-line")],
        [("joints.pin", "spherical"), ("joints.wrist", "cylindrical")],
    ]


def test_groups_are_the_loops_of_an_excavator(found):
    """Boom, arm; bucket cylinder and bucket linkage share the rocker's pin."""
    groups = {group.count: set() for group in found["excavator"].redundancies}
    for group in found["excavator"].redundancies:
        groups[group.count] |= {frozenset(name.split("_")[0] for name in group.joints)}
    assert groups == {
        3: {frozenset({"joints.boom"}), frozenset({"joints.arm"})},
        6: {frozenset(f"joints.{part}" for part in ("bucket", "rocker", "knee", "tooth"))},
    }


def test_two_hinges_of_a_door():
    """The usual answer: one hinge takes the weight, the other holds across its axis only."""
    sketch = Sketch("door")
    sketch.body("door", [0.4, 0, 1])
    for name, height in (("low", 0.2), ("high", 1.8)):
        sketch.joint(name, "revolute", "ground", "door", [0, 0, height], axis=Z)
    told = flexmb.mobility(sketch.model)
    (group,) = told.redundancies
    assert (group.count, told.delta) == (5, 1)
    assert {e.new for e in group.cures[0]} == {"spherical", "in-line"}
    assert flexmb.mobility(exchanged(sketch.model, group.cures[0])).redundant == 0
    (motion,) = told.motions
    assert motion.sentence == "door can turn about the line through its joints low and high"


def test_a_driven_joint_keeps_its_coordinate():
    """Pins that are driven, or that springs are on, are exchanged for joints that have an angle."""
    model = crank_slider("RRRT", driven=True)
    for k, name in enumerate(("pin", "wrist")):
        model.add_force(f"spring{k}", "rotational-spring-damper", joint=name, stiffness=1.0)
    (group,) = flexmb.mobility(model).redundancies
    for cure in group.cures:
        for exchange in cure:
            driven = exchange.joint != "joints.guide"
            assert not driven or "angle" in JOINT_TYPES[exchange.new].coordinates
    assert group.cures


def test_what_reactions_redundancy_leaves_in_doubt(found):
    """In a plane mechanism in space: forces across the plane and moments in it; no others."""
    told = {u.path: set(u.components) for u in found["R-R-R-T"].undetermined}
    for pin in ("bearing", "pin", "wrist"):
        assert told[f"joints.{pin}"] == {"force z", "moment x", "moment y"}
    assert len(told["joints.guide"]) == 3  # one force and two moments, in axes along the guide
    assert found["R-S-C-T"].undetermined == ()
    excavator = {u.path for u in found["excavator"].undetermined}
    assert "joints.slew" not in excavator and len(excavator) == 15


def test_idle_spins(found):
    (spin, rest) = found["R-S-S-T"].motions
    assert spin.idle and spin.bodies == ("rod",)
    assert spin.sentence == "rod can turn about the line through its joints pin and wrist"
    assert (rest.idle, rest.count) == (False, 1)
    idle = [motion for motion in found["Stewart 6-UCS"].motions if motion.idle]
    assert [motion.bodies for motion in idle] == [(f"upper{k}",) for k in range(6)]
    assert not any(motion.idle for motion in found["Stewart 6-UTS"].motions)


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
    sketch.joint("socket", "spherical", "ground", "ball", [0, 0, 1])
    sketch.joint("wire", "prismatic", "ground", "bead", [1, 0, 0], axis=X)
    assert [motion.sentence for motion in flexmb.mobility(sketch.model).motions] == [
        "ball can move by itself: 3 turns",
        "bead can slide along x",
        "stone is held by no joint",
    ]


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


def flexible_rod(m):
    """The planar crank-slider in space with a rod of m modes."""
    model, rng = crank_slider("RRRT"), np.random.default_rng(3)
    rod = model.bodies.pop("rod")
    made = cloud(rng, m)
    ends = []
    for name, marker in rod.markers.items():
        end = interface(rng, f"at_{name}", m)
        end = type(end)(end.name, np.array(marker.position), end.Phi_t, end.Phi_r)
        ends.append(end)
    model.add_body("rod", made.flexbody("rod", ends), position=list(rod.position))
    for name in rod.markers:
        model.add_marker(f"rod.{name}", interface=f"at_{name}")
    return model


@pytest.mark.parametrize("m", [1, 2, 6])
def test_modes_take_up_redundant_equations(m):
    """As many as the modal columns have rank in the left null space of the rigid ones."""
    model = flexible_rod(m)
    told = flexmb.mobility(model)
    compiled = compile_system(model)
    Cq = rows_at(compiled, compiled.placed).Cq
    N = np.linalg.svd(np.delete(Cq, np.s_[18:], axis=1))[0][:, 17:]
    taken = np.linalg.matrix_rank(N.T @ Cq[:, 18:], tol=1e-6)
    assert (told.coordinates, told.modes, told.as_rigid) == (18 + m, m, 3)
    assert told.redundant == 3 - taken == max(0, 3 - m)
    assert any(f"modes of the flexible bodies take up {taken}" in note for note in told.notes)


def test_a_joint_spring_brings_no_equation():
    model = crank_slider("RSUT")
    model.add_force("spring", "rotational-spring-damper", joint="bearing", stiffness=1.0)
    told = flexmb.mobility(model)
    assert (told.coordinates, told.count, told.delta) == (18, 17, 1)


def test_a_gap_is_closed_first():
    """Placed with open joints the model is assembled before anything is counted."""
    model = crank_slider("RSUT")
    model.bodies["rod"] = model.bodies["rod"].model_copy(update={"position": (0.31, 0.1, 0.02)})
    told = flexmb.mobility(model)
    assert (told.rank, told.delta, told.singular) == (17, 1, False)


# --- locked mechanisms and drivers that contradict each other ---


def test_a_locked_mechanism_is_told_with_a_cure():
    told = flexmb.mobility(four_bar(tilt=0.3))
    assert told.delta == 0
    (note,) = told.notes
    assert "locked, its joints A, B, C, D hold every motion" in note
    assert "exchange B: revolute -> spherical and C: revolute -> cylindrical" in note
    assert "slightly off" not in note
    (note,) = flexmb.mobility(four_bar(tilt=0.01)).notes
    assert "nearly free, so axes or places that should fit may be slightly off" in note
    (note,) = flexmb.mobility(bennett(skewed=0.01)).notes
    assert "locked" in note


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
