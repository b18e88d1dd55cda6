"""Rows about the separation of two markers, h = x_J − x_I.

    POINT     h·e_a      coincidence along a global axis
    DOT2      a·h        no motion along a = column a of R_I; a stroke if its function varies
    DISTANCE  |h|        the multiplier is the force in the massless link

What a row is, and the meaning of its units: `engine.kind.RowKind`. Source: Haug, Computer Aided
Kinematics and Dynamics, 1989, ch. 9; Hong & Liu 2011, §2.3.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.joints.dots import (
    add_dot2,
    clear_gradient,
    column_rates,
    put_pair,
    relative_velocity,
    separation,
)
from flexmb.engine.kind import RowKind
from flexmb.engine.method import FINE
from flexmb.engine.state import RowWork


@unit
def point_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """h·e_a."""
    return at.marker[j]["x"][a] - at.marker[i]["x"][a]  # type: ignore[no-any-return]


@unit
def point_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of h·e_a."""
    g = at.g
    clear_gradient(g)
    g[a] = -1.0
    g[6 + a] = 1.0
    return FINE


@unit
def point_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """None: h·e_a is linear."""
    return 0.0


POINT = RowKind("place {a}", point_value, point_gradient, point_curvature)


@unit
def dot2_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """a·h."""
    R = at.marker[i]["R"]
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    return R[0, a] * hx + R[1, a] * hy + R[2, a] * hz  # type: ignore[no-any-return]


@unit
def dot2_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of a·h."""
    clear_gradient(at.g)
    put_component_gradient(a, at.marker[i], at.marker[j], at.g)
    return FINE


@kernel
def put_component_gradient(a, mi, mj, g):
    """Put the gradient of a·h into g (12), zero elsewhere."""
    R = mi["R"]
    hx, hy, hz = separation(mi, mj)
    put_pair(g, 0, R[0, a], R[1, a], R[2, a])
    x, y, z = cross(R[0, a], R[1, a], R[2, a], hx, hy, hz)
    put(g, 3, x, y, z)


@unit
def dot2_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of a·h."""
    mi, mj = at.marker[i], at.marker[j]
    hx, hy, hz = separation(mi, mj)
    ux, uy, uz = relative_velocity(mi, mj)
    px, py, pz, qx, qy, qz = column_rates(mi["R"], a, mi["om"])
    return qx * hx + qy * hy + qz * hz + 2.0 * (px * ux + py * uy + pz * uz)  # type: ignore[no-any-return]


@unit
def dot2_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of a·h."""
    R = at.marker[i]["R"]
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    add_dot2(R[0, a], R[1, a], R[2, a], hx, hy, hz, f, at.H)
    return FINE


DOT2 = RowKind("offset {a}", dot2_value, dot2_gradient, dot2_curvature, dot2_tangent)


@unit
def distance_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """|h|."""
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    return math.sqrt(hx * hx + hy * hy + hz * hz)


@unit
def distance_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of |h|; not finite where it is zero."""
    clear_gradient(at.g)
    put_distance_gradient(at.marker[i], at.marker[j], at.g)
    return FINE


@kernel
def put_distance_gradient(mi, mj, g):
    """Put the gradient of |h| into g (12), zero elsewhere."""
    hx, hy, hz = separation(mi, mj)
    n = 1.0 / np.sqrt(hx * hx + hy * hy + hz * hz)
    put_pair(g, 0, hx * n, hy * n, hz * n)


@unit
def distance_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of |h|."""
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    ux, uy, uz = relative_velocity(at.marker[i], at.marker[j])
    d = math.sqrt(hx * hx + hy * hy + hz * hz)
    dd = (hx * ux + hy * uy + hz * uz) / d
    return (ux * ux + uy * uy + uz * uz - dd * dd) / d  # type: ignore[no-any-return]


@unit
def distance_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of |h|."""
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    add_distance(hx, hy, hz, f, at.H)
    return FINE


@kernel
def add_distance(hx, hy, hz, f, H):
    """f times the tangent of |h|."""
    d = math.sqrt(hx * hx + hy * hy + hz * hz)
    n = (hx / d, hy / d, hz / d)
    for i in range(3):
        for j in range(3):
            e = f * ((1.0 if i == j else 0.0) - n[i] * n[j]) / d
            H[i, j] += e
            H[6 + i, 6 + j] += e
            H[i, 6 + j] -= e
            H[6 + i, j] -= e


DISTANCE = RowKind(
    "length",
    distance_value,
    distance_gradient,
    distance_curvature,
    distance_tangent,
    is_distance=True,
)
