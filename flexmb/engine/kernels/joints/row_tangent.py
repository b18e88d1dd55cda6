"""Derivative of the wrenches λ g of a constraint row with the motion of its markers.

H (12, 12), rows and columns (x_I, φ_I, x_J, φ_J), rotations in global axes: the change of λ g per
(δx_I, δφ_I, δx_J, δφ_J). What the change of the lever arms adds is in `tangent`.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.joints import line
from flexmb.engine.kernels.joints.dots import add_dot, add_dot2, dot_columns, separation
from flexmb.engine.method import FINE
from flexmb.engine.state import Run
from flexmb.engine.tables import DISTANCE, DOT1, DOT2, POINT, TWIST


@unit
def add_row_tangent(run: Run, kind: int, a: int, b: int, i: int, j: int, lam: float) -> int:
    """Add the tangent of λ g of a row between two markers to dense.H; dense.g[0] is scratch."""
    markers, dense = run.work.now.marker, run.work.dense
    if kind >= TWIST:
        line.add_tangent(kind, markers[i], markers[j], lam, dense.g[0], dense.H)
    else:
        add_axis_tangent(kind, a, b, markers[i], markers[j], lam, dense.H)
    return FINE


@kernel
def add_axis_tangent(kind, a, b, mi, mj, lam, H):
    """Add the tangent of λ g of one row between points and axes, not between lines."""
    if kind == POINT:
        return
    Ri, Rj = mi["R"], mj["R"]
    if kind == DOT1:
        add_dot(Ri, a, Rj, b, lam, H)
    elif kind == DOT2:
        hx, hy, hz = separation(mi, mj)
        add_dot2(Ri[0, a], Ri[1, a], Ri[2, a], hx, hy, hz, lam, H)
    elif kind == DISTANCE:
        hx, hy, hz = separation(mi, mj)
        _add_distance(hx, hy, hz, lam, H)
    else:
        _add_angle(Ri, Rj, b, lam, H)


@kernel
def _add_distance(hx, hy, hz, f, H):
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


@kernel
def _add_angle(Ri, Rj, b, f, H):
    """f times the tangent of atan2(s, c), s = y_I·b, c = x_I·b."""
    s = dot_columns(Ri, 1, Rj, b)
    c = dot_columns(Ri, 0, Rj, b)
    n = 1.0 / (s * s + c * c)
    add_dot(Ri, 1, Rj, b, f * c * n, H)
    add_dot(Ri, 0, Rj, b, -f * s * n, H)
    ds = cross(Ri[0, 1], Ri[1, 1], Ri[2, 1], Rj[0, b], Rj[1, b], Rj[2, b])
    dc = cross(Ri[0, 0], Ri[1, 0], Ri[2, 0], Rj[0, b], Rj[1, b], Rj[2, b])
    for i in range(3):
        for j in range(3):
            dtheta = (c * ds[i] - s * dc[i]) * n
            e = f * n * (ds[i] * dc[j] - dc[i] * ds[j])
            e -= 2.0 * f * n * dtheta * (c * dc[j] + s * ds[j])
            H[3 + i, 3 + j] += e
            H[3 + i, 9 + j] -= e
            H[9 + i, 3 + j] -= e
            H[9 + i, 9 + j] += e
