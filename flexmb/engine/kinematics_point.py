"""One point of a kinematic analysis: positions, velocities, accelerations and reactions.

All solves use a factor of [[W, Cqᵀ], [Cq, −ε]] with a diagonal metric W. Newton's method for the
positions begins with the factor of the point before, and renews it if it contracts too slowly. The
factor at the solution is then used for velocities, accelerations and reactions. Inverse dynamics
solves Cqᵀ λ = Q − M v̇; with redundant rows, for the λ of least norm. Modal forces are left out:
they are taken by what keeps flexible bodies undeformed.

Test that a point continues the motion: for a smooth motion, the solution differs from the
prediction h v + h²/2 v̇ by h²/6 (v̇₁ − v̇₀) in the next order. On another branch of the mechanism
it differs by the distance of the branches, however small h is. Velocities are compared in the same
way, by the trapezoidal rule. There is a singular pose between two points if the solution of Cq x =
probe reverses its direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.ldl import multiply, solve, solve_refined
from flexmb.engine.algebra.vector import copy, weighted_max
from flexmb.engine.bodies.motion import move
from flexmb.engine.equations_of_motion import (
    bias_stage,
    constraint_stage,
    feedback_stage,
    forces,
    pose_stage,
    rate_stage,
    reaction_stage,
    run_stage,
    velocity_stage,
)
from flexmb.engine.iteration_matrix import factorise_metric
from flexmb.engine.jit import Matrix, Vector, array_of, kernel, unit
from flexmb.engine.joints.constraint import REGULARISATION, constraint_right_side
from flexmb.engine.method import (
    BRANCH_CHANGE,
    FUNCTION_JUMP,
    INCONSISTENT_VELOCITIES,
    NO_CONVERGENCE,
    NO_LOOP_CONVERGENCE,
    NOT_FINITE,
    SELF_LOCKING,
    SINGULAR_POSE,
    SUCCESS,
)
from flexmb.engine.projection import depends_on_solution
from flexmb.engine.state import Run

#: Memory of a kinematic analysis, from point to point.
PATH_MEMORY = np.dtype([
    ("next_increment", "f8"),  # increment to try next, s
    ("motion_since_factor", "f8"),  # weighted displacement since the factor; < 0: there is none
    ("largest_pivot", "f8"),  # largest of the least row pivots of all points so far
])  # fmt: skip

#: Counters of a kinematic analysis.
PATH_COUNTERS = np.dtype([("iterations", "i8"), ("factorisations", "i8"), ("singular_poses", "i8")])


class KinematicsSettings(NamedTuple):
    """Settings of a kinematic analysis."""

    start: float  # s
    interval: float  # interval of outputs, s
    outputs: int  # number of intervals
    gap: float  # constraint violation that is round-off, weighted
    redundant: int  # number of redundant rows


class Path(NamedTuple):
    """Memory of a kinematic analysis, from point to point."""

    metric: Vector  # (nv,) W
    probe: Vector  # (nc,) right side whose solution shows singular poses
    direction_before: Vector  # (nv,) that solution at the last point
    direction: Vector  # (nv,) that solution at the trial point
    jerk: Vector  # (nv,) last difference of v̇ over its increment
    correction: Vector  # (nv,) sum of Newton corrections to the prediction
    functions_before: Matrix  # (functions, 3) functions at the last point
    powers: Matrix  # (4, 3) powers at the last outputs, newest first
    memory: array_of(PATH_MEMORY)  # (1,)
    singular_times: Matrix  # (8, 2) times before and after a singular pose
    singular_positions: Matrix  # (8, nq) positions there
    count: array_of(PATH_COUNTERS)  # (1,)


_MAX_ITERATIONS = 15
_RENEW_AFTER_MOTION = 0.02  # weighted displacement after which a factor is renewed before use
_RENEW_ABOVE = 0.05  # contraction above which a new factor costs less than iterations
_FAIL_ABOVE = 0.9  # contraction with a new factor above which Newton's method fails
_MAX_CORRECTION = 0.5  # largest weighted correction of a prediction
_ROUND_OFF = 4e-16  # relative round-off of a function of time
_REDUNDANT_GAP = 1e-10  # weighted violation that redundant rows may have
_MAX_ROUNDS = 6  # refinements of velocities and accelerations
_RATE_TOLERANCE = 1e-13  # relative error of velocities and accelerations
_CONTRADICTION = 1e-7  # relative velocity error above which redundant rows contradict the others
_MIN_SPEED = 1e-290  # least scale of velocities; 1e-13 of it is hardly a normal number

# Singular pose: least row pivot, over that without other rows, below this share of the largest such
# value of all points so far. Not tested with redundant rows, whose pivots are always small.
_SINGULAR_PIVOT_RATIO = 1e-7


@unit
def solve_positions(run: Run, path: Path, settings: KinematicsSettings) -> int:
    """Solve C = 0 for the trial positions; then factor at the solution. Returns the status."""
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
    enough = settings.gap + _function_round_off(sys.rows, sys.row_weights, con.fun)
    size, last, fresh = math.inf, 0.0, False
    for _ in range(_MAX_ITERATIONS):
        pose_stage(run, at)
        constraint_stage(run, at)
        gap = weighted_max(C, sys.row_weights)
        closed = gap <= enough or (size <= enough and gap <= _REDUNDANT_GAP)
        if not gap < math.inf:
            return NOT_FINITE
        if closed or renew:
            factorise_metric(run, at, path.metric)
            memory["motion_since_factor"] = 0.0
            path.count[0]["factorisations"] += 1
            if closed:
                return SUCCESS
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
        if fresh and last > 0.0 and size > _FAIL_ABOVE * last and gap > _REDUNDANT_GAP:
            return NO_CONVERGENCE
        last = size
        move(sys.parts, q, dq, q)
        memory["motion_since_factor"] += size
    return NO_CONVERGENCE


@kernel
def _function_round_off(rows, row_weights, fun):
    """Round-off of the functions of time in the rows, weighted."""
    size = 0.0
    for k in range(rows.shape[0]):
        if rows[k]["fun"] >= 0:
            size = max(size, abs(fun[rows[k]["fun"], 0]) * row_weights[k])
    return _ROUND_OFF * size


@unit
def solve_velocities_accelerations(run: Run, path: Path, settings: KinematicsSettings) -> int:
    """Trial velocities and accelerations from the constraints, by refining predicted ones."""
    sys, at, con, fac = run.system, run.trial_point, run.work.con, run.work.factor
    sol, place, v, memory = fac.sol, sys.kkt.place, at.v, path.memory[0]
    nv = v.shape[0]
    if settings.redundant == 0:
        pivot = _least_pivot(place, nv, fac.d, fac.eps)
        memory["largest_pivot"] = max(memory["largest_pivot"], pivot)
        if pivot < _SINGULAR_PIVOT_RATIO * memory["largest_pivot"]:
            return SINGULAR_POSE
    scale, off = _MIN_SPEED, math.inf
    for n in range(_MAX_ROUNDS + 1):
        velocity_stage(run, at)
        rate_stage(run, at)
        off = weighted_max(con.rate, sys.row_weights)
        scale = max(scale, off, weighted_max(v, sys.weights))
        if off <= _RATE_TOLERANCE * scale or n == _MAX_ROUNDS:
            break
        _solve_rows(sys.kkt, fac, nv, con.rate, -1.0)
        for i in range(nv):
            v[i] += sol[place[i]]
    if off > _CONTRADICTION * scale:
        return INCONSISTENT_VELOCITIES
    bias_stage(run, at)
    constraint_right_side(run)
    correct_accelerations(run, at.vd)
    # the solution of Cq x = probe reverses its direction where det Cq changes sign
    _solve_rows(sys.kkt, fac, nv, path.probe, 1.0)
    for i in range(nv):
        path.direction[i] = sol[place[i]]
    return SUCCESS


@kernel
def _least_pivot(place, nv, d, eps):
    """The smallest pivot of a row over that without other rows: small near a singular pose."""
    least = 1.0
    for i in range(nv, place.shape[0]):
        k = place[i]
        if eps[k] > 0.0:
            least = min(least, abs(d[k]) * REGULARISATION / eps[k])
    return least


@unit
def correct_accelerations(run: Run, vd: Vector) -> int:
    """Refine vd until Cq v̇ = γ."""
    kkt, fac, gamma, row_weights = (
        run.system.kkt, run.work.factor, run.work.con.gamma, run.system.row_weights
    )  # fmt: skip
    place, rhs, tmp, sol, nv = kkt.place, fac.rhs, fac.tmp, fac.sol, vd.shape[0]
    scale = weighted_max(gamma, row_weights)
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
        scale = max(scale, weighted_max(vd, run.system.weights))
        if off <= _RATE_TOLERANCE * scale:
            break
        solve(kkt, fac, sol)
        for i in range(nv):
            vd[i] += sol[place[i]]
    return SUCCESS


@kernel
def _solve_rows(kkt, fac, nv, values, sign):
    """fac.sol for the right side (0; sign × values)."""
    place, sol = kkt.place, fac.sol
    for i in range(nv):
        sol[place[i]] = 0.0
    for i in range(values.shape[0]):
        sol[place[nv + i]] = sign * values[i]
    solve(kkt, fac, sol)


# Forces that depend on reactions: largest number of iterations; relative change at convergence.
_MAX_FORCE_ROUNDS, _FORCE_TOLERANCE = 100, 1e-12


@unit
def solve_reactions(run: Run) -> int:
    """λ of Cqᵀ λ = Q − M v̇ at the state with the factor of its pose; returns the status."""
    at, fac, kkt, now = run.state_point, run.work.factor, run.system.kkt, run.work.now
    place, lam, before, res = kkt.place, at.lam, run.work.con.gamma, run.work.trial.res
    nv, nc, weights = res.shape[0], lam.shape[0], run.system.row_weights
    run_stage(run.stages.inertia, run, at)
    if now.history.shape[0] > 0:
        now.span[0] = at.t[0] - now.history[0]
    for n in range(_MAX_FORCE_ROUNDS):
        feedback_stage(run, at)
        reaction_stage(run, at)
        for i in range(nc):
            before[i] = lam[i]
            lam[i] = 0.0
            fac.rhs[place[nv + i]] = 0.0
        status = forces(run, at)
        if status != SUCCESS:
            return status
        _clear_modal_forces(run.system.parts.bodies, res)
        for i in range(nv):
            fac.rhs[place[i]] = -res[i]
        solve_refined(kkt, fac, 1)  # removes the effect of the regularisation, 1e-9
        change, size = 0.0, 0.0
        for i in range(nc):
            lam[i] = fac.sol[place[nv + i]]
            change = max(change, abs(lam[i] - before[i]) / weights[i])
            size = max(size, abs(lam[i]) / weights[i])
        if not depends_on_solution(run) or (n > 0 and change <= _FORCE_TOLERANCE * size):
            return SUCCESS
    return SELF_LOCKING if len(run.stages.reaction.units) > 0 else NO_LOOP_CONVERGENCE


@kernel
def _clear_modal_forces(bodies, res):
    """Set the residual of modal coordinates to zero: bodies are kept undeformed."""
    for k in range(bodies.shape[0]):
        for j in range(bodies[k]["m"]):
            res[bodies[k]["iv"] + 6 + j] = 0.0


_MAX_MOTION = 0.5  # largest displacement of an increment, over the size of the model or in radians
# Largest deviation from the prediction over the displacement of an increment; beyond, the point is
# on another branch or the increment is too long.
_MAX_DEVIATION = 0.25
_SAME_BRANCH = 1e-5  # deviation over the size of the model within which branches are the same
_VELOCITY_DEVIATION = 0.55  # the same for velocities, where a jump of v̇ in the increment gives 0.5
_MIN_MOTION = 1e-12  # displacement by a velocity deviation, over the size, that is round-off
_JUMP_RATIO = 3.0  # change of a function over that by its slopes, above which it jumps
_JUMP_ROUND_OFF = 1e-9  # change of a function over its size that is round-off
_REVERSED_COSINE = -0.5  # cosine between two directions below which they are reversed


@kernel
def are_finite(functions, fun):
    """Whether all functions of time alone and their derivatives are finite numbers."""
    s, live = 0.0, functions.live
    for k in range(live.shape[0]):
        if live[k] == 0:
            s += fun[k, 0] + fun[k, 1] + fun[k, 2]
    return math.isfinite(s)


@kernel
def next_increment(left, h, speed):
    """The increment to try [s]: h or less, such that the time `left` has similar increments."""
    if h * speed > _MAX_MOTION:
        h = _MAX_MOTION / speed
    if h > left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left else h


@unit
def predict(run: Run, path: Path, h: float) -> int:
    """Predict the displacement, v and v̇ over h by Taylor's series; set corrections to zero."""
    st, dq, at = run.state, run.work.trial.dq, run.trial_point
    v0, vd0, jerk, v, vd, correction = st.v, st.vd, path.jerk, at.v, at.vd, path.correction
    for i in range(v0.shape[0]):
        j = jerk[i]
        dq[i] = h * (v0[i] + h * (0.5 * vd0[i] + h * j / 6.0))
        v[i] = v0[i] + h * (vd0[i] + 0.5 * h * j)
        vd[i] = vd0[i] + h * j
        correction[i] = 0.0
    return SUCCESS


@unit
def store_point(run: Run, path: Path, h: float) -> int:
    """Store of the accepted trial point what the next point needs."""
    fun, before = run.work.con.fun, path.functions_before
    vd0, vd, jerk = run.state.vd, run.work.trial.vd, path.jerk
    for i in range(vd.shape[0]):
        jerk[i] = (vd[i] - vd0[i]) / h if h > 0.0 else 0.0
    copy(path.direction, path.direction_before)
    for k in range(before.shape[0]):
        for c in range(3):
            before[k, c] = fun[k, c]
    return SUCCESS


@unit
def check_branch(run: Run, path: Path, h: float, last: int) -> int:
    """Test that the trial point continues the motion of the state; returns the status.

    `last` = 1: there is no smaller increment, so a jump of the rate of a function is accepted.
    """
    functions, fun, w = run.system.functions, run.work.con.fun, run.system.weights
    v0, vd0, v, vd = run.state.v, run.state.vd, run.work.trial.v, run.work.trial.vd
    jerk, correction = path.jerk, path.correction
    if last == 1 and _jumps(functions, path.functions_before, fun, h, 0):
        return FUNCTION_JUMP
    off, motion, turned, speed = 0.0, 0.0, 0.0, 0.0
    for i in range(w.shape[0]):
        c = correction[i]
        d = c + h * h * (h * jerk[i] - (vd[i] - vd0[i])) / 6.0
        off = max(off, w[i] * abs(d))
        motion = max(motion, w[i] * (0.5 * h * abs(v0[i] + v[i]) + abs(c)))
        mean = 0.5 * h * (vd0[i] + vd[i])
        turned = max(turned, w[i] * abs(v[i] - v0[i] - mean))
        speed = max(speed, w[i] * max(abs(v0[i]), abs(v[i]), abs(mean)))
    far = off > _MAX_DEVIATION * motion and off > _SAME_BRANCH
    other = turned > _VELOCITY_DEVIATION * speed and h * turned > _MIN_MOTION
    if far or (other and not (last == 1 and _jumps(functions, path.functions_before, fun, h, 1))):
        return BRANCH_CHANGE
    return SUCCESS


@kernel
def _jumps(functions, before, now, h, order):
    """Whether a function (order 0) or its rate (order 1) jumps between two times.

    It jumps if it changes by more than `_JUMP_RATIO` times the change by the larger slope.
    """
    live = functions.live
    for k in range(live.shape[0]):
        if live[k] == 1:
            continue
        change = abs(now[k, order] - before[k, order])
        slope = max(abs(before[k, order + 1]), abs(now[k, order + 1]))
        size = 1.0 + max(abs(before[k, order]), abs(now[k, order]))
        if change > _JUMP_RATIO * h * slope and change > _JUMP_ROUND_OFF * size:
            return True
    return False


@unit
def record_singular_pose(run: Run, path: Path) -> int:
    """Count a singular pose between the state and the trial point, and store times and q."""
    weights, before, here = run.system.weights, path.direction_before, path.direction
    times, count = path.singular_times, path.count[0]
    both, first, second = 0.0, 0.0, 0.0
    for i in range(weights.shape[0]):
        w = weights[i] * weights[i]
        both += w * before[i] * here[i]
        first += w * before[i] * before[i]
        second += w * here[i] * here[i]
    if both < _REVERSED_COSINE * math.sqrt(first * second):
        k = count["singular_poses"]
        if k < times.shape[0]:
            times[k, 0], times[k, 1] = run.state.t[0], run.work.trial.t[0]
            copy(run.work.trial.q, path.singular_positions[k])
        count["singular_poses"] += 1
    return SUCCESS


@kernel
def add_works(h, k, power, powers, work):
    """Works (3) up to output k at interval h, by formulas of order four (Adams–Moulton, Simpson).

    `powers` (4, 3) has those of the last outputs, newest first; it is updated.
    """
    for c in range(3):
        for n in range(3):
            powers[3 - n, c] = powers[2 - n, c]
        powers[0, c] = power[c]
        p0, p1, p2, p3 = powers[0, c], powers[1, c], powers[2, c], powers[3, c]
        if k == 1:
            work[c] = 0.5 * h * (p0 + p1)
        elif k == 2:
            work[c] = h * (p0 + 4.0 * p1 + p2) / 3.0
        elif k > 2:
            work[c] += h * (9.0 * p0 + 19.0 * p1 - 5.0 * p2 + p3) / 24.0
