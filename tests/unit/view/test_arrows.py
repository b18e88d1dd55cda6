"""Arrows of contacts: the force that a sensor records, from where the sides touch."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmb import simulate
from flexmb.model import Model
from flexmb.view.arrows import vectors
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import view_of

R, G = 0.1, 10.0
CORNERS = [[x, y, -0.05] for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
ROUND, FLAT = {"type": "sphere", "radius": R}, {"type": "plane", "axis": "z"}
# shapes of body and ground, marker of ground; where they touch is the origin
PAIRS = {
    "sphere on plane": (ROUND, FLAT, [0, 0, 0]),
    "sphere on sphere": (ROUND, {"type": "sphere", "radius": 0.4}, [0, 0, -0.4]),
    "sphere on cylinder": (ROUND, {"type": "cylinder", "radius": 0.4, "axis": "x"}, [0.2, 0, -0.4]),
    "sphere in bore": (ROUND, {"type": "cylinder", "radius": 0.4, "axis": "y", "side": "inside"},
                       [0, -0.3, 0.4]),
    "points on plane": ({"type": "points", "points": [[x, y, -R] for x, y, _ in CORNERS]}, FLAT,
                        [0.7, 0, 0]),
}  # fmt: skip
AWAY = (np.array([1000.0, -300.0, 500.0]), Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix())


def resting(pair, tmp_path, on="J", axes="global", turned=False, record=True):
    """A body that is pressed against ground at the origin, turned and moved with it."""
    mine, other, place = PAIRS[pair]
    x, A = AWAY if turned else (np.zeros(3), np.eye(3))
    made = Model(pair, folder=tmp_path, gravity=list(A @ [0, 0, -G]))
    frame = {"orientation": A.tolist()}
    made.add_marker("ground.seat", position=list(x + A @ place), **frame)
    made.add_body("body", mass=2.0, inertia=[0.02] * 3, position=list(x + A @ [0, 0, R]), **frame)
    made.add_marker("ground.rail", position=list(x), **frame)
    made.add_joint("guide", "prismatic", between=["ground.rail", "body"], axis=list(A[:, 2]))
    if "axis" in other:
        other = {**other, "axis": (A @ np.eye(3)["xyz".index(other["axis"])]).tolist()}
    made.add_force("contact", "contact", between=["ground.seat", "body"], shapes=[other, mine],
                   stiffness=1e6, exponent=1, restitution=0.1)  # fmt: skip
    if record:
        made.add_sensor("load", "reaction", force="contact", on=on, axes=axes)
    result = simulate(made, duration=0.1, outputs=4, accuracy=1e-6, start="static", output=tmp_path)
    return Mechanism(result, 0.1), x, A


def caption_of(mechanism, which):
    return Drawing(mechanism, view_of(mechanism, {"forces": which})).content().caption


def arrows(mechanism, which="reactions"):
    return [one for one in vectors(mechanism, which) if one.name == "contact"]


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize(("on", "axes", "turned"), [("J", "global", False), ("I", "joint", True)])
def test_it_is_the_force_where_the_sides_touch(pair, on, axes, turned, tmp_path):
    mechanism, x, A = resting(pair, tmp_path, on, axes, turned)
    [one] = arrows(mechanism)
    up = 2.0 * G if on == "J" else -2.0 * G
    np.testing.assert_allclose(A.T @ one.value, [0, 0, up], atol=1e-3)
    assert one.marker == ("body.origin" if on == "J" else "ground.seat") or one.marker == "body"
    frame = mechanism.marker_frame(one.marker)
    begin = frame[:3, :3] @ one.offset + frame[:3, 3]
    np.testing.assert_allclose(A.T @ (begin - x), 0.0, atol=3e-5)  # 20 µm deep


def test_it_is_drawn_there_and_in_the_caption(tmp_path):
    mechanism, _, _ = resting("sphere on plane", tmp_path)
    drawing = Drawing(mechanism, view_of(mechanism, {"forces": "reactions"}))
    content = drawing.content()
    assert "force 20 N" in content.caption and "none of" not in content.caption
    [solid] = [one for one in content.solids if one.role == "arrow"]
    low, high = solid.points.min(axis=0), solid.points.max(axis=0)
    np.testing.assert_allclose([low[2], high[2]], [0.0, 0.2 * drawing.size], atol=1e-4)
    assert not arrows(mechanism, "loads")


def test_a_contact_that_no_sensor_records_is_named(tmp_path):
    mechanism, _, _ = resting("sphere on plane", tmp_path, record=False)
    assert not arrows(mechanism)
    said = "none of contact, which no sensor of type reaction records"
    assert said in caption_of(mechanism, "all") and said not in caption_of(mechanism, "loads")


def test_the_scale_knows_blows_between_the_moments_that_are_looked_at(tmp_path):
    made = Model("blow", folder=tmp_path)
    made.add_body("ball", mass=1.0, inertia=[0.01] * 3, position=[0, 0, 0.15], velocity=[0, 0, -1])
    made.add_force("contact", "contact", between=["ground", "ball"], shapes=[FLAT, ROUND],
                   stiffness=1e6, exponent=1)  # fmt: skip
    made.add_sensor("load", "reaction", force="contact", axes="global")
    result = simulate(made, duration=0.1, outputs=1000, accuracy=1e-6, output=tmp_path)
    assert result["load.z"].max() == pytest.approx(1000.0, rel=1e-3)  # v sqrt(k m)
    assert "force 1000 N" in caption_of(Mechanism(result, 0.1), "all")


def test_springs_and_bushings_have_the_arrow_that_a_sensor_records(tmp_path):
    made = Model("spring", folder=tmp_path)
    made.add_body("b", mass=2, inertia=[1, 1, 1], position=[0, 3, 4])
    made.add_force("s", "spring-damper", between=["ground", "b"], stiffness=10, free_length=4)
    made.add_sensor("pull", "reaction", force="s", on="I")
    made.add_sensor("again", "reaction", force="s", on="I", axes="global")
    result = simulate(made, duration=0.1, outputs=2, output=tmp_path)
    [one] = [v for v in vectors(Mechanism(result, 0.0), "reactions") if v.name == "s"]
    np.testing.assert_allclose(one.value, [0, 6, 8], atol=1e-9)
    assert one.offset is None and one.marker in ("ground", "ground.origin")
