"""Markers: position, velocity and acceleration bias, and how a wrench acts back on the body.

Rigid: p = r + A ρ. Flexible: p = r + A s, s = ρ + Φ_t η + E ŝ with E = exp(θ̃), θ = Φ_r η and an
arm ŝ that turns with its node; orientation A E R. With T = T(θ) the angular velocity in body axes
is ω' + Tᵀ Φ_r η̇ and a wrench (f, τ) acts on (r, orientation, η) as
(f, s × f' + τ', Φ_tᵀ f' + Φ_rᵀ T (τ' + E ŝ × f')), primes in body axes.
Names: mk, mn one row of the marker tables (constant, now); body, bn likewise of a body.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import (
    compose,
    cross,
    rotation_matrix,
    tangent,
    tangent_coefficients,
    tangent_transposed,
    transform,
    transform_back,
)
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.joints import slider


@kernel
def modal_vector(pool, at, m, v, o):
    """Three rows of the pool, starting at `at`, times v[o:o+m]."""
    a = 0.0
    b = 0.0
    c = 0.0
    for j in range(m):
        y = v[o + j]
        a += pool[at + j] * y
        b += pool[at + m + j] * y
        c += pool[at + 2 * m + j] * y
    return a, b, c


@kernel
def position(parts, now, q):
    """Body rotations and the position and orientation of every marker."""
    for i in range(parts.bodies.shape[0]):
        rotation_matrix(q, parts.bodies[i]["iq"] + 3, now.body[i]["A"])
    for k in range(parts.markers.shape[0]):
        mk, mn = parts.markers[k], now.marker[k]
        if mk["body"] < 0:
            _ground_position(mk, mn)
        elif mk["modes"] < 0:
            _rigid_position(mk, mn, now.body[mk["body"]]["A"])
        else:
            body = parts.bodies[mk["body"]]
            A = now.body[mk["body"]]["A"]
            _flexible_position(mk, mn, body["m"], parts.pool, q, body["iq"] + 7, A)
        if mk["body"] >= 0:
            iq = parts.bodies[mk["body"]]["iq"]
            s = mn["s"]
            x, y, z = transform(now.body[mk["body"]]["A"], s[0], s[1], s[2])
            put(mn["x"], 0, q[iq] + x, q[iq + 1] + y, q[iq + 2] + z)
    slider.place(parts.sliders, parts, now, q)


@kernel
def _ground_position(mk, mn):
    for a in range(3):
        mn["x"][a] = mk["rho"][a]
        for c in range(3):
            mn["R"][a, c] = mk["R"][a, c]


@kernel
def _rigid_position(mk, mn, A):
    R = mk["R"]
    for a in range(3):
        mn["s"][a] = mk["rho"][a]
        for c in range(3):
            mn["R"][a, c] = A[a, 0] * R[0, c] + A[a, 1] * R[1, c] + A[a, 2] * R[2, c]


@kernel
def _flexible_position(mk, mn, m, pool, q, eta, A):
    E, p, at = mn["E"], mn["p"], mk["modes"]
    ux, uy, uz = modal_vector(pool, at, m, q, eta)
    tx, ty, tz = modal_vector(pool, at + 3 * m, m, q, eta)
    put(mn["th"], 0, tx, ty, tz)
    p[0] = 1.0
    put(p, 1, 0.0, 0.0, 0.0)
    compose(p, 0, tx, ty, tz, p, 0)
    rotation_matrix(p, 0, E)
    ax, ay, az = transform(E, mk["arm"][0], mk["arm"][1], mk["arm"][2])
    put(mn["arm"], 0, ax, ay, az)
    rho = mk["rho"]
    put(mn["s"], 0, rho[0] + ux + ax, rho[1] + uy + ay, rho[2] + uz + az)
    R = mk["R"]
    for c in range(3):
        x, y, z = transform(E, R[0, c], R[1, c], R[2, c])
        mn["R"][0, c], mn["R"][1, c], mn["R"][2, c] = transform(A, x, y, z)


@kernel
def _deformation_rates(mk, mn, m, pool, v, o):
    """Velocity of a flexible marker from η̇ alone, body axes: (of the point, angular)."""
    th, arm = mn["th"], mn["arm"]
    ux, uy, uz = modal_vector(pool, mk["modes"], m, v, o)
    tx, ty, tz = modal_vector(pool, mk["modes"] + 3 * m, m, v, o)
    wx, wy, wz = tangent_transposed(th[0], th[1], th[2], tx, ty, tz)
    cx, cy, cz = cross(wx, wy, wz, arm[0], arm[1], arm[2])
    return ux + cx, uy + cy, uz + cz, wx, wy, wz


@kernel
def velocity(parts, now, v):
    """Velocity and angular velocity of every marker, global axes."""
    for k in range(parts.markers.shape[0]):
        mk, mn = parts.markers[k], now.marker[k]
        if mk["body"] < 0:
            put(mn["vx"], 0, 0.0, 0.0, 0.0)
            put(mn["om"], 0, 0.0, 0.0, 0.0)
            continue
        body, A, s = parts.bodies[mk["body"]], now.body[mk["body"]]["A"], mn["s"]
        iv = body["iv"]
        wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
        ux, uy, uz = cross(wx, wy, wz, s[0], s[1], s[2])
        if mk["modes"] >= 0:
            dx, dy, dz, ex, ey, ez = _deformation_rates(mk, mn, body["m"], parts.pool, v, iv + 6)
            ux, uy, uz = ux + dx, uy + dy, uz + dz
            wx, wy, wz = wx + ex, wy + ey, wz + ez
        ux, uy, uz = transform(A, ux, uy, uz)
        put(mn["vx"], 0, v[iv] + ux, v[iv + 1] + uy, v[iv + 2] + uz)
        wx, wy, wz = transform(A, wx, wy, wz)
        put(mn["om"], 0, wx, wy, wz)
    slider.add_velocities(parts.sliders, parts, now, v)


@kernel
def bias(parts, now, v):
    """Acceleration of every marker at zero v̇, global axes: of the point, angular."""
    for k in range(parts.markers.shape[0]):
        mk, mn = parts.markers[k], now.marker[k]
        if mk["body"] < 0:
            put(mn["bx"], 0, 0.0, 0.0, 0.0)
            put(mn["bom"], 0, 0.0, 0.0, 0.0)
            continue
        body, A, s = parts.bodies[mk["body"]], now.body[mk["body"]]["A"], mn["s"]
        iv = body["iv"]
        wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
        cx, cy, cz = cross(wx, wy, wz, s[0], s[1], s[2])
        ax, ay, az = cross(wx, wy, wz, cx, cy, cz)
        ex, ey, ez = 0.0, 0.0, 0.0
        if mk["modes"] >= 0:
            dx, dy, dz, ox, oy, oz = _deformation_rates(mk, mn, body["m"], parts.pool, v, iv + 6)
            cx, cy, cz = cross(wx, wy, wz, dx, dy, dz)
            ex, ey, ez = cross(wx, wy, wz, ox, oy, oz)
            tx, ty, tz = _tangent_rate(mk, mn, body["m"], parts.pool, v, iv + 6)
            ex, ey, ez = ex + tx, ey + ty, ez + tz
            px, py, pz = _arm_bias(mn["arm"], ox, oy, oz, tx, ty, tz)
            ax, ay, az = ax + 2.0 * cx + px, ay + 2.0 * cy + py, az + 2.0 * cz + pz
        ax, ay, az = transform(A, ax, ay, az)
        put(mn["bx"], 0, ax, ay, az)
        ex, ey, ez = transform(A, ex, ey, ez)
        put(mn["bom"], 0, ex, ey, ez)
    slider.add_bias(parts.sliders, parts, now, v)


@kernel
def _tangent_rate(mk, mn, m, pool, v, o):
    """Ṫᵀ θ̇ in body axes."""
    rx, ry, rz = modal_vector(pool, mk["modes"] + 3 * m, m, v, o)
    tx, ty, tz = mn["th"][0], mn["th"][1], mn["th"][2]
    _, c2, d1, d2 = tangent_coefficients(tx * tx + ty * ty + tz * tz)
    rate = 2.0 * (tx * rx + ty * ry + tz * rz)
    ux, uy, uz = cross(tx, ty, tz, rx, ry, rz)
    wx, wy, wz = cross(tx, ty, tz, ux, uy, uz)
    px, py, pz = cross(rx, ry, rz, ux, uy, uz)
    return (
        rate * (d1 * ux + d2 * wx) + c2 * px,
        rate * (d1 * uy + d2 * wy) + c2 * py,
        rate * (d1 * uz + d2 * wz) + c2 * pz,
    )


@kernel
def _arm_bias(arm, ox, oy, oz, tx, ty, tz):
    """ω_E × (ω_E × arm) + (Ṫᵀ θ̇) × arm."""
    ux, uy, uz = cross(ox, oy, oz, arm[0], arm[1], arm[2])
    ax, ay, az = cross(ox, oy, oz, ux, uy, uz)
    bx, by, bz = cross(tx, ty, tz, arm[0], arm[1], arm[2])
    return ax + bx, ay + by, az + bz


@kernel
def add_pulled_back(parts, now, k, w, i, f, out, o):
    """out[o:o+6+m] += f Jᵀ w[i:i+6] for marker k; w = (force, moment) in global axes."""
    mk, mn = parts.markers[k], now.marker[k]
    A, s = now.body[mk["body"]]["A"], mn["s"]
    x, y, z = f * w[i], f * w[i + 1], f * w[i + 2]
    out[o] += x
    out[o + 1] += y
    out[o + 2] += z
    fx, fy, fz = transform_back(A, x, y, z)
    tx, ty, tz = transform_back(A, f * w[i + 3], f * w[i + 4], f * w[i + 5])
    mx, my, mz = cross(s[0], s[1], s[2], fx, fy, fz)
    out[o + 3] += mx + tx
    out[o + 4] += my + ty
    out[o + 5] += mz + tz
    if mk["modes"] >= 0:
        m = parts.bodies[mk["body"]]["m"]
        at, arm, th = mk["modes"], mn["arm"], mn["th"]
        mx, my, mz = cross(arm[0], arm[1], arm[2], fx, fy, fz)
        tx, ty, tz = tangent(th[0], th[1], th[2], tx + mx, ty + my, tz + mz)
        pool = parts.pool
        for j in range(m):
            out[o + 6 + j] += pool[at + j] * fx + pool[at + m + j] * fy
            out[o + 6 + j] += pool[at + 2 * m + j] * fz + pool[at + 3 * m + j] * tx
            out[o + 6 + j] += pool[at + 4 * m + j] * ty + pool[at + 5 * m + j] * tz


@kernel
def clear_wrenches(now):
    """No wrench on any marker."""
    for k in range(now.marker.shape[0]):
        W = now.marker[k]["W"]
        for c in range(6):
            W[c] = 0.0


@kernel
def subtract_wrenches(parts, now, out):
    """out (nv) −= generalised forces of the wrenches of all markers."""
    for k in range(parts.markers.shape[0]):
        b = parts.markers[k]["body"]
        if b >= 0:
            o = parts.bodies[b]["iv"]
            add_pulled_back(parts, now, k, now.marker[k]["W"], o - o, -1.0, out, o)
