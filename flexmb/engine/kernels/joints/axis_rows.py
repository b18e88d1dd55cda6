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

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.joints.dots import (
    add_dot,
    clear_gradient,
    dot_columns,
    dot_rates,
    put_pair,
)
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
    _, second = dot_rates(mi["R"], a, mi["om"], mj["R"], b, mj["om"])
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


@kernel
def _sine_and_cosine(Ri, Rj, b):
    """s = y_I·b and c = x_I·b, whose angle is that of the row."""
    return dot_columns(Ri, _Y, Rj, b), dot_columns(Ri, _X, Rj, b)


@unit
def angle_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Angle of b about z_I from x_I, within ±π."""
    s, c = _sine_and_cosine(at.marker[i]["R"], at.marker[j]["R"], b)
    return math.atan2(s, c)


@unit
def angle_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of atan2(s, c)."""
    g, Ri, Rj = at.g, at.marker[i]["R"], at.marker[j]["R"]
    clear_gradient(g)
    s, c = _sine_and_cosine(Ri, Rj, b)
    n = 1.0 / (s * s + c * c)
    ux = (c * Ri[0, _Y] - s * Ri[0, _X]) * n
    uy = (c * Ri[1, _Y] - s * Ri[1, _X]) * n
    uz = (c * Ri[2, _Y] - s * Ri[2, _X]) * n
    x, y, z = cross(Rj[0, b], Rj[1, b], Rj[2, b], ux, uy, uz)
    put_pair(g, 3, x, y, z)
    return FINE


@unit
def angle_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of atan2(s, c)."""
    Ri, Rj, omi, omj = at.marker[i]["R"], at.marker[j]["R"], at.marker[i]["om"], at.marker[j]["om"]
    s, c = _sine_and_cosine(Ri, Rj, b)
    s1, s2 = dot_rates(Ri, _Y, omi, Rj, b, omj)
    c1, c2 = dot_rates(Ri, _X, omi, Rj, b, omj)
    n = 1.0 / (s * s + c * c)
    return (c * s2 - s * c2) * n - 2.0 * (c * c1 + s * s1) * (c * s1 - s * c1) * n * n  # type: ignore[no-any-return]


@unit
def angle_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of atan2(s, c), n = 1/(s² + c²).

    n (c ∂²s − s ∂²c) is the tangent of u·b with u = n (c y_I − s x_I) held; the rest is of n and u.
    """
    Ri, Rj, g, H = at.marker[i]["R"], at.marker[j]["R"], at.g, at.H
    s, c = _sine_and_cosine(Ri, Rj, b)
    n = 1.0 / (s * s + c * c)
    bx, by, bz = Rj[0, b], Rj[1, b], Rj[2, b]
    ux = (c * Ri[0, _Y] - s * Ri[0, _X]) * n
    uy = (c * Ri[1, _Y] - s * Ri[1, _X]) * n
    uz = (c * Ri[2, _Y] - s * Ri[2, _X]) * n
    add_dot(ux, uy, uz, bx, by, bz, f, H)
    x, y, z = cross(Ri[0, _Y], Ri[1, _Y], Ri[2, _Y], bx, by, bz)
    put(g, 0, x, y, z)
    x, y, z = cross(Ri[0, _X], Ri[1, _X], Ri[2, _X], bx, by, bz)
    put(g, 3, x, y, z)
    for k in range(3):
        change = 2.0 * (c * g[k] - s * g[3 + k]) * n
        for m in range(3):
            e = g[k] * g[3 + m] - g[3 + k] * g[m] - change * (c * g[3 + m] + s * g[m])
            e *= f * n
            H[3 + k, 3 + m] += e
            H[3 + k, 9 + m] -= e
            H[9 + k, 3 + m] -= e
            H[9 + k, 9 + m] += e
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
    Ri, Rj, omi, omj = at.marker[i]["R"], at.marker[j]["R"], at.marker[i]["om"], at.marker[j]["om"]
    _, first = dot_rates(Ri, _X, omi, Rj, _Y, omj)
    _, second = dot_rates(Ri, _Y, omi, Rj, _X, omj)
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
