"""Tangents of the reactions of joints, drivers and what else is a group of rows."""

from __future__ import annotations

from flexmb.engine.algebra.blocks import clear
from flexmb.engine.bodies.wrench import add_moment_arms, add_pair
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.joints.row import add_row_tangent, put_row_gradient
from flexmb.engine.records import Vector
from flexmb.engine.state import Run


@kernel
def group_tangents(run, listed, lam, cp):
    """cp ∂(Cqᵀ λ)/∂q of some constraint groups."""
    groups, rows = run.system.groups, run.system.rows
    for n in range(listed.shape[0]):
        group = groups[listed[n]]
        i, j = rows[group["row"]]["I"], rows[group["row"]]["J"]
        curved = put_group_tangent(run, lam, listed[n])
        add_moment_arms(run, i, j, cp)
        if curved == 1:
            add_pair(run, i, j, group["couple"], cp)


@unit
def put_group_tangent(run: Run, lam: Vector, k: int) -> int:
    """Wrench pair of group k to dense.g[1], its tangent to dense.H; returns whether it has any."""
    rows, group, work = run.system.rows, run.system.groups[k], run.work
    g, w, H = work.row.g, work.dense.g[1], work.row.H
    curved = 0
    clear(H, H.shape[0], H.shape[1])
    for c in range(12):
        w[c] = 0.0
    for r in range(group["row"], group["row"] + group["n"]):
        put_row_gradient(run, rows[r])
        for c in range(12):
            w[c] += lam[r] * g[c]
        curved = max(curved, add_row_tangent(run, rows[r], lam[r]))
    return curved
