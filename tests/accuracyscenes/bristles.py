"""Contacts with bristles beside SciPy, from event to event: a thrown ball, a puck on a curved path.

With g the speed of sliding, N the normal force and L = μ N/k: a free bristle has s' = g. Where it
reaches ±L it is full and follows that, until the limit grows faster than g. The force on the body
is −(k s + c g), which μ N bounds; where a full bristle slides on, −μ N g/|g|.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from flexmb.model import Model

from .scene import Scene

G = 9.81
_J, _R, _K, _MU = 0.004, 0.1, 1e6, 0.3
_BRISTLE, _DAMPING = 1e5, 100.0
_BACK = 0.8  # coefficient of restitution
# Its factor of damping: v dv/dd = -K d^n (1 + chi v/v0)/m leads from v0 to -e v0 over closed depths
# where the integral of u/(1 + chi u) from -e to 1 is zero (Hunt & Crossley 1975).
_CHI = brentq(lambda x: x * (1 + _BACK) - np.log((1 + x) / (1 - x * _BACK)), 0.01, 1.2, xtol=1e-15)


def ball(size=1.0):
    """A ball of 1 kg, thrown flat onto the floor: it slides, sticks and slips in each impact."""
    made = Model("ball", gravity=[0, 0, -G * size])
    made.add_body("ball", mass=1.0, inertia=[_J * size**2] * 3, position=[0, 0, 0.5 * size],
                  velocity=[size, 0, 0])  # fmt: skip
    made.add_force(
        "floor", "contact", between=["ball", "ground"], stiffness=_K / size**0.5, exponent=1.5,
        restitution=_BACK, least_speed=1e-3 * size,
        shapes=[{"type": "sphere", "radius": _R * size}, {"type": "plane"}],
        friction={"dynamic": _MU, "stiffness": _BRISTLE, "damping": _DAMPING},
    )  # fmt: skip
    made.add_sensor("place", "position", of="ball")
    return made


class _Impact:
    """y = x, z, vx, vz, spin, s, from the onset at v0 to the end."""

    def __init__(self, v0):
        self.v0 = v0

    def slip(self, y):
        return y[2] - _R * y[4]

    def load(self, y):
        """N, and how fast it grows."""
        d, rate = max(_R - y[1], 0.0), -y[3]
        damped = 1.0 + _CHI * rate / self.v0
        N = _K * d**1.5 * damped
        return N, 1.5 * _K * d**0.5 * rate * damped - _K * d**1.5 * _CHI * (N - G) / self.v0

    def friction(self, y, side):
        """The force; side: 0 of a free bristle, else that of a full one."""
        limit, g = _MU * self.load(y)[0], self.slip(y)
        if side * g > 0.0:
            return -side * limit
        s = side * limit / _BRISTLE if side else y[5]
        return -np.clip(_BRISTLE * s + _DAMPING * g, -limit, limit)

    def rate(self, y, side):
        N, growth = self.load(y)
        f = self.friction(y, side)
        along = side * _MU * growth / _BRISTLE if side else self.slip(y)
        return [y[2], y[3], f, N - G, -_R * f / _J, along]

    def ends(self, side):
        """Fall below zero where it ends, and where the bristle becomes full or free."""

        def full(t, y):
            return _MU * self.load(y)[0] / _BRISTLE + 1e-16 - abs(y[5])

        def free(t, y):
            return side * self.slip(y) - _MU * self.load(y)[1] / _BRISTLE

        return [lambda t, y: _R - y[1], free if side else full]


def ball_truth(t):
    y, now, out = np.array([0.0, 0.5, 1.0, 0.0, 0.0, 0.0]), 0.0, np.empty((6, len(t)))
    impact, side = None, 0.0
    while now < t[-1]:
        events = impact.ends(side) if impact else [lambda t, y: y[1] - _R]
        for event in events:
            event.terminal, event.direction = True, -1.0
        piece = solve_ivp(
            lambda t, y, impact=impact, side=side: (
                impact.rate(y, side) if impact else [y[2], y[3], 0.0, -G, 0.0, 0.0]
            ),
            (now, t[-1]), y, "DOP853", events=events, dense_output=True, rtol=1e-12, atol=1e-15,
            max_step=2e-5 if impact else 1e-2,
        )  # fmt: skip
        inside = (t >= now) & (t <= piece.t[-1])
        if inside.any():
            out[:, inside] = piece.sol(t[inside])
        now, y = piece.t[-1], piece.y[:, -1]
        if len(piece.t_events[0]):
            impact, side = None if impact else _Impact(-y[3]), np.sign(y[2] - _R * y[4])
            y[1], y[5] = _R, 0.0
        elif impact and len(piece.t_events[1]):
            y[5] = side * _MU * impact.load(y)[0] / _BRISTLE if side else y[5]
            side = 0.0 if side else np.sign(y[5])
    return {"place.x": out[0], "place.z": out[1]}


_SIDE = 10.0  # stiffness across over that along


def puck(size=1.0):
    """A puck of 1 kg on one point, that springs turn on its way over the floor."""
    made = Model("puck", gravity=[0, 0, -G * size])
    made.add_body("puck", mass=1.0, inertia=[1e7 * size**2] * 3, velocity=[size, 0.6 * size, 0],
                  position=[0.5 * size, 0, -G / _K * size])  # fmt: skip
    made.add_force(
        "floor", "contact", between=["puck", "ground"], stiffness=_K, exponent=1, restitution=0.5,
        shapes=[{"type": "points", "points": [[0, 0, 0]]}, {"type": "plane"}],
        friction={"dynamic": 0.2, "stiffness": _BRISTLE},
    )  # fmt: skip
    made.add_sensor("place", "position", of="puck")
    made.add_sensor("way", "position", of="puck", relative_to="ground")
    made.add_force("springs", "force", at="puck", value=["-4*way.x", f"{-_SIDE}*way.y", "0"])
    return made


def puck_truth(t):
    """First the bristle is stretched, then Coulomb's friction is against the velocity."""

    def rate(t, y, slides):
        s = y[:2] - [0.5, 0.0]
        f = -0.2 * G * y[2:] / np.hypot(*y[2:]) if slides else -_BRISTLE * s
        return [y[2], y[3], f[0] - 4.0 * y[0], f[1] - _SIDE * y[1]]

    def is_full(t, y, _):
        return np.hypot(y[0] - 0.5, y[1]) - 0.2 * G / _BRISTLE

    is_full.terminal, knobs = True, {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15}
    first = solve_ivp(rate, (0.0, t[-1]), [0.5, 0.0, 1.0, 0.6], args=(False,), events=is_full,
                      first_step=1e-7, **knobs)  # fmt: skip
    rest = solve_ivp(rate, (first.t[-1], t[-1]), first.y[:, -1], args=(True,), t_eval=t[1:],
                     **knobs)  # fmt: skip
    x, y = np.column_stack([[0.5, 0.0], rest.y[:2]])
    return {"place.x": x, "place.y": y}


BRISTLES = {
    "ball with bristles": Scene(ball, 0.9, ball_truth),
    "puck on a curved path": Scene(puck, 1.2, puck_truth),
}
