"""State and scratch memory of a run: what there is of it, stage by stage.

`State` is all that a run hands from one chunk to the next, integrator memory included. `Work` is
scratch, grouped by what writes it and filled with NaN, so that reading a stage that was not
evaluated shows at once. `Run` holds all that compiled code is handed, by its address.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from flexmb.engine.jit import Complexes, Integers, Matrix, Records, Units, Vector, array_of
from flexmb.engine.method import COUNTERS, INTEGRATOR_MEMORY, Method, Settings
from flexmb.engine.tables import System

_F = "f8"

# A body now. Written by the stages position (A) and inertia (J, c).
BODY_NOW = np.dtype(
    [
        ("A", _F, (3, 3)),  # body axes to global
        ("J", _F, (3, 3)),  # inertia about the body origin, body axes, deformed
        ("c", _F, (3,)),  # first moment of mass, body axes, deformed
        ("V", _F, (3, 3)),  # scratch: a rate of Z, and the like
    ],
    align=True,
)
# A marker now. Position stage: x, R, s, and where modes move it th, c, T, arm; velocity stage:
# vx, om; bias stage, where modes move it the velocity stage: bx, bom; force stage: W.
MARKER_NOW = np.dtype(
    [
        ("x", _F, (3,)),  # position, global
        ("R", _F, (3, 3)),  # marker axes to global
        ("s", _F, (3,)),  # from the body origin, body axes
        ("th", _F, (3,)),  # rotation vector θ of the deformation
        ("c", _F, (4,)),  # coefficients of T(θ) and their slopes
        ("T", _F, (3, 3)),  # T(θ)
        ("arm", _F, (3,)),  # turned arm, body axes
        ("vx", _F, (3,)),  # velocity, global
        ("om", _F, (3,)),  # angular velocity, global
        ("bx", _F, (3,)),  # acceleration at zero vd, global
        ("bom", _F, (3,)),  # angular acceleration at zero vd, global
        ("W", _F, (6,)),  # force and moment on it, global
    ],
    align=True,
)


# A curve marker now: its twist per ds and the change of that per ds, global.
CURVE_MARKER_NOW = np.dtype([("J", _F, (6,)), ("D", _F, (6,))], align=True)


class State(NamedTuple):
    """Complete state: positions, velocities, multipliers, integrator memory, counters."""

    t: Vector  # (1,) time, s
    q: Vector  # (nq,)
    v: Vector  # (nv,)
    vd: Vector  # (nv,) accelerations
    vd_before: Vector  # (nv,) accelerations one step earlier, for the predictor
    aa: Vector  # (nv,) algorithmic accelerations of generalized-alpha
    jerk: Vector  # (nv,) its rate over the last step
    jerk_before: Vector  # (nv,) and over the one before
    lam: Vector  # (nc,) the integrator's own multipliers
    lam_before: Vector  # (nc,) multipliers one step earlier, for the predictor
    work_done: Vector  # (3,) work of drivers, dampers and applied forces so far, J
    power: Vector  # (3,) their power at t, W
    power_before: Matrix  # (2, 3) one step earlier, and two; NaN after a start
    angles: Vector  # (channels,) continuous joint angles of the angle sensors, rad
    q_first: Vector  # (nq,) positions at the start, for the motion so far
    first_places: Matrix  # (2, nv) round-off of corrections at the start; 1: a driver acts there
    motion: Vector  # (nv,) largest motion so far of what each coordinate belongs to, weighted
    speed: Vector  # (nv,) largest speed of it so far, weighted
    memory: array_of(INTEGRATOR_MEMORY)  # (1,)
    count: array_of(COUNTERS)  # (1,)
    history: Vector  # of the elements: time of the last accepted step, then their own


class Point(NamedTuple):
    """Where the equations are evaluated."""

    t: Vector  # (1,) time, s
    q: Vector  # (nq,)
    v: Vector  # (nv,)
    vd: Vector  # (nv,)
    lam: Vector  # (nc,)


class Now(NamedTuple):
    """Bodies and markers at the last evaluated position."""

    body: array_of(BODY_NOW)
    marker: array_of(MARKER_NOW)
    Z: Vector  # of every flexible body 9 m numbers Z_ab, 3 m of M_omega_eta (`deformation_room`)
    Phi: Matrix  # Phi_t - eta^T K_d, 3 m numbers, and room; of every marker, where some bend
    curve_marker: array_of(CURVE_MARKER_NOW)
    history: Vector  # of the elements, that forces are evaluated with, as State.history
    span: Vector  # (1,) time since then, s
    iteration: Vector  # (1,) of Newton's method within a step, from 0


class Constraints(NamedTuple):
    """Values of all rows."""

    C: Vector  # (nc,) constraint values
    rate: Vector  # (nc,) Cq v + C_t
    drift: Vector  # (1,) its largest entry before the last projection
    gamma: Vector  # (nc,) acceleration right side
    fun: Matrix  # (functions, 3) value, first and second derivative at t


class Dense(NamedTuple):
    """Small dense blocks on the way into the KKT matrix."""

    B: Matrix  # (6 + m, 6 + m) of one body or a pair
    J: array_of("f8", 3)  # (2, 6, 6 + m) Jacobians of two markers
    T: Matrix  # (24, 6 + m) one product, or wrenches and rates of damping pulled back
    H: Matrix  # (12, 12) tangent at two markers
    g: Matrix  # (2, 12) RowWork.g, wrench pair of one group
    X: Matrix  # (6, 12) wrench pairs that follow rates
    U: Matrix  # (6, 12) these rates per velocities of two markers
    jac: Vector  # Jacobian rows, flat
    pair: Integers  # (2,) markers I and J of a wrench pair


class RowWork(NamedTuple):
    """What units of constraint rows read and write (`engine.kind`)."""

    marker: array_of(MARKER_NOW)  # Now.marker
    g: Vector  # (12,) gradient of one row
    H: Matrix  # (12, 12) tangent at two markers, Dense.H


def rows_between(xi: np.ndarray, Ri: np.ndarray, xj: np.ndarray, Rj: np.ndarray) -> RowWork:
    """Two markers at rest, 0 and 1, for units of rows: positions (3,), axes (3, 3) to global."""
    markers = np.zeros(2, MARKER_NOW)
    markers["x"], markers["R"] = (xi, xj), (Ri, Rj)
    return RowWork(markers, np.zeros(12), np.zeros((12, 12)))


class Factor(NamedTuple):
    """The KKT matrix, its factor, and vectors in elimination order.

    The vectors end with one place more, for all coordinates that are left out.
    """

    low: Vector  # panels: rows of the lower triangle
    up: Vector  # panels: columns of the upper triangle
    low0: Vector  # the matrix itself, for refinement
    up0: Vector
    Wl: Vector  # one panel, times its pivots
    Wu: Vector
    d: Vector  # (n,) pivots
    eps: Vector  # (n,) regularisation
    diagonal: Vector  # (n,) |diagonal| of the coordinates before elimination
    symmetric: Integers  # (1,) 1: LDL^T on `low`; 0: LDU on both
    replaced: Integers  # (1,) pivots replaced in the last factorisation
    rhs: Vector  # (n,)
    sol: Vector  # (n,)
    tmp: Vector  # (n,)


class ComplexFactor(NamedTuple):
    """A complex matrix of the same structure, its factor, and a vector in elimination order."""

    low: Complexes  # panels: rows of the lower triangle
    up: Complexes  # panels: columns of the upper triangle
    Wl: Complexes  # one panel, times its pivots
    Wu: Complexes
    d: Complexes  # (n,) pivots
    sol: Complexes  # (n,)
    symmetric: Integers  # (1,) 1: LDL^T on `low`; 0: LDU on both


class Collocation(NamedTuple):
    """Stages of an implicit Runge–Kutta method."""

    u: Matrix  # (stages, nv) motions from the start of the step
    v: Matrix  # (stages, nv)
    a: Matrix  # (stages, nv) accelerations
    lam: Matrix  # (stages, nc)
    next_a: Matrix  # (stages, nv) predicted
    next_lam: Matrix  # (stages, nc)
    res: Matrix  # (stages, nv) forces out of balance
    gap: Matrix  # (stages, nc) constraint values
    change: Matrix  # (stages, nv) last correction
    power: Matrix  # (stages, 3) of drivers, dampers and applied forces, W
    share: Matrix  # (stages, stages) of the stages of the last step in the predicted ones
    age: Vector  # (1,) steps made by the present factors; below 0: there are none
    span: Vector  # (2,) start and length of the step that the stages are of, s; 0: of none
    real: Factor  # of the real eigenvalue
    pair: ComplexFactor  # of the pair of complex ones


class Partition(NamedTuple):
    """Independent and dependent coordinates."""

    metric: Vector  # (nv,) weights of least change: heavy for independent coordinates
    free: Vector  # (nv,) 1: dependent, 0: independent or left out of the system
    motion: Vector  # (nv,) of the present stage from the start of the step
    jacobian: Matrix  # (nc, nv) Cq without units, for the choice
    age: Vector  # (1,) steps since the choice; below 0: it is due
    pivot: Vector  # (2,) least pivot of the rows at the choice, and now
    rank: Integers  # (1,) number of dependent coordinates; 0: not known


class Before(NamedTuple):
    """What the dense output needs of the start of the last accepted step."""

    t: Vector
    q: Vector
    v: Vector
    work_done: Vector
    power: Vector
    history: Vector


# What the step control watches: it crosses zero where a force changes its formula.
EVENT_FUNCTION = np.dtype(
    [
        ("value", _F),
        ("rate", _F),  # where it may peak unseen within a step, else NaN
        # 1: where an operation of a function changes its law, as often as it likes; 2: with a jump
        ("of_law", _F),
    ],
    align=True,
)


class Events(NamedTuple):
    """Event functions of all elements."""

    before: array_of(EVENT_FUNCTION)  # at the start of the step
    now: array_of(EVENT_FUNCTION)  # at its end
    # (room, width) states behind events of a chunk, of many one in 3, 9, ...: t, q, v, next step,
    # v some steps later, vd, lam, history; of implicit methods
    states: Matrix
    taken: Integers  # (4,) events, rows, one in how many, steps since the last row


class Trial(NamedTuple):
    """The state that a step proposes."""

    t: Vector
    q: Vector
    v: Vector
    vd: Vector
    aa: Vector
    aa_start: Vector  # (nv,) algorithmic acceleration at the start, for this step size
    lam: Vector
    dq: Vector  # (nv,) motion of the step
    res: Vector  # (nv,) M vd - Q + Cq^T lam
    spare: Vector  # (nv,)
    mode_force: Vector  # (nv,) forces by which modes that are held keep the acceleration given
    dense_correction: Vector  # (nv,) beside the cubics of the dense output, times s² (1 − s)²
    power: Vector  # (3,)
    work_done: Vector  # (3,) works at an output
    angles: Vector  # (channels,) continuous angles at an output, or on the way
    before: Before  # the state that the last accepted step began with
    stages: Matrix  # (stages, nq + nv + 3) slopes and powers of an explicit method
    work: Vector  # (3,) work_done at its end, of a method with stages
    rate: Vector  # (nq,) sum of slopes
    shares: Vector  # (stages,) weights of the slopes in the dense output
    dense_ready: Integers  # (1,) 1: the stages of the dense output of the last step are there
    dq_round_off: Vector  # (nv,) weighted size of a correction that is round-off
    vd_round_off: Vector  # (nv,) weighted change of accelerations by round-off of places and speeds
    error: Vector  # (2,) estimated local error of positions and velocities over their motion
    jerk: Vector  # (nv,) rate of the algorithmic acceleration, as far as S lets it move
    stack: Matrix  # (depth, 3) of the function evaluator
    variables: Matrix  # (channels, 3) jets of the channels, for functions that name them


class FeedbackWork(NamedTuple):
    """Scratch of functions over channels."""

    t: Vector  # (1,) the time at which they were evaluated last
    near: Vector  # (channels,) the continuous angles at the last accepted state
    slopes: Vector  # (partials,) partial derivatives
    g: Matrix  # (4, 12) gradients of one term: position, velocity; two of scratch
    left: Vector  # (6 + m,) what acts
    right: Vector  # (6 + m,) what it depends on
    block: Integers  # (4,) first coordinate of left and right, and how many each has


# Places in Work.energies and in Work.powers.
KINETIC_ENERGY, STRAIN_ENERGY, GRAVITY_ENERGY, SPRING_ENERGY, BRISTLE_ENERGY = 0, 1, 2, 3, 4
DRIVER_POWER, DAMPER_POWER, LOAD_POWER = 0, 1, 2


class Alternation(NamedTuple):
    """Multipliers of the last fixed steps about an output: what of them changes its sign."""

    earlier: Vector  # (nc,) one step before lam_before; none of them: nothing is looked at
    bend: Vector  # (nc,) second difference at the step before
    low: Vector  # (nc,) least and greatest value about outputs
    high: Vector  # (nc,)
    size: Vector  # (nc,) the largest part that alternates
    time: Vector  # (nc,) of it, s
    count: Integers  # (2,) steps of equal size, steps since the last output


class Work(NamedTuple):
    """All scratch: of two runs of one System none is shared."""

    now: Now
    con: Constraints
    dense: Dense
    row: RowWork
    factor: Factor
    collocation: Collocation
    partition: Partition
    trial: Trial
    feedback: FeedbackWork
    events: Events
    alternation: Alternation
    energies: Vector  # (5,) kinetic, strain, gravity, spring; stored in bristles of friction
    powers: Vector  # (3,) of drivers, dampers, applied forces
    failed_element: Integers  # (1,) row of the element that gave the last status
    kinds: Mapping[str, Any]  # scratch of the kinds that have some, by name (`engine.kind`)


class Stage(NamedTuple):
    """The units of one stage, one for each kind that the scene holds, with its tables."""

    units: Units
    tables: Records


class Stages(NamedTuple):
    """What each kind of the scene does, stage by stage (`engine.kind`)."""

    constants: Stage
    functions: Stage
    position: Stage
    inertia: Stage
    velocity: Stage
    force_velocity: Stage  # velocity, where wrenches need it
    bias: Stage
    constraint: Stage
    rate: Stage
    axes: Stage
    feedback: Stage
    reaction: Stage
    static: Stage
    static_hold: Stage
    static_rates: Stage
    static_force: Stage
    static_path: Stage
    static_lag: Stage
    static_ahead: Stage
    static_begin: Stage
    wrench: Stage
    force: Stage
    matrix: Stage
    jacobian: Stage
    coupling: Stage
    mass: Stage
    energy: Stage
    power: Stage
    begin: Stage
    update_history: Stage
    jump: Stage
    events: Stage
    limits: Stage
    angles: Stage
    angle_path: Stage
    wrenches: Stage
    unit_force: Stage


class RowUnits(NamedTuple):
    """Units of constraint rows by their kind (`engine.joints`), those that the scene holds."""

    value: Units
    gradient: Units
    curvature: Units
    tangent: Units
    curved: Integers  # (kinds,) 1: it has a tangent
    period: Vector  # (kinds,) of what it measures; 0: none


class SensorUnits(NamedTuple):
    """Units of sensors by kind (`engine.sensors`), those that the scene holds."""

    channel: Units  # values of channels
    turns: Integers  # (kinds of channels,) 1: it counts turns
    computed: Integers  # (kinds of channels,) 1: of other channels
    measure: Units  # values of terms
    gradient: Units  # gradients of terms, for functions that act
    level: Integers  # (measures,) derivative in time


class Output(NamedTuple):
    """Rows of one chunk, allocated once."""

    t: Vector  # (rows,)
    q: Matrix  # (rows, nq)
    v: Matrix  # (rows, nv)
    vd: Matrix  # (rows, nv)
    lam: Matrix  # (rows, nc)
    reactions: Matrix  # (rows, 12 groups), as `layout.Layout` says
    sensors: Matrix  # (rows, channels)
    energy: Matrix  # (rows, 7): kinetic, strain, gravity, spring, and three works
    drift: Matrix  # (rows, 2): largest |C|, and |Cq v + C_t| before v was projected
    rows: Integers  # (1,) rows written so far
    extent: Matrix  # (3, 7) energies at steps between them: least, greatest, last; NaN: none


class Plan(NamedTuple):
    """Steps of one run, for another one to follow with shorter ones."""

    knots: Vector  # (n,) times of the accepted steps, s
    used: Integers  # (1,) how many of them there are


class Run(NamedTuple):
    """All that compiled code is handed."""

    system: System
    state: State
    work: Work
    state_point: Point  # arrays of the state
    trial_point: Point  # arrays of the trial state
    stages: Stages
    rows: RowUnits
    sensors: SensorUnits
    method: Method
    settings: Settings
    plan: Plan
    times: Vector  # (outputs,) of all outputs of the run, s
    output: Output
