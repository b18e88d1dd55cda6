"""Evaluation of all constraint rows of a system, group by group.

A group holds the rows of one joint or driver, which act between two markers. The functions here
evaluate the values C, rates and right sides γ of the rows, the Jacobian Cq, wrenches on the markers
and their derivatives, and the reactions of joints.
"""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.algebra.ldl import put_jacobian_row
from flexmb.engine.algebra.vector import clear, cross, put_part, times, turned_back, wrapped, zero
from flexmb.engine.bodies.wrench import add_generalized_force, add_moment_arms, add_pair_tangent
from flexmb.engine.jit import Integers, Vector, call_stage, kernel, unit
from flexmb.engine.joints import POINT
from flexmb.engine.joints.row import (
    add_row_tangent,
    put_row_gradient,
    rate,
    row_curvature,
    row_value,
)
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import DRIVER_POWER, Point, Run

# Regularisation ε of a row over (Cq diag(S)⁻¹ Cqᵀ)_ii, the pivot that it would have without other
# rows, S being the matrix of the coordinates. It gives redundant rows a pivot other than zero.
REGULARISATION = 1e-9


class Joints(NamedTuple):
    """Joints and drivers: groups of constraint rows (`System.rows`, `System.groups`)."""

    groups: Integers  # all groups but those of `PointJoints`
    driven: Integers  # rows with a prescribed function of time


class ConstraintRows(NamedTuple):
    """Rows of all kinds but POINT, which `point_joint` evaluates."""

    rows: Integers


@unit
def put_values(run: Run, of: ConstraintRows, at: Point) -> int:
    """Put C of all rows but those of kind POINT."""
    rows, con, period, listed = run.system.rows, run.work.con, run.rows.period, of.rows
    C, fun = con.C, con.fun
    for n in range(listed.shape[0]):
        row = rows[listed[n]]
        f = row["offset"]
        if row["fun"] >= 0:
            f += fun[row["fun"], 0]
        value = row_value(run, row) - f
        C[listed[n]] = value if period[row["kind"]] == 0.0 else wrapped(value)
    return SUCCESS


@unit
def subtract_reactions(run: Run, of: ConstraintRows, at: Point) -> int:
    """Subtract λ g from the wrenches of the markers, for all rows but those of kind POINT."""
    rows, markers, g, lam = run.system.rows, run.work.now.marker, run.work.row.g, at.lam
    listed = of.rows
    for n in range(listed.shape[0]):
        k = listed[n]
        row = rows[k]
        mi, mj = markers[row["I"]]["W"], markers[row["J"]]["W"]
        put_row_gradient(run, row)
        for c in range(6):
            mi[c] -= lam[k] * g[c]
            mj[c] -= lam[k] * g[6 + c]
    return SUCCESS


@unit
def put_rates(run: Run, of: ConstraintRows, at: Point) -> int:
    """Put Cq v + C_t of all rows but those of kind POINT."""
    rows, markers, con, g = run.system.rows, run.work.now.marker, run.work.con, run.work.row.g
    out, fun, listed = con.rate, con.fun, of.rows
    for n in range(listed.shape[0]):
        k = listed[n]
        row = rows[k]
        put_row_gradient(run, row)
        out[k] = rate(g, markers[row["I"]], markers[row["J"]])
        if row["fun"] >= 0:
            out[k] -= fun[row["fun"], 1]
    return SUCCESS


@unit
def constraint_right_side(run: Run) -> int:
    """Put γ of Cq v̇ = γ for all rows, after a bias stage."""
    rows, markers, con, g = run.system.rows, run.work.now.marker, run.work.con, run.work.row.g
    for k in range(rows.shape[0]):
        row = rows[k]
        mi, mj = markers[row["I"]], markers[row["J"]]
        if row["kind"] == POINT:
            con.gamma[k] = mi["bx"][row["a"]] - mj["bx"][row["a"]]
            continue
        put_row_gradient(run, row)
        s = row_curvature(run, row)
        for c in range(3):
            s += g[c] * mi["bx"][c] + g[3 + c] * mi["bom"][c]
            s += g[6 + c] * mj["bx"][c] + g[9 + c] * mj["bom"][c]
        if row["fun"] >= 0:
            s -= con.fun[row["fun"], 2]
        con.gamma[k] = -s
    return SUCCESS


@unit
def constraint_jacobian(run: Run) -> int:
    """Put the blocks of Cq, one for each body of a row, into dense.jac; after a position stage."""
    parts, now, rows, dense = run.system.parts, run.work.now, run.system.rows, run.work.dense
    bodies, table, jac, g = parts.bodies, parts.markers, dense.jac, run.work.row.g
    for k in range(rows.shape[0]):
        row = rows[k]
        i, j = row["I"], row["J"]
        plain = row["kind"] == POINT and table[i]["modes"] < 0 and table[j]["modes"] < 0
        if not plain:
            put_row_gradient(run, row)
        for side in range(2):
            at = row["jac_I"] if side == 0 else row["jac_J"]
            if at >= 0:
                marker = i if side == 0 else j
                for c in range(6 + bodies[table[marker]["body"]]["m"]):
                    jac[at + c] = 0.0
                if plain:
                    _put_point_row(now, table[marker], marker, row["a"], 2.0 * side - 1.0, jac, at)
                else:
                    add_generalized_force(parts, now, marker, g, 6 * side, 1.0, jac, at)
    return SUCCESS


@kernel
def _put_point_row(now, mk, k, a, sign, jac, at):
    """Gradient of ± x_a of a marker k that is fixed at s in its body: ± e_a and ± s × Aᵀ e_a."""
    A, s, jac[at + a] = now.body[mk["body"]]["A"], now.marker[k]["s"], sign
    put_part(jac, at + 3, times(sign, cross(s, (A[a, 0], A[a, 1], A[a, 2]))))


@unit
def put_jacobian(run: Run, joints: Joints, at: Point) -> int:
    """Copy Cq from dense.jac into the iteration matrix, with the regularisation of the rows."""
    sys, jac, factor = run.system, run.work.dense.jac, run.work.factor
    bodies, kkt, links, groups = sys.parts.bodies, sys.kkt, sys.kkt.links, sys.groups
    low, up, eps, rows = factor.low, factor.up, factor.eps, sys.rows
    symmetric = factor.symmetric[0] == 1
    regularisation = REGULARISATION * max(run.state.memory[0]["regularisation"], 1.0)
    for k in range(groups.shape[0]):
        group = groups[k]
        panel = kkt.panels[group["panel"]]
        for r in range(group["n"]):
            row = rows[group["row"] + r]
            s = 0.0
            diagonal = panel["at"] + r * panel["nc"] + r
            for side in range(2):
                b = group["body_I"] if side == 0 else group["body_J"]
                if b < 0:
                    continue
                link = links[group["link_I"] if side == 0 else group["link_J"]]
                start = row["jac_I"] if side == 0 else row["jac_J"]
                s += put_jacobian_row(link, r, bodies[b], kkt, jac, start, factor.diagonal, low)
                if not symmetric:
                    put_jacobian_row(link, r, bodies[b], kkt, jac, start, factor.diagonal, up)
            eps[panel["col"] + r] = regularisation * s
            low[diagonal] = -regularisation * s
            if not symmetric:
                up[diagonal] = low[diagonal]
    return SUCCESS


@kernel
def put_constraint_matrix(run, at):
    """Put all constraint rows into the iteration matrix; after `constraint_jacobian`."""
    units, tables = run.stages.jacobian.units, run.stages.jacobian.tables
    for k in range(len(units)):
        call_stage(units[k], run, tables[k], at)


@kernel
def group_tangents(run, listed, lam, cp):
    """Add cp ∂(Cqᵀ λ)/∂q of the listed constraint groups to the iteration matrix."""
    groups, rows = run.system.groups, run.system.rows
    for n in range(listed.shape[0]):
        group = groups[listed[n]]
        i, j = rows[group["row"]]["I"], rows[group["row"]]["J"]
        curved = put_group_tangent(run, lam, listed[n])
        add_moment_arms(run, i, j, cp)
        if curved == 1:
            add_pair_tangent(run, i, j, group["couple"], cp)


@unit
def put_group_tangent(run: Run, lam: Vector, k: int) -> int:
    """Put Σ λ g of group k into dense.g[1], and its tangent into dense.H.

    Returns 1 if the gradient of any of its rows depends on the positions of the markers, else 0.
    """
    rows, group, work = run.system.rows, run.system.groups[k], run.work
    g, w, H = work.row.g, work.dense.g[1], work.row.H
    curved = 0
    clear(H, H.shape[0], H.shape[1])
    zero(w)
    for r in range(group["row"], group["row"] + group["n"]):
        put_row_gradient(run, rows[r])
        for c in range(12):
            w[c] += lam[r] * g[c]
        curved = max(curved, add_row_tangent(run, rows[r], lam[r]))
    return curved


@unit
def joint_matrix(run: Run, joints: Joints, at: Point, cv: float, cp: float) -> int:
    """Add cp ∂(Cqᵀ λ)/∂q of all groups but those of `PointJoints`."""
    if cv != 0.0 or cp != 0.0:
        group_tangents(run, joints.groups, at.lam, cp)
    return SUCCESS


@unit
def driver_power(run: Run, joints: Joints, at: Point) -> int:
    """Power of drivers: Σ −λ ḟ over the rows with a function of time f."""
    rows, fun, driven = run.system.rows, run.work.con.fun, joints.driven
    for n in range(driven.shape[0]):
        k = driven[n]
        run.work.powers[DRIVER_POWER] -= at.lam[k] * fun[rows[k]["fun"], 1]
    return SUCCESS


@unit
def put_group_wrench(run: Run, k: int, lam: Vector) -> int:
    """dense.g[1] = wrench pair −Σ λ g of group k; dense.pair = its markers I and J."""
    sys, d = run.system, run.work.dense
    group, g, w = sys.groups[k], run.work.row.g, d.g[1]
    d.pair[0], d.pair[1] = sys.rows[group["row"]]["I"], sys.rows[group["row"]]["J"]
    zero(w)
    for r in range(group["row"], group["row"] + group["n"]):
        put_row_gradient(run, sys.rows[r])
        for c in range(12):
            w[c] -= lam[r] * g[c]
    return SUCCESS


@unit
def read_reactions(run: Run, at: Point, out: Vector) -> int:
    """Put the reactions of all groups into out, twelve numbers each.

    They are the force and moment on marker J of the joint, in the axes of J, then those on I, in
    the axes of I.
    """
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
            put_part(out, 12 * k + 3 * part, turned_back(R, (w[o], w[o + 1], w[o + 2])))
    return SUCCESS


@unit
def joint_wrench(run: Run, joints: Joints, at: Point, c: int) -> float:
    """Put the wrench pair of the joint or driver that channel c reads."""
    put_group_wrench(run, run.system.sensors.channels[c]["first"], at.lam)
    return 0.0


CONSTRAINT_ROWS = Kind(
    "constraint_rows",
    ConstraintRows,
    {"constraint": put_values, "rate": put_rates, "wrench": subtract_reactions},
)
JOINTS = Kind(
    "joints",
    Joints,
    {
        "matrix": joint_matrix,
        "jacobian": put_jacobian,
        "power": driver_power,
        "wrenches": joint_wrench,
    },
)
