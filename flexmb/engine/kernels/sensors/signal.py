"""Functions over measured channels while the model moves: forces and rates of states.

The stage evaluates the channels they name with the state at hand, accelerations and multipliers
included, then the functions, into the slots of Constraints.fun that loads and scalar coordinates
read. Continuous angles are those nearest to the last accepted state.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import inlined, kernel
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.functions.function import evaluate
from flexmb.engine.kernels.joints.primitive import wrapped
from flexmb.engine.kernels.sensors import sensor, turning
from flexmb.engine.sensor_tables import ANGLE_TURNS, ANGLES_TURN, SUM


@inlined
def stage(signals, sys, wk, t, q, v, vd, lam):
    """Values of all functions over channels, after a position stage."""
    if signals is not None:
        kinematics.velocity(sys.parts, wk.now, v)
        if signals.implicit[0] == 1:
            kinematics.bias(sys.parts, wk.now, v)
        wk.live.t[0] = t
        x = wk.trial.variables
        for k in range(signals.channels.shape[0]):
            c = signals.channels[k]
            x[c, 0] = _channel(sys, wk, c, q, v, vd, lam)
            x[c, 1], x[c, 2] = 0.0, 0.0
        for k in range(signals.programs.shape[0]):
            p, fun = signals.programs[k], wk.con.fun
            fun[p, 0], fun[p, 1], fun[p, 2] = evaluate(sys.functions, p, t, x, wk.trial.stack)


@inlined
def _channel(sys, wk, c, q, v, vd, lam):
    """Value of one channel now."""
    channel = sys.sensors.channels[c]
    if channel["turns"] == ANGLES_TURN:
        term, near, first = sys.sensors.terms[channel["first"]], wk.live.near, c - channel["a"]
        Ri, Rj = turning.axes(wk.now.marker, term)
        x, y, z = turning.angles(term["a"], Ri, Rj, near[first], near[first + 1], near[first + 2])
        return x if channel["a"] == 0 else y if channel["a"] == 1 else z
    if channel["what"] == SUM:
        s = sensor.total(
            sys.further, sys.lines, sys.parts, wk.now, channel, sys.sensors, vd, wk.dense
        )
        near = wk.live.near[c] if channel["turns"] == ANGLE_TURNS else math.nan
        return s if math.isnan(near) else near + wrapped(s - near)
    return sensor.other(sys.further, sys, wk, channel, q, v, lam, wk.trial.power)


@kernel
def remember(signals, wk, angles):
    """Take the continuous angles of an accepted state as those to stay near to."""
    if signals is not None:
        for c in range(angles.shape[0]):
            wk.live.near[c] = angles[c]


@kernel
def forget(signals, sensors, wk):
    """Angles within ±π from here on."""
    if signals is not None:
        sensor.forget(sensors, wk.live.near)
