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
from flexmb.engine.kernels.algebra.rotation import rotation_matrix
from flexmb.engine.kernels.algebra.triple import (
    add_part,
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
from flexmb.engine.kernels.bodies.kinematics import modal_vector, mode_vector
from flexmb.engine.method import FINE
from flexmb.engine.records import Integers, Vector
from flexmb.engine.state import Point, Run


class Bodies(NamedTuple):
    """Bodies of one sort; other records of bodies begin with the same field."""

    rows: Integers  # their rows in the table of bodies


@unit
def add_product(
    pool: Vector, at: int, n: int, m: int, v: Vector, o: int, f: float, out: Vector, oo: int
) -> int:
    """out[oo:oo+n] += f × (n × m block of the pool at `at`) v[o:o+m]."""
    for i in range(n):
        s = 0.0
        row = at + i * m
        for j in range(m):
            s += pool[row + j] * v[o + j]
        out[oo + i] += f * s
    return FINE


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
def prepare_bodies(bodies, body_now, rows):
    """J and c of undeformed bodies."""
    for n in range(rows.shape[0]):
        body, J, c = bodies[rows[n]], body_now[rows[n]]["J"], body_now[rows[n]]["c"]
        for a in range(3):
            c[a] = body["S1"][a]
            for b in range(3):
                J[a, b] = body["S0"][a, b]
        _put_inertia(J)


@unit
def prepare_rigid(run: Run, of: Bodies, at: Point) -> int:
    """J and c of rigid bodies, which never change."""
    prepare_bodies(run.system.parts.bodies, run.work.now.body, of.rows)
    return FINE


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
        add_product(pool, at_P + 9 * m, 9 * m, m, q, eta, 1.0, Z, z)
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
    return FINE


@unit
def rigid_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity of rigid bodies."""
    for n in range(of.rows.shape[0]):
        put_frame_forces(run, of.rows[n], at)
    return FINE


@unit
def flexible_inertia_forces(run: Run, of: Bodies, at: Point) -> int:
    """Trial.res = M v̇ + velocity terms + gravity + elastic and damping forces of such bodies."""
    parts, now, out, rows = run.system.parts, run.work.now, run.work.trial.res, of.rows
    for n in range(rows.shape[0]):
        put_frame_forces(run, rows[n], at)
        body, bn = parts.bodies[rows[n]], now.body[rows[n]]
        _put_modal_forces(body, bn, parts, now.Z, at.q, at.v, at.vd, out)
    return FINE


@unit
def put_frame_forces(run: Run, i: int, at: Point) -> int:
    """Force and moment rows of the frame of body i in Trial.res, without M_ωη and V."""
    parts, v, vd, out = run.system.parts, at.v, at.vd, run.work.trial.res
    body, bn = parts.bodies[i], run.work.now.body[i]
    iv, m, flex, A, J = body["iv"], body["m"], body["flex"], bn["A"], bn["J"]
    c, om, e = triple(bn["c"]), part(v, iv + 3), part(vd, iv + 3)
    a = plus(part(vd, iv), -1.0, triple(parts.gravity))
    # ω̇×c + ω×(ω×c + 2 p η̇) + p η̈
    x = plus(outer(om, c), 2.0, modal_vector(parts.pool, flex, m, v, iv + 6))
    x = plus(outer(om, x), 1.0, outer(e, c))
    x = turned(A, plus(x, 1.0, modal_vector(parts.pool, flex, m, vd, iv + 6)))
    put_part(out, iv, plus(x, body["mass"], a))
    moment = plus(turned(J, e), 1.0, outer(om, turned(J, om)))
    put_part(out, iv + 3, plus(moment, 1.0, outer(c, turned_back(A, a))))
    return FINE


@kernel
def put_rate(a, at, i, j, v, o, m, V):
    """V (3, 3): V_ab = m numbers of a from at + i a + j b on, times v[o:o+m]."""
    for r in range(3):
        for c in range(3):
            V[r, c] = dot(a, at + i * r + j * c, v, o, m)


@kernel
def less_trace(V, x):
    """tr(V) x − Vᵀ x."""
    return plus(times(V[0, 0] + V[1, 1] + V[2, 2], x), -1.0, turned_back(V, x))


@kernel
def _put_modal_forces(body, bn, parts, Z, q, v, vd, out):
    """Modal rows: inertia, weight, centrifugal, Coriolis, elastic and damping terms.

    And moment row += M_ωη η̈ + 2 (tr(V) − Vᵀ) ω' with V_ab = Z_ab·η̇.
    """
    m, iv, at, z, V = body["m"], body["iv"], body["flex"], body["z"], bn["V"]
    pool, o, zw, size = parts.pool, iv + 6, z + 9 * m, m * m
    a = turned_back(bn["A"], plus(part(vd, iv), -1.0, triple(parts.gravity)))
    e, om = part(vd, iv + 3), part(v, iv + 3)
    put_rate(Z, z, 3 * m, m, v, o, m, V)
    add_part(out, iv + 3, 2.0, less_trace(V, om))
    add_product(Z, zw, 3, m, vd, o, 1.0, out, iv + 3)
    for i in range(m):
        out[o + i] = inner(mode_vector(pool, at + i, m), a) + inner(mode_vector(Z, zw + i, m), e)
    at_G = at + 12 * m + 9 * size
    add_product(pool, at_G + 3 * size, m, m, vd, o, 1.0, out, o)
    add_product(pool, at_G + 4 * size, m, m, q, body["iq"] + 7, 1.0, out, o)
    if body["damped"] == 1:
        add_product(pool, at_G + 5 * size, m, m, v, o, 1.0, out, o)
    square = inner(om, om)
    for b in range(3):
        if v[iv + 3 + b] != 0.0:
            add_product(pool, at_G + b * size, m, m, v, o, -2.0 * v[iv + 3 + b], out, o)
        for c in range(3):
            f = v[iv + 3 + b] * v[iv + 3 + c] - (square if b == c else 0.0)
            if f != 0.0:
                for i in range(m):
                    out[o + i] += f * Z[z + (3 * c + b) * m + i]
