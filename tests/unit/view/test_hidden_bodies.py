"""What hides what in a picture, and what is drawn so that it is seen."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb import simulate
from flexmb.model import Model
from flexmb.view.camera import Camera, visible_shares
from flexmb.view.content import Content
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import view_of
from flexmb.view.shapes import box


def compose(mechanism: Mechanism, **words) -> Content:
    return Drawing(mechanism, view_of(mechanism, words)).content()


def test_hidden_parts_count_as_hidden() -> None:
    camera = Camera((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 60)] * 2), axis=-1).reshape(-1, 2)
    plate = np.column_stack([grid, np.zeros(len(grid))])
    behind = box((0.3, 0.3, 0.3)).points + [0, 0, -1]
    beside = box((0.3, 0.3, 0.3)).points + [3, 0, -1]
    assert list(visible_shares(camera, [plate, behind])) == [1.0, 0.0]
    assert list(visible_shares(camera, [plate, beside])) == [1.0, 1.0]
    other = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    assert visible_shares(other, [plate, behind])[1] == 1.0


def _discs(hidden: float) -> Mechanism:
    """Two discs on an axis, the nearer one of radius 0.18 and in front of the other from +z."""
    model = Model("two discs")
    model.add_body("near", shape={"type": "cylinder", "radius": 0.18, "length": 0.04}, mass=1)
    far = {"type": "cylinder", "radius": hidden, "length": 0.03}
    model.add_body("far", shape=far, mass=1, position=[0, 0, -0.05])
    return Mechanism(simulate(model, duration=0.1, outputs=2))


@pytest.mark.parametrize("camera", ["top", "bottom"])
def test_a_body_behind_another_is_seen_through_it(camera: str) -> None:
    solids = compose(_discs(0.15), camera=camera).solids
    opacity = {solid.name: solid.opacity for solid in solids if solid.role == "body"}
    assert (opacity["near"] < 1.0) is (camera == "top")  # from below a ring of it is seen
    assert opacity["far"] == 1.0


def test_a_body_that_is_seen_in_part_leaves_others_opaque() -> None:
    solids = compose(_discs(0.25), camera="top").solids
    assert {solid.opacity for solid in solids if solid.role == "body"} == {1.0}


def test_contact_surfaces_that_a_body_does_not_show_are_drawn() -> None:
    """A pawl's round nose and the teeth of its wheel, but not what a ball and a wheel roll on."""
    model = Model("ratchet")
    model.add_body("wheel", shape={"type": "cylinder", "radius": 0.4, "length": 0.1}, mass=1)
    model.add_body(
        "pawl", shape={"type": "box", "size": [0.5, 0.08, 0.08]}, mass=1, position=[0, 1, 0]
    )
    model.add_body("ball", shape={"type": "sphere", "radius": 0.1}, mass=1, position=[0, 3, 0])
    model.add_marker("pawl.nose", position=[-0.25, 0, 0])
    teeth = {"type": "points", "points": [[0.5, 0, 0], [-0.5, 0, 0], [0, 0.5, 0]]}
    nose, ball = {"type": "sphere", "radius": 0.06}, {"type": "sphere", "radius": 0.1}
    model.add_force(
        "mesh", "contact", between=["wheel", "pawl.nose"], shapes=[teeth, nose], stiffness=1e6
    )
    model.add_force(
        "other", "contact", between=["wheel", "ball"], shapes=[teeth, ball], stiffness=1e6
    )
    lane = [{"type": "sphere", "radius": 0.4}, {"type": "sphere", "radius": 0.1}]
    model.add_force("lane", "contact", between=["wheel", "ball"], shapes=lane, stiffness=1e6)
    solids = compose(Mechanism(simulate(model, duration=0.01, outputs=2))).solids
    drawn = [solid for solid in solids if solid.role == "force"]
    centers = [solid.points.mean(axis=0) for solid in drawn]
    assert [solid.name for solid in drawn] == ["mesh", "mesh", "other"]
    np.testing.assert_allclose(centers[1], [-0.25, 1, 0], atol=1e-9)  # the nose
    assert np.linalg.norm(drawn[0].points, axis=1).max() > 0.5  # the teeth


@pytest.mark.parametrize("shaped", [True, False])
def test_a_contact_plane_on_a_body_with_a_shape_is_that_shape(shaped: bool) -> None:
    """A plate of the size of the way beside it hid the tappet that carries it."""
    model = Model("table")
    shape = {"shape": {"type": "box", "size": [1, 1, 0.1]}} if shaped else {"inertia": [1, 1, 1]}
    model.add_body("table", mass=1, **shape)
    model.add_marker("table.top", position=[0, 0, 0.05])
    model.add_body("ball", shape={"type": "sphere", "radius": 0.1}, mass=1, position=[0, 0, 1])
    sides = [{"type": "sphere", "radius": 0.1}, {"type": "plane"}]
    model.add_force("c", "contact", between=["ball", "table.top"], shapes=sides, stiffness=1e6)
    solids = compose(Mechanism(simulate(model, duration=0.01, outputs=2))).solids
    assert any(solid.role == "surface" for solid in solids) is not shaped


def test_the_view_is_fitted_to_brackets_of_ground_beside_a_grid() -> None:
    """With a grid it was fitted before they were there: they were cut off below."""
    model = Model("leg", gravity=[0, 0, -9.81])
    model.add_body(
        "leg", shape={"type": "box", "size": [0.1, 0.1, 1]}, mass=1, position=[0, 0, 0.5]
    )
    model.add_marker("leg.foot", position=[0, 0, -0.5])
    model.add_joint("foot", "universal", between=["ground", "leg.foot"], axis="x", second_axis="y")
    model.add_driver("turn", joint="foot", angle="0.1*t")
    mechanism = Mechanism(simulate(model, duration=0.1, outputs=2))
    for grid in ("off", "on"):
        content = compose(mechanism, grid=grid)
        bracket = np.vstack([one.points for one in content.solids if one.role == "ground"])
        assert content.extent is not None
        assert content.extent.min(axis=0)[2] <= bracket.min(axis=0)[2]


def test_the_brake_of_a_joint_stands_on_its_pin() -> None:
    """Its disc hung in the air beyond a long pin."""
    model = Model("clutch")
    model.add_body("disc", shape={"type": "cylinder", "radius": 0.2, "length": 0.06}, mass=1)
    model.add_joint("pin", "revolute", between=["ground", "disc"], axis="z")
    lining = {"dynamic": 0.3, "radius": 0.1, "preload": 10, "stiffness": 1e4}
    model.add_force("lining", "joint-friction", joint="pin", **lining)
    solids = compose(Mechanism(simulate(model, duration=0.01, outputs=2))).solids
    ends = [
        (solid.points.min(axis=0)[2], solid.points.max(axis=0)[2])
        for name in ("pin", "lining")
        for solid in solids
        if solid.name == name
    ]
    pin, brake = max(end[1] for end in ends[:2]), ends[2]
    assert brake[0] < pin < brake[1]
