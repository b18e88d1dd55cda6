"""Functions over measured channels while the model moves: forces and rates of states.

The stage evaluates the channels they name with the state at hand, accelerations and multipliers
included, then the functions, into the slots of Constraints.fun that loads and scalar coordinates
read. Continuous angles are those nearest to the last accepted state.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.functions.function import run_program
from flexmb.engine.kernels.joints.primitive import wrapped
from flexmb.engine.kernels.sensors import turning
from flexmb.engine.kernels.sensors.feedback_tangent import add_tangents
from flexmb.engine.kernels.sensors.sensor import other_channel, sum_of_terms
from flexmb.engine.kernels.stages import bias_stage, velocity_stage
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.sensor_tables import ANGLE_TURNS, ANGLES_TURN, SUM, Feedback
from flexmb.engine.state import Point, Run


@unit
def evaluate_functions(run: Run, feedback: Feedback, at: Point) -> int:
    """Values of all functions over channels, after a position stage."""
    velocity_stage(run, at)
    if feedback.implicit == 1:
        bias_stage(run, at)
    channels, programs, t = feedback.channels, feedback.programs, at.t[0]
    functions, fun = run.system.functions, run.work.con.fun
    x, stack = run.work.trial.variables, run.work.trial.stack
    run.work.feedback.t[0] = t
    for k in range(channels.shape[0]):
        c = channels[k]
        x[c, 0] = _channel(run, at, c)
        x[c, 1], x[c, 2] = 0.0, 0.0
    for k in range(programs.shape[0]):
        p = programs[k]
        fun[p, 0] = run_program(functions, p, t, x, stack)
        fun[p, 1], fun[p, 2] = stack[0, 1], stack[0, 2]
    return FINE


@kernel
def _channel(run, at, c):
    """Value of channel c now; energies are none that a function may name."""
    channel, near = run.system.sensors.channels[c], run.work.feedback.near
    if channel["turns"] == ANGLES_TURN:
        term, first = run.system.sensors.terms[channel["first"]], c - channel["a"]
        Ri, Rj = turning.axes(run.work.now.marker, term)
        x, y, z = turning.angles(term["a"], Ri, Rj, near[first], near[first + 1], near[first + 2])
        return x if channel["a"] == 0 else y if channel["a"] == 1 else z
    if channel["what"] == SUM:
        s = sum_of_terms(run, at, c)
        before = near[c] if channel["turns"] == ANGLE_TURNS else math.nan
        return s if math.isnan(before) else before + wrapped(s - before)
    return other_channel(run, at, c, run.work.energies)


FEEDBACK = Kind(
    "feedback",
    Feedback,
    {"feedback": evaluate_functions, "matrix": add_tangents},
    works=True,
    stiff=True,
)
