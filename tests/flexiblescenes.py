"""Scenes with flexible bodies whose accuracy is judged by runs that are far more accurate."""

from __future__ import annotations

from femeshes import line

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}


def rod(height):
    return reduce(
        line(8, end=(0.45, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
        modes=4, sections={"all": rectangle(height, height)},
    )  # fmt: skip


def flexible_pendulum():
    made = Model("flexible pendulum", gravity=[0, -9.81, 3.0])
    made.add_body("rod", rod(0.002))
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


def flexible_crank():
    made = Model("flexible crank")
    made.add_body("crank", mass=1.0, inertia=[0.01] * 3)
    made.add_marker("crank.pin", position=[0.15, 0, 0])
    made.add_body("rod", rod(0.012), position=[0.15, 0, 0])
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[0.6, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle="150*t")
    made.add_sensor("slider", "position", of="slider")
    return made
