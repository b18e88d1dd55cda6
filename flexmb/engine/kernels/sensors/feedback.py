"""Functions over measured channels while the model moves: forces and rates of states.

The stage evaluates the channels they name with the state at hand, accelerations and multipliers
included, then the functions, into the slots of Constraints.fun that loads and scalar coordinates
read. Continuous angles are those nearest to the last accepted state.
"""

from __future__ import annotations

from flexmb.engine.jit import unit
from flexmb.engine.kernels.functions.function import run_program
from flexmb.engine.kernels.sensors.feedback_tangent import add_tangents
from flexmb.engine.kernels.sensors.sensor import channel_value
from flexmb.engine.kernels.stages import bias_stage, velocity_stage
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.sensor_tables import Feedback
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
        x[c, 0] = channel_value(run, at, c)
        x[c, 1], x[c, 2] = 0.0, 0.0
    for k in range(programs.shape[0]):
        p = programs[k]
        fun[p, 0] = run_program(functions, p, t, x, stack)
        fun[p, 1], fun[p, 2] = stack[0, 1], stack[0, 2]
    return FINE


FEEDBACK = Kind(
    "feedback",
    Feedback,
    {"feedback": evaluate_functions, "matrix": add_tangents},
    works=True,
    stiff=True,
)
