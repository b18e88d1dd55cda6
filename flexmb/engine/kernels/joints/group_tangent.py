"""Tangents of the reactions of joints, drivers and what else is a group of rows."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import clear
from flexmb.engine.kernels.bodies.pair_tangent import add_levers, add_pair
from flexmb.engine.kernels.joints import primitive, row_tangent
from flexmb.engine.tables import POINT


@kernel
def group_tangents(sys, wk, lam, cp):
    """cp ∂(Cqᵀ λ)/∂q of all constraint groups."""
    for k in range(sys.groups.shape[0]):
        group = sys.groups[k]
        i, j = sys.rows[group["row"]]["I"], sys.rows[group["row"]]["J"]
        curved = put_group_tangent(sys, wk, lam, k)
        add_levers(sys.parts, sys.kkt, wk, i, j, cp)
        if curved:
            add_pair(sys.parts, sys.kkt, wk, i, j, group["couple"], cp)


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
