"""One point of a kinematic analysis: positions, velocities and accelerations from the constraints.

The factor is that of [[W, Cqᵀ], [Cq, −ε]], W a diagonal metric. Newton's method for the positions
begins with the factor of the point before, and renews it where its contraction is poor; the factor
of the pose that it finds then serves velocities, accelerations and reactions.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import inlined, kernel
from flexmb.engine.kernels.algebra.ldl import multiply, solve
from flexmb.engine.kernels.algebra.vector import weighted_size
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.bodies.motion import move
from flexmb.engine.kernels.joints import constraint, coordinate
from flexmb.engine.kernels.kkt import factorise_metric
from flexmb.engine.method import FINE, NO_CONVERGENCE, NOT_FINITE, SINGULAR, UNLIKE_RATES

_ITERATIONS = 15
_MOVED, _PIVOT = 1, 2  # places in Path.number
_OLD = 0.02  # motion after which a factor is renewed before it is used
_RENEW_ABOVE = 0.05  # contraction from which on a new factor costs less than iterations
_GIVE_UP_ABOVE = 0.9
_FAR = 0.5  # a correction of this size does not belong to the prediction
_LAST_PLACES = 4e-16
_OPEN = 1e-10  # rows that repeat others may leave this much
_ROUNDS = 6
_EXACT = 1e-13  # relative, of velocities and accelerations
_UNLIKE = 1e-7  # relative: rows that repeat others and ask for other velocities
# Least pivot of a row, over what it is without the rest of the mechanism, against the largest such
# so far: a singular pose below. (Where rows repeat others their pivots are small anyhow.)
_SINGULAR = 1e-7
_REGULARISATION = 1e-9


@inlined
def close(sys, settings, wk, path):
    """Put the trial positions on C = 0; leaves the factor of the pose. Returns the status."""
    tr, con, sol, place = wk.trial, wk.con, wk.factor.sol, sys.kkt.place
    nv = tr.dq.shape[0]
    renew = path.number[_MOVED] < 0.0 or path.number[_MOVED] > _OLD
    enough = settings.closed + _noise(sys.rows, sys.row_weights, con.fun)
    size, last, fresh = math.inf, 0.0, False
    for _ in range(_ITERATIONS):
        coordinate.put_values(sys.parts.coordinates, sys, tr.q, con.fun)
        kinematics.position(sys.parts, wk.now, tr.q)
        constraint.evaluate(sys.lines, sys.rows, wk.now.marker, con)
        gap = weighted_size(con.C, sys.row_weights)
        closed = gap <= enough or (size <= enough and gap <= _OPEN)
        if not gap < math.inf:
            return NOT_FINITE
        if closed or renew:
            factorise_metric(sys, wk, path.metric)
            path.number[_MOVED] = 0.0
            path.count[1] += 1
            if closed:
                return FINE
            fresh, last = True, 0.0
        _solve_rows(sys.kkt, wk.factor, nv, con.C, -1.0)
        size = 0.0
        for i in range(nv):
            d = sol[place[i]]
            tr.dq[i] = d
            path.change[i] += d
            size = max(size, abs(d) * sys.weights[i])
        path.count[0] += 1
        if not size <= _FAR:
            return NO_CONVERGENCE
        renew = last > 0.0 and size > _RENEW_ABOVE * last and size > enough
        if fresh and last > 0.0 and size > _GIVE_UP_ABOVE * last and gap > _OPEN:
            return NO_CONVERGENCE
        last = size
        move(sys.parts, tr.q, tr.dq, tr.q)
        path.number[_MOVED] += size
    return NO_CONVERGENCE


@kernel
def _noise(rows, row_weights, fun):
    """Round-off of what the rows compare with functions of time, weighted."""
    size = 0.0
    for k in range(rows.shape[0]):
        if rows[k]["fun"] >= 0:
            size = max(size, abs(fun[rows[k]["fun"], 0]) * row_weights[k])
    return _LAST_PLACES * size


@inlined
def rates(sys, settings, wk, path):
    """Trial velocities and accelerations from the constraints, from guesses; returns the status."""
    tr, con, sol, place = wk.trial, wk.con, wk.factor.sol, sys.kkt.place
    nv = tr.dq.shape[0]
    if settings.redundant == 0:
        pivot = _least_pivot(place[nv:], wk.factor.d, wk.factor.eps)
        path.number[_PIVOT] = max(path.number[_PIVOT], pivot)
        if pivot < _SINGULAR * path.number[_PIVOT]:
            return SINGULAR
    scale, off = 0.0, math.inf
    for n in range(_ROUNDS + 1):
        kinematics.velocity(sys.parts, wk.now, tr.v)
        coordinate.put_rates(sys.parts.coordinates, sys, tr.v, con.fun)
        constraint.rates(sys.lines, sys.rows, wk.now.marker, con, wk.dense.g[0])
        off = weighted_size(con.rate, sys.row_weights)
        scale = max(scale, off, weighted_size(tr.v, sys.weights))
        if off <= _EXACT * scale or n == _ROUNDS:
            break
        _solve_rows(sys.kkt, wk.factor, nv, con.rate, -1.0)
        for i in range(nv):
            tr.v[i] += sol[place[i]]
    if off > _UNLIKE * scale:
        return UNLIKE_RATES
    kinematics.bias(sys.parts, wk.now, tr.v)
    constraint.right_side(sys.lines, sys.rows, wk.now.marker, con, wk.dense.g[0])
    _accelerations(sys.kkt, wk.factor, sys.weights, sys.row_weights, con.gamma, tr.vd)
    # The solution of Cq x = probe: its direction flips where det Cq passes zero.
    _solve_rows(sys.kkt, wk.factor, nv, path.probe, 1.0)
    for i in range(nv):
        path.look[i] = sol[place[i]]
    return FINE


@kernel
def _least_pivot(places, d, eps):
    """The smallest pivot of a row over its own compliance: small where others decide the row."""
    least = 1.0
    for i in range(places.shape[0]):
        k = places[i]
        if eps[k] > 0.0:
            least = min(least, abs(d[k]) * _REGULARISATION / eps[k])
    return least


@kernel
def _accelerations(kkt, fac, w, row_weights, gamma, vd):
    """Correct vd to Cq v̇ = γ."""
    place, nv = kkt.place, vd.shape[0]
    scale = weighted_size(gamma, row_weights)
    for _ in range(_ROUNDS):
        for i in range(nv):
            fac.rhs[place[i]] = vd[i]
        for i in range(gamma.shape[0]):
            fac.rhs[place[nv + i]] = 0.0
        multiply(kkt, fac, fac.rhs, fac.tmp)
        off = 0.0
        for i in range(nv):
            fac.sol[place[i]] = 0.0
        for i in range(gamma.shape[0]):
            k = place[nv + i]
            fac.sol[k] = gamma[i] - fac.tmp[k]
            off = max(off, abs(fac.sol[k]) * row_weights[i])
        scale = max(scale, weighted_size(vd, w))
        if off <= _EXACT * scale:
            break
        solve(kkt, fac, fac.sol)
        for i in range(nv):
            vd[i] += fac.sol[place[i]]


@kernel
def _solve_rows(kkt, fac, nv, values, sign):
    """fac.sol from no forces on the coordinates and these values of the rows, times a sign."""
    for i in range(nv):
        fac.sol[kkt.place[i]] = 0.0
    for i in range(values.shape[0]):
        fac.sol[kkt.place[nv + i]] = sign * values[i]
    solve(kkt, fac, fac.sol)
