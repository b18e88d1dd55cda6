"""Mass matrix and tangents of the inertia forces of one body, written into a dense block.

Columns and rows follow v of the body: (r, ω', η). The mass block is M; the velocity tangent the
derivative of the inertia forces with v (gyroscopic and damping terms); the position tangent that
with the configuration at constant v and v̇: elastic and centrifugal stiffness, the turning of
inertia forces and weight with the body, and the change of the integrals with the deformation.
All exact.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.blocks import add_body_block
from flexmb.engine.kernels.algebra.rotation import cross, transform, transform_back
from flexmb.engine.kernels.algebra.vector import dot
from flexmb.engine.kernels.bodies.inertia import Bodies
from flexmb.engine.kernels.bodies.kinematics import modal_vector
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run


@kernel
def add_column(B, i, j, f, x, y, z):
    """Add f (x, y, z) to column j of B from row i."""
    B[i, j] += f * x
    B[i + 1, j] += f * y
    B[i + 2, j] += f * z


@kernel
def add_skew(B, i, j, f, x, y, z):
    """Add f (x, y, z)~ to the 3 × 3 block of B at (i, j)."""
    add_column(B, i, j, f, 0.0, z, -y)
    add_column(B, i, j + 1, f, -z, 0.0, x)
    add_column(B, i, j + 2, f, y, -x, 0.0)


@kernel
def add_rotated_skew(B, i, j, f, A, x, y, z):
    """Add f A (x, y, z)~ to the 3 × 3 block of B at (i, j)."""
    for k in range(3):
        B[i + k, j] += f * (A[k, 1] * z - A[k, 2] * y)
        B[i + k, j + 1] += f * (A[k, 2] * x - A[k, 0] * z)
        B[i + k, j + 2] += f * (A[k, 0] * y - A[k, 1] * x)


@kernel
def rigid_mass_block(body, bn, B):
    """B[:6, :6] = M of one body without its modes; needs its inertia stage."""
    A, c, J = bn["A"], bn["c"], bn["J"]
    for i in range(6):
        for j in range(6):
            B[i, j] = 0.0
    for i in range(3):
        B[i, i] = body["mass"]
    add_rotated_skew(B, 0, 3, -1.0, A, c[0], c[1], c[2])
    for i in range(3):
        for j in range(3):
            B[3 + i, 3 + j] = J[i, j]
            B[3 + j, i] = B[i, 3 + j]


@kernel
def flexible_mass_block(body, bn, pool, Z, B):
    """B (6+m, 6+m) = M of one body; needs its inertia stage."""
    m, at, A = body["m"], body["flex"], bn["A"]
    rigid_mass_block(body, bn, B)
    zw = body["z"] + 9 * m
    at_M = at + 12 * m + 12 * m * m
    for k in range(m):
        x, y, z = transform(A, pool[at + k], pool[at + m + k], pool[at + 2 * m + k])
        B[0, 6 + k], B[1, 6 + k], B[2, 6 + k] = x, y, z
        B[3, 6 + k], B[4, 6 + k], B[5, 6 + k] = Z[zw + k], Z[zw + m + k], Z[zw + 2 * m + k]
        for i in range(6):
            B[6 + k, i] = B[i, 6 + k]
        for i in range(m):
            B[6 + k, 6 + i] = pool[at_M + k * m + i]


@unit
def rigid_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of rigid bodies, F their inertia forces."""
    parts, now, rows, B = run.system.parts, run.work.now, of.rows, run.work.dense.B
    bodies, body_now, v, vd, g = parts.bodies, now.body, at.v, at.vd, parts.gravity
    for n in range(rows.shape[0]):
        body, bn = bodies[rows[n]], body_now[rows[n]]
        rigid_mass_block(body, bn, B)
        if cv != 0.0:
            _add_velocity_tangent(body, bn, v, 0.0, 0.0, 0.0, cv, B)
        if cp != 0.0:
            _add_position_tangent(body, bn, g, v, vd, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, cp, B)
        add_body_block(run, rows[n], B)
    return FINE


@unit
def flexible_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of flexible bodies, F inertia, elastic and damping forces."""
    parts, now, rows = run.system.parts, run.work.now, of.rows
    B, v, vd = run.work.dense.B, at.v, at.vd
    for n in range(rows.shape[0]):
        body, bn = parts.bodies[rows[n]], now.body[rows[n]]
        m, o, flex = body["m"], body["iv"] + 6, body["flex"]
        flexible_mass_block(body, bn, parts.pool, now.Z, B)
        ux, uy, uz = modal_vector(parts.pool, flex, m, v, o)
        if cv != 0.0:
            _add_velocity_tangent(body, bn, v, ux, uy, uz, cv, B)
            _add_flexible_velocity_tangent(body, bn["A"], parts.pool, now.Z, v, cv, B)
        if cp != 0.0:
            wx, wy, wz = modal_vector(parts.pool, flex, m, vd, o)
            px, py, pz = _add_position_tangent(
                body, bn, parts.gravity, v, vd, ux, uy, uz, wx, wy, wz, cp, B
            )
            _add_modal_stiffness(body, parts.pool, v, vd, px, py, pz, cp, B)
            _add_frame_columns(body, bn["A"], parts.pool, now.Z, v, vd, cp, B)
        add_body_block(run, rows[n], B)
    return FINE


@unit
def rigid_mass_product(run: Run, of: Bodies, at: Point) -> int:
    """Factor.sol = M Trial.res of rigid bodies."""
    bodies, body_now, rows = run.system.parts.bodies, run.work.now.body, of.rows
    x, out, place = run.work.trial.res, run.work.factor.sol, run.system.kkt.place
    for n in range(rows.shape[0]):
        _multiply_rigid(bodies[rows[n]], body_now[rows[n]], x, bodies[rows[n]]["iv"], out, place)
    return FINE


@unit
def flexible_mass_product(run: Run, of: Bodies, at: Point) -> int:
    """Factor.sol = M Trial.res of flexible bodies."""
    parts, now, rows, B = run.system.parts, run.work.now, of.rows, run.work.dense.B
    x, out, place = run.work.trial.res, run.work.factor.sol, run.system.kkt.place
    for n in range(rows.shape[0]):
        body = parts.bodies[rows[n]]
        o, size = body["iv"], 6 + body["m"]
        flexible_mass_block(body, now.body[rows[n]], parts.pool, now.Z, B)
        for r in range(size):
            s = 0.0
            for c in range(size):
                s += B[r, c] * x[o + c]
            out[place[o + r]] = s
    return FINE


@kernel
def _multiply_rigid(body, bn, x, o, out, place):
    """m a + A(α × c) and c × Aᵀa + J α of a rigid body with x = (a, α)."""
    A, J, c = bn["A"], bn["J"], bn["c"]
    fx, fy, fz = cross(x[o + 3], x[o + 4], x[o + 5], c[0], c[1], c[2])
    fx, fy, fz = transform(A, fx, fy, fz)
    ax, ay, az = transform_back(A, x[o], x[o + 1], x[o + 2])
    tx, ty, tz = cross(c[0], c[1], c[2], ax, ay, az)
    hx, hy, hz = transform(J, x[o + 3], x[o + 4], x[o + 5])
    out[place[o]] = body["mass"] * x[o] + fx
    out[place[o + 1]] = body["mass"] * x[o + 1] + fy
    out[place[o + 2]] = body["mass"] * x[o + 2] + fz
    out[place[o + 3]] = tx + hx
    out[place[o + 4]] = ty + hy
    out[place[o + 5]] = tz + hz


@kernel
def _add_velocity_tangent(body, bn, v, dx, dy, dz, f, B):
    """Add f ∂(inertia forces)/∂v of the frame to B; (dx, dy, dz) = p η̇."""
    iv, A, J, c = body["iv"], bn["A"], bn["J"], bn["c"]
    wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
    ux, uy, uz = cross(wx, wy, wz, c[0], c[1], c[2])
    ux, uy, uz = ux + 2.0 * dx, uy + 2.0 * dy, uz + 2.0 * dz
    # ∂ A(ω×(ω×c) + 2ω×u̇)/∂ω = −A (ω×c + 2u̇)~ − A ω̃ c̃,  ω̃ c̃ = c ωᵀ − (ω·c) I
    add_rotated_skew(B, 0, 3, -f, A, ux, uy, uz)
    wc = wx * c[0] + wy * c[1] + wz * c[2]
    gx, gy, gz = transform(A, c[0], c[1], c[2])
    for k in range(3):
        wk = v[iv + 3 + k]
        add_column(B, 0, 3 + k, -f * wk, gx, gy, gz)
        add_column(B, 0, 3 + k, f * wc, A[0, k], A[1, k], A[2, k])
        x, y, z = cross(wx, wy, wz, J[0, k], J[1, k], J[2, k])
        add_column(B, 3, 3 + k, f, x, y, z)
    hx, hy, hz = transform(J, wx, wy, wz)
    add_skew(B, 3, 3, -f, hx, hy, hz)


@kernel
def _add_flexible_velocity_tangent(body, A, pool, Z, v, f, B):
    m, iv, at, z = body["m"], body["iv"], body["flex"], body["z"]
    o = iv + 6
    wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
    at_G = at + 12 * m + 9 * m * m
    at_D = at_G + 5 * m * m
    for b in range(3):
        for c in range(3):
            B[3 + b, 3 + c] -= 2.0 * f * dot(Z, z + (3 * c + b) * m, v, o, m)
            B[3 + c, 3 + c] += 2.0 * f * dot(Z, z + 4 * b * m, v, o, m)
    for k in range(m):
        # ∂/∂η̇ of 2 A ω×(p η̇)
        dx, dy, dz = cross(wx, wy, wz, pool[at + k], pool[at + m + k], pool[at + 2 * m + k])
        dx, dy, dz = transform(A, dx, dy, dz)
        add_column(B, 0, 6 + k, 2.0 * f, dx, dy, dz)
        trace = Z[z + k] + Z[z + 4 * m + k] + Z[z + 8 * m + k]
        for b in range(3):
            # ∂/∂η̇ of 2 (tr(V) − Vᵀ) ω, and ∂B_bc/∂ω_a Z_cb = Z_ca ω_c + Z_ac ω_c − 2 ω_a Z_cc
            s = 2.0 * trace * v[iv + 3 + b]
            u = -s
            for c in range(3):
                zcb, zbc = Z[z + (3 * c + b) * m + k], Z[z + (3 * b + c) * m + k]
                s -= 2.0 * zcb * v[iv + 3 + c]
                u += (zcb + zbc) * v[iv + 3 + c]
            B[3 + b, 6 + k] += f * s
            B[6 + k, 3 + b] += f * (u - 2.0 * dot(pool, at_G + (b * m + k) * m, v, o, m))
        for c in range(m):
            i = k * m + c
            s = wx * pool[at_G + i] + wy * pool[at_G + m * m + i]
            s += wz * pool[at_G + 2 * m * m + i]
            B[6 + k, 6 + c] += f * (pool[at_D + i] - 2.0 * s)


@kernel
def _add_position_tangent(body, bn, g, v, vd, dx, dy, dz, hx, hy, hz, f, B):
    """Add f ∂(inertia forces)/∂(r, θ') of the frame to B; returns Aᵀ(r̈ − g).

    (dx, dy, dz) = p η̇, (hx, hy, hz) = p η̈.
    """
    iv, A, c = body["iv"], bn["A"], bn["c"]
    wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
    ux, uy, uz = cross(wx, wy, wz, c[0], c[1], c[2])
    ex, ey, ez = cross(vd[iv + 3], vd[iv + 4], vd[iv + 5], c[0], c[1], c[2])
    fx, fy, fz = cross(wx, wy, wz, ux + 2.0 * dx, uy + 2.0 * dy, uz + 2.0 * dz)
    add_rotated_skew(B, 0, 3, -f, A, fx + ex + hx, fy + ey + hy, fz + ez + hz)
    px, py, pz = transform_back(A, vd[iv] - g[0], vd[iv + 1] - g[1], vd[iv + 2] - g[2])
    # δ(c × Aᵀa) = c̃ ã' δθ' = (a' cᵀ − (a'·c) I) δθ'
    pc = px * c[0] + py * c[1] + pz * c[2]
    for k in range(3):
        B[3 + k, 3 + k] -= f * pc
        add_column(B, 3, 3 + k, f * c[k], px, py, pz)
    return px, py, pz


@kernel
def _add_modal_stiffness(body, pool, v, vd, px, py, pz, f, B):
    """Modal rows; and in the moment rows the first moment moving under a' = (px, py, pz)."""
    m, iv, at = body["m"], body["iv"], body["flex"]
    at_M = at + 12 * m
    at_G = at_M + 9 * m * m
    at_K = at_M + 13 * m * m
    w2 = v[iv + 3] * v[iv + 3] + v[iv + 4] * v[iv + 4] + v[iv + 5] * v[iv + 5]
    for k in range(m):
        # p_k·(a' × δθ') in the modal rows and δc × a' in the moment rows
        ux, uy, uz = cross(pool[at + k], pool[at + m + k], pool[at + 2 * m + k], px, py, pz)
        add_column(B, 3, 6 + k, f, ux, uy, uz)
        B[6 + k, 3] += f * ux
        B[6 + k, 4] += f * uy
        B[6 + k, 5] += f * uz
        for c in range(m):
            B[6 + k, 6 + c] += f * pool[at_K + k * m + c]
    for b in range(3):
        # ω̇·δM_ωη: −ω̇_b G_b
        s = -f * vd[iv + 3 + b]
        if s != 0.0:
            _add_block(pool, at_G + b * m * m, m, s, B)
        for e in range(3):
            # Σ B_be M_be; the pool holds M_be at row block 3 e + b
            s = f * (v[iv + 3 + b] * v[iv + 3 + e] - (w2 if b == e else 0.0))
            if s != 0.0:
                _add_block(pool, at_M + (3 * e + b) * m * m, m, s, B)


@kernel
def _add_block(pool, at, m, f, B):
    """Add f × (m × m block of the pool at `at`) to the modal block of B."""
    for k in range(m):
        for c in range(m):
            B[6 + k, 6 + c] += f * pool[at + k * m + c]


@kernel
def _add_frame_columns(body, A, pool, Z, v, vd, f, B):
    """Force and moment rows: c, J, M_ωη and V change with η."""
    m, iv, at, z = body["m"], body["iv"], body["flex"], body["z"]
    o = iv + 6
    at_M = at + 12 * m
    at_G = at_M + 9 * m * m
    wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
    ex, ey, ez = vd[iv + 3], vd[iv + 4], vd[iv + 5]
    for k in range(m):
        # δc = p_k: A (ω̇×p_k + ω×(ω×p_k))
        x, y, z3 = pool[at + k], pool[at + m + k], pool[at + 2 * m + k]
        ux, uy, uz = cross(wx, wy, wz, x, y, z3)
        ux, uy, uz = cross(wx, wy, wz, ux, uy, uz)
        hx, hy, hz = cross(ex, ey, ez, x, y, z3)
        x, y, z3 = transform(A, ux + hx, uy + hy, uz + hz)
        add_column(B, 0, 6 + k, f, x, y, z3)
        # δJ = tr(δS) I − δS, δS_ab = Z_ab + Z_ba: δJ ω̇ + ω×δJ ω
        trace = 2.0 * (Z[z + k] + Z[z + 4 * m + k] + Z[z + 8 * m + k])
        hx, hy, hz = _times_symmetric(Z, z + k, m, wx, wy, wz)
        ux, uy, uz = cross(hx, hy, hz, wx, wy, wz)
        hx, hy, hz = _times_symmetric(Z, z + k, m, ex, ey, ez)
        ux, uy, uz = ux + trace * ex - hx, uy + trace * ey - hy, uz + trace * ez - hz
        add_column(B, 3, 6 + k, f, ux, uy, uz)
        # δM_ωη η̈ = G η̈, and 2 (tr(δV) − δVᵀ) ω with δV_ab = (M_ab η̇)_k
        trace = 0.0
        for a in range(3):
            trace += dot(pool, at_M + (4 * a * m + k) * m, v, o, m)
        for b in range(3):
            s = trace * v[iv + 3 + b]
            for c in range(3):
                s -= dot(pool, at_M + ((3 * b + c) * m + k) * m, v, o, m) * v[iv + 3 + c]
            B[3 + b, 6 + k] += f * (2.0 * s + dot(pool, at_G + (b * m + k) * m, vd, o, m))


@kernel
def _times_symmetric(Z, z, m, x, y, w):
    """(Z + Zᵀ)(x, y, w) with Z_ab at z + (3 a + b) m."""
    xy = Z[z + m] + Z[z + 3 * m]
    xz = Z[z + 2 * m] + Z[z + 6 * m]
    yz = Z[z + 5 * m] + Z[z + 7 * m]
    return (
        2.0 * Z[z] * x + xy * y + xz * w,
        xy * x + 2.0 * Z[z + 4 * m] * y + yz * w,
        xz * x + yz * y + 2.0 * Z[z + 8 * m] * w,
    )
