"""The bristle of a contact with friction: an elastic spring with deflection s, moving with body J.

Sliding stretches the bristle until k |s| = μ N. Below this limit the bristle is free. At the limit
it is full: sliding does not stretch it further, and its length stays μ N/k. It becomes free again
when the limit grows faster than the surfaces slide. A full bristle turns towards the sliding
velocity, at the rate (component of the velocity normal to the bristle)/(length of the bristle).

The slip of a step, the tangential displacement of I relative to J at the contact, is computed from
positions, so that it has the order of the integration method. A prime denotes components in the
axes of J. With u' the position of I relative to J, n' the normal, r the radius of a ball I (0: a
point) and ω' the angular velocity of I relative to J, the sliding velocity is the tangential part
of u̇' − r ω' × n'. With φ' the rotation vector since the step began, ω' = φ̇' + φ' × φ̇'/2 + ...
With ω₀', n₀' and ṅ₀' at the begin of the step, its integral over a step h is

    Δu' + ∫ n' dd − r ((φ' + h ω₀' × φ'/6) × n̄' + (φ' − h ω₀') × (n' − n₀')/6),

n̄' = n₀' + (n' − n₀')/3 + h ṅ₀'/6. The integral over the depth d removes the normal part of Δu';
d and n' are parabolas in time. The result is exact for points, and for a ball that turns about one
axis on a plane; otherwise its error is O(h⁴). Its projection on the tangent plane at the end of the
step has an error O(h³) if the normal turns.
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

# Number of internal variables of a bristle, at the last accepted step: mode (OPEN, FREE or FULL);
# in axes of J the bristle s (3), u (3), the normal (3) and its rate relative to J (3); depth and
# its rate; sliding distance since it became full, over its length. For a ball also the axes of I
# (9) and its angular velocity relative to J (3), in axes of J. Below: the index of each.
POINT_HISTORY, BALL_HISTORY = 16, 28
_MODE, _BRISTLE, _PLACE, _NORMAL, _TILT, _DEPTH, _SLID = 0, 1, 4, 7, 10, 13, 15
_AXES, _SPIN = 16, 25
_ZERO = (0.0, 0.0, 0.0)


@kernel
def is_open(c, history):
    """Whether the contact was open at the last accepted step, or has no bristle."""
    return c["model"] != BRISTLE or history[c["bristle"] + _MODE] == OPEN


@kernel
def _axes_before(c, history, mj, k):
    """Column k of the axes of I at the last accepted step, turned with J since then."""
    return turned(mj["R"], part(history, c["bristle"] + _AXES + 3 * k))


@kernel
def _rotation(c, history, mi, mj):
    """φ, the rotation of I relative to J since the last accepted step, global axes."""
    axis, trace = _ZERO, 0.0
    for k in range(3):
        before, now = _axes_before(c, history, mj, k), column(mi["R"], k)
        axis, trace = plus(axis, 0.5, cross(before, now)), trace + inner(before, now)
    sine = math.sqrt(inner(axis, axis))  # of the angle of rotation: the length of `axis`
    return times(math.atan2(sine, 0.5 * (trace - 1.0)) / sine, axis) if sine > 0.0 else axis


@kernel
def _normal_before(c, history, mj):
    """Normal n of the last accepted step, turned with J since then."""
    return turned(mj["R"], part(history, c["bristle"] + _NORMAL))


@kernel
def bristle_before(c, history, n, mj):
    """Bristle of the last accepted step, turned with J and then into the present tangent plane.

    And its sliding distance since it became full, over its length; −1 if it was free.
    """
    if is_open(c, history):
        return _ZERO, -1.0
    o = c["bristle"]
    s, n0 = turned(mj["R"], part(history, o + _BRISTLE)), _normal_before(c, history, mj)
    s = plus(s, -inner(n, s) / (1.0 + inner(n0, n)), plus(n0, 1.0, n))
    return s, history[o + _SLID] if history[o + _MODE] == FULL else -1.0


@kernel
def bristle_change(c, history, n, mj, dn, turn):
    """Change of `bristle_before` with the normal by dn and a rotation `turn` of J."""
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
    """u = x_I − x_J of the last accepted step, turned with J since then."""
    return turned(mj["R"], part(history, c["bristle"] + _PLACE))


@kernel
def _normal_parabola(c, history, h, mj, n):
    """Coefficients n₀, h ṅ₀ and n − n₀ − h ṅ₀ of the normal over the step, a parabola in time.

    n₀ and ṅ₀ (relative to J) are those of the last accepted step, turned with J since then.
    """
    n0 = _normal_before(c, history, mj)
    tilt = times(h, turned(mj["R"], part(history, c["bristle"] + _TILT)))
    return n0, tilt, plus(plus(n, -1.0, n0), -1.0, tilt)


@kernel
def _spin_before(c, history, h, mj):
    """h ω₀, ω₀ relative to J at the last accepted step, turned with J since then."""
    return times(h, turned(mj["R"], part(history, c["bristle"] + _SPIN)))


@kernel
def slip_since(c, history, h, n, d, mi, mj):
    """Slip since the last accepted step, m, global axes; zero if the contact was open then."""
    if is_open(c, history):
        return _ZERO
    o, (n0, tilt, bend) = c["bristle"], _normal_parabola(c, history, h, mj, n)
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
    """Change of `slip_since` with changes dn, dd, du, and rotations of I (spin) and J (turn)."""
    if is_open(c, history):
        return _ZERO
    o, (n0, tilt, bend) = c["bristle"], _normal_parabola(c, history, h, mj, n)
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
    """Change of a rotation vector φ when a small rotation x (`spin`) follows it: T(φ)⁻¹ x.

    T(φ)⁻¹ x = x − φ × x/2 + κ φ × (φ × x), κ = (1 − (sin θ/θ) / (2 (1 − cos θ)/θ²))/θ², θ = |φ|.
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
    """Rate at which the limit μ N/k of the bristle's length grows, m/s.

    `g`: relative velocity; `tilt`: rate of the normal; `acceleration`: rate of g.
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
def put_bristle_event(c, history, n, d, g, s, overload, tilt, acceleration, out):
    """Event function that crosses zero where a free bristle becomes full, or a full one free.

    s: bristle; `overload`: k |s| − μ N for s without its limit, N; `tilt`: rate of the
    normal; `acceleration`: rate of g.
    """
    out["value"], out["rate"] = 0.0, math.nan
    if history[c["bristle"] + _MODE] == FULL:
        v = tangential_part(n, g)
        along = s if inner(s, s) > 0.0 else v
        slides = inner(along, v) / math.sqrt(inner(along, along)) if inner(v, v) > 0.0 else 0.0
        out["value"] = limit_growth(c, history, n, d, g, tilt, acceleration) - slides
    elif not is_open(c, history):
        N, _, _ = normal_force(c, history, d, -inner(n, g))
        out["value"] = overload - LEAST_EXCESS * N


@kernel
def store_bristle(c, before, n, d, g, s, overload, slid, mi, mj, tilt, acceleration, history):
    """Write the internal variables at an accepted state; `before` holds those of the step's begin.

    A bristle that begins has no length yet. It is full if the surfaces slide faster than its limit
    grows.
    """
    o = c["bristle"]
    mode = OPEN if d <= 0.0 else FREE
    begins = is_open(c, before)
    if d > 0.0 and (overload >= 0.0 or begins):
        v = tangential_part(n, g)
        along = v if begins else s
        size = math.sqrt(inner(along, along))
        growth = limit_growth(c, history, n, d, g, tilt, acceleration)
        mode = FULL if size > 0.0 and inner(along, v) > growth * size else FREE
    history[o + _MODE] = mode
    history[o + _SLID] = ALIGNED if begins else slid
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
