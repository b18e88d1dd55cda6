"""Tangents of contacts: the change of their wrenches with position and velocity.

The wrench pair is W = B f, the velocity where they meet g = Bᵀ V, V the velocities of both markers.
With D = ∂f/∂g: ∂W/∂V = B D Bᵀ, and with position W changes by B (∂f at constant V) + ∂B f. What the
moment arms of the markers do to V at constant v adds B D ∂g.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.algebra.triple import column, inner, outer, plus, times, triple
from flexmb.engine.kernels.algebra.triple import unit as axis
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.kernels.bodies.pair_tangent import add_moment_arms, add_pair, put_outer
from flexmb.engine.kernels.forces.contact_force import (
    BALL,
    PLANE,
    Contacts,
    bristle,
    evaluate_contact,
    force,
    normal_force,
    put_wrench,
    separation,
)
from flexmb.engine.kernels.forces.friction import NO_FRICTION, tangential_change
from flexmb.engine.method import FINE
from flexmb.engine.records import Vector
from flexmb.engine.state import Point, Run

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _normal_change(c, n, rho, mi, mj, du, turn):
    """Changes of d and n with u by du and a rotation of J."""
    u = separation(mi, mj)
    if c["kind"] == PLANE:
        dn = outer(turn, n)
        return -inner(dn, u) - inner(n, du), dn
    if c["kind"] != BALL:  # p of u and the turning axis
        a = column(mj["R"], 2)
        da, s = outer(turn, a), inner(a, u)
        du = plus(du, -s, da)
        du = plus(du, -inner(da, u) - inner(a, du), a)
    across = -inner(n, du)
    return across, times(1.0 / rho, plus(du, across, n))


@kernel
def _force_change(c, now, n, d, g, mj, dd, dn, dg, turn):
    """Change of the force on I."""
    rate = -inner(n, g)
    N, stiff, viscous = normal_force(c, now.history, d, rate)
    dN = stiff * dd - viscous * (inner(dn, g) + inner(n, dg))
    df = plus(times(N, dn), dN, n)
    if c["model"] == NO_FRICTION:
        return df
    s0 = bristle(c, now.history, mj)
    more = tangential_change(c, n, N, g, s0, now.span[0], dn, dN, dg, outer(turn, s0))
    return plus(df, 1.0, more)


@kernel
def _times_slopes(D, a):
    return (
        D[0, 0] * a[0] + D[0, 1] * a[1] + D[0, 2] * a[2],
        D[1, 0] * a[0] + D[1, 1] * a[1] + D[1, 2] * a[2],
        D[2, 0] * a[0] + D[2, 1] * a[1] + D[2, 2] * a[2],
    )


@kernel
def _add_column(H, k, f, df, mi, mj):
    """Column k of H += f (df, m_I, −df, m_J)."""
    for r in range(3):
        H[r, k] += f * df[r]
        H[3 + r, k] += f * mi[r]
        H[6 + r, k] -= f * df[r]
        H[9 + r, k] += f * mj[r]


@unit
def put_contact_changes(run: Run, contacts: Contacts, k: int, d: float, cp: float) -> int:
    """D = ∂f/∂g of contact k, and dense.H = −cp ∂W/∂position at constant velocities of its markers.

    It is the contact that was evaluated last, of depth d > 0.
    """
    c, cn, D, now, H = contacts.rows[k], contacts.now[0], contacts.D, run.work.now, run.work.dense.H
    mi, mj, n, F = now.marker[c["I"]], now.marker[c["J"]], triple(cn["n"]), force(cn)
    rho, g, u, li = cn["rho"], triple(cn["g"]), separation(mi, mj), times(-c["ri"], n)
    lj = plus(u, 1.0, li)
    omi, omj = triple(mi["om"]), triple(mj["om"])
    clear(H, 12, 12)
    for a in range(3 if cp == 0.0 else 9):  # with g; with u; with a rotation of J
        dd, dn, dg, du, turn = 0.0, _ZERO, axis(a), axis(a - 3), axis(a - 6)
        if a >= 3:
            dd, dn = _normal_change(c, n, rho, mi, mj, du, turn)
            di = times(-c["ri"], dn)
            dg = plus(outer(omi, di), -1.0, outer(omj, plus(du, 1.0, di)))
        df = _force_change(c, now, n, d, g, mj, dd, dn, dg, turn)
        if a < 3:
            D[0, a], D[1, a], D[2, a] = df
            continue
        di = times(-c["ri"], dn)
        ti = plus(outer(di, F), 1.0, outer(li, df))
        tj = times(-1.0, plus(outer(plus(du, 1.0, di), F), 1.0, outer(lj, df)))
        if a < 6:
            _add_column(H, a - 3, -cp, df, ti, tj)
        _add_column(H, a + 3, cp if a < 6 else -cp, df, ti, tj)
    return FINE


@kernel
def _add_velocity(c, n, mi, mj, cv, D, dense):
    """Subtract cv B D Bᵀ from dense.H; columns of B into dense.T: 0 to 2 of I, 3 to 5 of J."""
    w, T, H = dense.g[0], dense.T, dense.H
    for a in range(3):
        put_wrench(c, n, mi, mj, axis(a), w)
        for r in range(6):
            T[a, r], T[3 + a, r] = w[r], w[6 + r]
    for i in range(2):
        for j in range(2):
            for a in range(3):
                for b in range(3):
                    f = cv * D[a, b]
                    for r in range(6):
                        for k in range(6):
                            H[6 * i + r, 6 * j + k] -= f * T[3 * i + a, r] * T[3 * j + b, k]


@unit
def add_rate_arms(run: Run, i: int, j: int, couple: int, v: Vector, f: float) -> int:
    """Add f Jᵀ w (L(u) v)ᵀ, w = dense.g[0] a wrench pair on markers i and j, u = dense.g[1].

    L is the tangent of the moment arms: what they do to the rate uᵀV at constant v; J of the
    markers is in dense.J. Rows of dense.T: Jᵀ w of the two bodies, Lᵀ v of the two bodies.
    """
    parts, kkt, d = run.system.parts, run.system.kkt, run.work.dense
    low, up, bodies, n = run.work.factor.low, run.work.factor.up, parts.bodies, (0, 0)
    B, T = d.B, d.T
    for side in range(2):
        k = i if side == 0 else j
        b = parts.markers[k]["body"]
        size = 6 + bodies[b]["m"] if b >= 0 else 0
        n = (n[1], size)
        if b < 0:
            continue
        clear(B, size, size)
        tangent.add_lever_tangent(parts, run.work.now, k, d.g[1], 6 * side, 1.0, B)
        J, w, o = d.J[side], d.g[0], bodies[b]["iv"]
        for col in range(size):
            T[side, col] = 0.0
            T[2 + side, col] = 0.0
            for r in range(6):
                T[side, col] += w[6 * side + r] * J[r, col]
            for r in range(size):
                T[2 + side, col] += v[o + r] * B[r, col]
    for side in range(2):
        here = parts.markers[i if side == 0 else j]["body"]
        there = parts.markers[j if side == 0 else i]["body"]
        if here < 0:
            continue
        put_outer(T, side, n[side], 2 + side, n[side], f, B)
        add_body_block(bodies[here], kkt, B, low, up)
        if couple >= 0:
            put_outer(T, side, n[side], 3 - side, n[1 - side], f, B)
            add_coupling(B, bodies[here], bodies[there], kkt, couple, side == 1, low, up)
    return FINE


@unit
def contact_tangents(run: Run, contacts: Contacts, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all contacts."""
    if cv != 0.0 or cp != 0.0:
        for k in range(contacts.rows.shape[0]):
            d = evaluate_contact(run, contacts, k)
            if d > 0.0:
                _add_contact(run, contacts, k, at.v, cv, cp, d)
    return FINE


@kernel
def _add_contact(run, contacts, k, v, cv, cp, d):
    c, cn, D, markers, dense = (
        contacts.rows[k], contacts.now[0], contacts.D, run.work.now.marker, run.work.dense
    )  # fmt: skip
    i, j, couple = c["I"], c["J"], c["couple"]
    mi, mj, n = markers[i], markers[j], triple(cn["n"])
    put_contact_changes(run, contacts, k, d, cp)
    _add_velocity(c, n, mi, mj, cv, D, dense)
    add_pair(run, i, j, couple, 1.0)
    if cp == 0.0:
        return
    smooth = c["model"] == NO_FRICTION  # then D = −viscous n nᵀ
    for a in range(1 if smooth else 3):
        put_wrench(c, n, mi, mj, _times_slopes(D, n) if smooth else column(D, a), dense.g[0])
        put_wrench(c, n, mi, mj, n if smooth else axis(a), dense.g[1])
        add_rate_arms(run, i, j, couple, v, -cp)
    put_wrench(c, n, mi, mj, times(-1.0, force(cn)), dense.g[1])
    add_moment_arms(run, i, j, cp)
