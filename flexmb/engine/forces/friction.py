"""Dry friction: coefficient over speed, and the force on a surface from bristle or smooth model.

μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + v_v v, v the speed of sliding (Stribeck;
Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083). Bristle: an elastic-plastic
spring s, an internal variable that the surface carries; with T = k s + c v the force is −T while
|T| ≤ μ N and −μ N T/|T| beyond (Dupont et al., IEEE Trans. Autom. Control 47 (2002) 787). A
bristle that sticks does not creep; one that slides follows up to the length k s = μ N, so that what
a stick begins with depends on no step.
Smooth: −μ N v/√(v² + v₀²), which creeps at any load.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.algebra.vector import inner, plus, times
from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.model.forces.friction import BaseFriction

# Models of friction, and what its history says: on a line −SLIDES, where the force is positive.
NO_FRICTION, BRISTLE, SMOOTH = 0, 1, 2
OPEN, STICKS, SLIDES, YIELDS = 0.0, 1.0, 2.0, 3.0

# Of the normal force, by which |T| exceeds μ N where it begins to slide: above round-off of what
# has just stuck.
LEAST_EXCESS = 1e-9

_I, _F = "i8", "f8"
# Fields of a row with friction; what it remembers begins at `history`. Stribeck speed (m/s),
# viscous coefficient per speed (s/m), k (N/m) and c (N s/m) of the bristle, speed of creep (m/s).
_WORDS = ("static", "dynamic", "stribeck", "viscous", "k", "c", "creep")
FRICTION_FIELDS = (("model", _I), *((word, _F) for word in _WORDS), ("history", _I))


def friction_parameters(spec: BaseFriction | None) -> tuple[float, ...]:
    """Numbers of `FRICTION_FIELDS` but the place of the history; None: no friction."""
    if spec is None:
        return NO_FRICTION, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0, 1.0
    static = spec.static_coefficient
    stribeck = spec.stribeck_speed if static > spec.dynamic else math.inf
    return (
        SMOOTH if spec.model == "smooth" else BRISTLE, static, spec.dynamic, stribeck,
        spec.viscous, spec.stiffness or 0.0, spec.damping, spec.creep_speed or 1.0,
    )  # fmt: skip


@kernel
def friction_coefficient(f, v):
    """μ(v) and its slope."""
    x = v / f["stribeck"]
    more = (f["static"] - f["dynamic"]) * math.exp(-x * x)
    slope = f["viscous"] - 2.0 * x / f["stribeck"] * more
    return f["dynamic"] + more + f["viscous"] * v, slope


@kernel
def tangential_part(n, a):
    """The part of a normal to n."""
    return plus(a, -inner(n, a), n)


@kernel
def friction_force(f, n, N, g, z):
    """Force of friction, bristle, whether it sticks or slides, and |T| − μ N.

    f: parameters; n, N: normal and normal force; g: relative velocity; z: bristle if it sticks.
    """
    v = tangential_part(n, g)
    speed = math.sqrt(inner(v, v))
    mu, _ = friction_coefficient(f, speed)
    limit = mu * N
    if f["model"] == SMOOTH:
        w = -limit / math.sqrt(speed * speed + f["creep"] * f["creep"])
        return times(w, v), times(0.0, v), SLIDES, 0.0
    s = tangential_part(n, z)
    T = plus(times(f["k"], s), f["c"], v)
    size = math.sqrt(inner(T, T))
    if size <= limit:
        return times(-1.0, T), s, STICKS, size - limit
    stretch = f["k"] * math.sqrt(inner(s, s))
    s = times(limit / stretch, s) if stretch > limit else s
    return times(-limit / size, T), s, SLIDES, size - limit


@kernel
def _tangential_part_change(n, a, dn, da):
    """Change of the part of a normal to n."""
    x = plus(da, -inner(dn, a) - inner(n, da), n)
    return plus(x, -inner(n, a), dn)


@kernel
def friction_force_change(f, n, N, g, z, dn, dN, dg, dz):
    """Change of the force of friction with changes of what it depends on."""
    v = tangential_part(n, g)
    speed = math.sqrt(inner(v, v))
    mu, slope = friction_coefficient(f, speed)
    dv = _tangential_part_change(n, g, dn, dg)
    dspeed = inner(v, dv) / speed if speed > 0.0 else 0.0
    limit, dlimit = mu * N, mu * dN + slope * dspeed * N
    if f["model"] == SMOOTH:
        w = 1.0 / math.sqrt(speed * speed + f["creep"] * f["creep"])
        change = times(-limit * w, dv)
        return plus(change, -dlimit * w + limit * w * w * w * speed * dspeed, v)
    s, ds = tangential_part(n, z), _tangential_part_change(n, z, dn, dz)
    T = plus(times(f["k"], s), f["c"], v)
    dT = plus(times(f["k"], ds), f["c"], dv)
    size = math.sqrt(inner(T, T))
    if size <= limit:
        return times(-1.0, dT)
    change = times(-limit / size, dT)
    return plus(change, (limit * inner(T, dT) / (size * size) - dlimit) / size, T)


@kernel
def next_mode(before, mode, along):
    """Mode to remember; `before`: of the step before, `along`: speed along the bristle.

    What slides and turns back sticks; what is pulled against its motion, as its load falls, yields.
    """
    if abs(mode) != SLIDES or along > 0.0:
        return mode
    return STICKS if abs(before) == SLIDES else YIELDS


@kernel
def line_friction(f, N, x, v, anchor):
    """The same on a line: force, anchor of the bristle, mode, |T| − μ N, and two slopes.

    x: place, v: speed, anchor: where the bristle is free. Slopes of −force over x and over v.
    """
    mu, slope = friction_coefficient(f, abs(v))
    limit = mu * N
    if f["model"] == SMOOTH:
        w = 1.0 / math.sqrt(v * v + f["creep"] * f["creep"])
        change = limit * w * (1.0 - v * v * w * w) + slope * N * abs(v) * w
        return -limit * v * w, x, SLIDES, 0.0, 0.0, change
    s = x - anchor
    T = f["k"] * s + f["c"] * v
    if abs(T) <= limit:
        return -T, anchor, STICKS, abs(T) - limit, f["k"], f["c"]
    sign = 1.0 if T > 0.0 else -1.0
    change = slope * N * sign * (1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0)
    longest = limit / f["k"]
    anchor = x - min(max(s, -longest), longest)
    return -limit * sign, anchor, sign * SLIDES, abs(T) - limit, 0.0, change
