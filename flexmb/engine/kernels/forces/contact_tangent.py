"""Tangents of contacts: the change of their wrenches with position and velocity.

The wrench pair is W = B f, the velocity where they meet g = Bᵀ V, V the velocities of both markers.
With D = ∂f/∂g: ∂W/∂V = B D Bᵀ, and with position W changes by B (∂f at constant V) + ∂B f. What the
moment arms of the markers do to V at constant v adds B D ∂g.
"""

from __future__ import annotations

from flexmb.engine.algebra.blocks import clear
from flexmb.engine.algebra.vector import axis_vector as axis
from flexmb.engine.algebra.vector import column, inner, outer, plus, times, triple
from flexmb.engine.bodies.wrench import add_moment_arms, add_pair
from flexmb.engine.jit import kernel, unit
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
from flexmb.engine.kernels.forces.damping_tangent import add_rate_arms, add_rates
from flexmb.engine.kernels.forces.friction import NO_FRICTION, tangential_change
from flexmb.engine.method import FINE
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
    c, s, now, H = contacts.rows[k], contacts.scratch, run.work.now, run.work.dense.H
    cn, D = s.now[0], s.D
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
    c, s, markers, dense = contacts.rows[k], contacts.scratch, run.work.now.marker, run.work.dense
    cn, D = s.now[0], s.D
    i, j, couple = c["I"], c["J"], c["couple"]
    mi, mj, n = markers[i], markers[j], triple(cn["n"])
    put_contact_changes(run, contacts, k, d, cp)
    smooth = c["model"] == NO_FRICTION  # then D = −viscous n nᵀ
    rates = 1 if smooth else 3
    for a in range(rates):
        put_wrench(
            c,
            n,
            mi,
            mj,
            times(D[0, 0] + D[1, 1] + D[2, 2], n) if smooth else column(D, a),
            dense.X[a],
        )
        put_wrench(c, n, mi, mj, n if smooth else axis(a), dense.U[a])
    add_rates(run, rates, -cv)
    add_pair(run, i, j, couple, 1.0)
    if cp != 0.0:
        add_rate_arms(run, v, i, j, couple, rates, -cp)
        put_wrench(c, n, mi, mj, times(-1.0, force(cn)), dense.g[1])
        add_moment_arms(run, i, j, cp)
