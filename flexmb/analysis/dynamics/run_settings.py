"""Settings of a run: output times, steps, tolerances, first error scales.

A run under error control is integrated twice: first as a coarse run (its *scout*), whose steps the
fine run follows with more and shorter ones (`verified_run`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexmb.engine import method
from flexmb.engine.bodies.motion import RELATIVE_ROUND_OFF
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.compile import Compiled
from flexmb.engine.forces.contact import CONTACTS
from flexmb.engine.forces.force_characteristic import FORCE_CHARACTERISTICS
from flexmb.engine.geometry import extents_of_parts
from flexmb.engine.joints import ANGLE
from flexmb.engine.sensors.feedback import FEEDBACK
from flexmb.engine.stage_tables import kinds_of
from flexmb.engine.state import State
from flexmb.flexbody.arrays import Array
from flexmb.model.joints.joint import lost_inertias
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import ACCURACY, DynamicsSpec

_MAX_ITERATIONS = 15
# Newton tolerance with fixed steps, over h² v̇: of methods of order 2, and of high order.
_NEWTON, _NEWTON_OF_HIGH_ORDER = 1e-8, 1e-10
# Local tolerance over the requested accuracy; True: high order. With 0.1, half of 171 first passes
# of the test scenes have an error below 0.1 times the request and a fifth are repeated (order 8;
# for order 5 it is 0.6 times and a half).
_LOCAL_SHARE = {True: 0.1, False: 0.2}
# The same of high order without a comparison run, where it exceeds `Method.max_tolerance`. Of 276
# runs at 1e-2 to 1e-4, 12 exceed twice the request (3 with that tolerance, at 1.35 times the cost);
# half of them have an error below 0.01 times the request.
_UNVERIFIED_SHARE = 0.01
# A step of the fine run is rejected if its error exceeds this many times the tolerance (True:
# explicit methods). It follows the steps of the scout, and one of its steps may lie across two of
# them. With order 8 and factors 4, 2, 1, 0.7 errors exceed twice the request in 1, 0, 0, 0 of 450
# runs and are misjudged in 6, 6, 6, 11, at costs of 1, 1.02, 1.08, 1.16; with radau 4 or 2 misjudge
# 5 of 498.
_REJECTION_FACTOR = {True: 2.0, False: 4.0}
# Number of times between outputs at which ranges are looked at too. Outputs in phase with a motion
# do not show its range: 4 to 26 times the steps were taken, and errors of 0 to 300 % stated.
_TIMES_BETWEEN = 50
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # multiples of it, less whole numbers, are spread evenly
_SAME_TIME = 1e-9  # difference of two times that are equal within round-off, over the duration
# Largest number of outputs of a scout (True: with state events). With 128 of 400 outputs a seventh
# of 107 reaction errors is reported as less than a third, since pulses lie between outputs; with
# all outputs 3 of 105, at 1.04 times the cost. So all of 2000 outputs count if there are events.
_SCOUT_ROWS = {True: 1280, False: 128}
_LEAST_MOTION = 1e-6  # displacement over the size of the model below which it is at rest
# Round-off in error estimates, over the distance of positions from the origin: of Radau's method,
# of other implicit methods, and of explicit ones.
_NOISE_OF_COLLOCATION, _NOISE_OF_SOLVES, _NOISE_OF_EXPLICIT = 5e-14, 1e-14, 2e-17
_SHARE_AT_REST = 1e-3  # displacement of a part at rest over that of the model at rest
_SPEED_AT_REST = 1e3  # velocity at rest over its mean by that displacement: round-off is fast
_ROUND_OFF_FACTOR = 2.0  # roundings of a position as large as the model
_COORDINATE_SIZE = 1e-3  # assumed size of a scalar coordinate


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
    return np.linspace(0.0, spec.duration, spec.outputs + 1)


def seen_times(spec: DynamicsSpec) -> np.ndarray:
    """Times at which errors count [s]: the outputs, and even ones if they are few or listed."""
    times = output_times(spec)
    if isinstance(spec.outputs, int) and len(times) > _TIMES_BETWEEN:
        return times
    return _with_others(times, np.linspace(0.0, 1.0, _TIMES_BETWEEN + 1), spec.duration)


def compared_times(spec: DynamicsSpec) -> np.ndarray:
    """Times at which a run and its scout have rows [s].

    These are `seen_times`, and others between them that are in phase with no motion, so that its
    peak-to-peak range is known.
    """
    return _with_others(seen_times(spec), _uneven(_TIMES_BETWEEN), spec.duration)


def _with_others(times: Array, shares: Array, span: float) -> Array:
    """Times, and others at these shares of a span that are not the same."""
    others = shares * span
    edges = np.concatenate([[-np.inf], times, [np.inf]])
    after = np.searchsorted(edges, others)
    apart = np.minimum(others - edges[after - 1], edges[after] - others)
    return np.union1d(times, others[apart > _SAME_TIME * span])


def scout_rows(n: int, events: bool = False) -> np.ndarray:
    """(n,) flags of the compared times at which the scout has rows: a selection of many."""
    rows, every = np.zeros(n, dtype=bool), max(1, n // _SCOUT_ROWS[events])
    rows[(_uneven(n // every) * (n // every * every)).astype(int)] = True
    rows[-1:] = True
    return rows


def _uneven(n: int) -> Array:
    """Places (n,) from 0 to 1, one in each nth part, each elsewhere in its part."""
    k = np.arange(n)
    return np.asarray((k + k * _GOLDEN % 1.0) / n)


def damps_vibrations(compiled: Compiled, integrator: method.Method) -> bool:
    """Whether the model has flexible bodies and the method damps unresolved vibrations."""
    return integrator.stages == 0 and bool(compiled.system.parts.bodies["m"].any())


def why_implicit(compiled: Compiled, model: Model) -> str:
    """Why a run does not begin with an explicit method, or ""."""
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


def local_tolerance(spec: DynamicsSpec, integrator: method.Method) -> float:
    """First local tolerance, over the error scales, for the requested accuracy.

    A run of n steps adds up n local errors of order hᵖ⁺¹ to an error of order hᵖ. The error
    estimate is of order hᵉ, and so are outputs inside a step if e < p. The tolerance is at most
    `Method.max_tolerance`, so that errors decrease with the steps by the order: only then does the
    difference of two runs tell the error. Without a comparison run it may be larger.
    """
    accuracy = ACCURACY if spec.accuracy is None else spec.accuracy
    power = max(integrator.error_order / integrator.order, 1.0)
    high_order = integrator.order >= method.HIGH_ORDER
    wanted, largest = accuracy**power, integrator.max_tolerance
    if high_order and spec.verify is False:
        largest = max(largest, _UNVERIFIED_SHARE * wanted)
    return float(min(_LOCAL_SHARE[high_order] * wanted, largest))


def with_tolerance(
    settings: method.Settings, spec: DynamicsSpec, integrator: method.Method, tolerance: float
) -> method.Settings:
    """The settings with another local tolerance; the largest rotation per step changes with it."""
    finer = (tolerance / local_tolerance(spec, integrator)) ** (1.0 / integrator.error_order)
    return settings._replace(tolerance=tolerance, max_rotation=settings.max_rotation * finer)


def refinement(integrator: method.Method) -> float:
    """Steps of the fine run per step of its scout: 2, or 1.6 with high order.

    The reported over the true error of the test scenes, from the 10 % to the 90 % quantile: with
    order 8 0.8 to 2.7 with 1.6, 0.5 to 2.7 with 2; with order 5 0.9 to 2.6, and 0.8 to 4.
    """
    return 2.0 if integrator.order < method.HIGH_ORDER else 1.6


def loop_settings(
    compiled: Compiled, spec: DynamicsSpec, integrator: method.Method, determinate: bool
) -> method.Settings:
    """Settings of a run without scout; `determinate`: the constraints alone fix the motion."""
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
        least_motion=_LEAST_MOTION,
        newton_tolerance=spec.newton_tolerance or (newton if grid.step else 0.0),
        max_iterations=_MAX_ITERATIONS,
        does_work=int(works),
        stiff=int(stiff),
        determinate=int(determinate),
        static_after_step=int(
            static is not None and (integrator.stages > 0 or bool(static.kinetostatic.any()))
        ),
        fractional=int(math.isfinite(least_fractional_exponent(compiled))),
    )


def least_fractional_exponent(compiled: Compiled) -> float:
    """The least exponent of a contact or stop, no whole number; infinite: there is none."""
    kinds, none = compiled.system.kinds, np.zeros(0)
    contacts, laws = (kinds.get(one.name) for one in (CONTACTS, FORCE_CHARACTERISTICS))
    of_contacts = none if contacts is None else contacts.rows["n"]
    of_stops = none if laws is None else laws.rows["exponent"][laws.rows["stop"] == 1]
    exponents = np.concatenate([of_contacts, of_stops])
    return float(exponents[exponents % 1.0 > 0.0].min(initial=np.inf))


def set_least_motion(
    compiled: Compiled, integrator: method.Method, settings: method.Settings, state: State
) -> None:
    """Set the first error scales: displacements and velocities that are rest or round-off.

    They are a share of the size of the part of the model to which a coordinate is connected, and at
    least the round-off of its distance from the origin. So other parts, and where they are, have no
    influence. A driven part has at least the size of the radius of gyration of its bodies: if all
    of them were at one point, the first motion would be resolved down to the round-off of the
    driver.
    """
    bodies, weights = compiled.system.parts.bodies, compiled.system.weights
    size, away = (one * weights for one in extents_of_parts(compiled.system, state.q))
    for iv, m in zip(bodies["iv"], bodies["m"], strict=True):
        size[iv + 3 : iv + 6] = away[iv + 3 : iv + 6] = 1.0
        for x in (size, away):  # weighted modes are displacements of points, as those of the frame
            x[iv + 6 : iv + 6 + m] = x[iv]
    first = len(weights) - len(compiled.system.parts.coordinates)
    far, explicit = away / weights, integrator.stages > 0
    size[first:] = away[first:] = _COORDINATE_SIZE
    if not explicit:  # Newton's method solves for these coordinates too
        _put_joint_coordinates(compiled, np.ones(len(far)), far, away)
    noise = (
        _NOISE_OF_COLLOCATION
        if integrator.collocation
        else _NOISE_OF_EXPLICIT
        if explicit
        else _NOISE_OF_SOLVES
    )
    state.q_scale[:] = np.maximum(
        _SHARE_AT_REST * settings.least_motion * size, noise / settings.tolerance * away
    )
    state.v_scale[:] = _SPEED_AT_REST / (settings.end - settings.start) * state.q_scale


def set_first_round_off(compiled: Compiled, state: State) -> None:
    """Set the round-off of corrections at the first pose (State.first_round_off).

    Round-off of marker positions appears as the gap of a joint. Closing it moves all bodies of the
    same part of the model, and rotates them more, the smaller the part is.
    """
    system, of = compiled.system, compiled.system.part
    bodies, rows, markers = system.parts.bodies, system.rows, system.parts.markers
    size, away = extents_of_parts(compiled.system, state.q)
    away = np.maximum(_ROUND_OFF_FACTOR * size, away)
    away[away == 0.0] = _ROUND_OFF_FACTOR * compiled.length  # all markers are at the origin
    turn = np.divide(away, size, out=np.full(len(size), _ROUND_OFF_FACTOR), where=size > 0.0)
    places, coordinates = away / compiled.length, system.parts.coordinates
    _put_joint_coordinates(compiled, turn, away, places)
    states = coordinates["iv"][coordinates["state"] == 1]
    places[states] = _ROUND_OFF_FACTOR
    for iv in bodies["iv"]:
        places[iv + 3 : iv + 6] = turn[iv + 3 : iv + 6]
    ends = rows[rows["fun"] >= 0]
    on = np.concatenate([markers["body"][ends[end]] for end in "IJ"])
    is_driven = np.isin(of, of[bodies["iv"][on[on >= 0]]])
    is_driven[states] = not _bodies_act_on_states(compiled)
    state.first_round_off[:] = RELATIVE_ROUND_OFF * places, is_driven


def _bodies_act_on_states(compiled: Compiled) -> bool:
    """Whether the rate of a state depends on the motion of bodies, and on its round-off."""
    feedback = compiled.system.kinds.get(FEEDBACK.name)
    if feedback is None:
        return False
    of_states = feedback.tangents["state"][feedback.tangents["kind"] == -1]
    return bool(feedback.implicit == 1 or np.any(of_states < 0))


def _put_joint_coordinates(compiled: Compiled, turn: Array, way: Array, out: Array) -> None:
    """Raise entries of `out` for joint coordinates to those of a rotation [rad] or a way [m]."""
    system, of = compiled.system, compiled.system.parts.coordinates["iv"]
    for row, k, factor in system.coupled[["row", "coordinate", "factor"]]:
        is_angle, iv = system.rows["kind"][row] == ANGLE, of[k]
        own = turn[iv] if is_angle else way[iv] * system.weights[iv]
        out[iv] = max(out[iv], own / abs(factor))


def scout_settings(settings: method.Settings, integrator: method.Method) -> method.Settings:
    """Settings of the scout of a run: the tolerance that corresponds to its longer steps."""
    looser = refinement(integrator) ** integrator.error_order * settings.tolerance
    return settings._replace(tolerance=looser)


def fine_settings(settings: method.Settings, integrator: method.Method) -> method.Settings:
    """Settings of the fine run, which follows the steps of its scout.

    Its own error estimate rejects a step only if it is far above the tolerance.
    """
    finer = refinement(integrator)
    rings = finer**integrator.error_order if integrator.order < method.HIGH_ORDER else 1.0
    return settings._replace(
        refinement=finer, rejection_factor=_REJECTION_FACTOR[integrator.stages > 0] * rings
    )
