"""Stick and slip by bristles beside scipy: each law from event to event, at 1e-12.

T = k s + c v of a bristle s: it sticks while |T| ≤ μ(v) N, with s' = v; it slides with μ(v) N until
it turns back, and then sticks with k s = μ N.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from flexmb.model import Model

from .scene import Scene

G = 9.81


def stick_slip(t, start, pull, k, c, N, law, belt=lambda _: 0.0):
    """Places at the times of a mass of 1 kg; `pull(x, v)` but for friction, law: μ(v).

    `belt(t)`: speed of what it rubs on.
    """
    y, out, now = np.array([*start, 0.0]), np.zeros_like(t), t[0]

    def tension(t, y):
        return k * y[2] + c * (y[1] - belt(t))

    def limit(t, y):
        return law(abs(y[1] - belt(t))) * N

    way = np.sign(tension(now, y)) if abs(tension(now, y)) > limit(now, y) else 0.0  # 0: it sticks
    while now < t[-1]:

        def slope(t, y, way=way):
            friction = way * limit(t, y) if way else tension(t, y)
            return [y[1], pull(y[0], y[1]) - friction, 0.0 if way else y[1] - belt(t)]

        def changes(t, y, way=way):
            return way * (belt(t) - y[1]) if way else abs(tension(t, y)) - limit(t, y)

        changes.terminal, changes.direction = True, 1
        part = solve_ivp(slope, (now, t[-1]), y, "DOP853", events=changes, dense_output=True,
                         rtol=1e-12, atol=1e-15, max_step=(t[-1] - t[0]) / 200)  # fmt: skip
        inside = (t >= now) & (t <= part.t[-1])
        if inside.any():
            out[inside] = part.sol(t[inside])[0]
        now, y = part.t[-1], part.y[:, -1]
        if way:
            y[2], way = way * limit(now, y) / k, 0.0
        else:
            way = np.sign(tension(now, y))
    return out


def stribeck(static, dynamic, speed):
    return lambda v: dynamic + (static - dynamic) * np.exp(-((v / speed) ** 2))


def _swings(static, dynamic, damping):
    """A block of 1 kg on a spring of 400 N/m, 50 mm off, on bristles of 4e5 N/m in its guide."""

    def make(size):
        made = Model("slider", gravity=[0, 0, -G * size])
        made.add_body("block", mass=1, inertia=[0.01] * 3, position=[0.05 * size, 0, 0])
        made.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
        made.add_force("rub", "joint-friction", joint="guide", static=static, dynamic=dynamic,
                       stribeck_speed=0.02 * size, stiffness=4e5, damping=damping)  # fmt: skip
        made.add_marker("ground.wall", position=[-2 * size, 0, 0])
        made.add_force("spring", "spring-damper", between=["ground.wall", "block"],
                       stiffness=400, free_length=2 * size)  # fmt: skip
        made.add_sensor("place", "position", of="block")
        return made

    def truth(t):
        law = stribeck(static, dynamic, 0.02)
        return {"place.x": stick_slip(t, (0.05, 0), lambda x, _: -400 * x, 4e5, damping, G, law)}

    return Scene(make, 1.0, truth)


def on_points(size=1.0):
    """A block of 2 kg on four points in the plane of its spring, held by bristles of 1e5 N/m."""
    sag = 2 * G / 4e6 * size
    made = Model("points", gravity=[0, 0, -G * size])
    made.add_body("block", mass=2, inertia=[0.01] * 3, position=[0.05 * size, 0, 0])
    made.add_marker("ground.middle", position=[0.05 * size, 0, 0])
    made.add_joint("flat", "planar", between=["ground.middle", "block"], axis="y")
    corners = [[x * size, y * size, -sag] for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    made.add_force(
        "floor", "contact", between=["block", "ground"], stiffness=1e6, exponent=1,
        restitution=0.5, shapes=[{"type": "points", "points": corners}, {"type": "plane"}],
        friction={"dynamic": 0.3, "stiffness": 1e5, "damping": 200},
    )  # fmt: skip
    made.add_marker("ground.wall", position=[-2 * size, 0, 0])
    made.add_force("spring", "spring-damper", between=["ground.wall", "block"], stiffness=400,
                   free_length=2 * size)  # fmt: skip
    made.add_sensor("place", "position", of="block")
    return made


def on_points_truth(t):
    """Over the mass: springs, bristles and dampers of all points."""
    law = stribeck(0.3, 0.3, 1.0)
    x = stick_slip(t, (0.05, 0), lambda x, _: -200 * x, 4e5 / 2, 800 / 2, G, law)
    return {"place.x": x}


def on_a_belt(size=1.0, stroke="0.1*t"):
    """A block on a spring of 100 N/m, carried by a belt of 0.1 m/s until it slips."""
    made = Model("belt", gravity=[0, 0, -G * size])
    for name in ("belt", "block"):
        made.add_body(name, mass=1, inertia=[0.01] * 3)
    made.add_joint("drum", "prismatic", between=["ground", "belt"], axis="x")
    made.add_driver("run", joint="drum", stroke=f"{size!r}*({stroke})")
    made.add_joint("guide", "prismatic", between=["belt", "block"], axis="x")
    made.add_marker("ground.wall", position=[-2 * size, 0, 0])
    made.add_force("spring", "spring-damper", between=["ground.wall", "block"], stiffness=100,
                   free_length=2 * size, damping=2)  # fmt: skip
    made.add_force("rub", "joint-friction", joint="guide", static=0.4, dynamic=0.2,
                   stribeck_speed=0.05 * size, stiffness=1e5, damping=300)  # fmt: skip
    made.add_sensor("place", "position", of="block")
    return made


def on_a_belt_truth(t, belt=lambda _: 0.1):
    law = stribeck(0.4, 0.2, 0.05)
    x = stick_slip(t, (0, 0), lambda x, v: -100 * x - 2 * v, 1e5, 300, G, law, belt)
    return {"place.x": x}


def on_a_belt_to_and_fro(size=1.0):
    return on_a_belt(size, "0.02*sin(8*t)")


def on_a_belt_to_and_fro_truth(t):
    return on_a_belt_truth(t, lambda t: 0.16 * np.cos(8 * t))


FRICTION = {
    "block on bristles": _swings(0.3, 0.3, 0.0),
    "block on damped bristles": _swings(0.3, 0.3, 100.0),
    "block on stiffly damped bristles": _swings(0.3, 0.3, 1000.0),
    "block that Stribeck's curve holds": _swings(0.4, 0.3, 100.0),
    "block on points": Scene(on_points, 1.0, on_points_truth),
    "block on a belt": Scene(on_a_belt, 3.0, on_a_belt_truth),
    "block on a belt to and fro": Scene(on_a_belt_to_and_fro, 2.0, on_a_belt_to_and_fro_truth),
}
