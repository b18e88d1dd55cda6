"""Rows about the angles between axes of two markers.

With a = column a of R_I and b = column b of R_J:

    DOT1      a·b                 two axes keep their angle, 90 deg for 0
    ANGLE     atan2(y_I·b, x_I·b) angle of b about z_I from x_I, within ±π
    TWIST     x_I·y_J − y_I·x_J   no twist about the bisector of z_I and z_J: zero for shafts that
                                  turn with equal speed at any angle

What a row is, and the meaning of its units: `engine.kind.RowKind`. Source: Haug, Computer Aided
Kinematics and Dynamics, 1989, ch. 9; of the homokinetic condition: Shabana, Dynamics of Multibody
Systems, ch. 3.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import column, inner, outer, plus, put_part, times, triple
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.row import add_dot, dot_columns, dot_rates, put_pair
from flexmb.engine.kind import RowKind
from flexmb.engine.method import FINE
from flexmb.engine.state import RowWork

_X, _Y = 0, 1


@unit
def dot1_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """a·b."""
    return dot_columns(at.marker[i]["R"], a, at.marker[j]["R"], b)  # type: ignore[no-any-return]


@unit
def dot1_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of a·b."""
    put_pair(at.g, 3, outer(column(at.marker[j]["R"], b), column(at.marker[i]["R"], a)))
    return FINE


@unit
def dot1_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of a·b."""
    mi, mj = at.marker[i], at.marker[j]
    _, second = dot_rates(column(mi["R"], a), mi["om"], column(mj["R"], b), mj["om"])
    return second  # type: ignore[no-any-return]


@unit
def dot1_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of a·b."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    add_dot(Ri[0, a], Ri[1, a], Ri[2, a], Rj[0, b], Rj[1, b], Rj[2, b], f, at.H)
    return FINE


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
    """u and v, axes of I across and along b in its plane x, y, over the length of b there.

    With both fixed to I, θ̇ is the rate of u·b, and that of the length over the length is that of
    v·b.
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
    put_pair(at.g, 3, outer(column(Rj, b), u))
    return FINE


@unit
def angle_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of θ: (u·b)¨ − 2 (u·b)˙ (v·b)˙, with u and v fixed to I."""
    mi, mj = at.marker[i], at.marker[j]
    axis, p, q = column(mj["R"], b), triple(mi["om"]), triple(mj["om"])
    u, v = _across_and_along(mi["R"], mj["R"], b)
    first, second = dot_rates(u, p, axis, q)
    growth = inner(plus(q, -1.0, p), outer(axis, v))
    return second - 2.0 * first * growth  # type: ignore[no-any-return]


@unit
def angle_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of θ: that of u·b with u fixed to I, less that of its length and turn."""
    g, H, Rj = at.g, at.H, at.marker[j]["R"]
    axis = column(Rj, b)
    u, v = _across_and_along(at.marker[i]["R"], Rj, b)
    add_dot(u[0], u[1], u[2], axis[0], axis[1], axis[2], f, H)
    put_part(g, 0, outer(axis, u))
    put_part(g, 3, outer(axis, v))
    for k in range(3):
        for m in range(3):
            e = f * (g[k] * g[3 + m] + g[3 + k] * g[m])
            H[3 + k, 3 + m] -= e
            H[3 + k, 9 + m] += e
            H[9 + k, 3 + m] += e
            H[9 + k, 9 + m] -= e
    return FINE


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
    first = outer(column(Ri, _Y), column(Rj, _X))
    put_pair(at.g, 3, plus(first, -1.0, outer(column(Ri, _X), column(Rj, _Y))))
    return FINE


@unit
def twist_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of x_I·y_J − y_I·x_J."""
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
    return FINE


TWIST = RowKind("twist", twist_value, twist_gradient, twist_curvature, twist_tangent, angular=True)
