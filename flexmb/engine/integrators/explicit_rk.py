"""Explicit Runge–Kutta of high order on the index-1 form, one step, or Baumgarte's method.

Every stage solves [[M, Cqᵀ], [Cq, −ε]] (v̇; λ) = (Q; γ) and integrates q̇ = N(q) v, v̇ as one vector
(q, v); the Euler parameters of a stage are normalised before it is evaluated. After the step
positions and velocities are put on the constraints, and the accelerations there are the first stage
of the next step. For scenes without stiff forces.

Baumgarte's method has γ − 2α (Cq v + C_t) − β² C for γ, so that violations of the constraints obey
C̈ + 2α Ċ + β² C = 0 and die out with critical damping for α = β (Baumgarte, Comput. Methods Appl.
Mech. Eng. 1 (1972) 1). Nothing is projected, neither after a step nor for the outputs: joints drift
by what steps and gains leave. With α = β = 0 it is the plain augmented method, whose drift grows
with t². Gains are rates of the motion like any other: a step must be short against 1/α, and the
order of the method holds for steps that are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexmb.engine.algebra.vector import copy
from flexmb.engine.bodies.motion import normalise, position_rate
from flexmb.engine.integrators import runge_kutta
from flexmb.engine.integrators.runge_kutta import (
    Tableau,
    begin_step,
    combine,
    end_step,
    explicit_method,
    put_shares,
    put_slopes,
    tableau_of,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import FINE, Method
from flexmb.engine.projection import NOTHING, POSITIONS, accelerations
from flexmb.engine.state import Run

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec

# Violations fall to 1/e within this share of the run by default, and within a fixed step at least.
_SHARE = 0.05


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene, by its `order`."""
    return explicit_method(tableau_of(spec), step, interpolate)


def stabilised_method(spec: DynamicsSpec) -> Method:
    """Baumgarte's method for a scene, by its `order`, `baumgarte_alpha` and `baumgarte_beta`."""
    usual = 1.0 / max(_SHARE * spec.duration, spec.step or 0.0)
    alpha = usual if spec.baumgarte_alpha is None else spec.baumgarte_alpha
    beta = usual if spec.baumgarte_beta is None else spec.baumgarte_beta
    return explicit_method(
        tableau_of(spec), step, interpolate, stabilised=1, alpha=alpha, beta=beta
    )


def dormand_prince_5() -> Method:
    """The method of order 5."""
    return explicit_method(runge_kutta.dormand_prince_5(), step, interpolate)


def dormand_prince_8() -> Method:
    """The method of order 8."""
    return explicit_method(runge_kutta.dormand_prince_8(), step, interpolate)


@unit
def step(run: Run, tableau: Tableau, h: float) -> int:
    """One step from the state; see the contract in `engine.method`."""
    st, tr, stages = run.state, run.work.trial, tableau.stages
    position_rate(run.system.parts, st.q, st.v, tr.stages[0])
    begin_step(run)
    for s in range(1, stages):
        status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], s, h, NOTHING)
        if status != FINE:
            return status
    copy(tr.v, tr.aa_start)
    status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], stages, h, POSITIONS)
    return end_step(run, tableau, h, status, True)


@kernel
def _evaluate_stage(run, tableau, q, v, t, s, h, project):
    """Slopes of stage s of a step h from (t, q, v); leaves its state in the trial state."""
    tr, parts, nq = run.work.trial, run.system.parts, q.shape[0]
    combine(q, tr.stages, 0, tableau.A[s], s, h, tr.q)
    combine(v, tr.stages, nq, tableau.A[s], s, h, tr.v)
    normalise(parts.bodies, tr.q)
    tr.t[0] = t + tableau.c[s] * h
    status = accelerations(run, run.trial_point, 0.0, project)
    position_rate(parts, tr.q, tr.v, tr.stages[s])
    put_slopes(run, s)
    return status


@unit
def interpolate(run: Run, tableau: Tableau, share: float) -> int:
    """Positions and velocities at a share of the last accepted step, into the trial state."""
    tr, before = run.work.trial, run.work.trial.before
    h = run.state.t[0] - before.t[0]
    count, weights, nq = tableau.c.shape[0], tr.shares, before.q.shape[0]
    if tr.extended[0] == 0:
        for s in range(tableau.stages + 1, count):
            status = _evaluate_stage(run, tableau, before.q, before.v, before.t[0], s, h, NOTHING)
            if status != FINE:
                return status
        tr.extended[0] = 1
    put_shares(tableau, share, weights)
    combine(before.q, tr.stages, 0, weights, count, h, tr.q)
    combine(before.v, tr.stages, nq, weights, count, h, tr.v)
    copy(before.work_done, tr.work_done)
    if run.settings.works == 1:
        combine(before.work_done, tr.stages, nq + tr.v.shape[0], weights, count, h, tr.work_done)
    normalise(run.system.parts.bodies, tr.q)
    return FINE


METHODS = {"explicit-rk": make_method, "baumgarte": stabilised_method}
