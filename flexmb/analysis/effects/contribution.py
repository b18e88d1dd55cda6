"""Contribution of an effect to the sensors of a run: another model along the same motion.

In: a run, its compiled model, and that of the same scene with one effect more or less. Out: for
each sensor the largest change, in its SI unit and over its largest peak-to-peak range.

Indicators are numbers of a motion that show which effects of a flexible body may be significant:
deflection over length, angular velocity over the lowest frequency, and the frequency of the
accelerations over that one.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.assembly.jacobian import ConstraintRows
from flexmb.analysis.effects.idle_motions import idle_bodies, turned_motions
from flexmb.analysis.effects.perturbation import Response, respond
from flexmb.analysis.effects.smooth_pieces import follow_places, follow_velocities
from flexmb.analysis.effects.stored_motion import Motion, carry_motion
from flexmb.analysis.validity.linear_elasticity import joined_modes
from flexmb.engine import equations_of_motion as stages
from flexmb.engine.allocation import new_run, new_state, new_work
from flexmb.engine.bodies.flexible_body import modal_reach
from flexmb.engine.bodies.static_modes import static_bodies
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_units import call, packed_record, prepare_units
from flexmb.engine.iteration_matrix import put_matrix
from flexmb.engine.stage_tables import units_of
from flexmb.errors import FlexmbError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array
from flexmb.model.forces.contact import ContactSpec
from flexmb.model.forces.force_characteristic import AnyStop
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.model import Model
from flexmb.model.scenes.effects import active_model
from flexmb.model.sensor import channels_of

_STANDSTILL = 1e-7  # range of a sensor over the largest of its unit that is round-off
_ROUND_OFF = 1e-13  # of places over the model, of rates over the largest
_FORCE_ROUND_OFF = 1e-9  # of reactions over the largest
_AT_REST_SHARE = 1e-3  # range in the run over that with the change of a sensor at rest
_SYMMETRY = 0.2  # change by all bodies over that by one, below which the changes cancel
_TIMED_EVALUATIONS = 50  # evaluations of the equations to measure their time
_RINGING_FLOOR = 1e-3  # least scale of fast vibrations, over the largest range of the unit
_NO_VIBRATION = 1e4  # the same, over round-off
_CUBIC = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0  # a row minus the cubic through its neighbours
_WINDOW = 11  # rows over which the median of squared differences is taken
_SECOND_ORDER = 1e-2  # change over the range of a channel above which it may be of second order
_LINEARITY = 0.3  # largest relative difference of the estimate along the changed motion
_MAX_SHARE = 1e3  # largest reported change over range


@dataclass(frozen=True)
class Contribution:
    """The largest change of a sensor: `value` in its SI unit, `share` of its peak-to-peak.

    ``at_rest``: the sensor does not move in the run. ``by_symmetry``: it does not move either if
    the effects of this kind of all bodies change together, although that of one body would move it.
    ``unresolved``: share of vibrations in it that rows do not resolve, so that the change of these
    is not known. ``unsettled``: why a second estimate, along the changed motion or with more rows,
    differs much; empty if it does not. ``coarse``: share with fewer rows, where these differ so.
    """

    sensor: str
    unit: str
    value: float
    share: float
    at_rest: bool = False
    by_symmetry: bool = False
    unresolved: float = 0.0
    unsettled: str = ""
    coarse: float = 0.0


def first_change(
    compiled: Compiled, model: Model, motion: Motion
) -> tuple[Array, Array, Array] | None:
    """Changes (nv,) of the first positions, velocities and accelerations of another model.

    None if the other model has no consistent first state there.
    """
    from scipy.spatial.transform import Rotation

    assert model.dynamics is not None
    try:
        state = assemble(compiled, model, start=model.dynamics.start).state
    except FlexmbError:
        return None
    dq, dv = np.zeros(compiled.layout.nv), state.v - motion.v[0]
    for body in compiled.layout.bodies:
        a, b = (x[body.iq : body.iq + 7 + body.m] for x in (motion.q[0], state.q))
        own = slice(body.iv, body.iv + 6 + body.m)
        turn = Rotation.from_quat(np.roll(a[3:7], -1)).inv() * Rotation.from_quat(
            np.roll(b[3:7], -1)
        )
        dq[own] = np.concatenate([b[:3] - a[:3], turn.as_rotvec(), b[7:] - a[7:]])
    n = len(compiled.layout.coordinates)
    if n:
        dq[-n:] = state.q[-n:] - motion.q[0, -n:]
    return dq, dv, state.vd - motion.vd[0]


def smaller_range(history: Array, other: Array) -> Array:
    """Least and largest values (2, k) of each channel, in the history where its range is less."""
    a, b = (np.stack([x.min(axis=0), x.max(axis=0)]) for x in (history, other))
    return np.where(np.ptp(a, axis=0) < np.ptp(b, axis=0), a, b)


def smaller_change(change: Array, other: Array) -> Array:
    """Of two estimates (n, k) of a change, that of each channel whose largest value is less."""
    sizes = (np.abs(np.nan_to_num(x, nan=np.inf)).max(axis=0, initial=0.0) for x in (change, other))
    return np.where(np.less(*sizes), change, other)


def round_off(compiled: Compiled, motion: Motion) -> dict[str, float]:
    """Range by unit (SI) below which a channel of a motion is round-off, whatever others show."""
    length, system = compiled.length, compiled.system
    rigid = [body.iv + k for body in compiled.layout.bodies for k in range(6)]
    v, vd = (np.abs(x[:, rigid] * system.weights[rigid]).max() for x in (motion.v, motion.vd))
    moments = np.abs(motion.lam).max(axis=0, initial=0.0) / system.row_weights
    moment = float(moments.max(initial=0.0))
    turns = {"rad": 1.0, "rad/s": float(v), "rad/s^2": float(vd)}
    places = {unit.replace("rad", "m"): length * size for unit, size in turns.items()}
    least = {unit: _ROUND_OFF * size for unit, size in {**turns, **places}.items()}
    return {**least, "N m": _FORCE_ROUND_OFF * moment, "N": _FORCE_ROUND_OFF * moment / length}


def contributions(
    model: Model, histories: tuple[Array, ...], change: Array, names: tuple[str, ...],
    together: Array | None = None, least: Mapping[str, float] | None = None,
) -> list[Contribution]:  # fmt: skip
    """The largest change of each sensor; zero for a sensor at rest in all histories.

    Parameters
    ----------
    model : Model
        The model with its sensors and their units.
    histories : two or three (n, k) arrays
        Channels of the run (the first one shows which are at rest), and with the change; the larger
        peak-to-peak range of the last two is used.
    change : (n, k) array
        Change of the channels by the effect.
    names : tuple of str
        Names of the channels.
    together : (n, k) array, optional
        Change by the same effect of all bodies, which shows what is at rest by symmetry.
    least : mapping of str to float, optional
        From `round_off`: ranges by unit that are no motion.
    """
    sizes: dict[str, tuple[str, float, float]] = {}
    symmetric: set[str] = set()
    rings = [fast_shares(model, x, names, least) for x in histories[:-1]]
    rests: dict[str, float] = {}
    largest: dict[str, float] = {}
    owners = {**model.sensors, **model.states, **model.controllers}
    for name, spec in owners.items():
        columns = [names.index(channel) for channel in channels_of(name, spec)]
        unit = model.channel_unit(channels_of(name, spec)[0]) or ""
        ranges = [np.ptp(x[:, columns], axis=0).max(initial=0.0) for x in histories]
        rests[name], size = ranges[0], max(ranges[-2:])
        value = np.abs(np.nan_to_num(change[:, columns], nan=np.inf)).max(initial=0.0)
        if together is not None and np.abs(together[:, columns]).max() < _SYMMETRY * value:
            symmetric.add(name)
        sizes[name] = unit, float(size), float(value)
        largest[unit] = max(largest.get(unit, 0.0), float(size))
    result = []
    for name, (unit, size, value) in sizes.items():
        moves = size > max(_STANDSTILL * largest[unit], (least or {}).get(unit, 0.0))
        share = min(value / size, _MAX_SHARE) if moves else 0.0
        at_rest = bool(rests[name] <= _AT_REST_SHARE * size)
        still = at_rest and name in symmetric
        changed, rest = value if moves else 0.0, max(one[name] for one in rings)
        result.append(Contribution(name, unit, changed, share, at_rest, still, rest))
    return result


def fast_shares(
    model: Model, history: Array, names: tuple[str, ...], least: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Difference of rows from the cubic through their neighbours (rms), over each sensor's range.

    It is small for motions that the rows resolve: 0.01 of a vibration with 0.5 rad from row to row,
    0.14 of one with 1 rad. Single jumps do not contribute, nor does `least`, from `round_off`: no
    number of rows resolves noise.
    """
    from scipy.ndimage import correlate1d, median_filter

    sizes: dict[str, tuple[str, float, float]] = {}
    largest: dict[str, float] = {}
    for name, spec in {**model.sensors, **model.states, **model.controllers}.items():
        columns = [names.index(channel) for channel in channels_of(name, spec)]
        unit, x = model.channel_unit(channels_of(name, spec)[0]) or "", history[:, columns]
        apart = correlate1d(x, _CUBIC, axis=0)[2:-2]
        # of sin² median and mean are equal; the four rows at a jump are fewer than half of a window
        usual = median_filter((apart**2).sum(axis=1), _WINDOW) if len(apart) else np.zeros(1)
        rms = float(np.sqrt(usual.mean()))
        sizes[name] = unit, float(np.ptp(x, axis=0).max(initial=0.0)), rms
        largest[unit] = max(largest.get(unit, 0.0), sizes[name][1])
    still = {unit: _NO_VIBRATION * (least or {}).get(unit, 0.0) for unit in largest}
    floors = {
        name: max(size, _RINGING_FLOOR * largest[unit], still[unit])
        for name, (unit, size, _) in sizes.items()
    }
    return {k: one[2] / floors[k] if floors[k] > 0.0 else 0.0 for k, one in sizes.items()}


def shared(
    of_one: Sequence[Contribution], of_each: Sequence[Sequence[Contribution]],
    together: Sequence[Contribution],
) -> list[Contribution]:  # fmt: skip
    """The share of one body in the change by the same effect of all bodies.

    The change by all bodies is divided in proportion to the changes by each alone. One body alone
    may change almost nothing if others support it, as one of two columns under a table, or a change
    that the others cancel. A sensor that is at rest in the run and stays so by symmetry has no
    change.
    """
    result = []
    for k, (own, whole) in enumerate(zip(of_one, together, strict=True)):
        each = [one[k].share for one in of_each]
        part = own.share / sum(each) if sum(each) > 0.0 else 1.0 / len(each)
        largest = max((one[k] for one in of_each), key=lambda one: one.value)
        still = whole.at_rest and whole.value < _SYMMETRY * largest.value and largest.by_symmetry
        value, share = (0.0, 0.0) if still else (part * whole.value, part * whole.share)
        rough = own.unsettled or whole.unsettled
        result.append(replace(own, value=value, share=share, by_symmetry=still, unsettled=rough))
    return result


def estimate(
    own: Compiled, other: Compiled, model: Model, motion: Motion, shapes: Mapping[str, Array],
    *, begins_as_placed: bool = True, quasi_static: Sequence[str] = (), inertia: Sequence[str] = (),
) -> tuple[Response, NDArray[np.bool_]]:  # fmt: skip
    """First-order change of the sensors of a run in another model, and whether it is reliable.

    Reliability is examined if there are contacts, stops or joint friction.

    Parameters
    ----------
    own, other : Compiled
        The model of the run, and the other one.
    model : Model
        The scene of the other model.
    motion : Motion
        The run.
    shapes : mapping of str to array
        As for `carry_motion`.
    begins_as_placed : bool
        Whether the run began as the scene says, not from another run.
    quasi_static : sequence of str
        Bodies whose vibrations have no inertia.
    inertia : sequence of str
        Bodies whose modes have no inertia in the run: their residual is no noise. Kinetostatic ones
        get the time derivatives of their positions as velocities, those that are springs without
        mass the derivatives of their velocities as accelerations.
    """
    carried, balance = carry_motion(motion, own, other, shapes)
    if own.layout.rows != other.layout.rows:  # a plane has no redundant reactions
        carried = carried.with_least_reactions(other)
    for body in other.layout.bodies:
        if body.name in inertia:
            balance[:, body.iv + 6 : body.iv + 6 + body.m] = 0.0
    jumps, names = None, [body.name for body in own.layout.bodies]
    every, kinetostatic = ([names[k] for k in one] for one in static_bodies(own.system))
    if static := [name for name in kinetostatic if name in inertia]:
        carried, jumps = follow_places(other, carried, static)
    elif springs := [name for name in every if name in inertia]:
        carried = follow_velocities(other, carried, springs)
    carried = carried.with_history(other)
    start = first_change(other, model, carried) if begins_as_placed else None
    made = respond(other, carried, balance, start, quasi_static=quasi_static, jumps=jumps)
    if idle := idle_bodies(other, model, carried, made.dq):
        still, changes = list[Response](), list[Array]()
        for one in turned_motions(other, carried, idle):
            if start is not None and still:
                start = first_change(replace(other, initial_q=one.q[0]), model, one)
            still.append(
                respond(
                    other, one, balance, start, quasi_static=quasi_static, jumps=jumps, idle=idle
                )
            )
            changes.append(still[-1].channels + one.channels - carried.channels)
        largest = np.abs(changes).max(axis=1).argmax(axis=0)
        change = np.take_along_axis(np.array(changes), largest[None, None], 0)[0]
        turns = ["rad" in (model.channel_unit(name) or "") for name in other.layout.channels]
        made = replace(still[0], channels=np.where(turns, made.channels, change))
    specs = active_model(model).forces.values()
    if not any(isinstance(spec, (ContactSpec, AnyStop, JointFrictionSpec)) for spec in specs):
        return made, np.ones(made.channels.shape[1], bool)
    return made, settles(other, carried, balance, made, quasi_static)


def settles(
    other: Compiled, motion: Motion, balance: Array, first: Response, quasi_static: Sequence[str]
) -> NDArray[np.bool_]:
    """Whether each channel's change is nearly confirmed by the equations along the changed motion.

    This is a second step of Newton's method for the motion. It is as large as the first if contacts
    open or close at other times with the effect, if friction forces change sign, or if the change
    is large.
    """
    span = np.maximum(np.ptp(motion.channels, axis=0), 1e-300)
    large = np.abs(first.channels).max(axis=0, initial=0.0) / span
    if first.motion is None or np.all(large < _SECOND_ORDER):
        return np.ones(len(large), bool)
    try:
        second = respond(other, first.motion, balance, quasi_static=quasi_static).channels
    except (FlexmbError, ValueError):  # no motion close to the changed one satisfies the equations
        return np.asarray(large < _SECOND_ORDER)
    more = np.abs(second).max(axis=0, initial=0.0) / span
    return np.asarray((large < _SECOND_ORDER) | (more < _LINEARITY * large))


@dataclass(frozen=True)
class Indicators:
    """Indicators of one body along a motion.

    Attributes
    ----------
    deflection : float
        Largest displacement by deformation over the length of the body.
    speed : float
        Largest angular velocity over the lowest angular frequency.
    excitation : float
        Frequency of the rigid accelerations, weighted by their energy, over the lowest one.
    """

    deflection: float
    speed: float
    excitation: float


def indicators(compiled: Compiled, motion: Motion, body: FlexBody, name: str) -> Indicators:
    """The indicators of a body of a compiled model along a motion."""
    columns = next(one for one in compiled.layout.bodies if one.name == name)
    rows = ConstraintRows(compiled).evaluate(motion.q[0])
    lowest = joined_modes(body, columns, motion.q[0], rows.Cq)[0].min(initial=np.inf)
    iv, iq = columns.iv, columns.iq + 7
    eta = motion.q[:, iq : iq + body.m]
    size = body.characteristic_length
    moved = float((np.abs(eta) @ modal_reach(body)).max(initial=0.0))
    speed = float(np.linalg.norm(motion.v[:, iv + 3 : iv + 6], axis=1).max())
    rigid = motion.vd[:, iv : iv + 6] * np.repeat([1.0, size], 3)
    change = np.gradient(rigid, motion.t, axis=0)
    total = float(np.sqrt((rigid**2).sum()))
    fast = float(np.sqrt((change**2).sum())) / total if total > 0.0 else 0.0
    return Indicators(moved / size if size > 0.0 else 0.0, speed / lowest, fast / lowest)


def evaluation_time(compiled: Compiled) -> float:
    """Time of one evaluation of the forces and one of their matrix [s]."""
    system, state = compiled.system, new_state(compiled.system, len(compiled.layout.channels))
    state.q[:] = compiled.initial_q
    prepare_units([stages.begin_run, stages.residual, put_matrix, *units_of(system)])
    run = packed_record(new_run(system, state, new_work(system, len(state.angles))))
    at, best = packed_record(run.record.state_point), np.inf
    call(stages.begin_run, run, at)
    for _ in range(5):
        began = time.thread_time()
        for _ in range(_TIMED_EVALUATIONS):
            call(stages.residual, run, at)
            call(put_matrix, run, at, 1.0, 1.0)
        best = min(best, time.thread_time() - began)
    return best / _TIMED_EVALUATIONS
