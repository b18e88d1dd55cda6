"""Flexible bodies whose inertia is coupled with the deformation to order zero or one.

With the integrals of `flexible_body` and the rigid inertia of the undeformed body, J0, S1:

Constant coupling keeps S1, S0, p, W and M_ηη, W = P_yz − P_zy and cyclic: the mass matrix of the
undeformed body, and of velocity terms those of the rigid body alone,

    force    m a + A (ω̇×S1 + ω×(ω×S1) + p η̈)
    moment   S1×a' + J0 ω̇ + ω×J0 ω + W η̈
    modes    pᵀa' + Wᵀω̇ + M_ηη η̈ + Kη + Dη̇

In mean axes p = W = 0: the rigid body and its modes are coupled only by joints and forces; energy
½ vᵀM v + V and the angular momentum of the undeformed body are conserved.

Partial coupling adds c = S1 + p η, J = J0 + tr(S) I − S with S_ab = (P_ab + P_ba) η, and all
velocity terms that are linear in the deformation:

    moment   2 (tr(V) − Vᵀ) ω' = J̇ ω' + ω' × W η̇,   V_ab = P_ab·η̇
    modes    Σ B_bc (P_cb + M_bc η) − 2 Σ ω'_k G_k η̇,   Σ B_bc P_cb = −½ ω'ᵀ (∂J/∂η) ω'

Terms of second order of the deformation in the inertia are left out: M_bc in J, M_ωη and V. Energy
and angular momentum are conserved except for terms of that order. In mean axes the velocity terms
enter the iteration matrix only if the body rotates by more than a few degrees in a step.
Source: Shabana, Dynamics of Multibody Systems, 4th ed., §5.4; for the orders Padilla & von Flotow,
J. Guidance 15 (1992) 131.
"""

from __future__ import annotations

from flexmb.engine.algebra.ldl import add_body_block
from flexmb.engine.algebra.vector import (
    add_column,
    add_part,
    cross,
    inner,
    modal_vector,
    mode_vector,
    part,
    plus,
    put_part,
    symmetric_times,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.bodies.flexible_body import (
    add_modal_product,
    add_modal_rate,
    add_product,
    damping_power,
    flexible_energies,
    multiply_block,
)
from flexmb.engine.bodies.rigid_body import (
    Bodies,
    prepare_rigid,
    put_frame_forces,
    put_frame_matrix,
    turn_bodies,
)
from flexmb.engine.bodies.velocity_forms import (
    add_inertia_rate,
    add_velocity_block,
    add_velocity_forces,
    place_of_inertia_change,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Point, Run

# Velocity terms of partial coupling enter the iteration matrix if they change it by more than this
# share of the mass matrix.
_NEGLIGIBLE = 0.05


@unit
def prepare_constant(run: Run, of: Bodies, at: Point) -> int:
    """Set J0 and S1, and P and W in place of the integrals that depend on the deformation."""
    parts, Z, rows = run.system.parts, run.work.now.Z, of.rows
    prepare_rigid(run, of, at)
    for n in range(rows.shape[0]):
        body = parts.bodies[rows[n]]
        m, z, P = body["m"], body["z"], body["flex"] + 3 * body["m"]
        for k in range(9 * m):
            Z[z + k] = parts.pool[P + k]
        for a in range(3):
            j, k = (a + 1) % 3, (a + 2) % 3
            for i in range(m):
                Z[z + (9 + a) * m + i] = Z[z + (3 * j + k) * m + i] - Z[z + (3 * k + j) * m + i]
    return SUCCESS


@unit
def prepare_partial(run: Run, of: Bodies, at: Point) -> int:
    """J and c to first order in the deformation."""
    parts, now, rows, q = run.system.parts, run.work.now, of.rows, at.q
    pool = parts.pool
    prepare_rigid(run, of, at)
    for n in range(rows.shape[0]):
        body, bn = parts.bodies[rows[n]], now.body[rows[n]]
        m, eta, J = body["m"], body["iq"] + 7, bn["J"]
        if body["attached"] == 1:
            c = plus(triple(bn["c"]), 1.0, modal_vector(pool, body["flex"], m, q, eta))
            put_part(bn["c"], 0, c)
        change = place_of_inertia_change(body)
        straight = modal_vector(pool, change, m, q, eta)
        mixed = modal_vector(pool, change + 3 * m, m, q, eta)
        for a in range(3):
            b = a + 1 if a < 2 else 0
            J[a, a] += straight[a]
            J[a, b] += mixed[a]
            J[b, a] += mixed[a]
    return SUCCESS


@kernel
def _put_undeformed_forces(run, i, at, p_rate):
    """Rows of body i with the mass matrix of partial or constant coupling, weight and elasticity.

    `p_rate`: number of modes whose rates act on the frame through p.
    """
    parts, now, out, v, vd = run.system.parts, run.work.now, run.work.trial.res, at.v, at.vd
    body, bn, pool = parts.bodies[i], now.body[i], parts.pool
    m, iv, flex, zw = body["m"], body["iv"], body["flex"], body["z"] + 9 * body["m"]
    o = iv + 6
    put_frame_forces(run, i, at, p_rate if body["attached"] == 1 else 0)
    for k in range(m):
        out[o + k] = 0.0
    if body["attached"] == 1:
        if p_rate == 0:
            add_part(out, iv, 1.0, turned(bn["A"], modal_vector(pool, flex, m, vd, o)))
        add_product(now.Z, zw, 3, m, vd, o, 1.0, out, iv + 3)
        a = turned_back(bn["A"], plus(part(vd, iv), -1.0, triple(parts.gravity)))
        e = part(vd, iv + 3)
        for k in range(m):
            out[o + k] += inner(mode_vector(pool, flex + k, m), a)
            out[o + k] += inner(mode_vector(now.Z, zw + k, m), e)
    add_modal_product(body, pool, at.q, v, vd, out)


@unit
def constant_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms of the rigid body + gravity, elasticity and damping."""
    for n in range(of.rows.shape[0]):
        _put_undeformed_forces(run, of.rows[n], at, 0)
    return SUCCESS


@unit
def partial_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res with all velocity terms that are linear in the deformation."""
    parts, now, out, q, v = run.system.parts, run.work.now, run.work.trial.res, at.q, at.v
    for n in range(of.rows.shape[0]):
        body = parts.bodies[of.rows[n]]
        m, iv = body["m"], body["iv"]
        om = part(v, iv + 3)
        _put_undeformed_forces(run, of.rows[n], at, m)
        if inner(om, om) == 0.0:
            continue
        if body["attached"] == 1:  # 2 (tr(V) − Vᵀ) ω' = J̇ ω' + ω' × W η̇
            turning = modal_vector(now.Z, body["z"] + 9 * m, m, v, iv + 6)
            add_part(out, iv + 3, 1.0, cross(om, turning))
        add_inertia_rate(body, parts.pool, v, om, out)
        add_velocity_forces(body, now, q, v, om, parts.pool, out)
    return SUCCESS


@unit
def put_undeformed_matrix(run: Run, i: int, at: Point, cv: float, cp: float, partial: int) -> int:
    """dense.B = M + cv ∂F/∂v + cp ∂F/∂q of body i, without velocity terms of the modal rows."""
    parts, now, B, vd = run.system.parts, run.work.now, run.work.dense.B, at.vd
    body, bn, pool, Z = parts.bodies[i], now.body[i], parts.pool, now.Z
    m, iv, flex, z, A = body["m"], body["iv"], body["flex"], body["z"], bn["A"]
    o, at_M = iv + 6, flex + 12 * m
    put_frame_matrix(run, i, at, cv, cp, m if partial == 1 else 0)
    for k in range(m):
        for r in range(6):
            B[r, 6 + k] = B[6 + k, r] = 0.0
        for r in range(m):
            n = at_M + k * m + r
            B[6 + k, 6 + r] = pool[n] + cp * pool[n + m * m] + cv * pool[n + 2 * m * m]
    a = turned_back(A, plus(part(vd, iv), -1.0, triple(parts.gravity)))
    if body["attached"] == 1:
        for k in range(m):
            p, w = mode_vector(pool, flex + k, m), mode_vector(Z, z + 9 * m + k, m)
            put_part(B[6 + k], 0, turned(A, p))
            put_part(B[6 + k], 3, plus(w, cp, cross(p, a)))
            add_column(B, 0, 6 + k, 1.0, turned(A, p))
            add_column(B, 3, 6 + k, 1.0, w)
        if cp != 0.0 and partial == 0:
            x = modal_vector(pool, flex, m, vd, o)
            for r in range(3):
                add_part(B[r], 3, -cp, cross(part(A[r], 0), x))
    return SUCCESS


@kernel
def _add_partial_columns(run, i, at, cv, cp, B):
    """Derivatives of force and moment by the modes, and of modal forces by ω'.

    As in `flexible_body`, with Z = P.
    """
    parts, now, v, vd = run.system.parts, run.work.now, at.v, at.vd
    body, bn, pool, Z = parts.bodies[i], now.body[i], parts.pool, now.Z
    m, iv, flex, z, A, V = body["m"], body["iv"], body["flex"], body["z"], bn["A"], bn["V"]
    change, om, e = place_of_inertia_change(body), part(v, iv + 3), part(vd, iv + 3)
    a = turned_back(A, plus(part(vd, iv), -1.0, triple(parts.gravity)))
    add_modal_rate(pool, flex + 3 * m, m, v, iv + 6, V, cv, B)
    for k in range(m):
        p = mode_vector(pool, flex + k, m)
        turning = cross(om, p)
        force = plus(cross(om, turning), 1.0, cross(e, p))
        add_column(B, 0, 6 + k, 1.0, turned(A, plus(times(2.0 * cv, turning), cp, force)))
        straight, mixed = mode_vector(pool, change + k, m), mode_vector(pool, change + 3 * m + k, m)
        spin = symmetric_times(straight, mixed, om)  # ∂J/∂η_k ω'
        half = plus(spin, 1.0, cross(om, mode_vector(Z, z + 9 * m + k, m)))
        moment = plus(plus(cross(p, a), 1.0, cross(om, spin)), 1.0,
                      symmetric_times(straight, mixed, e))  # fmt: skip
        add_column(B, 3, 6 + k, 1.0, plus(times(cv, half), cp, moment))
        add_part(B[6 + k], 3, -cv, spin)


@kernel
def _add_sparse_block(run, i, at, cv, cp):
    """M + cv ∂F/∂v + cp ∂F/∂q of a body in mean axes with diagonal modes, into the panel."""
    kkt, low, up, parts = run.system.kkt, run.work.factor.low, run.work.factor.up, run.system.parts
    body, B, pool = parts.bodies[i], run.work.dense.B, parts.pool
    panel, column, o = kkt.panels[body["panel"]], kkt.column, body["iv"]
    put_frame_matrix(run, i, at, cv, cp, 0)
    top, nc, m = panel["at"], panel["nc"], body["m"]
    for r in range(6):
        pr = column[o + r]
        for c in range(6):
            pc = column[o + c]
            if pr >= pc and pc >= 0:
                low[top + pr * nc + pc] += B[r, c]
            if 0 <= pr <= pc:
                up[top + pc * nc + pr] += B[r, c]
    size = m * m
    for k in range(m):
        at_M = body["flex"] + 12 * m + k * (m + 1)
        value = pool[at_M] + cp * pool[at_M + size] + cv * pool[at_M + 2 * size]
        place = top + column[o + 6 + k] * (nc + 1)
        low[place] += value
        up[place] += value


@kernel
def _is_sparse(body):
    return body["attached"] == 0 and body["diagonal"] == 1 and body["damped"] != 1


@unit
def constant_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of bodies with constant coupling."""
    for n in range(of.rows.shape[0]):
        if _is_sparse(run.system.parts.bodies[of.rows[n]]):
            _add_sparse_block(run, of.rows[n], at, cv, cp)
        else:
            put_undeformed_matrix(run, of.rows[n], at, cv, cp, 0)
            add_body_block(run, of.rows[n], run.work.dense.B)
    return SUCCESS


@unit
def partial_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of bodies with partial coupling."""
    B, parts = run.work.dense.B, run.system.parts
    for n in range(of.rows.shape[0]):
        i = of.rows[n]
        body = parts.bodies[i]
        om = part(at.v, body["iv"] + 3)
        square = inner(om, om)
        fast = abs(cp) * square > _NEGLIGIBLE or cv * cv * square > _NEGLIGIBLE**2
        if _is_sparse(body) and not fast:
            _add_sparse_block(run, i, at, cv, cp)
            continue
        put_undeformed_matrix(run, i, at, cv, cp, 1)
        if fast or (body["attached"] == 1 and (cv != 0.0 or cp != 0.0)):
            _add_partial_columns(run, i, at, cv, cp, B)
        if fast:
            add_velocity_block(body, parts.pool, at.q, at.v, cv, cp, run.work.now.Z, B)
        add_body_block(run, i, B)
    return SUCCESS


@unit
def undeformed_mass_product(run: Run, of: Bodies, at: Point) -> int:
    """Factor.sol = M Trial.res of bodies with constant or partial coupling.

    M has the same form for both; J and c of partial coupling are those of `prepare_partial`.
    """
    for n in range(of.rows.shape[0]):
        put_undeformed_matrix(run, of.rows[n], at, 0.0, 0.0, 0)
        multiply_block(run, of.rows[n])
    return SUCCESS


CONSTANT_BODIES = Kind(
    "constant_bodies",
    Bodies,
    {
        "constants": prepare_constant,
        "position": turn_bodies,
        "force": constant_inertia_forces,
        "matrix": constant_matrix,
        "mass": undeformed_mass_product,
        "energy": flexible_energies,
        "power": damping_power,
    },
    stiff=True,
)
PARTIAL_BODIES = Kind(
    "partial_bodies",
    Bodies,
    {
        "constants": prepare_constant,
        "position": turn_bodies,
        "inertia": prepare_partial,
        "force": partial_inertia_forces,
        "matrix": partial_matrix,
        "mass": undeformed_mass_product,
        "energy": flexible_energies,
        "power": damping_power,
    },
    stiff=True,
)
