"""An arm that is controlled: held references, limits of a rate, dead zones, delays."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.signal import tf2ss

from .scene import Scene
from .switches import arm, between_switches
from .textbook import integrated

_J = 0.1
_HELD = np.round(np.sin(0.2 * np.arange(51)), 3)  # references, each for 0.1 s
_DELAY = 0.15


def _seen(angle):
    return {"angle": angle, "tip.x": np.cos(angle), "tip.y": np.sin(angle)}


def _drive(value):
    """A law that is a torque on the pin, at size 1."""

    def law(model, unit):
        model.add_force("motor", "rotational-spring-damper", joint="pin",
                        value=f"{unit!r}*({value})")  # fmt: skip

    return law


def staircase(within=1e-9):
    """A computer holds its reference for 0.1 s and changes it within some seconds."""

    def law(model, unit):
        points = [
            [0.1 * k + later, 3 * unit * float(value)]
            for k, value in enumerate(_HELD)
            for later in (within * (k > 0), 0.1)
        ]
        steps = {"type": "table", "points": points, "beyond": "hold"}
        model.add_force("reference", "torque", at="arm", value=[0, 0, steps])
        _drive("-3*angle - 0.4*speed")(model, unit)

    return arm(law)


def staircase_truth(t):
    """J a'' + 0.4 a' + 3 (a − r) = 0 with r constant: matrix exponentials, one after the other."""
    A = np.array([[0, 1], [-3 / _J, -0.4 / _J]])
    y, found = np.zeros(2), np.zeros(len(t))
    for k, value in enumerate(_HELD):
        off = y - [value, 0]
        for i in np.flatnonzero((t > 0.1 * k - 1e-9) & (t < 0.1 * (k + 1) + 1e-9)):
            found[i] = value + (expm(A * (t[i] - 0.1 * k)) @ off)[0]
        y = [value, 0] + expm(A * 0.1) @ off
    return _seen(found)


_WANTED = "20*(3*(sin(2*t) - angle) - 0.6*speed - torque)"


def _rate_limit(model, unit):
    """A motor whose torque changes by 2 N m/s at most."""
    model.add_state("torque", rate=f"max(-2, min(2, {_WANTED}))", start=0)
    _drive("torque")(model, unit)


def _rate_limit_truth(t):
    def wanted(t, y):
        return 20 * (3 * (np.sin(2 * t) - y[0]) - 0.6 * y[1] - y[2])

    def rate(t, y, signs):
        change = 2.0 if signs[0] > 0 else -2.0 if signs[1] < 0 else wanted(t, y)
        return [y[1], y[2] / _J, change]

    def switches(t, y):
        return wanted(t, y) - 2, wanted(t, y) + 2

    return _seen(between_switches(rate, switches, (0.0, 0.0, 0.0), t)[0])


_DEAD_ZONE = _drive(
    "8*(max(0, sin(2*t) - angle - 0.1) + min(0, sin(2*t) - angle + 0.1)) - 0.2*speed"
)


def _dead_zone_truth(t):
    def rate(t, y, signs):
        off = np.sin(2 * t) - y[0]
        pull = 8 * (off - 0.1) if signs[0] > 0 else 8 * (off + 0.1) if signs[1] < 0 else 0.0
        return [y[1], (pull - 0.2 * y[1]) / _J]

    def switches(t, y):
        off = np.sin(2 * t) - y[0]
        return off - 0.1, off + 0.1

    return _seen(between_switches(rate, switches, (0.0, 0.0), t)[0])


_PADE = ([_DELAY**2 / 12, -_DELAY / 2, 1], [_DELAY**2 / 12, _DELAY / 2, 1])


def _delay(model, unit):
    """A controller whose output comes late, by Padé's approximation of order 2."""
    model.add_controller("late", type="transfer-function", input="sin(3*t) - angle - 0.3*speed",
                         numerator=_PADE[0], denominator=_PADE[1])  # fmt: skip
    _drive("2*late")(model, unit)


def _delay_truth(t):
    A, B, C, D = tf2ss(*_PADE)

    def slope(t, y):
        error = np.sin(3 * t) - y[0] - 0.3 * y[1]
        torque = 2 * ((C @ y[2:])[0] + D[0, 0] * error)
        return [y[1], torque / _J, *(A @ y[2:] + B[:, 0] * error)]

    return _seen(integrated(slope, [0.0, 0.0, 0.0, 0.0], t)[0])


CONTROL = {
    "staircase": Scene(staircase(), 5.0, staircase_truth),
    "limited rate": Scene(arm(_rate_limit), 5.0, _rate_limit_truth),
    "dead zone": Scene(arm(_DEAD_ZONE), 5.0, _dead_zone_truth),
    "delay": Scene(arm(_delay), 5.0, _delay_truth),
}
