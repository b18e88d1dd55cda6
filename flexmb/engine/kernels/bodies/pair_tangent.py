"""Tangents of wrenches on one marker or a pair, added to the blocks of their bodies."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.bodies import tangent


@kernel
def add_own(parts, kkt, wk, k, side, f):
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
def add_pair(parts, kkt, wk, i, j, link, f):
    """Add f Jᵀ H J for the bodies of markers i and j, H (12, 12) in dense.H."""
    d, low, up = wk.dense, wk.factor.low, wk.factor.up
    n = (0, 0)
    for side in range(2):
        k = add_own(parts, kkt, wk, i if side == 0 else j, side, f)
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
def add_levers(parts, kkt, wk, i, j, f):
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
def put_outer(T, i, ni, j, nj, f, B):
    """B[:ni, :nj] = f T[i, :ni] T[j, :nj]ᵀ."""
    for r in range(ni):
        for c in range(nj):
            B[r, c] = f * T[i, r] * T[j, c]
