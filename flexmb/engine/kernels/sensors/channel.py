"""Channels of sensors: sums of terms, states, places on curves, energies, wrenches, expressions."""

from __future__ import annotations

from flexmb.engine.bodies.flexible_body import body_energy
from flexmb.engine.jit import call_channel, unit
from flexmb.engine.kernels.functions.function import run_program
from flexmb.engine.kind import ChannelKind
from flexmb.engine.sensor_tables import Sensors
from flexmb.engine.state import Point, Run

_SPRING, _TOTAL = 3, 4


@unit
def sum_of_terms(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Sum of the terms of channel c."""
    channel, terms, units = sensors.channels[c], sensors.terms, run.sensors.measure
    s = 0.0
    for t in range(channel["first"], channel["first"] + channel["n"]):
        value = call_channel(units[terms[t]["measure"]], run, sensors, at, t)
        s += terms[t]["factor"] * value
    return s


@unit
def velocity_coordinate(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """A velocity coordinate: a state, or the rate of a place."""
    return at.v[sensors.channels[c]["first"]]  # type: ignore[no-any-return]


@unit
def place(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Place of a curve marker along its curve."""
    return at.q[sensors.channels[c]["first"]]  # type: ignore[no-any-return]


@unit
def energy(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """An energy of the model, as evaluated last; that of springs with that of bristles."""
    e, number = run.work.energies, sensors.channels[c]["first"]
    spring = e[_SPRING] + e[4]
    if number == _TOTAL:
        return e[0] + e[1] + e[2] + spring  # type: ignore[no-any-return]
    return spring if number == _SPRING else e[number]  # type: ignore[no-any-return]


@unit
def energy_of_body(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """An energy of one body."""
    channel = sensors.channels[c]
    return body_energy(run, channel["n"], channel["first"], at)


@unit
def wrench(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """One component of the force or moment that an element has on one of its two markers."""
    channel, d, stage = sensors.channels[c], run.work.dense, run.stages.wrenches
    kind, axes, a = channel["kind"], channel["axes"], channel["a"]
    call_channel(stage.units[kind], run, stage.tables[kind], at, c)
    w = d.g[1]
    o = 6 * (1 - channel["side"]) + 3 * channel["quantity"]
    if axes == -1:
        return w[o + a]  # type: ignore[no-any-return]
    own = d.pair[1] if channel["side"] == 0 else d.pair[0]
    R = run.work.now.marker[own if axes < 0 else axes]["R"]
    return R[0, a] * w[o] + R[1, a] * w[o + 1] + R[2, a] * w[o + 2]  # type: ignore[no-any-return]


@unit
def expression(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """A program over other channels, which stand in Trial.variables."""
    trial, k = run.work.trial, sensors.channels[c]["first"]
    return run_program(sensors.programs, k, at.t[0], trial.variables, trial.stack)


SUM = ChannelKind(sum_of_terms, "terms")
STATE = ChannelKind(velocity_coordinate, "state")
PLACE = ChannelKind(place, "coordinate")
PLACE_RATE = ChannelKind(velocity_coordinate, "coordinate")
ENERGY = ChannelKind(energy, "forces")
BODY_ENERGY = ChannelKind(energy_of_body, "forces")
WRENCH = ChannelKind(wrench, "forces")
EXPRESSION = ChannelKind(expression, "channels")
