"""Reactions of joints and drivers: the wrench on both markers in their own axes, from λ."""

from __future__ import annotations

from flexmb.engine.algebra.rotation import transform_back
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import call_stage, unit
from flexmb.engine.kernels.joints.row import put_row_gradient
from flexmb.engine.method import FINE
from flexmb.engine.records import Vector
from flexmb.engine.state import Point, Run


@unit
def put_group_wrench(run: Run, k: int, lam: Vector) -> int:
    """dense.g[1] = wrench pair of group k for these multipliers; its markers into dense.pair."""
    sys, d = run.system, run.work.dense
    group, g, w = sys.groups[k], run.work.row.g, d.g[1]
    d.pair[0], d.pair[1] = sys.rows[group["row"]]["I"], sys.rows[group["row"]]["J"]
    for c in range(12):
        w[c] = 0.0
    for r in range(group["row"], group["row"] + group["n"]):
        put_row_gradient(run, sys.rows[r])
        for c in range(12):
            w[c] -= lam[r] * g[c]
    return FINE


@unit
def read_reactions(run: Run, at: Point, out: Vector) -> int:
    """out (12 groups): force and moment on marker J of the joint in its axes, then on marker I."""
    groups, markers, d = run.system.groups, run.work.now.marker, run.work.dense
    w, stage = d.g[1], run.stages.axes
    for k in range(len(stage.units)):
        call_stage(stage.units[k], run, stage.tables[k], at)
    for k in range(groups.shape[0]):
        put_group_wrench(run, k, at.lam)
        i, j = d.pair[0], d.pair[1]
        for part in range(4):
            of_J = (part < 2) != (groups[k]["reversed"] == 1)
            R = markers[j]["R"] if of_J else markers[i]["R"]
            o = 3 * (part % 2) + (6 if of_J else 0)
            x, y, z = transform_back(R, w[o], w[o + 1], w[o + 2])
            put(out, 12 * k + 3 * part, x, y, z)
    return FINE
