"""Drivers that cannot be: each is told with its place, before anything runs."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.engine.compile import compile_system
from flexmb.errors import SceneError
from flexmb.model import Model


def arm(plane="xy"):
    model = Model("arm", plane=plane)
    for name, x in (("a", 0.0), ("b", 1.0)):
        markers = {"tip": {"position": [0.8, 0, 0]}, "side": {"orientation": {"axis": "x",
                   "angle": "30 deg"}}}  # fmt: skip
        model.add_body(name, mass=1, inertia=[1, 1, 1], position=[x, 0, 0], markers=markers)
    model.add_joint("shoulder", "revolute", between=["ground", "a"], axis="z")
    model.set_dynamics(duration=2.0)
    return model


def problems(plane="xy", *drivers):
    """Everything that is wrong with these drivers."""
    model = arm(plane)
    try:
        for k, fields in enumerate(drivers):
            model.add_driver(f"d{k}", **fields)
    except SceneError as error:
        return error.problems
    return model.problems()


@pytest.mark.parametrize(
    ("fields", "where", "sentence"),
    [
        ({"x": 1}, ".joint", 'say what is driven by "joint", "marker" or "between"'),
        ({"marker": "b.tip"}, "", "prescribes no coordinate; give one of these"),
        ({"marker": "b.tip", "joint": "shoulder", "x": 1}, "", '"marker" and "between" must'),
        ({"joint": "shoulder"}, "", "given none"),
        ({"joint": "shoulder", "angle": 1, "stroke": 1}, "", "given angle and stroke"),
        ({"joint": "shoulder", "stroke": 1}, ".stroke", "has no stroke; it has: angle"),
        ({"joint": "shoulder", "x": 1}, ".x", 'a driver of "joint" has no x'),
        ({"joint": "shoulder", "position": "t"}, ".position", '"joint" has no position'),
        ({"joint": "sholder", "angle": 1}, ".joint", 'unknown joint "sholder"'),
        ({"marker": "b.top", "x": 1}, ".marker", 'body "b" has no marker "top"'),
        ({"marker": "ground", "x": 1}, ".marker", "a marker of ground does not move"),
        ({"marker": "b.tip", "relative_to": "b", "x": 1}, ".relative_to", "both markers are on"),
        ({"marker": "b.tip", "z": 1}, ".z", "z has a component normal to the plane xy"),
        ({"marker": "b.tip", "relative_to": "a.side", "y": 1}, ".y", "y of a.side has a component"),
        ({"marker": "b.tip", "position": [1, 2, 3]}, ".position", "2 coordinates in the plane xy"),
        ({"marker": "b.tip", "position": [1]}, ".position", "a point has 3 coordinates"),
        ({"marker": "b.tip", "position": [1, 2], "y": 1}, ".position", "give one of them"),
        ({"marker": "b.tip", "angle": 1, "axis": "x"}, ".axis", "must be normal to the plane xy"),
        ({"marker": "b.tip", "angle": 1, "x": 1, "axis": "z"}, ".axis", "the angle of a marker"),
        ({"joint": "shoulder", "angle": 1, "axis": "z"}, ".axis", "the angle of a marker"),
        ({"between": ["a", "b"], "distance": 1, "relative_to": "a"}, ".relative_to", "of a marker"),
        ({"between": ["a", "a.tip"], "distance": 1}, ".between", 'both markers are on "a"'),
        ({"between": ["a", "b"], "distance": "t"}, ".distance", "the distance is 0 m at 0 s"),
        ({"between": ["a", "b"], "distance": "1 - t"}, ".distance", "the distance is 0 m at 1 s"),
        ({"marker": "b.tip", "x": "sqrt(t)"}, ".x", "first derivative"),
        ({"marker": "b.tip", "x": "t m"}, ".x", None),
        ({"marker": "b.tip", "x": "t m/s"}, ".x", "a length"),
        ({"marker": "b.tip", "x": "t m", "prescribes": "velocity"}, ".x", "a velocity"),
        ({"marker": "b.tip", "x": 1, "start": 2}, ".start", "begins by itself"),
        ({"marker": "b.tip", "x": 1, "prescribes": "velocity", "start_velocity": 2},
         ".start_velocity", "prescribes the velocity and begins by itself"),
        ({"marker": "b.tip", "position": [1, 2], "prescribes": "velocity", "start": 2},
         ".start", "2 values are expected, one for each coordinate"),
        ({"marker": "b.tip", "angle": 1, "prescribes": "velocity", "start": "2 mm"},
         ".start", "an angle"),
        ({"marker": "b.tip", "x": 1, "prescribes": "speed"}, ".prescribes", "unknown choice"),
    ],
)  # fmt: skip
def test_one_driver_that_cannot_be(fields, where, sentence):
    found = problems("xy", fields)
    if sentence is None:
        assert not found
        return
    (problem,) = found
    assert problem.where == f"drivers.d0{where}" and sentence in problem.what


@pytest.mark.parametrize(
    ("first", "second", "sentence"),
    [
        ({"joint": "shoulder", "angle": 1}, {"joint": "shoulder", "angle": 1, "prescribes":
         "velocity"}, 'the angle of joint "shoulder" is driven by "d0" already'),
        ({"marker": "b.tip", "x": 1}, {"marker": "b.tip", "x": "t", "prescribes": "acceleration"},
         'the x of marker "b.tip" is driven by "d0" already'),
        ({"marker": "b.tip", "position": [1, "t"]}, {"marker": "b.tip", "y": 1},
         'the y of marker "b.tip" is driven by "d0" already'),
        ({"marker": "b.tip", "relative_to": "a", "x": 1}, {"marker": "b.tip", "relative_to": "a",
         "x": 1}, 'the x of marker "b.tip" relative to "a" is driven by "d0" already'),
        ({"between": ["a", "b"], "distance": 1}, {"between": ["b", "a"], "distance": 2},
         'the distance between "a" and "b" is driven by "d0" already'),
    ],
)  # fmt: skip
def test_two_drivers_of_one_coordinate(first, second, sentence):
    (problem,) = problems("xy", first, second)
    assert problem.where == "drivers.d1" and problem.what == sentence


def test_different_coordinates_do_not_conflict():
    assert not problems(
        "xy", {"marker": "b.tip", "x": 1}, {"marker": "b.tip", "y": 1},
        {"marker": "b", "x": 1}, {"marker": "b.tip", "relative_to": "a", "x": 1},
    )  # fmt: skip


def test_a_point_in_space_has_three_coordinates():
    (problem,) = problems(None, {"marker": "b.tip", "position": [1, 2]})
    assert problem.what == "a point has 3 coordinates, given 2"


def test_what_needs_a_length_of_the_run_says_so():
    model = arm()
    model.dynamics = None
    model.add_driver("d", joint="shoulder", angle="sin(t**2)", prescribes="velocity")
    with pytest.raises(SceneError, match=r"drivers\.d\.angle: .* give dynamics\.duration"):
        compile_system(model)


def test_a_distance_that_starts_at_zero_has_no_direction():
    model = arm()
    model.add_marker("b.near", position=[-1, 0, 0])
    model.add_driver("d", between=["a", "b.near"], distance="1", prescribes="velocity")
    with pytest.raises(SceneError, match=r"drivers\.d\.distance: the distance begins with zero"):
        compile_system(model)


def test_a_distance_that_comes_to_zero_by_its_velocity():
    model = arm()
    model.add_driver("d", between=["a", "b"], distance="-2*t", prescribes="velocity")
    with pytest.raises(SceneError, match=r"drivers\.d\.distance: the distance is .* at 1 s"):
        compile_system(model)


def test_a_rate_without_a_value_is_told():
    model = arm()
    model.add_driver("d", joint="shoulder", angle="log(1.5 - t)", prescribes="velocity")
    with pytest.raises(SceneError, match=r"drivers\.d\.angle: .* not finite at t = 1.5 s"):
        compile_system(model)


@pytest.mark.parametrize(
    ("angle", "sentence"),
    [
        ("0.2*sign(t - 0.7)", "jumps at t = 0.7 s"),
        ("0.3*sign(sin(20*t))", f"jumps at t = {np.pi / 20:.5g} s"),
        ("atan2(sin(3*t), cos(3*t))", f"jumps at t = {np.pi / 3:.5g} s"),
        ("1e4*t + 0.005*sign(t - 0.7)", "jumps at t = 0.7 s"),  # beside a large motion
        ("sin(3000*t) + 1e-3*sign(1.3 - t)", "jumps at t = 1.3 s"),  # beside a fast one
        ("sqrt(0.5 - t)", "not finite at t = 0.5 s"),
        ("log(1.5 - t)", "not finite at t = 1.5 s"),
        ("1e-3/(t - 0.5)", "not finite at t = 0.5 s"),
    ],
)
def test_an_angle_that_no_force_can_follow(angle, sentence):
    (problem,) = problems("xy", {"joint": "shoulder", "angle": angle})
    assert problem.where == "drivers.d0.angle" and sentence in problem.what


def test_a_cam_table_that_is_not_closed_is_told_how():
    """It was to "rise by a step with a beginning and an end", and was shown as a Python dict."""
    points = {"type": "spline", "points": [[0, 0], [0.5, 8], [1, 0.5]], "beyond": "repeat"}
    (problem,) = problems("xy", {"joint": "shoulder", "angle": points})
    assert problem.what.startswith("the function jumps at t = 1 s: no force moves a body at once")
    assert problem.what.endswith("it repeats, so that its last value must be its first one")


@pytest.mark.parametrize("angle", ["t**3", "sqrt(1 + t)", "1/(3 - t)", "abs(2 - t)",
                                   "step(t, 0.5, 0, 0.501, 1)", "max(1, 2 + t)",
                                   "abs(sin(1000*t))", "1e8 + abs(t - 1)", "sqrt(1e-6 + (t-1)**2)",
                                   "1e-6*max(t, 1)", "0.1*exp(-((t - 0.7123)/1e-3)**2)",
                                   "0.1*t + 1/(1 + ((t - 0.7123)/1e-4)**2)"])  # fmt: skip
def test_an_angle_that_is_well(angle):
    assert not problems("xy", {"joint": "shoulder", "angle": angle})


def test_a_force_without_a_value_at_some_time():
    model = arm()
    model.add_force("f", "force", at="b", value=["sqrt(1.25 - t)", "sign(t - 1)", 0])
    (problem,) = model.problems()
    assert problem.where == "forces.f.value[0]" and "not finite at t = 1.25 s" in problem.what


@pytest.mark.parametrize(
    ("fields", "time"),
    [
        ({"angle": "abs(t - 0.5)"}, "0.5"),
        ({"angle": "max(sin(5*t), 0)"}, f"{np.pi / 5:.6g}"),
        ({"angle": "sign(t - 1.1)", "prescribes": "velocity"}, "1.1"),
        ({"angle": "t**2"}, None),
    ],
)
def test_a_velocity_that_jumps_is_an_impact(fields, time):
    model = arm()
    model.add_driver("d", joint="shoulder", **fields)
    told = model.warnings()
    assert len(told) == (time is not None)
    assert all(f"jumps at t = {time} s, an impact" in sentence for sentence in told)
