"""Inertia of rigid and flexible bodies with full coupling, from second-moment integrals.

With x = s + N η in body axes, Z_ab = ∫ρ x_a N_b = P_ab + M_ba η, S_ab = ∫ρ x_a x_b,
J = tr(S) I − S, c = ∫ρ x = S1 + p η, and a' = Aᵀ(r̈ − g), B = ω̃'²:

    force    m (r̈ − g) + A (ω̇'×c + ω'×(ω'×c) + 2 ω'×(p η̇) + p η̈)
    moment   c × a' + J ω̇' + ω'×J ω' + M_ωη η̈ + 2 (tr(V) − Vᵀ) ω',   V_ab = Z_ab·η̇
    modes    p_bᵀ a'_b + M_ωηᵀ ω̇' + M_ηη η̈ + Σ B_bc Z_cb − 2 Σ ω'_k G_k η̇ + Kη + Dη̇

M_ωη has the row x: Z_yz − Z_zy and cyclic; G_x = M_yz − M_zy and cyclic. A rigid body is the case
of no modes. Gravity enters as an acceleration of the frame, so it needs no force of its own.
Exact for solids, beams and shells (Shabana, Dynamics of Multibody Systems, 4th ed., §5.4, written
with second moments).
"""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import (
    cross,
    rotation_matrix,
    transform,
    transform_back,
)
from flexmb.engine.kernels.algebra.vector import dot, put
from flexmb.engine.kernels.bodies.kinematics import modal_vector
from flexmb.engine.method import FINE
from flexmb.engine.records import Integers
from flexmb.engine.state import Point, Run


class Bodies(NamedTuple):
    """Bodies of one sort; other records of bodies begin with the same field."""

    rows: Integers  # their rows in the table of bodies


@kernel
def add_product(pool, at, m, v, o, f, out, oo):
    """out[oo:oo+m] += f × (m × m block of the pool at `at`) v[o:o+m]."""
    for i in range(m):
        s = 0.0
        row = at + i * m
        for j in range(m):
            s += pool[row + j] * v[o + j]
        out[oo + i] += f * s


@unit
def turn_bodies(run: Run, of: Bodies, at: Point) -> int:
    """Direction cosines of the bodies."""
    bodies, body_now, rows, q = run.system.parts.bodies, run.work.now.body, of.rows, at.q
    for n in range(rows.shape[0]):
        rotation_matrix(q, bodies[rows[n]]["iq"] + 3, body_now[rows[n]]["A"])
    return FINE


@kernel
def _put_inertia(J):
    """From second moments, J = tr(S) I − S."""
    trace = J[0, 0] + J[1, 1] + J[2, 2]
    for a in range(3):
        for b in range(3):
            J[a, b] = (trace if a == b else 0.0) - J[a, b]


@kernel
def _put_rigid_moments(body, bn):
    """c and S of the undeformed body."""
    J, c, S0, S1 = bn["J"], bn["c"], body["S0"], body["S1"]
    for a in range(3):
        c[a] = S1[a]
        for b in range(3):
            J[a, b] = S0[a, b]


@kernel
def prepare_bodies(bodies, body_now, rows):
    """J and c of undeformed bodies."""
    for n in range(rows.shape[0]):
        _put_rigid_moments(bodies[rows[n]], body_now[rows[n]])
        _put_inertia(body_now[rows[n]]["J"])


@unit
def prepare_rigid(run: Run, of: Bodies, at: Point) -> int:
    """J and c of rigid bodies, which never change."""
    prepare_bodies(run.system.parts.bodies, run.work.now.body, of.rows)
    return FINE


@unit
def prepare_flexible(run: Run, of: Bodies, at: Point) -> int:
    """J, c, Z and M_ωη of flexible bodies at q."""
    parts, now, rows = run.system.parts, run.work.now, of.rows
    for n in range(rows.shape[0]):
        body, bn = parts.bodies[rows[n]], now.body[rows[n]]
        _put_rigid_moments(body, bn)
        _add_deformation(body, bn["J"], bn["c"], parts.pool, now.Z, at.q)
        _put_inertia(bn["J"])
    return FINE


@kernel
def _add_deformation(body, S, c, pool, Z, q):
    """Z and M_ωη of a flexible body, and what η adds to its first and second moments."""
    m, z, eta = body["m"], body["z"], body["iq"] + 7
    at_P = body["flex"] + 3 * m
    at_M = at_P + 9 * m
    cx, cy, cz = modal_vector(pool, body["flex"], m, q, eta)
    put(c, 0, c[0] + cx, c[1] + cy, c[2] + cz)
    for k in range(9 * m):
        Z[z + k] = pool[at_P + k]
    for k in range(9):
        add_product(pool, at_M + k * m * m, m, q, eta, 1.0, Z, z + k * m)
    for a in range(3):
        for b in range(a, 3):
            s = dot(pool, at_P + (3 * b + a) * m, q, eta, m)
            s += dot(Z, z + (3 * a + b) * m, q, eta, m)
            S[a, b] += s
            if a != b:
                S[b, a] += s
        j, k = (a + 1) % 3, (a + 2) % 3
        zj, zk, zw = z + (3 * j + k) * m, z + (3 * k + j) * m, z + (9 + a) * m
        for i in range(m):
            Z[zw + i] = Z[zj + i] - Z[zk + i]


@unit
def rigid_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity of rigid bodies."""
    parts, body_now, out, rows = run.system.parts, run.work.now.body, run.work.trial.res, of.rows
    bodies, g, v, vd = parts.bodies, parts.gravity, at.v, at.vd
    for n in range(rows.shape[0]):
        body, bn = bodies[rows[n]], body_now[rows[n]]
        _rigid_forces(body, bn, g, v, vd, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, out)
    return FINE


@unit
def flexible_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity + elastic and damping forces of such bodies."""
    parts, now, out, rows = run.system.parts, run.work.now, run.work.trial.res, of.rows
    q, v, vd = at.q, at.v, at.vd
    for n in range(rows.shape[0]):
        body, bn = parts.bodies[rows[n]], now.body[rows[n]]
        flex, m, o = body["flex"], body["m"], body["iv"] + 6
        ux, uy, uz = modal_vector(parts.pool, flex, m, v, o)
        wx, wy, wz = modal_vector(parts.pool, flex, m, vd, o)
        _rigid_forces(body, bn, parts.gravity, v, vd, ux, uy, uz, wx, wy, wz, out)
        _add_relative_moment(body, now.Z, v, vd, out)
        _modal_forces(body, bn, parts, now.Z, q, v, vd, out)
    return FINE


@kernel
def _rigid_forces(body, bn, g, v, vd, ux, uy, uz, px, py, pz, out):
    """Force and moment rows of the frame; u = p η̇, p = p η̈."""
    iv, mass, A, J, c = body["iv"], body["mass"], bn["A"], bn["J"], bn["c"]
    wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
    ex, ey, ez = vd[iv + 3], vd[iv + 4], vd[iv + 5]
    ax, ay, az = vd[iv] - g[0], vd[iv + 1] - g[1], vd[iv + 2] - g[2]
    hx, hy, hz = transform(J, wx, wy, wz)
    gx, gy, gz = cross(wx, wy, wz, hx, hy, hz)
    tx, ty, tz = transform(J, ex, ey, ez)
    qx, qy, qz = cross(wx, wy, wz, c[0], c[1], c[2])
    fx, fy, fz = cross(wx, wy, wz, qx + 2.0 * ux, qy + 2.0 * uy, qz + 2.0 * uz)
    qx, qy, qz = cross(ex, ey, ez, c[0], c[1], c[2])
    fx, fy, fz = transform(A, fx + qx + px, fy + qy + py, fz + qz + pz)
    put(out, iv, mass * ax + fx, mass * ay + fy, mass * az + fz)
    ax, ay, az = transform_back(A, ax, ay, az)
    qx, qy, qz = cross(c[0], c[1], c[2], ax, ay, az)
    put(out, iv + 3, tx + gx + qx, ty + gy + qy, tz + gz + qz)


@kernel
def _add_relative_moment(body, Z, v, vd, out):
    """Moment row += M_ωη η̈ + 2 (tr(V) − Vᵀ) ω' with V_ab = Z_ab·η̇."""
    m, iv, z = body["m"], body["iv"], body["z"]
    o = iv + 6
    trace = 0.0
    for a in range(3):
        trace += dot(Z, z + 4 * a * m, v, o, m)
        out[iv + 3 + a] += dot(Z, z + (9 + a) * m, vd, o, m)
    for b in range(3):
        s = trace * v[iv + 3 + b]
        for c in range(3):
            s -= v[iv + 3 + c] * dot(Z, z + (3 * c + b) * m, v, o, m)
        out[iv + 3 + b] += 2.0 * s


@kernel
def _modal_forces(body, bn, parts, Z, q, v, vd, out):
    """Modal rows: inertia, weight, centrifugal, Coriolis, elastic and damping terms."""
    m, iv, at, z = body["m"], body["iv"], body["flex"], body["z"]
    pool, g, o, eta = parts.pool, parts.gravity, body["iv"] + 6, body["iq"] + 7
    at_G = at + 12 * m + 9 * m * m
    at_M = at_G + 3 * m * m
    ax, ay, az = transform_back(bn["A"], vd[iv] - g[0], vd[iv + 1] - g[1], vd[iv + 2] - g[2])
    ex, ey, ez = vd[iv + 3], vd[iv + 4], vd[iv + 5]
    zw = z + 9 * m
    for i in range(m):
        s = pool[at + i] * ax + pool[at + m + i] * ay + pool[at + 2 * m + i] * az
        s += Z[zw + i] * ex + Z[zw + m + i] * ey + Z[zw + 2 * m + i] * ez
        out[o + i] = s
    add_product(pool, at_M, m, vd, o, 1.0, out, o)
    add_product(pool, at_M + m * m, m, q, eta, 1.0, out, o)
    if body["damped"] == 1:
        add_product(pool, at_M + 2 * m * m, m, v, o, 1.0, out, o)
    w2 = v[iv + 3] * v[iv + 3] + v[iv + 4] * v[iv + 4] + v[iv + 5] * v[iv + 5]
    for b in range(3):
        wb = v[iv + 3 + b]
        if wb != 0.0:
            add_product(pool, at_G + b * m * m, m, v, o, -2.0 * wb, out, o)
        for c in range(3):
            f = wb * v[iv + 3 + c] - (w2 if b == c else 0.0)
            zc = z + (3 * c + b) * m
            if f != 0.0:
                for i in range(m):
                    out[o + i] += f * Z[zc + i]
