"""The bristle of a contact with friction: an elastic spring s that the surface J carries.

It is stretched by the way that the surfaces slide past each other, up to k |s| = μ N: it is free
below, and full while it would be longer. A full one follows its limit until that grows faster than
the surfaces slide; then it is free again. While they slide on it turns with their velocity, by the
speed across it over its length.

The way of a step follows from places, so that it has the order of the method. With u' the place of
I in axes of J, n' the normal, r the radius of a ball I (0: a point) and ω' its angular velocity
relative to J, the surfaces slide by u̇' − r ω' × n'. Of the rotation since the step began φ' is the
vector, so that ω' = φ̇' + φ' × φ̇'/2 + ... With ω₀', n₀' and ṅ₀' at its begin the integral over a
step h is

    Δu' + ∫ n' dd − r ((φ' + h ω₀' × φ'/6) × n̄' + (φ' − h ω₀') × (n' − n₀')/6),

n̄' = n₀' + (n' − n₀')/3 + h ṅ₀'/6, where the depth d, whose part of u' goes along the normal, and n'
are parabolas in time: exact for points, and for a ball that turns about one axis on a plane; else
wrong by h⁴. In the plane of n it is wrong by h³ where that turns.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import (
    column,
    cross,
    inner,
    part,
    plus,
    put_part,
    tangent_coefficients,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.forces.contact_pair import normal_force, separation
from flexmb.engine.forces.friction import (
    ALIGNED,
    BRISTLE,
    FREE,
    FULL,
    LEAST_EXCESS,
    OPEN,
    friction_coefficient,
    tangential_part,
)
from flexmb.engine.jit import kernel

# It remembers its mode, and in axes of J itself (3), where I is (3), the normal (3) and its rate
# (3), depth and its rate, lengths that it slid while full; of a ball the axes of I (9) and how fast
# it turns (3) too.
POINT_HISTORY, BALL_HISTORY = 16, 28
_MODE, _BRISTLE, _PLACE, _NORMAL, _TILT, _DEPTH, _TURNS = 0, 1, 4, 7, 10, 13, 15
_AXES, _SPIN = 16, 25
_ZERO = (0.0, 0.0, 0.0)


@kernel
def is_open(c, history):
    """Whether there was no contact at the last accepted step, or it has no bristle."""
    return c["model"] != BRISTLE or history[c["bristle"] + _MODE] == OPEN


@kernel
def _axes_before(c, history, mj, k):
    """Column k of the axes of I at the last accepted step, as they stand on J now."""
    return turned(mj["R"], part(history, c["bristle"] + _AXES + 3 * k))


@kernel
def _rotation(c, history, mi, mj):
    """φ, the rotation of I relative to J since the last accepted step, global axes."""
    axis, trace = _ZERO, 0.0
    for k in range(3):
        before, now = _axes_before(c, history, mj, k), column(mi["R"], k)
        axis, trace = plus(axis, 0.5, cross(before, now)), trace + inner(before, now)
    sine = math.sqrt(inner(axis, axis))  # of its angle, the axis is as long
    return times(math.atan2(sine, 0.5 * (trace - 1.0)) / sine, axis) if sine > 0.0 else axis


@kernel
def _normal_before(c, history, mj):
    """n of the last accepted step as it stands on J now."""
    return turned(mj["R"], part(history, c["bristle"] + _NORMAL))


@kernel
def bristle_before(c, history, n, mj):
    """The bristle of the last accepted step, as it stands on J now, turned with the normal.

    And lengths that it had slid while full; < 0: it was free.
    """
    if is_open(c, history):
        return _ZERO, -1.0
    o = c["bristle"]
    s, n0 = turned(mj["R"], part(history, o + _BRISTLE)), _normal_before(c, history, mj)
    s = plus(s, -inner(n, s) / (1.0 + inner(n0, n)), plus(n0, 1.0, n))
    return s, history[o + _TURNS] if history[o + _MODE] == FULL else -1.0


@kernel
def bristle_change(c, history, n, mj, dn, turn):
    """Its change with the normal and a rotation of J."""
    if is_open(c, history):
        return _ZERO
    s = turned(mj["R"], part(history, c["bristle"] + _BRISTLE))
    n0 = _normal_before(c, history, mj)
    ds, dn0, both = cross(turn, s), cross(turn, n0), 1.0 + inner(n0, n)
    share = inner(n, s) / both
    change = (inner(dn, s) + inner(n, ds) - share * (inner(dn0, n) + inner(n0, dn))) / both
    ds = plus(ds, -change, plus(n0, 1.0, n))
    return plus(ds, -share, plus(dn0, 1.0, dn))


@kernel
def _place_before(c, history, mj):
    """u of the last accepted step as it stands on J now."""
    return turned(mj["R"], part(history, c["bristle"] + _PLACE))


@kernel
def _parabola(c, history, h, mj, n):
    """n₀, h ṅ₀ and n − n₀ − h ṅ₀, of the last accepted step as they stand on J now."""
    n0 = _normal_before(c, history, mj)
    tilt = times(h, turned(mj["R"], part(history, c["bristle"] + _TILT)))
    return n0, tilt, plus(plus(n, -1.0, n0), -1.0, tilt)


@kernel
def _spin_before(c, history, h, mj):
    """h ω₀ of the last accepted step as it stands on J now."""
    return times(h, turned(mj["R"], part(history, c["bristle"] + _SPIN)))


@kernel
def slip_since(c, history, h, n, d, mi, mj):
    """What the surfaces have slid since the last accepted step; nothing if they did not touch."""
    if is_open(c, history):
        return _ZERO
    o, (n0, tilt, bend) = c["bristle"], _parabola(c, history, h, mj, n)
    rise = h * history[o + _DEPTH + 1]
    rest = d - history[o + _DEPTH] - rise
    way = plus(separation(mi, mj), -1.0, _place_before(c, history, mj))
    way = plus(way, rise + rest, n0)  # and the rest of ∫ n dd
    way = plus(plus(way, rise / 2.0 + rest / 1.5, tilt), rise / 3.0 + rest / 2.0, bend)
    if c["ri"] > 0.0:
        phi, theta = _rotation(c, history, mi, mj), _spin_before(c, history, h, mj)
        mean = plus(plus(n0, 1.0 / 2.0, tilt), 1.0 / 3.0, bend)
        way = plus(way, -c["ri"], cross(plus(phi, 1.0 / 6.0, cross(theta, phi)), mean))
        way = plus(way, -c["ri"] / 6.0, cross(plus(phi, -1.0, theta), plus(tilt, 1.0, bend)))
    return way


@kernel
def slip_change(c, history, h, n, d, mi, mj, dn, dd, du, spin, turn):
    """Its change with normal, depth and separation, and rotations of I and of J."""
    if is_open(c, history):
        return _ZERO
    o, (n0, tilt, bend) = c["bristle"], _parabola(c, history, h, mj, n)
    dn0, dtilt = cross(turn, n0), cross(turn, tilt)
    dbend = plus(plus(dn, -1.0, dn0), -1.0, dtilt)
    rise = h * history[o + _DEPTH + 1]
    rest = d - history[o + _DEPTH] - rise
    change = plus(du, -1.0, cross(turn, _place_before(c, history, mj)))
    change = plus(plus(change, rise + rest, dn0), dd, n0)
    change = plus(plus(change, rise / 2.0 + rest / 1.5, dtilt), dd / 1.5, tilt)
    change = plus(plus(change, rise / 3.0 + rest / 2.0, dbend), dd / 2.0, bend)
    if c["ri"] > 0.0:
        phi, theta = _rotation(c, history, mi, mj), _spin_before(c, history, h, mj)
        dphi = plus(cross(turn, phi), 1.0, _vector_change(phi, plus(spin, -1.0, turn)))
        dtheta = cross(turn, theta)
        mean = plus(plus(n0, 1.0 / 2.0, tilt), 1.0 / 3.0, bend)
        dmean = plus(plus(dn0, 1.0 / 2.0, dtilt), 1.0 / 3.0, dbend)
        x = plus(phi, 1.0 / 6.0, cross(theta, phi))
        dx = plus(dphi, 1.0 / 6.0, plus(cross(dtheta, phi), 1.0, cross(theta, dphi)))
        change = plus(change, -c["ri"], plus(cross(dx, mean), 1.0, cross(x, dmean)))
        y, dy = plus(phi, -1.0, theta), plus(dphi, -1.0, dtheta)
        step, dstep = plus(tilt, 1.0, bend), plus(dtilt, 1.0, dbend)
        change = plus(change, -c["ri"] / 6.0, plus(cross(dy, step), 1.0, cross(y, dstep)))
    return change


@kernel
def _vector_change(phi, spin):
    """Change of a rotation vector φ with a rotation that follows: T(φ)⁻¹ of it.

    x − φ × x/2 + κ φ × (φ × x), κ = (1 − (sin θ/θ) / (2 (1 − cos θ)/θ²))/θ².
    """
    square = inner(phi, phi)
    c1, c2, _, _ = tangent_coefficients(square)
    y = cross(phi, spin)
    # 1 − s/(2 c1) with s = sin θ/θ = 1 − c2 θ², c1 = (1 − cos θ)/θ²; below 0.1 rad by its series
    kappa = 1.0 / 12.0 + square / 720.0 if square < 1e-4 else (
        (1.0 - 0.5 * (1.0 - c2 * square) / c1) / square
    )  # fmt: skip
    return plus(plus(spin, -0.5, y), kappa, cross(phi, y))


@kernel
def limit_growth(c, history, n, d, g, tilt, acceleration):
    """The speed at which the limit μ N/k of its length grows, m/s.

    `tilt`: rate of the normal; `acceleration`: that of g.
    """
    N, stiff, viscous = normal_force(c, history, d, -inner(n, g))
    v, change = tangential_part(n, g), plus(acceleration, -inner(n, g), tilt)
    change = tangential_part(n, change)
    speed = math.sqrt(inner(v, v))
    mu, slope = friction_coefficient(c, speed)
    more = inner(v, change) / speed if speed > 0.0 else math.sqrt(inner(change, change))
    rise = -stiff * inner(n, g) - viscous * (inner(n, acceleration) + inner(tilt, g))
    return (mu * rise + slope * more * N) / c["k"]


@kernel
def put_bristle_event(c, history, n, d, g, s, room, tilt, acceleration, out):
    """What crosses zero where the bristle becomes full or free; `room`: k |s| − μ N if it is free.

    s: the bristle; `tilt`: rate of the normal; `acceleration`: that of g.
    """
    out["value"], out["rate"] = 0.0, math.nan
    if history[c["bristle"] + _MODE] == FULL:
        v = tangential_part(n, g)
        along = s if inner(s, s) > 0.0 else v
        slides = inner(along, v) / math.sqrt(inner(along, along)) if inner(v, v) > 0.0 else 0.0
        out["value"] = limit_growth(c, history, n, d, g, tilt, acceleration) - slides
    elif not is_open(c, history):
        N, _, _ = normal_force(c, history, d, -inner(n, g))
        out["value"] = room - LEAST_EXCESS * N


@kernel
def remember_bristle(c, before, n, d, g, s, room, turns, mi, mj, tilt, acceleration, history):
    """Write the history of the bristle s at an accepted state; `before` is that of the step.

    One that begins, with no length yet, is full where the surfaces slide faster than it may grow.
    """
    o = c["bristle"]
    mode = OPEN if d <= 0.0 else FREE
    begins = is_open(c, before)
    if d > 0.0 and (room >= 0.0 or begins):
        v = tangential_part(n, g)
        along = v if begins else s
        size = math.sqrt(inner(along, along))
        growth = limit_growth(c, history, n, d, g, tilt, acceleration)
        mode = FULL if size > 0.0 and inner(along, v) > growth * size else FREE
    history[o + _MODE] = mode
    history[o + _TURNS] = ALIGNED if begins else turns
    put_part(history, o + _BRISTLE, turned_back(mj["R"], s) if d > 0.0 else _ZERO)
    put_part(history, o + _PLACE, turned_back(mj["R"], separation(mi, mj)))
    put_part(history, o + _NORMAL, turned_back(mj["R"], n))
    om = triple(mj["om"])
    put_part(history, o + _TILT, turned_back(mj["R"], plus(tilt, -1.0, cross(om, n))))
    history[o + _DEPTH], history[o + _DEPTH + 1] = d, -inner(n, g)
    if c["ri"] > 0.0:
        for k in range(3):
            put_part(history, o + _AXES + 3 * k, turned_back(mj["R"], column(mi["R"], k)))
        put_part(history, o + _SPIN, turned_back(mj["R"], plus(triple(mi["om"]), -1.0, om)))
