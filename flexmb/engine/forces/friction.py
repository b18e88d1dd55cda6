"""Dry friction: coefficient over speed, and the force on a surface from bristle or smooth model.

μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + v_v v, v the speed of sliding (Stribeck;
Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083). Bristle: an elastic-plastic
spring s, an internal variable that the surface carries; with T = k s + c v the force is −T while
|T| ≤ μ N and −μ N T/|T| beyond, when s shrinks in the same ratio (Dupont et al., IEEE Trans. Autom.
Control 47 (2002) 787; return mapping as in plasticity). A bristle that sticks does not creep.
Smooth: −μ N v/√(v² + v₀²), which creeps at any load. In a step of length h the trial bristle
is s₀ + h v with the velocity of the end (backward Euler), so that stiff bristles come to rest.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.algebra.vector import inner, plus, times
from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.model.forces.friction import BaseFriction

# Models of friction, and what its history says.
NO_FRICTION, BRISTLE, SMOOTH = 0, 1, 2
OPEN, STICKS, SLIDES = 0.0, 1.0, 2.0

_I, _F = "i8", "f8"
# Fields of a row with friction; what it remembers begins at `history`.
FRICTION_FIELDS = (
    ("model", _I),  # NO_FRICTION, BRISTLE, SMOOTH
    ("static", _F),
    ("dynamic", _F),
    ("stribeck", _F),  # m/s
    ("viscous", _F),  # s/m, coefficient per speed
    ("k", _F),  # N/m of the bristle
    ("c", _F),  # N s/m of the bristle
    ("creep", _F),  # m/s, of the smooth model
    ("history", _I),
)


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
def friction_force(f, n, N, g, s0, h):
    """Force of friction, bristle, whether it sticks or slides, and |T| − μ N.

    f: parameters; n, N: normal and normal force; g: relative velocity; s0: bristle a time h ago.
    """
    v = tangential_part(n, g)
    speed = math.sqrt(inner(v, v))
    mu, _ = friction_coefficient(f, speed)
    limit = mu * N
    if f["model"] == SMOOTH:
        w = -limit / math.sqrt(speed * speed + f["creep"] * f["creep"])
        return times(w, v), times(0.0, v), SLIDES, 0.0
    s = tangential_part(n, plus(s0, h, g))
    T = plus(times(f["k"], s), f["c"], v)
    size = math.sqrt(inner(T, T))
    if size <= limit:
        return times(-1.0, T), s, STICKS, size - limit
    return times(-limit / size, T), times(limit / size, s), SLIDES, size - limit


@kernel
def _tangential_part_change(n, a, dn, da):
    """Change of the part of a normal to n."""
    x = plus(da, -inner(dn, a) - inner(n, da), n)
    return plus(x, -inner(n, a), dn)


@kernel
def friction_force_change(f, n, N, g, s0, h, dn, dN, dg, ds0):
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
    z = plus(s0, h, g)
    s, ds = tangential_part(n, z), _tangential_part_change(n, z, dn, plus(ds0, h, dg))
    T = plus(times(f["k"], s), f["c"], v)
    dT = plus(times(f["k"], ds), f["c"], dv)
    size = math.sqrt(inner(T, T))
    if size <= limit:
        return times(-1.0, dT)
    change = times(-limit / size, dT)
    return plus(change, (limit * inner(T, dT) / (size * size) - dlimit) / size, T)


@kernel
def line_friction(f, N, x, v, anchor):
    """The same on a line: force, anchor of the bristle, stick or slide, |T| − μ N, and two slopes.

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
    return -limit * sign, x - limit / abs(T) * s, SLIDES, abs(T) - limit, 0.0, change
