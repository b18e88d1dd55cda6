"""Models with gears for tests of what a scene says of them."""

from __future__ import annotations

from flexmb.model import Model


def wheels(units="SI", second_axis="z", at=(0.3, 0.0, 0.0), backwards=False):
    """Two wheels on ground about axes of one direction or another."""
    model = Model("gears", units=units)
    model.add_marker("ground.second", position=list(at))
    for name, place, axis in (("a", (0, 0, 0), "z"), ("b", at, second_axis)):
        model.add_body(name, mass=1, inertia=[1, 1, 1], position=list(place))
        ends = ["ground" if name == "a" else "ground.second", name]
        if backwards and name == "b":
            ends = ends[::-1]
        model.add_joint(f"pin_{name}", "revolute", between=ends, axis=axis)
    return model


def planetary(planets=1):
    model = Model("planetary")
    model.add_body("arm", mass=1, inertia=[1, 1, 1])
    model.add_body("wheel", mass=1, inertia=[1, 1, 1])
    model.add_joint("arm_pin", "revolute", between=["ground", "arm"], axis="z")
    model.add_joint("sun_pin", "revolute", between=["arm", "wheel"], axis="z")
    for k in range(planets):
        suffix, at = ("", "_b", "_c")[k], [0.3 * (-1) ** k, 0.0, 0.0]
        model.add_body(f"planet{suffix}", mass=1, inertia=[1, 1, 1], position=at)
        model.add_marker(f"arm.pin{suffix}", position=at)
        pins = [f"arm.pin{suffix}", f"planet{suffix}"]
        model.add_joint(f"pin{suffix}", "revolute", between=pins, axis="z")
        model.add_coupler(
            f"sun{suffix}", "gear", joints=["sun_pin", f"pin{suffix}"], teeth=[20, 10]
        )
        model.add_coupler(
            f"ring{suffix}", "gear", joints=["arm_pin", f"pin{suffix}"], teeth=[40, 10],
            internal=True,
        )  # fmt: skip
    return model
