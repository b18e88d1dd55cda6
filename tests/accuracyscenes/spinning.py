"""Tops and bodies that spin freely."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from flexmb.model import Model

from .scene import Scene
from .textbook import ball_chain

G = 9.81


def top(mass, height, inertia, tilt, spin):
    """Scene of a top on its point; `spin` is its angular velocity in global axes."""
    orientation = Rotation.from_rotvec([tilt, 0, 0])

    def make(size=1.0):
        made = Model("top", gravity=[0, 0, -G * size])
        made.add_body("top", mass=mass, center=[0, 0, height * size],
                      inertia=[one * size**2 for one in inertia], angular_velocity=list(spin),
                      orientation={"axis": "x", "angle": tilt})  # fmt: skip
        made.add_marker("top.tip", position=[0, 0, height * size])
        made.add_joint("point", "spherical", between=["ground", "top"])
        made.add_sensor("tip", "position", of="top.tip")
        return made

    def truth(t):
        p = np.roll(orientation.as_quat(), 1)
        R = ball_chain([mass], [[0, 0, height]], [inertia], None, [0, 0, -G], p, spin, t)
        tip = height * R[0, :, :, 2].T
        return dict(zip(("tip.x", "tip.y", "tip.z"), tip, strict=True))

    return make, truth


def tumbling(size=1.0):
    """Spun about the middle axis: it turns over."""
    made = Model("tumbling")
    made.add_body("b", mass=1, inertia=[1 * size**2, 2 * size**2, 2.8 * size**2],
                  angular_velocity=[0.1, 3, 0.1])  # fmt: skip
    made.add_marker("b.p", position=[0.5 * size] * 3)
    made.add_sensor("p", "position", of="b.p")
    return made


def tumbling_truth(t):
    R = ball_chain([1], [[0, 0, 0]], [[1, 2, 2.8]], None, [0, 0, 0], [1, 0, 0, 0], [0.1, 3, 0.1], t)
    return dict(zip(("p.x", "p.y", "p.z"), 0.5 * R[0].sum(axis=2).T, strict=True))


FREE_SPIN = np.array([0.6, 0.0, 8.0])


def free_top(size=1.0):
    """A symmetric body thrown: its axis goes round the moment of momentum."""
    made = Model("free top")
    made.add_body("b", mass=1, inertia=[2 * size**2, 2 * size**2, 1.2 * size**2],
                  velocity=[size, 0, 0], angular_velocity=FREE_SPIN.tolist())  # fmt: skip
    made.add_marker("b.p", position=[0.3 * size, 0, size])
    made.add_sensor("p", "position", of="b.p", relative_to="b")
    made.add_sensor("b", "position", of="b")
    return made


def free_top_truth(t):
    """Turned about L by |L| t/A after a turn about the own axis by (1 − C/A) ω₃ t."""
    A, C = 2.0, 1.2
    momentum = FREE_SPIN * [A, A, C]
    about = Rotation.from_rotvec(np.outer(t, momentum / A))
    own = Rotation.from_rotvec(np.outer(t, [0, 0, (1 - C / A) * FREE_SPIN[2]]))
    p = (about * own).apply([0.3, 0, 1.0])
    return dict(zip(("p.x", "p.y", "p.z"), p.T, strict=True)) | {"b.x": t}


_heavy = top(15, 1.0, (0.23, 0.23, 0.45), np.pi / 3, (0, -8, 20))
_nutating = top(1, 0.1, (5e-3, 5e-3, 2e-3), np.pi / 3, (0, 0, 80))
_axis = np.array([0, -np.sin(0.4), np.cos(0.4)])
_fast = top(1, 0.1, (5e-3, 5e-3, 2e-3), 0.4, 300 * _axis)
_sleeping = top(1, 0.1, (5e-3, 5e-3, 2e-3), 1e-3, (0.0, 0.0, 200.0))

SPINNING = {
    "top": Scene(_heavy[0], 1.5, _heavy[1]),
    "nutating top": Scene(_nutating[0], 2.0, _nutating[1]),
    "fast top": Scene(_fast[0], 1.0, _fast[1]),
    "sleeping top": Scene(_sleeping[0], 1.0, _sleeping[1]),
    "tumbling body": Scene(tumbling, 5.0, tumbling_truth),
    "free top": Scene(free_top, 10.0, free_top_truth),
}
