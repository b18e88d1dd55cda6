"""The integration method of a run with its coefficients, and the settings of the time loop.

Contract of a step: a method is one file in `integrators` with a unit `step(run, coefficients, h) ->
status`. It reads `State` and writes the trial state at t + h to `Work.trial`; under error control
also its estimate of the local error, over the error scales, to `trial.error`. Only the time loop
accepts and rejects steps, selects the next step size, stores and reports. A second unit,
`interpolate(run, coefficients, share) -> status`, is the dense output: positions and velocities
inside the last accepted step. What a method carries from step to step (previous accelerations,
contraction, step sizes) is in `State`; so multi-step, multi-stage and explicit methods have the
same form. As a step is only proposed, an event between `State` and the trial state can still
shorten or reject it. The options of methods in a scene are in `model.scenes.dynamics`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.jit import Records, Units, kernel


class Method(NamedTuple):
    """An integration method with its options in a scene."""

    step: Units  # (1,) its unit `step`
    interpolate: Units  # (1,) its unit `interpolate`
    coefficients: Records  # (1,) its coefficients
    order: int  # global order p: the error at the end is of order h^p
    error_order: int  # power of h in its estimate of the local error
    stages: int  # number of stages of an explicit method, 0 of others
    filter: float  # b/h² in M + b ∂F/∂q, with which reported accelerations are solved for
    prefers_constant_step: int  # 1: a change of h costs a factorisation or upsets its estimate
    collocation: int  # number of implicit collocation stages
    max_tolerance: float  # largest local tolerance at which errors fall with the order
    stabilised: int = 0  # 1: Baumgarte, C̈ + 2α Ċ + β² C = 0, in place of projection
    alpha: float = 0.0  # 1/s
    beta: float = 0.0  # 1/s
    mass_refinements: int = 0  # refinements with M of projected velocities and accelerations
    partitions: int = 0  # 1: it partitions coordinates into independent and dependent ones


class Settings(NamedTuple):
    """Settings of the time loop."""

    start: float  # s
    end: float  # s
    interval: float  # mean interval between outputs, s
    step: float  # fixed step, s, a whole fraction of the run; 0: error control
    tolerance: float  # of the local error of a step over the error scales (error control)
    accuracy: float  # requested error at the end over the motion (error control)
    rejection_factor: float  # a step is repeated if its error exceeds this times `tolerance`
    max_rotation: float  # largest rotation of a body in a step, rad
    refinement: float  # steps per step of the plan that the run follows; 0: it writes a plan
    least_motion: float  # displacement over the size of the model below which it is at rest
    newton_tolerance: float  # Newton correction over h² v̇ at convergence; 0: by `tolerance`
    max_iterations: int
    does_work: int  # 1: drivers, dampers or applied forces do work
    stiff: int  # 1: the model has springs, flexible bodies or other stiffness
    determinate: int  # 1: the constraints alone fix the motion (no degree of freedom)
    static_after_step: int  # 1: quasi-static modes are solved for after a step, 0: within it
    fractional: int = 0  # 1: a force d^n of a contact or stop has an n that is no whole number


HIGH_ORDER = 5  # least order of methods that lose most of it if forces jump
STEP_ROUND_OFF = 1e-6  # over a fixed step, whose parts are powers of 1/2 and far larger


@kernel
def time_round_off(settings):
    """Largest difference of two times that count as equal [s]."""
    if settings.step > 0.0:
        return STEP_ROUND_OFF * settings.step
    return 1e-12 * (settings.end - settings.start)


@kernel
def next_end(time_events, t, end):
    """Latest end of a step that begins at t [s]: the next time event, or the end of the run."""
    k = count_passed(time_events, t)
    return min(time_events[k, 0], end) if k < time_events.shape[0] else end


@kernel
def count_passed(time_events, t):
    """Number of time events whose time just before is t or earlier."""
    low, high = 0, time_events.shape[0]
    while low < high:
        middle = (low + high) // 2
        if time_events[middle, 0] <= t:
            low = middle + 1
        else:
            high = middle
    return low


# Status codes of the kernels; `status_messages` turns them into sentences.
SUCCESS, NO_CONVERGENCE, ZERO_LENGTH, NOT_FINITE, STEP_TOO_SMALL, REPEAT = range(6)
CURVE_END = 7  # a joint leaves its curve at an end
SELF_LOCKING = 8  # the iteration of joint friction and reactions does not converge
NO_PARTITION = 9  # no choice of independent coordinates determines the others
NO_LOOP_CONVERGENCE = 20  # that of forces with accelerations or reactions does not converge
# Of a kinematic analysis: a singular pose, a point on another branch, a function that jumps,
# redundant rows that contradict each other in their velocities.
SINGULAR_POSE, BRANCH_CHANGE, FUNCTION_JUMP, INCONSISTENT_VELOCITIES = range(30, 34)

#: Memory of the step control and of Newton's method from step to step.
INTEGRATOR_MEMORY = np.dtype([
    ("contraction", "f8"),  # ratio of successive corrections of Newton's method
    ("factor_age", "f8"),  # steps that the factor has served; < 0: there is none
    ("symmetric", "f8"),  # 1: the factor is of the symmetrised matrix
    ("factor_step", "f8"),  # step size that the factor is for, s
    ("regularisation", "f8"),  # of constraint rows, over the standard one; 0: standard
    ("next_step", "f8"),  # size of the step to try next, s
    ("last_step", "f8"),  # of the last accepted step, s
    ("earlier_step", "f8"),  # of the accepted step before that, s
    ("step_fraction", "f8"),  # part of a fixed step that is done, 0 to 1
    ("smallest_step", "f8"),  # of all accepted steps, s
    ("largest_step", "f8"),
    ("max_displacement", "f8"),  # so far, weighted; at least Settings.least_motion
    ("max_velocity", "f8"),  # so far, weighted
    ("recent_speed", "f8"),  # largest weighted velocity, decaying from step to step
    ("usual_speed", "f8"),  # typical weighted velocity, from a coarse run before this one
    ("driven_rate", "f8"),  # acceleration over velocity of driven coordinates, decaying, 1/s
    ("travel", "f8"),  # sum of weighted velocity times step size
    ("angular_velocity", "f8"),  # largest one at present, rad/s
    ("error_sum", "f8"),  # sum of the local errors over the motion
    ("error_ratio", "f8"),  # error of the last step over the allowed one
    ("velocity_error", "f8"),  # of the last step, over h³
    ("steps_at_this_size", "f8"),  # accepted in a row
    ("steps_at_jump", "f8"),  # in a row, accepted with any error
    ("recent_time", "f8"),  # start of the present count of slow steps, s
    ("steps_since", "f8"),  # steps since then
    ("failing_time", "f8"),  # start of the present count of failed steps, s
    ("failures_since", "f8"),  # failed steps since then
    ("static_lag", "f8"),  # sum over steps: kinetostatic modes from the path of their rates, m
    ("static_size", "f8"),  # sum over steps: displacement by these modes, m
    ("steps_since_output", "f8"),
    ("steps_until_growth", "f8"),  # steps until the step size may grow, after a rejection
    ("rejected_step", "f8"),  # size of the last rejected step, s; 0 once its end is passed
    ("rejected_ratio", "f8"),  # its error over the allowed one
    ("rejected_start", "f8"),  # its start and its end, s
    ("rejected_end", "f8"),
    ("has_kink", "f8"),  # 1: a force seems to jump or have a kink within it
    ("step_before_event", "f8"),  # size of the step before it was shortened for an event, s
    ("event_trials", "f8"),  # how often it was shortened
    ("steps_until_event_search", "f8"),  # steps until events of elements are located again
    ("steps_until_law_search", "f8"),  # steps until events of functions are
    ("steps_at_stability_limit", "f8"),  # of an explicit method
    ("stable_step", "f8"),  # largest stable next step of an explicit method, s
    ("fastest_rate", "f8"),  # rate of the motion at the first step at that limit, 1/s
])  # fmt: skip

#: Counters of a run, from its start.
COUNTERS = np.dtype([
    ("steps", "i8"),
    ("residuals", "i8"),
    ("factorisations", "i8"),
    ("regularised_pivots", "i8"),
    ("rejected", "i8"),
    ("failed", "i8"),
    ("fixed_steps", "i8"),  # completed ones
    ("outputs", "i8"),  # rows written
    ("events", "i8"),
    ("partitions", "i8"),  # how often independent coordinates were selected again
])  # fmt: skip
