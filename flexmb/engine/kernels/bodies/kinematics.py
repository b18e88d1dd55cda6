"""Markers: position, velocity and acceleration bias, and how a wrench acts back on the body.

Rigid: p = r + A ρ. Flexible: p = r + A s, s = ρ + Φ_t η + E ŝ with E = exp(θ̃), θ = Φ_r η and an
arm ŝ that turns with its node; orientation A E R. With T = T(θ) the angular velocity in body axes
is ω' + Tᵀ Φ_r η̇ and a wrench (f, τ) acts on (r, orientation, η) as
(f, s × f' + τ', Φ_tᵀ f' + Φ_rᵀ T (τ' + E ŝ × f')), primes in body axes.
Names: mk, mn one row of the marker tables (constant, now); body, bn likewise of a body.
"""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.jit import kernel, unit
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
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.records import Integers, Vector
from flexmb.engine.state import Now, Point, Run
from flexmb.engine.tables import Parts


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


class Markers(NamedTuple):
    """Markers of one sort."""

    rows: Integers  # their rows in the table of markers


@unit
def place_rigid(run: Run, markers: Markers, at: Point) -> int:
    """Position and orientation of the markers on rigid places and on ground."""
    parts, now, q = run.system.parts, run.work.now, at.q
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], marker_now[rows[n]]
        b = mk["body"]
        if b < 0:
            _ground_position(mk, mn)
        else:
            _rigid_position(mk, mn, body_now[b]["A"], q, bodies[b]["iq"])
    return FINE


@unit
def place_flexible(run: Run, markers: Markers, at: Point) -> int:
    """Position and orientation of the markers that modes move."""
    parts, now, q = run.system.parts, run.work.now, at.q
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        body, A = bodies[mk["body"]], now.body[mk["body"]]["A"]
        _flexible_position(mk, mn, body["m"], parts.pool, q, body["iq"] + 7, A)
        s, iq = mn["s"], body["iq"]
        x, y, z = transform(A, s[0], s[1], s[2])
        put(mn["x"], 0, q[iq] + x, q[iq + 1] + y, q[iq + 2] + z)
    return FINE


@kernel
def _ground_position(mk, mn):
    for a in range(3):
        mn["x"][a] = mk["rho"][a]
        for c in range(3):
            mn["R"][a, c] = mk["R"][a, c]


@kernel
def _rigid_position(mk, mn, A, q, iq):
    R, rho, s, x, axes = mk["R"], mk["rho"], mn["s"], mn["x"], mn["R"]
    for a in range(3):
        s[a] = rho[a]
        x[a] = q[iq + a] + A[a, 0] * rho[0] + A[a, 1] * rho[1] + A[a, 2] * rho[2]
        for c in range(3):
            axes[a, c] = A[a, 0] * R[0, c] + A[a, 1] * R[1, c] + A[a, 2] * R[2, c]


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


@unit
def move_rigid(run: Run, markers: Markers, at: Point) -> int:
    """Velocity and angular velocity of the markers on rigid places, global axes."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], marker_now[rows[n]]
        b = mk["body"]
        if b < 0:
            put(mn["vx"], 0, 0.0, 0.0, 0.0)
            put(mn["om"], 0, 0.0, 0.0, 0.0)
            continue
        A, s, iv = body_now[b]["A"], mn["s"], bodies[b]["iv"]
        wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
        ux, uy, uz = cross(wx, wy, wz, s[0], s[1], s[2])
        ux, uy, uz = transform(A, ux, uy, uz)
        put(mn["vx"], 0, v[iv] + ux, v[iv + 1] + uy, v[iv + 2] + uz)
        wx, wy, wz = transform(A, wx, wy, wz)
        put(mn["om"], 0, wx, wy, wz)
    return FINE


@unit
def move_flexible(run: Run, markers: Markers, at: Point) -> int:
    """Velocity and angular velocity of the markers that modes move, global axes."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        body, A, s = bodies[mk["body"]], now.body[mk["body"]]["A"], mn["s"]
        iv = body["iv"]
        wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
        ux, uy, uz = cross(wx, wy, wz, s[0], s[1], s[2])
        dx, dy, dz, ex, ey, ez = _deformation_rates(mk, mn, body["m"], parts.pool, v, iv + 6)
        ux, uy, uz = transform(A, ux + dx, uy + dy, uz + dz)
        put(mn["vx"], 0, v[iv] + ux, v[iv + 1] + uy, v[iv + 2] + uz)
        wx, wy, wz = transform(A, wx + ex, wy + ey, wz + ez)
        put(mn["om"], 0, wx, wy, wz)
    return FINE


@unit
def bias_rigid(run: Run, markers: Markers, at: Point) -> int:
    """Acceleration of the markers on rigid places at zero v̇, global axes: point, angular."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        put(mn["bx"], 0, 0.0, 0.0, 0.0)
        put(mn["bom"], 0, 0.0, 0.0, 0.0)
        b = mk["body"]
        if b >= 0:
            A, s, iv = now.body[b]["A"], mn["s"], bodies[b]["iv"]
            wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
            cx, cy, cz = cross(wx, wy, wz, s[0], s[1], s[2])
            ax, ay, az = cross(wx, wy, wz, cx, cy, cz)
            ax, ay, az = transform(A, ax, ay, az)
            put(mn["bx"], 0, ax, ay, az)
    return FINE


@unit
def bias_flexible(run: Run, markers: Markers, at: Point) -> int:
    """Acceleration of the markers that modes move at zero v̇, global axes: point, angular."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        body, A, s = bodies[mk["body"]], now.body[mk["body"]]["A"], mn["s"]
        iv = body["iv"]
        wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
        cx, cy, cz = cross(wx, wy, wz, s[0], s[1], s[2])
        ax, ay, az = cross(wx, wy, wz, cx, cy, cz)
        dx, dy, dz, ox, oy, oz = _deformation_rates(mk, mn, body["m"], parts.pool, v, iv + 6)
        cx, cy, cz = cross(wx, wy, wz, dx, dy, dz)
        ex, ey, ez = cross(wx, wy, wz, ox, oy, oz)
        tx, ty, tz = _tangent_rate(mk, mn, body["m"], parts.pool, v, iv + 6)
        px, py, pz = _arm_bias(mn["arm"], ox, oy, oz, tx, ty, tz)
        ax, ay, az = transform(A, ax + 2.0 * cx + px, ay + 2.0 * cy + py, az + 2.0 * cz + pz)
        put(mn["bx"], 0, ax, ay, az)
        ex, ey, ez = transform(A, ex + tx, ey + ty, ez + tz)
        put(mn["bom"], 0, ex, ey, ez)
    return FINE


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


@unit
def add_pulled_back(
    parts: Parts, now: Now, k: int, w: Vector, i: int, f: float, out: Vector, o: int
) -> int:
    """out[o:o+6+m] += f Jᵀ w[i:i+6] for marker k; w = (force, moment) in global axes."""
    _pull_back(parts, now, k, w, i, f, out, o)
    return FINE


@kernel
def _pull_back(parts, now, k, w, i, f, out, o):
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
        add_modal_forces(parts, now, k, fx, fy, fz, tx, ty, tz, out, o + 6)


@unit
def add_modal_forces(
    parts: Parts,
    now: Now,
    k: int,
    fx: float,
    fy: float,
    fz: float,
    tx: float,
    ty: float,
    tz: float,
    out: Vector,
    o: int,
) -> int:
    """out[o:o+m] += what a force and a moment in body axes on marker k do to the modes."""
    mk, mn = parts.markers[k], now.marker[k]
    m = parts.bodies[mk["body"]]["m"]
    at, arm, th = mk["modes"], mn["arm"], mn["th"]
    mx, my, mz = cross(arm[0], arm[1], arm[2], fx, fy, fz)
    tx, ty, tz = tangent(th[0], th[1], th[2], tx + mx, ty + my, tz + mz)
    pool = parts.pool
    for j in range(m):
        s = pool[at + j] * fx + pool[at + m + j] * fy
        s += pool[at + 2 * m + j] * fz + pool[at + 3 * m + j] * tx
        out[o + j] += s + pool[at + 4 * m + j] * ty + pool[at + 5 * m + j] * tz
    return FINE


@unit
def clear_wrenches(run: Run, markers: Markers, at: Point) -> int:
    """No wrench on any marker."""
    rows, marker_now = markers.rows, run.work.now.marker
    for n in range(rows.shape[0]):
        W = marker_now[rows[n]]["W"]
        for c in range(6):
            W[c] = 0.0
    return FINE


@unit
def subtract_wrenches(run: Run, markers: Markers, at: Point) -> int:
    """Trial.res −= generalised forces of the wrenches of all markers."""
    parts, now, out = run.system.parts, run.work.now, run.work.trial.res
    rows, table, bodies, marker_now = markers.rows, parts.markers, parts.bodies, now.marker
    for n in range(rows.shape[0]):
        b = table[rows[n]]["body"]
        if b >= 0:
            o = bodies[b]["iv"]
            _pull_back(parts, now, rows[n], marker_now[rows[n]]["W"], 0, -1.0, out, o)
    return FINE


RIGID_MARKERS = Kind(
    "rigid_markers",
    Markers,
    {
        "position": place_rigid,
        "velocity": move_rigid,
        "bias": bias_rigid,
        "wrench": clear_wrenches,
        "force": subtract_wrenches,
    },
)
FLEXIBLE_MARKERS = Kind(
    "flexible_markers",
    Markers,
    {
        "position": place_flexible,
        "velocity": move_flexible,
        "bias": bias_flexible,
        "wrench": clear_wrenches,
        "force": subtract_wrenches,
    },
)
