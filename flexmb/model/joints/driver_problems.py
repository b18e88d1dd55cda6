"""Whether drivers fit the model and each other, and functions have values where runs begin.

In: a model under check. Out: problems with scene paths.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import Problem
from flexmb.model.functions.expression import Expression
from flexmb.model.functions.function import Function
from flexmb.model.joints.drivers import DriverSpec
from flexmb.model.scenes.scope import Scope
from flexmb.model.values.names import GROUND, split_reference

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["closing", "driver_problems", "finite"]

_SAMPLES = 201  # of a distance over the run


def driver_problems(scope: Scope) -> Iterator[Problem]:
    """All that is wrong with the drivers."""
    yield from scope.markers("drivers")
    driven: dict[tuple[str, ...], str] = {}
    for name, spec in scope.model.drivers.items():
        where = f"drivers.{name}"
        yield from _target(scope, where, spec)
        for coordinate, function in spec.motions(scope.model.plane):
            yield from finite(f"{where}.{coordinate}", function, max(0, 2 - spec.order))
            target, key = _key(spec, coordinate)
            if key in driven:
                what = f'the {coordinate} {target} is driven by "{driven[key]}" already'
                yield Problem(where, what)
            driven.setdefault(key, name)
        if spec.distance is not None and spec.order == 0:
            told = closing(scope.model, spec.distance.expression)
            if told is not None:
                yield Problem(f"{where}.distance", told)


def _target(scope: Scope, where: str, spec: DriverSpec) -> Iterator[Problem]:
    """A coordinate that the joint has, or markers that move."""
    if spec.joint is not None:
        yield from scope.coordinate(where, spec.joint, spec.coordinate)
        return
    if spec.position is not None and scope.model.plane is None and len(spec.position) != 3:
        yield Problem(f"{where}.position", "a point has 3 coordinates, given 2")
    if spec.between is not None:
        yield from scope.pair(where, spec.between, "a driver")
        return
    first, second = spec.ends
    yield from scope.material(f"{where}.marker", second)
    if spec.relative_to is not None:
        yield from scope.material(f"{where}.relative_to", first)
    bodies = split_reference(first)[0], split_reference(second)[0]
    if bodies[1] == GROUND:
        yield Problem(f"{where}.marker", "a marker of ground does not move")
    elif bodies[0] == bodies[1]:
        what = f'both markers are on "{bodies[0]}": they do not move against each other'
        yield Problem(f"{where}.relative_to", what)


def _key(spec: DriverSpec, coordinate: str) -> tuple[str, tuple[str, ...]]:
    """What is driven, in words and so that equal coordinates have equal keys."""
    if spec.joint is not None:
        return f'of joint "{spec.joint}"', ("joint", spec.joint, coordinate)
    if spec.between is not None:
        first, second = sorted(spec.between)
        return f'between "{first}" and "{second}"', ("between", first, second)
    first, second = spec.ends
    frame = f' relative to "{first}"' if spec.relative_to else ""
    return f'of marker "{second}"{frame}', ("marker", first, second, coordinate)


def closing(model: Model, distance: Expression) -> str | None:
    """The sentence for a distance that does not stay above zero over the run, as far as seen."""
    end, units = model.dynamics.duration if model.dynamics is not None else 0.0, model.units
    for t in np.linspace(0.0, end, _SAMPLES if end > 0.0 else 1):
        value = distance.value(float(t))[0]
        if value <= 0.0:
            told = f"the distance is {units.say(value, 'm')} at {units.say(float(t), 's')}"
            return f"{told}; at zero the line between the markers has no direction: keep it above"
    return None


def finite(where: str, function: Function, derivatives: int = 0) -> Iterator[Problem]:
    """A function that has a value at the start of a run, and as many derivatives as are needed."""
    if function.expression.channels:
        return  # known only as the model moves
    parts = ("value", "first derivative", "second derivative")
    for part, value in zip(parts, function.value(0.0)[: derivatives + 1], strict=False):
        if not math.isfinite(value):
            text = function.expression.text
            yield Problem(where, f'the {part} of "{text}" is {value:g} at t = 0, not finite')
            return
