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
`model.tasks.methods`.
"""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.records import Records, Units


class Method(NamedTuple):
    """A method for a scene."""

    step: Units  # its unit `step`, alone
    interpolate: Units  # its unit for the state inside an accepted step, alone
    coefficients: Records  # its coefficients, alone
    order: int  # of the error in the end
    error_order: int  # power of the step that its estimate of the local error is of
    stages: int  # rows of slopes that it needs memory for
    filter: float  # over h²: factor of the tangent beside M in reported accelerations
    keeps_step: int  # 1: a change of the step is dear, or its estimate rings after one
    collocation: int  # implicit stages that it needs memory for
    loosest: float  # local tolerance from which on errors fall with the steps as the order says
    stabilised: int = 0  # 1: C̈ + 2α Ċ + β² C = 0 in place of projection onto the constraints
    alpha: float = 0.0  # 1/s
    beta: float = 0.0  # 1/s
    partitions: int = 0  # 1: it needs memory for independent and dependent coordinates


class Settings(NamedTuple):
    """Numbers of the loop."""

    start: float  # s
    end: float  # s
    interval: float  # mean one between outputs, s
    step: float  # s, a whole share of the run; 0: steps by error control
    tolerance: float  # local error of a step over motion and speed so far, with error control
    accuracy: float  # error over motion in the end, with error control
    slack: float  # times `tolerance`: from which on a step is repeated shorter
    turn: float  # largest angle that a body turns in a step, rad
    refinement: float  # steps for each step of the plan; 0: the plan is not followed but written
    least_motion: float  # motion over the size of the model below which it counts as at rest
    newton_tolerance: float  # remaining Newton correction over h² v̇; 0: a share of `tolerance`
    max_iterations: int
    works: int  # 1: something does work (drivers, dampers, applied forces)
    stiff: int  # 1: springs, flexible bodies or other stiffness
    determined: int  # 1: the constraints alone fix the motion (no free coordinate)


# Status codes of the kernels; `status` turns them into sentences.
FINE, NO_CONVERGENCE, ZERO_LENGTH, NOT_FINITE, NO_METHOD, TOO_SMALL, REPEAT = range(7)
CURVE_END = 7  # a joint leaves its curve at an end
SELF_LOCKING = 8  # friction in joints and the reactions that cause it do not settle
NO_PARTITION = 9  # no choice of independent coordinates determines the others
NO_LOOP = 20  # forces that depend on accelerations or reactions do not settle
# Of a kinematic analysis: a singular pose, a point that does not continue the motion, a function
# that jumps, rows that repeat others and ask for other velocities.
SINGULAR, JUMP, LEAP, UNLIKE_RATES = range(30, 34)

# Places in State.memory: contraction of Newton's method, age of the factor (< 0: none), whether it
# is symmetric, the step it is for; the step to try next, the last one accepted; the share of a
# fixed step that is done; the largest motion and speed so far, weighted; least and greatest step
# accepted; steps since the size changed, error of velocities over h³ then; steps to go before it
# may grow; the step before it was shortened to end at an event (0: it was not), how often it was,
# and steps to go after an event before the next one is looked for; the largest present angular
# velocity; sum of the local errors over the motion; steps of an explicit method at its limit of
# stability, and the largest rate of the motion at the first one; the last step rejected, its error
# over what is allowed, the times at which it began and would have ended, and 1 if a force jumps or
# has a kink within it (0 after that time); that error of the last step accepted;
# the length of the step before the last one.
CONTRACTION, AGE, SYMMETRIC, FACTOR_STEP, STEP, LAST_STEP = 0, 1, 2, 3, 4, 5
PART, MOTION, SPEED, LEAST_STEP, GREATEST_STEP = 6, 7, 8, 9, 10
SINCE, JERK_ERROR, CALM = 11, 12, 13
EVENT_STEP, EVENT_TRIES, EVENT_REST = 14, 15, 16
TURNING, ERROR_SUM, STIFF_STEPS, STIFF_RATE = 17, 18, 19, 20
REJECTED_STEP, REJECTED_RATIO, REJECTED_START, REJECTED_END = 21, 22, 23, 24
KINK, LAST_RATIO, EARLIER_STEP = 25, 26, 27
MEMORY = 28
# Places in State.count; GRID counts whole fixed steps, OUTPUTS the rows written, PARTITIONS how
# often independent coordinates were chosen because those before were poor.
STEPS, RESIDUALS, FACTORISATIONS, FIXED_PIVOTS, REJECTED, FAILED, GRID, OUTPUTS = range(8)
EVENTS, PARTITIONS = 8, 9
COUNTS = 10
