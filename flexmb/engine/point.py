"""One point of a kinematic analysis: positions, velocities and accelerations from the constraints.

The factor is that of [[W, Cqᵀ], [Cq, −ε]], W a diagonal metric. Newton's method for the positions
begins with the factor of the point before, and renews it where its contraction is poor; the factor
of the pose that it finds then serves velocities, accelerations and reactions.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.ldl import multiply, solve
from flexmb.engine.algebra.vector import weighted_size
from flexmb.engine.bodies.motion import move
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.constraint import constraint_right_side
from flexmb.engine.kernels.kkt import factorise_metric
from flexmb.engine.kernels.stages import (
    bias_stage,
    constraint_stage,
    pose_stage,
    rate_stage,
    velocity_stage,
)
from flexmb.engine.kinematics_state import (
    KinematicsSettings,
    Path,
)
from flexmb.engine.method import FINE, NO_CONVERGENCE, NOT_FINITE, SINGULAR, UNLIKE_RATES
from flexmb.engine.records import Vector
from flexmb.engine.state import Run

_MAX_ITERATIONS = 15
_RENEW_AFTER_MOTION = 0.02  # motion after which a factor is renewed before it is used
_RENEW_ABOVE = 0.05  # contraction from which on a new factor costs less than iterations
_GIVE_UP_ABOVE = 0.9
_MAX_CORRECTION = 0.5  # a correction of this size does not belong to the prediction
_LAST_PLACES = 4e-16
_REDUNDANT_GAP = 1e-10  # rows that repeat others may leave this much
_MAX_ROUNDS = 6
_EXACT = 1e-13  # relative, of velocities and accelerations
_UNLIKE = 1e-7  # relative: rows that repeat others and ask for other velocities
# Least pivot of a row, over what it is without the rest of the mechanism, against the largest such
# so far: a singular pose below. (Where rows repeat others their pivots are small anyhow.)
_SINGULAR = 1e-7
_REGULARISATION = 1e-9


@unit
def solve_positions(run: Run, path: Path, settings: KinematicsSettings) -> int:
    """Put the trial positions on C = 0; leaves the factor of the pose. Returns the status."""
    sys, at, con, fac = run.system, run.trial_point, run.work.con, run.work.factor
    q, dq, C, sol, place, memory = (
        at.q,
        run.work.trial.dq,
        con.C,
        fac.sol,
        sys.kkt.place,
        path.memory[0],
    )
    weights, correction = sys.weights, path.correction
    nv = dq.shape[0]
    renew = (
        memory["motion_since_factor"] < 0.0 or memory["motion_since_factor"] > _RENEW_AFTER_MOTION
    )
    enough = settings.gap + _noise(sys.rows, sys.row_weights, con.fun)
    size, last, fresh = math.inf, 0.0, False
    for _ in range(_MAX_ITERATIONS):
        pose_stage(run, at)
        constraint_stage(run, at)
        gap = weighted_size(C, sys.row_weights)
        closed = gap <= enough or (size <= enough and gap <= _REDUNDANT_GAP)
        if not gap < math.inf:
            return NOT_FINITE
        if closed or renew:
            factorise_metric(run, at, path.metric)
            memory["motion_since_factor"] = 0.0
            path.count[0]["factorisations"] += 1
            if closed:
                return FINE
            fresh, last = True, 0.0
        _solve_rows(sys.kkt, fac, nv, C, -1.0)
        size = 0.0
        for i in range(nv):
            d = sol[place[i]]
            dq[i] = d
            correction[i] += d
            size = max(size, abs(d) * weights[i])
        path.count[0]["iterations"] += 1
        if not size <= _MAX_CORRECTION:
            return NO_CONVERGENCE
        renew = last > 0.0 and size > _RENEW_ABOVE * last and size > enough
        if fresh and last > 0.0 and size > _GIVE_UP_ABOVE * last and gap > _REDUNDANT_GAP:
            return NO_CONVERGENCE
        last = size
        move(sys.parts, q, dq, q)
        memory["motion_since_factor"] += size
    return NO_CONVERGENCE


@kernel
def _noise(rows, row_weights, fun):
    """Round-off of what the rows compare with functions of time, weighted."""
    size = 0.0
    for k in range(rows.shape[0]):
        if rows[k]["fun"] >= 0:
            size = max(size, abs(fun[rows[k]["fun"], 0]) * row_weights[k])
    return _LAST_PLACES * size


@unit
def solve_velocities_accelerations(run: Run, path: Path, settings: KinematicsSettings) -> int:
    """Trial velocities and accelerations from the constraints, from guesses; returns the status."""
    sys, at, con, fac = run.system, run.trial_point, run.work.con, run.work.factor
    sol, place, v, memory = fac.sol, sys.kkt.place, at.v, path.memory[0]
    nv = v.shape[0]
    if settings.redundant == 0:
        pivot = _least_pivot(place, nv, fac.d, fac.eps)
        memory["largest_pivot"] = max(memory["largest_pivot"], pivot)
        if pivot < _SINGULAR * memory["largest_pivot"]:
            return SINGULAR
    scale, off = 0.0, math.inf
    for n in range(_MAX_ROUNDS + 1):
        velocity_stage(run, at)
        rate_stage(run, at)
        off = weighted_size(con.rate, sys.row_weights)
        scale = max(scale, off, weighted_size(v, sys.weights))
        if off <= _EXACT * scale or n == _MAX_ROUNDS:
            break
        _solve_rows(sys.kkt, fac, nv, con.rate, -1.0)
        for i in range(nv):
            v[i] += sol[place[i]]
    if off > _UNLIKE * scale:
        return UNLIKE_RATES
    bias_stage(run, at)
    constraint_right_side(run)
    correct_accelerations(run, at.vd)
    # The solution of Cq x = probe: its direction flips where det Cq passes zero.
    _solve_rows(sys.kkt, fac, nv, path.probe, 1.0)
    for i in range(nv):
        path.direction[i] = sol[place[i]]
    return FINE


@kernel
def _least_pivot(place, nv, d, eps):
    """The smallest pivot of a row over its own compliance: small where others decide the row."""
    least = 1.0
    for i in range(nv, place.shape[0]):
        k = place[i]
        if eps[k] > 0.0:
            least = min(least, abs(d[k]) * _REGULARISATION / eps[k])
    return least


@unit
def correct_accelerations(run: Run, vd: Vector) -> int:
    """Correct vd to Cq v̇ = γ."""
    kkt, fac, gamma, row_weights = (
        run.system.kkt, run.work.factor, run.work.con.gamma, run.system.row_weights
    )  # fmt: skip
    place, rhs, tmp, sol, nv = kkt.place, fac.rhs, fac.tmp, fac.sol, vd.shape[0]
    scale = weighted_size(gamma, row_weights)
    for _ in range(_MAX_ROUNDS):
        for i in range(nv):
            rhs[place[i]] = vd[i]
        for i in range(gamma.shape[0]):
            rhs[place[nv + i]] = 0.0
        multiply(kkt, fac, rhs, tmp)
        off = 0.0
        for i in range(nv):
            sol[place[i]] = 0.0
        for i in range(gamma.shape[0]):
            k = place[nv + i]
            sol[k] = gamma[i] - tmp[k]
            off = max(off, abs(sol[k]) * row_weights[i])
        scale = max(scale, weighted_size(vd, run.system.weights))
        if off <= _EXACT * scale:
            break
        solve(kkt, fac, sol)
        for i in range(nv):
            vd[i] += sol[place[i]]
    return FINE


@kernel
def _solve_rows(kkt, fac, nv, values, sign):
    """fac.sol from no forces on the coordinates and these values of the rows, times a sign."""
    place, sol = kkt.place, fac.sol
    for i in range(nv):
        sol[place[i]] = 0.0
    for i in range(values.shape[0]):
        sol[place[nv + i]] = sign * values[i]
    solve(kkt, fac, sol)
