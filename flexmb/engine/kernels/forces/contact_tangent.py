"""Tangents of contacts: the change of their wrenches with position and velocity.

The wrench pair is W = B f, the velocity where they meet g = Bᵀ V, V the velocities of both markers.
With D = ∂f/∂g: ∂W/∂V = B D Bᵀ, and with position W changes by B (∂f at constant V) + ∂B f. What the
levers of the markers do to V at constant v adds B D ∂g.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.algebra.triple import column, inner, outer, plus, times, triple, unit
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.kernels.bodies.pair_tangent import add_levers, add_pair, put_outer
from flexmb.engine.kernels.forces.contact import (
    bristle,
    force,
    normal_force,
    penetration,
    put_wrench,
    relative_velocity,
    separation,
)
from flexmb.engine.kernels.forces.friction import tangential_change
from flexmb.engine.tables import BALL, NO_FRICTION, PLANE

_NOTHING = (0.0, 0.0, 0.0)


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
    N, stiff, viscous = normal_force(c, now.kept, d, rate)
    dN = stiff * dd - viscous * (inner(dn, g) + inner(n, dg))
    df = plus(times(N, dn), dN, n)
    if c["model"] == NO_FRICTION:
        return df
    s0 = bristle(c, now.kept, mj)
    more = tangential_change(c, n, N, g, s0, now.span[0], dn, dN, dg, outer(turn, s0))
    return plus(df, 1.0, more)


@kernel
def _put_slopes(c, now, n, d, g, mj, D):
    """D = ∂f/∂g."""
    for k in range(3):
        df = _force_change(c, now, n, d, g, mj, 0.0, _NOTHING, unit(k), _NOTHING)
        D[0, k], D[1, k], D[2, k] = df


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


@kernel
def _add_position(c, now, n, rho, d, g, F, mi, mj, cp, H):
    """Subtract cp ∂W/∂position from H (12, 12), at constant velocities of the markers."""
    u, li = separation(mi, mj), times(-c["ri"], n)
    lj = plus(u, 1.0, li)
    omi, omj = triple(mi["om"]), triple(mj["om"])
    for k in range(6):
        du = unit(k) if k < 3 else _NOTHING
        turn = _NOTHING if k < 3 else unit(k - 3)
        dd, dn = _normal_change(c, n, rho, mi, mj, du, turn)
        di = times(-c["ri"], dn)
        dj = plus(du, 1.0, di)
        dg = plus(outer(omi, di), -1.0, outer(omj, dj))
        df = _force_change(c, now, n, d, g, mj, dd, dn, dg, turn)
        ti = plus(outer(di, F), 1.0, outer(li, df))
        tj = times(-1.0, plus(outer(dj, F), 1.0, outer(lj, df)))
        if k < 3:
            _add_column(H, k, -cp, df, ti, tj)
            _add_column(H, 6 + k, cp, df, ti, tj)
        else:
            _add_column(H, 6 + k, -cp, df, ti, tj)


@kernel
def _add_velocity(li, lj, cv, D, H):
    """Subtract cv B D Bᵀ from H."""
    for k in range(3):
        e = unit(k)
        for part in range(2):
            df = _times_slopes(D, e if part == 0 else outer(e, li))
            _add_column(H, 3 * part + k, -cv, df, outer(li, df), times(-1.0, outer(lj, df)))
            df = _times_slopes(D, e if part == 0 else outer(e, lj))
            _add_column(H, 6 + 3 * part + k, cv, df, outer(li, df), times(-1.0, outer(lj, df)))


@kernel
def _add_rate_levers(parts, kkt, wk, c, v, f):
    """Add f Jᵀ w (L(u) v)ᵀ, w = dense.g[0] a wrench pair, L the lever tangent of u = dense.g[1].

    What levers do to the rate uᵀV at constant v; J of the markers is in dense.J. Rows of dense.T:
    Jᵀ w of the two bodies, Lᵀ v of the two bodies.
    """
    d, n = wk.dense, (0, 0)
    for side in range(2):
        k = c["I"] if side == 0 else c["J"]
        b = parts.markers[k]["body"]
        size = 6 + parts.bodies[b]["m"] if b >= 0 else 0
        n = (n[1], size)
        if b < 0:
            continue
        clear(d.B, size, size)
        tangent.add_lever_tangent(parts, wk.now, k, d.g[1], 6 * side, 1.0, d.B)
        J, o = d.J[side], parts.bodies[b]["iv"]
        for col in range(size):
            d.T[side, col] = 0.0
            d.T[2 + side, col] = 0.0
            for r in range(6):
                d.T[side, col] += d.g[0, 6 * side + r] * J[r, col]
            for r in range(size):
                d.T[2 + side, col] += v[o + r] * d.B[r, col]
    for side in range(2):
        here = parts.markers[c["I"] if side == 0 else c["J"]]["body"]
        there = parts.markers[c["J"] if side == 0 else c["I"]]["body"]
        if here < 0:
            continue
        put_outer(d.T, side, n[side], 2 + side, n[side], f, d.B)
        add_body_block(parts.bodies[here], kkt, d.B, wk.factor.low, wk.factor.up)
        if c["couple"] >= 0:
            put_outer(d.T, side, n[side], 3 - side, n[1 - side], f, d.B)
            add_coupling(
                d.B, parts.bodies[here], parts.bodies[there], kkt, c["couple"],
                side == 1, wk.factor.low, wk.factor.up,
            )  # fmt: skip


@kernel
def contact_tangents(sys, contacts, wk, v, cv, cp):
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all contacts."""
    if contacts is not None:
        for k in range(contacts.shape[0]):
            c = contacts[k]
            mi, mj = wk.now.marker[c["I"]], wk.now.marker[c["J"]]
            d, n, rho = penetration(c, mi, mj)
            if d > 0.0:
                _add_contact(sys.parts, sys.kkt, wk, c, v, cv, cp, d, n, rho)


@kernel
def _add_contact(parts, kkt, wk, c, v, cv, cp, d, n, rho):
    H, D, w = wk.dense.H, wk.dense.D, wk.dense.g[1]
    mi, mj = wk.now.marker[c["I"]], wk.now.marker[c["J"]]
    g = relative_velocity(c, n, mi, mj)
    F = force(c, wk.now, n, d, g, mj)
    li = times(-c["ri"], n)
    _put_slopes(c, wk.now, n, d, g, mj, D)
    clear(H, 12, 12)
    _add_velocity(li, plus(separation(mi, mj), 1.0, li), cv, D, H)
    if cp != 0.0:
        _add_position(c, wk.now, n, rho, d, g, F, mi, mj, cp, H)
    add_pair(parts, kkt, wk, c["I"], c["J"], c["couple"], 1.0)
    if cp == 0.0:
        return
    if c["model"] == NO_FRICTION:  # D = −viscous n nᵀ
        put_wrench(c, n, mi, mj, _times_slopes(D, n), wk.dense.g[0])
        put_wrench(c, n, mi, mj, n, w)
        _add_rate_levers(parts, kkt, wk, c, v, -cp)
    else:
        for k in range(3):
            put_wrench(c, n, mi, mj, column(D, k), wk.dense.g[0])
            put_wrench(c, n, mi, mj, unit(k), w)
            _add_rate_levers(parts, kkt, wk, c, v, -cp)
    put_wrench(c, n, mi, mj, times(-1.0, F), w)
    add_levers(parts, kkt, wk, c["I"], c["J"], cp)
