"""Tangents of wrenches on one marker or a pair, added to the blocks of their bodies."""

from __future__ import annotations

from flexmb.engine.jit import unit
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
    tangent.put_product_block(d.H, side, side, J, n, J, n, f, d.T, d.B)
    add_body_block(run, b, d.B)
    return n


@unit
def add_pair(run: Run, i: int, j: int, link: int, f: float) -> int:
    """Add f Jᵀ H J for the bodies of markers i and j, H (12, 12) in dense.H."""
    parts, d = run.system.parts, run.work.dense
    n0, n1 = add_own(run, i, 0, f), add_own(run, j, 1, f)
    if link < 0:
        return FINE
    a, b = parts.markers[i]["body"], parts.markers[j]["body"]
    tangent.put_product_block(d.H, 0, 1, d.J[0], n0, d.J[1], n1, f, d.T, d.B)
    add_coupling(run, a, b, link, 0, d.B)
    tangent.put_product_block(d.H, 1, 0, d.J[1], n1, d.J[0], n0, f, d.T, d.B)
    add_coupling(run, b, a, link, 1, d.B)
    return FINE


@unit
def add_moment_arms(run: Run, i: int, j: int, f: float) -> int:
    """Change of the moment arms of the wrench pair dense.g[1] on markers i and j (−1: none)."""
    parts, d = run.system.parts, run.work.dense
    for side in range(2):
        k = i if side == 0 else j
        b = parts.markers[k]["body"] if k >= 0 else -1
        if b >= 0:
            n = 6 + parts.bodies[b]["m"]
            clear(d.B, n, n)
            tangent.add_lever_tangent(parts, run.work.now, k, d.g[1], 6 * side, f, d.B)
            add_body_block(run, b, d.B)
    return FINE
