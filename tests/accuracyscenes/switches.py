"""Laws that change with motion or time: backlash, drag, saturation, waves, a damped buffer; torques
that switch with the sign of a time or of a speed.

An arm turns about a pin. The truth is integrated by SciPy from change to change, which it finds as
roots, each law smooth on both sides.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from flexmb.model import Model

from .scene import Scene

_J = 0.1


def between_switches(rate, switches, first, t):
    """y (n, len(t)) of y' = rate(t, y, signs); signs (k,) are those of `switches(t, y)` (k,).

    A sign changes where its switch is zero.
    """
    y, now, out = np.array(first, float), t[0], np.empty((len(first), len(t)))
    signs = np.where(np.array(switches(now, y)) < 0, -1.0, 1.0)
    while True:
        own = signs.copy()
        events = [
            lambda t, y, k=k, sign=sign: sign * switches(t, y)[k] for k, sign in enumerate(own)
        ]
        for event in events:
            event.terminal, event.direction = True, -1.0
        piece = solve_ivp(
            lambda t, y, own=own: rate(t, y, own), (now, t[-1]), y, "DOP853", rtol=3e-14,
            atol=1e-16, events=events, dense_output=True, max_step=0.05,
        )  # fmt: skip
        inside = (t >= now) & (t <= piece.t[-1])
        if inside.any():
            out[:, inside] = piece.sol(t[inside])
        if piece.status == 0:
            return out
        now, y = piece.t[-1], piece.y[:, -1]
        signs[[len(times) > 0 for times in piece.t_events]] *= -1.0


def arm(law):
    """A scene maker; `law(model, size²)` adds what turns the arm."""

    def make(size=1.0):
        model = Model("arm")
        model.add_body("arm", mass=1.0, inertia=[_J * size**2] * 3)
        model.add_marker("arm.tip", position=[size, 0, 0])
        model.add_joint("pin", "revolute", between=["ground", "arm"], axis="z")
        model.add_sensor("tip", "position", of="arm.tip")
        model.add_sensor("angle", "angle", joint="pin")
        model.add_sensor("speed", "angle", joint="pin", derivative=1)
        law(model, size**2)
        return model

    return make


def _truth(torque, switches, damping=0.0):
    """Of J a'' = torque(t, a, a', signs) − damping a', from rest."""

    def truth(t):
        def rate(t, y, signs):
            return [y[1], (torque(t, *y, signs) - damping * y[1]) / _J]

        angle = between_switches(rate, lambda t, y: switches(t, *y), (0.0, 0.0), t)[0]
        return {"angle": angle, "tip.x": np.cos(angle), "tip.y": np.sin(angle)}

    return truth


def _actuated(value, **fields):
    """A law that is a torque on the pin: what it is at size 1 times the square of the size."""

    def law(model, unit):
        scaled = {key: unit * number for key, number in fields.items()}
        model.add_force("motor", "rotational-spring-damper", joint="pin",
                        value=f"{unit!r}*({value})", **scaled)  # fmt: skip

    return law


def _backlash(model, unit):
    """A play of 0.1 rad to both sides, then 20 N m/rad."""
    points = [[-3, -58 * unit], [-0.1, 0], [0.1, 0], [3, 58 * unit]]
    model.add_force(
        "motor", "rotational-spring-damper", joint="pin", value=f"{0.5 * unit!r}*sin(3*t)",
        damping=0.02 * unit, spring_force={"points": points, "interpolation": "linear"},
    )  # fmt: skip


def _backlash_torque(t, a, w, signs):
    over, under = signs
    reaction = 20 * (a - 0.1) if over > 0 else 20 * (a + 0.1) if under < 0 else 0.0
    return 0.5 * np.sin(3 * t) - reaction


def _servo_torque(t, a, w, signs):
    wanted = 3 * (np.sin(2 * t) - a) - 0.5 * w
    return 0.2 if signs[0] > 0 else -0.2 if signs[1] < 0 else wanted


def _servo_switches(t, a, w):
    wanted = 3 * (np.sin(2 * t) - a) - 0.5 * w
    return wanted - 0.2, wanted + 0.2


def _buffer(model, unit):
    """A stop that is soft, fully damped from 0.02 rad on, and would pull when the arm leaves it."""
    _actuated("0.6*sin(3*t)", damping=0.02)(model, unit)
    model.add_force("buffer", "rotational-stop", joint="pin", upper=0.15, stiffness=30 * unit,
                    damping=2 * unit, depth=0.02)  # fmt: skip


def _buffer_force(a, w, deep):
    p = a - 0.15
    share = 1.0 if deep > 0 else (p / 0.02) ** 2 * (3 - 2 * p / 0.02)
    return 30 * p + 2 * share * w


def _buffer_torque(t, a, w, signs):
    presses, deep, pushes = signs
    push = _buffer_force(a, w, deep) if presses > 0 and pushes > 0 else 0.0
    return 0.6 * np.sin(3 * t) - push


def _buffer_switches(t, a, w):
    p = a - 0.15
    return p, p - 0.02, _buffer_force(a, w, p - 0.02) if p > 0 else 30 * abs(p)


SWITCHES = {
    "backlash": Scene(
        arm(_backlash), 5.0,
        _truth(_backlash_torque, lambda t, a, w: (a - 0.1, a + 0.1), 0.02),
    ),
    "servo that saturates": Scene(
        arm(_actuated("max(-0.2, min(0.2, 3*(sin(2*t) - angle) - 0.5*speed))")), 5.0,
        _truth(_servo_torque, _servo_switches),
    ),
    "quadratic drag": Scene(
        arm(_actuated("0.5*sin(3*t) - 0.2*speed*abs(speed)", damping=0.02)), 5.0,
        _truth(
            lambda t, a, w, signs: 0.5 * np.sin(3 * t) - 0.2 * signs[0] * w * w,
            lambda t, a, w: (w,), 0.02,
        ),
    ),
    "rectified wave": Scene(
        arm(_actuated("0.6*max(0, sin(4*t)) - 0.2*sign(sin(3.1*t))", damping=0.02)), 8.0,
        _truth(
            lambda t, a, w, signs: 0.6 * (signs[0] > 0) * np.sin(4 * t) - 0.2 * signs[1],
            lambda t, a, w: (np.sin(4 * t), np.sin(3.1 * t)), 0.02,
        ),
    ),
    "switched against dry drag": Scene(
        arm(_actuated("0.3*sign(sin(4*t + 1)) - 0.05*sign(speed)", damping=0.02)), 5.0,
        _truth(
            lambda t, a, w, signs: 0.3 * signs[0] - 0.05 * signs[1],
            lambda t, a, w: (np.sin(4 * t + 1), w if t > 0 else 1.0), 0.02,
        ),
    ),
    "shaken against dry drag": Scene(
        arm(_actuated("0.4*cos(3*t) - angle - 0.1*sign(speed)", damping=0.01)), 5.0,
        _truth(
            lambda t, a, w, signs: 0.4 * np.cos(3 * t) - a - 0.1 * signs[0],
            lambda t, a, w: (w if t > 0 else 1.0,), 0.01,
        ),
    ),
    "damped buffer": Scene(
        arm(_buffer), 5.0, _truth(_buffer_torque, _buffer_switches, 0.02)
    ),
}  # fmt: skip
