"""Where deformed bodies and their markers are drawn, by plain vectors; strain energy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmb import Model, simulate
from flexmb.view import fields
from flexmb.view.joint_shapes import joint_parts
from flexmb.view.mechanism import Display, Mechanism, inverse, rotation, transform

RNG = np.random.default_rng(2)
ETA = np.array([0.02, -0.01])
MARKER = SimpleNamespace(
    body="a", position=np.array([0.5, 0.2, -0.1]), arm=np.array([0.1, -0.3, 0.2]), R=np.eye(3),
    Phi_t=RNG.normal(size=(3, 2)), Phi_r=RNG.normal(size=(3, 2)),
)  # fmt: skip


def mechanism():
    """A body with one marker, deformed."""
    made = SimpleNamespace(marker=lambda _: MARKER, pose=lambda _: SimpleNamespace(eta=ETA))
    made.motion = lambda reference: Mechanism.motion(made, reference)
    return made


def test_rotations_and_their_inverse():
    turn = np.array([0.7, -0.4, 1.1])
    np.testing.assert_allclose(rotation(turn), Rotation.from_rotvec(turn).as_matrix(), atol=1e-14)
    T = transform(rotation(turn), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-14)


def test_a_marker_on_an_arm_moves_with_the_turn_of_its_node():
    u, turn = mechanism().motion("a.eye")
    np.testing.assert_allclose(turn, MARKER.Phi_r @ ETA)
    np.testing.assert_allclose(u, MARKER.Phi_t @ ETA + np.cross(turn, MARKER.arm), atol=1e-15)


def test_the_undeformed_body_stands_where_its_reference_is():
    """The marker that deformation is relative to is at one place, deformed or not."""
    view = SimpleNamespace(mechanism=mechanism(), reference_of=lambda _: "a.eye")
    link = SimpleNamespace(body="a", reference=None, holds=())
    R, d = Display._reference(view, link)
    u, _ = view.mechanism.motion("a.eye")
    np.testing.assert_allclose(R @ MARKER.position + d, MARKER.position + u, atol=1e-15)


def test_strain_energy_of_single_stresses(monkeypatch):
    """sigma^2/(2 E) of tension and tau^2/(2 G) of shear per volume."""
    monkeypatch.setattr(fields, "_materials", lambda _: [(200e9, 0.3)])
    body = SimpleNamespace(stress=SimpleNamespace(part=np.zeros(6, int)))
    found = fields._strain_energy(body, 5e6 * np.eye(6), slice(None))
    assert found[:3] == pytest.approx([5e6**2 / (2 * 200e9)] * 3)
    assert found[3:] == pytest.approx([5e6**2 / (2 * 200e9 / 2.6)] * 3)


@pytest.fixture(scope="module")
def supported():
    """A beam on a pin and a roller, bent by its weight alone: 5 q L⁴/(384 E I) in its middle."""
    model = Model("beam", gravity=[0, -9.81, 0])
    model.add_body(
        "beam", mesh={"type": "beam", "length": 2.0, "divisions": 8}, material="steel", modes=4,
        sections={"all": {"type": "rectangle", "y": 0.02, "z": 0.02, "orientation": "y"}},
        interfaces={"left": "start", "right": "end"},
    )  # fmt: skip
    model.add_joint("pin", "revolute", between=["ground", "beam.left"], axis="z")
    model.add_joint("roller", "in-plane", between=["ground", "beam.right"], axis="y")
    model.add_joint("side", "in-plane", between=["ground", "beam.right"], axis="z")
    return Mechanism(simulate(model, duration=0.01, outputs=2, start="quasi-static"))


def test_a_beam_on_a_pin_and_a_roller_is_drawn_on_both(supported):
    """Its end was drawn off the roller by twice the sag times the factor."""
    display = Display(supported, 50.0)
    for end, x in (("left", 0.0), ("right", 2.0)):
        np.testing.assert_allclose(display.point(f"beam.{end}"), [x, 0, 0], atol=1e-6)
    drawn, undeformed, sizes = display.surface("beam")
    sag = 5 * 7850 * 9.81 * 0.02**2 * 2.0**4 / (384 * 210e9 * 0.02**4 / 12)
    assert sizes.max() == pytest.approx(sag, rel=0.01)
    assert (undeformed - drawn)[:, 1].max() == pytest.approx(50 * sag, rel=0.01)


def test_the_plate_of_a_roller_lies_below_it(supported):
    """It was drawn about the marker on ground, at the other end of the beam."""
    (plate, ball) = (part.solid(Display(supported)) for part in joint_parts(supported, 0.01, {})
                     if part.name == "roller")  # fmt: skip
    np.testing.assert_allclose(plate.points.mean(axis=0), [2, 0, 0], atol=1e-3)
    np.testing.assert_allclose(ball.points.mean(axis=0), [2, 0, 0], atol=1e-3)
