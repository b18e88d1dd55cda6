"""Dry friction: coefficient over speed, and the force on a surface from bristle or smooth model.

μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + v_v v, v the speed of sliding (Stribeck;
Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083). Bristle: an elastic-plastic
spring s, an internal variable that the surface carries; with T = k s + c v the force is −T while
|T| ≤ μ N and −μ N T/|T| beyond (Dupont et al., IEEE Trans. Autom. Control 47 (2002) 787). A
bristle that sticks does not creep; one that slides follows up to the length k s = μ N, so that what
a stick begins with depends on no step. It is full then, until the limit grows faster than it slides
(`forces.bristle`). That of a contact turns with the velocity, and after some lengths friction is
against that, whatever the lag.
Smooth: −μ N v/√(v² + v₀²), which creeps at any load.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.algebra.vector import inner, plus, times
from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.model.forces.friction import BaseFriction

# Models of friction, and what the history of a bristle says: no contact, free, or as long as its
# limit.
NO_FRICTION, BRISTLE, SMOOTH = 0, 1, 2
OPEN, FREE, FULL = 0.0, 1.0, 2.0

# Of the normal force, by which |T| exceeds μ N where it begins to slide: above round-off of what
# has just stuck, or is pushed back. By as little a bristle that is full may be too short.
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
def friction_force(f, n, N, g, s0, way, turns):
    """Force of friction, bristle, |T| − μ N, k |z| − μ N, and lengths that it slid while full.

    T of what was free with z, so that it grows steadily where it begins to slide.

    f: parameters; n, N: normal and normal force; g: relative velocity; s0: bristle as the step
    began, way: what the surfaces have slid since, z: both; `turns`: lengths as the step began, < 0
    if it was free.
    """
    v = tangential_part(n, g)
    speed = math.sqrt(inner(v, v))
    mu, _ = friction_coefficient(f, speed)
    limit = mu * N
    if f["model"] == SMOOTH:
        w = -limit / math.sqrt(speed * speed + f["creep"] * f["creep"])
        return times(w, v), times(0.0, v), 0.0, 0.0, -1.0
    s0, way = tangential_part(n, s0), tangential_part(n, way)
    s, is_free = plus(s0, 1.0, way), turns < 0.0
    reach, _ = _direction(plus(times(f["k"], s), f["c"], v))
    room, along = f["k"] * math.sqrt(inner(s, s)) - limit, 0.0
    if room > (-LEAST_EXCESS * limit if turns >= 0.0 else 0.0):
        e, turns = _full_direction(s0, way, v, limit / f["k"], turns)
        along, s = inner(e, v), times(limit / f["k"], e)
    T = plus(times(f["k"], s), f["c"], v)
    size, d = _direction(T)
    if along > 0.0:
        share = _aligned(turns) * (1.0 - (1.0 - (along / speed) ** 2) ** 4)
        _, d = _direction(plus(times(1.0 - share, d), share / speed, v))
        excess = reach - limit if is_free else limit * along / speed
        return times(-limit, d), s, excess, room, turns
    excess = reach - limit if is_free else size - limit
    return times(-min(size, limit), d), s, excess, room, turns


# Lengths of a full bristle after which what slides is rubbed against its velocity alone: e⁻⁴, 2 %
# of an angle between both, is left. Not where that is nearly across: at an angle ψ by 1 − sin⁸ ψ.
ALIGNED = 4.0


@kernel
def _aligned(turns):
    """Share of the velocity in the direction of friction, that of the bristle at first."""
    u = min(max(turns, 0.0) / ALIGNED, 1.0)
    return u * u * u * (10.0 - u * (15.0 - 6.0 * u))


@kernel
def _memory(sigma, before, length):
    """Way x in lengths of a full bristle; weights of its direction before, and of the velocity's.

    The velocity turned evenly: weights of its mean direction, that of the way, and of that now.
    """
    x = 2.0 * sigma / (before + length)
    a = math.exp(-x)
    b = 2.0 * (1.0 - a * (1.0 + x)) / x
    return x, a, b, 1.0 - a - b


@kernel
def _follows_velocity(s0, way, v):
    """Whether a full bristle slides on, and turns with the velocity."""
    return inner(s0, way) >= 0.0 and inner(way, way) > 0.0 and inner(v, v) > 0.0


@kernel
def _direction(a):
    """Size and direction."""
    size = math.sqrt(inner(a, a))
    return size, times(1.0 / size, a) if size > 0.0 else a


@kernel
def _full_direction(s0, way, v, length, turns):
    """Direction of a full bristle, and lengths that it slid while full.

    That turns by the part of the speed across it over its length, so that of the angle ψ to a
    constant velocity after a way x L tan ψ/2 e^(−x) is left. What becomes full, or is pushed back,
    is as long in the direction that it has.
    """
    before, e0 = _direction(s0)
    if turns < 0.0 or not _follows_velocity(s0, way, v):
        return _direction(plus(s0, 1.0, way))[1], max(turns, 0.0)
    sigma, e1 = _direction(way)
    x, a, b, c = _memory(sigma, before, length)
    _, e = _direction(plus(times(b, e1), c, _direction(v)[1]))
    if before > 0.0:
        e = plus(times((1.0 - a) * (1.0 + a + (1.0 - a) * inner(e0, e)), e), 2.0 * a, e0)
    return _direction(e)[1], turns + x


@kernel
def _tangential_part_change(n, a, dn, da):
    """Change of the part of a normal to n."""
    x = plus(da, -inner(dn, a) - inner(n, da), n)
    return plus(x, -inner(n, a), dn)


@kernel
def _direction_change(a, da):
    """Size of a, its direction, and the change of that."""
    size, e = _direction(a)
    return size, e, times(1.0 / size, plus(da, -inner(e, da), e)) if size > 0.0 else da


@kernel
def _full_direction_change(s0, way, v, length, turns, ds0, dway, dv, dlength):
    """Direction of a full bristle and its change, lengths that it slid and theirs."""
    before, e0, de0 = _direction_change(s0, ds0)
    if turns < 0.0 or not _follows_velocity(s0, way, v):
        _, e, de = _direction_change(plus(s0, 1.0, way), plus(ds0, 1.0, dway))
        return e, de, max(turns, 0.0), 0.0
    sigma, e1, de1 = _direction_change(way, dway)
    _, e2, de2 = _direction_change(v, dv)
    x, a, b, c = _memory(sigma, before, length)
    dx = (2.0 * inner(e1, dway) - x * (inner(e0, ds0) + dlength)) / (before + length)
    da, db = -a * dx, (2.0 * a - b / x) * dx
    e, de = plus(times(b, e1), c, e2), plus(plus(times(b, de1), c, de2), db, e1)
    _, e, de = _direction_change(e, plus(de, -da - db, e2))
    if before > 0.0:
        near, change = inner(e0, e), inner(e0, de) + inner(de0, e)
        f = (1.0 - a) * (1.0 + a + (1.0 - a) * near)
        df = (1.0 - a) ** 2 * change - 2.0 * (a + near * (1.0 - a)) * da
        de = plus(plus(times(df, e), f, de), 2.0 * a, de0)
        e, de = plus(times(f, e), 2.0 * a, e0), plus(de, 2.0 * da, e0)
        _, e, de = _direction_change(e, de)
    return e, de, turns + x, dx


@kernel
def friction_force_change(f, n, N, g, s0, way, turns, dn, dN, dg, ds0, dway):
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
    ds0, dway = _tangential_part_change(n, s0, dn, ds0), _tangential_part_change(n, way, dn, dway)
    s0, way = tangential_part(n, s0), tangential_part(n, way)
    s, ds = plus(s0, 1.0, way), plus(ds0, 1.0, dway)
    cosine, dcosine, dturns, room = 0.0, 0.0, 0.0, f["k"] * math.sqrt(inner(s, s)) - limit
    if room > (-LEAST_EXCESS * limit if turns >= 0.0 else 0.0):
        s, ds, turns, dturns = _full_direction_change(
            s0, way, v, limit / f["k"], turns, ds0, dway, dv, dlimit / f["k"]
        )
        cosine = inner(s, v) / speed if speed > 0.0 else 0.0
        dcosine = inner(ds, v) + inner(s, dv) - cosine * dspeed
        dcosine = dcosine / speed if speed > 0.0 else 0.0
        s, ds = times(limit, s), plus(times(dlimit, s), limit, ds)
    else:
        s, ds = times(f["k"], s), times(f["k"], ds)
    size, d, dd = _direction_change(plus(s, f["c"], v), plus(ds, f["c"], dv))
    if cosine > 0.0:
        u = min(turns / ALIGNED, 1.0)
        across = 1.0 - cosine * cosine
        share = _aligned(turns) * (1.0 - across**4)
        rise = 30.0 * (u * (1.0 - u)) ** 2 / ALIGNED * dturns
        dshare = rise * (1.0 - across**4)
        dshare += 8.0 * _aligned(turns) * cosine * across**3 * dcosine
        _, e, de = _direction_change(v, dv)
        dd = plus(plus(times(1.0 - share, dd), share, de), dshare, plus(e, -1.0, d))
        _, d, dd = _direction_change(plus(times(1.0 - share, d), share, e), dd)
    elif size <= limit:
        return times(-1.0, plus(ds, f["c"], dv))
    return plus(times(-dlimit, d), -limit, dd)


@kernel
def line_friction(f, N, stretch, v, mode):
    """The same on a line: force, bristle, |T| − μ N, k |z| − μ N, slopes of −force over z, v and N.

    stretch: z, v: speed, mode: what its history says, ±FULL. The normal force of a joint depends on
    its friction, so that it slides by T alone: a bristle that is let go, as the load falls, is
    longer by c |v|/k, where T = μ N.
    """
    mu, slope = friction_coefficient(f, abs(v))
    limit, way = mu * N, 1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0
    rise = slope * N * way
    if f["model"] == SMOOTH:
        w = 1.0 / math.sqrt(v * v + f["creep"] * f["creep"])
        change = limit * w * (1.0 - v * v * w * w) + rise * v * w
        return -limit * v * w, 0.0, 0.0, 0.0, 0.0, change, mu * v * w
    T = f["k"] * stretch + f["c"] * v
    side = math.copysign(1.0, T if T != 0.0 else stretch)
    longest = limit + f["c"] * max(-side * v, 0.0)  # times k: what is let go may be longer
    room = side * f["k"] * stretch - longest
    is_full = room > (-LEAST_EXCESS * limit if abs(mode) == FULL else 0.0)
    excess = abs(T) - limit
    if is_full:
        return -side * limit, side * longest / f["k"], excess, room, 0.0, side * rise, side * mu
    if excess > 0.0:
        return -side * limit, stretch, excess, room, 0.0, side * rise, side * mu
    return -T, stretch, excess, room, f["k"], f["c"], 0.0
