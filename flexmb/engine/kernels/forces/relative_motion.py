"""Relative motion of two markers in the axes of marker I, and tangents of what depends on it.

With h = x_J − x_I: separation u = R_Iᵀ h, relative rotation Q = R_Iᵀ R_J = exp(φ̃) with |φ| < π, and
as seen from I the velocity u̇ = R_Iᵀ (v_J − v_I − ω_I × h) and the angular velocity
ω = R_Iᵀ (ω_J − ω_I). A rigid motion of both markers changes none of them, so forces made from them
are objective. φ̇ = G(φ) ω with G = I − ½ φ̃ + e φ̃², e = (1 − (φ/2) cot(φ/2))/φ² (the inverse of the
tangent of the exponential map; Géradin & Cardona, Flexible Multibody Dynamics, 2001, ch. 4).

A force f and a moment m in the axes of I, with which J is pulled to I, act on J as −(R_I f, R_I m)
and on I as the opposite at the same point, which is (R_I f, R_I m + h × R_I f) at its marker: the
pair has neither momentum nor moment of momentum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import cross, transform, transform_back
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.bodies.inertia_tangent import add_skew
from flexmb.engine.kernels.joints.dots import dot_columns, separation
from flexmb.engine.records import Matrix, Vector

# Below this φ² the series of e, in φ², has a remainder below round-off; above, the closed form of
# its slope keeps all but three digits.
_SERIES = 0.5


class RelativeMotion(NamedTuple):
    """Scratch of one pair of markers: relative motion, force, and what tangents are made of."""

    x: Vector  # (6,) separation and rotation vector of J from I, axes of I
    rate: Vector  # (6,) velocity and angular velocity of J seen from I, axes of I
    Q: Matrix  # (3, 3) axes of J in those of I
    p: Vector  # (6,) force conjugate to x
    f: Vector  # (6,) force and moment with which J is pulled to I, axes of I
    K: Matrix  # (6, 6) its change with the relative motion
    C: Matrix  # (6, 6) and with the relative velocity
    E: Matrix  # (6, 12) relative motion per motion of the markers
    D: Matrix  # (6, 12) change of the relative velocity with their position
    S: Matrix  # (6, 12)
    W: Matrix  # (12, 12) damping between the markers
    N: Matrix  # (6, 6 + m) change of a marker's velocity with q at constant v


@kernel
def put_relative_motion(mi, mj, s):
    """s.x, s.rate and s.Q of two markers; the rate is of use after a velocity stage only."""
    Ri, Rj, out, rate, Q = mi["R"], mj["R"], s.x, s.rate, s.Q
    hx, hy, hz = separation(mi, mj)
    x, y, z = transform_back(Ri, hx, hy, hz)
    put(out, 0, x, y, z)
    for a in range(3):
        for b in range(3):
            Q[a, b] = dot_columns(Ri, a, Rj, b)
    x, y, z = rotation_vector(Q)
    put(out, 3, x, y, z)
    x, y, z = _velocity_from(mi, mj)
    x, y, z = transform_back(Ri, x, y, z)
    put(rate, 0, x, y, z)
    p, q = mi["om"], mj["om"]
    x, y, z = transform_back(Ri, q[0] - p[0], q[1] - p[1], q[2] - p[2])
    put(rate, 3, x, y, z)


@kernel
def _velocity_from(mi, mj):
    """Velocity of J seen from I, global axes."""
    hx, hy, hz = separation(mi, mj)
    om, u, v = mi["om"], mi["vx"], mj["vx"]
    cx, cy, cz = cross(om[0], om[1], om[2], hx, hy, hz)
    return v[0] - u[0] - cx, v[1] - u[1] - cy, v[2] - u[2] - cz


@kernel
def rotation_vector(Q):
    """φ of Q = exp(φ̃), |φ| ≤ π, by the largest of four Euler parameters (Shepperd 1978)."""
    trace = Q[0, 0] + Q[1, 1] + Q[2, 2]
    if trace >= max(Q[0, 0], Q[1, 1], Q[2, 2]):
        w = 0.5 * math.sqrt(1.0 + trace)
        n = 0.25 / w
        x, y, z = n * (Q[2, 1] - Q[1, 2]), n * (Q[0, 2] - Q[2, 0]), n * (Q[1, 0] - Q[0, 1])
    elif Q[0, 0] >= max(Q[1, 1], Q[2, 2]):
        x = 0.5 * math.sqrt(1.0 + Q[0, 0] - Q[1, 1] - Q[2, 2])
        n = 0.25 / x
        w, y, z = n * (Q[2, 1] - Q[1, 2]), n * (Q[0, 1] + Q[1, 0]), n * (Q[0, 2] + Q[2, 0])
    elif Q[1, 1] >= Q[2, 2]:
        y = 0.5 * math.sqrt(1.0 + Q[1, 1] - Q[0, 0] - Q[2, 2])
        n = 0.25 / y
        w, x, z = n * (Q[0, 2] - Q[2, 0]), n * (Q[0, 1] + Q[1, 0]), n * (Q[1, 2] + Q[2, 1])
    else:
        z = 0.5 * math.sqrt(1.0 + Q[2, 2] - Q[0, 0] - Q[1, 1])
        n = 0.25 / z
        w, x, y = n * (Q[1, 0] - Q[0, 1]), n * (Q[0, 2] + Q[2, 0]), n * (Q[1, 2] + Q[2, 1])
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    f = 2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 2.0
    return f * x, f * y, f * z


@kernel
def inverse_coefficient(x):
    """e and de/dx of G, x = φ²; coefficients of the series are |B_2n| / (2n)!."""
    if x < _SERIES:
        e = x * (1.0 / 74724249600.0 + x * 3617.0 / 10670622842880000.0)
        e = x * (1.0 / 1209600.0 + x * (1.0 / 47900160.0 + x * 691.0 / 1307674368000.0 + x * e))
        e = 1.0 / 12.0 + x * (1.0 / 720.0 + x * (1.0 / 30240.0 + e))
        d = x * (6.0 / 74724249600.0 + x * 7.0 * 3617.0 / 10670622842880000.0)
        d = x * (3.0 / 1209600.0 + x * (4.0 / 47900160.0 + x * (5.0 * 691.0 / 1307674368000.0 + d)))
        return e, 1.0 / 720.0 + x * (2.0 / 30240.0 + d)
    angle = math.sqrt(x)
    s, c = math.sin(0.5 * angle), math.cos(0.5 * angle)
    e = 1.0 / x - 0.5 * c / (s * angle)
    return e, (0.125 / (s * s) + 0.25 * c / (s * angle) - 1.0 / x) / x


@kernel
def inverse_tangent(phi, o, sign, x, y, z):
    """G(sign φ) (x, y, z), φ = phi[o:o+3]; sign −1 gives the transpose."""
    a, b, c = phi[o], phi[o + 1], phi[o + 2]
    e, _ = inverse_coefficient(a * a + b * b + c * c)
    ux, uy, uz = cross(a, b, c, x, y, z)
    wx, wy, wz = cross(a, b, c, ux, uy, uz)
    h = 0.5 * sign
    return x - h * ux + e * wx, y - h * uy + e * wy, z - h * uz + e * wz


@kernel
def inverse_tangent_slope(phi, o, sign, x, y, z, dx, dy, dz):
    """Derivative of G(sign φ) (x, y, z) along δφ = (dx, dy, dz)."""
    a, b, c = phi[o], phi[o + 1], phi[o + 2]
    e, de = inverse_coefficient(a * a + b * b + c * c)
    de *= 2.0 * (a * dx + b * dy + c * dz)
    ux, uy, uz = cross(a, b, c, x, y, z)
    wx, wy, wz = cross(a, b, c, ux, uy, uz)
    px, py, pz = cross(dx, dy, dz, x, y, z)
    qx, qy, qz = cross(dx, dy, dz, ux, uy, uz)
    rx, ry, rz = cross(a, b, c, px, py, pz)
    h = 0.5 * sign
    return (
        -h * px + e * (qx + rx) + de * wx,
        -h * py + e * (qy + ry) + de * wy,
        -h * pz + e * (qz + rz) + de * wz,
    )


@kernel
def add_wrenches(mi, mj, f, wi, wj):
    """Add the wrenches of the pull f (6) to wi and wj (6 each)."""
    hx, hy, hz = separation(mi, mj)
    x, y, z = transform(mi["R"], f[0], f[1], f[2])
    mx, my, mz = transform(mi["R"], f[3], f[4], f[5])
    ax, ay, az = cross(hx, hy, hz, x, y, z)
    put(wi, 0, wi[0] + x, wi[1] + y, wi[2] + z)
    put(wi, 3, wi[3] + mx + ax, wi[4] + my + ay, wi[5] + mz + az)
    put(wj, 0, wj[0] - x, wj[1] - y, wj[2] - z)
    put(wj, 3, wj[3] - mx, wj[4] - my, wj[5] - mz)


@kernel
def _put_maps(mi, mj, E, D):
    """E, D (6, 12): relative motion, and relative velocity at constant velocities of the markers,
    per (δx_I, δφ_I, δx_J, δφ_J) in global axes."""
    Ri, om = mi["R"], mi["om"]
    hx, hy, hz = separation(mi, mj)
    sx, sy, sz = _velocity_from(mi, mj)
    wx, wy, wz = mj["om"][0] - om[0], mj["om"][1] - om[1], mj["om"][2] - om[2]
    for r in range(6):
        for c in range(12):
            E[r, c] = 0.0
            D[r, c] = 0.0
    for r in range(3):
        ax, ay, az = Ri[0, r], Ri[1, r], Ri[2, r]
        put(E[r], 0, -ax, -ay, -az)
        put(E[r], 6, ax, ay, az)
        x, y, z = cross(ax, ay, az, hx, hy, hz)
        put(E[r], 3, x, y, z)
        put(E[3 + r], 3, -ax, -ay, -az)
        put(E[3 + r], 9, ax, ay, az)
        x, y, z = cross(om[0], om[1], om[2], ax, ay, az)
        put(D[r], 0, -x, -y, -z)
        put(D[r], 6, x, y, z)
        x, y, z = cross(ax, ay, az, sx, sy, sz)
        put(D[r], 3, x, y, z)
        x, y, z = cross(ax, ay, az, wx, wy, wz)
        put(D[3 + r], 3, x, y, z)


@kernel
def add_tangent(mi, mj, s, damped, cv, cp, H):
    """Add −(cp ∂w/∂position + cv ∂w/∂velocity) of the wrenches of the pull s.f to H (12, 12).

    s.K and s.C are its changes with (δu, δθ) and (u̇, ω), δθ the turn of J from I in axes of I.
    Where there is damping s.W (12, 12) is that between the velocities of the markers.
    """
    E, D, K, C, S = s.E, s.D, s.K, s.C, s.S
    _put_maps(mi, mj, E, D)
    for r in range(6):
        for c in range(12):
            x = 0.0
            for k in range(6):
                x += cp * K[r, k] * E[k, c]
                if damped == 1:
                    x += C[r, k] * (cv * E[k, c] + cp * D[k, c])
            S[r, c] = x
    for i in range(12):
        for c in range(12):
            for r in range(6):
                H[i, c] += E[r, i] * S[r, c]
    if damped == 1:
        _put_damping(E, C, S, s.W)
    _add_turning(mi, mj, s.f, cp, H)


@kernel
def _put_damping(E, C, S, W):
    """W = Eᵀ C E; S (6, 12) is scratch."""
    for r in range(6):
        for c in range(12):
            x = 0.0
            for k in range(6):
                x += C[r, k] * E[k, c]
            S[r, c] = x
    for i in range(12):
        for c in range(12):
            x = 0.0
            for r in range(6):
                x += E[r, i] * S[r, c]
            W[i, c] = x


@kernel
def _add_turning(mi, mj, f, cp, H):
    """cp times what the turning of I's axes and the change of h do at a constant pull f."""
    hx, hy, hz = separation(mi, mj)
    x, y, z = transform(mi["R"], f[0], f[1], f[2])
    mx, my, mz = transform(mi["R"], f[3], f[4], f[5])
    add_skew(H, 0, 3, cp, x, y, z)
    add_skew(H, 6, 3, -cp, x, y, z)
    add_skew(H, 9, 3, -cp, mx, my, mz)
    add_skew(H, 3, 3, cp, mx, my, mz)
    add_skew(H, 3, 6, cp, x, y, z)
    add_skew(H, 3, 0, -cp, x, y, z)
    # h̃ F̃ = F hᵀ − (h·F) I
    dot = hx * x + hy * y + hz * z
    for k in range(3):
        H[3 + k, 3 + k] -= cp * dot
        h = hx if k == 0 else hy if k == 1 else hz
        H[3, 3 + k] += cp * x * h
        H[4, 3 + k] += cp * y * h
        H[5, 3 + k] += cp * z * h
