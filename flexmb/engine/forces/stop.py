"""The law of a stop: bounds of one measure s, that push back.

At a penetration p > 0 of a bound a stop pushes back with max(0, k p^e + c step(p/d) ṗ), step the
cubic from 0 to 1 over the depth d (IMPACT and BISTOP of MSC Adams); k p^e is stored. A row is one
of `FORCE_CHARACTERISTIC`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.model.forces.force_characteristic import AnyStop

#: Of a stop: both bounds, the depth at which it is fully damped, and where it would begin to pull.
STOP_EVENTS = 4


def stop_parameters(spec: AnyStop, unit: float) -> dict[str, float]:
    """Fields of a FORCE_CHARACTERISTIC row; `unit` of s in which the stiffness counts, SI."""
    lower, upper = spec.bounds
    return {
        "stop": 1,
        "exponent": spec.exponent,
        "c": spec.damping,
        "lower": lower,
        "upper": upper,
        "depth": math.inf if spec.depth is None else spec.depth,
        "k": spec.stiffness * unit ** (1.0 - spec.exponent),
    }


@kernel
def penetration(row, s):
    """Penetration of a bound, negative clear of both, and the direction: 1 upper, −1 lower."""
    if s - row["upper"] > row["lower"] - s:
        return s - row["upper"], 1.0
    return row["lower"] - s, -1.0


@kernel
def _step(row, p):
    """Fraction of the damping at penetration p, and its slope."""
    y = p / row["depth"]
    if y >= 1.0:
        return 1.0, 0.0
    return y * y * (3.0 - 2.0 * y), 6.0 * y * (1.0 - y) / row["depth"]


@kernel
def stop_resistance(row, s, v):
    """R, ∂R/∂s, ∂R/∂ṡ."""
    p, side = penetration(row, s)
    if p <= 0.0:
        return 0.0, 0.0, 0.0
    e = row["exponent"]
    f, k, c = row["k"] * p**e, row["k"] * e * p ** (e - 1.0), 0.0
    if row["c"] != 0.0:
        share, slope = _step(row, p)
        c = row["c"] * share
        f += c * side * v
        k += row["c"] * slope * side * v
        if f <= 0.0:  # it does not pull
            return 0.0, 0.0, 0.0
    return side * f, k, c


@kernel
def stop_energy(row, s):
    """Stored energy, J; zero clear of the stop."""
    p, _ = penetration(row, s)
    e = row["exponent"] + 1.0
    return row["k"] * p**e / e if p > 0.0 else 0.0


@kernel
def stop_power(row, s, v):
    """Power of the damping on the system, W."""
    p, side = penetration(row, s)
    if p <= 0.0 or row["c"] == 0.0:
        return 0.0
    f, _, _ = stop_resistance(row, s, v)
    return -(side * f - row["k"] * p ** row["exponent"]) * side * v


@kernel
def put_stop_events(row, s, v, events, o):
    """How far a stop is from where its law changes, with rates, into events from o on."""
    p, side = penetration(row, s)
    events[o]["value"], events[o]["rate"] = s - row["upper"], v
    events[o + 1]["value"], events[o + 1]["rate"] = row["lower"] - s, -v
    deep, force = -math.inf, 1.0
    if row["c"] != 0.0:
        deep, force = p - row["depth"], row["k"] * abs(p) ** row["exponent"]
        if p > 0.0:
            force += row["c"] * _step(row, p)[0] * side * v
    events[o + 2]["value"], events[o + 2]["rate"] = deep, side * v
    events[o + 3]["value"], events[o + 3]["rate"] = force, math.nan
