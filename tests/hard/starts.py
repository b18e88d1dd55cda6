"""Bad starts: bodies out of place, velocities that do not fit, nothing that moves, jumps."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model
from tests.hard.case import Hard, largest

G = 9.81
RUN = {"duration": 1.0, "outputs": 50, "accuracy": 1e-5}
METHODS = {
    "auto": {}, "generalized-alpha": {"accuracy": None, "step": 1e-3}, "explicit-rk": {},
    "radau": {},
}  # fmt: skip


def pendulum(position=(0.0, 0.0, 0.0), **fields):
    """A rod of 1 m on a pin at the origin, hanging."""
    made = Model("pendulum", gravity=[0, -G, 0])
    made.add_body("rod", mass=1, center=[0, -0.5, 0], inertia=[1 / 12, 1e-3, 1 / 12],
                  position=list(position), **fields)  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground", "rod"], axis="z")
    made.add_sensor("swing", "angle", joint="pin")
    return made


def held():
    """Everything is fixed; what holds it carries the weight."""
    made = Model("held", gravity=[0, -G, 0])
    made.add_body("block", mass=2, inertia=[1, 1, 1])
    made.add_joint("weld", "fixed", between=["ground", "block"])
    made.add_sensor("place", "position", of="block")
    made.add_sensor("force", "reaction", joint="weld", on="J")
    return made


def driven(angle):
    made = pendulum()
    made.add_driver("motor", joint="pin", angle=angle)
    return made


def touching():
    """A ball begins 1 mm deep in a plane without losses: the energy there throws it up."""
    made = Model("touching", gravity=[0, 0, -G])
    made.add_body("ball", mass=1, inertia=[0.004] * 3, position=[0, 0, 0.099])
    made.add_force("floor", "contact", between=["ball", "ground"], exponent=1, stiffness=1e5,
                   shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}])  # fmt: skip
    made.add_sensor("ball", "position", of="ball")
    return made


def off_throw(run):
    """k d^2/2 = m g (h + d): 0.0041 m above the plane."""
    height = 1e5 * 1e-3**2 / (2 * G) - 1e-3
    return abs(run["ball.z"].max() - 0.1 - height) / height


def free():
    made = Model("free")
    made.add_body("block", mass=2, inertia=[1, 1, 1])
    made.add_sensor("place", "position", of="block")
    return made


CASES = {
    "a body far from its joint": Hard(
        "The pin stands half a metre away from the rod: which of both is meant?",
        "Refused before the run, with the distance and the cure.",
        0.0, lambda: pendulum([0.5, 0, 0]), run=RUN, methods=METHODS,
        stops={"all": "would have to move by 0.5 m"},
    ),
    "velocities that the joint forbids": Hard(
        "The rod has 3 m/s at its pin, which stands still, and turns with 1 rad/s.",
        "What the joint forbids is told and changed least: it swings from 1 rad/s, to 1e-3 of it.",
        1e-3, lambda: pendulum(velocity=[3.0, 0, 0], angular_velocity=[0, 0, 1.0]),
        lambda run: abs(largest(run["swing"]) / np.arccos(1 - 1 / (3 * G)) - 1),
        {**RUN, "outputs": 400}, METHODS, warns="does not fit the joints",
    ),
    "everything is held": Hard(
        "No freedom is left.",
        "Nothing moves by more than round-off, and the weld carries 19.62 N.",
        1e-12, held,
        lambda run: largest(run["place.x"], run["place.y"], np.abs(run["force.y"]) / (2 * G) - 1),
        RUN, METHODS,
    ),
    "no forces": Hard(
        "A body at rest without weight: no scale of motion at all.",
        "It stays where it is, exactly.",
        0.0, free, lambda run: largest(run["place.x"], run["place.y"]), RUN, METHODS,
    ),
    "a driver that jumps at once": Hard(
        "The angle is a step at t = 0.5 s.",
        "Refused: no force moves a body at once.",
        0.0, lambda: driven("0.2*sign(t - 0.5) + 0.2"), run=RUN, methods=METHODS,
        stops={"all": "jumps at t = 0.5 s"},
    ),
    "a driver that begins elsewhere": Hard(
        "The rod hangs, the driver begins at 0.3 rad.",
        "The rod is brought there before the run: the angle is that of the driver to 1e-9 rad.",
        1e-9, lambda: driven("0.3 + 0.1*t**2"),
        lambda run: largest(run["swing"] - 0.3 - 0.1 * run.time**2), RUN, METHODS,
    ),
    "a contact that begins deep": Hard(
        "The ball stands 1 mm in the plane at t = 0.",
        "It is thrown up by the energy of the spring of contact: height to 1 %.",
        0.01, touching, off_throw, {**RUN, "duration": 0.05, "outputs": 200},
        {**METHODS, "generalized-alpha": {"accuracy": None, "step": 5e-5}},
    ),
}  # fmt: skip
