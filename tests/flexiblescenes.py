"""Scenes with flexible bodies whose accuracy is judged by runs that are far more accurate."""

from __future__ import annotations

import numpy as np
from femeshes import line

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}


def rod(height, length=0.45, elements=8, modes=4, **options):
    """A square bar of steel along x with an interface at each end."""
    return reduce(
        line(elements, end=(length, 0, 0)), material=STEEL, modes=modes,
        interfaces={"root": "root", "tip": "tip"}, sections={"all": rectangle(height, height)},
        **options,
    )  # fmt: skip


def flexible_pendulum():
    made = Model("flexible pendulum", gravity=[0, -9.81, 3.0])
    made.add_body("rod", rod(0.002))
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


def flexible_crank(**effects):
    made = Model("flexible crank")
    made.add_body("crank", mass=1.0, inertia=[0.01] * 3)
    made.add_marker("crank.pin", position=[0.15, 0, 0])
    made.add_body("rod", rod(0.012), position=[0.15, 0, 0], **effects)
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[0.6, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle="150*t")
    made.add_sensor("slider", "position", of="slider")
    return made


def four_bar_with_a_beam():
    """Its coupler a beam of 1 m; the crank turns once, within 1.2 s from rest to rest."""
    made = Model("four-bar with a beam")
    made.add_body("crank", mass=0.5, inertia=[0.01] * 3, center=[0, 0.1, 0])
    made.add_marker("crank.pin", position=[0, 0.2, 0])
    made.add_body("beam", rod(0.01, 1.0, 10, 8), position=[0, 0.2, 0])
    made.add_marker("ground.right", position=[1.0, -0.4, 0])
    made.add_body("rocker", mass=1.0, inertia=[0.05] * 3, center=[0, 0.3, 0],
                  position=[1.0, -0.4, 0])  # fmt: skip
    made.add_marker("rocker.pin", position=[0, 0.6, 0])
    made.add_joint("left", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("crank_pin", "spherical", between=["crank.pin", "beam.root"])
    made.add_joint("rocker_pin", "revolute", between=["beam.tip", "rocker.pin"], axis="z")
    made.add_joint("right", "cylindrical", between=["ground.right", "rocker"], axis="z")
    made.add_driver("motor", joint="left", angle={"type": "step", "t1": 1.2, "y1": 2 * np.pi})
    made.add_sensor("pin", "position", of="rocker.pin")
    return made


def suddenly_loaded_beam():
    """A cantilever of 1 m with 16 modes, a force of 10 N at its tip from the first moment on."""
    made = Model("cantilever")
    made.add_body("beam", rod(0.01, 1.0, 20, 16))
    made.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    made.add_force("load", "force", at="beam.tip", value=[0, 10.0, 0])
    made.add_sensor("tip", "position", of="beam.tip")
    return made


BEAM_PERIOD = 2 * np.pi / (1.8751041**2 * np.sqrt(STEEL["E"] * 0.01**2 / 12 / STEEL["density"]))
"""s, of the first swing of that cantilever (Euler's beam)."""
