"""Pictures of the modes of a machine: one per mode, displaced where the mode moves it."""

from __future__ import annotations

import numpy as np
import pytest
from restscenes import chain

import flexmb
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import view_of


@pytest.mark.seconds
def test_a_picture_and_a_vibration_for_each_mode(tmp_path):
    made = flexmb.linearize(chain())
    pictures = flexmb.render_mode_shapes(made, tmp_path, [1, 2, 9])
    assert [path.name for path in pictures] == ["mode_1.png", "mode_2.png"]
    assert all(path.stat().st_size > 5000 for path in pictures)
    rows = flexmb.load_result(tmp_path / "mode_1.h5")
    moved = rows.q[:, ::7] - made.state.q[::7]
    shape = np.sin(np.arange(1, 5) * np.pi / 5)
    np.testing.assert_allclose(moved[0] / moved[0, 0], shape / shape[0], rtol=1e-9)
    np.testing.assert_allclose(moved[12], -moved[0], atol=1e-12)
    mechanism = Mechanism(rows)
    caption = Drawing(mechanism, view_of(mechanism, {})).content().caption
    assert caption == "shape of a vibration, its amplitude is arbitrary"


@pytest.mark.seconds
def test_colours_of_a_mode_are_relative(tmp_path):
    model = flexmb.Model("beam")
    mesh = {"type": "beam", "length": 1.0, "divisions": 4}
    section = {"all": {"type": "circle", "radius": 0.01}}
    model.add_body(
        "beam", mesh=mesh, material="steel", sections=section, interfaces={"root": "start"}, modes=2
    )
    model.add_joint("wall", "fixed", between=["ground", "beam.root"])
    flexmb.render_mode_shapes(flexmb.linearize(model), tmp_path, [1])
    mechanism = Mechanism(flexmb.load_result(tmp_path / "mode_1.h5"))
    content = Drawing(mechanism, view_of(mechanism, {})).content()
    assert not content.outline  # of the undeformed bodies, which follow the slope at a joint
    scale = content.scale
    assert (scale.label, scale.top) == ("relative displacement", pytest.approx(1.0))


@pytest.mark.seconds
def test_a_vibration_along_the_joint_axes_is_seen_from_aside(tmp_path):
    model = flexmb.Model("rotor on a spring")
    model.add_body("mount", shape={"type": "box", "size": [1, 1, 0.2]}, density=1000)
    model.add_body("rotor", shape={"type": "box", "size": [0.5, 0.1, 0.1]}, density=1000)
    model.add_joint("guide", "prismatic", between=["ground", "mount"], axis="z")
    model.add_joint("shaft", "revolute", between=["mount", "rotor"], axis="z")
    model.add_force("bed", "translational-spring-damper", joint="guide", stiffness=1e5)
    model.add_force("coupling", "rotational-spring-damper", joint="shaft", stiffness=10.0)
    made = flexmb.linearize(model)
    for mode in (1, 2):
        flexmb.render_mode_shapes(made, tmp_path, [mode])
        mechanism = Mechanism(flexmb.load_result(tmp_path / f"mode_{mode}.h5"))
        towards = Drawing(mechanism, view_of(mechanism, {})).content().camera.direction
        along = np.abs(mechanism.result.q[0, 2] - mechanism.result.q[12, 2]) > 1e-3
        assert (abs(towards[2]) < 0.7) == along
