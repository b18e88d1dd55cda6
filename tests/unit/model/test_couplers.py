"""Gears, racks and linear couplers: what a scene may say of them, their signs, their mistakes."""

from __future__ import annotations

import numpy as np
import pytest
from gearkit import planetary, wheels

from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.joints.joint import count


def equation(model, name):
    """The equation of a coupler."""
    return model.couplers[name].equation(model, {})


def ratio(model, **fields):
    """Turns of the second joint's angle for one of the first."""
    model.couplers.clear()
    model.add_coupler("mesh", "gear", joints=["pin_a", "pin_b"], **fields)
    model.validate()
    one, two = equation(model, "mesh").terms
    return -one.factor / two.factor


SPUR = [
    ({}, {}, -2.0),
    ({}, {"internal": True}, 2.0),
    ({"second_axis": "-z"}, {}, 2.0),
    ({"second_axis": "-z"}, {"internal": True}, -2.0),
    ({"backwards": True}, {}, 2.0),  # the angle is that of ground against the wheel
    ({"backwards": True, "second_axis": "-z"}, {}, -2.0),
]


@pytest.mark.parametrize(("places", "fields", "wanted"), SPUR)
def test_spur_gears_turn_in_opposite_senses_outside_and_in_the_same_inside(places, fields, wanted):
    assert ratio(wheels(**places), teeth=[40, 20], **fields) == pytest.approx(wanted, abs=1e-15)
    radii = [0.6, 0.3] if fields else [0.2, 0.1]
    assert ratio(wheels(**places), radii=radii, **fields) == pytest.approx(wanted, abs=1e-15)


def test_a_ratio_has_its_own_sign():
    assert ratio(wheels(), ratio=-0.5) == -0.5
    assert ratio(wheels(second_axis="-z"), ratio=-0.5) == -0.5
    assert ratio(wheels(backwards=True), ratio=-0.5) == 0.5
    assert ratio(wheels(second_axis=[0, 1, 1]), ratio=3) == 3


BEVEL = [  # first wheel about z at the origin; axes meet in (0, 0, 0.2)
    ("x", (0.1, 0, 0.2), 1.0),  # the first axis leads to the meeting point, the second away
    ("-x", (0.1, 0, 0.2), -1.0),
    ("x", (-0.1, 0, 0.2), -1.0),
    ("x", (0, 0, 0.2), 1.0),  # in the meeting point the axis itself tells
    ([1, 0, -1], (0.1, 0, 0.1), 1.0),
]


@pytest.mark.parametrize(("axis", "at", "wanted"), BEVEL)
def test_bevel_wheels_turn_in_opposite_senses_as_seen_from_where_their_axes_meet(axis, at, wanted):
    """The contact point must have one velocity: θ1 u1 × c = θ2 u2 × c, c between the wheels."""
    model = wheels(second_axis=axis, at=at)
    assert ratio(model, teeth=[20, 20]) == pytest.approx(wanted, abs=1e-12)
    meeting, u1 = np.array([0, 0, 0.2]), np.array([0, 0, 1.0])
    u2 = np.array(model.joints["pin_b"].axis)
    towards = [-u1, np.array(at) - meeting]
    if np.linalg.norm(towards[1]) == 0:
        towards[1] = u2
    c = sum(t / np.linalg.norm(t) for t in towards)
    np.testing.assert_allclose(np.cross(u1, c), wanted * np.cross(u2, c), atol=1e-12)


def test_a_planetary_train_counts_angles_from_its_arm():
    """Ring on ground, arm on marker J of its own pin: angle of the arm is minus the ring's."""
    model = planetary()
    sun, ring = (equation(model, name).terms for name in ("sun", "ring"))
    assert [t.factor for t in sun] == [20, 10]
    assert [t.factor for t in ring] == [-40, -10]
    assert count(model).couplers == 2
    assert count(model).mobility == 3 * 6 - 3 * 5 - 2 == 1


def rack(pinion_at=(0, 0.1, 0), axis="z", slides="x"):
    model = Model("rack")
    model.add_marker("ground.pin", position=list(pinion_at))
    model.add_body("pinion", mass=1, inertia=[1, 1, 1], position=list(pinion_at))
    model.add_body("rack", mass=1, inertia=[1, 1, 1])
    model.add_joint("pin", "revolute", between=["ground.pin", "pinion"], axis=axis)
    model.add_joint("guide", "prismatic", between=["ground", "rack"], axis=slides)
    model.add_coupler("mesh", "rack-and-pinion", joints=["pin", "guide"], radius=0.1)
    return model


@pytest.mark.parametrize(
    ("at", "axis", "slides", "wanted"),
    [
        ((0, 0.1, 0), "z", "x", 0.1),  # the lowest point of a pinion above moves forward
        ((0, -0.1, 0), "z", "x", -0.1),
        ((0, 0.1, 0), "-z", "x", -0.1),
        ((0.5, 0.3, 0.2), "z", "-x", -0.1),
    ],
)
def test_a_rack_moves_as_the_point_of_the_pinion_next_to_it(at, axis, slides, wanted):
    pinion, slide = equation(rack(at, axis, slides), "mesh").terms
    assert -pinion.factor / slide.factor == pytest.approx(wanted, abs=1e-15)


def test_linear_couplers_take_numbers_in_the_units_of_the_scene():
    """2 (s/mm) + 3 φ = 4 is 2000 (s/m) + 3 φ = 4."""
    model = Model("mm", units="mm-t-s")
    model.add_body("b", mass=1, inertia=[1, 1, 1])
    model.add_joint("tube", "cylindrical", between=["ground", "b"], axis="z")
    terms = [
        {"joint": "tube", "coordinate": "stroke", "factor": 2},
        {"joint": "tube", "coordinate": "angle", "factor": "1 + 2"},
    ]
    model.add_coupler("thread", "linear", terms=terms, constant=4)
    found = equation(model, "thread")
    assert [t.factor for t in found.terms] == [2000, 3]
    assert found.constant == 4
    again = Model.from_scene_dict(model.to_scene_dict())
    assert again.couplers == model.couplers
    assert model.to_scene_dict()["couplers"]["thread"]["terms"][0]["factor"] == 2


def test_all_kinds_are_written_back():
    for model in (planetary(), rack()):
        again = Model.from_scene_dict(model.to_scene_dict())
        assert again.couplers == model.couplers


SCREW = {"type": "screw", "between": ["ground", "a"], "axis": "x"}
MISTAKES = [
    (
        "g", "gear", {"joints": ["pin_a", "pin_b"]},
        'couplers.g: give exactly one of "teeth", "radii" and "ratio", given none',
    ),
    (
        "g", "gear", {"joints": ["pin_a", "pin_b"], "teeth": [0, 5]},
        "couplers.g.teeth[0]: a whole number from 1 on is expected, is 0",
    ),
    (
        "g", "gear", {"joints": ["pin_a", "pin_b"], "ratio": 0},
        "couplers.g.ratio: is zero: the second wheel would never turn",
    ),
    (
        "g", "gear", {"joints": ["pin_a", "pin_b"], "ratio": 2, "internal": True},
        "couplers.g.internal: is ignored when 'ratio' is given",
    ),
    (
        "g", "gear", {"joints": ["pin_a", "pin_a"], "ratio": 2},
        'couplers.g.joints: names the joint "pin_a" twice: a gear joins two of them',
    ),
    (
        "g", "gear", {"joints": ["pin_a", "pinb"], "ratio": 2},
        'couplers.g.joints[1]: unknown joint "pinb"; nearest: pin_b',
    ),
    (
        "g", "gear", {"joints": ["pin_a", "guide"], "ratio": 2},
        'couplers.g.joints[1]: the prismatic joint "guide" has no angle; it has: stroke',
    ),
    (
        "g", "gear", {"joints": ["pin_a", "wrist"], "ratio": 2},
        'couplers.g.joints: no common carrier: "pin_a" joins ground and a, "wrist" joins b and c; '
        "both wheels must hang on one body, which may be ground or an arm that turns",
    ),
    (
        "g", "gear", {"joints": ["pin_a", "hook"], "ratio": 2},
        'couplers.g.joints[1]: no wheel can hang by the universal joint "hook"; '
        "allowed: revolute, cylindrical, screw, planar, parallel",
    ),
    (
        "g", "gear", {"joints": ["pin_a", "pin_b"], "radii": [0.1, 0.1]},
        "couplers.g: wheels of the radii 0.1 m and 0.1 m roll outside with their axes 0.2 m apart, "
        "these are 0.3 m apart",
    ),
    (
        "g", "gear", {"joints": ["pin_a", "pin_c"], "teeth": [10, 10]},
        "couplers.g: the axes of the wheels are neither parallel nor do they meet",
    ),
    (
        "r", "rack-and-pinion", {"joints": ["pin_a", "guide"], "radius": 0.1},
        "couplers.r: the joint of the rack lies on the axis of the pinion",
    ),
    (
        "r", "rack-and-pinion", {"joints": ["pin_a", "lift"], "radius": 0.1},
        "couplers.r: the rack must slide at right angles to the axis of its pinion",
    ),
    (
        "r", "rack-and-pinion", {"joints": ["pin_a", "pin_b"], "radius": 0.1},
        'couplers.r.joints[1]: the revolute joint "pin_b" has no stroke; it has: angle',
    ),
    (
        "r", "rack-and-pinion", {"joints": ["pin_a", "guide"], "radius": 0},
        "couplers.r.radius: must be positive, is 0 m",
    ),
    (
        "l", "linear", {"terms": [{"joint": "pin_a", "coordinate": "angle", "factor": 1}]},
        "couplers.l.terms: two or three terms are expected, given 1",
    ),
    (
        "l", "linear", {"terms": [{"joint": "pin_a", "coordinate": "angle", "factor": 0}]},
        "couplers.l.terms[0].factor: is zero: leave the term out",
    ),
    (
        "l", "linear", {"terms": [{"joint": "pin_a", "coordinate": "angel", "factor": 1}]},
        'couplers.l.terms[0].coordinate: unknown coordinate "angel"; nearest: angle',
    ),
    (
        "l", "linear",
        {"terms": [{"joint": j, "coordinate": "stroke", "factor": 1} for j in ("pin_a", "guide")]},
        'couplers.l.terms[0].coordinate: the revolute joint "pin_a" has no stroke; it has: angle',
    ),
    (
        "l", "linear",
        {"terms": [{"joint": "pin_a", "coordinate": "angle", "factor": f} for f in (1, 2)]},
        'couplers.l.terms: the angle of joint "pin_a" stands here twice: add up its factors',
    ),
    (
        "x", "gaer", {"joints": ["pin_a", "pin_b"]},
        'couplers.x.type: unknown coupler type "gaer"; nearest: gear; '
        "allowed: gear, rack-and-pinion, linear",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("name", "kind", "fields", "sentence"), MISTAKES)
def test_mistakes_are_told(name, kind, fields, sentence):
    model = wheels()
    for body in "cd":
        model.add_body(body, mass=1, inertia=[1, 1, 1], position=[0.0, 0.4, 0.0])
    model.add_joint("wrist", "revolute", between=["b", "c"], axis="z")
    model.add_marker("ground.c", position=[0.0, 0.4, 0.0])
    model.add_joint("pin_c", "revolute", between=["ground.c", "c"], axis="x")
    model.add_joint("hook", "universal", between=["ground.c", "d"], axis="x", second_axis="y")
    model.add_joint("guide", "prismatic", between=["ground", "b"], axis="x")
    model.add_joint("lift", "prismatic", between=["ground", "b"], axis="z")
    with pytest.raises(SceneError) as caught:
        model.add_coupler(name, kind, **fields)
        model.validate()
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({}, "joints.j.pitch: is missing: how far the screw moves in one turn"),
        ({"pitch": 0}, "joints.j.pitch: is zero: a screw that turns and does not move"),
        ({"type": "revolute", "pitch": 1}, "joints.j.pitch: only a screw has a pitch"),
    ],
)
def test_mistakes_of_a_pitch_are_told(fields, sentence):
    model = wheels()
    with pytest.raises(SceneError) as caught:
        model.add_joint("j", **(SCREW | fields))
    assert str(caught.value).startswith(sentence)


def test_the_wheels_of_a_gear_are_different_bodies():
    model = wheels()
    model.add_joint("again", "cylindrical", between=["a", "ground"], axis="z")
    model.add_coupler("mesh", "gear", joints=["pin_a", "again"], ratio=1)
    (problem,) = model.problems()
    assert problem.what == (
        '"pin_a" joins ground and a, and so does "again": the second wheel must be another body'
    )


def test_mistakes_of_joints_are_not_told_again_of_their_couplers():
    scene = wheels().to_scene_dict()
    scene["couplers"] = {"mesh": {"type": "gear", "joints": ["pin_a", "pin_b"], "teeth": [2, 1]}}
    scene["joints"]["pin_b"]["axis"] = "w"
    with pytest.raises(SceneError) as caught:
        Model.from_scene_dict(scene)
    assert [problem.where for problem in caught.value.problems] == ["joints.pin_b.axis"]


def test_reactions_of_couplers_are_sensed_by_coupler_and_joint():
    model = planetary()
    model.add_sensor("tooth", "reaction", coupler="sun.pin", quantity="moment")
    assert model.problems() == []
    model.add_sensor("other", "reaction", coupler="sun.arm_pin")
    (problem,) = model.problems()
    assert (problem.where, problem.what) == (
        "sensors.other.coupler", 'unknown coupler and joint "sun.arm_pin"',
    )  # fmt: skip
    assert problem.allowed == ("sun.sun_pin", "sun.pin", "ring.arm_pin", "ring.pin")


def test_in_a_plane_a_cylindrical_joint_has_one_coordinate():
    model = Model("flat", plane="xy")
    for name in "ab":
        model.add_body(name, mass=1, inertia=[1, 1, 1])
        model.add_joint(name, "cylindrical", between=["ground", name], axis="x")
    terms = [{"joint": j, "coordinate": "angle", "factor": 1} for j in "ab"]
    model.add_coupler("sum", "linear", terms=terms)
    assert [p.where for p in model.problems()] == ["couplers.sum"] * 2
    assert model.problems()[0].what == 'in the plane xy the joint "a" has no angle'


def test_teeth_of_one_wheel_that_need_two_modules_are_told():
    model = planetary()
    assert not model.warnings()
    del model.couplers["ring"]
    model.add_coupler("ring", "gear", joints=["arm_pin", "pin"], teeth=[60, 10], internal=True)
    (told,) = model.warnings()
    assert told.startswith("couplers.ring: by the distances of the axes the 10 teeth of pin have")
    assert "the module 0.012 m here and 0.02 m in couplers.sun" in told
