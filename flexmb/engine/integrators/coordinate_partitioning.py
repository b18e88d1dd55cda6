"""Generalised coordinate partitioning, by explicit Runge–Kutta on the independent coordinates.

The coordinates of a step are the displacements x from its start, rotations as rotation vectors.
Complete pivoting of Cq splits them: the columns of the pivots are the dependent coordinates u, the
others the independent ones w (Wehage & Haug, J. Mech. Des. 104 (1982) 247). Only w and its
velocities are integrated. At every stage Newton's method solves C = 0 for u at fixed w;
Cq v + C_t = 0 gives the dependent velocities, and the augmented equations the accelerations.
Redundant rows have no pivot and determine no coordinate. The partition is renewed when the
equations for u become ill-conditioned, as near a stretched or flat pose.

Corrections of u alone are solved for with [[W, Cqᵀ], [Cq, −ε]], where the metric W is very large
for w.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine.algebra import ldl
from flexmb.engine.algebra.vector import (
    copy,
    cross,
    inner,
    part,
    plus,
    put_part,
    tangent_coefficients,
    weighted_max,
    zero,
)
from flexmb.engine.bodies.motion import move, rotation_rate
from flexmb.engine.equations_of_motion import (
    constraint_stage,
    position_stage,
    rate_stage,
    velocity_stage,
)
from flexmb.engine.integrators.explicit_rk import (
    Tableau,
    add_slopes,
    begin_step,
    combine,
    end_step,
    explicit_method,
    put_dense_weights,
    put_slopes,
    tableau_of,
)
from flexmb.engine.iteration_matrix import least_pivot, put_metric, store_diagonal
from flexmb.engine.jit import Vector, kernel, unit
from flexmb.engine.joints.constraint import constraint_jacobian, put_constraint_matrix
from flexmb.engine.method import NO_CONVERGENCE, NO_PARTITION, NOT_FINITE, SUCCESS, Method
from flexmb.engine.projection import NOTHING, accelerations
from flexmb.engine.state import Point, Run

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec

# Pivots of Cq over the largest one: below the first limit a row is redundant, up to inaccuracies of
# scenes (`analysis.mobility` refuses larger ones before a run); below the second the pose is
# singular.
_RANK_PIVOT, _SINGULAR_PIVOT = 1e-8, 1e-7
# Weight of independent coordinates in the metric.
_INDEPENDENT_WEIGHT = 1e10
# The partition is renewed when the least pivot of the rows has fallen to this share of its value at
# the selection.
_POOR_PIVOT = 0.2
_MAX_ITERATIONS = 12
# Corrections over the size of the model that are round-off; and those that are, if they no longer
# decrease.
_ROUND_OFF, _NOISE = 1e-14, 1e-11
_STAGNANT = 0.3


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene, by its `order`."""
    return explicit_method(tableau_of(spec), step, interpolate, partitions=1)


@unit
def step(run: Run, tableau: Tableau, h: float) -> int:
    """One step from the state; see the contract in `engine.method`."""
    st, tr, split, stages = run.state, run.work.trial, run.work.partition, tableau.stages
    if split.age[0] < 0.0:
        status = choose_independent(run, run.state_point)
        if status != SUCCESS:
            return status
    copy(st.v, tr.stages[0])
    begin_step(run)
    status = SUCCESS
    for s in range(1, stages + 1):
        copy(tr.v, tr.aa_start)
        status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], s, h)
        if status != SUCCESS:
            split.age[0] = -1.0
            return status
    if split.pivot[1] < _POOR_PIVOT * split.pivot[0]:
        split.age[0] = -1.0
        st.count[0]["partitions"] += 1
    return end_step(run, tableau, h, status, False)


@unit
def choose_independent(run: Run, at: Point) -> int:
    """Select the independent coordinates at a point; returns NO_PARTITION at a singular pose."""
    split, con, weights = run.work.partition, run.work.con, run.system.weights
    free, metric, J, done = split.free, split.metric, split.jacobian, con.rate
    nc, nv = J.shape[0], J.shape[1]
    for i in range(nv):
        free[i] = 0.0
        split.motion[i] = 0.0
        metric[i] = weights[i] ** 2 if weights[i] > 0.0 else 1.0
    position_stage(run, at)
    _factorise(run, at, False)
    _put_jacobian(run)
    for r in range(nc):
        done[r] = 0.0
    rank, first, least = 0, 0.0, 1.0
    for _ in range(min(nc, nv)):
        row, column, size = _largest(J, done, free)
        first = max(first, size)
        if not size > _RANK_PIVOT * first:
            break
        least = size / first
        rank += 1
        free[column], done[row] = 1.0, 1.0
        _eliminate(J, done, row, column)
    if least < _SINGULAR_PIVOT or rank < split.rank[0]:
        return NO_PARTITION
    for i in range(nv):
        if free[i] == 0.0:
            metric[i] *= _INDEPENDENT_WEIGHT
    _factorise(run, at, False)
    split.rank[0], split.age[0] = rank, 0.0
    split.pivot[0] = split.pivot[1] = least_pivot(run, nv)
    return SUCCESS


@kernel
def _put_jacobian(run):
    """Store the present Cq with dimensionless rows and columns."""
    kkt, fac, sys = run.system.kkt, run.work.factor, run.system
    J, place, x, y = run.work.partition.jacobian, kkt.place, fac.rhs, fac.tmp
    nc, nv = J.shape[0], J.shape[1]
    zero(x)
    for c in range(nv):
        left_out = place[c] == x.shape[0] - 1
        x[place[c]] = 1.0
        ldl.multiply(kkt, fac, x, y)
        x[place[c]] = 0.0
        for r in range(nc):
            weightless = left_out or not sys.weights[c] > 0.0
            J[r, c] = 0.0 if weightless else y[place[nv + r]] * sys.row_weights[r] / sys.weights[c]


@kernel
def _largest(J, done, free):
    """Row, column and absolute value of the largest entry in rows and columns without a pivot."""
    row, column, size = 0, 0, 0.0
    for r in range(J.shape[0]):
        if done[r] == 0.0:
            for c in range(J.shape[1]):
                if free[c] == 0.0 and abs(J[r, c]) > size:
                    row, column, size = r, c, abs(J[r, c])
    return row, column, size


@kernel
def _eliminate(J, done, row, column):
    """Eliminate the pivot column from all rows without a pivot."""
    for r in range(J.shape[0]):
        if done[r] == 0.0:
            f = J[r, column] / J[row, column]
            if f != 0.0:
                for c in range(J.shape[1]):
                    J[r, c] -= f * J[row, c]


@unit
def _factorise(run: Run, at: Point, turned: bool) -> int:
    """Factor [[W, Cqᵀ], [Cq, −ε]] after a position stage, for velocities or (turned) for x."""
    split, fac, kkt, parts = run.work.partition, run.work.factor, run.system.kkt, run.system.parts
    low, low0 = fac.low, fac.low0
    zero(low)
    fac.symmetric[0] = 1
    put_metric(parts, kkt, split.metric, low)
    store_diagonal(kkt.panels, low, fac.diagonal)
    constraint_jacobian(run)
    if turned:
        _transform_rotations(parts, run.system.rows, run.work.dense.jac, split.motion)
    put_constraint_matrix(run, at)
    copy(low, low0)
    fac.replaced[0] = ldl.factor(kkt, fac)
    return fac.replaced[0]


@kernel
def _transform_rotations(parts, rows, jac, motion):
    """Multiply the rotation columns of the rows by T(θ): for changes of rotation vectors."""
    bodies, markers = parts.bodies, parts.markers
    for k in range(rows.shape[0]):
        for side in range(2):
            at = rows[k]["jac_I"] if side == 0 else rows[k]["jac_J"]
            if at >= 0:
                marker = rows[k]["I"] if side == 0 else rows[k]["J"]
                theta = part(motion, bodies[markers[marker]["body"]]["iv"] + 3)
                c1, c2, _, _ = tangent_coefficients(inner(theta, theta))
                row = part(jac, at + 3)
                once = cross(theta, row)
                put_part(jac, at + 3, plus(plus(row, c1, once), c2, cross(theta, once)))


@kernel
def _evaluate_stage(run, tableau, q, v, t, s, h):
    """Rates of stage s of a step h from (t, q, v); the stage becomes the trial state."""
    tr, parts, x = run.work.trial, run.system.parts, run.work.partition.motion
    zero(x)
    add_slopes(tr.stages, 0, tableau.A[s], s, x)
    for i in range(x.shape[0]):
        x[i] *= h
    move(parts, q, x, tr.q)
    combine(v, tr.stages, q.shape[0], tableau.A[s], s, h, tr.v)
    tr.t[0] = t + tableau.c[s] * h
    if run.work.con.C.shape[0] > 0:
        status = _solve_positions(run, q)
        if status != SUCCESS:
            return status
        _solve_velocities(run)
    status = accelerations(run, run.trial_point, 0.0, NOTHING)
    _put_rates(parts.bodies, x, tr.v, tr.stages[s])
    put_slopes(run, s)
    return status


@unit
def _solve_positions(run: Run, q: Vector) -> int:
    """Dependent coordinates of the trial state from C = 0; q is that of the start of the step."""
    split, fac, kkt, at = run.work.partition, run.work.factor, run.system.kkt, run.trial_point
    C, x, free, sol, place = run.work.con.C, split.motion, split.free, fac.sol, kkt.place
    last = math.inf
    for n in range(_MAX_ITERATIONS):
        position_stage(run, at)
        if n == 0:
            _factorise(run, at, True)
        constraint_stage(run, at)
        _solve_rows(kkt, fac, C, x.shape[0])
        size = 0.0
        for i in range(x.shape[0]):
            d = free[i] * sol[place[i]]
            x[i] += d
            size = max(size, abs(d) * run.system.weights[i])
        if not math.isfinite(size):
            return NOT_FINITE
        move(run.system.parts, q, x, at.q)
        if size <= _ROUND_OFF or (size <= _NOISE and size > _STAGNANT * last):
            return SUCCESS
        last = size
    return NO_CONVERGENCE


@unit
def _solve_velocities(run: Run) -> int:
    """Dependent velocities of the trial state from Cq v + C_t = 0."""
    split, fac, kkt, at = run.work.partition, run.work.factor, run.system.kkt, run.trial_point
    v, free, weights, sol, place = at.v, split.free, run.system.weights, fac.sol, kkt.place
    position_stage(run, at)
    _factorise(run, at, False)
    split.pivot[1] = least_pivot(run, v.shape[0])
    for _ in range(_MAX_ITERATIONS):
        velocity_stage(run, at)
        rate_stage(run, at)
        _solve_rows(kkt, fac, run.work.con.rate, v.shape[0])
        size = 0.0
        for i in range(v.shape[0]):
            d = free[i] * sol[place[i]]
            v[i] += d
            size = max(size, abs(d) * weights[i])
        if size <= _ROUND_OFF * weighted_max(v, weights):
            break
    return SUCCESS


@kernel
def _solve_rows(kkt, fac, gaps, nv):
    """fac.sol: the correction of least norm that removes the violations of the rows."""
    sol, place = fac.sol, kkt.place
    for i in range(nv):
        sol[place[i]] = 0.0
    for k in range(gaps.shape[0]):
        sol[place[nv + k]] = -gaps[k]
    ldl.solve(kkt, fac, sol)


@kernel
def _put_rates(bodies, x, v, out):
    """ẋ of velocities v: θ̇ = T(θ)⁻¹ ω'."""
    copy(v, out)
    for k in range(bodies.shape[0]):
        o = bodies[k]["iv"] + 3
        put_part(out, o, rotation_rate(part(x, o), part(v, o)))


@unit
def interpolate(run: Run, tableau: Tableau, share: float) -> int:
    """Positions and velocities at a fraction of the last accepted step, into the trial state."""
    tr, before, x = run.work.trial, run.work.trial.before, run.work.partition.motion
    h = run.state.t[0] - before.t[0]
    count, weights, nq = tableau.c.shape[0], tr.shares, before.q.shape[0]
    if tr.dense_ready[0] == 0:
        for s in range(tableau.stages + 1, count):
            status = _evaluate_stage(run, tableau, before.q, before.v, before.t[0], s, h)
            if status != SUCCESS:
                return status
        tr.dense_ready[0] = 1
    put_dense_weights(tableau, share, weights)
    zero(x)
    add_slopes(tr.stages, 0, weights, count, x)
    for i in range(x.shape[0]):
        x[i] *= h
    move(run.system.parts, before.q, x, tr.q)
    combine(before.v, tr.stages, nq, weights, count, h, tr.v)
    copy(before.work_done, tr.work_done)
    if run.settings.does_work == 1:
        combine(before.work_done, tr.stages, nq + tr.v.shape[0], weights, count, h, tr.work_done)
    return SUCCESS


METHODS = {"coordinate-partitioning": make_method}
