"""What is said about contacts and frictions that cannot be."""

from __future__ import annotations

import pytest
from femeshes import line
from goodscene import GOOD, message

from flexmb.errors import SceneError
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

CONTACT = """
[forces.touch]
type = "contact"
between = ["rod.center", "ground"]
shapes = [{ type = "sphere", radius = 0.05 }, { type = "plane" }]
stiffness = 1e6
[sensors.tip]"""
FRICTION = """
[forces.rub]
type = "joint-friction"
joint = "guide"
dynamic = 0.1
stiffness = 1e5
[sensors.tip]"""


def told(tmp_path, addition, *changes):
    """The message for the good scene with a contact or a friction, after changes to it."""
    for old, new in changes:
        assert old in addition
        addition = addition.replace(old, new, 1)
    return message(tmp_path, ("[sensors.tip]", addition), text=GOOD)


SPHERE = '{ type = "sphere", radius = 0.05 }'


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        ((SPHERE, '{ type = "plane" }'), "forces.touch.shapes", "no contact between plane and"),
        ((SPHERE, '{ type = "cube" }'), "forces.touch.shapes[0].type", "unknown contact shape"),
        ((SPHERE, '{ type = "sphere" }'), "forces.touch.shapes[0].radius", "is missing"),
        (("1e6", "1e6\nrestitution = -0.1"), "forces.touch.restitution", "between 0 and 1"),
        (("1e6", "1e6\nrestitution = 1.5"), "forces.touch.restitution", "between 0 and 1"),
        (("1e6", "1e6\nrestitution = 0"), "forces.touch.restitution", "infinite"),
        (("stiffness = 1e6", ""), "forces.touch", 'either "stiffness" or "materials"'),
        (("1e6", '1e6\nmaterials = ["steel", "steel"]'), "forces.touch", "either"),
        (("1e6", "-1"), "forces.touch.stiffness", "must be positive"),
        (('"ground"]', '"rod"]'), "forces.touch.between", 'both markers are on "rod"'),
        (('"ground"]', '"grund"]'), "forces.touch.between[1]", 'unknown body "grund"'),
        (
            (SPHERE, '{ type = "points", nodes = [1] }'),
            "forces.touch.shapes[0].nodes",
            "has no mesh",
        ),
        (
            (SPHERE, '{ type = "points", nodes = [1], group = "sole" }'),
            "forces.touch.shapes[0]",
            'exactly one of "points", "nodes" and "group"',
        ),
        (
            ("1e6", "1e6\nfriction = { static = 0.1, dynamic = 0.2, stiffness = 1e5 }"),
            "forces.touch.friction.static",
            "at least dynamic",
        ),
        (
            ("1e6", "1e6\nfriction = { dynamic = 0.2 }"),
            "forces.touch.friction.stiffness",
            "held by a spring",
        ),
        (
            (SPHERE, '{ type = "sphere", radius = 0.05 }, { type = "plane" }'),
            "forces.touch.shapes",
            "2 values",
        ),
    ],
)
def test_contact(tmp_path, change, where, words):
    text = told(tmp_path, CONTACT, change)
    assert where in text
    assert words in text


def test_pairs_are_listed(tmp_path):
    text = told(tmp_path, CONTACT, (SPHERE, '{ type = "plane" }'))
    assert "sphere - plane" in text
    assert "points - cylinder" in text


def test_deep_penetration(tmp_path):
    """The rod's centre is 0.2 m behind the plane, whose normal leads away from it."""
    change = ('{ type = "plane" }', '{ type = "plane", axis = "-x" }')
    text = told(tmp_path, CONTACT, change)
    assert "forces.touch.between: the shapes overlap by 0.25 m" in text
    assert "place the bodies apart" in text


def test_sphere_larger_than_its_bore(tmp_path):
    bore = '{ type = "cylinder", radius = 0.04, side = "inside" }'
    text = told(tmp_path, CONTACT, ('{ type = "plane" }', bore))
    assert "does not fit into the bore" in text


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        (('"guide"', '"guid"'), "forces.rub.joint", 'unknown joint "guid"'),
        (('"guide"', '"guide"\ncoordinate = "angle"'), "forces.rub.angle", "has no angle"),
        (('"guide"', '"pin"'), "forces.rub.radius", "is missing"),
        (('"guide"', '"guide"\nradius = 0.1'), "forces.rub.radius", "leave it out"),
        (('"guide"', '"guide"\nstatic = 0.05'), "forces.rub.static", "at least dynamic"),
        (('"guide"', '"guide"\nmodel = "smooth"'), "forces.rub.creep_speed", "is missing"),
        (('"guide"', '"pin"\nradius = 0.1\nwidth = 1'), "forces.rub.width", "leave it out"),
        (("dynamic = 0.1", "dynamic = -0.1"), "forces.rub.dynamic", "zero or positive"),
    ],
)
def test_joint_friction(tmp_path, change, where, words):
    text = told(tmp_path, FRICTION, change)
    assert where in text
    assert words in text


def test_friction_in_a_joint_that_has_none(tmp_path):
    text = message(
        tmp_path, ("[sensors.tip]", FRICTION), ('type = "prismatic"', 'type = "in-plane"')
    )
    assert "there is no friction in in-plane joints" in text
    assert "revolute" in text


def test_a_group_that_the_mesh_does_not_have():
    """Known once the body is; the nearest name is told."""
    bar = reduce(
        line(4, end=(1.0, 0, 0)), material="steel", interfaces={"tip": "tip"}, modes=2,
        sections={"all": rectangle(0.02, 0.02)},
    )  # fmt: skip
    model = Model("bar")
    model.add_body("bar", bar)
    model.add_marker("ground.floor", position=[0, 0, -1])
    model.add_force(
        "floor", "contact", between=["bar", "ground.floor"], stiffness=1e6,
        shapes=[{"type": "points", "group": "tipp"}, {"type": "plane"}],
    )  # fmt: skip
    with pytest.raises(
        SceneError, match=r'shapes\[0\].group: the mesh has no group "tipp"'
    ) as error:
        model.validate()
    assert '"tip"' in str(error.value) or "tip" in error.value.problems[0].nearest


def test_a_contact_of_a_body_with_itself_is_one_mistake(tmp_path):
    """That its shapes overlap, and the cure to place it apart from itself, was told as well."""
    text = told(tmp_path, CONTACT, ('"ground"]', '"rod"]'))
    assert 'both markers are on "rod"' in text and "overlap" not in text


def test_values_in_messages_are_written_as_in_a_scene(tmp_path):
    change = (SPHERE, '{ type = "sphere", radius = { a = [1, true], b = "x" } }')
    assert 'given { a = [1, true], b = "x" }' in told(tmp_path, CONTACT, change)
