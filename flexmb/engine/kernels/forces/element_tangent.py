"""Tangents of joints, springs and loads, added to the panels of the KKT matrix."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.kernels.forces import force
from flexmb.engine.kernels.joints import primitive, row_tangent
from flexmb.engine.tables import POINT


@kernel
def _add_own(parts, kkt, wk, k, side, f):
    """Add f Jᵀ H J of marker k, one end of a pair, to its body; returns 6 + m."""
    b = parts.markers[k]["body"]
    if b < 0:
        return 0
    d = wk.dense
    n = 6 + parts.bodies[b]["m"]
    J = d.J[side]
    tangent.marker_jacobian(parts, wk.now, k, J)
    clear(d.B, n, n)
    tangent.add_product_block(d.H, side, side, J, n, J, n, f, d.T, d.B)
    add_body_block(parts.bodies[b], kkt, d.B, wk.factor.low, wk.factor.up)
    return n


@kernel
def _add_pair(parts, kkt, wk, i, j, link, f):
    """Add f Jᵀ H J for the bodies of markers i and j, H (12, 12) in dense.H."""
    d, low, up = wk.dense, wk.factor.low, wk.factor.up
    n = (0, 0)
    for side in range(2):
        k = _add_own(parts, kkt, wk, i if side == 0 else j, side, f)
        n = (n[1], k)
    if link < 0:
        return
    for side in range(2):
        here, there = (i, j) if side == 0 else (j, i)
        first = parts.bodies[parts.markers[here]["body"]]
        second = parts.bodies[parts.markers[there]["body"]]
        clear(d.B, n[side], n[1 - side])
        J, K = d.J[side], d.J[1 - side]
        tangent.add_product_block(d.H, side, 1 - side, J, n[side], K, n[1 - side], f, d.T, d.B)
        add_coupling(d.B, first, second, kkt, link, side == 1, low, up)


@kernel
def _add_levers(parts, kkt, wk, i, j, f):
    """Change of the lever arms of the wrench pair dense.g[1] on markers i and j (−1: none)."""
    for side in range(2):
        k = i if side == 0 else j
        if k >= 0 and parts.markers[k]["body"] >= 0:
            d, body = wk.dense, parts.bodies[parts.markers[k]["body"]]
            n = 6 + body["m"]
            clear(d.B, n, n)
            tangent.add_lever_tangent(parts, wk.now, k, d.g[1], 6 * side, f, d.B)
            add_body_block(body, kkt, d.B, wk.factor.low, wk.factor.up)


@kernel
def put_group_tangent(sys, wk, lam, k):
    """Wrench pair of group k to dense.g[1], its tangent to dense.H; returns whether it has any."""
    rows, group, d = sys.rows, sys.groups[k], wk.dense
    g, w = d.g[0], d.g[1]
    i, j = rows[group["row"]]["I"], rows[group["row"]]["J"]
    mi, mj = wk.now.marker[i], wk.now.marker[j]
    curved = False
    clear(d.H, d.H.shape[0], d.H.shape[1])
    for c in range(12):
        w[c] = 0.0
    for r in range(group["row"], group["row"] + group["n"]):
        kind, a, b = rows[r]["kind"], rows[r]["a"], rows[r]["b"]
        primitive.gradient(sys.lines, kind, a, b, mi, mj, g)
        for c in range(12):
            w[c] += lam[r] * g[c]
        if kind != POINT:
            curved = True
            row_tangent.add_row_tangent(sys.lines, kind, a, b, mi, mj, lam[r], g, d.H)
    return curved


@kernel
def group_tangents(sys, wk, lam, cp):
    """cp ∂(Cqᵀ λ)/∂q of all constraint groups."""
    for k in range(sys.groups.shape[0]):
        group = sys.groups[k]
        i, j = sys.rows[group["row"]]["I"], sys.rows[group["row"]]["J"]
        curved = put_group_tangent(sys, wk, lam, k)
        _add_levers(sys.parts, sys.kkt, wk, i, j, cp)
        if curved:
            _add_pair(sys.parts, sys.kkt, wk, i, j, group["couple"], cp)


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
            _add_pair(sys.parts, sys.kkt, wk, i, j, spring["couple"], 1.0)
            d, nx, ny, nz = force.direction(mi, mj)
            if spring["c"] != 0.0:
                _add_damper_levers(sys.parts, sys.kkt, wk, spring, v, cp, nx, ny, nz)
            f = force.spring_force(spring, mi, mj, d, nx, ny, nz)
            for c in range(12):
                w[c] = 0.0
            force.add_pair(w[0:6], w[6:12], -f * nx, -f * ny, -f * nz)
            _add_levers(sys.parts, sys.kkt, wk, i, j, cp)


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
            _put_outer(d.T, side, n[side], 2 + side, n[side], cp * spring["c"], d.B)
            add_body_block(body, kkt, d.B, wk.factor.low, wk.factor.up)
        if spring["couple"] >= 0:
            other = 1 - side
            there = parts.bodies[parts.markers[spring["J"] if side == 0 else spring["I"]]["body"]]
            _put_outer(d.T, side, n[side], 2 + other, n[other], -cp * spring["c"], d.B)
            add_coupling(
                d.B, parts.bodies[parts.markers[k]["body"]], there, kkt, spring["couple"],
                side == 1, wk.factor.low, wk.factor.up,
            )  # fmt: skip


@kernel
def _put_outer(T, i, ni, j, nj, f, B):
    """B[:ni, :nj] = f T[i, :ni] T[j, :nj]ᵀ."""
    for r in range(ni):
        for c in range(nj):
            B[r, c] = f * T[i, r] * T[j, c]


@kernel
def load_tangents(sys, loads, wk, cp):
    """−cp ∂Q/∂q of all loads."""
    for k in range(loads.shape[0]):
        i, o = loads[k]["marker"], 3 * loads[k]["torque"]
        w = wk.dense.g[1]
        clear(wk.dense.H, wk.dense.H.shape[0], wk.dense.H.shape[1])
        force.add_load_tangent(loads[k], wk.now.marker, wk.con.fun, wk.dense.H)
        for side in range(1):
            _add_own(sys.parts, sys.kkt, wk, i, side, cp)
        x, y, z = force.load_vector(loads[k], wk.now.marker, wk.con.fun)
        for c in range(6):
            w[c] = 0.0
        w[o], w[o + 1], w[o + 2] = -x, -y, -z
        _add_levers(sys.parts, sys.kkt, wk, i, -1, cp)
