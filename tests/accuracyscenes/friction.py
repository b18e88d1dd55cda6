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


LOAD = 20.0  # N, of the guide that is loaded to and fro


def _loaded_to_and_fro(bias, damping):
    """A block of 1 kg on a spring of 400 N/m, thrown by 1 m/s in a guide of which loads change.

    20 sin(9 t) N and `bias` across it, 2 cos(3 t) N the other way: bristles of 4e5 N/m are as long
    as the load allows, or stick, or are let go as it falls.
    """

    def make(size):
        made = Model("guide")
        made.add_body("block", mass=1, inertia=[0.01] * 3, velocity=[size, 0, 0])
        made.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
        made.add_force("rub", "joint-friction", joint="guide", dynamic=0.3, stiffness=4e5,
                       damping=damping)  # fmt: skip
        made.add_marker("ground.wall", position=[-2 * size, 0, 0])
        made.add_force("spring", "spring-damper", between=["ground.wall", "block"], stiffness=400,
                       free_length=2 * size)  # fmt: skip
        across = [0, f"{size * LOAD!r}*sin(9*t) + {size * bias!r}", f"{2 * size!r}*cos(3*t)"]
        made.add_force("load", "force", at="block", value=across)
        made.add_sensor("place", "position", of="block")
        return made

    return Scene(make, 1.0, lambda t: {"place.x": _Guide(bias, damping).places(t)})


class _Guide:
    """The block of `_loaded_to_and_fro` from event to event; y: place, speed and bristle."""

    def __init__(self, bias, damping):
        self.bias, self.c, self.k = bias, damping, 4e5

    def limit(self, t):
        """Greatest friction and its rate."""
        a, b = LOAD * np.sin(9 * t) + self.bias, 2 * np.cos(3 * t)
        load = np.hypot(a, b)
        rate = (a * 9 * LOAD * np.cos(9 * t) - b * 6 * np.sin(3 * t)) / load
        return 0.3 * load, 0.3 * rate

    def longest(self, t, v, side):
        """k times the length at most: what is let go pulls with the limit."""
        return self.limit(t)[0] + self.c * max(-side * v, 0.0)

    def pull(self, t, y, side):
        """Force of the bristle; side: of a full one, 0 of a free one."""
        if side:
            return side * self.limit(t)[0]
        most = self.limit(t)[0]
        return min(max(self.k * y[2] + self.c * y[1], -most), most)

    def excess(self, t, y, side):
        """Speed of sliding above that at which a full bristle may grow longer."""
        growth = self.limit(t)[1]
        if side * y[1] < 0.0:
            growth -= self.c * side * (-400 * y[0] - self.pull(t, y, side))
        return side * y[1] - growth / self.k

    def side(self, y):
        return np.sign(self.k * y[2] + self.c * y[1]) or np.sign(y[2]) or 1.0

    def places(self, times):
        y, now, side, out = np.array([0.0, 1.0, 0.0]), 0.0, 0.0, np.zeros(len(times))
        while now < times[-1]:

            def slope(t, y, side=side):
                return [y[1], -400 * y[0] - self.pull(t, y, side), y[1]]

            def changes(t, y, side=side):
                if side:
                    return self.excess(t, y, side)
                way = self.side(y)
                return self.longest(t, y[1], way) + 1e-16 - way * self.k * y[2]

            def turns(t, y, side=side):
                return y[1] if side else 1.0

            changes.terminal = turns.terminal = True
            changes.direction = -1
            part = solve_ivp(slope, (now, times[-1]), y, "DOP853", events=[changes, turns],
                             dense_output=True, rtol=1e-11, atol=1e-14, max_step=2e-4)  # fmt: skip
            inside = (times >= now) & (times <= part.t[-1])
            if inside.any():
                out[inside] = part.sol(times[inside])[0]
            now, y = part.t[-1], part.y[:, -1]
            if part.status == 0:
                break
            if side and len(part.t_events[1]):  # just beyond the turn, on which the law depends
                y[1] = np.copysign(1e-14, -400 * y[0] - self.pull(now, y, side))
            way = side or self.side(y)
            if self.excess(now, y, way) > 0.0 and not (side and len(part.t_events[0])):
                side = way
                continue
            if side:
                y[2] = side * self.longest(now, y[1], side) / self.k
            side, now = 0.0, now + 1e-11
            y = y + 1e-11 * np.array(slope(now, y, 0.0))
        return out


FRICTION = {
    "block on bristles": _swings(0.3, 0.3, 0.0),
    "block on damped bristles": _swings(0.3, 0.3, 100.0),
    "block on stiffly damped bristles": _swings(0.3, 0.3, 1000.0),
    "block that Stribeck's curve holds": _swings(0.4, 0.3, 100.0),
    "block on points": Scene(on_points, 1.0, on_points_truth),
    "block on a belt": Scene(on_a_belt, 3.0, on_a_belt_truth),
    "guide loaded to and fro": _loaded_to_and_fro(19.8, 100.0),
    "guide loaded one way": _loaded_to_and_fro(5.0, 300.0),
    "guide loaded on undamped bristles": _loaded_to_and_fro(19.8, 0.0),
    "block on a belt to and fro": Scene(on_a_belt_to_and_fro, 2.0, on_a_belt_to_and_fro_truth),
}
