"""Joints on curves give their bodies something to show: cams, wires, rollers, flats."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model
from flexmb.view.body_shapes import curve_shapes


class Still:
    """A mechanism of rigid bodies, without a run."""

    def __init__(self, model: Model) -> None:
        self.model, self.flexbodies = model, {}


def train() -> Model:
    model = Model("train")
    model.add_curve("oval", x="2*cos(t)", y="sin(t)", closed=True)
    model.add_curve("line", points=[[0, 0], [4, 0]])
    for name in ("cam", "roller", "flat", "pin"):
        model.add_body(name, mass=1, inertia=[1, 1, 1])
    model.add_joint("r", "cam-roller", between=["cam", "roller"], curve="oval", radius=0.3)
    model.add_joint("f", "cam-flat", between=["cam", "flat"], curve="oval", axis="x")
    model.add_joint("s", "pin-in-slot", between=["roller", "pin"], curve="line")
    return model


def test_every_side_shows_its_part_in_the_axes_of_its_body() -> None:
    shown = Still(train())
    plates = curve_shapes(shown, "cam", 1.0)
    assert len(plates) == 2  # one for each joint
    np.testing.assert_allclose(np.ptp(plates[0].points, axis=0), [4.0, 2.0, 0.06], atol=2e-2)
    np.testing.assert_allclose(plates[0].points.mean(axis=0), 0.0, atol=2e-2)
    disk, wire = curve_shapes(shown, "roller", 1.0)
    np.testing.assert_allclose(np.ptp(disk.points, axis=0)[:2], 0.6, atol=2e-3)
    np.testing.assert_allclose(np.ptp(wire.points, axis=0)[0], 4.0, atol=1e-9)
    (pad,) = curve_shapes(shown, "flat", 1.0)
    assert np.argmin(np.ptp(pad.points, axis=0)) == 0  # across the axis, x
    (pin,) = curve_shapes(shown, "pin", 1.0)
    assert np.argmax(np.ptp(pin.points, axis=0)) == 2  # along the normal of the curve's plane
