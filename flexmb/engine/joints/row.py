"""Constraint rows of any kind: calls of their units, and the dot products they are made of.

Dot products are between axes of two markers and their separation: values, rates and tangents.
H (12, 12) is as in `engine.kind.RowKind`.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import call_row, call_row_tangent, call_row_value, kernel, unit
from flexmb.engine.method import FINE
from flexmb.engine.records import Matrix

_TURN = 2.0 * math.pi


@kernel
def wrapped(angle):
    """Angle within ±π."""
    return angle - _TURN * np.floor(angle / _TURN + 0.5)


# `row` below is a row of constraints, or a term of a sensor that measures as one does.


@kernel
def row_value(run, row):
    """What a row measures."""
    unit = run.rows.value[row["kind"]]
    return call_row_value(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def put_row_gradient(run, row):
    """Gradient of a row to RowWork.g."""
    unit = run.rows.gradient[row["kind"]]
    call_row(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def row_curvature(run, row):
    """Second time derivative of what a row measures at zero accelerations of both markers."""
    unit = run.rows.curvature[row["kind"]]
    return call_row_value(unit, run.work.row, row["a"], row["b"], row["I"], row["J"])


@kernel
def add_row_tangent(run, row, f):
    """Add f times the tangent of a row to RowWork.H; returns whether it has one."""
    kind = row["kind"]
    if run.rows.curved[kind] == 0:
        return 0
    unit = run.rows.tangent[kind]
    call_row_tangent(unit, run.work.row, row["a"], row["b"], row["I"], row["J"], f)
    return 1


@kernel
def rate(g, mi, mj):
    """g times the velocities of the two markers."""
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
def clear_gradient(g):
    """g (12) = 0."""
    for k in range(12):
        g[k] = 0.0


@kernel
def put_pair(g, o, x, y, z):
    """(x, y, z) for marker J at o + 6, the opposite for marker I at o."""
    put(g, o, -x, -y, -z)
    put(g, o + 6, x, y, z)


@kernel
def vector_rates(x, y, z, om):
    """First derivative of a vector fixed to a marker, and second at zero angular acceleration."""
    x, y, z = cross(om[0], om[1], om[2], x, y, z)
    u, v, w = cross(om[0], om[1], om[2], x, y, z)
    return x, y, z, u, v, w


@kernel
def column_rates(R, a, om):
    """The same of column a of R."""
    return vector_rates(R[0, a], R[1, a], R[2, a], om)


@kernel
def dot_rates(ax, ay, az, omi, bx, by, bz, omj):
    """a·b: first derivative, and second at zero angular accelerations."""
    px, py, pz, qx, qy, qz = vector_rates(ax, ay, az, omi)
    rx, ry, rz, sx, sy, sz = vector_rates(bx, by, bz, omj)
    first = px * bx + py * by + pz * bz + ax * rx + ay * ry + az * rz
    second = qx * bx + qy * by + qz * bz + ax * sx + ay * sy + az * sz
    return first, second + 2.0 * (px * rx + py * ry + pz * rz)


@kernel
def _add_skew(H, i, j, f, x, y, z):
    """Add f (x, y, z)~ to the 3 × 3 block at (i, j)."""
    H[i, j + 1] -= f * z
    H[i, j + 2] += f * y
    H[i + 1, j] += f * z
    H[i + 1, j + 2] -= f * x
    H[i + 2, j] -= f * y
    H[i + 2, j + 1] += f * x


@kernel
def _add_skew_product(H, i, j, f, px, py, pz, qx, qy, qz):
    """Add f p~ q~ = f (q pᵀ − (p·q) I) to the 3 × 3 block at (i, j)."""
    dot = px * qx + py * qy + pz * qz
    H[i, j] += f * (qx * px - dot)
    H[i, j + 1] += f * qx * py
    H[i, j + 2] += f * qx * pz
    H[i + 1, j] += f * qy * px
    H[i + 1, j + 1] += f * (qy * py - dot)
    H[i + 1, j + 2] += f * qy * pz
    H[i + 2, j] += f * qz * px
    H[i + 2, j + 1] += f * qz * py
    H[i + 2, j + 2] += f * (qz * pz - dot)


@unit
def add_dot(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, f: float, H: Matrix
) -> int:
    """f times the tangent of a·b."""
    _add_skew_product(H, 3, 3, f, bx, by, bz, ax, ay, az)
    _add_skew_product(H, 3, 9, -f, ax, ay, az, bx, by, bz)
    _add_skew_product(H, 9, 9, f, ax, ay, az, bx, by, bz)
    _add_skew_product(H, 9, 3, -f, bx, by, bz, ax, ay, az)
    return FINE


@kernel
def add_dot2(ax, ay, az, hx, hy, hz, f, H):
    """f times the tangent of a·h."""
    _add_skew(H, 0, 3, f, ax, ay, az)
    _add_skew(H, 6, 3, -f, ax, ay, az)
    _add_skew_product(H, 3, 3, f, hx, hy, hz, ax, ay, az)
    _add_skew(H, 3, 6, f, ax, ay, az)
    _add_skew(H, 3, 0, -f, ax, ay, az)
