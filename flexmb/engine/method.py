"""What a run is asked to do: the method with its coefficients, and the settings of the loop.

The step contract. A method is one file in `integrators` with a unit `step(run, coefficients, h) ->
status` that reads `State` and leaves the trial state at t + h in `Work.trial`, with its estimate of
the local error, over the motion so far, in `trial.error` if steps are controlled; the loop alone
accepts, rejects, chooses the next step, stores and reports. A second unit, `interpolate(run,
coefficients, share) -> status`, gives positions and velocities inside the last accepted step.
Memory that a method carries from step to step (previous accelerations, contraction, step sizes)
lives in `State`, so a multi-step method, a multi-stage method and an explicit one fit alike; and
because a step is only proposed, an event found between `State` and the trial state can still
shorten or reject it. The words of methods are
`model.scenes.dynamics`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.jit import Records, Units, kernel


class Method(NamedTuple):
    """A method for a scene."""

    step: Units  # its unit `step`, alone
    interpolate: Units  # its unit for the state inside an accepted step, alone
    coefficients: Records  # its coefficients, alone
    order: int  # of the error in the end
    error_order: int  # power of the step that its estimate of the local error is of
    stages: int  # rows of slopes that it needs memory for
    filter: float  # over h²: b of M + b ∂F/∂q, by which reported accelerations are solved for
    prefers_constant_step: int  # 1: a change of the step is dear, or its estimate rings after one
    collocation: int  # implicit stages that it needs memory for
    max_tolerance: float  # largest local one with which errors fall as the order says
    stabilised: int = 0  # 1: C̈ + 2α Ċ + β² C = 0 in place of projection onto the constraints
    alpha: float = 0.0  # 1/s
    beta: float = 0.0  # 1/s
    mass_refinements: int = 0  # refinements of projected rates and accelerations by M alone
    end_power_weight: float = 0.0  # of the power at the end in the works of a step
    partitions: int = 0  # 1: it needs memory for independent and dependent coordinates


class Settings(NamedTuple):
    """Numbers of the loop."""

    start: float  # s
    end: float  # s
    interval: float  # mean one between outputs, s
    step: float  # s, a whole share of the run; 0: steps by error control
    tolerance: float  # local error of a step over motion and speed so far, with error control
    accuracy: float  # error over motion in the end, with error control
    rejection_factor: float  # times `tolerance`: from which on a step is repeated shorter
    max_rotation: float  # largest angle that a body turns in a step, rad
    refinement: float  # steps for each step of the plan; 0: the plan is not followed but written
    least_motion: float  # motion over the size of the model below which it counts as at rest
    newton_tolerance: float  # remaining Newton correction over h² v̇; 0: a share of `tolerance`
    max_iterations: int
    does_work: int  # 1: something does work (drivers, dampers, applied forces)
    stiff: int  # 1: springs, flexible bodies or other stiffness
    determinate: int  # 1: the constraints alone fix the motion (no free coordinate)
    static_after_step: int  # 1: quasi-static modes follow the loads after a step, 0: within it


HIGH_ORDER = 5  # from which on methods have most to lose where forces jump, and errors are small
STEP_ROUND_OFF = 1e-6  # parts of a fixed step are powers of a half, so this is far below them


@kernel
def time_round_off(settings):
    """Times that differ by less are the same [s]."""
    if settings.step > 0.0:
        return STEP_ROUND_OFF * settings.step
    return 1e-12 * (settings.end - settings.start)


# Status codes of the kernels; `status_messages` turns them into sentences.
SUCCESS, NO_CONVERGENCE, ZERO_LENGTH, NOT_FINITE, STEP_TOO_SMALL, REPEAT = range(6)
CURVE_END = 7  # a joint leaves its curve at an end
SELF_LOCKING = 8  # friction in joints and the reactions that cause it do not settle
NO_PARTITION = 9  # no choice of independent coordinates determines the others
NO_LOOP_CONVERGENCE = 20  # forces that depend on accelerations or reactions do not settle
# Of a kinematic analysis: a singular pose, a point that does not continue the motion, a function
# that jumps, rows that repeat others and ask for other velocities.
SINGULAR_POSE, BRANCH_CHANGE, FUNCTION_JUMP, INCONSISTENT_VELOCITIES = range(30, 34)

#: Memory of the time loop and of Newton's method, from step to step.
INTEGRATOR_MEMORY = np.dtype([
    ("contraction", "f8"),  # of Newton's method
    ("factor_age", "f8"),  # steps that the factor has served; < 0: there is none
    ("symmetric", "f8"),  # 1: it is that of the symmetric matrix
    ("factor_step", "f8"),  # the step that it is for, s
    ("regularisation", "f8"),  # of constraint rows, over the usual; 0: as usual
    ("next_step", "f8"),  # the step to try next, s
    ("last_step", "f8"),  # the last one accepted, s
    ("earlier_step", "f8"),  # and the one before, s
    ("step_fraction", "f8"),  # of a fixed step, that is done
    ("smallest_step", "f8"),  # accepted, s
    ("largest_step", "f8"),
    ("max_displacement", "f8"),  # so far, weighted
    ("max_velocity", "f8"),  # of the motion itself, without what counts as rest
    ("recent_speed", "f8"),  # its largest one, which fades from step to step
    ("usual_speed", "f8"),  # that a rough run before this one tells
    ("travel", "f8"),  # sum of speed and step
    ("angular_velocity", "f8"),  # largest one now, rad/s
    ("error_sum", "f8"),  # of the local errors over the motion
    ("error_ratio", "f8"),  # error of the last step over what is allowed
    ("velocity_error", "f8"),  # of the last step, over h³
    ("steps_at_this_size", "f8"),
    ("steps_at_jump", "f8"),  # in a row, whose error is of its size
    ("recent_time", "f8"),  # since which steps have hardly advanced, s
    ("steps_since", "f8"),
    ("failing_time", "f8"),  # since which those that fail have, s
    ("failures_since", "f8"),
    ("steps_since_output", "f8"),
    ("steps_until_growth", "f8"),  # after a rejection
    ("rejected_step", "f8"),  # the last one, s; 0 behind its end
    ("rejected_ratio", "f8"),  # its error over what is allowed
    ("rejected_start", "f8"),  # times at which it began and would have ended, s
    ("rejected_end", "f8"),
    ("has_kink", "f8"),  # 1: a force jumps or has a kink within it
    ("step_before_event", "f8"),  # before it was shortened to end at one, s
    ("event_trials", "f8"),  # how often it was shortened
    ("steps_until_event_search", "f8"),  # after an event
    ("steps_until_law_search", "f8"),  # after a change of the law of a function
    ("steps_at_stability_limit", "f8"),  # of an explicit method
    ("stable_step", "f8"),  # that it may take next, s
    ("fastest_rate", "f8"),  # of the motion at the first one, 1/s
])  # fmt: skip

#: What a run has done so far.
COUNTERS = np.dtype([
    ("steps", "i8"),
    ("residuals", "i8"),
    ("factorisations", "i8"),
    ("regularised_pivots", "i8"),
    ("rejected", "i8"),
    ("failed", "i8"),
    ("fixed_steps", "i8"),  # whole ones
    ("outputs", "i8"),  # rows written
    ("events", "i8"),
    ("partitions", "i8"),  # times that independent coordinates were chosen again
])  # fmt: skip
