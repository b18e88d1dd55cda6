"""Why a run ended early, in one sentence: what happened, when, where, and what to do.

A function of time that is not finite is named first, since it makes everything else not finite.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from flexmb.engine import method
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import solve_stage
from flexmb.engine.initial_conditions import RESIDUAL
from flexmb.engine.state import Work
from flexmb.engine.status_messages import status_message
from flexmb.model.control import feedback_functions, resolved
from flexmb.model.forces.load import BodyLoadSpec, LineForceSpec, LoadSpec
from flexmb.model.forces.spring_damper import JointSpringSpec, SpringDamperSpec
from flexmb.model.functions.function import Function
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock

_WORDS = ("value", "first derivative", "second derivative")


def failure_sentence(
    status: int, compiled: Compiled, model: Model, work: Work, time: float, step: float,
    likely: str = "",
) -> str:  # fmt: skip
    """The sentence on a step that failed.

    Parameters
    ----------
    status : int
        Status code, not `SUCCESS`.
    compiled, model, work : Compiled, Model, Work
        The model, and the scratch after the failed step.
    time, step : float
        Start and length of the step [s].
    likely : str
        The cause, unless a function is not finite.
    """
    cause = ""
    if status in (method.NOT_FINITE, method.NO_CONVERGENCE):
        cause = _not_finite(compiled, model, work, time)
        cause = cause or not_finite_function(model, (time, time + 0.5 * step, time + step))
    return cause or status_message(status, compiled, work, time, likely)


def not_finite_function(model: Model, times: Iterable[float]) -> str:
    """The sentence on the first function of time that is not finite at one of these times."""
    for where, function, derivatives in _functions(model):
        for moment in times:
            jet = tuple(function.value(moment))[: derivatives + 1]
            for word, number in zip(_WORDS, jet, strict=False):
                if not math.isfinite(number):
                    what = f'the {word} of "{function.expression.text}" is {number:g}'
                    return f"at t = {moment:.6g} s {where}: {what}, not finite"
    return ""


def _not_finite(compiled: Compiled, model: Model, work: Work, time: float) -> str:
    """The sentence on an expression over channels that is not finite where the step failed."""
    if "feedback" not in compiled.system.kinds:
        return ""
    names = dict(zip(compiled.numbers, work.trial.variables[:, 0], strict=True))
    for where, function in feedback_functions(model):
        program = resolved(model, function.expression)
        used = {name: float(names[name]) for name in program.channels}
        if where.startswith("sensors.") or not all(map(math.isfinite, used.values())):
            continue
        value = program.value(time, {name: (x, 0.0, 0.0) for name, x in used.items()})[0]
        if not math.isfinite(value):
            at = ", ".join(
                f"{name} = {model.units.say(x, model.channel_unit(name) or '')}"
                for name, x in used.items()
            )
            text = function.expression.text
            return f'at t = {time:.6g} s {where}: "{text}" is {value:g} with {at}, not finite'
    return ""


def gaps_at(compiled: Compiled, rows: OutputBlock, row: int) -> NDArray[np.float64]:
    """C (nc,) at one output row."""
    state = new_state(compiled.system, len(compiled.layout.channels))
    work = new_work(compiled.system)
    state.t[0], state.q[:], state.v[:] = rows.t[row], rows.q[row], rows.v[row]
    solve_stage(compiled.system, state, work, RESIDUAL)
    gaps: NDArray[np.float64] = work.con.C
    return gaps


def open_joint(compiled: Compiled, C: NDArray[np.float64], time: float) -> str:
    """The sentence on violated constraints; `C` (nc,) are their values at that time."""
    worst = int(np.argmax(np.abs(C)))
    where, gap = compiled.layout.rows[worst], abs(C[worst])
    return (
        f"at t = {time:.6g} s the mechanism has come apart: {where} is off by {gap:.3g} m or rad. "
        "A driver asks for more than the links can reach, or the pose is singular: check drivers "
        "and lengths, or try a smaller dynamics.step"
    )


def _functions(model: Model) -> Iterator[tuple[str, Function, int]]:
    """All functions of time with their scene path and the number of derivatives that are used."""
    for name, driver in model.drivers.items():
        for coordinate, function in driver.motions(model.plane):
            yield f"drivers.{name}.{coordinate}", function, max(0, 2 - driver.order)
    for name, force in model.forces.items():
        if isinstance(force, LoadSpec):
            for k, function in enumerate(force.value):
                if not function.expression.channels:
                    yield f"forces.{name}.value[{k}]", function, 0
        elif isinstance(force, BodyLoadSpec | SpringDamperSpec | LineForceSpec | JointSpringSpec):
            actuator = force.value
            if actuator is not None and not actuator.expression.channels:
                yield f"forces.{name}.value", actuator, 0
