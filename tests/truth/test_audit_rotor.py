"""The audit of a rotor in bearings that stand still: coefficients that turn with it."""

from __future__ import annotations

import numpy as np
import pytest

import flexmb
from flexmb.model import Model


def rotor(modes: int) -> Model:
    """A round shaft with an unbalanced disk between a hub on a pin and one on a ball joint."""
    made = Model("rotor", gravity=[0, -9.81, 0])
    made.add_body(
        "shaft", mesh={"type": "beam", "length": 1.0, "divisions": 12}, material="steel",
        sections={"all": {"type": "circle", "radius": 0.012}}, modes=modes,
        interfaces={"a": "start", "b": "end", "disk": {"node": 4}}, geometric_stiffening="full",
    )  # fmt: skip
    made.add_body("disk", mass=8.0, inertia=[0.06, 0.03, 0.03], center=[0, 3e-4, 0],
                  position=[1 / 3, 0, 0])  # fmt: skip
    made.add_marker("ground.end", position=[1, 0, 0])
    axial = {"left": 1e7, "right": 1e5}
    for name, place, ground in (("left", 0.0, "ground"), ("right", 1.0, "ground.end")):
        made.add_body(name, mass=0.5, inertia=[1e-3, 1e-3, 1e-3], position=[place, 0, 0])
        made.add_force(
            f"bearing_{name}", "bushing", between=[ground, name], damping=[100, 200, 200],
            stiffness=[axial[name], 3e6, 3e6], rotational_stiffness=1e4, rotational_damping=1.0,
        )  # fmt: skip
    made.add_joint("seat", "fixed", between=["shaft.disk", "disk"])
    made.add_joint("pin", "revolute", between=["left", "shaft.a"], axis="x")
    made.add_joint("ball", "spherical", between=["right", "shaft.b"])
    turn = {"type": "step5", "t1": 0.5, "y1": 120.0}
    made.add_driver("motor", joint="pin", angle=turn, prescribes="velocity")
    made.add_sensor("disk", "position", of="disk")
    made.set_dynamics(duration=1.0, accuracy=1e-6, outputs=800)
    return made


@pytest.mark.slow
def test_further_modes_of_a_rotor_change_as_little_as_they_do(tmp_path):
    """Vibrations near half a period per row were excited by the steps of what turns: unbounded."""
    run = flexmb.simulate(rotor(6), output=tmp_path / "few")
    more = flexmb.simulate(rotor(12), output=tmp_path / "more")
    size = max(np.ptp(more[f"disk.{axis}"]) for axis in "xyz")
    true = max(np.abs(run[f"disk.{axis}"] - more[f"disk.{axis}"]).max() for axis in "xyz") / size
    assert true < 1e-3
    (one,) = (one for one in flexmb.audit(run).effects if one.effect == "further modes")
    assert one.share < 0.01
    assert one.verdict == "may stay off"
