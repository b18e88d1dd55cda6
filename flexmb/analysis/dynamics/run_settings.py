"""Settings of a run: times of outputs, steps, tolerances, and what counts as rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexmb.engine import method
from flexmb.engine.bodies.motion import RELATIVE_ROUND_OFF
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.compile import Compiled
from flexmb.engine.geometry import extents_of_parts
from flexmb.engine.joints import ANGLE
from flexmb.engine.stage_tables import kinds_of
from flexmb.engine.state import State
from flexmb.flexbody.arrays import Array
from flexmb.model.joints.joint import lost_inertias
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import ACCURACY, DynamicsSpec

_MAX_ITERATIONS = 15
_NEWTON, _NEWTON_OF_HIGH_ORDER = 1e-8, 1e-10  # relative, with fixed steps
# Local error over the requested one, of high order or not: with 0.1 half of 171 first passes of the
# judging scenes are below 0.1 times it and a fifth are repeated (order 8; 0.6 and a half, order 5).
_LOCAL = {True: 0.1, False: 0.2}
# Local error of a run over that of its shorter steps, where one lies across two of its scout
# (explicit or not). By order 8, 4, 2, 1, 0.7 exceed twice the request in 1, 0, 0, 0 of 450 runs and
# misjudge 6, 6, 6, 11, at 1, 1.02, 1.08, 1.16 times the cost; 4 or 2 misjudge 5 of 498 of radau.
_SLACK = {True: 2.0, False: 4.0}
_COMPARED = 51  # times in addition to outputs that are fewer or listed
_SAME_TIME = 1e-9  # difference of two times that are one but for round-off, over the duration
# Outputs from which on a scout has fewer than the run (where contacts, stops or limits of functions
# are watched or not): with 128 of 400 a seventh of 107 reactions is told as less than a third, as
# pulses lie between; with all 3 of 105, at 1.04 times the cost.
_SCOUT_ROWS = {True: 256, False: 128}
_AT_REST = 1e-6  # motion over the size of the model
# What round-off of positions, over their distance from the origin, leaves in estimates: of Radau's
# method, of others that solve for the motion of a step, and of explicit ones.
_COLLOCATED, _SOLVED, _NOISE = 5e-14, 1e-14, 2e-17
_SHARE_AT_REST = 1e-3  # of what counts for the model, for one of its parts
_FASTER = 1e3  # speed at rest over its mean in the run: round-off is fast
_ROUNDED = 2.0  # times that what is as large as the model is rounded
_STATE = 1e-3  # size of a scalar coordinate, of which nothing is known


@dataclass(frozen=True)
class Steps:
    """The grid of a run: mean interval of outputs, and fixed step, 0 for error control [s]."""

    interval: float
    step: float


def time_grid(spec: DynamicsSpec) -> Steps:
    """The largest step not above the requested one that divides the interval of equal outputs.

    Where output times are listed, it divides the run.
    """
    listed = isinstance(spec.outputs, tuple)
    interval = spec.duration / (spec.n_rows if listed else spec.n_rows - 1)
    if spec.step is None:
        return Steps(interval, 0.0)
    whole = spec.duration if listed else interval
    every = max(1, math.ceil(whole / spec.step * (1.0 - 1e-12)))
    return Steps(interval, whole / every)


def output_times(spec: DynamicsSpec) -> np.ndarray:
    """Times of all outputs (n,) [s]."""
    if isinstance(spec.outputs, tuple):
        return np.array(spec.outputs)
    return np.arange(spec.outputs + 1) * (spec.duration / spec.outputs)


def compared_times(spec: DynamicsSpec) -> np.ndarray:
    """Times at which a run and its scout are compared: of outputs, and where these are few or
    listed of so many others that the peak-to-peak is known."""
    times = output_times(spec)
    if isinstance(spec.outputs, int) and len(times) >= _COMPARED:
        return times
    others = np.linspace(0.0, spec.duration, _COMPARED)
    edges = np.concatenate([[-np.inf], times, [np.inf]])
    after = np.searchsorted(edges, others)
    apart = np.minimum(others - edges[after - 1], edges[after] - others)
    return np.union1d(times, others[apart > _SAME_TIME * spec.duration])


def scout_rows(n: int, events: bool = False) -> np.ndarray:
    """Which of n compared times a scout has rows at: of many every second, third, ...; (n,)."""
    rows = np.zeros(n, dtype=bool)
    rows[:: max(1, n // _SCOUT_ROWS[events])] = True
    rows[-1:] = True
    return rows


def damps_vibrations(compiled: Compiled, integrator: method.Method) -> bool:
    """Whether there are flexible bodies, and a method that damps what it does not resolve."""
    return integrator.stages == 0 and bool(compiled.system.parts.bodies["m"].any())


def why_implicit(compiled: Compiled, model: Model) -> str:
    """Why a run is not begun by an explicit method, or ""."""
    if compiled.system.parts.bodies["m"].any():
        return "flexible bodies"
    return "an inertia that is round-off" if any(lost_inertias(model)) else ""


def gyration(compiled: Compiled) -> dict[str, float]:
    """Radius of gyration of each flexible body about the origin of its frame, by its name [m]."""
    rows = zip(compiled.layout.bodies, compiled.system.parts.bodies, strict=True)
    return {
        body.name: float(np.sqrt(np.trace(row["S0"]) / row["mass"]))
        for body, row in rows
        if row["m"]
    }


def modal_reach(compiled: Compiled) -> dict[str, Array]:
    """What one unit of each modal coordinate of a flexible body moves a point at most [m]."""
    lengths = compiled.system.weights * compiled.length
    return {
        body.name: lengths[body.iv + 6 : body.iv + 6 + body.m]
        for body in compiled.layout.bodies
        if body.m
    }


def local_tolerance(spec: DynamicsSpec, integrator: method.Method) -> float:
    """First guess of the local error of a step, over the motion, for the requested accuracy.

    n steps leave n local errors of order hᵖ⁺¹, so that the error in the end is of order hᵖ; the
    estimate of the method is of order hᵉ, and so are outputs inside a step where e < p. It is never
    so large that errors do not fall with the steps as the order says.
    """
    accuracy = ACCURACY if spec.accuracy is None else spec.accuracy
    power = max(integrator.error_order / integrator.order, 1.0)
    local = _LOCAL[integrator.order >= method.HIGH_ORDER]
    return float(min(local * accuracy**power, integrator.max_tolerance))


def with_tolerance(
    settings: method.Settings, spec: DynamicsSpec, integrator: method.Method, tolerance: float
) -> method.Settings:
    """The settings with another local tolerance; steps that are not ruled by it shrink as well."""
    finer = (tolerance / local_tolerance(spec, integrator)) ** (1.0 / integrator.error_order)
    return settings._replace(tolerance=tolerance, max_rotation=settings.max_rotation * finer)


def refinement(integrator: method.Method) -> float:
    """Steps of a run for each one of its scout: twice, or fewer where errors fall fast.

    The error told over the true one of the judging scenes, a tenth of them below and a tenth above:
    0.8 to 2.7 with 1.6 and order 8, 0.5 to 2.7 with 2; 0.9 to 2.6 and 0.8 to 4 with order 5.
    """
    return 2.0 if integrator.order < method.HIGH_ORDER else 1.6


def loop_settings(
    compiled: Compiled, spec: DynamicsSpec, integrator: method.Method, determinate: bool
) -> method.Settings:
    """Of a run without scout; `determinate` if the constraints alone fix the motion."""
    system, kinds, grid = compiled.system, kinds_of(compiled.system), time_grid(spec)
    works = bool(
        any(kind.does_work for kind in kinds)
        or np.any(system.rows["fun"] >= 0)
        or np.any(system.parts.bodies["damped"])
    )
    stiff = any(kind.is_stiff(system.kinds[kind.name]) for kind in kinds)
    static = system.kinds.get(STATIC_MODES.name)
    newton = _NEWTON if integrator.order < method.HIGH_ORDER else _NEWTON_OF_HIGH_ORDER
    return method.Settings(
        start=0.0,
        end=spec.duration,
        interval=grid.interval,
        step=grid.step,
        tolerance=0.0 if grid.step else local_tolerance(spec, integrator),
        accuracy=ACCURACY if spec.accuracy is None else spec.accuracy,
        rejection_factor=1.0,
        max_rotation=1.0,
        refinement=0.0,
        least_motion=_AT_REST,
        newton_tolerance=spec.newton_tolerance or (newton if grid.step else 0.0),
        max_iterations=_MAX_ITERATIONS,
        does_work=int(works),
        stiff=int(stiff),
        determinate=int(determinate),
        static_after_step=int(
            static is not None and (integrator.stages > 0 or bool(static.kinetostatic.any()))
        ),
    )


def set_least_motion(
    compiled: Compiled, integrator: method.Method, settings: method.Settings, state: State
) -> None:
    """Set motion and speed of all coordinates to what is rest or round-off.

    Round-off grows with the distance from the origin; a share of the size of the part of the
    model that shares equations, so that what else moves, and where it stands, has no say. A part
    that is driven is as large as the radius of gyration of its bodies at least: where they all
    stand at one point the first motion would be resolved down to the round-off of the driver.
    """
    bodies, weights = compiled.system.parts.bodies, compiled.system.weights
    size, away = (one * weights for one in extents_of_parts(compiled.system, state.q))
    for iv, m in zip(bodies["iv"], bodies["m"], strict=True):
        size[iv + 3 : iv + 6] = away[iv + 3 : iv + 6] = 1.0
        for x in (size, away):  # a weighted mode moves points of the body, as its frame does
            x[iv + 6 : iv + 6 + m] = x[iv]
    first = len(weights) - len(compiled.system.parts.coordinates)
    far, explicit = away / weights, integrator.stages > 0
    size[first:] = away[first:] = _STATE
    if not explicit:  # Newton's method solves for them too
        _put_joint_coordinates(compiled, np.ones(len(far)), far, away)
    noise = _COLLOCATED if integrator.collocation else _NOISE if explicit else _SOLVED
    state.motion[:] = np.maximum(
        _SHARE_AT_REST * settings.least_motion * size, noise / settings.tolerance * away
    )
    state.speed[:] = _FASTER / (settings.end - settings.start) * state.motion


def set_first_places(compiled: Compiled, state: State) -> None:
    """Set the round-off of corrections at the first pose (State.first_places).

    Round-off of marker positions appears as the gap of a joint. Closing it moves all bodies of the
    same part of the model, and rotates them more, the smaller the part is.
    """
    system, of = compiled.system, compiled.system.part
    bodies, rows, markers = system.parts.bodies, system.rows, system.parts.markers
    size, away = extents_of_parts(compiled.system, state.q)
    away = np.maximum(_ROUNDED * size, away)
    away[away == 0.0] = _ROUNDED * compiled.length  # all at the origin, without a marker elsewhere
    turn = np.divide(away, size, out=np.full(len(size), _ROUNDED), where=size > 0.0)
    places, coordinates = away / compiled.length, system.parts.coordinates
    _put_joint_coordinates(compiled, turn, away, places)
    places[coordinates["iv"][coordinates["state"] == 1]] = _ROUNDED
    for iv in bodies["iv"]:
        places[iv + 3 : iv + 6] = turn[iv + 3 : iv + 6]
    ends = rows[rows["fun"] >= 0]
    on = np.concatenate([markers["body"][ends[end]] for end in "IJ"])
    state.first_places[:] = RELATIVE_ROUND_OFF * places, np.isin(of, of[bodies["iv"][on[on >= 0]]])


def _put_joint_coordinates(compiled: Compiled, turn: Array, way: Array, out: Array) -> None:
    """Let coordinates that follow joints have at least a turn [rad] or a way [m], all (nv,)."""
    system, of = compiled.system, compiled.system.parts.coordinates["iv"]
    for row, k, factor in system.coupled[["row", "coordinate", "factor"]]:
        is_angle, iv = system.rows["kind"][row] == ANGLE, of[k]
        own = turn[iv] if is_angle else way[iv] * system.weights[iv]
        out[iv] = max(out[iv], own / abs(factor))


def scout_settings(settings: method.Settings, integrator: method.Method) -> method.Settings:
    """Of the scout of a run: the tolerance that its longer steps leave."""
    looser = refinement(integrator) ** integrator.error_order * settings.tolerance
    return settings._replace(tolerance=looser)


def fine_settings(settings: method.Settings, integrator: method.Method) -> method.Settings:
    """Of a run that follows the steps of its scout; its own estimate is a safeguard only."""
    finer = refinement(integrator)
    rings = finer**integrator.error_order if integrator.order < method.HIGH_ORDER else 1.0
    return settings._replace(
        refinement=finer, rejection_factor=_SLACK[integrator.stages > 0] * rings
    )
