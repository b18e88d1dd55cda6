"""Derivative of the wrenches λ g of a constraint row with the motion of its markers.

H (12, 12), rows and columns (x_I, φ_I, x_J, φ_J), rotations in global axes: the change of λ g per
(δx_I, δφ_I, δx_J, δφ_J). What the change of the lever arms adds is in `tangent`.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.primitive import dot_columns, separation
from flexmb.engine.kernels.rotation import cross
from flexmb.engine.tables import DISTANCE, DOT1, DOT2, POINT


@kernel
def add_row_tangent(kind, a, b, mi, mj, lam, H):
    """Add the tangent of λ g of one row to H (12, 12)."""
    if kind == POINT:
        return
    Ri, Rj = mi["R"], mj["R"]
    if kind == DOT1:
        _add_dot(Ri, a, Rj, b, lam, H)
    elif kind == DOT2:
        hx, hy, hz = separation(mi, mj)
        _add_dot2(Ri[0, a], Ri[1, a], Ri[2, a], hx, hy, hz, lam, H)
    elif kind == DISTANCE:
        hx, hy, hz = separation(mi, mj)
        _add_distance(hx, hy, hz, lam, H)
    else:
        _add_angle(Ri, Rj, lam, H)


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


@kernel
def _add_dot(Ri, a, Rj, b, f, H):
    """f times the tangent of a·b."""
    ax, ay, az = Ri[0, a], Ri[1, a], Ri[2, a]
    bx, by, bz = Rj[0, b], Rj[1, b], Rj[2, b]
    _add_skew_product(H, 3, 3, f, bx, by, bz, ax, ay, az)
    _add_skew_product(H, 3, 9, -f, ax, ay, az, bx, by, bz)
    _add_skew_product(H, 9, 9, f, ax, ay, az, bx, by, bz)
    _add_skew_product(H, 9, 3, -f, bx, by, bz, ax, ay, az)


@kernel
def _add_dot2(ax, ay, az, hx, hy, hz, f, H):
    """f times the tangent of a·h."""
    _add_skew(H, 0, 3, f, ax, ay, az)
    _add_skew(H, 6, 3, -f, ax, ay, az)
    _add_skew_product(H, 3, 3, f, hx, hy, hz, ax, ay, az)
    _add_skew(H, 3, 6, f, ax, ay, az)
    _add_skew(H, 3, 0, -f, ax, ay, az)


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
def _add_angle(Ri, Rj, f, H):
    """f times the tangent of atan2(s, c), s = y_I·x_J, c = x_I·x_J."""
    s = dot_columns(Ri, 1, Rj, 0)
    c = dot_columns(Ri, 0, Rj, 0)
    n = 1.0 / (s * s + c * c)
    _add_dot(Ri, 1, Rj, 0, f * c * n, H)
    _add_dot(Ri, 0, Rj, 0, -f * s * n, H)
    ds = cross(Ri[0, 1], Ri[1, 1], Ri[2, 1], Rj[0, 0], Rj[1, 0], Rj[2, 0])
    dc = cross(Ri[0, 0], Ri[1, 0], Ri[2, 0], Rj[0, 0], Rj[1, 0], Rj[2, 0])
    for i in range(3):
        for j in range(3):
            dtheta = (c * ds[i] - s * dc[i]) * n
            e = f * n * (ds[i] * dc[j] - dc[i] * ds[j])
            e -= 2.0 * f * n * dtheta * (c * dc[j] + s * ds[j])
            H[3 + i, 3 + j] += e
            H[3 + i, 9 + j] -= e
            H[9 + i, 3 + j] -= e
            H[9 + i, 9 + j] += e
