"""Characteristics of springs, dampers, actuators and stops: force, slopes, energy and power.

A characteristic resists the growth of its measure s with R(s, ṡ). A spring has, with x = s − free,
R = k x + c ṡ + S(x) + D(ṡ) − u(t), S and D as programs. A stop has one bound
or two: at a penetration p > 0 of one it pushes back with max(0, k p^e + c step(p/d) ṗ), step the
cubic from 0 to 1 over the depth d (IMPACT and BISTOP of MSC Adams). The elastic parts are stored.
"""

from __future__ import annotations

import numpy as np

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.functions.function import FunctionTable, evaluate, run_program
from flexmb.engine.records import Matrix

# A force by a characteristic of one measure s and its rate: the distance of two markers, the
# component of their separation along z of I, or a scalar coordinate.
FORCE_CHARACTERISTIC = np.dtype(
    [
        ("measure", "i8"),  # DISTANCE_OF, COMPONENT_OF, COORDINATE_OF
        ("I", "i8"),
        ("J", "i8"),
        ("coordinate", "i8"),  # the scalar coordinate, or -1
        ("couple", "i8"),
        ("stop", "i8"),  # 1: a stop; then k, c are at full depth, free is not used
        ("k", "f8"),
        ("c", "f8"),
        ("free", "f8"),
        ("fun", "i8"),  # u(t), or -1
        ("spring", "i8"),  # program, or -1
        ("stored", "i8"),  # program of the integral of the spring, or -1: by Gauss's rule
        ("damper", "i8"),  # program, or -1
        ("exponent", "f8"),
        ("depth", "f8"),
        ("lower", "f8"),
        ("upper", "f8"),
    ],
    align=True,
)
# Measures.
# The first two are those of the rows of joints.
DISTANCE_OF, COMPONENT_OF, COORDINATE_OF = 0, 1, 2

_PANELS = 16
# Points and half weights of Gauss–Legendre's rule of eight points on (0, 1), the lower four.
_GAUSS = (
    (0.019855071751231884, 0.05061426814518813),
    (0.10166676129318664, 0.11119051722668724),
    (0.2372337950418355, 0.15685332293894364),
    (0.4082826787521751, 0.18134189168918100),
)


@kernel
def resistance(row, programs, stack, s, v, u):
    """R, ∂R/∂s, ∂R/∂ṡ; u the present value of its function of time."""
    if row["stop"] == 1:
        return _stop(row, s, v)
    x = s - row["free"]
    f, k, c = row["k"] * x - u, row["k"], 0.0
    if row["spring"] >= 0:
        a, b, _ = evaluate(programs, row["spring"], x, stack, stack)
        f, k = f + a, k + b
    if row["c"] != 0.0:
        f, c = f + row["c"] * v, row["c"]
    if row["damper"] >= 0:
        a, b, _ = evaluate(programs, row["damper"], v, stack, stack)
        f, c = f + a, c + b
    return f, k, c


@kernel
def penetration(row, s):
    """Depth in a bound, negative clear of both, and the direction: 1 upper, −1 lower."""
    if s - row["upper"] > row["lower"] - s:
        return s - row["upper"], 1.0
    return row["lower"] - s, -1.0


@kernel
def _step(row, p):
    """Share of the damping at penetration p, and its slope."""
    y = p / row["depth"]
    if y >= 1.0:
        return 1.0, 0.0
    return y * y * (3.0 - 2.0 * y), 6.0 * y * (1.0 - y) / row["depth"]


@kernel
def _stop(row, s, v):
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
def stored_energy(row, programs, stack, s):
    """What the elastic part stores, J; nothing at x = 0 or clear of the stop."""
    if row["stop"] == 1:
        p, _ = penetration(row, s)
        e = row["exponent"] + 1.0
        return row["k"] * p**e / e if p > 0.0 else 0.0
    x = s - row["free"]
    stored = 0.5 * row["k"] * x * x
    if row["stored"] >= 0:
        stored += run_program(programs, row["stored"], x, stack, stack)
    elif row["spring"] >= 0:
        stored += integral(programs, row["spring"], stack, x)
    return stored


@unit
def integral(programs: FunctionTable, k: int, stack: Matrix, x: float) -> float:
    """Integral of program k from 0 to x by Gauss's rule, exact to the 15th power of x."""
    total = 0.0
    h = x / _PANELS
    for n in range(_PANELS):
        for place, weight in _GAUSS:
            f = run_program(programs, k, h * (n + place), stack, stack)
            g = run_program(programs, k, h * (n + 1.0 - place), stack, stack)
            total += weight * (f + g)
    return h * total


@kernel
def dissipation(row, programs, stack, s, v):
    """Power of the dissipative part on the system, W."""
    if row["stop"] == 1:
        p, side = penetration(row, s)
        if p <= 0.0 or row["c"] == 0.0:
            return 0.0
        f, _, _ = _stop(row, s, v)
        return -(side * f - row["k"] * p ** row["exponent"]) * side * v
    f = row["c"] * v if row["c"] != 0.0 else 0.0
    if row["damper"] >= 0:
        f += run_program(programs, row["damper"], v, stack, stack)
    return -f * v
