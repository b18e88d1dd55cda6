"""Reading sensors: every channel by the unit of its kind (`engine.sensor_kinds`)."""

from __future__ import annotations

from flexmb.engine.algebra.vector import copy
from flexmb.engine.jit import call_channel, kernel, unit
from flexmb.engine.kernels.stages import walk
from flexmb.engine.method import FINE
from flexmb.engine.records import Vector
from flexmb.engine.state import Point, Run


@kernel
def count_turns(run, at, angles):
    """Carry what counts turns to the present position: in `angles`, and for feedback."""
    near = run.work.feedback.near
    copy(angles, near)
    walk(run.stages.angles, run, at)
    for c in range(angles.shape[0]):
        angles[c] = near[c]


@kernel
def channel_value(run, at, c):
    """Value of channel c now."""
    sensors = run.system.sensors
    unit = run.sensors.channel[sensors.channels[c]["what"]]
    return call_channel(unit, run, sensors, at, c)


@unit
def read_channels(run: Run, at: Point, angles: Vector, out: Vector) -> int:
    """out (channels) of all sensors; after position, velocity and bias stages and the energies.

    `angles`: the continuous ones, at this position.
    """
    channels, turns, computed = run.system.sensors.channels, run.sensors.turns, run.sensors.computed
    variables, n_computed = run.work.trial.variables, 0
    for c in range(out.shape[0]):
        what = channels[c]["what"]
        if computed[what] == 1:
            n_computed += 1
        else:
            out[c] = angles[c] if turns[what] == 1 else channel_value(run, at, c)
    if n_computed > 0:
        for c in range(channels.shape[0]):
            x = out[c] if c < out.shape[0] else channel_value(run, at, c)
            variables[c, 0], variables[c, 1], variables[c, 2] = x, 0.0, 0.0
        for c in range(out.shape[0]):
            if computed[channels[c]["what"]] == 1:
                out[c] = channel_value(run, at, c)
    return FINE
