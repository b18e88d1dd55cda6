"""Inertia of flexible bodies with full coupling, from second-moment integrals.

With x = s + N η in body axes, Z_ab = ∫ρ x_a N_b = P_ab + M_ba η, c = S1 + p η, B = ω̃'² and the
frame of `rigid_body`, the modes add

    moment   M_ωη η̈ + 2 (tr(V) − Vᵀ) ω',   V_ab = Z_ab·η̇
    modes    p_bᵀ a'_b + M_ωηᵀ ω̇' + M_ηη η̈ + Σ B_bc Z_cb − 2 Σ ω'_k G_k η̇ + Kη + Dη̇

M_ωη has the row x: Z_yz − Z_zy and cyclic; G_x = M_yz − M_zy and cyclic. Exact for solids, beams
and shells (Shabana, Dynamics of Multibody Systems, 4th ed., §5.4, written with second moments).
With geometric stiffening, M_ab is reduced by the geometric stiffness K_ab of the centrifugal loads
(not in M_ηη). The same numbers stiffen the body and change its inertia: energy is conserved.

The tangents are exact. The mass tangent is M. The velocity tangent is the derivative of the inertia
forces by v: gyroscopic and damping terms. The position tangent is their derivative by the
configuration at constant v and v̇: elastic and centrifugal stiffness, the rotation of inertia forces
and weight with the body, and the change of the integrals with the deformation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.engine.algebra.forms import grouped_rows
from flexmb.engine.algebra.ldl import add_body_block
from flexmb.engine.algebra.vector import (
    add_column,
    add_part,
    cross,
    dot,
    inner,
    modal_vector,
    mode_vector,
    part,
    plus,
    put_part,
    rows_times,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.bodies.membrane_forces import membrane_energy
from flexmb.engine.bodies.rigid_body import (
    Array,
    Bodies,
    frame_energy,
    prepare_rigid,
    put_frame_forces,
    put_frame_matrix,
    rigid_energies,
    turn_bodies,
)
from flexmb.engine.jit import Vector, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import DAMPER_POWER, KINETIC_ENERGY, STRAIN_ENERGY, Point, Run
from flexmb.engine.tables import whole_vectors

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody


# Angular velocity about a body axis, over the largest component, that is round-off: after a
# thousand steps of a planar motion it is 1e-16 to 2e-15.
_SPIN_ROUND_OFF = 1e-13


@unit
def add_product(
    pool: Vector, at: int, n: int, m: int, v: Vector, o: int, f: float, out: Vector, oo: int
) -> int:
    """out[oo:oo+n] += f × (n × m block of the pool at `at`) v[o:o+m]."""
    for i in range(n):
        out[oo + i] += f * dot(pool, at + i * m, v, o, m)
    return SUCCESS


@unit
def prepare_flexible(run: Run, of: Bodies, at: Point) -> int:
    """J, c, Z and M_ωη of flexible bodies at q."""
    parts, now, rows = run.system.parts, run.work.now, of.rows
    pool, Z, q = parts.pool, now.Z, at.q
    prepare_rigid(run, of, at)
    for n in range(rows.shape[0]):
        body, J, c = parts.bodies[rows[n]], now.body[rows[n]]["J"], now.body[rows[n]]["c"]
        m, z, eta = body["m"], body["z"], body["iq"] + 7
        at_P = body["flex"] + 3 * m
        for k in range(9 * m):
            Z[z + k] = pool[at_P + k]
        add_product(pool, at_P + 9 * m + 3 * m * m, 9 * m, m, q, eta, 1.0, Z, z)
        for a in range(3):
            c[a] += dot(pool, body["flex"] + a * m, q, eta, m)
            for b in range(3):
                s = dot(pool, at_P + (3 * b + a) * m, q, eta, m)
                s += dot(Z, z + (3 * a + b) * m, q, eta, m)
                J[a, b] -= s
                if a == b:
                    for d in range(3):
                        J[d, d] += s
            j, k = (a + 1) % 3, (a + 2) % 3
            zj, zk, zw = z + (3 * j + k) * m, z + (3 * k + j) * m, z + (9 + a) * m
            for i in range(m):
                Z[zw + i] = Z[zj + i] - Z[zk + i]
    return SUCCESS


@unit
def flexible_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity + elastic and damping forces of such bodies."""
    parts, now, out, rows = run.system.parts, run.work.now, run.work.trial.res, of.rows
    for n in range(rows.shape[0]):
        put_frame_forces(run, rows[n], at, parts.bodies[rows[n]]["m"])
        body, bn = parts.bodies[rows[n]], now.body[rows[n]]
        _put_modal_forces(body, bn, parts, now.Z, at.q, at.v, at.vd, out)
    return SUCCESS


@kernel
def put_modal_rate(a, at, i, j, v, o, m, V):
    """V (3, 3): V_ab = m numbers of a from at + i a + j b on, times v[o:o+m]."""
    for r in range(3):
        put_part(V[r], 0, rows_times(a, at + i * r, j, m, v, o))


@kernel
def add_modal_rate(a, at, m, v, o, V, cv, B):
    """V_ab = a_ab v[o:o+m], nine rows of a; add cv ∂(2 (tr(V) − Vᵀ) ω')/∂ω' to B of the frame."""
    put_modal_rate(a, at, 3 * m, m, v, o, m, V)
    for b in range(3):
        for c in range(3):
            B[3 + b, 3 + c] -= 2.0 * cv * V[c, b]
            B[3 + c, 3 + c] += 2.0 * cv * V[b, b]


@kernel
def less_trace(V, x):
    """tr(V) x − Vᵀ x."""
    return plus(times(V[0, 0] + V[1, 1] + V[2, 2], x), -1.0, turned_back(V, x))


@kernel
def add_modal_product(body, pool, q, v, vd, out):
    """Modal rows += M_ηη η̈ + K η + D η̇."""
    m, o, iq, size = body["m"], body["iv"] + 6, body["iq"] + 7, body["m"] * body["m"]
    at = body["flex"] + 12 * m
    if body["diagonal"] == 1:
        for i in range(m):
            k = at + i * (m + 1)
            out[o + i] += pool[k] * vd[o + i] + pool[k + size] * q[iq + i]
    else:
        add_product(pool, at, m, m, vd, o, 1.0, out, o)
        add_product(pool, at + size, m, m, q, iq, 1.0, out, o)
    if body["damped"] == 2:
        for i in range(m):
            out[o + i] += pool[at + 2 * size + i * (m + 1)] * v[o + i]
    elif body["damped"] == 1:
        add_product(pool, at + 2 * size, m, m, v, o, 1.0, out, o)


@kernel
def least_turn(om):
    """Angular velocity about a body axis below which it is round-off of the largest component."""
    return _SPIN_ROUND_OFF * max(abs(om[0]), abs(om[1]), abs(om[2]))


@kernel
def _put_modal_forces(body, bn, parts, Z, q, v, vd, out):
    """Modal rows: inertia, weight, centrifugal, Coriolis, elastic and damping terms.

    Adds M_ωη η̈ + 2 (tr(V) − Vᵀ) ω' to the moment rows, with V_ab = Z_ab·η̇.
    """
    m, iv, at, z, V = body["m"], body["iv"], body["flex"], body["z"], bn["V"]
    pool, o, zw, size = parts.pool, iv + 6, z + 9 * m, m * m
    a = turned_back(bn["A"], plus(part(vd, iv), -1.0, triple(parts.gravity)))
    e, om = part(vd, iv + 3), part(v, iv + 3)
    put_modal_rate(Z, z, 3 * m, m, v, o, m, V)
    add_part(out, iv + 3, 2.0, less_trace(V, om))
    add_product(Z, zw, 3, m, vd, o, 1.0, out, iv + 3)
    for i in range(m):
        out[o + i] = inner(mode_vector(pool, at + i, m), a) + inner(mode_vector(Z, zw + i, m), e)
    add_modal_product(body, pool, q, v, vd, out)
    at_G = at + 12 * m + 12 * size
    square, least = inner(om, om), least_turn(om)
    for b in range(3):
        if abs(v[iv + 3 + b]) > least:
            add_product(pool, at_G + b * size, m, m, v, o, -2.0 * v[iv + 3 + b], out, o)
        for c in range(3):
            f = v[iv + 3 + b] * v[iv + 3 + c] - (square if b == c else 0.0)
            if f != 0.0:
                for i in range(m):
                    out[o + i] += f * Z[z + (3 * c + b) * m + i]


@unit
def put_modal_matrix(run: Run, i: int, at: Point, cv: float, cp: float) -> int:
    """dense.B = M + cv ∂F/∂v + cp ∂F/∂q of body i: rows and columns of the modes.

    To be called after its inertia stage and after the block of its frame (`put_frame_matrix`), to
    which the rates of the integrals add terms of ∂F/∂v.
    """
    parts, now, B = run.system.parts, run.work.now, run.work.dense.B
    body, bn, pool, Z = parts.bodies[i], now.body[i], parts.pool, now.Z
    m, flex, zw = body["m"], body["flex"], body["z"] + 9 * body["m"]
    at_M = flex + 12 * m
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
    return SUCCESS


@unit
def flexible_matrix(run: Run, of: Bodies, at: Point, cv: float, cp: float) -> int:
    """Add M + cv ∂F/∂v + cp ∂F/∂q of flexible bodies, F inertia, elastic and damping forces."""
    rows = of.rows
    for n in range(rows.shape[0]):
        put_frame_matrix(run, rows[n], at, cv, cp, run.system.parts.bodies[rows[n]]["m"])
        put_modal_matrix(run, rows[n], at, cv, cp)
        add_body_block(run, rows[n], run.work.dense.B)
    return SUCCESS


@kernel
def multiply_block(run, i):
    """Rows of body i in Factor.sol = dense.B times its rows in Trial.res."""
    body, B, place = run.system.parts.bodies[i], run.work.dense.B, run.system.kkt.place
    o, size = body["iv"], 6 + body["m"]
    for r in range(size):
        run.work.factor.sol[place[o + r]] = dot(B[r], 0, run.work.trial.res, o, size)


@unit
def flexible_mass_product(run: Run, of: Bodies, at: Point) -> int:
    """Factor.sol = M Trial.res of flexible bodies."""
    for n in range(of.rows.shape[0]):
        put_frame_matrix(run, of.rows[n], at, 0.0, 0.0, run.system.parts.bodies[of.rows[n]]["m"])
        put_modal_matrix(run, of.rows[n], at, 0.0, 0.0)
        multiply_block(run, of.rows[n])
    return SUCCESS


@kernel
def _add_mode_columns(body, bn, a, pool, Z, v, vd, cv, cp, B):
    """Blocks of B that couple frame and modes: derivatives of force, moment and modal forces.

    a = a'. δc = p_k; δJ = 2 tr(Z_k) − Z_k − Z_kᵀ, Z_k the 3 × 3 matrix of mode k, and with it
    2 (tr(Z_k) − Z_kᵀ) ω = δJ ω + ω × M_ωη,k; δV_ab = (M_ab η̇)_k, with M_ab at block 3 b + a of the
    pool. The derivative of Σ B_bc Z_cb with ω is −δJ ω.
    """
    m, iv, at, o, A, V = body["m"], body["iv"], body["flex"], body["iv"] + 6, bn["A"], bn["V"]
    z, size = body["z"], m * m
    at_M = at + 12 * m + 3 * size
    at_G = at_M + 9 * size
    om, e = part(v, iv + 3), part(vd, iv + 3)
    add_modal_rate(Z, z, m, v, o, V, cv, B)
    for k in range(m):
        p = mode_vector(pool, at + k, m)
        turning, pulled = cross(om, p), cross(p, a)
        force = plus(cross(om, turning), 1.0, cross(e, p))
        add_column(B, 0, 6 + k, 1.0, turned(A, plus(times(2.0 * cv, turning), cp, force)))
        put_modal_rate(pool, at_M + k * m, size, 3 * size, v, o, m, V)
        moment = plus(pulled, 2.0, less_trace(V, om))
        trace = 0.0
        for b in range(3):
            trace += Z[z + 4 * b * m + k]
        for b in range(3):
            for c in range(3):
                V[b, c] = -Z[z + (3 * b + c) * m + k] - Z[z + (3 * c + b) * m + k]
            V[b, b] += 2.0 * trace
        spin = turned(V, om)  # δJ ω
        half = plus(spin, 1.0, cross(om, mode_vector(Z, z + 9 * m + k, m)))
        moment = plus(plus(moment, 1.0, cross(om, spin)), 1.0, turned(V, e))
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
    for b in range(5):  # blocks M_ηη, K, D, then M_bc, then G_c
        for c in range(3):
            if b == 0:
                f = cp if c == 1 else cv if c == 2 else 0.0
            elif b < 4:
                f = cp * (v[o + b - 1] * v[o + c] - (square if b - 1 == c else 0.0))
            else:
                f = -2.0 * cv * v[o + c] - cp * vd[o + c]
            if f != 0.0:
                for k in range(m):
                    row = at + ((3 * b + c) * m + k) * m
                    for r in range(m):
                        B[6 + k, 6 + r] += f * pool[row + r]


@kernel
def _modal_form(parts, i, block, x, o):
    """yᵀ A y of one body, y = x[o:o+m], A an (m, m) block of its pool: 0 is M_ηη, 1 K, 2 D."""
    m, e = parts.bodies[i]["m"], 0.0
    at = parts.bodies[i]["flex"] + 12 * m + block * m * m
    for r in range(m):
        e += x[o + r] * dot(parts.pool, at + r * m, x, o, m)
    return e


@kernel
def _strain(parts, q, i):
    """½ ηᵀ K η of one body, J."""
    return 0.5 * _modal_form(parts, i, 1, q, parts.bodies[i]["iq"] + 7)


@kernel
def _modal_kinetic(parts, now, v, i):
    """Kinetic energy of the modes: ṙ·A p η̇ + ω'·M_ωη η̇ + ½ η̇ᵀ M_ηη η̇ [J]."""
    body = parts.bodies[i]
    m, o = body["m"], body["iv"]
    x = turned(now.body[i]["A"], modal_vector(parts.pool, body["flex"], m, v, o + 6))
    y = modal_vector(now.Z, body["z"] + 9 * m, m, v, o + 6)
    e = inner(part(v, o), x) + inner(part(v, o + 3), y)
    return e + 0.5 * _modal_form(parts, i, 0, v, o + 6)


@unit
def body_energy(run: Run, i: int, what: int, at: Point) -> float:
    """Kinetic (0), strain (1) or gravity (2) energy of one body, J; after a velocity stage."""
    parts = run.system.parts
    if what == 1:
        a = run.work.dense.B[0]
        return _strain(parts, at.q, i) + membrane_energy(parts.bodies[i], parts.pool, at.q, a)
    e = frame_energy(run, i, what, at)
    if what == 0 and parts.bodies[i]["m"] > 0:
        e += _modal_kinetic(parts, run.work.now, at.v, i)
    return e


@unit
def flexible_energies(run: Run, of: Bodies, at: Point) -> int:
    """Kinetic, strain and gravity energy of flexible bodies."""
    parts, rows, out = run.system.parts, of.rows, run.work.energies
    rigid_energies(run, of, at)
    for n in range(rows.shape[0]):
        out[KINETIC_ENERGY] += _modal_kinetic(parts, run.work.now, at.v, rows[n])
        out[STRAIN_ENERGY] += _strain(parts, at.q, rows[n])
    return SUCCESS


@unit
def damping_power(run: Run, of: Bodies, at: Point) -> int:
    """−η̇ᵀ D η̇ of flexible bodies."""
    parts, rows, out = run.system.parts, of.rows, run.work.powers
    for n in range(rows.shape[0]):
        if parts.bodies[rows[n]]["damped"] > 0:
            out[DAMPER_POWER] -= _modal_form(
                parts, rows[n], 2, at.v, parts.bodies[rows[n]]["iv"] + 6
            )
    return SUCCESS


FLEXIBLE_BODIES = Kind(
    "flexible_bodies",
    Bodies,
    {
        "position": turn_bodies,
        "inertia": prepare_flexible,
        "force": flexible_inertia_forces,
        "matrix": flexible_matrix,
        "mass": flexible_mass_product,
        "energy": flexible_energies,
        "power": damping_power,
    },
    stiff=True,
)


def modal_block(body: FlexBody, coupling: str = "full", Mab: Array | None = None) -> Array:
    """The numbers of `tables.FLEX_LAYOUT` in one row, with the Mab of the body or other ones."""
    Mab = body.Mab if Mab is None else Mab
    damping = np.zeros_like(body.K) if body.D is None else body.D
    parts = [body.p, body.P, np.einsum("bbij->ij", Mab), body.K, damping]
    if coupling != "constant":
        M = Mab
        if body.centrifugal_stiffness is not None:
            M = M - body.centrifugal_stiffness
        turning = [M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]]
        if coupling == "partial":
            across = [M[1, 1] + M[2, 2], M[2, 2] + M[0, 0], M[0, 0] + M[1, 1]]
            mixed = [M[0, 1] + M[1, 0], M[1, 2] + M[2, 1], M[2, 0] + M[0, 2]]
            pairs = [form for pair in zip(across, turning, strict=True) for form in pair]
            P = body.P + body.P.swapaxes(0, 1)
            rows = [*(np.trace(P) - P[[0, 1, 2], [0, 1, 2]]), *-P[[0, 1, 2], [1, 2, 0]]]
            m = body.m
            gap = np.zeros(whole_vectors(18 * m + 3 * m * m) - 18 * m - 3 * m * m)
            parts += [np.array(rows), gap, grouped_rows([*pairs, *mixed])]
        else:
            parts += [np.array([M[b, a] for a in range(3) for b in range(3)]), *turning]
    return np.concatenate([np.ascontiguousarray(part).ravel() for part in parts])


_ROUND_OFF = 1e-12  # of integrals, relative to their Cauchy-Schwarz bounds


def put_flags(row: Any, body: FlexBody, static: bool) -> None:
    """Set the flags of a body in its row of the table: terms that are zero (see `tables.BODY`).

    `static`: some of its modes have no inertia.
    """

    def diagonal(form: Array) -> bool:
        size = np.sqrt(np.abs(np.diag(form)))
        rest = np.abs(form - np.diag(np.diag(form)))
        return bool(np.all(rest <= _ROUND_OFF * np.outer(size, size)))

    size = np.sqrt(np.diag(body.M_eta))
    arms = np.array([body.P[1, 2] - body.P[2, 1], body.P[2, 0] - body.P[0, 2],
                     body.P[0, 1] - body.P[1, 0]])  # fmt: skip
    moved = np.abs(body.p).max(axis=0) > _ROUND_OFF * size * np.sqrt(body.mass)
    turned = np.abs(arms).max(axis=0) > _ROUND_OFF * size * np.sqrt(np.trace(body.S0))
    row["attached"] = int(np.any(moved | turned))
    decoupled = not (row["shapes"] or static and row["attached"])
    row["diagonal"] = int(diagonal(body.M_eta) and diagonal(body.K) and decoupled)
    row["damped"] = 0 if body.D is None or not np.any(body.D) else 2 if diagonal(body.D) else 1


def modal_reach(body: FlexBody) -> Array:
    """Largest displacement anywhere on the body per unit of each modal coordinate (m,)."""
    fields = [interface.Phi_t for interface in body.interfaces]
    if body.surface is not None:
        fields.extend(body.surface.modes)
    mean = np.sqrt(np.diag(body.M_eta) / body.mass)
    if not fields:
        return mean
    reach = np.linalg.norm(np.stack(fields), axis=1).max(axis=0)
    return np.where(reach > _ROUND_OFF * mean, reach, mean)  # a mode may move no interface
