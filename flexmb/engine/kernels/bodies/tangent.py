"""Tangents of wrenches at markers, pulled back to the coordinates of the bodies.

For generalised forces Jᵀ w the derivative has two parts: Jᵀ H J, H the change of the wrenches with
the motion of the markers, and the change of J at constant w (the lever arms turn and deform).
"""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import (
    cross,
    tangent,
    tangent_coefficients,
    tangent_transposed,
    transform,
    transform_back,
)
from flexmb.engine.kernels.bodies.inertia_tangent import add_column, add_skew
from flexmb.engine.method import FINE
from flexmb.engine.records import Matrix, Vector
from flexmb.engine.state import Now
from flexmb.engine.tables import Parts


@unit
def marker_jacobian(parts: Parts, now: Now, k: int, Jm: Matrix) -> int:
    """Jm (6, 6+m): velocity and angular velocity of marker k, global axes, per v of its body."""
    mk, mn = parts.markers[k], now.marker[k]
    A, s = now.body[mk["body"]]["A"], mn["s"]
    m = parts.bodies[mk["body"]]["m"]
    for r in range(6):
        for c in range(6 + m):
            Jm[r, c] = 0.0
    for r in range(3):
        Jm[r, r] = 1.0
        for c in range(3):
            Jm[3 + r, 3 + c] = A[r, c]
        Jm[r, 3] = A[r, 2] * s[1] - A[r, 1] * s[2]
        Jm[r, 4] = A[r, 0] * s[2] - A[r, 2] * s[0]
        Jm[r, 5] = A[r, 1] * s[0] - A[r, 0] * s[1]
    if mk["modes"] >= 0:
        for c in range(m):
            ux, uy, uz, tx, ty, tz = _modal_column(mk, mn, parts.pool, m, c)
            ux, uy, uz = transform(A, ux, uy, uz)
            tx, ty, tz = transform(A, tx, ty, tz)
            add_column(Jm, 0, 6 + c, 1.0, ux, uy, uz)
            add_column(Jm, 3, 6 + c, 1.0, tx, ty, tz)
    return FINE


@kernel
def _modal_column(mk, mn, pool, m, c):
    """Translation Φ_t + (TᵀΦ_r) × ŝ and rotation TᵀΦ_r of a marker per η_c, body axes."""
    at, th, arm = mk["modes"] + c, mn["th"], mn["arm"]
    tx, ty, tz = tangent_transposed(
        th[0], th[1], th[2], pool[at + 3 * m], pool[at + 4 * m], pool[at + 5 * m]
    )
    hx, hy, hz = cross(tx, ty, tz, arm[0], arm[1], arm[2])
    return pool[at] + hx, pool[at + m] + hy, pool[at + 2 * m] + hz, tx, ty, tz


@unit
def put_product_block(
    H: Matrix,
    i: int,
    j: int,
    Ji: Matrix,
    ni: int,
    Jj: Matrix,
    nj: int,
    f: float,
    T: Matrix,
    B: Matrix,
) -> int:
    """B[:ni, :nj] = f J_iᵀ H[6i:6i+6, 6j:6j+6] J_j; T (6, nj) is scratch."""
    for r in range(6):
        for c in range(nj):
            s = 0.0
            for k in range(6):
                s += H[6 * i + r, 6 * j + k] * Jj[k, c]
            T[r, c] = s
    for r in range(ni):
        for c in range(nj):
            B[r, c] = 0.0
        for k in range(6):
            x = f * Ji[k, r]
            if x != 0.0:
                for c in range(nj):
                    B[r, c] += x * T[k, c]
    return FINE


@unit
def add_lever_tangent(
    parts: Parts, now: Now, k: int, w: Vector, i: int, f: float, B: Matrix
) -> int:
    """Add f ∂(Jᵀ w[i:i+6])/∂(r, θ', η) of marker k, w constant in global axes, to B (6+m, 6+m)."""
    mk, mn = parts.markers[k], now.marker[k]
    A, s = now.body[mk["body"]]["A"], mn["s"]
    fx, fy, fz = transform_back(A, f * w[i], f * w[i + 1], f * w[i + 2])
    tx, ty, tz = transform_back(A, f * w[i + 3], f * w[i + 4], f * w[i + 5])
    add_skew(B, 3, 3, 1.0, tx, ty, tz)
    # s̃ f̃' = f' sᵀ − (s·f') I
    d = s[0] * fx + s[1] * fy + s[2] * fz
    for c in range(3):
        B[3 + c, 3 + c] -= d
        add_column(B, 3, 3 + c, s[c], fx, fy, fz)
    if mk["modes"] >= 0:
        m = parts.bodies[mk["body"]]["m"]
        _add_modal_lever(mk, mn, parts.pool, m, fx, fy, fz, tx, ty, tz, B)
    return FINE


@kernel
def _add_modal_lever(mk, mn, pool, m, fx, fy, fz, tx, ty, tz, B):
    """Rows and columns of the modes: Φ_t, the tangent T(θ) and the arm all move with η."""
    at, th, arm = mk["modes"], mn["th"], mn["arm"]
    mx, my, mz = cross(arm[0], arm[1], arm[2], fx, fy, fz)
    mx, my, mz = mx + tx, my + ty, mz + tz
    for c in range(m):
        ux, uy, uz, ex, ey, ez = _modal_column(mk, mn, pool, m, c)
        # moment row: δs × f'; modal rows, δθ': f' and τ' turn with the body
        vx, vy, vz = cross(ux, uy, uz, fx, fy, fz)
        add_column(B, 3, 6 + c, 1.0, vx, vy, vz)
        wx, wy, wz = cross(ex, ey, ez, tx, ty, tz)
        B[6 + c, 3] += vx + wx
        B[6 + c, 4] += vy + wy
        B[6 + c, 5] += vz + wz
        # modal rows, δη: the arm turns, and T(θ) changes
        ax, ay, az = cross(ex, ey, ez, arm[0], arm[1], arm[2])
        ax, ay, az = cross(ax, ay, az, fx, fy, fz)
        jx, jy, jz = tangent(th[0], th[1], th[2], ax, ay, az)
        o = at + 3 * m
        rx, ry, rz = pool[o + c], pool[o + m + c], pool[o + 2 * m + c]
        dx, dy, dz = _tangent_slope(th, rx, ry, rz, mx, my, mz)
        jx, jy, jz = jx + dx, jy + dy, jz + dz
        for r in range(m):
            B[6 + r, 6 + c] += pool[o + r] * jx + pool[o + m + r] * jy + pool[o + 2 * m + r] * jz


@kernel
def _tangent_slope(th, rx, ry, rz, mx, my, mz):
    """Derivative of T(θ) m along δθ = r, at constant m."""
    qx, qy, qz = th[0], th[1], th[2]
    c1, c2, d1, d2 = tangent_coefficients(qx * qx + qy * qy + qz * qz)
    s = 2.0 * (qx * rx + qy * ry + qz * rz)
    ux, uy, uz = cross(qx, qy, qz, mx, my, mz)
    wx, wy, wz = cross(qx, qy, qz, ux, uy, uz)
    ax, ay, az = cross(rx, ry, rz, mx, my, mz)
    bx, by, bz = cross(rx, ry, rz, ux, uy, uz)
    gx, gy, gz = cross(qx, qy, qz, ax, ay, az)
    return (
        -c1 * ax - s * d1 * ux + c2 * (bx + gx) + s * d2 * wx,
        -c1 * ay - s * d1 * uy + c2 * (by + gy) + s * d2 * wy,
        -c1 * az - s * d1 * uz + c2 * (bz + gz) + s * d2 * wz,
    )
