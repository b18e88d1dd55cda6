"""Whether what a scene says of times fits its run: known answers, pictures, outputs, tables.

In: a model. Out: problems with scene paths.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import Problem
from flexmb.model.functions.function import Function
from flexmb.model.functions.piecewise import Piecewise
from flexmb.model.scenes.scope import Scope

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["time_problems"]

_SAME = 1e-12  # share of the run by which times that are the same may differ
_WITH_FUNCTIONS = ("drivers", "forces", "sensors", "states", "controllers")


def time_problems(scope: Scope) -> Iterator[Problem]:
    """All problems of times."""
    model = scope.model
    spans = [spec.duration for spec in (model.dynamics, model.kinematics) if spec is not None]
    if spans:
        yield from _of_outputs(model, max(spans))
        yield from _of_functions(model, max(spans))


def _of_outputs(model: Model, duration: float) -> Iterator[Problem]:
    """Times at which something is asked of the run."""
    units, spec = model.units, model.dynamics
    times = [] if model.view.time is None else [("view.time", model.view.time)]
    times += [(f"check[{i}].time", c.time) for i, c in enumerate(model.checks)]
    listed = spec is not None and model.kinematics is None and isinstance(spec.outputs, tuple)
    first, last = (0.0, duration)
    if listed and spec is not None and isinstance(spec.outputs, tuple):
        first, last = spec.outputs[0], spec.outputs[-1]
    for where, time in times:
        told = units.say(time, "s")
        if time > duration * (1 + _SAME):
            end = units.say(duration, "s")
            yield Problem(where, f"{told} lies after the end of the run, {end}")
        elif listed and not first * (1 - _SAME) <= time <= last * (1 + _SAME):
            span = f"{units.say(first, 's')} to {units.say(last, 's')}"
            what = f"nothing is recorded at {told}: dynamics.outputs covers {span}"
            yield Problem(where, what)


def _of_functions(model: Model, duration: float) -> Iterator[Problem]:
    """Splines and tables without values in a part of the run."""
    say = model.units.say
    for section in _WITH_FUNCTIONS:
        for name, spec in getattr(model, section).items():
            for where, function in _functions(f"{section}.{name}", vars(spec)):
                first, last = _domain(function)
                cure = 'give more points, or say how it goes on (beyond = "hold", '
                cure += '"extrapolate" or "repeat")'
                if last < duration:
                    what = f"its points end at {say(last, 's')}, the run at {say(duration, 's')}"
                    yield Problem(where, f"{what}; {cure}")
                if first > 0.0:
                    yield Problem(
                        where, f"its points begin at {say(first, 's')}, the run at 0; {cure}"
                    )


def _functions(where: str, value: Any) -> Iterator[tuple[str, Function]]:
    """The functions of time in the fields of a specification, with their paths."""
    if isinstance(value, Function):
        yield where, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _functions(f"{where}.{key}", item)
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _functions(f"{where}[{i}]", item)


def _domain(function: Function) -> tuple[float, float]:
    """From when to when a function through points has values [s]; infinite for all others."""
    ops = function.expression.ops
    curve = ops[-1][1] if ops and ops[0][0] == "t" and len(ops) == 2 else None
    if not isinstance(curve, Piecewise):
        return -np.inf, np.inf
    first = curve.knots[0] if np.isnan(curve.coefficients[0]).any() else -np.inf
    last = curve.knots[-1] if np.isnan(curve.coefficients[-1]).any() else np.inf
    return float(first), float(last)
