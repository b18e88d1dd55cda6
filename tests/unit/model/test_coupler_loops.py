"""Couplers that close a circle: ratios that hold it fast, that agree, that contradict."""

from __future__ import annotations

import pytest
from gearkit import planetary, wheels

from flexmb.errors import FlexmbWarning
from flexmb.model import Model


def linear(model, name, factors, constant=0.0):
    terms = [
        {"joint": joint, "coordinate": "angle", "factor": factor}
        for joint, factor in zip(("pin_a", "pin_b"), factors, strict=True)
    ]
    model.add_coupler(name, "linear", terms=terms, constant=constant)


def test_a_loop_whose_ratios_disagree_is_told():
    model = planetary()
    model.add_coupler("belt", "gear", joints=["sun_pin", "arm_pin"], ratio=0.5)
    (problem,) = model.problems()
    assert problem.where == "couplers.belt"
    assert problem.what == (
        'closes a loop with "sun" and "ring" in which "sun_pin.angle", "pin.angle" and '
        '"arm_pin.angle" cannot move, for its ratios multiply to -1 instead of 1; leave one of '
        "these couplers out, or make their ratios agree"
    )


def test_two_gears_between_the_same_wheels():
    model = wheels()
    for k, teeth in enumerate(([20, 10], [30, 10])):
        model.add_coupler(f"g{k}", "gear", joints=["pin_a", "pin_b"], teeth=teeth)
    (problem,) = model.problems()
    assert problem.what.startswith('closes a loop with "g0" in which "pin_a.angle" and "pin_b')
    assert "multiply to 1.5 instead of 1" in problem.what


def test_a_loop_whose_ratios_agree_is_warned_of():
    model = planetary(2)
    assert model.problems() == []
    with pytest.warns(FlexmbWarning) as told:
        model.validate()
    (sentence,) = (str(warning.message) for warning in told)
    assert sentence.startswith('couplers.ring_b repeats what "sun", "ring" and "sun_b" already')


def test_a_thread_counts_as_a_coupler_of_its_own():
    model = wheels()
    model.add_body("c", mass=1, inertia=[1, 1, 1])
    model.add_joint("thread", "screw", between=["ground", "c"], axis="x", pitch=0.5)
    terms = [
        {"joint": "thread", "coordinate": "stroke", "factor": 1},
        {"joint": "thread", "coordinate": "angle", "factor": 1},
    ]
    model.add_coupler("other", "linear", terms=terms)
    (problem,) = model.problems()
    assert problem.what.startswith('closes a loop with "joints.thread" in which "thread.angle"')


def test_equal_equations_with_different_constants_contradict():
    model = wheels()
    linear(model, "one", (1, 2), 0.5)
    linear(model, "two", (2, 4), 1.0)
    assert model.problems() == []
    linear(model, "three", (-1, -2), 0.5)
    (problem,) = model.problems()
    assert problem.where == "couplers.three"
    assert problem.what.startswith('contradicts "one": they demand the same but for another')


def test_three_couplers_of_three_coordinates_are_no_loop_unless_one_is_held():
    """x1 + x2 + x3 = 0 and x1 = x2 leave one motion; with x1 + x2 = x3 as well there is none."""
    model = planetary()
    model.couplers.clear()
    joints = ("arm_pin", "sun_pin", "pin")

    def add(name, *factors):
        terms = [
            {"joint": joint, "coordinate": "angle", "factor": factor}
            for joint, factor in zip(joints, factors, strict=True)
            if factor
        ]
        model.add_coupler(name, "linear", terms=terms)

    add("sum", 1, 1, 1)
    add("equal", 1, -1, 0)
    assert model.problems() == []
    add("other", 1, 1, -1)
    (problem,) = model.problems()
    assert 'closes a loop with "sum" and "equal" in which' in problem.what


def test_a_long_train_with_an_open_end_is_no_circle():
    """However little its last wheel turns when the first one does: here 1e-12 of it."""
    model = Model("train")
    for k in range(41):
        model.add_body(f"b{k}", mass=1, inertia=[1, 1, 1], position=[k, 0, 0])
        model.add_marker(f"ground.g{k}", position=[k, 0, 0])
        model.add_joint(f"pin{k}", "revolute", between=[f"ground.g{k}", f"b{k}"])
        if k:
            model.add_coupler(f"g{k}", "gear", joints=[f"pin{k - 1}", f"pin{k}"], teeth=[10, 20])
    assert model.problems() == []
    model.add_coupler("back", "gear", joints=["pin0", "pin3"], teeth=[10, 70])
    assert model.problems()[0].where == "couplers.back"


def test_an_equation_of_three_terms_locks_what_the_others_combine_to():
    model = wheels()
    model.add_body("c", mass=1, inertia=[1, 1, 1])
    model.add_joint("pin_c", "revolute", between=["ground", "c"])
    linear(model, "opposite", (1.0, 1.0))
    joints = ("pin_a", "pin_b", "pin_c")
    terms = [{"joint": joint, "coordinate": "angle", "factor": 2.0} for joint in joints]
    model.add_coupler("sum", "linear", terms=terms)
    (problem,) = model.problems()
    assert problem.where == "couplers.sum"
    assert 'in which "pin_c.angle" cannot move' in problem.what
