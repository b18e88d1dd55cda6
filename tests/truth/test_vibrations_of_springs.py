"""Vibrations that only the force of a spring shows: the run states what its sensor lacks.

Two masses in guides along x, the first on a soft spring, the second on it by a stiff one, let go
from 0.2 m. No joint feels the vibration of the second, and its first acceleration is zero. The
motion is that of M ẍ + C ẋ + K x = 0, by the modes of the damped system.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes.judging import largest_error
from truthkit import run

from flexmb.model import Model

SOFT, MASS = 10.0, 0.01  # N/m; kg, of the second body


def chain(stiffness, damping):
    made = Model("chain")
    for name, place, mass in (("first", 1.0, 1.0), ("second", 2.0, MASS)):
        made.add_body(name, mass=mass, inertia=[1, 1, 1], position=[place, 0, 0])
        made.add_joint(name, "prismatic", between=["ground", name], axis="x")
        made.add_sensor(f"at_{name}", "position", of=name)
        made.add_sensor(f"speed_{name}", "velocity", of=name)
    made.add_force("soft", "spring-damper", between=["ground", "first"], stiffness=SOFT,
                   free_length=0.8)  # fmt: skip
    made.add_force("stiff", "spring-damper", between=["first", "second"], stiffness=stiffness,
                   damping=damping, free_length=1)  # fmt: skip
    made.add_sensor("force", "reaction", force="stiff", quantity="force", axes="global")
    return made


def truth(stiffness, damping, t):
    """In √k times elongations and √m times speeds, in which stiff springs spoil no digits."""
    soft, stiff, m = np.sqrt(SOFT), np.sqrt(stiffness), np.sqrt(MASS)
    A = np.array([
        [0, 0, soft, 0],
        [0, 0, -stiff, stiff / m],
        [-soft, stiff, -damping, damping / m],
        [0, -stiff / m, damping / m, -damping / MASS],
    ])  # fmt: skip
    values, vectors = np.linalg.eig(A)
    share = np.linalg.solve(vectors, np.array([0.2 * soft, 0, 0, 0], complex))
    y = ((vectors * share) @ np.exp(np.outer(values, t))).real
    speeds = {"speed_first.x": y[2], "speed_second.x": y[3] / m}
    pull = stiff * y[1] + damping * (y[3] / m - y[2])
    places = {"at_first.x": 0.8 + y[0] / soft, "at_second.x": 1.8 + y[0] / soft + y[1] / stiff}
    return {"force.x": -pull}, speeds, places


@pytest.mark.parametrize(("damping", "accuracy"), [(0.0, 1e-3), (0.2, 1e-3), (0.2, 1e-7)])
def test_what_the_sensor_of_a_spring_lacks_is_stated(damping, accuracy):
    """At 503 Hz. With 1e-7 the vibration is followed at first, and lost where steps are longer."""
    found = run(chain(1e5, damping), duration=4.0, outputs=100, accuracy=accuracy, method="radau")
    pulls, speeds, places = truth(1e5, damping, found.t)
    for channels, of in ((pulls, "reactions"), (speeds, "velocities"), (places, "positions")):
        error = largest_error({name: found[name] for name in channels}, channels)[0]
        told = found.statistics[f"measured_error_of_{of}"]
        if of == "positions":
            assert error <= accuracy and told <= accuracy
        else:
            assert error / 3 <= told <= 3 * error
