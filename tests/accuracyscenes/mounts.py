"""Held-out scenes: inverted and elastic pendulums, mounts, a blade, a sudden load."""

from __future__ import annotations

import numpy as np

from flexmb.flexbody import FlexBody, Interface
from flexmb.model import Model

from .oscillators import on_rails
from .scene import Scene
from .textbook import found_once, integrated

G = 9.81
_LIFT, _FAST, _BEGIN = 0.05, 100.0, 0.4


def inverted(size=1.0):
    """A rod upright on a pivot that trembles up and down: Kapitza's pendulum, Mathieu's motion."""
    model = Model("inverted", gravity=[0, -G * size, 0])
    model.add_body("pivot", mass=1, inertia=[size**2] * 3, position=[0, _LIFT * size, 0])
    model.add_body("rod", mass=1, center=[0, 0.25 * size, 0], inertia=[0.02 * size**2] * 3,
                   position=[0, _LIFT * size, 0],
                   orientation={"axis": "z", "angle": -_BEGIN})  # fmt: skip
    model.add_marker("rod.tip", position=[0, 0.5 * size, 0])
    model.add_joint("guide", "prismatic", between=["ground", "pivot"], axis="y")
    model.add_joint("pin", "revolute", between=["pivot", "rod"], axis="z")
    model.add_driver("shaker", joint="guide", stroke=f"{_LIFT * size!r}*cos({_FAST}*t)")
    model.add_sensor("tip", "position", of="rod.tip")
    model.add_sensor("lean", "angle", joint="pin")
    return model


def inverted_truth(t):
    """(J + m h²) θ'' = m h (g + y'') sin θ."""

    def slope(t, y):
        lift = -_LIFT * _FAST**2 * np.cos(_FAST * t)
        return [y[1], 0.25 * (G + lift) * np.sin(y[0]) / (0.02 + 0.25**2)]

    lean = integrated(slope, [_BEGIN, 0], t)[0]
    return {
        "tip.x": 0.5 * np.sin(lean), "tip.y": _LIFT * np.cos(_FAST * t) + 0.5 * np.cos(lean),
        "lean": -(lean - _BEGIN),
    }  # fmt: skip


def elastic(size=1.0):
    """A ball on a spring, thrown around in space."""
    model = Model("elastic pendulum", gravity=[0, 0, -G * size])
    model.add_body("ball", mass=1, inertia=[0.01 * size**2] * 3, position=[1.2 * size, 0, 0],
                   velocity=[0, 2 * size, 0.5 * size])  # fmt: skip
    model.add_force("spring", "spring-damper", between=["ground", "ball"], stiffness=120,
                    free_length=size)  # fmt: skip
    model.add_sensor("ball", "position", of="ball")
    model.add_sensor("length", "distance", between=["ground", "ball"])
    return model


def elastic_truth(t):
    def slope(_, y):
        r = y[:3]
        length = np.sqrt(r @ r)
        return [*y[3:], *(-120 * (length - 1) * r / length + np.array([0, 0, -G]))]

    r = integrated(slope, [1.2, 0, 0, 0, 2, 0.5], t)[:3]
    return {"ball.x": r[0], "ball.y": r[1], "ball.z": r[2], "length": np.sqrt((r * r).sum(axis=0))}


_STIFFNESS, _LOSS = 1e6, 200.0


def mount(size=1.0):
    """A pendulum under a block on a stiff bushing, on a cart that sets off."""
    model = Model("mount", gravity=[0, -G * size, 0])
    model.add_body("cart", mass=50, inertia=[size**2] * 3)
    model.add_body("block", mass=1, inertia=[size**2] * 3)
    model.add_body("rod", mass=0.5, center=[0, -0.4 * size, 0], inertia=[0.01 * size**2] * 3)
    model.add_marker("rod.end", position=[0, -0.8 * size, 0])
    model.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    model.add_joint("guide", "prismatic", between=["cart", "block"], axis="x")
    model.add_joint("pin", "revolute", between=["block", "rod"], axis="z")
    model.add_driver("motor", joint="rail", stroke=f"{0.3 * size!r}*(1 - cos(4*t))")
    model.add_force("bushing", "bushing", between=["cart", "block"], stiffness=_STIFFNESS,
                    damping=_LOSS)  # fmt: skip
    model.add_sensor("end", "position", of="rod.end")
    model.add_sensor("block", "position", of="block", relative_to="cart")
    return model


def mount_truth(t):
    """x of the block on the cart, the lean of the rod."""
    m, h, J = 0.5, 0.4, 0.01

    def slope(t, y):
        x, a, u, w = y
        cart = 0.3 * 16 * np.cos(4 * t)
        M = [[1 + m, m * h * np.cos(a)], [m * h * np.cos(a), J + m * h * h]]
        pull = m * h * w * w * np.sin(a) - (1 + m) * cart - _STIFFNESS * x - _LOSS * u
        turn = -m * h * np.cos(a) * cart - m * G * h * np.sin(a)
        return [u, w, *np.linalg.solve(M, [pull, turn])]

    x, a = integrated(slope, [0, 0, 0, 0], t)[:2]
    place = 0.3 * (1 - np.cos(4 * t)) + x
    return {"end.x": place + 0.8 * np.sin(a), "end.y": -0.8 * np.cos(a), "block.x": x}


_X = np.linspace(0.25, 1.0, 4)
# Four points of 1/4 kg: places, shapes of two modes, their stiffness and damping.
_MASS, _PLACES = np.full(4, 0.25), np.stack([_X, 0.1 * _X, [0, 0.1, -0.1, 0]], axis=1)
_SHAPES = np.stack([
    np.stack([0 * _X, _X**2, 0.3 * _X**2], axis=1),
    np.stack([0.1 * _X**3, _X**2 - 1.3 * _X**3, 0.1 * _X**2], axis=1),
], axis=2)  # fmt: skip
_STIFF, _DAMP, _REST = np.diag([300.0, 2000.0]), np.diag([0.1, 0.1]), np.zeros((3, 2))
BLADE = FlexBody(
    "blade", _MASS.sum(), _MASS @ _PLACES,
    np.einsum("k,ka,kb->ab", _MASS, _PLACES, _PLACES),
    np.einsum("k,kbi->bi", _MASS, _SHAPES),
    np.einsum("k,ka,kbi->abi", _MASS, _PLACES, _SHAPES),
    np.einsum("k,kai,kbj->abij", _MASS, _SHAPES, _SHAPES),
    _STIFF, _DAMP, (
        Interface("root", [0, 0, 0], _REST, _REST),
        Interface("tip", _PLACES[-1], _SHAPES[-1], _REST),
    ),
)  # fmt: skip


def blade(size=1.0):
    """A blade of two modes from arrays on a hub that turns unevenly."""
    assert size == 1.0
    model = Model("blade")
    model.add_body("blade", BLADE, angular_velocity=[0, 0, 3])
    model.add_joint("hub", "revolute", between=["ground", "blade.root"], axis="z")
    model.add_driver("motor", joint="hub", angle="3*t + 0.5*(1 - cos(6*t))")
    model.add_sensor("tip", "position", of="blade.tip")
    model.add_sensor("bend", "position", of="blade.tip", relative_to="blade.root",
                     axes="blade.root")  # fmt: skip
    return model


@found_once
def blade_motion(t):
    """η and η' (4, len(t)), each point by itself in axes that turn: Σ m Nᵀ(N η'' + their pull)."""
    m, s, N = _MASS, _PLACES, _SHAPES
    weighed = (m[:, None, None] * N).reshape(-1, N.shape[2]).T
    flat = N.reshape(-1, N.shape[2])
    inverse = np.linalg.inv(weighed @ flat)

    def slope(t, y):
        spin, gain = 3 + 3 * np.sin(6 * t), 18 * np.cos(6 * t)
        r, u = s + (flat @ y[:2]).reshape(s.shape), (flat @ y[2:]).reshape(s.shape)
        frame = np.stack([
            -2 * spin * u[:, 1] - gain * r[:, 1] - spin**2 * r[:, 0],
            2 * spin * u[:, 0] + gain * r[:, 0] - spin**2 * r[:, 1], 0 * r[:, 0],
        ], axis=1)  # fmt: skip
        pull = -weighed @ frame.ravel() - _STIFF @ y[:2] - _DAMP @ y[2:]
        return [*y[2:], *inverse @ pull]

    return integrated(slope, [0, 0, 0, 0], t)


def blade_truth(t):
    bend = _PLACES[-1][:, None] + _SHAPES[-1] @ blade_motion(t)[:2]
    turn = (bend[0] + 1j * bend[1]) * np.exp(1j * (3 * t + 0.5 * (1 - np.cos(6 * t))))
    tip = {"tip.x": turn.real, "tip.y": turn.imag, "tip.z": bend[2]}
    return tip | {f"bend.{axis}": bend[k] for k, axis in enumerate("xyz")}


_JUMP, _RISE = 1.7, 1e-7  # s


def sudden(size=1.0):
    """A damped mass at rest until a load is on it, and few outputs."""
    model = on_rails([2], [1.0], size)
    model.add_force("spring", "translational-spring-damper", joint="guide0", stiffness=800,
                    damping=3, free=size)  # fmt: skip
    rise = f"{30 * size!r}*step(t, {_JUMP}, 0, {_JUMP + _RISE!r}, 1)"
    model.add_force("load", "force", at="m0", value=[rise, 0, 0])
    return model


def sudden_truth(t):
    late, decay = np.maximum(t - _JUMP - _RISE / 2, 0.0), 0.75
    w = np.sqrt(400 - decay**2)
    rest = 30 / 800
    swing = np.exp(-decay * late) * (np.cos(w * late) + decay / w * np.sin(w * late))
    return {"p0.x": 1.0 + rest * (1 - swing)}


MOUNTS = {
    "inverted pendulum": Scene(inverted, 6.0, inverted_truth),
    "elastic pendulum": Scene(elastic, 8.0, elastic_truth),
    "pendulum on a stiff mount": Scene(mount, 3.0, mount_truth),
    "blade": Scene(blade, 3.0, blade_truth, sized=False),
    "sudden load": Scene(sudden, 4.0, sudden_truth, outputs=5),
}
