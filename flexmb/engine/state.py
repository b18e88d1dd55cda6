"""State and scratch memory of a run: what there is of it, stage by stage.

`State` is all that a run hands from one chunk to the next, integrator memory included. `Work` is
scratch, grouped by what writes it and filled with NaN, so that reading a stage that was not
evaluated shows at once. Kernels take the group they need, not the whole.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_F = "f8"

# A body now. Written by kinematics.position (A) and inertia.prepare (J, c).
BODY_NOW = np.dtype(
    [
        ("A", _F, (3, 3)),  # body axes to global
        ("J", _F, (3, 3)),  # inertia about the body origin, body axes, deformed
        ("c", _F, (3,)),  # first moment of mass, body axes, deformed
    ],
    align=True,
)
# A marker now. Position stage: x, R, s, th, arm; velocity stage: vx, om; bias stage: bx, bom;
# force stage: W. `E` and `p` are scratch of the position stage.
MARKER_NOW = np.dtype(
    [
        ("x", _F, (3,)),  # position, global
        ("R", _F, (3, 3)),  # marker axes to global
        ("s", _F, (3,)),  # from the body origin, body axes
        ("th", _F, (3,)),  # rotation vector of the deformation
        ("arm", _F, (3,)),  # turned arm, body axes
        ("vx", _F, (3,)),  # velocity, global
        ("om", _F, (3,)),  # angular velocity, global
        ("bx", _F, (3,)),  # acceleration at zero vd, global
        ("bom", _F, (3,)),  # angular acceleration at zero vd, global
        ("W", _F, (6,)),  # force and moment on it, global
        ("E", _F, (3, 3)),
        ("p", _F, (4,)),
    ],
    align=True,
)


# A curve marker now: its twist per ds and the change of that per ds, global.
SLIDER_NOW = np.dtype([("J", _F, (6,)), ("D", _F, (6,))], align=True)


class State(NamedTuple):
    """Complete state: positions, velocities, multipliers, integrator memory, counters."""

    t: np.ndarray  # (1,) time, s
    q: np.ndarray  # (nq,)
    v: np.ndarray  # (nv,)
    vd: np.ndarray  # (nv,) accelerations
    vd_before: np.ndarray  # (nv,) accelerations one step earlier, for the predictor
    aa: np.ndarray  # (nv,) algorithmic accelerations of generalized-alpha
    jerk: np.ndarray  # (nv,) its rate over the last step
    jerk_before: np.ndarray  # (nv,) and over the one before
    lam: np.ndarray  # (nc,) the integrator's own multipliers
    lam_before: np.ndarray  # (nc,) multipliers one step earlier, for the predictor
    work_done: np.ndarray  # (3,) work of drivers, dampers and applied forces so far, J
    power: np.ndarray  # (3,) their power at t, W
    angles: np.ndarray  # (channels,) continuous joint angles of the angle sensors, rad
    q_first: np.ndarray  # (nq,) positions at the start, for the motion so far
    memory: np.ndarray  # integrator memory, places in `method`
    count: np.ndarray  # counters, places in `method`
    kept: np.ndarray  # memory of the elements: time of the last accepted step, then their own


class ElementNow(NamedTuple):
    """Scratch of one force element: relative motion, force, and what tangents are made of."""

    x: np.ndarray  # (6,) separation and rotation vector of J from I, axes of I
    rate: np.ndarray  # (6,) velocity and angular velocity of J seen from I, axes of I
    Q: np.ndarray  # (3, 3) axes of J in those of I
    p: np.ndarray  # (6,) force conjugate to x
    f: np.ndarray  # (6,) force and moment with which J is pulled to I, axes of I
    K: np.ndarray  # (6, 6) its change with the relative motion
    C: np.ndarray  # (6, 6) and with the relative velocity
    E: np.ndarray  # (6, 12) relative motion per motion of the markers
    D: np.ndarray  # (6, 12) change of the relative velocity with their position
    S: np.ndarray  # (6, 12)
    W: np.ndarray  # (12, 12) damping between the markers
    N: np.ndarray  # (6, 6 + m) change of a marker's velocity with q at constant v
    s: np.ndarray  # scalar coordinates
    stack: np.ndarray  # (depth, 3) of the function evaluator


class Now(NamedTuple):
    """Bodies and markers at the last evaluated position."""

    body: np.ndarray  # BODY_NOW
    marker: np.ndarray  # MARKER_NOW
    Z: np.ndarray  # 9 m numbers Z_ab and 3 m of M_omega_eta for every flexible body
    slider: object  # SLIDER_NOW or None
    kept: np.ndarray  # memory of the elements that forces are evaluated with, as State.kept
    span: np.ndarray  # (1,) time since then, s
    grip: np.ndarray  # (joint frictions, 2): normal force and force of friction, N
    element: object  # ElementNow, or None without such elements


class Constraints(NamedTuple):
    """Values of all rows."""

    C: np.ndarray  # (nc,) constraint values
    rate: np.ndarray  # (nc,) Cq v + C_t
    drift: np.ndarray  # (1,) its largest entry before the last projection
    gamma: np.ndarray  # (nc,) acceleration right side
    fun: np.ndarray  # (functions, 3) value, first and second derivative at t


class Dense(NamedTuple):
    """Small dense blocks on the way into the KKT matrix."""

    B: np.ndarray  # (6 + m, 6 + m) of one body or a pair
    J: np.ndarray  # (2, 6, 6 + m) Jacobians of two markers
    T: np.ndarray  # (6, 6 + m) one product
    H: np.ndarray  # (12, 12) tangent at two markers
    g: np.ndarray  # (2, 12) gradient of one row, wrench pair of one group
    jac: np.ndarray  # Jacobian rows, flat
    D: np.ndarray  # (3, 3) force of one contact per relative velocity


class Factor(NamedTuple):
    """The KKT matrix, its factor, and vectors in elimination order.

    The vectors end with one place more, for all coordinates that are left out.
    """

    low: np.ndarray  # panels: rows of the lower triangle
    up: np.ndarray  # panels: columns of the upper triangle
    low0: np.ndarray  # the matrix itself, for refinement
    up0: np.ndarray
    Wl: np.ndarray  # one panel, times its pivots
    Wu: np.ndarray
    d: np.ndarray  # (n,) pivots
    eps: np.ndarray  # (n,) regularisation
    diagonal: np.ndarray  # (n,) |diagonal| of the coordinates before elimination
    symmetric: np.ndarray  # (1,) 1: LDL^T on `low`; 0: LDU on both
    replaced: np.ndarray  # (1,) pivots replaced in the last factorisation
    rhs: np.ndarray  # (n,)
    sol: np.ndarray  # (n,)
    tmp: np.ndarray  # (n,)


class Before(NamedTuple):
    """What the dense output needs of the start of the last accepted step."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    work_done: np.ndarray
    power: np.ndarray
    kept: np.ndarray


class Events(NamedTuple):
    """What the step control watches: each crosses zero where a force has a kink."""

    before: np.ndarray  # at the start of the step
    now: np.ndarray  # at its end


class Trial(NamedTuple):
    """The state that a step proposes."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    vd: np.ndarray
    aa: np.ndarray
    aa_start: np.ndarray  # (nv,) algorithmic acceleration at the start, for this step size
    lam: np.ndarray
    dq: np.ndarray  # (nv,) motion of the step
    res: np.ndarray  # (nv,) M vd - Q + Cq^T lam
    zero: np.ndarray  # (nv,) zeros
    power: np.ndarray  # (3,)
    work_done: np.ndarray  # (3,) works at an output
    angles: np.ndarray  # (channels,) joint angles at an output
    before: Before  # the state that the last accepted step began with
    stages: np.ndarray  # (stages, nq + nv) slopes of an explicit method
    error: np.ndarray  # (2,) estimated local error of positions and velocities, weighted
    jerk: np.ndarray  # (nv,) rate of the algorithmic acceleration, as far as S lets it move
    stack: np.ndarray  # (depth, 3) of the function evaluator
    variables: np.ndarray  # (channels, 3) jets of the channels, for functions that name them


class Live(NamedTuple):
    """Scratch of functions over channels."""

    t: np.ndarray  # (1,) the time at which they were evaluated last
    near: np.ndarray  # (channels,) the continuous angles at the last accepted state
    slopes: np.ndarray  # (partials,) partial derivatives
    g: np.ndarray  # (4, 12) gradients of one term: position, velocity; two of scratch
    left: np.ndarray  # (6 + m,) what acts
    right: np.ndarray  # (6 + m,) what it depends on


class Work(NamedTuple):
    """All scratch."""

    now: Now
    con: Constraints
    dense: Dense
    factor: Factor
    trial: Trial
    live: object  # Live or None
    events: Events
