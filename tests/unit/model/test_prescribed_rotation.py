"""Accelerations of a body that a driver turns, before anything is run: those of a circle."""

from __future__ import annotations

import numpy as np

from flexmb.fe import reduce
from flexmb.model import Model
from flexmb.model.excitation import _accelerations


def test_the_centre_goes_round_the_hinge():
    """C has α × (C − P) − ω² (C − P) about a hinge P."""
    angle, place = 0.6, np.array([1.0, -2.0, 0.5])
    model = Model("bar")
    body = reduce({"type": "beam", "length": 1.0, "divisions": 4}, material="steel", modes=1,
                  interfaces={"root": "start", "tip": "end"},
                  sections={"all": {"type": "rectangle", "y": 0.02, "z": 0.02}})  # fmt: skip
    model.add_body("bar", body, position=place.tolist(),
                   orientation={"axis": "z", "angle": f"{angle} rad"})  # fmt: skip
    A = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    model.add_marker("ground.pivot", position=(place + A @ [1.0, 0, 0]).tolist())
    model.add_joint("hinge", "revolute", between=["ground.pivot", "bar.tip"], axis="z")
    model.add_driver("motor", joint="hinge", angle="3*t + 2*t**2")
    model.set_dynamics(duration=1.0, outputs=10)
    (c,) = _accelerations(model, "bar", {"bar": body})
    arm = A @ [-0.5, 0, 0]
    wanted = np.cross([0, 0, 4.0], arm) - 7.0**2 * arm  # in the end
    np.testing.assert_allclose(A @ c[-1, :3], wanted, rtol=1e-9, atol=1e-9)
