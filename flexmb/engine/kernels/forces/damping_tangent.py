"""What damping between two markers does at constant v while the moment arms change."""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.bodies.tangent import add_lever_tangent, add_product_block
from flexmb.engine.method import FINE
from flexmb.engine.records import Matrix
from flexmb.engine.state import Point, Run


@unit
def add_damping_moment_arms(
    run: Run, at: Point, i: int, j: int, link: int, cp: float, W: Matrix, N: Matrix
) -> int:
    """Add cp Jᵀ W ∂(J v)/∂q of markers i and j; J of the markers is in dense.J.

    W (12, 12) is the damping between their velocities, N (6, 6 + m) scratch.
    """
    parts, kkt, d = run.system.parts, run.system.kkt, run.work.dense
    low, up, B, J = run.work.factor.low, run.work.factor.up, d.B, d.J
    for side in range(2):
        k = i if side == 0 else j
        b = parts.markers[k]["body"]
        if b < 0:
            continue
        n = 6 + parts.bodies[b]["m"]
        _put_velocity_slope(parts, run.work.now, d, k, at.v, N)
        for row in range(2):
            a = parts.markers[i if row == 0 else j]["body"]
            if a < 0 or (row != side and link < 0):
                continue
            m = 6 + parts.bodies[a]["m"]
            clear(B, m, n)
            add_product_block(W, row, side, J[row], m, N, n, cp, d.T, B)
            if row == side:
                add_body_block(parts.bodies[a], kkt, B, low, up)
            else:
                add_coupling(B, parts.bodies[a], parts.bodies[b], kkt, link, row == 1, low, up)
    return FINE


@kernel
def _put_velocity_slope(parts, now, d, k, v, N):
    """N (6, 6 + m) = ∂(J v)/∂q of marker k: row by row vᵀ times the tangent of a moment arm."""
    B, w = d.B, d.g[0]
    body = parts.bodies[parts.markers[k]["body"]]
    n, o = 6 + body["m"], body["iv"]
    for r in range(6):
        w[r] = 0.0
    for r in range(6):
        w[r] = 1.0
        clear(B, n, n)
        add_lever_tangent(parts, now, k, w, 0, 1.0, B)
        for c in range(n):
            x = 0.0
            for a in range(n):
                x += v[o + a] * B[a, c]
            N[r, c] = x
        w[r] = 0.0
