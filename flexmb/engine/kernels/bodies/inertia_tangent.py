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
from flexmb.engine.kernels.algebra.triple import (
    add_part,
    column,
    inner,
    outer,
    part,
    plus,
    put_part,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.kernels.algebra.vector import dot
from flexmb.engine.kernels.bodies.inertia import Bodies, less_trace, put_rate
from flexmb.engine.kernels.bodies.kinematics import modal_vector, mode_vector
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run


@kernel
def add_column(B, i, j, f, a):
    """Add f a to column j of B from row i."""
    B[i, j] += f * a[0]
    B[i + 1, j] += f * a[1]
    B[i + 2, j] += f * a[2]


@kernel
def add_skew(B, i, j, f, a):
    """Add f ã to the 3 × 3 block of B at (i, j)."""
    add_column(B, i, j, f, (0.0, a[2], -a[1]))
    add_column(B, i, j + 1, f, (-a[2], 0.0, a[0]))
    add_column(B, i, j + 2, f, (a[1], -a[0], 0.0))


@kernel
def _add_rotated_skew(B, f, A, a):
    """Add f A ã to the 3 × 3 block of B at (0, 3): the rows are those of A times a~."""
    for k in range(3):
        add_part(B[k], 3, f, outer(part(A[k], 0), a))


@unit
def put_frame_matrix(run: Run, i: int, at: Point, cv: float, cp: float) -> int:
    """dense.B[:6, :6] = M + cv ∂F/∂v + cp ∂F/∂q of the frame of body i, F its inertia forces."""
    parts, B, v, vd = run.system.parts, run.work.dense.B, at.v, at.vd
    body, bn, pool = parts.bodies[i], run.work.now.body[i], parts.pool
    A, J, c, iv, m = bn["A"], bn["J"], triple(bn["c"]), body["iv"], body["m"]
    for r in range(3):
        for k in range(3):
            B[r, k] = body["mass"] if r == k else 0.0
            B[r, 3 + k] = 0.0
            B[3 + r, 3 + k] = J[r, k]
    _add_rotated_skew(B, -1.0, A, c)
    for r in range(3):
        for k in range(3):
            B[3 + r, k] = B[k, 3 + r]
    om, e = part(v, iv + 3), part(vd, iv + 3)
    turning = plus(outer(om, c), 2.0, modal_vector(pool, body["flex"], m, v, iv + 6))
    if cv != 0.0:
        # ∂ A(ω×(ω×c) + 2ω×(p η̇))/∂ω = −A (ω×c + 2 p η̇)~ − A ω̃ c̃,  ω̃ c̃ = c ωᵀ − (ω·c) I
        _add_rotated_skew(B, -cv, A, turning)
        add_skew(B, 3, 3, -cv, turned(J, om))
        for k in range(3):
            x = plus(times(inner(om, c), column(A, k)), -v[iv + 3 + k], turned(A, c))
            add_column(B, 0, 3 + k, cv, x)
            add_column(B, 3, 3 + k, cv, outer(om, column(J, k)))
    if cp != 0.0:
        x = plus(plus(outer(om, turning), 1.0, outer(e, c)), 1.0,
                 modal_vector(pool, body["flex"], m, vd, iv + 6))  # fmt: skip
        _add_rotated_skew(B, -cp, A, x)
        # δ(c × a') = c̃ ã' δθ' = (a' cᵀ − (a'·c) I) δθ', a' = Aᵀ(r̈ − g)
        a = turned_back(A, plus(part(vd, iv), -1.0, triple(parts.gravity)))
        for k in range(3):
            B[3 + k, 3 + k] -= cp * inner(a, c)
            add_column(B, 3, 3 + k, cp * bn["c"][k], a)
    return FINE


@unit
def put_modal_matrix(run: Run, i: int, at: Point, cv: float, cp: float) -> int:
    """The same in rows and columns of the modes of body i; after its inertia stage and its frame.

    The rate of the integrals also enters the frame's own block of ∂F/∂v.
    """
    parts, now, B = run.system.parts, run.work.now, run.work.dense.B
    body, bn, pool, Z = parts.bodies[i], now.body[i], parts.pool, now.Z
    m, flex, zw = body["m"], body["flex"], body["z"] + 9 * body["m"]
    at_M = flex + 12 * m * (1 + m)
    for k in range(m):
        row = B[6 + k]
        put_part(row, 0, turned(bn["A"], mode_vector(pool, flex + k, m)))
        put_part(row, 3, mode_vector(Z, zw + k, m))
        for r in range(6):
            B[r, 6 + k] = row[r]
        for r in range(m):
            row[6 + r] = pool[at_M + k * m + r]
    if cv != 0.0 or cp != 0.0:
        a = plus(part(at.vd, body["iv"]), -1.0, triple(parts.gravity))
        _add_mode_columns(body, bn, turned_back(bn["A"], a), pool, Z, at.v, at.vd, cv, cp, B)
        _add_modal_block(body, pool, at.v, at.vd, cv, cp, B)
    return FINE


@unit
def rigid_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of rigid bodies, F their inertia forces."""
    rows = of.rows
    for n in range(rows.shape[0]):
        put_frame_matrix(run, rows[n], at, cv, cp)
        add_body_block(run, rows[n], run.work.dense.B)
    return FINE


@unit
def flexible_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of flexible bodies, F inertia, elastic and damping forces."""
    rows = of.rows
    for n in range(rows.shape[0]):
        put_frame_matrix(run, rows[n], at, cv, cp)
        put_modal_matrix(run, rows[n], at, cv, cp)
        add_body_block(run, rows[n], run.work.dense.B)
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
    rows, B, place = of.rows, run.work.dense.B, run.system.kkt.place
    for n in range(rows.shape[0]):
        body = run.system.parts.bodies[rows[n]]
        o, size = body["iv"], 6 + body["m"]
        put_frame_matrix(run, rows[n], at, 0.0, 0.0)
        put_modal_matrix(run, rows[n], at, 0.0, 0.0)
        for r in range(size):
            run.work.factor.sol[place[o + r]] = dot(B[r], 0, run.work.trial.res, o, size)
    return FINE


@kernel
def _multiply_rigid(body, bn, x, o, out, place):
    """m a + A(α × c) and c × Aᵀa + J α of a rigid body with x = (a, α)."""
    A, c, a, alpha = bn["A"], triple(bn["c"]), part(x, o), part(x, o + 3)
    force = plus(turned(A, outer(alpha, c)), body["mass"], a)
    moment = plus(turned(bn["J"], alpha), 1.0, outer(c, turned_back(A, a)))
    out[place[o]], out[place[o + 1]], out[place[o + 2]] = force
    out[place[o + 3]], out[place[o + 4]], out[place[o + 5]] = moment


@kernel
def _add_mode_columns(body, bn, a, pool, Z, v, vd, cv, cp, B):
    """What the modes change in the force and moment, and the frame in the modal forces.

    a = a'. δc = p_k; δJ = 2 tr(Z_k) − Z_k − Z_kᵀ, Z_k the 3 × 3 matrix of mode k, and with it
    2 (tr(Z_k) − Z_kᵀ) ω = δJ ω + ω × M_ωη,k; δV_ab = (M_ab η̇)_k, with M_ab at block 3 b + a of the
    pool. The derivative of Σ B_bc Z_cb with ω is −δJ ω.
    """
    m, iv, at, o, A, V = body["m"], body["iv"], body["flex"], body["iv"] + 6, bn["A"], bn["V"]
    at_M, z, size = at + 12 * m, body["z"], m * m
    at_G = at_M + 9 * size
    om, e = part(v, iv + 3), part(vd, iv + 3)
    put_rate(Z, z, 3 * m, m, v, o, m, V)
    for b in range(3):
        for c in range(3):
            B[3 + b, 3 + c] -= 2.0 * cv * V[c, b]
            B[3 + c, 3 + c] += 2.0 * cv * V[b, b]
    for k in range(m):
        p = mode_vector(pool, at + k, m)
        turning, pulled = outer(om, p), outer(p, a)
        force = plus(outer(om, turning), 1.0, outer(e, p))
        add_column(B, 0, 6 + k, 1.0, turned(A, plus(times(2.0 * cv, turning), cp, force)))
        put_rate(pool, at_M + k * m, size, 3 * size, v, o, m, V)
        moment = plus(pulled, 2.0, less_trace(V, om))
        trace = 0.0
        for b in range(3):
            trace += Z[z + 4 * b * m + k]
        for b in range(3):
            for c in range(3):
                V[b, c] = -Z[z + (3 * b + c) * m + k] - Z[z + (3 * c + b) * m + k]
            V[b, b] += 2.0 * trace
        spin = turned(V, om)  # δJ ω
        half = plus(spin, 1.0, outer(om, mode_vector(Z, z + 9 * m + k, m)))
        moment = plus(plus(moment, 1.0, outer(om, spin)), 1.0, turned(V, e))
        add_column(B, 3, 6 + k, 1.0, plus(times(cv, half), cp, moment))
        add_part(B[6 + k], 3, 1.0, plus(times(-cv, spin), cp, pulled))
        for b in range(3):
            row = at_G + (b * m + k) * m
            B[3 + b, 6 + k] += cp * dot(pool, row, vd, o, m)
            B[6 + k, 3 + b] -= 2.0 * cv * dot(pool, row, v, o, m)


@kernel
def _add_modal_block(body, pool, v, vd, cv, cp, B):
    """Modal rows with the modes: cp (K − Σ ω̇_b G_b + Σ B_bc M_bc) + cv (D − 2 Σ ω_b G_b)."""
    m, o, at = body["m"], body["iv"] + 3, body["flex"] + 12 * body["m"]
    om = part(v, o)
    square = inner(om, om)
    for b in range(5):  # blocks M_bc, then G_c, then M_ηη, K, D
        for c in range(3):
            if b < 3:
                f = cp * (v[o + b] * v[o + c] - (square if b == c else 0.0))
            elif b == 3:
                f = -2.0 * cv * v[o + c] - cp * vd[o + c]
            else:
                f = cp if c == 1 else cv if c == 2 else 0.0
            if f != 0.0:
                for k in range(m):
                    row = at + ((3 * b + c) * m + k) * m
                    for r in range(m):
                        B[6 + k, 6 + r] += f * pool[row + r]
