"""Relative motion of two markers in the axes of marker I: six measures, rates and derivatives.

With h = x_J − x_I, the measures are the separation u = R_Iᵀ h and the rotation vector φ of
R_Iᵀ R_J = exp(φ̃), |φ| < π. A common rigid motion of both markers does not change them, so forces
that depend on them are objective. φ̇ = G(φ) ω with ω = R_Iᵀ (ω_J − ω_I) and G = I − ½ φ̃ + e φ̃²,
e = (1 − (φ/2) cot(φ/2))/φ² (the inverse of the tangent operator of the exponential map; Géradin &
Cardona, Flexible Multibody Dynamics, 2001, ch. 4).

The gradient E (6, 12) of x = (u, φ) gives ẋ = E (v_I, ω_I, v_J, ω_J), velocities in global axes:
u̇_r = a_r·(v_J − v_I − ω_I × h), a_r the axes of I, and φ̇ = G R_Iᵀ (ω_J − ω_I). Forces p conjugate
to x are the wrench pair −Eᵀ p on the two markers, as for constraint rows with multipliers p.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import (
    add_column,
    add_part,
    add_skew,
    column,
    cross,
    inner,
    part,
    plus,
    put_part,
    triple,
    turned,
    turned_back,
    zero,
)
from flexmb.engine.algebra.vector import axis_vector as axis
from flexmb.engine.jit import Matrix, Vector, kernel, unit
from flexmb.engine.joints.point_joint import dot2_gradient, dot2_tangent
from flexmb.engine.joints.row import dot_columns, separation
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Run

# Below this φ² the series of e in φ² has a remainder below round-off; above it the closed form of
# de/d(φ²) loses no more than three digits by cancellation.
_SERIES = 0.5


class RelativeMotion(NamedTuple):
    """Scratch of one pair of markers: relative motion, forces and derivatives."""

    x: Vector  # (6,) separation and rotation vector of J relative to I, axes of I
    rate: Vector  # (6,) ẋ, if there is damping
    elastic: Vector  # (6,) part of p that depends on x
    viscous: Vector  # (6,) part of p that depends on ẋ
    p: Vector  # (6,) force conjugate to x: elastic + viscous
    e: Vector  # (2,) e and de/d(φ²)
    Q: Matrix  # (3, 3) R_Iᵀ R_J, the axes of J in those of I
    S: Matrix  # (3, 3) ∂(G v)/∂φ or ∂(Gᵀ v)/∂φ
    E: Matrix  # (6, 12) gradient of x
    D: Matrix  # (6, 12) ∂ẋ/∂(position of the markers)


def new_relative_motion() -> RelativeMotion:
    """Scratch filled with NaN."""
    shapes = *((6,) for _ in range(5)), (2,), (3, 3), (3, 3), (6, 12), (6, 12)
    return RelativeMotion(*(np.full(shape, np.nan) for shape in shapes))


@unit
def put_relative_motion(run: Run, i: int, j: int, s: RelativeMotion) -> int:
    """Put Q, x and e of markers i and j into s."""
    mi, mj = run.work.now.marker[i], run.work.now.marker[j]
    R = mi["R"]
    for r in range(3):
        for c in range(3):
            s.Q[r, c] = dot_columns(R, r, mj["R"], c)
    put_part(s.x, 0, turned_back(R, separation(mi, mj)))
    phi = rotation_vector(s.Q)
    put_part(s.x, 3, phi)
    s.e[0], s.e[1] = inverse_coefficient(inner(phi, phi))
    return SUCCESS


@unit
def put_rates(run: Run, i: int, j: int, s: RelativeMotion) -> int:
    """Put ẋ into s, after a velocity stage and `put_relative_motion`."""
    mi, mj = run.work.now.marker[i], run.work.now.marker[j]
    R, h, om = mi["R"], separation(mi, mj), triple(mi["om"])
    u = plus(plus(triple(mj["vx"]), -1.0, triple(mi["vx"])), -1.0, cross(om, h))
    spin = plus(triple(mj["om"]), -1.0, om)
    put_part(s.rate, 0, turned_back(R, u))
    put_part(s.rate, 3, _rotation_rate(s, 1.0, turned_back(R, spin)))
    return SUCCESS


@kernel
def _rotation_rate(s, sign, a):
    """G(φ) a, or for sign −1 Gᵀ a."""
    phi = part(s.x, 3)
    u = cross(phi, a)
    return plus(plus(a, -0.5 * sign, u), s.e[0], cross(phi, u))


@kernel
def add_wrenches(mi, mj, s, wi, wj):
    """Add the wrench pair −Eᵀ p to wi and wj (6 each); both forces act at the place of marker J."""
    R = mi["R"]
    force, moment = turned(R, part(s.p, 0)), turned(R, _rotation_rate(s, -1.0, part(s.p, 3)))
    add_part(wi, 0, 1.0, force)
    add_part(wi, 3, 1.0, plus(moment, 1.0, cross(separation(mi, mj), force)))
    add_part(wj, 0, -1.0, force)
    add_part(wj, 3, -1.0, moment)


@unit
def put_wrench_pair(run: Run, i: int, j: int, s: RelativeMotion) -> int:
    """dense.g[1] = −Eᵀ p."""
    w, markers = run.work.dense.g[1], run.work.now.marker
    zero(w)
    add_wrenches(markers[i], markers[j], s, w[0:6], w[6:12])
    return SUCCESS


@kernel
def rotation_vector(Q):
    """φ of Q = exp(φ̃), |φ| ≤ π, by the largest of four Euler parameters (Shepperd 1978)."""
    trace, most = Q[0, 0] + Q[1, 1] + Q[2, 2], max(Q[0, 0], Q[1, 1], Q[2, 2])
    if trace >= most:
        w = 0.5 * math.sqrt(1.0 + trace)
        n = 0.25 / w
        x, y, z = n * (Q[2, 1] - Q[1, 2]), n * (Q[0, 2] - Q[2, 0]), n * (Q[1, 0] - Q[0, 1])
    else:
        i = 0 if Q[0, 0] == most else 1 if Q[1, 1] == most else 2
        j, k = (i + 1) % 3, (i + 2) % 3
        a = 0.5 * math.sqrt(1.0 + most - Q[j, j] - Q[k, k])
        n = 0.25 / a
        w, b, c = n * (Q[k, j] - Q[j, k]), n * (Q[i, j] + Q[j, i]), n * (Q[i, k] + Q[k, i])
        x, y, z = (a, b, c) if i == 0 else (c, a, b) if i == 1 else (b, c, a)
    sine = math.sqrt(x * x + y * y + z * z)
    f = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 0.0 else 2.0
    if w < 0.0:
        f = -f
    return f * x, f * y, f * z


@kernel
def inverse_coefficient(x):
    """e and de/dx for x = φ². Coefficients of the series: |B_2n|/(2n)!, B the Bernoulli numbers."""
    if x < _SERIES:
        e = x * (1.0 / 74724249600.0 + x * 3617.0 / 10670622842880000.0)
        e = x * (1.0 / 1209600.0 + x * (1.0 / 47900160.0 + x * 691.0 / 1307674368000.0 + x * e))
        e = 1.0 / 12.0 + x * (1.0 / 720.0 + x * (1.0 / 30240.0 + e))
        d = x * (6.0 / 74724249600.0 + x * 7.0 * 3617.0 / 10670622842880000.0)
        d = x * (3.0 / 1209600.0 + x * (4.0 / 47900160.0 + x * (5.0 * 691.0 / 1307674368000.0 + d)))
        return e, 1.0 / 720.0 + x * (2.0 / 30240.0 + d)
    angle = math.sqrt(x)
    s, c = math.sin(0.5 * angle), math.cos(0.5 * angle)
    e = 1.0 / x - 0.5 * c / (s * angle)
    return e, (0.125 / (s * s) + 0.25 * c / (s * angle) - 1.0 / x) / x


@kernel
def _put_slope(s, sign, v):
    """S = ∂(G v)/∂φ at constant v, or for sign −1 ∂(Gᵀ v)/∂φ."""
    phi, S = part(s.x, 3), s.S
    along, square = inner(phi, v), inner(phi, phi)
    for r in range(3):
        for c in range(3):
            x = phi[r] * v[c] - 2.0 * v[r] * phi[c] + (along if r == c else 0.0)
            S[r, c] = s.e[0] * x + 2.0 * s.e[1] * (phi[r] * along - square * v[r]) * phi[c]
    add_skew(S, 0, 0, 0.5 * sign, v)


@unit
def put_gradient(run: Run, i: int, j: int, s: RelativeMotion) -> int:
    """Put the gradient E into s, after `put_relative_motion`."""
    R, g, E = run.work.now.marker[i]["R"], run.work.row.g, s.E
    for r in range(3):
        dot2_gradient(run.work.row, r, 0, i, j)
        for c in range(12):
            E[r, c], E[3 + r, c] = g[c], 0.0
    for c in range(3):
        x = _rotation_rate(s, 1.0, part(R[c], 0))
        add_column(E, 3, 3 + c, -1.0, x)
        add_column(E, 3, 9 + c, 1.0, x)
    return SUCCESS


@unit
def put_rate_change(run: Run, i: int, j: int, s: RelativeMotion) -> int:
    """Put D into s: ∂ẋ/∂(position of the markers) at constant velocities of the markers."""
    mi, mj, E, D, S = run.work.now.marker[i], run.work.now.marker[j], s.E, s.D, s.S
    Ri, om = mi["R"], triple(mi["om"])
    spin = plus(triple(mj["om"]), -1.0, om)
    u = plus(plus(triple(mj["vx"]), -1.0, triple(mi["vx"])), -1.0, cross(om, separation(mi, mj)))
    _put_slope(
        s, 1.0, (inner(column(Ri, 0), spin), inner(column(Ri, 1), spin), inner(column(Ri, 2), spin))
    )
    for r in range(6):
        for c in range(12):
            D[r, c] = 0.0
    for k in range(3):
        a = column(Ri, k)
        turn, arm = cross(om, a), cross(a, u)
        add_part(D[k], 0, -1.0, turn)
        add_part(D[k], 3, 1.0, arm)
        add_part(D[k], 6, 1.0, turn)
        x = turned(S, (E[3, 9 + k], E[4, 9 + k], E[5, 9 + k]))
        turn = _rotation_rate(s, 1.0, turned_back(Ri, cross(spin, axis(k))))
        add_column(D, 3, 3 + k, 1.0, plus(turn, -1.0, x))
        add_column(D, 3, 9 + k, 1.0, x)
    return SUCCESS


@unit
def put_geometric_tangent(run: Run, i: int, j: int, s: RelativeMotion, cp: float) -> int:
    """Geometric tangent: dense.H = cp ∂(Eᵀ p)/∂position at constant p, and dense.g[1] = Eᵀ p."""
    R, E, p, S, H = run.work.now.marker[i]["R"], s.E, s.p, s.S, run.work.dense.H
    w = run.work.dense.g[1]
    put_wrench_pair(run, i, j, s)
    for r in range(12):
        w[r] = -w[r]
        for c in range(12):
            H[r, c] = 0.0
    for r in range(3):
        dot2_tangent(run.work.row, r, 0, i, j, cp * p[r])
    # the moment R_I Gᵀ p[3:] turns with I and changes with φ
    _put_slope(s, -1.0, (p[3], p[4], p[5]))
    moment = part(w, 9)
    add_skew(H, 3, 3, cp, moment)
    add_skew(H, 9, 3, -cp, moment)
    for a in range(3):
        for b in range(3):
            x = 0.0
            for r in range(3):
                for k in range(3):
                    x += cp * R[a, r] * S[r, k] * E[3 + k, 9 + b]
            H[3 + a, 3 + b] += x
            H[3 + a, 9 + b] -= x
            H[9 + a, 3 + b] -= x
            H[9 + a, 9 + b] += x
    return SUCCESS
