"""Dry friction: the coefficient as a function of speed, and the force of two models.

μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + v_v v, v the speed of sliding (Stribeck;
Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083).

Bristle model: the deflection s of an elastic-plastic spring is an internal variable that moves with
the surface J. With T = k s + c v the force is −T while |T| ≤ μ N, and −μ N T/|T| beyond (Dupont et
al., IEEE Trans. Autom. Control 47 (2002) 787). A bristle that sticks does not creep. Sliding
stretches it up to k |s| = μ N, so that its length at the begin of a stick does not depend on the
step size. At this limit it is full, until the limit grows faster than the surfaces slide
(`forces.bristle`). In a contact a full bristle turns towards the velocity of sliding; after a
sliding distance of some lengths (`ALIGNED`) friction opposes this velocity, although the bristle
may still lag behind it.

Smooth model: the force is −μ N v/√(v² + v₀²). It creeps under any load.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.algebra.vector import inner, plus, times
from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.model.forces.friction import BaseFriction

# Models of friction, and modes of a bristle (`forces.bristle`): OPEN, the sides do not touch; FREE,
# shorter than its limit; FULL, at its limit.
NO_FRICTION, BRISTLE, SMOOTH = 0, 1, 2
OPEN, FREE, FULL = 0.0, 1.0, 2.0

# Sliding begins where |T| exceeds μ N by this fraction of the normal force: more than the round-off
# of a contact that has just begun to stick or has been pushed back. A full bristle that is shorter
# than its limit by less than this relative amount stays full.
LEAST_EXCESS = 1e-9

_I, _F = "i8", "f8"
# Friction fields of a table row: static and dynamic coefficient, Stribeck speed v_s (m/s), viscous
# coefficient per speed v_v (s/m), k (N/m) and c (N s/m) of the bristle, creep speed v₀ (m/s) of the
# smooth model; `history`: index of the row's first internal variable.
_WORDS = ("static", "dynamic", "stribeck", "viscous", "k", "c", "creep")
FRICTION_FIELDS = (("model", _I), *((word, _F) for word in _WORDS), ("history", _I))


def friction_parameters(spec: BaseFriction | None) -> tuple[float, ...]:
    """Numbers of `FRICTION_FIELDS` without `history`, which is added later; None: no friction."""
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
    """μ(v) and dμ/dv, s/m."""
    x = v / f["stribeck"]
    more = (f["static"] - f["dynamic"]) * math.exp(-x * x)
    slope = f["viscous"] - 2.0 * x / f["stribeck"] * more
    return f["dynamic"] + more + f["viscous"] * v, slope


@kernel
def tangential_part(n, a):
    """The component of vector a in the tangent plane, whose unit normal is n."""
    return plus(a, -inner(n, a), n)


@kernel
def friction_force(f, n, N, g, s0, way, slid):
    """Force of friction on I, bristle s, |T| − μ N, k |z| − μ N, and `slid` at the end of the step.

    z = s0 + way is the bristle without its limit. For a bristle that was free, T in |T| − μ N is
    made with z, so that this is smooth where sliding begins.

    f: friction fields; n, N: normal and normal force; g: relative velocity; s0: bristle at the
    begin of the step; way: slip since then, m; slid: sliding distance of the full bristle over its
    length at the begin of the step, < 0 if it was free.
    """
    v = tangential_part(n, g)
    speed = math.sqrt(inner(v, v))
    mu, _ = friction_coefficient(f, speed)
    limit = mu * N
    if f["model"] == SMOOTH:
        w = -limit / math.sqrt(speed * speed + f["creep"] * f["creep"])
        return times(w, v), times(0.0, v), 0.0, 0.0, -1.0
    s0, way = tangential_part(n, s0), tangential_part(n, way)
    s, is_free = plus(s0, 1.0, way), slid < 0.0
    reach, _ = _direction(plus(times(f["k"], s), f["c"], v))
    overload, along = f["k"] * math.sqrt(inner(s, s)) - limit, 0.0
    if overload > (-LEAST_EXCESS * limit if slid >= 0.0 else 0.0):
        e, slid = _full_direction(s0, way, v, limit / f["k"], slid)
        along, s = inner(e, v), times(limit / f["k"], e)
    T = plus(times(f["k"], s), f["c"], v)
    size, d = _direction(T)
    if along > 0.0:
        share = _velocity_weight(slid) * (1.0 - (1.0 - (along / speed) ** 2) ** 4)
        _, d = _direction(plus(times(1.0 - share, d), share / speed, v))
        excess = reach - limit if is_free else limit * along / speed
        return times(-limit, d), s, excess, overload, slid
    excess = reach - limit if is_free else size - limit
    return times(-min(size, limit), d), s, excess, overload, slid


# Sliding distance, over the length of a full bristle, after which friction opposes the velocity
# alone: of an initial angle between bristle and velocity e⁻⁴, 2 %, is left then. If the angle ψ
# between both is nearly a right one, the velocity has less weight: 1 − sin⁸ ψ of it.
ALIGNED = 4.0


@kernel
def _velocity_weight(slid):
    """Weight of the velocity in the direction of friction, from 0 (bristle alone) to 1."""
    u = min(max(slid, 0.0) / ALIGNED, 1.0)
    return u * u * u * (10.0 - u * (15.0 - 6.0 * u))


@kernel
def _turning_weights(sigma, before, length):
    """Relative slip x and the weights a, b, c of three directions in that of a full bristle.

    x is the slip `sigma` of the step over the mean length of the bristle. a is the weight of the
    bristle's direction before the step. The velocity is taken to turn at a constant rate: b is the
    weight of its mean direction, which is that of the slip, and c that of its present direction.
    """
    x = 2.0 * sigma / (before + length)
    a = math.exp(-x)
    b = 2.0 * (1.0 - a * (1.0 + x)) / x
    return x, a, b, 1.0 - a - b


@kernel
def _follows_velocity(s0, way, v):
    """Whether a full bristle is dragged on, not pushed back, so that it turns with the velocity."""
    return inner(s0, way) >= 0.0 and inner(way, way) > 0.0 and inner(v, v) > 0.0


@kernel
def _direction(a):
    """Length and unit vector of a."""
    size = math.sqrt(inner(a, a))
    return size, times(1.0 / size, a) if size > 0.0 else a


@kernel
def _full_direction(s0, way, v, length, slid):
    """Direction of a full bristle of this length, and its sliding distance over its length.

    The bristle turns at the rate (velocity normal to it)/(its length L). So for a constant velocity
    at an angle ψ, tan ψ/2 falls by the factor e^(−x) over a slip x L. A bristle that has just
    become full, or that is pushed back, has the direction of s0 + way.
    """
    before, e0 = _direction(s0)
    if slid < 0.0 or not _follows_velocity(s0, way, v):
        return _direction(plus(s0, 1.0, way))[1], max(slid, 0.0)
    sigma, e1 = _direction(way)
    x, a, b, c = _turning_weights(sigma, before, length)
    _, e = _direction(plus(times(b, e1), c, _direction(v)[1]))
    if before > 0.0:
        e = plus(times((1.0 - a) * (1.0 + a + (1.0 - a) * inner(e0, e)), e), 2.0 * a, e0)
    return _direction(e)[1], slid + x


@kernel
def _tangential_part_change(n, a, dn, da):
    """Change of `tangential_part`(n, a) with n and a."""
    x = plus(da, -inner(dn, a) - inner(n, da), n)
    return plus(x, -inner(n, a), dn)


@kernel
def _direction_change(a, da):
    """Length and unit vector of a, and the change of the unit vector with a."""
    size, e = _direction(a)
    return size, e, times(1.0 / size, plus(da, -inner(e, da), e)) if size > 0.0 else da


@kernel
def _full_direction_change(s0, way, v, length, slid, ds0, dway, dv, dlength):
    """Results of `_full_direction`, each followed by its change with the arguments."""
    before, e0, de0 = _direction_change(s0, ds0)
    if slid < 0.0 or not _follows_velocity(s0, way, v):
        _, e, de = _direction_change(plus(s0, 1.0, way), plus(ds0, 1.0, dway))
        return e, de, max(slid, 0.0), 0.0
    sigma, e1, de1 = _direction_change(way, dway)
    _, e2, de2 = _direction_change(v, dv)
    x, a, b, c = _turning_weights(sigma, before, length)
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
    return e, de, slid + x, dx


@kernel
def friction_force_change(f, n, N, g, s0, way, slid, dn, dN, dg, ds0, dway):
    """Change of the force of `friction_force` with changes dn, dN, ... of its arguments."""
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
    cosine, dcosine, dturns, overload = 0.0, 0.0, 0.0, f["k"] * math.sqrt(inner(s, s)) - limit
    if overload > (-LEAST_EXCESS * limit if slid >= 0.0 else 0.0):
        s, ds, slid, dturns = _full_direction_change(
            s0, way, v, limit / f["k"], slid, ds0, dway, dv, dlimit / f["k"]
        )
        cosine = inner(s, v) / speed if speed > 0.0 else 0.0
        dcosine = inner(ds, v) + inner(s, dv) - cosine * dspeed
        dcosine = dcosine / speed if speed > 0.0 else 0.0
        s, ds = times(limit, s), plus(times(dlimit, s), limit, ds)
    else:
        s, ds = times(f["k"], s), times(f["k"], ds)
    size, d, dd = _direction_change(plus(s, f["c"], v), plus(ds, f["c"], dv))
    if cosine > 0.0:
        u = min(slid / ALIGNED, 1.0)
        across = 1.0 - cosine * cosine
        share = _velocity_weight(slid) * (1.0 - across**4)
        rise = 30.0 * (u * (1.0 - u)) ** 2 / ALIGNED * dturns
        dshare = rise * (1.0 - across**4)
        dshare += 8.0 * _velocity_weight(slid) * cosine * across**3 * dcosine
        _, e, de = _direction_change(v, dv)
        dd = plus(plus(times(1.0 - share, dd), share, de), dshare, plus(e, -1.0, d))
        _, d, dd = _direction_change(plus(times(1.0 - share, d), share, e), dd)
    elif size <= limit:
        return times(-1.0, plus(ds, f["c"], dv))
    return plus(times(-dlimit, d), -limit, dd)


@kernel
def line_friction(f, N, stretch, v, mode):
    """Friction on a line: force, bristle, |T| − μ N, k |z| − μ N, derivatives of −force.

    These are with respect to z, v and N. stretch: z, the bristle without its limit, m; v: velocity;
    mode: FREE, or ±FULL with the sign of the bristle.

    The normal force of a joint depends on its friction, so that here |T| = μ N alone decides on
    sliding. While a falling load releases the bristle (v opposite to it), its limit is therefore
    longer than μ N/k by c |v|/k.
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
    longest = limit + f["c"] * max(-side * v, 0.0)  # k times the limit of the bristle's length
    overload = side * f["k"] * stretch - longest
    is_full = overload > (-LEAST_EXCESS * limit if abs(mode) == FULL else 0.0)
    excess = abs(T) - limit
    if is_full:
        return (
            -side * limit, side * longest / f["k"], excess, overload, 0.0, side * rise, side * mu
        )  # fmt: skip
    if excess > 0.0:
        return -side * limit, stretch, excess, overload, 0.0, side * rise, side * mu
    return -T, stretch, excess, overload, f["k"], f["c"], 0.0
