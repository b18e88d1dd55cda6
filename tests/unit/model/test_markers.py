"""Markers: automatic ones, carriers on flexible bodies, frames of joints."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from flexmb.errors import FlexmbWarning, SceneError
from flexmb.flexbody import FlexBody, Interface, NodeModes, rigid_body
from flexmb.model import Model
from flexmb.model.lookup import frames, place_marker, pose
from flexmb.model.markers import rotation_matrix


@pytest.fixture
def beam():
    """Two coordinates, two interfaces, three nodes on the x axis."""
    rng = np.random.default_rng(3)
    Phi = rng.normal(size=(3, 3, 2))
    position = np.array([[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
    ends = [Interface(name, position[k], Phi[k], Phi[k]) for name, k in (("left", 0), ("right", 2))]
    return FlexBody(
        name="beam",
        mass=1.0,
        S1=[0.5, 0, 0],
        S0=np.diag([1 / 3, 1e-3, 1e-3]),
        p=np.zeros((3, 2)),
        P=np.zeros((3, 3, 2)),
        Mab=np.eye(3)[:, :, None, None] * np.eye(2) / 3,
        K=np.eye(2),
        interfaces=tuple(ends),
        nodes=NodeModes(np.array([7, 8, 9]), position, Phi, Phi),
    )


@pytest.fixture
def model(beam):
    model = Model("m")
    model.add_body("crank", mass=1, inertia=[1, 1, 1], center=[0.5, 0, 0], position=[1, 2, 3])
    model.add_body("beam", beam, orientation={"axis": "z", "angle": "90 deg"})
    model.add_marker("crank.tip", position=[1, 0, 0])
    model.add_marker("beam.middle", node=8)
    model.add_marker("beam.near", position=[0.6, 0.1, 0])
    model.add_marker("beam.eye", interface="right", position=[1, 0, 0.2])
    model.add_marker("ground.wall", position=[0, 0, 1])
    return model


def test_automatic_markers(model):
    assert model.marker("crank").name == "origin"
    assert model.marker("crank.center").spec.position == (0.5, 0, 0)
    assert model.marker("beam.right").spec.interface == "right"
    assert model.marker("ground.wall").spec.position == (0, 0, 1)


def test_a_node_or_an_interface_carries_a_flexible_marker(model, beam):
    middle = place_marker(model, "beam.middle")
    np.testing.assert_array_equal(middle.rho, [0.5, 0, 0])
    np.testing.assert_array_equal(middle.Phi_t, beam.nodes.Phi_t[1])
    near = place_marker(model, "beam.near")
    np.testing.assert_allclose(near.rho, [0.5, 0, 0])
    np.testing.assert_allclose(near.arm, [0.1, 0.1, 0])
    eye = place_marker(model, "beam.eye")
    np.testing.assert_allclose(eye.arm, [0, 0, 0.2])
    np.testing.assert_array_equal(eye.Phi_r, beam.interfaces[1].Phi_r)
    assert place_marker(model, "beam.origin").Phi_t is None


def test_a_body_without_modes_carries_markers_anywhere(model):
    model.add_body("block", rigid_body(2.0, (0.1, 0, 0), 1.0))
    model.add_marker("block.corner", position=[1, 2, 3])
    model.add_joint("weld", "fixed", between=["crank.tip", "block.corner"])
    model.validate()
    corner = place_marker(model, "block.corner")
    np.testing.assert_array_equal(corner.position, [1, 2, 3])
    assert corner.Phi_t is None
    np.testing.assert_allclose(place_marker(model, "block.center").position, [0.1, 0, 0])
    model.add_marker("block.pin", node=3)
    with pytest.raises(SceneError, match="bodies.block.markers.pin: .*holds no nodes"):
        model.validate()


def test_a_marker_far_from_its_body_is_warned_of(model, beam):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.validate({"beam": beam})
    model.add_marker("beam.lost", position=[100, 0, 0])
    model.validate()  # said once the bodies are known, not each time
    with pytest.warns(FlexmbWarning, match="bodies.beam.markers.lost: lies 99 m from") as told:
        model.validate({"beam": beam})
    assert len(told) == 1


def test_joint_frames_coincide_in_the_placed_pose(model):
    axis = np.array([0.6, 0.0, 0.8])
    I, J = frames(model, ("crank.tip", "beam.left"), axis)  # noqa: E741
    world = [rotation_matrix(pose(model.bodies[marker.body])[1]) @ marker.R for marker in (I, J)]
    np.testing.assert_allclose(world[0], world[1], atol=1e-15)
    np.testing.assert_allclose(world[0][:, 2], axis, atol=1e-15)


def test_unknown_markers_list_what_there_is(model):
    with pytest.raises(SceneError, match='no marker "rigt"; nearest: right; allowed: origin, left'):
        model.marker("beam.rigt")
    with pytest.raises(SceneError, match='unknown body "crnk"; nearest: crank'):
        model.marker("crnk.tip")
    with pytest.raises(SceneError, match='unknown body "crnk"'):
        model.add_marker("crnk.tip")


def test_a_node_that_does_not_exist(model):
    model.add_marker("beam.far", node=99)
    with pytest.raises(
        SceneError, match="bodies.beam.markers.far: .*no node 99; it has nodes 7 to 9"
    ):
        model.validate()


def test_a_joint_needs_a_material_point(model):
    model.add_joint("j", "spherical", between=["crank.tip", "beam"])
    with pytest.raises(
        SceneError, match="floating frame of a flexible body.*beam.left, beam.right"
    ):
        model.validate()
