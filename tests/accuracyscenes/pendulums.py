"""Pendulums in a plane and in space."""

from __future__ import annotations

import numpy as np
from scipy.special import ellipj, ellipk

from flexmb.model import Model

from .scene import Scene
from .textbook import Linkage, ball_chain, integrated

G = 9.81


def links(n, size=1.0):
    """n links of 1 m hinged in a row, let go from the horizontal."""
    made = Model("links", gravity=[0, -G * size, 0])
    for k in range(n):
        made.add_body(f"b{k}", mass=1, center=[0.5 * size, 0, 0],
                      inertia=[0.01 * size**2, 0.1 * size**2, 0.1 * size**2],
                      position=[k * size, 0, 0])  # fmt: skip
        made.add_marker(f"b{k}.end", position=[size, 0, 0])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "revolute", between=ends, axis="z")
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


def pendulum_truth(t):
    """sin(angle/2) = k sn: one link hung at its end, from the horizontal; J = 0.1 + 0.25."""
    w, k = np.sqrt(G * 0.5 / 0.35), np.sin(np.pi / 4)
    sn = ellipj(ellipk(k * k) + w * t, k * k)[0]
    angle = 2 * np.arcsin(k * sn)  # from the lowest point
    return {"end0.x": np.sin(angle), "end0.y": -np.cos(angle)}


def point(size=1.0):
    """A mass that is nearly a point on an arm, as users write it."""
    made = Model("point", gravity=[0, -G * size, 0])
    made.add_body("bob", mass=1, inertia=[1e-9 * size**2] * 3, position=[size, 0, 0])
    made.add_marker("bob.pin", position=[-size, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "bob.pin"], axis="z")
    made.add_sensor("bob", "position", of="bob")
    return made


def point_truth(t):
    sn = ellipj(ellipk(0.5) + np.sqrt(G / (1 + 1e-9)) * t, 0.5)[0]
    angle = 2 * np.arcsin(np.sqrt(0.5) * sn)
    return {"bob.x": np.sin(angle), "bob.y": -np.cos(angle)}


def links_truth(n):
    def truth(t):
        arms = np.tril(np.ones((n, n))) - 0.5 * np.eye(n)
        row = Linkage(np.ones(n), 0.1 * np.ones(n), arms, gravity=-1j * G)
        ends = np.cumsum(np.exp(1j * row.run(np.zeros(n), np.zeros(n), range(n), t)), axis=0)
        found = {f"end{k}.x": end.real for k, end in enumerate(ends)}
        return found | {f"end{k}.y": end.imag for k, end in enumerate(ends)}

    return truth


def forced(size=1.0):
    made = links(1, size)
    made.add_force("twist", "torque", at="b0", value=[0, 0, f"{6 * size**2!r}*sin(3*t)"])
    return made


def forced_truth(t):
    angle, _ = integrated(
        lambda t, y: [y[1], (6 * np.sin(3 * t) - G * 0.5 * np.cos(y[0])) / 0.35], [0.0, 0.0], t
    )
    return {"end0.x": np.cos(angle), "end0.y": np.sin(angle)}


def hit(size=1.0):
    """A link that hangs at rest until a moment acts, from a third of the run on."""
    made = Model("hit", gravity=[0, -G * size, 0])
    made.add_body("b0", mass=1, center=[0, -0.5 * size, 0], inertia=[0.1 * size**2] * 3)
    made.add_marker("b0.end", position=[0, -size, 0])
    made.add_joint("j0", "revolute", between=["ground", "b0"], axis="z")
    made.add_sensor("end", "position", of="b0.end")
    made.add_force("twist", "torque", at="b0",
                   value=[0, 0, f"{3 * size**2!r}*step(t, 1, 0, 1.2, 1)"])  # fmt: skip
    return made


def hit_truth(t):
    def slope(t, y):
        x = min(max((t - 1) / 0.2, 0.0), 1.0)
        return [y[1], (3 * x * x * (3 - 2 * x) - G * 0.5 * np.sin(y[0])) / 0.35]

    angle, y = np.zeros(len(t)), np.zeros(2)
    for begin, end in ((1.0, 1.2), (1.2, np.inf)):  # between the kinks of the moment
        there = (t > begin) & (t <= end)
        times = np.unique([begin, *t[there], min(end, t[-1])])
        found = integrated(slope, y, times)
        angle[there], y = found[0, np.searchsorted(times, t[there])], found[:, -1]
    return {"end.x": np.sin(angle), "end.y": -np.cos(angle)}


def spherical(size=1.0):
    """A rod on a ball joint that goes round in a bent cone."""
    made = Model("spherical pendulum", gravity=[0, 0, -G * size])
    made.add_body("rod", mass=2, center=[0, 0, -0.6 * size],
                  inertia=[0.2 * size**2, 0.2 * size**2, 0.01 * size**2],
                  orientation={"axis": "x", "angle": 1.0},
                  angular_velocity=[0, *SPIN])  # fmt: skip
    made.add_marker("rod.tip", position=[0, 0, -size])
    made.add_joint("point", "spherical", between=["ground", "rod"])
    made.add_sensor("tip", "position", of="rod.tip")
    return made


SPIN = (0.9, 1.5)


def spherical_truth(t):
    R = ball_chain([2], [[0, 0, -0.6]], [[0.2, 0.2, 0.01]], None, [0, 0, -G],
                   [np.cos(0.5), np.sin(0.5), 0, 0], [0, *SPIN], t)  # fmt: skip
    tip = -R[0, :, :, 2].T
    return dict(zip(("tip.x", "tip.y", "tip.z"), tip, strict=True))


def foucault(size=1.0):
    """A mass on a soft spring to all sides, seen from a turntable: Coriolis' force by its speed."""
    made = Model("foucault", plane="xy")
    made.add_body("m", mass=2, inertia=[1, 1, 1], position=[0.3 * size, 0, 0],
                  velocity=[0, 0, 0])  # fmt: skip
    made.add_sensor("p", "position", of="m", relative_to="ground")
    made.add_sensor("v", "velocity", of="m")
    value = [f"2*(-9*p.x + 2*{TURN}*v.y)", f"2*(-9*p.y - 2*{TURN}*v.x)", 0]
    made.add_force("pull", "force", at="m", value=value)
    return made


TURN = 0.2


def foucault_truth(t):
    """z̈ + 2iΩ ż + ω² z = 0."""
    root = np.sqrt(TURN**2 + 9)
    a, b = -TURN + root, -TURN - root
    z = 0.3 * (b * np.exp(1j * a * t) - a * np.exp(1j * b * t)) / (b - a)
    return {"p.x": z.real, "p.y": z.imag}


def thrown(size=1.0):
    """A spatial chain of three bodies, the last one spun."""
    made = Model("thrown", gravity=[0, -G * size, 0])
    for k in range(3):
        spin = {"angular_velocity": [1.0, 2.0, 3.0]} if k == 2 else {}
        made.add_body(f"b{k}", mass=1.0 + k, center=[0.5 * size, 0.1 * size, 0],
                      inertia=[0.02 * size**2, 0.1 * size**2, 0.09 * size**2],
                      position=[k * size, 0, 0.1 * k * size], **spin)  # fmt: skip
        made.add_marker(f"b{k}.end", position=[size, 0, 0.1 * size])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "spherical", between=ends)
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


def thrown_truth(t):
    end, upright = np.array([1, 0, 0.1]), np.tile([1, 0, 0, 0], (3, 1))
    spins = [[0, 0, 0], [0, 0, 0], [1, 2, 3]]
    R = ball_chain([1, 2, 3], [[0.5, 0.1, 0]] * 3, [[0.02, 0.1, 0.09]] * 3, [end] * 3,
                   [0, -G, 0], upright, spins, t)  # fmt: skip
    ends = np.cumsum(R @ end, axis=0)
    return {
        f"end{k}.{axis}": ends[k, :, i] for k in range(3) for i, axis in enumerate("xyz")
    }  # fmt: skip


def on_a_cart(size=1.0):
    """A pendulum let go on a cart that rolls freely."""
    made = Model("cart", gravity=[0, -G * size, 0])
    made.add_body("cart", mass=2, inertia=[0.1 * size**2] * 3)
    made.add_body("rod", mass=1, center=[0, -0.5 * size, 0], inertia=[0.1 * size**2] * 3,
                  orientation={"axis": "z", "angle": 1.2})  # fmt: skip
    made.add_marker("rod.tip", position=[0, -size, 0])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_joint("pin", "revolute", between=["cart", "rod"], axis="z")
    made.add_sensor("cart", "position", of="cart")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


def cart_truth(t):
    made = Linkage([2, 1], [0.1], [[0], [0.5]], [[1], [1]], gravity=-1j * G)
    angle, x = made.run([1.2 - np.pi / 2, 0.0], [0.0, 0.0], [0, 1], t)
    return {"cart.x": x, "tip.x": x + np.cos(angle), "tip.y": np.sin(angle)}


PENDULUMS = {
    "pendulum": Scene(lambda s=1.0: links(1, s), 3.0, pendulum_truth),
    "pendulum of a point": Scene(point, 5.0, point_truth),
    "long pendulum": Scene(lambda s=1.0: links(1, s), 100.0, pendulum_truth),
    "double pendulum": Scene(lambda s=1.0: links(2, s), 2.0, links_truth(2)),
    "triple pendulum": Scene(lambda s=1.0: links(3, s), 1.5, links_truth(3)),
    "driven pendulum": Scene(forced, 10.0, forced_truth),
    "pendulum hit from rest": Scene(hit, 3.0, hit_truth),
    "spherical pendulum": Scene(spherical, 5.0, spherical_truth),
    "Foucault's pendulum": Scene(foucault, 10.0, foucault_truth),
    "pendulum on a cart": Scene(on_a_cart, 4.0, cart_truth),
    "spatial chain": Scene(thrown, 1.0, thrown_truth),
}
