"""Tangents of springs and loads, added to the panels of the KKT matrix."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.kernels.bodies.pair_tangent import add_levers, add_own, add_pair, put_outer
from flexmb.engine.kernels.forces import force


@kernel
def spring_tangents(sys, springs, wk, v, cv, cp):
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all spring–dampers."""
    if springs is not None:
        for k in range(springs.shape[0]):
            spring, w = springs[k], wk.dense.g[1]
            i, j = spring["I"], spring["J"]
            mi, mj = wk.now.marker[i], wk.now.marker[j]
            clear(wk.dense.H, wk.dense.H.shape[0], wk.dense.H.shape[1])
            force.add_spring_tangent(spring, mi, mj, cv, cp, wk.dense.H)
            add_pair(sys.parts, sys.kkt, wk, i, j, spring["couple"], 1.0)
            d, nx, ny, nz = force.direction(mi, mj)
            if spring["c"] != 0.0:
                _add_damper_levers(sys.parts, sys.kkt, wk, spring, v, cp, nx, ny, nz)
            f = force.spring_force(spring, mi, mj, d, nx, ny, nz)
            for c in range(12):
                w[c] = 0.0
            force.add_pair(w[0:6], w[6:12], -f * nx, -f * ny, -f * nz)
            add_levers(sys.parts, sys.kkt, wk, i, j, cp)


@kernel
def _add_damper_levers(parts, kkt, wk, spring, v, cp, nx, ny, nz):
    """Add −cp ∂Q/∂q of one damper by what the levers of its markers do to ḋ at constant v.

    On each body ∂(nᵀ J v)/∂q = vᵀ L, L the lever tangent of the unit force n; J of the markers is
    in dense.J. Rows of dense.T: Jᵀ n of the two bodies, Lᵀ v of the two bodies.
    """
    d, w, n = wk.dense, wk.dense.g[1], (0, 0)
    for side in range(2):
        k = spring["I"] if side == 0 else spring["J"]
        b = parts.markers[k]["body"]
        size = 6 + parts.bodies[b]["m"] if b >= 0 else 0
        n = (n[1], size)
        if b < 0:
            continue
        for c in range(6):
            w[c] = 0.0
        w[0], w[1], w[2] = nx, ny, nz
        clear(d.B, size, size)
        tangent.add_lever_tangent(parts, wk.now, k, w, 0, 1.0, d.B)
        J, o = d.J[side], parts.bodies[b]["iv"]
        for c in range(size):
            d.T[side, c] = nx * J[0, c] + ny * J[1, c] + nz * J[2, c]
            d.T[2 + side, c] = 0.0
            for r in range(size):
                d.T[2 + side, c] += v[o + r] * d.B[r, c]
    for side in range(2):
        k = spring["I"] if side == 0 else spring["J"]
        if n[side] > 0:
            body = parts.bodies[parts.markers[k]["body"]]
            put_outer(d.T, side, n[side], 2 + side, n[side], cp * spring["c"], d.B)
            add_body_block(body, kkt, d.B, wk.factor.low, wk.factor.up)
        if spring["couple"] >= 0:
            other = 1 - side
            there = parts.bodies[parts.markers[spring["J"] if side == 0 else spring["I"]]["body"]]
            put_outer(d.T, side, n[side], 2 + other, n[other], -cp * spring["c"], d.B)
            add_coupling(
                d.B, parts.bodies[parts.markers[k]["body"]], there, kkt, spring["couple"],
                side == 1, wk.factor.low, wk.factor.up,
            )  # fmt: skip


@kernel
def load_tangents(sys, loads, wk, cp):
    """−cp ∂Q/∂q of all loads."""
    for k in range(loads.shape[0]):
        i, o = loads[k]["marker"], 3 * loads[k]["torque"]
        w = wk.dense.g[1]
        clear(wk.dense.H, wk.dense.H.shape[0], wk.dense.H.shape[1])
        force.add_load_tangent(loads[k], wk.now.marker, wk.con.fun, wk.dense.H)
        for side in range(1):
            add_own(sys.parts, sys.kkt, wk, i, side, cp)
        x, y, z = force.load_vector(loads[k], wk.now.marker, wk.con.fun)
        for c in range(6):
            w[c] = 0.0
        w[o], w[o + 1], w[o + 2] = -x, -y, -z
        add_levers(sys.parts, sys.kkt, wk, i, -1, cp)
