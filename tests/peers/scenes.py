"""The mechanisms that are compared: in flexmb, and where their points are at the end."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexmb.model import Model
from tests.accuracyscenes import machines, pendulums

G = 9.81
N_CHAIN = 10


@dataclass(frozen=True)
class Compared:
    """A model of flexmb, its end, and the channels whose end is compared, by a known solution.

    Attributes
    ----------
    make : callable
        The model.
    duration : float
        s.
    size : float
        m; errors are told over it.
    truth : callable
        Channels over time, as `accuracyscenes` have them.
    channels : tuple of str
        Coordinates of points, compared at the end.
    """

    make: Callable[[], Model]
    duration: float
    size: float
    truth: Callable
    channels: tuple[str, ...]

    @functools.cache  # noqa: B019
    def end(self):
        """(channels,) m at the end, by the known solution."""
        found = self.truth(np.array([0.0, self.duration]))
        return np.array([found[channel][-1] for channel in self.channels])


def slider_crank():
    """The slider-crank of `accuracyscenes`, in its plane."""
    made = Model("slider-crank", plane="xy", gravity=[0, -G, 0])
    r, rod = machines.R, machines.L
    made.add_body("crank", mass=2, center=[r / 2, 0, 0], inertia=[0.01] * 3)
    made.add_body("rod", mass=1, center=[rod / 2, 0, 0], inertia=[0.02] * 3, position=[r, 0, 0])
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[r + rod, 0, 0])
    made.add_marker("crank.pin", position=[r, 0, 0])
    made.add_marker("rod.end", position=[rod, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "revolute", between=["crank.pin", "rod"], axis="z")
    made.add_joint("wrist", "revolute", between=["rod.end", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_force("torque", "torque", at="crank", value=[0, 0, 5])
    made.add_sensor("slider", "position", of="slider")
    made.add_sensor("pin", "position", of="crank.pin")
    return made


def chain():
    """Ten links in a plane, let go from the horizontal."""
    scene = pendulums.links(N_CHAIN).to_scene_dict()
    return Model.from_scene_dict({**scene, "plane": "xy"})


_ENDS = tuple(f"end{k}.{axis}" for k in range(N_CHAIN) for axis in "xy")

SCENES = {
    "slider-crank": Compared(
        slider_crank, 1.0, 0.3, machines.slider_crank_truth, ("slider.x", "pin.x", "pin.y")
    ),
    "Andrews": Compared(
        machines.andrews, 0.03, 0.014, machines.andrews_truth, ("E.x", "E.y")
    ),
    "spatial slider-crank": Compared(
        machines.spatial_crank, 2.0, 0.2, machines.spatial_crank_truth,
        ("slider.x", "pin.y", "pin.z"),
    ),
    "chain of 10": Compared(
        chain, 1.0, float(N_CHAIN), pendulums.links_truth(N_CHAIN), _ENDS
    ),
}  # fmt: skip
"""By name."""
