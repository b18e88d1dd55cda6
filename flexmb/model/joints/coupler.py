"""Couplers: one equation between coordinates of two or three joints.

A linear coupler is a1 x1 + a2 x2 (+ a3 x3) = constant in the coordinates themselves; gears and
racks, whose factors follow from where their wheels are, stand in :mod:`flexmb.model.joints.gear`.
Source: Hong & Liu 2011, sections 1.3, 1.7.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.model import lookup
from flexmb.model.lookup import Bodies, ModelData
from flexmb.model.references import Component, Scope
from flexmb.model.values.quantities import Number, Quantity, Text, plain
from flexmb.model.values.reading import (
    Reader,
    Spec,
    context_of,
    fail,
    quote,
    read_entry,
    reference,
    split_reference,
)

Key = tuple[str, str]
"""A joint and its coordinate."""


@dataclass(frozen=True)
class Term:
    """One coordinate of a joint in an equation, with its factor (SI)."""

    joint: str
    coordinate: str
    factor: float


@dataclass(frozen=True)
class Equation:
    """Σ factor x = constant; ``relative``: x are counted from the placed pose."""

    terms: tuple[Term, ...]
    constant: float
    relative: bool


class Coupler(Component):
    """Base of the couplers."""

    type: str

    @property
    def coordinates(self) -> tuple[Key, ...]:
        """Joints and coordinates that it relates, in order."""
        raise NotImplementedError

    def reaction_names(self, name: str) -> tuple[str, ...]:
        """Names of what it does to each of its joints, ``coupler.joint``.

        With the coordinate behind them where the joint alone does not identify it.
        """
        joints = [joint for joint, _ in self.coordinates]
        return tuple(
            f"{name}.{joint}" + (f".{x}" if x == "second_angle" or joints.count(joint) > 1 else "")
            for joint, x in self.coordinates
        )

    def equation(self, model: ModelData, flexbodies: Bodies) -> Equation:
        """Its equation; its joints exist and share a carrier.

        Raises
        ------
        SceneError
            Axes on which the wheels cannot roll, radii that do not fit their distance.
        """
        raise NotImplementedError

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        problems = list(self.reference_problems(scope, where))
        yield from problems
        if not problems and all(joint in scope.model.joints for joint, _ in self.coordinates):
            yield from self.geometry_problems(scope, where)

    def reference_problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        """Joints that exist, differ, and have these coordinates."""
        raise NotImplementedError

    def geometry_problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        """What keeps it from having an equation, as far as the bodies of its joints are known."""
        model = scope.model
        for joint, _ in self.coordinates:
            for end in model.joints[joint].between:
                body = split_reference(end)[0]
                if body in scope.broken.get("bodies", {}) or any(scope.marker("", end)):
                    return
                flexible = body in model.bodies and model.bodies[body].flexible
                if flexible and lookup.flexbody_of(model, body, scope.flexbodies) is None:
                    return
        try:
            self.equation(model, scope.flexbodies)
        except SceneError as error:
            yield from (Problem(where, p.what) for p in error.problems)


class AngleTerm(Spec):
    """One angle in a linear coupler and its factor."""

    joint: Text
    coordinate: Literal["angle", "second_angle"]
    factor: Number


class StrokeTerm(Spec):
    """One stroke in a linear coupler and its factor."""

    joint: Text
    coordinate: Literal["stroke"]
    factor: Annotated[float, Quantity("1/m")]


_TERMS: dict[str, type[AngleTerm | StrokeTerm]] = {
    "angle": AngleTerm,
    "second_angle": AngleTerm,
    "stroke": StrokeTerm,
}


def _term(value: Any, info: ValidationInfo) -> AngleTerm | StrokeTerm:
    if isinstance(value, AngleTerm | StrokeTerm):
        return value
    coordinate = value.get("coordinate") if isinstance(value, dict) else "angle"
    if coordinate is None:
        raise fail(Problem("coordinate", "is missing", tuple(_TERMS)))
    if coordinate not in tuple(_TERMS):
        what = f"unknown coordinate {quote(coordinate)}"
        raise fail(Problem("coordinate", what, tuple(_TERMS), nearest(str(coordinate), _TERMS)))
    spec, problems = read_entry(_TERMS[coordinate], value, context_of(info))
    if spec is not None and spec.factor == 0:
        problems = [Problem("factor", "is zero: leave the term out")]
    if problems or spec is None:
        raise fail(*problems)
    return spec


def _as_table(value: AngleTerm | StrokeTerm, info: SerializationInfo) -> dict[str, Any]:
    return value.model_dump(mode="json", exclude_none=True, context=info.context)


_TERM_FORM = {"anyOf": [reference(AngleTerm), reference(StrokeTerm)]}


class LinearCouplerSpec(Coupler):
    """a1 x1 + a2 x2 (+ a3 x3) = ``constant``, x angles [rad] and strokes of joints.

    ``terms`` are two or three tables of ``joint``, ``coordinate`` and ``factor``.
    """

    type: Literal["linear"]
    terms: Annotated[
        tuple[Annotated[AngleTerm | StrokeTerm, Reader(_term, _as_table, _TERM_FORM)], ...],
        BeforeValidator(plain),
    ]
    constant: Number = 0.0

    @model_validator(mode="after")
    def _two_or_three_different(self) -> Self:
        keys = self.coordinates
        if len(keys) not in (2, 3):
            raise fail(Problem("terms", f"two or three terms are expected, given {len(keys)}"))
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            what = f'the {twice[1]} of joint "{twice[0]}" stands here twice: add up its factors'
            raise fail(Problem("terms", what))
        return self

    @property
    def coordinates(self) -> tuple[Key, ...]:
        return tuple((term.joint, term.coordinate) for term in self.terms)

    def equation(self, model: ModelData, flexbodies: Bodies) -> Equation:
        terms = tuple(Term(term.joint, term.coordinate, term.factor) for term in self.terms)
        return Equation(terms, self.constant, relative=False)

    def reference_problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        for i, (joint, coordinate) in enumerate(self.coordinates):
            for problem in scope.coordinate(f"{where}.terms[{i}]", joint, coordinate):
                place = problem.where.replace(f".{coordinate}", ".coordinate")
                yield Problem(place, problem.what, problem.allowed, problem.nearest)


def coupler_equations(model: ModelData, flexbodies: Bodies) -> Iterator[tuple[str, Equation]]:
    """The equations of screws (by scene path), then those of couplers (by name) that can be had."""
    for name, joint in model.joints.items():
        if joint.pitch is not None:
            thread = (Term(name, "angle", joint.pitch / (2 * math.pi)), Term(name, "stroke", -1.0))
            yield f"joints.{name}", Equation(thread, 0.0, relative=True)
    for name, coupler in model.couplers.items():
        try:
            yield name, coupler.equation(model, flexbodies)
        except (FlexmbError, KeyError, IndexError):
            continue  # reported by the check of the coupler itself
