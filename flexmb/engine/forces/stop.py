"""Force of a stop, which bounds one measure s from below, above or both.

At a penetration p > 0 of a bound a stop pushes back with max(0, k p^e + c step(p/d) ṗ). step is the
cubic that rises from 0 to 1 over the depth d, so that damping sets in smoothly (IMPACT and BISTOP
of MSC Adams). The part k p^e is elastic. Its row is a `FORCE_CHARACTERISTIC`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.model.forces.force_characteristic import AnyStop

#: Event functions of a stop: one for each bound, one for the depth of full damping, and one for the
#: force, which would be negative beyond its zero.
STOP_EVENTS = 4


def stop_parameters(spec: AnyStop, unit: float) -> dict[str, float]:
    """Fields of a FORCE_CHARACTERISTIC row; `unit`: SI value of the unit of s in the stiffness."""
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
    """Penetration of the nearer bound, negative if clear of it; and 1 (upper) or −1 (lower)."""
    if s - row["upper"] > row["lower"] - s:
        return s - row["upper"], 1.0
    return row["lower"] - s, -1.0


@kernel
def _step(row, p):
    """Fraction of the damping at penetration p > 0, and its derivative with respect to p."""
    y = p / row["depth"]
    if y >= 1.0:
        return 1.0, 0.0
    return y * y * (3.0 - 2.0 * y), 6.0 * y * (1.0 - y) / row["depth"]


@kernel
def stop_resistance(row, s, v):
    """R, ∂R/∂s and ∂R/∂ṡ of a stop at s and v = ṡ."""
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
        if f <= 0.0:  # a stop does not pull
            return 0.0, 0.0, 0.0
    return side * f, k, c


@kernel
def stop_energy(row, s):
    """Elastic energy, J; zero clear of the stop."""
    p, _ = penetration(row, s)
    e = row["exponent"] + 1.0
    return row["k"] * p**e / e if p > 0.0 else 0.0


@kernel
def stop_power(row, s, v):
    """Power that the damping force does on the system, W; not positive."""
    p, side = penetration(row, s)
    if p <= 0.0 or row["c"] == 0.0:
        return 0.0
    f, _, _ = stop_resistance(row, s, v)
    return -(side * f - row["k"] * p ** row["exponent"]) * side * v


@kernel
def put_stop_events(row, s, v, events, o):
    """Put the `STOP_EVENTS` event functions of a stop, with their rates, into events from o on."""
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
