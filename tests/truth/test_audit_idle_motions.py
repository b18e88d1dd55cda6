"""Estimates of the audit for a rod that spins idly between two ball joints, and for rods that are
reduced again."""

from __future__ import annotations

import numpy as np
import pytest
from truth.test_audit_machines import left_out, slender

import flexmb
from flexmb.model import Model

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
RIGID = {"deformation": "rigid", "geometric_stiffening": "none"}


def spatial_crank(first="spherical", **strip):
    """A crank about y, a strip, and a slider along x beside the plane of the crank."""
    model, r, aside, L = Model("spatial slider-crank", gravity=[0, 0, -9.81]), 0.1, 0.08, 0.4
    along = np.array([np.sqrt(L**2 - r**2 - aside**2), -aside, -r]) / L
    turn = np.cross([1, 0, 0], along)
    angle = float(np.arctan2(np.linalg.norm(turn), along[0]))
    tilt = {"axis": (turn / np.linalg.norm(turn)).tolist(), "angle": angle}
    section = {"type": "rectangle", "y": 0.004, "z": 0.012}
    model.add_body("crank", mass=0.5, inertia=[1e-3] * 3)
    model.add_marker("crank.pin", position=[0, aside, r])
    fields = {**slender(L, 0.004, modes=3), "sections": {"all": section}, **strip}
    model.add_body("rod", **fields, position=[0, aside, r], orientation=tilt)
    model.add_body("slider", mass=0.3, inertia=[1e-4] * 3, position=[along[0] * L, 0, 0])
    model.add_joint("bearing", "revolute", between=["ground", "crank"], axis="y")
    model.add_joint("pin", first, between=["crank.pin", "rod.root"])
    model.add_joint("wrist", "spherical", between=["rod.tip", "slider"])
    model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    model.add_driver("motor", joint="bearing", angle="30*t")
    model.add_marker("rod.middle", position=[L / 2, 0, 0])
    model.add_sensor("middle", "position", of="rod.middle")
    model.add_sensor("pin", "reaction", joint="pin")
    model.set_dynamics(duration=0.4, outputs=100, accuracy=1e-5, start="quasi-static", verify=False)
    return model


def moved(model, by):
    """The same machine on a marker of the ground that lies elsewhere."""
    scene = model.to_scene_dict()
    for body in scene["bodies"].values():
        body["position"] = [a + b for a, b in zip(body.get("position", [0, 0, 0]), by, strict=True)]
    for joint in scene["joints"].values():
        joint["between"] = [f"{k}.there" if k == "ground" else k for k in joint["between"]]
    scene["ground"] = {"markers": {"there": {"position": by}}}
    return Model.from_scene_dict(scene)


@pytest.mark.seconds
@pytest.mark.parametrize(
    "by", [[0.0, 0.0, 0.0], pytest.param([1e3, 500.0, -300.0], marks=pytest.mark.slow)]
)
def test_a_strip_that_spins_idly_turns_its_soft_side_to_its_load(by, tmp_path):
    """The turns of its spin were taken for small ones, and its deflection grew with them. A
    reaction in axes that spin along turns by itself: 0.3 % were told for 13 %."""
    every = left_out(moved(spatial_crank(), by), tmp_path, RIGID, "deformation")
    for told, true in (every["middle"], every["pin"]):
        assert 1 / 3 < told / true < 3


@pytest.mark.slow
def test_a_reduction_of_another_mesh_in_the_folder_is_not_audited(tmp_path):
    """The audit of a rigid rod took the modes of one that an earlier run left in its folder."""
    thick = {"sections": {"all": {"type": "rectangle", "y": 0.02, "z": 0.03}}}
    before = spatial_crank(geometric_stiffening="full", **thick)
    flexmb.simulate(before, output=tmp_path / "both")
    found = []
    for folder in ("both", "fresh"):
        run = flexmb.simulate(spatial_crank(**RIGID), output=tmp_path / folder)
        (one,) = (one for one in flexmb.audit(run).effects if one.effect == "deformation")
        found.append(one.share)
    assert found[0] == pytest.approx(found[1], rel=1e-6)
