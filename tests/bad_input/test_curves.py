"""Mistakes with curves and the joints on them: each a sentence with the place and the cure."""

from __future__ import annotations

import re

import numpy as np
import pytest
from truthkit import Memory

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.dynamics.dynamics import dynamics as dynamics_of
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError, SceneError
from flexmb.model import Model

CIRCLE = {"circle": 0.05}


def cam(kind="cam-knife", shape=None, plane="xy", **fields):
    """A cam, a follower above it, and a joint of that type between them."""
    model = Model("cam", plane=plane)
    model.add_curve("profile", **(CIRCLE if shape is None else shape))
    model.add_body("cam", mass=1, inertia=[1, 1, 1])
    model.add_body("follower", mass=1, inertia=[1, 1, 1], position=[0, 0.05, 0])
    model.add_joint("contact", kind, between=["cam", "follower"], **{"curve": "profile", **fields})
    return model


def told(problems, where, sentence):
    assert any(p.where == where and re.search(sentence, p.what) for p in problems), problems


@pytest.mark.parametrize(
    ("shape", "where", "sentence"),
    [
        ({"points": [[0, 0]]}, "points", "needs 2 points at least, given 1"),
        ({"points": [[0, 0], [1, 0]], "closed": True}, "points", "a closed curve needs 3 points"),
        ({"points": [[0, 0], [1, 0], [1, 0], [2, 1]]}, "points", "point 3 repeats point 2"),
        ({"points": [[0, 0], [1, 0], [1, 1], [0, 0]], "closed": True}, "points", "repeats the fir"),
        ({"points": [[0, 0], [1, 0, 0]]}, "points", "all points have two coordinates, or all"),
        ({"polar_points": [[0, 1], [2, 1], [1, 1]]}, "polar_points", "angles must increase"),
        ({"x": "t - sin(t)", "y": "1 - cos(t)"}, "", "its tangent vanishes at t = .*: a cusp"),
        ({"x": "t - sin(t)", "y": "1 - cos(t)", "range": [-3, 4]}, "", "tangent vanishes"),
        ({"polar": "1/(t - 1)", "range": [0.5, 1.5]}, "", "not finite at t = 1"),
        ({"polar": "1 + 0.1*t", "closed": True}, "closed", "its ends must meet"),
        ({"polar": "2 + cos(t/2)**2", "range": [0, "pi"], "closed": True}, "closed", "must meet"),
        ({"x": 2, "y": 3}, "", "it has no length"),
        ({"file": "nothing.csv"}, "file", "there is no file"),
    ],
)
def test_shapes_that_nothing_can_slide_along(shape, where, sentence):
    problems = cam(shape=shape).problems()
    told(problems, ".".join(filter(None, ("curves.profile", where))), sentence)


@pytest.mark.parametrize(
    ("fields", "where", "sentence"),
    [
        ({}, "", 'give exactly one of "points", "file"'),
        ({"circle": 1, "polar": "2"}, "", "given polar and circle"),
        ({"x": "t"}, "y", "is missing: x and y are given together"),
        ({"polar": "2", "y": "t"}, "y", "only a curve given by x, y"),
        ({"circle": 1, "range": [0, 1]}, "range", "only curves given by expressions"),
        ({"polar": "1", "range": [1, 0]}, "range", "must be larger than the first"),
        ({"circle": 1, "closed": False}, "closed", "a circle is closed"),
        ({"polar": "1", "center": [0, 1]}, "center", "only a circle"),
        ({"polar": "1 + speed*t"}, "polar", 'unknown name "speed"'),
        ({"points": [[0, "nonsense"]]}, "points[0][1]", "unknown name"),
    ],
)
def test_words_of_a_curve(fields, where, sentence):
    with pytest.raises(SceneError) as caught:
        Model("curve").add_curve("c", **fields)
    told(caught.value.problems, ".".join(filter(None, ("curves.c", where))), sentence)


@pytest.mark.parametrize(
    ("kind", "fields", "where", "sentence"),
    [
        ("cam-knife", {"curve": None}, "curve", "is missing: a cam-knife joint needs it"),
        ("cam-roller", {}, "radius", "is missing"),
        ("cam-flat", {"radius": 1}, "radius", "a cam-flat joint has no radius"),
        ("cam-cam", {}, "second_curve", "is missing"),
        ("cam-knife", {"second_start": 1}, "second_start", "has no second_start"),
        ("pin-in-slot", {"axis": "z"}, "axis", "has no axis"),
        ("revolute", {}, "curve", "a revolute joint has no curve"),
    ],
)
def test_words_of_joints_on_curves(kind, fields, where, sentence):
    given = {"between": ["ground", "b"], "curve": "c", **fields}
    given = {key: value for key, value in given.items() if value is not None}
    with pytest.raises(SceneError) as caught:
        Model("words").add_joint("contact", kind, **given)
    told(caught.value.problems, f"joints.contact.{where}", sentence)


LINE = {"points": [[-1, 0], [1, 0]]}
HELIX = {"x": "cos(t)", "y": "sin(t)", "z": "t"}


@pytest.mark.parametrize(
    ("model", "where", "sentence"),
    [
        (
            cam(shape=LINE, start=3),
            "start",
            r"lies beyond the curve \"profile\", which is 2 m long",
        ),
        (cam(shape=LINE, start=-0.1), "start", "lies beyond"),
        (cam(shape=HELIX, plane=None), "curve", "needs a plane curve"),
        (
            cam("point-on-curve", shape=HELIX),
            "curve",
            "three coordinates has no meaning in a plane",
        ),
        (cam(plane="yz"), "between[0]", "must lie in the plane yz: turn the marker"),
        (cam("cam-flat", axis="z"), "axis", "must lie in the plane xy"),
    ],
)
def test_curves_that_do_not_fit_their_joints(model, where, sentence):
    told(model.problems(), f"joints.contact.{where}", sentence)


@pytest.mark.parametrize(
    ("fields", "where", "sentence"),
    [
        ({"joint": "nothing"}, "joint", 'unknown joint "nothing"'),
        ({"joint": "pivot"}, "joint", 'the revolute joint "pivot" is on no curve'),
        ({"joint": "contact", "on": "J"}, "on", "has a curve on I only"),
    ],
)
def test_sensors_of_places_that_no_joint_has(fields, where, sentence):
    model = cam()
    model.add_joint("pivot", "revolute", between=["ground", "cam"], axis="z")
    model.add_sensor("place", "place", **fields)
    told(model.problems(), f"sensors.place.{where}", sentence)


def test_no_force_follows_a_place():
    model = cam()
    model.add_sensor("place", "place", joint="contact")
    model.add_force("pull", "force", at="follower", value=["100*place", 0, 0])
    told(model.problems(), "forces.pull.value[0]", '"place" is a place along a curve, computed')


def test_an_unknown_curve_is_told_with_the_nearest():
    (problem,) = cam(curve="profil").problems()
    assert problem.where == "joints.contact.curve" and problem.nearest == ("profile",)


@pytest.mark.seconds
def test_a_roller_too_large_for_a_hollow_curve_is_told():
    hollow = {"polar": "1 + 0.3*cos(4*t)", "closed": True}
    fits, large = (cam("cam-roller", hollow, radius=r) for r in (0.1, 0.3))
    for model in (fits, large):
        model.bodies["follower"] = model.bodies["follower"].model_copy(
            update={"position": (0.0, 1.4, 0.0)}
        )
    compile_system(fits)
    # where the polar curve is hollow most, at t = pi/4, r = 0.7 and r'' = 4.8: radius r²/(r'' − r)
    with pytest.raises(SceneError, match=r"hollow .* a radius of 0.1195"):
        compile_system(large)


def test_a_table_without_numbers_names_its_line(tmp_path):
    (tmp_path / "cam.csv").write_text("x; y\n0; 1\n1; one\n")
    model = cam(shape={"file": "cam.csv"})
    model.folder = tmp_path
    told(model.problems(), "curves.profile.file", "line 3 is no point")


def turning(curve, kind, height, **fields):
    """A cam on a pivot with a follower in a guide."""
    model = Model("cam", plane="xy")
    model.add_curve("profile", **curve)
    model.add_body("cam", mass=1, inertia=[1, 1, 1])
    model.add_body("follower", mass=1, inertia=[1, 1, 1], position=[0, height, 0])
    model.add_joint("pivot", "revolute", between=["ground", "cam"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "follower"], axis="y")
    model.add_joint("contact", kind, between=["cam", "follower"], curve="profile", **fields)
    return model


def turn(model, angle, **dynamics):
    """How a run ends in which the cam is turned, and its last time."""
    model.add_driver("motor", joint="pivot", angle=angle)
    model.set_dynamics(**{"duration": 0.2, "step": 0.01, "outputs": 10, **dynamics})
    memory = Memory()
    outcome = dynamics_of(compile_system(model), model, memory)
    return outcome, float(memory.tables()[0][-1])


@pytest.mark.parametrize(
    ("angle", "control", "end", "time"),
    [pytest.param("-20*t", {}, "end", 3 - np.pi / 2, id="end", marks=pytest.mark.slow),
     pytest.param("-20*t", {"step": None, "accuracy": 1e-2}, "end", 3 - np.pi / 2, id="controlled"),
     pytest.param("20*t", {}, "beginning", np.pi / 2, id="beginning")],
)  # fmt: skip
def test_a_joint_that_leaves_its_curve(angle, control, end, time):
    """The cam is touched at the angle π/2 ± 20 t of its profile, which ends at 0 and 3 rad."""
    model = turning({"polar": "0.05 + 0.01*t", "range": [0, 3]}, "cam-knife", 0.06)
    outcome, last = turn(model, angle, **control)
    message = outcome.message
    assert outcome.status == "failed"
    told_at = float(re.search(r"at t = ([\d.]+) s", message)[1])
    assert told_at == pytest.approx(0.05 * time, abs=2e-5)
    assert f"joints.contact leaves its curve at the {end} of it" in message
    assert "closed = true" in message
    assert 0.05 * time - 0.021 < last < 0.05 * time


DISK = {"circle": 0.05, "center": [0.02, 0]}


def test_a_cam_that_loses_contact_is_noted():
    """Without weight the flat is pulled as soon as it slows down, sin θ > 0."""
    outcome, _ = turn(turning(DISK, "cam-flat", 0.05, axis="y"), "10*t")
    note = " ".join(outcome.notes)
    assert "joints.contact pulls its follower towards the cam, first at t = 0.02 s" in note
    assert "a contact with a tappet that its lift drives" in note


def test_weight_keeps_contact_below_its_speed():
    """e ω² = 2 m/s² is below g: no note."""
    model = turning(DISK, "cam-flat", 0.05, axis="y")
    model.set_gravity([0, -9.81, 0])
    outcome, _ = turn(model, "10*t")
    assert (outcome.status, outcome.message, outcome.notes) == ("finished", "", ())


SPIRAL = {"polar": "0.02 + 0.004*t", "range": [0, "4*pi"]}
WAISTED = {"polar": "0.05 + 0.02*cos(2*t)", "closed": True}


@pytest.mark.parametrize(
    ("curve", "kind", "height", "fields"),
    [(SPIRAL, "cam-roller", 0.041, {"radius": 0.015}), (WAISTED, "cam-flat", 0.031, {"axis": "y"})],
    ids=["cut", "bridged"],
)
def test_a_follower_on_the_wrong_branch(curve, kind, height, fields):
    model = turning(curve, kind, height, **fields)
    with pytest.raises(AssemblyError, match="another part of it reaches .* into the follower"):
        assemble(compile_system(model), model)
