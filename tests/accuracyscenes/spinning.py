"""Tops, and bodies that turn in space."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from flexmb.model import Model

from .scene import Scene
from .textbook import ball_chain, integrated

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


_SKEW = np.array([[1.0, 0.2, 0.1], [0.2, 0.7, 0.15], [0.1, 0.15, 1.2]])  # kg m², about the centre
_CENTRE, _END, _HOOK = np.array([0.3, 0.1, -0.2]), np.array([0.5, 0.6, 0.2]), np.array([1.0, 2, 3])
_THROWN, _STIFFNESS, _FREE = np.array([0.5, -0.3, 0.4]), 5.0, 1.0


def skew_body(name, size, **more):
    made = Model(name, **more)
    thrown = {} if more else {"angular_velocity": list(_THROWN)}
    made.add_body("b", mass=1, center=list(_CENTRE * size),
                  inertia=(_SKEW * size**2).tolist(), **thrown)  # fmt: skip
    made.add_marker("b.end", position=list(_END * size))
    made.add_sensor("end", "position", of="b.end")
    return made


def hung(size=1.0):
    """A skew body on a universal joint, let go: it turns about both axes and over its top."""
    made = skew_body("hung", size, gravity=[0, -G * size, 0])
    made.add_joint("cross", "universal", between=["ground", "b"], axis="x", second_axis="y")
    return made


def hung_truth(t):
    """Lagrange's equations in the angles a, b of R = Rx(a) Ry(b), ω' = (a' cos b, b', a' sin b)."""
    inertia = _SKEW + _CENTRE @ _CENTRE * np.eye(3) - np.outer(_CENTRE, _CENTRE)

    def slope(_, y):
        (a, b), rate = y[:2], y[2:]
        sa, ca, sb, cb = np.sin(a), np.cos(a), np.sin(b), np.cos(b)
        E, slant = np.array([[cb, 0], [0, 1], [sb, 0]]), np.array([[-sb, 0], [0, 0], [cb, 0]])
        change = slant.T @ inertia @ E + E.T @ inertia @ slant  # of the mass matrix, by b
        x, height, z = _CENTRE
        rise = np.array([-height * sa - (-sb * x + cb * z) * ca, (cb * x + sb * z) * sa])
        force = np.array([0.0, 0.5 * rate @ change @ rate]) - change @ rate * rate[1] - G * rise
        return [*rate, *np.linalg.solve(E.T @ inertia @ E, force)]

    a, b = integrated(slope, np.zeros(4), t)[:2]
    x, y, z = _END
    across = -np.sin(b) * x + np.cos(b) * z
    return {
        "end.x": np.cos(b) * x + np.sin(b) * z,
        "end.y": np.cos(a) * y - np.sin(a) * across,
        "end.z": np.sin(a) * y + np.cos(a) * across,
    }


def tethered(size=1.0):
    """A skew body thrown, a spring between its end and a hook."""
    made = skew_body("tethered", size)
    made.add_marker("ground.hook", position=list(_HOOK * size))
    made.add_force("spring", "spring-damper", between=["b.end", "ground.hook"],
                   stiffness=_STIFFNESS, free_length=_FREE * size)  # fmt: skip
    return made


def tethered_truth(t):
    """Newton's and Euler's equations about the centre of mass."""
    arm, inverse = _END - _CENTRE, np.linalg.inv(_SKEW)

    def slope(_, y):
        x, v, p, w = y[:3], y[3:6], y[6:10], y[10:]
        R = Rotation.from_quat(p).as_matrix()
        gap = _HOOK - x - R @ arm
        pull = _STIFFNESS * (1 - _FREE / np.linalg.norm(gap)) * gap
        spin = np.cross(arm, R.T @ pull) - np.cross(w, _SKEW @ w)
        turn = [*(p[3] * w + np.cross(p[:3], w)), -p[:3] @ w]
        return [*v, *pull, *(0.5 * np.array(turn)), *(inverse @ spin)]

    first = [*_CENTRE, *np.cross(_THROWN, _CENTRE), 0, 0, 0, 1, *_THROWN]
    y = integrated(slope, first, t)
    end = y[:3].T + Rotation.from_quat(y[6:10].T).apply(arm)
    return dict(zip(("end.x", "end.y", "end.z"), end.T, strict=True))


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
    "skew body on a cross": Scene(hung, 10.0, hung_truth),
    "skew body on a spring": Scene(tethered, 10.0, tethered_truth),
}
