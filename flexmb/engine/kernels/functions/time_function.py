"""All functions of time of a system at one time."""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.jit import unit
from flexmb.engine.kernels.functions.function import CONST, run_program
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run


class TimeFunctions(NamedTuple):
    """Functions of time alone (`System.functions`)."""


@unit
def evaluate_functions(run: Run, of: TimeFunctions, at: Point) -> int:
    """Value and two derivatives at t of every function of time alone, into Constraints.fun."""
    table, out, stack = run.system.functions, run.work.con.fun, run.work.trial.stack
    variables, start, ops = run.work.trial.variables, table.start, table.ops
    for k in range(start.shape[0] - 1):
        if table.live[k] == 0:
            first = start[k]
            if start[k + 1] - first == 1 and ops[first] == CONST:
                out[k, 0], out[k, 1], out[k, 2] = table.args[first], 0.0, 0.0
            else:
                out[k, 0] = run_program(table, k, at.t[0], variables, stack)
                out[k, 1], out[k, 2] = stack[0, 1], stack[0, 2]
    return FINE


TIME_FUNCTIONS = Kind("time_functions", TimeFunctions, {"functions": evaluate_functions})
