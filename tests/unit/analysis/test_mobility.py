"""Counts, rank and freedoms of known mechanisms; cures by trying them; what drivers contradict.

Counts: Hong & Liu 2011, sections 1.6, 2.6-2.8, as the rank of the Jacobian gives them; the rings of
Bricard, Bennett and Sarrus have one freedom each (J. M. McCarthy, G. S. Soh, Geometric Design of
Linkages, 2nd ed., 2011, ch. 1: overconstrained linkages).
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import threadpoolctl
from generators import cloud, interface
from mechanisms import (
    Sketch,
    X,
    Z,
    cam_valve,
    crank_slider,
    excavator,
    four_bar,
    planetary,
    quick_return,
    stewart,
)
from rings import bennett, bricard, sarrus

import flexmb
from flexmb.analysis.assembly.jacobian import ConstraintRows
from flexmb.engine.compile import compile_system
from flexmb.errors import FlexmbWarning
from flexmb.model.joints.joint import JOINT_TYPES

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
    "planetary gear": (planetary, 9, 8, 1, 0),
    "planetary gear, two planets": (lambda: planetary(2), 12, 12, 1, 1),
    "cam and valve": (cam_valve, 9, 8, 1, 0),
    "Bricard": (bricard, 30, 30, 1, 1),
    "Bennett": (bennett, 18, 20, 1, 3),
    "Sarrus": (sarrus, 30, 30, 1, 1),
    "four-bar": (four_bar, 18, 20, 1, 3),
    "four-bar in its plane": (lambda: four_bar(plane="xy"), 9, 8, 1, 0),
}


@pytest.fixture(scope="module")
def found():
    with warnings.catch_warnings():  # of a coupler that repeats others, on which see below
        warnings.simplefilter("ignore", FlexmbWarning)
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
        if not exchange.new:
            section, name = exchange.joint.split(".")
            del getattr(model, section)[name]
            continue
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


def with_lengths_driven(model):
    """Distance joints exchanged for drivers of the same lengths, which start as placed."""
    for name in [name for name, joint in model.joints.items() if joint.type == "distance"]:
        between = list(model.joints.pop(name).between)
        model.add_driver(name, between=between, distance=0.01, prescribes="velocity")
    return model


def test_cylinders_and_legs_as_drivers_of_their_length():
    """Six legs fix a platform; three cylinders and the slew fix an excavator of six bodies."""
    told = flexmb.mobility(with_lengths_driven(stewart("distance")))
    assert (told.coordinates, told.count, told.rank, told.delta) == (6, 6, 6, 0)
    assert told.delta_without_drivers == 6
    model = with_lengths_driven(excavator("distance"))
    model.add_driver("turn", joint="slew", angle="0.2*t")
    told = flexmb.mobility(model)
    assert (told.coordinates, told.count - told.drivers, told.delta_without_drivers) == (36, 32, 4)
    assert (told.delta, told.redundant) == (0, 0)


def test_groups_are_the_loops_of_an_excavator(found):
    """Boom, arm; bucket cylinder and bucket linkage share the rocker's pin."""
    groups = {group.count: set() for group in found["excavator"].redundancies}
    for group in found["excavator"].redundancies:
        groups[group.count] |= {frozenset(name.split("_")[0] for name in group.joints)}
    assert groups == {
        3: {frozenset({"joints.boom"}), frozenset({"joints.arm"})},
        6: {frozenset(f"joints.{part}" for part in ("bucket", "rocker", "knee", "tooth"))},
    }


def test_gears_that_repeat_each_other(found):
    """A second planet between sun and ring: its gear with the ring says what the others say."""
    (group,) = found["planetary gear, two planets"].redundancies
    couplers = {name for name in group.joints if name.startswith("couplers.")}
    assert couplers == {
        f"couplers.{planet}_{wheel}"
        for planet in ("planet", "planet_2")
        for wheel in ("sun", "ring")
    }
    assert [str(e) for e in group.cures[0]] == ["leave out couplers.planet_2_ring (gear)"]
    told = {u.path for u in found["planetary gear, two planets"].undetermined}
    assert "couplers.planet_2_ring.planet_2_pin" in told


def test_screws_and_curves_count_as_the_tables_say():
    """A scalar coordinate takes one equation for itself, and neither is counted."""
    told = {e.path: e.count for e in flexmb.mobility(cam_valve()).equations}
    assert told["joints.lifter"] == told["joints.foot"] == 1
    sketch = Sketch("screw")
    sketch.body("nut", [0.1, 0, 0])
    sketch.joint("thread", "screw", "ground", "nut", [0, 0, 0], axis=X, pitch=0.01)
    told = flexmb.mobility(sketch.model)
    assert (told.count, told.delta) == (5, 1)
    assert told.motions[0].sentence == "nut can move as a screw about x through its joint thread"


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
    Cq = ConstraintRows(compiled).evaluate(compiled.initial_q).Cq
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
    model.set_assembly()
    told = flexmb.mobility(model)
    assert (told.rank, told.delta, told.singular) == (17, 1, False)


def test_small_matrices_are_decomposed_by_one_thread(monkeypatch):
    """On a busy machine several would wait for each other."""
    threads, svd = set(), np.linalg.svd

    def seen(*words, **options):
        libraries = threadpoolctl.threadpool_info()
        threads.update(one["num_threads"] for one in libraries if one["user_api"] == "blas")
        return svd(*words, **options)

    monkeypatch.setattr(np.linalg, "svd", seen)
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        flexmb.mobility(crank_slider("RSUT"))
    assert threads <= {1}
