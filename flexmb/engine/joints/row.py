"""Constraint rows of any kind: calls of their units, and the dot products they are made of.

Dot products are between axes of two markers and their separation: values, rates and tangents.
H (12, 12) is as in `engine.kind.RowKind`.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.blocks import add_column, add_skew
from flexmb.engine.algebra.vector import inner, outer, put_part, times, triple
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
def put_pair(g, o, a):
    """g (12) = 0 but for a, of marker J at o + 6, and the opposite, of marker I at o."""
    for k in range(12):
        g[k] = 0.0
    put_part(g, o, times(-1.0, a))
    put_part(g, o + 6, a)


@kernel
def vector_rates(a, om):
    """First derivative of a vector fixed to a marker, and second at zero angular acceleration."""
    first = outer(triple(om), a)
    return first, outer(triple(om), first)


@kernel
def dot_rates(a, omi, b, omj):
    """a·b: first derivative, and second at zero angular accelerations."""
    a1, a2 = vector_rates(a, omi)
    b1, b2 = vector_rates(b, omj)
    return inner(a1, b) + inner(a, b1), inner(a2, b) + inner(a, b2) + 2.0 * inner(a1, b1)


@kernel
def _add_skew_product(H, i, j, f, p, q):
    """Add f p~ q~ = f (q pᵀ − (p·q) I) to the 3 × 3 block at (i, j)."""
    dot = f * inner(p, q)
    for k in range(3):
        add_column(H, i, j + k, f * p[k], q)
        H[i + k, j + k] -= dot


@unit
def add_dot(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, f: float, H: Matrix
) -> int:
    """f times the tangent of a·b."""
    a, b = (ax, ay, az), (bx, by, bz)
    _add_skew_product(H, 3, 3, f, b, a)
    _add_skew_product(H, 3, 9, -f, a, b)
    _add_skew_product(H, 9, 9, f, a, b)
    _add_skew_product(H, 9, 3, -f, b, a)
    return FINE


@kernel
def add_dot2(a, h, f, H):
    """f times the tangent of a·h."""
    add_skew(H, 0, 3, f, a)
    add_skew(H, 6, 3, -f, a)
    _add_skew_product(H, 3, 3, f, h, a)
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
    """Add f (I, −I; −I, I) to the blocks of the two places."""
    for k in range(3):
        H[k, k] += f
        H[6 + k, 6 + k] += f
        H[k, 6 + k] -= f
        H[6 + k, k] -= f
