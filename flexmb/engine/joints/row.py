"""Constraint rows: calls of their functions, and the rows that measure axes and lines.

With h = x_J − x_I, a = column a of R_I and b = column b of R_J; in the last two a = z_I, b = z_J:

    DOT1      a·b                 cosine of the angle of two axes: they stay perpendicular for 0
    ANGLE     atan2(y_I·b, x_I·b) angle of b about z_I from x_I, within ±π
    TWIST     x_I·y_J − y_I·x_J   twist about the bisector of z_I and z_J: zero for two shafts that
                                  turn with equal speed whatever their angle
    RADIAL    |h − (a·h) a|       distance of the point J from the line along a through I
    MOMENT    h·(a × b)           mutual moment: distance of the lines times the sine of their angle

What a row is, H (12, 12), and what its functions do: `engine.kind.RowKind`. Sources: Haug,
Computer Aided Kinematics and Dynamics, 1989, ch. 9; of the homokinetic condition Shabana, Dynamics
of Multibody Systems, ch. 3; of the mutual moment Selig, Geometric Fundamentals of Robotics, ch. 6.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.vector import (
    add_column,
    add_skew,
    add_skew_product,
    axis_vector,
    column,
    cross,
    inner,
    plus,
    put_part,
    times,
    triple,
    zero,
)
from flexmb.engine.jit import Matrix, call_row, call_row_tangent, call_row_value, kernel, unit
from flexmb.engine.kind import RowKind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import RowWork

# `row` below is a constraint row, or a term of a sensor that measures the same quantity.


@kernel
def row_value(run, row):
    """Value of the quantity that a row measures."""
    unit = run.rows.value[row["kind"]]
    return call_row_value(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def put_row_gradient(run, row):
    """Put the gradient of a row (12) into RowWork.g."""
    unit = run.rows.gradient[row["kind"]]
    call_row(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def row_curvature(run, row):
    """Second time derivative of the measured quantity at zero accelerations of both markers."""
    unit = run.rows.curvature[row["kind"]]
    return call_row_value(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def add_row_tangent(run, row, f):
    """Add f times the tangent of a row to RowWork.H; return 1, or 0 if its gradient is constant."""
    kind = row["kind"]
    if run.rows.curved[kind] == 0:
        return 0
    unit = run.rows.tangent[kind]
    call_row_tangent(unit, run.work.row, row["a"], row["b"], row["I"], row["J"], f)
    return 1


@kernel
def rate(g, mi, mj):
    """Rate g·(v_I, ω_I, v_J, ω_J) from the gradient g (12)."""
    r = 0.0
    for k in range(3):
        r += g[k] * mi["vx"][k] + g[3 + k] * mi["om"][k]
        r += g[6 + k] * mj["vx"][k] + g[9 + k] * mj["om"][k]
    return r


@kernel
def dot_columns(R, a, S, b):
    """Column a of R times column b of S."""
    return R[0, a] * S[0, b] + R[1, a] * S[1, b] + R[2, a] * S[2, b]


@kernel
def separation(mi, mj):
    """h = x_J − x_I."""
    a, b = mi["x"], mj["x"]
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


@kernel
def relative_velocity(mi, mj):
    """Rate of h."""
    a, b = mi["vx"], mj["vx"]
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


@kernel
def put_pair(g, o, a):
    """g (12) = 0 except g[o + 6 :] = a for marker J and g[o :] = −a for I, three numbers each."""
    zero(g)
    put_part(g, o, times(-1.0, a))
    put_part(g, o + 6, a)


@kernel
def vector_rates(a, om):
    """First derivative of a vector fixed to a marker, and second at zero angular acceleration."""
    first = cross(triple(om), a)
    return first, cross(triple(om), first)


@kernel
def dot_rates(a, omi, b, omj):
    """a·b: first derivative, and second at zero angular accelerations."""
    a1, a2 = vector_rates(a, omi)
    b1, b2 = vector_rates(b, omj)
    return inner(a1, b) + inner(a, b1), inner(a2, b) + inner(a, b2) + 2.0 * inner(a1, b1)


@unit
def add_dot(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, f: float, H: Matrix
) -> int:
    """Add f times the tangent of a·b to H, for axes a of marker I and b of marker J."""
    a, b = (ax, ay, az), (bx, by, bz)
    add_skew_product(H, 3, 3, f, b, a)
    add_skew_product(H, 3, 9, -f, a, b)
    add_skew_product(H, 9, 9, f, a, b)
    add_skew_product(H, 9, 3, -f, b, a)
    return SUCCESS


@kernel
def add_dot2(a, h, f, H):
    """Add f times the tangent of a·h to H, for an axis a of marker I."""
    add_skew(H, 0, 3, f, a)
    add_skew(H, 6, 3, -f, a)
    add_skew_product(H, 3, 3, f, h, a)
    add_skew(H, 3, 6, f, a)
    add_skew(H, 3, 0, -f, a)


@kernel
def subtract_square(g, f, H):
    """H −= f g gᵀ."""
    for k in range(12):
        for m in range(12):
            H[k, m] -= f * g[k] * g[m]


@kernel
def add_distance(f, H):
    """Add f (I, −I; −I, I) to the blocks of H for the positions of both markers."""
    for k in range(3):
        H[k, k] += f
        H[6 + k, 6 + k] += f
        H[k, 6 + k] -= f
        H[6 + k, k] -= f


_X, _Y = 0, 1


@unit
def dot1_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """a·b."""
    return dot_columns(at.marker[i]["R"], a, at.marker[j]["R"], b)  # type: ignore[no-any-return]


@unit
def dot1_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of a·b."""
    put_pair(at.g, 3, cross(column(at.marker[j]["R"], b), column(at.marker[i]["R"], a)))
    return SUCCESS


@unit
def dot1_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second time derivative of a·b."""
    mi, mj = at.marker[i], at.marker[j]
    _, second = dot_rates(column(mi["R"], a), mi["om"], column(mj["R"], b), mj["om"])
    return second  # type: ignore[no-any-return]


@unit
def dot1_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of a·b."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    add_dot(Ri[0, a], Ri[1, a], Ri[2, a], Rj[0, b], Rj[1, b], Rj[2, b], f, at.H)
    return SUCCESS


DOT1 = RowKind(
    "axes {a} and {b}", dot1_value, dot1_gradient, dot1_curvature, dot1_tangent, angular=True
)


@unit
def angle_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Angle θ of b about z_I from x_I, within ±π."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    return math.atan2(dot_columns(Ri, _Y, Rj, b), dot_columns(Ri, _X, Rj, b))


@kernel
def _across_and_along(Ri, Rj, b):
    """Vectors u and v normal and parallel to the projection of b on the plane x, y of I.

    Their lengths are 1/(length of the projection). With u and v fixed to I, θ̇ is the rate of u·b,
    and the rate of v·b is the relative rate of the length of the projection.
    """
    s, c = dot_columns(Ri, _Y, Rj, b), dot_columns(Ri, _X, Rj, b)
    n = 1.0 / (s * s + c * c)
    x, y = column(Ri, _X), column(Ri, _Y)
    return plus(times(n * c, y), -n * s, x), plus(times(n * c, x), n * s, y)


@unit
def angle_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of θ, b × u."""
    Rj = at.marker[j]["R"]
    u, _ = _across_and_along(at.marker[i]["R"], Rj, b)
    put_pair(at.g, 3, cross(column(Rj, b), u))
    return SUCCESS


@unit
def angle_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second time derivative of θ: (u·b)¨ − 2 (u·b)˙ (v·b)˙, with u and v fixed to I."""
    mi, mj = at.marker[i], at.marker[j]
    axis, p, q = column(mj["R"], b), triple(mi["om"]), triple(mj["om"])
    u, v = _across_and_along(mi["R"], mj["R"], b)
    first, second = dot_rates(u, p, axis, q)
    growth = inner(plus(q, -1.0, p), cross(axis, v))
    return second - 2.0 * first * growth  # type: ignore[no-any-return]


@unit
def angle_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """Add f times the tangent of θ: that of u·b with u fixed to I, less that of changes of u."""
    g, H, Rj = at.g, at.H, at.marker[j]["R"]
    axis = column(Rj, b)
    u, v = _across_and_along(at.marker[i]["R"], Rj, b)
    add_dot(u[0], u[1], u[2], axis[0], axis[1], axis[2], f, H)
    put_part(g, 0, cross(axis, u))
    put_part(g, 3, cross(axis, v))
    for k in range(3):
        for m in range(3):
            e = f * (g[k] * g[3 + m] + g[3 + k] * g[m])
            H[3 + k, 3 + m] -= e
            H[3 + k, 9 + m] += e
            H[9 + k, 3 + m] += e
            H[9 + k, 9 + m] -= e
    return SUCCESS


ANGLE = RowKind(
    "angle", angle_value, angle_gradient, angle_curvature, angle_tangent,
    angular=True, period=2.0 * math.pi,
)  # fmt: skip


@unit
def twist_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """x_I·y_J − y_I·x_J."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    return dot_columns(Ri, _X, Rj, _Y) - dot_columns(Ri, _Y, Rj, _X)  # type: ignore[no-any-return]


@unit
def twist_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of x_I·y_J − y_I·x_J."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    first = cross(column(Ri, _Y), column(Rj, _X))
    put_pair(at.g, 3, plus(first, -1.0, cross(column(Ri, _X), column(Rj, _Y))))
    return SUCCESS


@unit
def twist_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second time derivative of x_I·y_J − y_I·x_J."""
    mi, mj = at.marker[i], at.marker[j]
    R, S = mi["R"], mj["R"]
    _, first = dot_rates(column(R, _X), mi["om"], column(S, _Y), mj["om"])
    _, second = dot_rates(column(R, _Y), mi["om"], column(S, _X), mj["om"])
    return first - second  # type: ignore[no-any-return]


@unit
def twist_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of x_I·y_J − y_I·x_J."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    for k in range(2):
        m, sign = 1 - k, 1.0 - 2.0 * k
        add_dot(Ri[0, k], Ri[1, k], Ri[2, k], Rj[0, m], Rj[1, m], Rj[2, m], sign * f, at.H)
    return SUCCESS


TWIST = RowKind("twist", twist_value, twist_gradient, twist_curvature, twist_tangent, angular=True)


_Z = 2


@kernel
def _across(mi, mj):
    """h, its component vector normal to a = z_I, and its component along a."""
    a, h = column(mi["R"], _Z), separation(mi, mj)
    s = inner(a, h)
    return h, plus(h, -s, a), s


@unit
def radial_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Distance of J from the line through I."""
    _, p, _ = _across(at.marker[i], at.marker[j])
    return math.sqrt(inner(p, p))


@kernel
def _put_radial_gradient(mi, mj, g):
    """Put the gradient of the distance into g (12)."""
    _, p, s = _across(mi, mj)
    n = times(1.0 / np.sqrt(inner(p, p)), p)
    put_pair(g, 0, n)
    put_part(g, 3, times(-s, cross(column(mi["R"], _Z), n)))


@unit
def radial_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of the distance; not finite where it is zero."""
    _put_radial_gradient(at.marker[i], at.marker[j], at.g)
    return SUCCESS


@unit
def radial_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second time derivative of the distance."""
    mi, mj = at.marker[i], at.marker[j]
    axis, u = column(mi["R"], _Z), relative_velocity(mi, mj)
    first, second = vector_rates(axis, mi["om"])
    h, n, s = _across(mi, mj)
    d = math.sqrt(inner(n, n))
    s1 = inner(first, h) + inner(axis, u)
    s2 = inner(second, h) + 2.0 * inner(first, u)
    d1 = (inner(h, u) - s * s1) / d
    return (inner(u, u) - s1 * s1 - s * s2 - d1 * d1) / d  # type: ignore[no-any-return]


@unit
def radial_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of d, from that of d²/2 = h·h/2 − s²/2 with s = a·h."""
    mi, mj, g, H = at.marker[i], at.marker[j], at.g, at.H
    axis = column(mi["R"], _Z)
    h, p, s = _across(mi, mj)
    f /= math.sqrt(inner(p, p))
    put_pair(g, 0, axis)
    put_part(g, 3, cross(axis, h))
    subtract_square(g, f, H)
    add_dot2(axis, h, -f * s, H)
    add_distance(f, H)
    _put_radial_gradient(mi, mj, g)
    subtract_square(g, f, H)
    return SUCCESS


RADIAL = RowKind(
    "distance from the axis", radial_value, radial_gradient, radial_curvature, radial_tangent,
    is_distance=True,
)  # fmt: skip


@unit
def moment_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """h·(a × b)."""
    mi, mj = at.marker[i], at.marker[j]
    return inner(separation(mi, mj), cross(column(mi["R"], _Z), column(mj["R"], _Z)))  # type: ignore[no-any-return]


@unit
def moment_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of h·(a × b)."""
    g, mi, mj = at.g, at.marker[i], at.marker[j]
    u, v, h = column(mi["R"], _Z), column(mj["R"], _Z), separation(mi, mj)
    put_pair(g, 0, cross(u, v))
    put_part(g, 3, cross(u, cross(v, h)))
    put_part(g, 9, cross(v, cross(h, u)))
    return SUCCESS


@unit
def moment_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second time derivative of h·(a × b)."""
    mi, mj = at.marker[i], at.marker[j]
    u, v = column(mi["R"], _Z), column(mj["R"], _Z)
    u1, u2 = vector_rates(u, mi["om"])
    v1, v2 = vector_rates(v, mj["om"])
    first = plus(cross(u1, v), 1.0, cross(u, v1))
    second = plus(plus(cross(u2, v), 2.0, cross(u1, v1)), 1.0, cross(u, v2))
    return 2.0 * inner(relative_velocity(mi, mj), first) + inner(separation(mi, mj), second)  # type: ignore[no-any-return]


@unit
def moment_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of h·(a × b), column by column."""
    mi, mj, H = at.marker[i], at.marker[j], at.H
    u, v, h = column(mi["R"], _Z), column(mj["R"], _Z), separation(mi, mj)
    vh, hu = cross(v, h), cross(h, u)
    for k in range(3):
        e = axis_vector(k)
        ue, ve = cross(u, e), cross(v, e)
        vue, uve = cross(v, ue), cross(u, ve)
        for side in range(2):  # columns of x_I, then of x_J
            sign = f * (2.0 * side - 1.0)
            add_column(H, 3, 6 * side + k, sign, uve)
            add_column(H, 9, 6 * side + k, -sign, vue)
            add_column(H, 6 * side, 3 + k, sign, vue)
            add_column(H, 6 * side, 9 + k, -sign, uve)
        add_column(H, 3, 3 + k, f, cross(vh, ue))
        add_column(H, 3, 9 + k, f, cross(u, cross(h, ve)))
        add_column(H, 9, 3 + k, -f, cross(v, cross(h, ue)))
        add_column(H, 9, 9 + k, f, cross(hu, ve))
    return SUCCESS


MOMENT = RowKind(
    "distance of the axes", moment_value, moment_gradient, moment_curvature, moment_tangent
)
