"""Tangents of forces that follow rates of two markers: wrench pairs Σ X_r (U_r·V).

V (12) holds the velocities of both markers, X_r and U_r the rows of dense.X and dense.U (n, 12). At
constant velocities v of the bodies V changes too, while the moment arms do.
"""

from __future__ import annotations

from flexmb.engine.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.bodies.wrench import add_moment_arm
from flexmb.engine.jit import unit
from flexmb.engine.method import FINE
from flexmb.engine.records import Vector
from flexmb.engine.state import Run


@unit
def add_rates(run: Run, n: int, f: float) -> int:
    """Add f Σ X_r U_rᵀ, r < n, to dense.H (12, 12)."""
    X, U, H = run.work.dense.X, run.work.dense.U, run.work.dense.H
    for r in range(12):
        for k in range(n):
            x = f * X[k, r]
            if x != 0.0:
                for c in range(12):
                    H[r, c] += x * U[k, c]
    return FINE


@unit
def add_rate_arms(run: Run, v: Vector, i: int, j: int, link: int, n: int, f: float) -> int:
    """Add f Jᵀ Σ X_r ∂(U_r·V)/∂q, r < n, at constant v; J of markers i and j is in dense.J.

    Rows of dense.T: Jᵀ X_r of the two bodies, from 12 on ∂(U_r·V)/∂q, which is vᵀ times the tangent
    of the moment arms of U_r.
    """
    parts, d = run.system.parts, run.work.dense
    T, B, X = d.T, d.B, d.X
    for side in range(2):
        k = i if side == 0 else j
        b = parts.markers[k]["body"]
        if b < 0:
            continue
        J, o, size = d.J[side], parts.bodies[b]["iv"], 6 + parts.bodies[b]["m"]
        for r in range(n):
            clear(B, size, size)
            add_moment_arm(parts, run.work.now, k, d.U[r], 6 * side, f, B)
            for c in range(size):
                push, rate = 0.0, 0.0
                for a in range(6):
                    push += X[r, 6 * side + a] * J[a, c]
                for a in range(size):
                    rate += v[o + a] * B[a, c]
                T[6 * side + r, c], T[12 + 6 * side + r, c] = push, rate
    for pair in range(4):
        here, there = pair // 2, pair % 2
        a, b = parts.markers[j if here else i]["body"], parts.markers[j if there else i]["body"]
        if a < 0 or b < 0 or (here != there and link < 0):
            continue
        for r in range(6 + parts.bodies[a]["m"]):
            for c in range(6 + parts.bodies[b]["m"]):
                B[r, c] = 0.0
                for k in range(n):
                    B[r, c] += T[6 * here + k, r] * T[12 + 6 * there + k, c]
        if here == there:
            add_body_block(run, a, B)
        else:
            add_coupling(run, a, b, link, here, B)
    return FINE
