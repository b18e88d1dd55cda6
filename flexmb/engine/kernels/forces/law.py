"""Forces by a law of one measure: springs, dampers, actuators, stops; force, slopes, energy, power.

A law resists the growth of its measure s with R(s, ṡ). A spring has, with x = s − free,
R = k x + c ṡ + S(x) + D(ṡ) − u(t), S and D as programs. A stop has one bound
or two: at a penetration p > 0 of one it pushes back with max(0, k p^e + c step(p/d) ṗ), step the
cubic from 0 to 1 over the depth d (IMPACT and BISTOP of MSC Adams). The elastic parts are stored.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.functions.function import evaluate

_PANELS = 16
# Points and half weights of Gauss–Legendre's rule of eight points on (0, 1), the lower four.
_GAUSS = (
    (0.019855071751231884, 0.05061426814518813),
    (0.10166676129318664, 0.11119051722668724),
    (0.2372337950418355, 0.15685332293894364),
    (0.4082826787521751, 0.18134189168918100),
)


@kernel
def resistance(law, elements, stack, s, v, u):
    """R, ∂R/∂s, ∂R/∂ṡ; u the present value of its function of time."""
    if law["stop"] == 1:
        return _stop(law, s, v)
    x = s - law["free"]
    f, k, c = law["k"] * x - u, law["k"], 0.0
    if law["spring"] >= 0:
        a, b, _ = evaluate(elements.programs, law["spring"], x, stack, stack)
        f, k = f + a, k + b
    if law["c"] != 0.0:
        f, c = f + law["c"] * v, law["c"]
    if law["damper"] >= 0:
        a, b, _ = evaluate(elements.programs, law["damper"], v, stack, stack)
        f, c = f + a, c + b
    return f, k, c


@kernel
def penetration(law, s):
    """Depth in a bound, negative clear of both, and the direction: 1 upper, −1 lower."""
    if s - law["upper"] > law["lower"] - s:
        return s - law["upper"], 1.0
    return law["lower"] - s, -1.0


@kernel
def _step(law, p):
    """Share of the damping at penetration p, and its slope."""
    y = p / law["depth"]
    if y >= 1.0:
        return 1.0, 0.0
    return y * y * (3.0 - 2.0 * y), 6.0 * y * (1.0 - y) / law["depth"]


@kernel
def _stop(law, s, v):
    p, side = penetration(law, s)
    if p <= 0.0:
        return 0.0, 0.0, 0.0
    e = law["exponent"]
    f, k, c = law["k"] * p**e, law["k"] * e * p ** (e - 1.0), 0.0
    if law["c"] != 0.0:
        share, slope = _step(law, p)
        c = law["c"] * share
        f += c * side * v
        k += law["c"] * slope * side * v
        if f <= 0.0:  # it does not pull
            return 0.0, 0.0, 0.0
    return side * f, k, c


@kernel
def energy(law, elements, stack, s):
    """What the elastic part stores, J; nothing at x = 0 or clear of the stop."""
    if law["stop"] == 1:
        p, _ = penetration(law, s)
        e = law["exponent"] + 1.0
        return law["k"] * p**e / e if p > 0.0 else 0.0
    x = s - law["free"]
    stored = 0.5 * law["k"] * x * x
    if law["stored"] >= 0:
        stored += evaluate(elements.programs, law["stored"], x, stack, stack)[0]
    elif law["spring"] >= 0:
        stored += integral(elements.programs, law["spring"], stack, x)
    return stored


@kernel
def integral(programs, at, stack, x):
    """Integral of a program from 0 to x by Gauss's rule, exact to the 15th power of x."""
    total = 0.0
    h = x / _PANELS
    for n in range(_PANELS):
        for place, weight in _GAUSS:
            f, _, _ = evaluate(programs, at, h * (n + place), stack, stack)
            g, _, _ = evaluate(programs, at, h * (n + 1.0 - place), stack, stack)
            total += weight * (f + g)
    return h * total


@kernel
def damper_power(law, elements, stack, s, v):
    """Power of the dissipative part on the system, W."""
    if law["stop"] == 1:
        p, side = penetration(law, s)
        if p <= 0.0 or law["c"] == 0.0:
            return 0.0
        f, _, _ = _stop(law, s, v)
        return -(side * f - law["k"] * p ** law["exponent"]) * side * v
    f = law["c"] * v if law["c"] != 0.0 else 0.0
    if law["damper"] >= 0:
        f += evaluate(elements.programs, law["damper"], v, stack, stack)[0]
    return -f * v
