"""Couplers: one equation between coordinates of two or three joints.

A linear coupler is a1 x1 + a2 x2 (+ a3 x3) = constant in the coordinates themselves. Gears and
racks, whose factors follow from the positions of their wheels, are in
:mod:`flexmb.model.joints.gear`.

The couplers of a model are linear equations A x = c in joint coordinates x. A row that is a linear
combination of others closes a loop whose ratios agree: it is redundant. A coordinate that is
determined by the rows alone is locked. Source: Hong & Liu 2011, sections 1.3, 1.7.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.flexbody.arrays import Array
from flexmb.model import lookup
from flexmb.model.lookup import Bodies, Component, ModelData, Scope
from flexmb.model.quantities import Number, Quantity, Text, plain
from flexmb.model.reading import (
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
    """Σ factor x = constant; if ``relative``, each x is measured from the placed pose."""

    terms: tuple[Term, ...]
    constant: float
    relative: bool


class Coupler(Component):
    """Base of the couplers."""

    type: str

    @property
    def coordinates(self) -> tuple[Key, ...]:
        """Joints and coordinates that the coupler relates, in order."""
        raise NotImplementedError

    def reaction_names(self, name: str) -> tuple[str, ...]:
        """Names of its reactions on its joints, ``coupler.joint``.

        The coordinate is appended if the joint alone does not identify the reaction.
        """
        joints = [joint for joint, _ in self.coordinates]
        return tuple(
            f"{name}.{joint}" + (f".{x}" if x == "second_angle" or joints.count(joint) > 1 else "")
            for joint, x in self.coordinates
        )

    def equation(self, model: ModelData, flexbodies: Bodies) -> Equation:
        """The equation; its joints must exist and share a carrier.

        Raises
        ------
        SceneError
            Axes on which the wheels cannot roll, or radii that do not fit the distance of the axes.
        """
        raise NotImplementedError

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        problems = list(self.reference_problems(scope, where))
        yield from problems
        if not problems and all(joint in scope.model.joints for joint, _ in self.coordinates):
            yield from self.geometry_problems(scope, where)

    def reference_problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        """Problems of joints that do not exist, are equal, or do not have these coordinates."""
        raise NotImplementedError

    def geometry_problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        """Why there is no equation, as far as the bodies of its joints are known."""
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
    def _check_terms(self) -> Self:
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
    """Equations of screws (by scene path), then of couplers (by name); those with errors are left
    out."""
    for name, joint in model.joints.items():
        if joint.pitch is not None:
            thread = (Term(name, "angle", joint.pitch / (2 * math.pi)), Term(name, "stroke", -1.0))
            yield f"joints.{name}", Equation(thread, 0.0, relative=True)
    for name, coupler in model.couplers.items():
        try:
            yield name, coupler.equation(model, flexbodies)
        except (FlexmbError, KeyError, IndexError):
            continue  # reported by the check of the coupler itself


_ROUND_OFF = 1e-9  # share of a row of unit length below which its remainder is round-off


def coupler_loop_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of couplers that contradict or lock each other, if each is correct by itself."""
    for loop in _loops(scope.model, scope.flexbodies):
        if loop.problem is not None:
            yield Problem(f"couplers.{loop.name}", loop.problem)


def repeated_couplers(model: ModelData, flexbodies: Bodies) -> Iterator[str]:
    """Sentences on couplers that close a loop in which all ratios agree, and so are redundant."""
    for loop in _loops(model, flexbodies):
        if loop.problem is None:
            yield (
                f"couplers.{loop.name} repeats what {_join(loop.others)} already demand: "
                "the motion is the same, but how the loop shares its loads is not unique; "
                "without this coupler it is"
            )


@dataclass
class _Independent:
    """The independent couplers so far, and the coordinates that they relate."""

    equations: list[tuple[str, Equation]] = field(default_factory=list)
    # indices of the equations that contain each coordinate
    relating: dict[Key, list[int]] = field(default_factory=dict)
    locked: set[Key] = field(default_factory=set)

    def add(self, name: str, equation: Equation) -> None:
        """Append a coupler."""
        for key in _factors(equation):
            self.relating.setdefault(key, []).append(len(self.equations))
        self.equations.append((name, equation))

    def extends(self, equation: Equation) -> bool:
        """Whether a coupler has coordinates that no other relates, and locks none.

        It locks none if there are two such coordinates, or one that follows a coordinate which can
        move.
        """
        factors = _factors(equation)
        least = _ROUND_OFF * math.hypot(*factors.values())
        keys = [key for key, factor in factors.items() if abs(factor) > least]
        old = [key for key in keys if key in self.relating]
        new = len(keys) - len(old)
        return new > 1 or (new == 1 and len(old) == 1 and old[0] not in self.locked)

    def connected(self, equation: Equation) -> dict[str, Equation]:
        """All couplers that are connected with one, directly or through others, by shared
        coordinates."""
        numbers: set[int] = set()
        left = list(_factors(equation))
        while left:
            more = set(self.relating.get(left.pop(), ())) - numbers
            numbers |= more
            left += [key for k in more for key in _factors(self.equations[k][1])]
        return dict(self.equations[k] for k in sorted(numbers))


class _Loop(NamedTuple):
    """A coupler that closes a loop with others; ``problem`` is None if all of them agree."""

    name: str
    others: tuple[str, ...]
    problem: str | None


def _loops(model: ModelData, flexbodies: Bodies) -> Iterator[_Loop]:
    """Couplers that close a loop with earlier ones, in the order of the model."""
    couplers = _Independent()
    for name, equation in coupler_equations(model, flexbodies):
        if couplers.extends(equation):
            couplers.add(name, equation)
        else:
            yield from _closed_loop(couplers, name, equation)


def _closed_loop(couplers: _Independent, name: str, equation: Equation) -> Iterator[_Loop]:
    """The loop that a coupler closes with others, if any; an independent coupler is added."""
    connected = couplers.connected(equation)
    keys = list(dict.fromkeys(key for e in (*connected.values(), equation) for key in _factors(e)))
    before = np.array([_row(e, keys) for e in connected.values()]).reshape(-1, len(keys))
    row = _row(equation, keys)
    share, left = _combined(before, row)
    others = tuple(n for n, s in zip(connected, share, strict=True) if abs(s) > _ROUND_OFF)
    if left <= _ROUND_OFF:
        yield _Loop(name, others, _contradiction(equation, others, connected, share))
        return
    rows = np.vstack([before, row])
    couplers.add(name, equation)
    locked = np.flatnonzero(_locked(rows) & ~_locked(before))
    couplers.locked.update(keys[k] for k in locked)
    if len(locked):
        involved = np.abs(np.array([_combined(rows, np.eye(len(keys))[k])[0] for k in locked]))
        parts = zip((*connected, name), involved.max(axis=0), strict=True)
        others = tuple(n for n, s in parts if s > _ROUND_OFF and n != name)
        coordinates = [f"{keys[k][0]}.{keys[k][1]}" for k in locked]
        what = f"closes a loop with {_join(others)} in which {_join(coordinates)} cannot move"
        product = _product(before, row)
        if product is not None:
            what += f", for its ratios multiply to {product:.6g} instead of 1"
        what += "; leave one of these couplers out, or make their ratios agree"
        yield _Loop(name, others, what)


def _factors(equation: Equation) -> dict[Key, float]:
    """The factors of an equation by coordinate."""
    factors: dict[Key, float] = {}
    for term in equation.terms:
        key = term.joint, term.coordinate
        factors[key] = factors.get(key, 0.0) + term.factor
    return factors


def _row(equation: Equation, keys: list[Key]) -> Array:
    """The factors of an equation in the order of `keys`, scaled to a row of unit length."""
    factors = _factors(equation)
    row = np.array([factors.get(key, 0.0) for key in keys])
    return np.asarray(row / np.linalg.norm(row))


def _combined(rows: Array, wanted: Array) -> tuple[Array, float]:
    """Coefficients of the combination of rows that is nearest to `wanted`, and the distance
    left."""
    share = np.linalg.lstsq(rows.T, wanted, rcond=None)[0]
    return np.asarray(share, float), float(np.linalg.norm(wanted - rows.T @ share))


def _locked(rows: Array) -> NDArray[np.bool_]:
    """(keys,) bool: coordinates that the (independent) rows determine alone."""
    Q = np.linalg.qr(rows.T)[0]
    left = np.eye(rows.shape[1]) - Q @ Q.T
    locked: NDArray[np.bool_] = np.linalg.norm(left, axis=0) <= _ROUND_OFF
    return locked


def _contradiction(
    equation: Equation, others: tuple[str, ...], connected: dict[str, Equation], share: Array
) -> str | None:
    """The problem of a redundant equation with another constant; None if any equation is
    relative."""
    if equation.relative or any(connected[name].relative for name in others):
        return None

    def scaled(e: Equation) -> float:
        return e.constant / float(np.linalg.norm([term.factor for term in e.terms]))

    constants = np.array([scaled(e) for e in connected.values()])
    if abs(share @ constants - scaled(equation)) <= _ROUND_OFF * max(1.0, np.abs(constants).max()):
        return None
    return (
        f"contradicts {_join(others)}: they demand the same but for another constant; correct it, "
        "or leave one of them out"
    )


def _product(before: Array, row: Array) -> float | None:
    """The product of the ratios around a loop of couplers with two terms each; None for others."""
    terms = np.flatnonzero(np.abs(row) > _ROUND_OFF)
    if len(terms) != 2 or len(before) == 0:
        return None
    i, j = terms
    # Motions that the other couplers allow, restricted to those two coordinates.
    _, size, Vt = np.linalg.svd(before)
    allowed = Vt[int(np.sum(size > _ROUND_OFF)) :, [i, j]]
    scale, directions = np.linalg.svd(allowed)[1:]
    if scale[1:].sum() > _ROUND_OFF * scale.sum() or np.abs(directions[0]).min() <= _ROUND_OFF:
        return None
    return float(-row[i] / row[j] * directions[0, 0] / directions[0, 1])


def _join(names: Sequence[str]) -> str:
    quoted = [f'"{name}"' for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)
