"""What a run is asked to do: the method with its coefficients, and the settings of the loop.

The step contract. A method is one file in `integrators` with a kernel `step(sys, coefficients,
settings, st, wk, h) -> status` that reads `State` and leaves the trial state at t + h in
`Work.trial`, with its estimate of the local error in `trial.error` if steps are controlled; the
loop alone accepts, rejects, chooses the next step, stores and reports. Memory that a method carries
from step to step (previous accelerations, contraction, step sizes) lives in `State`, so a
multi-step method, a multi-stage method and an explicit one fit alike; and because a step is only
proposed, an event found between `State` and the trial state can still shorten or reject it.
Coefficients are data. The methods not chosen are None and are not compiled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Alpha(NamedTuple):
    """Coefficients of generalized-alpha."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float


class Tableau(NamedTuple):
    """Butcher tableau of an explicit pair: y1 from b, error from b - b_hat."""

    A: np.ndarray  # (stages, stages)
    b: np.ndarray
    c: np.ndarray
    difference: np.ndarray  # b - b_hat


class Method(NamedTuple):
    """The chosen method; the others are None."""

    alpha: object  # Alpha or None
    explicit: object  # Tableau or None


class Settings(NamedTuple):
    """Numbers of the loop."""

    start: float  # s
    end: float  # s
    interval: float  # between outputs, s
    step: float  # s, a whole share of the interval; 0: steps by error control
    tolerance: float  # local error of a step over motion and speed so far, with error control
    accuracy: float  # error over motion in the end, with error control
    order: int  # of the method
    newton_tolerance: float  # remaining Newton correction over h² v̇; 0: a share of `tolerance`
    max_iterations: int
    works: int  # 1: something does work (drivers, dampers, applied forces)
    stiff: int  # 1: springs, flexible bodies or other stiffness
    determined: int  # 1: the constraints alone fix the motion (no free coordinate)


# Status codes of the kernels; `status` turns them into sentences.
FINE, NO_CONVERGENCE, ZERO_LENGTH, NOT_FINITE, NO_METHOD, TOO_SMALL, REPEAT = range(7)
CURVE_END = 7  # a joint leaves its curve at an end
SELF_LOCKING = 8  # friction in joints and the reactions that cause it do not settle
NO_LOOP = 20  # forces that depend on accelerations or reactions do not settle
# Of a kinematic analysis: a singular pose, a point that does not continue the motion, a function
# that jumps, rows that repeat others and ask for other velocities.
SINGULAR, JUMP, LEAP, UNLIKE_RATES = range(30, 34)

# Places in State.memory: contraction of Newton's method, age of the factor (< 0: none), whether it
# is symmetric, the step it is for; the step to try next, the last one accepted; the share of a
# fixed step that is done; the largest motion and speed so far, sum of the local errors, weighted;
# least and greatest step accepted; steps since the size changed, error of velocities over h³ then;
# the share of the tolerance that leaves the accuracy in the end; steps to go before it may grow;
# the step before it was shortened to end at an event (0: it was not), how often it was, and
# steps to go after an event before the next one is looked for.
CONTRACTION, AGE, SYMMETRIC, FACTOR_STEP, STEP, LAST_STEP = 0, 1, 2, 3, 4, 5
PART, MOTION, SPEED, ERROR_SUM, LEAST_STEP, GREATEST_STEP = 6, 7, 8, 9, 10, 11
SINCE, JERK_ERROR, SHARE, CALM = 12, 13, 14, 15
EVENT_STEP, EVENT_TRIES, EVENT_REST = 16, 17, 18
MEMORY = 19
# Places in State.count; GRID counts whole fixed steps, OUTPUTS the rows written.
STEPS, RESIDUALS, FACTORISATIONS, FIXED_PIVOTS, REJECTED, FAILED, GRID, OUTPUTS = range(8)
EVENTS = 8
COUNTS = 9


def generalized_alpha(spectral_radius: float) -> Method:
    """Chung & Hulbert's coefficients for a spectral radius at infinity in [0, 1]."""
    rho = spectral_radius
    alpha_m = (2.0 * rho - 1.0) / (rho + 1.0)
    alpha_f = rho / (rho + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    beta = 0.25 * (gamma + 0.5) ** 2
    return Method(alpha=Alpha(alpha_m, alpha_f, beta, gamma), explicit=None)


def bogacki_shampine() -> Method:
    """The explicit 3(2) pair of Bogacki & Shampine (Appl. Math. Lett. 2, 1989, 321)."""
    A = np.zeros((4, 4))
    A[1, 0] = 1 / 2
    A[2, 1] = 3 / 4
    A[3, :3] = 2 / 9, 1 / 3, 4 / 9
    b = np.array([2 / 9, 1 / 3, 4 / 9, 0.0])
    b_hat = np.array([7 / 24, 1 / 4, 1 / 3, 1 / 8])
    return Method(alpha=None, explicit=Tableau(A, b, np.array([0.0, 0.5, 0.75, 1.0]), b - b_hat))


def n_stages(method: Method) -> int:
    """Number of explicit stages that need memory."""
    return 0 if method.explicit is None else len(method.explicit.b)
