"""Records of a run: its state and its scratch memory, grouped by stage.

`State` is all that a run passes from one chunk to the next, including the memory of the integrator.
`Work` is scratch, grouped by the stage that writes it and filled with NaN at first, so that reading
a stage that was not evaluated shows at once. `Run` is the argument of compiled code.
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
        ("V", _F, (3, 3)),  # scratch, such as a time derivative of Z
    ],
    align=True,
)
# A marker now. Position stage: x, R, s, and if modes move it th, c, T, arm; velocity stage: vx, om;
# bias stage (velocity stage if modes move it): bx, bom; force stage: W.
MARKER_NOW = np.dtype(
    [
        ("x", _F, (3,)),  # position, global
        ("R", _F, (3, 3)),  # marker axes to global
        ("s", _F, (3,)),  # position relative to the body origin, body axes
        ("th", _F, (3,)),  # rotation vector θ of the deformation
        ("c", _F, (4,)),  # coefficients of T(θ) and their derivatives
        ("T", _F, (3, 3)),  # T(θ), tangent of the exponential map
        ("arm", _F, (3,)),  # rotated arm, body axes
        ("vx", _F, (3,)),  # velocity, global
        ("om", _F, (3,)),  # angular velocity, global
        ("bx", _F, (3,)),  # acceleration at zero vd, global
        ("bom", _F, (3,)),  # angular acceleration at zero vd, global
        ("W", _F, (6,)),  # force and moment on it, global
    ],
    align=True,
)


# A curve marker now: its twist per arc length s, and the derivative of that by s, global.
CURVE_MARKER_NOW = np.dtype([("J", _F, (6,)), ("D", _F, (6,))], align=True)


class State(NamedTuple):
    """Complete state: positions, velocities, multipliers, integrator memory, counters."""

    t: Vector  # (1,) time, s
    q: Vector  # (nq,)
    v: Vector  # (nv,)
    vd: Vector  # (nv,) accelerations
    vd_before: Vector  # (nv,) accelerations one step earlier, for the predictor
    aa: Vector  # (nv,) algorithmic accelerations of generalized-alpha
    jerk: Vector  # (nv,) rate of aa over the last step
    jerk_before: Vector  # (nv,) rate of aa over the step before
    lam: Vector  # (nc,) the integrator's own multipliers
    lam_before: Vector  # (nc,) multipliers one step earlier, for the predictor
    work_done: Vector  # (3,) work of drivers, dampers and applied forces so far, J
    power: Vector  # (3,) their power at t, W
    power_before: Matrix  # (2, 3) power one and two steps earlier; NaN after a start
    angles: Vector  # (channels,) continuous joint angles of the angle sensors, rad
    q_first: Vector  # (nq,) positions at the start, for displacements
    v_first: Vector  # (nv,) velocities at the start, for changes of states
    # (2, nv) round-off of corrections at the start; 1: a driver acts there, or no body on states
    first_round_off: Matrix
    q_scale: Vector  # (nv,) error scale of positions: largest displacement so far, weighted
    v_scale: Vector  # (nv,) error scale of velocities: largest velocity so far, weighted
    memory: array_of(INTEGRATOR_MEMORY)  # (1,)
    count: array_of(COUNTERS)  # (1,)
    history: Vector  # of the elements: time of the last accepted step, then numbers of each


class Point(NamedTuple):
    """Time, positions, ... at which the equations are evaluated."""

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
    Phi: Matrix  # (markers, ...) Phi_t - eta^T K_d, 3 m numbers, and padding; if some need K_d
    curve_marker: array_of(CURVE_MARKER_NOW)
    history: Vector  # history of the elements with which forces are evaluated, as State.history
    span: Vector  # (1,) time since that history, s
    iteration: Vector  # (1,) number of the Newton iteration within a step, from 0


class Constraints(NamedTuple):
    """Values of all constraint rows."""

    C: Vector  # (nc,) constraint values
    rate: Vector  # (nc,) Cq v + C_t
    drift: Vector  # (1,) max |Cq v + C_t| before the last projection
    impulse_work: Vector  # (1,) work of drivers in it, J
    gamma: Vector  # (nc,) right side of Cq v̇ = γ
    fun: Matrix  # (functions, 3) value, first and second derivative at t


class Dense(NamedTuple):
    """Small dense blocks, from which the iteration matrix is assembled."""

    B: Matrix  # (6 + m, 6 + m) of one body or a pair
    J: array_of("f8", 3)  # (2, 6, 6 + m) Jacobians of two markers
    T: Matrix  # (24, 6 + m) one product, or wrenches and rates of damping in body coordinates
    H: Matrix  # (12, 12) tangent at two markers
    g: Matrix  # (2, 12) RowWork.g, wrench pair of one group
    X: Matrix  # (6, 12) wrench pairs per unit of each rate
    U: Matrix  # (6, 12) these rates per unit velocity of two markers
    jac: Vector  # Jacobian rows of all bodies, one after the other
    pair: Integers  # (2,) markers I and J of a wrench pair


class RowWork(NamedTuple):
    """Argument of the units of constraint rows (`engine.kind`)."""

    marker: array_of(MARKER_NOW)  # Now.marker
    g: Vector  # (12,) gradient of one row
    H: Matrix  # (12, 12) tangent at two markers, Dense.H


def rows_between(xi: np.ndarray, Ri: np.ndarray, xj: np.ndarray, Rj: np.ndarray) -> RowWork:
    """Two markers at rest, 0 and 1, for units of rows: positions (3,), marker axes to global."""
    markers = np.zeros(2, MARKER_NOW)
    markers["x"], markers["R"] = (xi, xj), (Ri, Rj)
    return RowWork(markers, np.zeros(12), np.zeros((12, 12)))


class Factor(NamedTuple):
    """The iteration matrix, its factor, and vectors in elimination order.

    The vectors have one more entry at the end, for all coordinates that are not in the matrix.
    """

    low: Vector  # panels: rows of the lower triangle
    up: Vector  # panels: columns of the upper triangle
    low0: Vector  # the matrix itself, for refinement
    up0: Vector
    Wl: Vector  # scratch: one panel times its pivots
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
    change: Matrix  # (stages, nv) last Newton correction
    power: Matrix  # (stages, 3) of drivers, dampers and applied forces, W
    share: Matrix  # (stages, stages) weights of the stages of the last step in predicted ones
    age: Vector  # (1,) steps that the present factors have served; below 0: there are none
    span: Vector  # (2,) start and length of the step of these stages, s; length 0: none
    real: Factor  # of the real eigenvalue of the Runge–Kutta matrix
    pair: ComplexFactor  # of its pair of complex eigenvalues


class Partition(NamedTuple):
    """Independent and dependent coordinates."""

    metric: Vector  # (nv,) weights of a correction: very large for independent coordinates
    free: Vector  # (nv,) 1: dependent, 0: independent or not in the system
    motion: Vector  # (nv,) displacement of the present stage from the start of the step
    jacobian: Matrix  # (nc, nv) dimensionless Cq, for the selection
    age: Vector  # (1,) steps since the selection; below 0: a selection is due
    pivot: Vector  # (2,) least pivot of the rows at the selection, and now
    rank: Integers  # (1,) number of dependent coordinates; 0: not known


class Before(NamedTuple):
    """The start of the last accepted step, for the dense output."""

    t: Vector
    q: Vector
    v: Vector
    work_done: Vector
    power: Vector
    history: Vector


# An event function: zero where a force or a function changes its law (`engine.events`).
EVENT_FUNCTION = np.dtype(
    [
        ("value", _F),
        ("rate", _F),  # time derivative, if it may exceed zero within a step and return; else NaN
        # NaN: of an element. 1: of an operation of a function, which may switch any number of
        # times; 2: the same, where the value of the function jumps; 3, 4: x and y of a vector,
        # whose zero is where it turns round
        ("of_law", _F),
    ],
    align=True,
)


class Events(NamedTuple):
    """Event functions of all elements."""

    before: array_of(EVENT_FUNCTION)  # at the start of the step
    now: array_of(EVENT_FUNCTION)  # at its end
    # (room, width) states after events of a chunk (implicit methods); of many events every third,
    # ninth, ...: t, q, v, next step, v some steps later, vd, lam, history, angles
    states: Matrix
    taken: Integers  # (4,) events, rows, events per row, steps since the last row


class Trial(NamedTuple):
    """The state that a step proposes."""

    t: Vector
    q: Vector
    v: Vector
    vd: Vector
    aa: Vector
    aa_start: Vector  # (nv,) algorithmic acceleration at the start, for this step size
    lam: Vector
    dq: Vector  # (nv,) displacement of the step
    res: Vector  # (nv,) M vd - Q + Cq^T lam
    spare: Vector  # (nv,) scratch
    mode_force: Vector  # (nv,) τ² K_ss η̈_s: forces with which kinetostatic modes get a given η̈_s
    dense_correction: Vector  # (nv,) factor of s² (1 − s)² in the dense output, added to the cubic
    power: Vector  # (3,)
    work_done: Vector  # (3,) works at an output
    angles: Vector  # (channels,) continuous angles at an output, or within a step
    before: Before  # the start of the last accepted step
    stages: Matrix  # (stages, nq + nv + 3) q̇, v̇ and powers of the stages of an explicit method
    work: Vector  # (3,) work_done at the end of the step, of a method with stages
    rate: Vector  # (nq,) weighted sum of q̇ of the stages
    shares: Vector  # (stages,) weights of the stages in the dense output
    dense_ready: Integers  # (1,) 1: the dense output of the last step is evaluated
    dq_round_off: Vector  # (nv,) size of a correction that is round-off, weighted
    vd_round_off: Vector  # (nv,) round-off of accelerations by that of q and v, weighted
    error: Vector  # (2,) estimated local error of positions and of velocities, over their scales
    jerk: Vector  # (nv,) rate of the algorithmic acceleration, on the null space of the constraints
    stack: Matrix  # (depth, 3) of the function evaluator
    variables: Matrix  # (channels, 3) values and time derivatives of channels, for functions


class FeedbackWork(NamedTuple):
    """Scratch of functions over channels."""

    t: Vector  # (1,) time of their last evaluation, s
    near: Vector  # (channels,) the continuous angles at the last accepted state
    slopes: Vector  # (partials,) partial derivatives of functions by channels
    rate_terms: Matrix  # (2, nv) of rates of states: sum of |terms|, and |slope| by the own state
    g: Matrix  # (4, 12) gradient of one term by positions, by velocities; two rows of scratch
    left: Vector  # (6 + m,) generalised force of a unit value of the function
    right: Vector  # (6 + m,) cp ∂m/∂q + cv ∂m/∂v of one term m, by the coordinates of a body
    block: Integers  # (4,) first coordinate of left and right, and the number of each


# Indices in Work.energies and in Work.powers.
KINETIC_ENERGY, STRAIN_ENERGY, GRAVITY_ENERGY, SPRING_ENERGY, BRISTLE_ENERGY = 0, 1, 2, 3, 4
DRIVER_POWER, DAMPER_POWER, LOAD_POWER = 0, 1, 2


class Alternation(NamedTuple):
    """Alternation of multipliers from step to step near outputs, with fixed steps."""

    earlier: Vector  # (nc,) multipliers one step before lam_before; of length 0: not examined
    bend: Vector  # (nc,) second difference at the step before
    low: Vector  # (nc,) least and greatest value near outputs
    high: Vector  # (nc,)
    size: Vector  # (nc,) largest amplitude of alternation
    time: Vector  # (nc,) its time, s
    count: Integers  # (2,) steps of equal size, steps since the last output


class Work(NamedTuple):
    """All scratch memory of a run; two runs of one System share none."""

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
    kinds: Mapping[str, Any]  # scratch of kinds that have some, by name (`engine.kind`)


class Stage(NamedTuple):
    """The units of one stage, one for each kind of the model that takes part, with its tables."""

    units: Units
    tables: Records


class Stages(NamedTuple):
    """All stages; `engine.kind` says what each does."""

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
    """Units of constraint rows by number of their kind (`engine.joints`); None: not used."""

    value: Units
    gradient: Units
    curvature: Units
    tangent: Units
    curved: Integers  # (kinds,) 1: it has a tangent
    period: Vector  # (kinds,) period of its measure; 0: none


class SensorUnits(NamedTuple):
    """Units of sensors by number of their kind (`engine.sensors`); None: not used."""

    channel: Units  # values of channels
    turns: Integers  # (kinds of channels,) 1: an angle that counts turns
    computed: Integers  # (kinds of channels,) 1: computed from other channels
    measure: Units  # values of terms
    gradient: Units  # gradients of terms, for functions of channels that act on the model
    level: Integers  # (measures,) highest time derivative that it depends on


class Output(NamedTuple):
    """Output rows of one chunk, allocated once."""

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
    extent: Matrix  # (3, 7) energies at steps between rows: least, greatest, last; NaN: none


class Plan(NamedTuple):
    """Times of the steps of one run, which another run follows with shorter steps."""

    knots: Vector  # (n,) times of the accepted steps, s
    used: Integers  # (1,) number of times stored


class Run(NamedTuple):
    """The argument of compiled code: all records of a run."""

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
