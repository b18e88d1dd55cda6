"""The iteration matrix of the equations of motion: assembly, factorisation, check of its pivots.

It is stored in the panels of the factor,

    S = [[M + cv ∂F/∂v + cp ∂F/∂q, Cqᵀ], [Cq, −ε]],

with F the inertia, applied and constraint forces on the left side, M v̇ + … + Cqᵀ λ − Q. With
cv = cp = 0 it is the matrix for accelerations and multipliers. The regularisation ε_i is 1e-9 times
(Cq diag(S)⁻¹ Cqᵀ)_ii: being relative, it does not depend on units or on the step size. Iterative
refinement removes its effect.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra import ldl
from flexmb.engine.algebra.vector import copy, zero
from flexmb.engine.equations_of_motion import velocity_stage
from flexmb.engine.jit import Vector, call_matrix, kernel, unit
from flexmb.engine.joints import ROW_KINDS
from flexmb.engine.joints.constraint import (
    REGULARISATION,
    constraint_jacobian,
    put_constraint_matrix,
)
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import ComplexFactor, Point, Run


@kernel
def add_matrix(run, at, cv, cp):
    """Tangents of all kinds, into the iteration matrix."""
    units, tables = run.stages.matrix.units, run.stages.matrix.tables
    for k in range(len(units)):
        call_matrix(units[k], run, tables[k], at, cv, cp)


@kernel
def add_couplings(run, at, cv, cp):
    """Unsymmetric terms in the columns of the multipliers."""
    units, tables = run.stages.coupling.units, run.stages.coupling.tables
    for k in range(len(units)):
        call_matrix(units[k], run, tables[k], at, cv, cp)


# Simplified Newton iteration: limits of the contraction (ratio of successive corrections).
REFACTOR_ABOVE = 0.3
"""Contraction with an old factor above which it is renewed within a step."""
SETTLED_NOISE = 10.0
"""A last correction is noise up to this many times one that was within round-off."""
# With a new factor: above the first the unsymmetric matrix is used, above the second a step fails.
_UNSYMMETRIC_ABOVE = 0.2
_FAIL_ABOVE = 0.9
_REDUNDANT_PIVOT = 1e-7  # pivot of a redundant row over that without other rows, at most
LARGEST_REDUNDANT_PIVOT = 10.0  # pivot of a redundant row over its regularisation
_INDEPENDENT_PIVOT_RATIO = 1e6  # pivot of an independent row over its regularisation, at least
# Refinements: most of them; ratio of successive changes above which more do not help; change over
# the largest acceleration that is round-off.
_MAX_REFINEMENTS, _SLOW_REFINEMENT, _REFINED = 30, 0.9, 1e-13
# Self-stress: the acceleration that it may cause, over that of its largest force; regularisation
# over ε.
_SELF_STRESS_TOLERANCE, _SELF_STRESS_REGULARISATION = 1e-10, 1e5
# Regularisation of a row times the largest mass that the row constrains, over `REGULARISATION`:
# above, the joint would yield to the load of that mass.
_UNEVEN_FACTOR = 1e5
_ANGULAR = tuple(kind.angular for kind in ROW_KINDS)


@unit
def put_matrix(run: Run, at: Point, cv: float, cp: float) -> int:
    """M + cv ∂F/∂v + cp ∂F/∂q at the point of the last position stage into the panels."""
    factor = run.work.factor
    low, up = factor.low, factor.up
    is_mass = cp == 0.0 and cv == 0.0 and factor.symmetric[0] == 1  # it is symmetric itself
    zero(low)
    if not is_mass:
        zero(up)
    if cp != 0.0 or cv != 0.0:
        velocity_stage(run, at)
    add_matrix(run, at, cv, cp)
    constraint_jacobian(run)
    if factor.symmetric[0] == 1 and not is_mass:
        for i in range(low.shape[0]):
            low[i] = 0.5 * (low[i] + up[i])
    return SUCCESS


@unit
def put_rows(run: Run, at: Point, cv: float, cp: float) -> int:
    """Add the constraint rows to the matrix, and unsymmetric terms in their columns."""
    put_constraint_matrix(run, at)
    if run.work.factor.symmetric[0] == 0 and (cp != 0.0 or cv != 0.0):
        add_couplings(run, at, cv, cp)
    return SUCCESS


@unit
def factorise(run: Run, at: Point, cv: float, cp: float) -> int:
    """Assemble S at the point of the last position stage and factor it.

    Returns the number of pivots that were replaced. `factor.symmetric` selects LDLᵀ or LDU. The
    matrix itself is stored in low0 and up0, for refinement.
    """
    factor, kkt = run.work.factor, run.system.kkt
    low, up, low0, up0 = factor.low, factor.up, factor.low0, factor.up0
    put_matrix(run, at, cv, cp)
    store_diagonal(kkt.panels, low, factor.diagonal)
    put_rows(run, at, cv, cp)
    copy(low, low0)
    if factor.symmetric[0] == 0:
        copy(up, up0)
    factor.replaced[0] = _factor_less_regularised(run)
    return factor.replaced[0]


# A row pivot below _SMALL_PIVOT_RATIO times its regularisation makes a joint too soft: all but the
# share _KEPT_REGULARISATION of the regularisation is removed, up to _MAX_REDUCTIONS times (after a
# third time it would be round-off). Pivots of redundant rows are as small, but fall with it, below
# _PIVOT_REDUCTION times their value before: then it is restored.
_SMALL_PIVOT_RATIO, _KEPT_REGULARISATION, _MAX_REDUCTIONS, _PIVOT_REDUCTION = 1e3, 1e-3, 2, 1.2e-3


@kernel
def _factor_less_regularised(run):
    """Factor S, with less regularisation if it would soften a joint of light and heavy bodies.

    low0 and up0 hold the matrix as well. The same share is removed from all rows, since the
    regularisation decides how redundant rows share a load. fac.tmp: regularisation removed in all;
    fac.rhs: pivots of the round before; fac.sol: regularisation removed in one round.
    """
    kkt, fac = run.system.kkt, run.work.factor
    replaced, eps, d, before = ldl.factor(kkt, fac), fac.eps, fac.d, fac.rhs
    zero(fac.tmp)
    for n in range(_MAX_REDUCTIONS):
        if not _has_small_pivot(eps, d) or (n == 0 and not _is_uneven(run)):
            break
        others, follow = False, False
        for k in range(eps.shape[0]):
            fac.sol[k], before[k] = (1.0 - _KEPT_REGULARISATION) * eps[k], abs(d[k])
        replaced = _factor_again(kkt, fac)
        for k in range(eps.shape[0]):
            follows = eps[k] > 0.0 and abs(d[k]) < _PIVOT_REDUCTION * before[k]
            follow = follow or follows
            others = others or (
                not follows and before[k] < _SMALL_PIVOT_RATIO * eps[k] / _KEPT_REGULARISATION
            )
        if follow and not others:
            for k in range(eps.shape[0]):
                fac.sol[k] *= -1.0
            replaced = _factor_again(kkt, fac)
        if follow:
            break
    return replaced


@kernel
def _has_small_pivot(eps, d):
    """Whether a pivot is small relative to its regularisation."""
    yields = False
    for k in range(eps.shape[0]):
        yields = yields or abs(d[k]) < _SMALL_PIVOT_RATIO * eps[k]
    return yields


@kernel
def _factor_again(kkt, fac):
    """Factor with the regularisation reduced by fac.sol; fac.tmp adds up the reductions."""
    for k in range(fac.eps.shape[0]):
        fac.eps[k] -= fac.sol[k]
        fac.tmp[k] += fac.sol[k]
    _add_diagonal(kkt.panels, fac.sol, 1.0, fac.low0)
    copy(fac.low0, fac.low)
    if fac.symmetric[0] == 0:
        _add_diagonal(kkt.panels, fac.sol, 1.0, fac.up0)
        copy(fac.up0, fac.up)
    return ldl.factor(kkt, fac)


@kernel
def _add_diagonal(panels, change, f, low):
    """low += f diag(change), in elimination order."""
    for p in range(panels.shape[0]):
        panel = panels[p]
        at, nc, col = panel["at"], panel["nc"], panel["col"]
        for c in range(nc):
            low[at + c * nc + c] += f * change[col + c]


@unit
def factorise_pair(run: Run, pair: ComplexFactor) -> int:
    """Factor the assembled matrix, and a complex one with the same regularisation."""
    factor, kkt = run.work.factor, run.system.kkt
    if run.state.memory[0]["regularisation"] == 0.0:
        copy(factor.low, factor.low0)
        copy(factor.up, factor.up0)
        replaced = _factor_less_regularised(run)
        _add_diagonal(kkt.panels, factor.tmp, 1.0, pair.low)
        _add_diagonal(kkt.panels, factor.tmp, 1.0, pair.up)
    else:
        replaced = ldl.factor(kkt, factor)
    ldl.factor_complex(kkt, pair)
    return replaced


@kernel
def _is_uneven(run):
    """Whether a joint or coupler has rows whose regularisation is large for one of its bodies.

    That is so if the masses of the bodies, or their inertias about the joint, differ very much.
    """
    rows, coupled = run.system.rows, run.system.coupled
    for k in range(rows.shape[0]):
        if _is_regularisation_large(run, k, rows[k]):
            return True
    for i in range(coupled.shape[0]):
        for j in range(coupled.shape[0]):
            share = i != j and coupled[i]["coordinate"] == coupled[j]["coordinate"]
            if share and _is_regularisation_large(run, coupled[i]["row"], rows[coupled[j]["row"]]):
                return True
    return False


@kernel
def _is_regularisation_large(run, k, other):
    """Whether the regularisation of row k is large relative to the bodies of the row `other`."""
    sys, heavy, diagonal = run.system, 0.0, run.work.factor.diagonal
    place, kind = sys.kkt.place, sys.rows[k]["kind"]
    if _ANGULAR[kind] != _ANGULAR[other["kind"]]:
        return False
    for marker in (other["I"], other["J"]):
        body = sys.parts.markers[marker]["body"]
        if body >= 0:
            first = sys.parts.bodies[body]["iv"] + (3 if _ANGULAR[kind] else 0)
            for i in range(first, first + 3):
                if heavy < diagonal[place[i]] < math.inf:
                    heavy = diagonal[place[i]]
    return (
        run.work.factor.eps[place[sys.weights.shape[0] + k]] * heavy
        > REGULARISATION * _UNEVEN_FACTOR
    )


@kernel
def store_diagonal(panels, low, out):
    """Store |diagonal| of the coordinates; infinite if it is zero, so that 1/diagonal is zero."""
    for i in range(panels.shape[0]):
        panel = panels[i]
        at, nc, col = panel["at"], panel["nc"], panel["col"]
        for c in range(nc):
            diagonal = abs(low[at + c * nc + c])
            out[col + c] = diagonal if diagonal > 0.0 else math.inf


@kernel
def permute(kkt, top, bottom, out):
    """out = (top, bottom) in elimination order."""
    n, place = top.shape[0], kkt.place
    for i in range(n):
        out[place[i]] = top[i]
    for i in range(bottom.shape[0]):
        out[place[n + i]] = bottom[i]


@unit
def factorise_metric(run: Run, at: Point, metric: Vector) -> int:
    """Assemble and factor [[W, Cqᵀ], [Cq, −ε]] with a diagonal metric W (nv), for kinematics.

    The columns of modal coordinates in Cq are zero: flexible bodies keep their shape. Returns the
    number of pivots that were replaced.
    """
    factor, kkt, parts = run.work.factor, run.system.kkt, run.system.parts
    low, low0 = factor.low, factor.low0
    zero(low)
    factor.symmetric[0] = 1
    put_metric(parts, kkt, metric, low)
    store_diagonal(kkt.panels, low, factor.diagonal)
    constraint_jacobian(run)
    _clear_modal_columns(parts, run.system.rows, run.work.dense.jac)
    put_constraint_matrix(run, at)
    copy(low, low0)
    factor.replaced[0] = ldl.factor(kkt, factor)
    return factor.replaced[0]


@kernel
def least_pivot(run, nv):
    """The smallest pivot of a row over that without other rows: small near a singular pose.

    Redundant rows, whose pivot is round-off, are left out.
    """
    fac, place, least = run.work.factor, run.system.kkt.place, 1.0
    for i in range(nv, place.shape[0]):
        k = place[i]
        if fac.eps[k] > 0.0:
            pivot = abs(fac.d[k]) * REGULARISATION / fac.eps[k]
            least = min(least, pivot if pivot > _REDUNDANT_PIVOT else 1.0)
    return least


@kernel
def has_dependent_rows(fac, redundant):
    """Whether constraint rows are nearly dependent, by their pivots over the regularisation.

    Rows with a ratio below `redundant` are left out: they are redundant in any pose.
    """
    for k in range(fac.eps.shape[0]):
        pivot = abs(fac.d[k])
        if redundant * fac.eps[k] < pivot < _INDEPENDENT_PIVOT_RATIO * fac.eps[k]:
            return True
    return False


@unit
def solve_motion(run: Run) -> int:
    """fac.sol = S⁻¹ fac.rhs, refined until the coordinates no longer change.

    A round reduces the error of nearly dependent rows by their pivot over the regularisation.
    """
    fac, kkt, weights = run.work.factor, run.system.kkt, run.system.weights
    place, last = kkt.place, math.inf
    ldl.solve_refined(kkt, fac, 1)
    for _ in range(_MAX_REFINEMENTS):
        ldl.refine(kkt, fac)
        change, size = 0.0, 0.0
        for i in range(weights.shape[0]):
            k = place[i]
            change = max(change, abs(fac.tmp[k]) * weights[i])
            size = max(size, abs(fac.sol[k]) * weights[i])
        if change <= _REFINED * size or change >= _SLOW_REFINEMENT * last:
            break
        last = change
    return SUCCESS


@unit
def remove_self_stress(run: Run, at: Point, cp: float) -> int:
    """Remove the self-stress of redundant constraints from λ, after `accelerations` with this cp.

    Self-stress is s with Cqᵀ s = 0. Of all solutions `accelerations` gives that of least norm in
    M + cp ∂F/∂q, which changes with step and pose, and round-off over ε of self-stress. With M
    alone, [[M, Cqᵀ], [Cq, 0]] (x; λ) = (Cqᵀ λ₀; 0) gives the same λ in all; with a larger ε its
    round-off is less. If x is not zero, the rows are independent: λ₀ is kept.
    """
    fac, kkt, lam, eps = run.work.factor, run.system.kkt, at.lam, run.work.factor.eps
    place, nv = kkt.place, at.vd.shape[0]
    if fac.replaced[0] != 0 or not has_dependent_rows(fac, 0.0):
        return SUCCESS
    if cp != 0.0 and factorise(run, at, 0.0, 0.0) != 0:
        return SUCCESS
    zero(fac.sol)
    for i in range(lam.shape[0]):
        fac.sol[place[nv + i]] = lam[i]
    ldl.multiply(kkt, fac, fac.sol, fac.rhs)
    for i in range(lam.shape[0]):
        fac.rhs[place[nv + i]] = 0.0
    for change in (-_SELF_STRESS_REGULARISATION, 1.0 - 1.0 / _SELF_STRESS_REGULARISATION):
        for k in range(eps.shape[0]):
            fac.sol[k] = change * eps[k]
        if _factor_again(kkt, fac) == 0 and _is_self_stress_removed(run, nv):
            for i in range(lam.shape[0]):
                lam[i] = fac.sol[place[nv + i]]
            break
    return SUCCESS


@kernel
def _is_self_stress_removed(run, nv):
    """Solve for (x; λ) of `remove_self_stress`; whether x became zero."""
    fac, kkt, weights = run.work.factor, run.system.kkt, run.system.weights
    place, most, last = kkt.place, 0.0, math.inf
    for i in range(nv):
        most = max(most, abs(fac.rhs[place[i]]) / fac.diagonal[place[i]] * weights[i])
    ldl.solve_refined(kkt, fac, 0)
    for _ in range(_MAX_REFINEMENTS):
        ldl.refine(kkt, fac)
        moved = 0.0
        for i in range(nv):
            moved = max(moved, abs(fac.sol[place[i]]) * weights[i])
        if moved >= _SLOW_REFINEMENT * last:
            break
        last = moved
    return last <= _SELF_STRESS_TOLERANCE * most


@kernel
def put_metric(parts, kkt, metric, low):
    """Put the metric (nv) of bodies and scalar coordinates on the diagonal."""
    bodies, coordinates, panels, column = parts.bodies, parts.coordinates, kkt.panels, kkt.column
    for i in range(bodies.shape[0]):
        body = bodies[i]
        panel, o = panels[body["panel"]], body["iv"]
        for c in range(6 + body["m"]):
            pc = column[o + c]
            if pc >= 0:
                low[panel["at"] + pc * panel["nc"] + pc] = metric[o + c]
    for k in range(coordinates.shape[0]):
        low[panels[coordinates[k]["panel"]]["at"]] = metric[coordinates[k]["iv"]]


@kernel
def _clear_modal_columns(parts, rows, jac):
    """Set the columns of modal coordinates in the constraint Jacobian to zero."""
    bodies, markers = parts.bodies, parts.markers
    for k in range(rows.shape[0]):
        for side in range(2):
            at = rows[k]["jac_I"] if side == 0 else rows[k]["jac_J"]
            if at >= 0:
                marker = rows[k]["I"] if side == 0 else rows[k]["J"]
                m = bodies[markers[marker]["body"]]["m"]
                for c in range(6, 6 + m):
                    jac[at + c] = 0.0


@kernel
def check_contraction(memory, contraction):
    """Decide by the contraction whether to renew the factor, or use the unsymmetric matrix.

    Returns whether the step fails.
    """
    fresh = memory["factor_age"] == 0.0
    if contraction > _UNSYMMETRIC_ABOVE and memory["symmetric"] == 1.0 and fresh:
        memory["symmetric"] = 0.0
        memory["factor_age"] = -1.0
    elif contraction > REFACTOR_ABOVE and not fresh:
        memory["factor_age"] = -1.0
    return contraction > _FAIL_ABOVE and fresh and memory["factor_age"] == 0.0
