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

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.row import add_dot, clear_gradient, dot_columns, dot_rates, put_pair
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
    g, Ri, Rj = at.g, at.marker[i]["R"], at.marker[j]["R"]
    clear_gradient(g)
    x, y, z = cross(Ri[0, a], Ri[1, a], Ri[2, a], Rj[0, b], Rj[1, b], Rj[2, b])
    put_pair(g, 3, -x, -y, -z)
    return FINE


@unit
def dot1_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of a·b."""
    mi, mj = at.marker[i], at.marker[j]
    R, S = mi["R"], mj["R"]
    _, second = dot_rates(R[0, a], R[1, a], R[2, a], mi["om"], S[0, b], S[1, b], S[2, b], mj["om"])
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
    s, c = n * s, n * c
    return (
        c * Ri[0, _Y] - s * Ri[0, _X],
        c * Ri[1, _Y] - s * Ri[1, _X],
        c * Ri[2, _Y] - s * Ri[2, _X],
        c * Ri[0, _X] + s * Ri[0, _Y],
        c * Ri[1, _X] + s * Ri[1, _Y],
        c * Ri[2, _X] + s * Ri[2, _Y],
    )


@unit
def angle_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of θ, b × u."""
    g, Rj = at.g, at.marker[j]["R"]
    clear_gradient(g)
    ux, uy, uz, _, _, _ = _across_and_along(at.marker[i]["R"], Rj, b)
    x, y, z = cross(Rj[0, b], Rj[1, b], Rj[2, b], ux, uy, uz)
    put_pair(g, 3, x, y, z)
    return FINE


@unit
def angle_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of θ: (u·b)¨ − 2 (u·b)˙ (v·b)˙, with u and v fixed to I."""
    mi, mj = at.marker[i], at.marker[j]
    Rj, p, q = mj["R"], mi["om"], mj["om"]
    bx, by, bz = Rj[0, b], Rj[1, b], Rj[2, b]
    ux, uy, uz, vx, vy, vz = _across_and_along(mi["R"], Rj, b)
    first, second = dot_rates(ux, uy, uz, p, bx, by, bz, q)
    x, y, z = cross(bx, by, bz, vx, vy, vz)
    growth = (q[0] - p[0]) * x + (q[1] - p[1]) * y + (q[2] - p[2]) * z
    return second - 2.0 * first * growth  # type: ignore[no-any-return]


@unit
def angle_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of θ: that of u·b with u fixed to I, less that of its length and turn."""
    g, H, Rj = at.g, at.H, at.marker[j]["R"]
    bx, by, bz = Rj[0, b], Rj[1, b], Rj[2, b]
    ux, uy, uz, vx, vy, vz = _across_and_along(at.marker[i]["R"], Rj, b)
    add_dot(ux, uy, uz, bx, by, bz, f, H)
    x, y, z = cross(bx, by, bz, ux, uy, uz)
    put(g, 0, x, y, z)
    x, y, z = cross(bx, by, bz, vx, vy, vz)
    put(g, 3, x, y, z)
    for k in range(3):
        for m in range(3):
            e = f * (g[k] * g[3 + m] + g[3 + k] * g[m])
            H[3 + k, 3 + m] -= e
            H[3 + k, 9 + m] += e
            H[9 + k, 3 + m] += e
            H[9 + k, 9 + m] -= e
    return FINE


ANGLE = RowKind(
    "angle",
    angle_value,
    angle_gradient,
    angle_curvature,
    angle_tangent,
    angular=True,
    period=2.0 * math.pi,
)


@unit
def twist_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """x_I·y_J − y_I·x_J."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    return dot_columns(Ri, _X, Rj, _Y) - dot_columns(Ri, _Y, Rj, _X)  # type: ignore[no-any-return]


@unit
def twist_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of x_I·y_J − y_I·x_J."""
    g, Ri, Rj = at.g, at.marker[i]["R"], at.marker[j]["R"]
    clear_gradient(g)
    x, y, z = cross(Ri[0, _X], Ri[1, _X], Ri[2, _X], Rj[0, _Y], Rj[1, _Y], Rj[2, _Y])
    u, v, w = cross(Ri[0, _Y], Ri[1, _Y], Ri[2, _Y], Rj[0, _X], Rj[1, _X], Rj[2, _X])
    put_pair(g, 3, u - x, v - y, w - z)
    return FINE


@unit
def twist_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of x_I·y_J − y_I·x_J."""
    mi, mj = at.marker[i], at.marker[j]
    R, S = mi["R"], mj["R"]
    total = 0.0
    for k in range(2):
        m, sign = 1 - k, 1.0 - 2.0 * k
        _, second = dot_rates(
            R[0, k], R[1, k], R[2, k], mi["om"], S[0, m], S[1, m], S[2, m], mj["om"]
        )
        total += sign * second
    return total  # type: ignore[no-any-return]


@unit
def twist_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of x_I·y_J − y_I·x_J."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    for k in range(2):
        m, sign = 1 - k, 1.0 - 2.0 * k
        add_dot(Ri[0, k], Ri[1, k], Ri[2, k], Rj[0, m], Rj[1, m], Rj[2, m], sign * f, at.H)
    return FINE


TWIST = RowKind("twist", twist_value, twist_gradient, twist_curvature, twist_tangent, angular=True)
