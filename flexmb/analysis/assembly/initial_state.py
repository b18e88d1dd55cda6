"""Consistent first state: positions, velocities, accelerations and multipliers.

Positions follow by Gauss–Newton with the least change of the pose of the scene, velocities by
projection of the prescribed ones; then, for a quasi-static start, elastic equilibrium with the
rigid accelerations; at last v̇ and λ from [[M, Cqᵀ], [Cq, 0]] (v̇; λ) = (Q; γ). Changes are least
in the metric of the mass matrix, with modal masses M + b K: bodies are moved and hardly strained.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.body_damping import add_damping
from flexmb.analysis.assembly.gaps import moved_notes
from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, null_space
from flexmb.analysis.assembly.positions import (
    Corrector,
    assembly_weights,
    close_positions,
    mass_corrector,
)
from flexmb.analysis.assembly.static_mode_selection import choose_static_modes
from flexmb.analysis.assembly.velocities import InitialVelocities
from flexmb.analysis.equilibrium_solver import solve_equilibrium, spin_of
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.engine import initial_conditions
from flexmb.engine.algebra.forms import size_of_form
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.bodies.static_modes import STATIC_MODES, static_coordinates
from flexmb.engine.bodies.velocity_forms import place_of_pairs
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import solve_stage, stage_solver
from flexmb.engine.compiled_units import interpretation, load_units
from flexmb.engine.forces.force_characteristic import FORCE_CHARACTERISTICS
from flexmb.engine.forces.spring_damper import COORDINATE_OF, DISTANCE_OF
from flexmb.engine.initial_conditions import ACCELERATIONS, BEGIN, REMEMBER, RESIDUAL, VELOCITIES
from flexmb.engine.method import NO_LOOP_CONVERGENCE, SELF_LOCKING, SUCCESS
from flexmb.engine.stage_tables import units_of
from flexmb.engine.state import State, Work
from flexmb.engine.tables import System
from flexmb.errors import AssemblyError
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.model.forces.force_characteristic import JointStopSpec
from flexmb.model.model import Model
from flexmb.results import BodyDamping

_STIFFENING = 1e8  # b K over M of the softest mode while gaps are closed
_SOFT_STIFFENING = 1e5  # the same if they do not close with the first
_MASS_FACTOR = 1e3  # b of the quasi-static solve over 1/ω² of the softest mode
_MAX_ROUNDS = 40  # of the quasi-static solve
_DEFORMATION_TOLERANCE = 1e-12  # change of the deformation over the size of the model
# Change of membranes, over the size of the model, below which steps to equilibrium are combined.
_SMALL_STEP = 1e-5
_RANK_TOLERANCE = 1e-10  # relative singular values of previous steps that are round-off
_NO_STIFFNESS = 1e-12  # stiffness of a mode over the largest one that is none
_MAX_INTERPRETED = 200  # velocity coordinates up to which plain Python takes half a second
_PENETRATION = 1e-9  # least penetration of a stop that is no round-off, over the size or in radians

_ACCELERATION_ERRORS = {
    NO_LOOP_CONVERGENCE: (
        "the algebraic loop between forces and accelerations does not converge: the loop "
        "amplifies; lower its gain, or let a state or a filter stand between"
    ),
    SELF_LOCKING: (
        "friction in the joints and the reactions that cause it do not settle: a joint locks "
        "itself; lower its coefficients, or make its bearing longer"
    ),
}


class _NoEquilibrium(AssemblyError):
    """There is no elastic equilibrium of the modes with the first motion."""


@dataclass(frozen=True)
class Assembled:
    """The first state with its scratch; notes for the user; the model with the damping of its
    flexible bodies in this pose, and the damping ratios of their modes."""

    state: State
    work: Work
    notes: tuple[str, ...]
    compiled: Compiled
    dampings: list[BodyDamping]


class StartValues(NamedTuple):
    """A start in place of the pose of the scene."""

    q: Array  # (nq,)
    v: Array  # (nv,); NaN: the velocities of the scene are used
    time: float = 0.0  # s
    vibrates: bool = True  # else flexible bodies are in elastic equilibrium with the motion


def assemble(
    compiled: Compiled, model: Model, *, start: str = "undeformed", begin: StartValues | None = None
) -> Assembled:
    """Consistent first state of a compiled model.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model, for its initial velocities.
    start : {"undeformed", "quasi-static", "static"}
        Flexible bodies start undeformed, as far as the joints allow; or in elastic equilibrium with
        weight, loads and the inertia forces of the first motion; or the whole machine starts from
        its equilibrium at rest, with the initial velocities added.
    begin : StartValues, optional
        Positions and velocities to begin from, changed as little as joints and drivers require;
        `start` is then ignored.

    Raises
    ------
    AssemblyError
        Joints that cannot be closed (the largest gaps), a joint on its wrong branch, no elastic
        equilibrium, or accelerations that are not finite.
    SceneError
        Damping of modes that do not exist.
    """
    system = compiled.system
    state = new_state(system, channels=len(compiled.layout.channels))
    work = new_work(system)
    state.q[:] = compiled.initial_q if begin is None else begin.q
    state.t[0] = 0.0 if begin is None else begin.time
    period = _slowest_period(compiled)
    stiff = _stiffened(system, _STIFFENING * period)
    velocities = InitialVelocities(compiled, model, stiff)

    weights = assembly_weights(model)
    corrector = mass_corrector(_weighted(stiff, weights), state, work)

    def make(of: Compiled, at: State, stiffening: float = _STIFFENING) -> Corrector:
        if of is compiled and at is state and stiffening == _STIFFENING:
            return corrector
        metric = _weighted(_stiffened(of.system, stiffening * period), weights)
        return mass_corrector(metric, at, work if at is state else None)

    def close(guess: bool = False) -> None:
        before = state.q.copy()
        try:
            moved = close_positions(compiled, model, state, make, guess)
        except AssemblyError:  # with stiff modes, redundant joints may close too slowly
            if not len(_modal_coordinates(compiled)):
                raise
            state.q[:] = before
            soft = partial(make, stiffening=_SOFT_STIFFENING)
            moved = close_positions(compiled, model, state, soft, guess)
        if guess:
            placement.extend(moved_notes(moved, model.units))
        velocities.set(state)
        if begin is not None:
            state.v[:] = np.where(np.isnan(begin.v), state.v, begin.v)
            solve_stage(stiff, state, work, VELOCITIES)
        _set_states(compiled, state, work, begin)

    placement: list[str] = []
    close(begin is None)
    notes = [*placement, *velocities.notes(state)] if begin is None else []
    solve_stage(system, state, work, REMEMBER)
    elastic = start == "quasi-static" if begin is None else not begin.vibrates
    modes = _modal_coordinates(compiled) if elastic else static_coordinates(compiled.system)
    if len(modes) and (begin is None or elastic):
        try:
            _equilibrate(compiled, modes, _MASS_FACTOR * period, state, work, close)
        except _NoEquilibrium as error:
            why = _on_global_spins(compiled, model, modes)
            why += _above_critical_speed(compiled, model, modes, state.v)
            raise AssemblyError(str(error) + why) from None
    if start == "static" and begin is None:
        _solve_accelerations(stage_solver(system, state, work), state)
        solve_equilibrium(compiled, model, state, spin=spin_of(model))
        settled, states = state.v.copy(), [one.iv for one in compiled.starts]
        velocities.set(state)
        if spin_of(model).any():
            state.v[:] = settled
            solve_stage(stiff, state, work, VELOCITIES)
        state.v[states] = settled[states]
    solve_stage(system, state, work, REMEMBER)
    damped, dampings = add_damping(choose_static_modes(compiled, state.q), model, state.q)
    solve = stage_solver(damped.system, state, work)
    _solve_accelerations(solve, state)
    solve(BEGIN)
    notes += _stop_notes(compiled, model, state, work)
    return Assembled(state, work, tuple(notes), damped, dampings)


def velocity_notes(compiled: Compiled, model: Model, q: Array) -> list[str]:
    """Notes on initial velocities that a run from the closed positions q (nq,) would change.

    Nothing is compiled: missing units run as plain Python, if that is fast enough. There are no
    notes if a flexible body is not reduced yet, since its modes may satisfy the velocities.
    """
    specs = model.bodies.values()
    rigid = any(s.flexible and not b.m for s, b in zip(specs, compiled.layout.bodies, strict=True))
    loaded = load_units([initial_conditions.solve_stage, *units_of(compiled.system)])
    slow = not loaded and compiled.layout.nv > _MAX_INTERPRETED
    if rigid or slow or not any(spec.initial_velocities for spec in specs):
        return []
    state = new_state(compiled.system, channels=len(compiled.layout.channels))
    state.q[:] = q
    with nullcontext() if loaded else interpretation():
        stiff = _stiffened(compiled.system, _STIFFENING * _slowest_period(compiled))
        velocities = InitialVelocities(compiled, model, stiff)
        velocities.set(state)
        return velocities.notes(state)


def _set_states(compiled: Compiled, state: State, work: Work, begin: StartValues | None) -> None:
    """Set scalar states: first values, then those that start as functions, which may use others."""
    free = [s for s in compiled.starts if begin is None or np.isnan(begin.v[s.iv])]
    for start in free:
        state.v[start.iv] = start.value
    follow = [start for start in free if start.program >= 0]
    for _ in follow:
        solve_stage(compiled.system, state, work, RESIDUAL)
        for start in follow:
            state.v[start.iv] = work.con.fun[start.program, 0]


def _modal_coordinates(compiled: Compiled) -> IntArray:
    """(k,) indices in v of all modes."""
    places = [body.iv + 6 + np.arange(body.m) for body in compiled.layout.bodies]
    return np.concatenate([np.zeros(0, np.int64), *places])


def _on_global_spins(compiled: Compiled, model: Model, modes: IntArray) -> str:
    """Text on a cure if there is no equilibrium and rotors do not tilt with their bearings."""
    of = compiled.system.part
    names = [
        body.name
        for body in compiled.layout.bodies
        for one in model.bodies[body.name].initial_velocities.values()
        if one.axes == "global" and any(one.angular_velocity or ())
        if np.isin(of[body.iv : body.iv + 6], of[modes]).any()  # joints and forces connect them
    ]
    if not names:
        return ""
    return (
        f"; bodies.{names[0]}: an angular velocity in global axes does not tilt with a bearing "
        'that sags: leave it to a driver, or give it at a marker with axes = "body"'
    )


def _above_critical_speed(compiled: Compiled, model: Model, modes: IntArray, v: Array) -> str:
    """Text if a body rotates above the critical speed of its supports, or ""."""
    from scipy.linalg import eigvalsh

    of, speeds = compiled.system.part, {}
    for body in compiled.layout.bodies:
        if np.isin(of[body.iv : body.iv + 6], of[modes]).any():
            speeds[body.name] = float(np.linalg.norm(v[body.iv + 3 : body.iv + 6]))
    name = max(speeds, key=lambda one: speeds[one], default="")
    equations = StateEquations(compiled, new_state(compiled.system))
    equations.state.q[:] = compiled.initial_q
    M, _, K, Cq, _ = equations.tangents()
    if not np.isfinite(K).all():  # of immense forces
        return ""
    elsewhere = np.eye(len(M))[~np.isin(of, of[modes])]
    Z = null_space(np.vstack([Cq, elsewhere]))
    try:
        squares = eigvalsh(Z.T @ (K + K.T) @ Z, 2.0 * Z.T @ M @ Z)
    except np.linalg.LinAlgError:
        return ""
    squares = squares[squares > _NO_STIFFNESS * squares.max(initial=0.0)]
    lowest = float(np.sqrt(squares.min(initial=np.inf)))
    if not name or not lowest < speeds[name] < np.inf:
        return ""
    fast, slow = (model.units.say(one, "rad/s", 3) for one in (speeds[name], lowest))
    return f"; bodies.{name} turns with {fast}, above the lowest natural frequency at rest, {slow}"


def _equilibrate(
    compiled: Compiled,
    rates: IntArray,
    b: float,
    state: State,
    work: Work,
    close: Callable[[], None],
) -> None:
    """Elastic equilibrium of modes with the accelerations of a motion without vibration.

    `rates` (k,) are the indices of the modes in v. With the modal mass M + b K, the accelerations
    η̈ give the step f = b η̈ to equilibrium, and reactions that rigid bodies do not determine are
    distributed by stiffness. √b is much longer than all periods, so that finally η̈ = 0. Loads that
    depend on the deformation, as in a fast rotation, may exceed K η. So the steps are combined by
    Anderson acceleration (J. ACM 12 (1965) 547), which solves linear equations in as many rounds as
    there are modes. With geometric stiffening and membrane forces K is that of the deformation and
    loads of the round (Newton); with membrane forces steps are combined once they are small.
    """
    solve = stage_solver(_stiffened(compiled.system, b, rates), state, work)
    begins = [body.iv for body in compiled.layout.bodies]  # a pose has one more than v
    modes = rates + np.searchsorted(begins, rates, side="right")
    weights = compiled.system.weights[rates]
    before: list[tuple[Array, Array]] = []  # previous deformations and their steps
    membranes = compiled.system.parts.bodies["shapes"].any()
    stiffened = [one.centrifugal_stiffness is not None for one in compiled.bodies.values()]
    newton = membranes or (any(stiffened) and len(state.v) <= MAX_COORDINATES)
    equations = StateEquations(compiled, state) if newton else None
    for _ in range(_MAX_ROUNDS):
        _solve_accelerations(solve, state)
        if equations is not None:
            added = equations.added_stiffness()
            solve = stage_solver(_stiffened(compiled.system, b, rates, added), state, work)
            _solve_accelerations(solve, state)
        eta, step = state.q[modes], b * state.vd[rates]
        change = float(np.abs(step * weights).max(initial=0.0))
        if not change < 1.0:
            break
        state.q[modes] += step
        if before:
            motion = np.stack([eta - one for one, _ in before], axis=1)
            fall = np.stack([step - one for _, one in before], axis=1)
            scaled = weights[:, None] * fall
            shares = np.linalg.lstsq(scaled, weights * step, rcond=_RANK_TOLERANCE)[0]
            state.q[modes] -= (motion + fall) @ shares
        if change < _SMALL_STEP or not membranes:
            before.append((eta, step))
        try:
            close()
        except AssemblyError:  # deformed so far that joints stay open or close on a wrong branch
            break
        if change <= _DEFORMATION_TOLERANCE:
            return
    what = (
        "the flexible bodies find no elastic equilibrium with the first motion: it is too fast or "
    )
    if len(rates) < len(_modal_coordinates(compiled)):
        cure = "the quasi-static modes too soft; make the lowest of them dynamic"
        raise _NoEquilibrium(what + cure)
    raise _NoEquilibrium(
        what
        + 'the body too soft for dynamics.start = "quasi-static"; use "undeformed", or begin slower'
    )


def _solve_accelerations(solve: Callable[[int], float], state: State) -> None:
    code = solve(ACCELERATIONS)
    if code != SUCCESS:
        no_length = "a spring-damper has no length in the first pose; move its markers apart"
        raise AssemblyError(_ACCELERATION_ERRORS.get(int(code), no_length))
    if not (np.all(np.isfinite(state.vd)) and np.all(np.isfinite(state.lam))):
        raise AssemblyError(
            "the first accelerations are not finite; check functions of time at t = 0"
        )
    state.aa[:] = state.vd
    state.vd_before[:] = state.vd
    state.lam_before[:] = state.lam


def _stop_notes(compiled: Compiled, model: Model, state: State, work: Work) -> list[str]:
    """A sentence on each stop that is in contact at the start."""
    notes = []
    for name, element in compiled.elements.items():
        if element.kind != FORCE_CHARACTERISTICS.name:
            continue
        row = compiled.system.kinds[element.kind].rows[element.row]
        if not row["stop"]:
            continue
        measure = _stop_measure(compiled, row, state, work)
        depth = max(measure - row["upper"], row["lower"] - measure)
        spec = model.forces[name.partition(".")[2]]
        angular = isinstance(spec, JointStopSpec) and spec.coordinate != "stroke"
        if depth > _PENETRATION * (1.0 if angular else compiled.length):
            text = model.units.say(depth, "rad" if angular else "m", 4)
            notes.append(f"{name} is {text} inside the stop at the start: it pushes from there on")
    return notes


def _stop_measure(compiled: Compiled, row: np.void, state: State, work: Work) -> float:
    """Distance, displacement or joint coordinate that a stop limits."""
    if row["measure"] == COORDINATE_OF:
        return float(state.q[compiled.system.parts.coordinates[row["coordinate"]]["iq"]])
    markers = work.now.marker
    h = markers["x"][row["J"]] - markers["x"][row["I"]]
    if row["measure"] == DISTANCE_OF:
        return float(np.linalg.norm(h))
    return float(markers["R"][row["I"]][:, 2] @ h)


def _stiffened(
    system: System, b: float, modes: IntArray | None = None, more: Mapping[int, Array] | None = None
) -> System:
    """The system with modal masses M + b K, b in s², of all modes or of those with indices in v.

    `more` (m, m) by rows of bodies is added to K.
    """
    pool, added = system.parts.pool.copy(), np.ones(len(system.weights))
    if modes is not None:
        added[:] = 0.0
        added[modes] = 1.0
    for row in np.flatnonzero(system.parts.bodies["m"]):
        body = system.parts.bodies[row]
        mass, stiffness = _modal_blocks(pool, body)
        if more and row in more:
            stiffness = stiffness + more[int(row)]
        own = added[body["iv"] + 6 : body["iv"] + 6 + body["m"]]
        mass += b * stiffness * np.outer(own, own)
    kinds = {name: tables for name, tables in system.kinds.items() if name != STATIC_MODES.name}
    return system._replace(parts=system.parts._replace(pool=pool), kinds=kinds)


def _weighted(system: System, weights: Array) -> System:
    """The system with the inertia of each body multiplied by its weight; (bodies,) weights."""
    if np.all(weights == 1.0):
        return system
    bodies, pool = system.parts.bodies.copy(), system.parts.pool.copy()
    bodies["mass"] *= weights
    bodies["S1"] *= weights[:, None]
    bodies["S0"] *= weights[:, None, None]
    for body, weight in zip(_flexible(system), weights[bodies["m"] > 0], strict=True):
        m, at = int(body["m"]), int(body["flex"])
        forms = at + 12 * m + 3 * m * m  # after mass, stiffness and damping
        pool[at : forms - 2 * m * m] *= weight
        partial = place_of_pairs(body) - forms + 9 * size_of_form(m)[0]
        pool[forms : forms + (0, partial, 12 * m * m)[int(body["coupling"])]] *= weight
    return system._replace(parts=system.parts._replace(bodies=bodies, pool=pool))


def _slowest_period(compiled: Compiled) -> float:
    """1/ω² of the softest mode of all bodies that has stiffness [s²]; 0 without flexible bodies."""
    slowest = 0.0
    for body in compiled.flexbodies.values():
        values = (2.0 * np.pi * body.frequencies) ** 2
        values = values[values > _NO_STIFFNESS * values.max(initial=0.0)]
        slowest = max(slowest, 1.0 / float(values.min())) if values.size else slowest
    return slowest


def _flexible(system: System) -> NDArray[np.void]:
    """Rows of the bodies that have modes."""
    bodies = system.parts.bodies
    return np.asarray(bodies[bodies["m"] > 0])


def _modal_blocks(pool: Array, body: np.void) -> tuple[Array, Array]:
    """Views (m, m) of the modal mass and stiffness of one body in the pool."""
    m = int(body["m"])
    at = int(body["flex"]) + 12 * m
    mass, stiffness = pool[at : at + 2 * m * m].reshape(2, m, m)
    return mass, stiffness
