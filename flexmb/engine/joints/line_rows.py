"""Rows about the lines of two markers, along a = z_I and b = z_J, with h = x_J − x_I.

    RADIAL    |h − (a·h) a|    distance of the point J from the line a through I
    MOMENT    h·(a × b)        mutual moment: distance of the lines times the sine of their angle

What a row is, and the meaning of its units: `engine.kind.RowKind`. Source of the mutual moment:
Selig, Geometric Fundamentals of Robotics, ch. 6.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.blocks import add_column
from flexmb.engine.algebra.vector import (
    axis_vector,
    column,
    inner,
    outer,
    plus,
    put_part,
    times,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.row import (
    add_distance,
    add_dot2,
    put_pair,
    relative_velocity,
    separation,
    subtract_square,
    vector_rates,
)
from flexmb.engine.kind import RowKind
from flexmb.engine.method import FINE
from flexmb.engine.state import RowWork

_Z = 2


@kernel
def _across(mi, mj):
    """h, its part normal to a, and the length of the part along a."""
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
    put_part(g, 3, times(-s, outer(column(mi["R"], _Z), n)))


@unit
def radial_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of the distance; not finite where it is zero."""
    _put_radial_gradient(at.marker[i], at.marker[j], at.g)
    return FINE


@unit
def radial_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of the distance."""
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
    put_part(g, 3, outer(axis, h))
    subtract_square(g, f, H)
    add_dot2(axis, h, -f * s, H)
    add_distance(f, H)
    _put_radial_gradient(mi, mj, g)
    subtract_square(g, f, H)
    return FINE


RADIAL = RowKind(
    "distance from the axis", radial_value, radial_gradient, radial_curvature, radial_tangent,
    is_distance=True,
)  # fmt: skip


@unit
def moment_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """h·(a × b)."""
    mi, mj = at.marker[i], at.marker[j]
    return inner(separation(mi, mj), outer(column(mi["R"], _Z), column(mj["R"], _Z)))  # type: ignore[no-any-return]


@unit
def moment_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of h·(a × b)."""
    g, mi, mj = at.g, at.marker[i], at.marker[j]
    u, v, h = column(mi["R"], _Z), column(mj["R"], _Z), separation(mi, mj)
    put_pair(g, 0, outer(u, v))
    put_part(g, 3, outer(u, outer(v, h)))
    put_part(g, 9, outer(v, outer(h, u)))
    return FINE


@unit
def moment_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of h·(a × b)."""
    mi, mj = at.marker[i], at.marker[j]
    u, v = column(mi["R"], _Z), column(mj["R"], _Z)
    u1, u2 = vector_rates(u, mi["om"])
    v1, v2 = vector_rates(v, mj["om"])
    first = plus(outer(u1, v), 1.0, outer(u, v1))
    second = plus(plus(outer(u2, v), 2.0, outer(u1, v1)), 1.0, outer(u, v2))
    return 2.0 * inner(relative_velocity(mi, mj), first) + inner(separation(mi, mj), second)  # type: ignore[no-any-return]


@unit
def moment_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of h·(a × b), column by column."""
    mi, mj, H = at.marker[i], at.marker[j], at.H
    u, v, h = column(mi["R"], _Z), column(mj["R"], _Z), separation(mi, mj)
    vh, hu = outer(v, h), outer(h, u)
    for k in range(3):
        e = axis_vector(k)
        ue, ve = outer(u, e), outer(v, e)
        vue, uve = outer(v, ue), outer(u, ve)
        for side in range(2):  # columns of x_I, then of x_J
            sign = f * (2.0 * side - 1.0)
            add_column(H, 3, 6 * side + k, sign, uve)
            add_column(H, 9, 6 * side + k, -sign, vue)
            add_column(H, 6 * side, 3 + k, sign, vue)
            add_column(H, 6 * side, 9 + k, -sign, uve)
        add_column(H, 3, 3 + k, f, outer(vh, ue))
        add_column(H, 3, 9 + k, f, outer(u, outer(h, ve)))
        add_column(H, 9, 3 + k, -f, outer(v, outer(h, ue)))
        add_column(H, 9, 9 + k, f, outer(hu, ve))
    return FINE


MOMENT = RowKind(
    "distance of the axes", moment_value, moment_gradient, moment_curvature, moment_tangent
)
