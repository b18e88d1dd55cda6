"""Tangents of wrenches on one marker or a pair, added to the blocks of their bodies."""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.method import FINE
from flexmb.engine.state import Run


@unit
def add_own(run: Run, k: int, side: int, f: float) -> int:
    """Add f Jᵀ H J of marker k, one end of a pair, to its body; returns 6 + m.

    H (12, 12) is in dense.H, J is left in dense.J[side].
    """
    parts, d = run.system.parts, run.work.dense
    b = parts.markers[k]["body"]
    if b < 0:
        return 0
    n = 6 + parts.bodies[b]["m"]
    J = d.J[side]
    tangent.marker_jacobian(parts, run.work.now, k, J)
    clear(d.B, n, n)
    tangent.add_product_block(d.H, side, side, J, n, J, n, f, d.T, d.B)
    add_body_block(parts.bodies[b], run.system.kkt, d.B, run.work.factor.low, run.work.factor.up)
    return n


@unit
def add_pair(run: Run, i: int, j: int, link: int, f: float) -> int:
    """Add f Jᵀ H J for the bodies of markers i and j, H (12, 12) in dense.H."""
    parts, d = run.system.parts, run.work.dense
    low, up = run.work.factor.low, run.work.factor.up
    n0, n1 = add_own(run, i, 0, f), add_own(run, j, 1, f)
    if link < 0:
        return FINE
    for side in range(2):
        here, there = (i, j) if side == 0 else (j, i)
        n, m = (n0, n1) if side == 0 else (n1, n0)
        first = parts.bodies[parts.markers[here]["body"]]
        second = parts.bodies[parts.markers[there]["body"]]
        clear(d.B, n, m)
        J, K = d.J[side], d.J[1 - side]
        tangent.add_product_block(d.H, side, 1 - side, J, n, K, m, f, d.T, d.B)
        add_coupling(d.B, first, second, run.system.kkt, link, side == 1, low, up)
    return FINE


@unit
def add_moment_arms(run: Run, i: int, j: int, f: float) -> int:
    """Change of the moment arms of the wrench pair dense.g[1] on markers i and j (−1: none)."""
    parts, d = run.system.parts, run.work.dense
    for side in range(2):
        k = i if side == 0 else j
        if k >= 0 and parts.markers[k]["body"] >= 0:
            body = parts.bodies[parts.markers[k]["body"]]
            n = 6 + body["m"]
            clear(d.B, n, n)
            tangent.add_lever_tangent(parts, run.work.now, k, d.g[1], 6 * side, f, d.B)
            low, up = run.work.factor.low, run.work.factor.up
            add_body_block(body, run.system.kkt, d.B, low, up)
    return FINE


@kernel
def put_outer(T, i, ni, j, nj, f, B):
    """B[:ni, :nj] = f T[i, :ni] T[j, :nj]ᵀ."""
    for r in range(ni):
        for c in range(nj):
            B[r, c] = f * T[i, r] * T[j, c]
