"""Whether the couplers of a model fit their joints and each other.

In: the scope of a check. Out: problems: joints that do not exist or lack the coordinate, gears
without a common carrier, couplers that hold each other fast; and sentences on couplers that repeat
what others say. The couplers are linear equations A x = c between joint coordinates x: a row that
others combine to is a circle whose ratios agree; a coordinate that the rows determine is locked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem, SceneError
from flexmb.model import lookup
from flexmb.model.joints.couplers import GearSpec, LinearCouplerSpec
from flexmb.model.joints.gearing import Equation, carriers, equation, known_equations, terms_of
from flexmb.model.scenes.scope import Scope
from flexmb.model.values.names import split_reference

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["coupler_problems", "repeated_couplers"]

Array = NDArray[np.float64]
Key = tuple[str, str]
"""A joint and its coordinate."""

_WHEELS = ("revolute", "cylindrical", "screw", "planar", "parallel")
_RACKS = ("prismatic", "cylindrical", "screw")
_NONE = 1e-9  # share of a row that round-off of ratios leaves


def coupler_problems(scope: Scope) -> Iterator[Problem]:
    """What is wrong with the couplers of a model."""
    wrong = False
    for name, spec in scope.model.couplers.items():
        where, terms = f"couplers.{name}", terms_of(spec)
        found = list(_joints(scope, where, terms))
        read = all(joint in scope.model.joints for joint, _ in terms)
        if read and not found and not isinstance(spec, LinearCouplerSpec):
            found = list(_carrier(scope.model, where, spec.joints))
        if read and not found:
            found = list(_geometry(scope, name))
        yield from found
        wrong = wrong or bool(found)
    if not wrong:
        for circle in _circles(scope.model, scope.flexbodies):
            if circle.what is not None:
                yield Problem(f"couplers.{circle.name}", circle.what)


def repeated_couplers(model: Model, flexbodies: lookup.Bodies) -> Iterator[str]:
    """Sentences on couplers that close a circle in which all ratios agree."""
    for circle in _circles(model, flexbodies):
        if circle.what is None:
            yield (
                f"couplers.{circle.name} repeats what {_listed(circle.others)} already demand: "
                "the motion is the same, but how the circle shares its loads is not unique; "
                "without this coupler it is"
            )


def _joints(scope: Scope, where: str, terms: tuple[tuple[str, str], ...]) -> Iterator[Problem]:
    """Joints that exist, differ, and have these coordinates."""
    spec = scope.model.couplers[where.partition(".")[2]]
    linear = isinstance(spec, LinearCouplerSpec)
    for i, (joint, coordinate) in enumerate(terms):
        place = f"{where}.terms[{i}]" if linear else f"{where}.joints[{i}]"
        for problem in scope.coordinate(place, joint, coordinate):
            at = problem.where.replace(f".{coordinate}", ".coordinate") if linear else place
            yield Problem(at, problem.what, problem.allowed, problem.nearest)
    if not linear and terms[0][0] == terms[1][0]:
        what = f'names the joint "{terms[0][0]}" twice: a {spec.type} joins two of them'
        yield Problem(f"{where}.joints", what)
    elif not linear and all(joint in scope.model.joints for joint, _ in terms):
        gear = isinstance(spec, GearSpec)
        for i, kinds in enumerate((_WHEELS, _WHEELS if gear else _RACKS)):
            joint, coordinate = terms[i]
            kind = scope.model.joints[joint].type
            if kind not in kinds and not any(scope.coordinate(where, joint, coordinate)):
                noun = "wheel" if gear or i == 0 else "rack"
                what = f'no {noun} can hang by the {kind} joint "{joint}"'
                yield Problem(f"{where}.joints[{i}]", what, kinds)


def _carrier(model: Model, where: str, joints: tuple[str, str]) -> Iterator[Problem]:
    """One body that both joints share."""
    shared = carriers(model, joints)
    if len(shared) == 1:
        return
    ends = [[split_reference(end)[0] for end in model.joints[joint].between] for joint in joints]
    told = [f'"{j}" joins {a} and {b}' for j, (a, b) in zip(joints, ends, strict=True)]
    if not shared:
        what = f"no common carrier: {told[0]}, {told[1]}; both wheels must hang on one body, "
        yield Problem(f"{where}.joints", what + "which may be ground or an arm that turns")
    else:
        what = f'{told[0]}, and so does "{joints[1]}": the second wheel must be another body'
        yield Problem(f"{where}.joints", what)


def _geometry(scope: Scope, name: str) -> Iterator[Problem]:
    """Axes on which the wheels can roll, as far as their bodies are known."""
    model = scope.model
    for joint, _ in terms_of(model.couplers[name]):
        for end in model.joints[joint].between:
            body = split_reference(end)[0]
            if body in scope.broken.get("bodies", {}) or any(scope.marker("", end)):
                return
            flexible = body in model.bodies and model.bodies[body].flexible
            if flexible and lookup.flexbody_of(model, body, scope.flexbodies) is None:
                return
    try:
        equation(model, name, scope.flexbodies)
    except SceneError as error:
        yield from error.problems


@dataclass
class _Independent:
    """The couplers so far that repeat no others, and the coordinates that they relate."""

    equations: list[tuple[str, Equation]] = field(default_factory=list)
    relating: dict[Key, list[int]] = field(default_factory=dict)  # their numbers by coordinate
    locked: set[Key] = field(default_factory=set)

    def add(self, name: str, one: Equation) -> None:
        """Append a coupler."""
        for key in _factors(one):
            self.relating.setdefault(key, []).append(len(self.equations))
        self.equations.append((name, one))

    def leads_on(self, one: Equation) -> bool:
        """Whether a coupler reaches coordinates that no other relates, and locks none.

        It locks none if there are two such, or one that follows one which can move.
        """
        factors = _factors(one)
        least = _NONE * math.hypot(*factors.values())
        keys = [key for key, factor in factors.items() if abs(factor) > least]
        old = [key for key in keys if key in self.relating]
        new = len(keys) - len(old)
        return new > 1 or (new == 1 and len(old) == 1 and old[0] not in self.locked)

    def connected(self, one: Equation) -> dict[str, Equation]:
        """All couplers that shared coordinates join to one, in order."""
        numbers: set[int] = set()
        left = list(_factors(one))
        while left:
            more = set(self.relating.get(left.pop(), ())) - numbers
            numbers |= more
            left += [key for k in more for key in _factors(self.equations[k][1])]
        return dict(self.equations[k] for k in sorted(numbers))


class _Circle(NamedTuple):
    """A coupler that closes a circle: with which others; what is wrong, None if all agrees."""

    name: str
    others: tuple[str, ...]
    what: str | None


def _circles(model: Model, flexbodies: lookup.Bodies) -> Iterator[_Circle]:
    """Couplers that close a circle with earlier ones, in order."""
    couplers = _Independent()
    for name, one in known_equations(model, flexbodies):
        if couplers.leads_on(one):
            couplers.add(name, one)
        else:
            yield from _closed(couplers, name, one)


def _closed(couplers: _Independent, name: str, one: Equation) -> Iterator[_Circle]:
    """The circle that a coupler closes with others, if it does; an independent one is added."""
    kept = couplers.connected(one)
    keys = list(dict.fromkeys(key for e in (*kept.values(), one) for key in _factors(e)))
    before = np.array([_row(e, keys) for e in kept.values()]).reshape(-1, len(keys))
    row = _row(one, keys)
    share, left = _combined(before, row)
    others = tuple(n for n, s in zip(kept, share, strict=True) if abs(s) > _NONE)
    if left <= _NONE:
        yield _Circle(name, others, _contradiction(one, others, kept, share))
        return
    rows = np.vstack([before, row])
    couplers.add(name, one)
    locked = np.flatnonzero(_locked(rows) & ~_locked(before))
    couplers.locked.update(keys[k] for k in locked)
    if len(locked):
        involved = np.abs(np.array([_combined(rows, np.eye(len(keys))[k])[0] for k in locked]))
        parts = zip((*kept, name), involved.max(axis=0), strict=True)
        others = tuple(n for n, s in parts if s > _NONE and n != name)
        held = [f"{keys[k][0]}.{keys[k][1]}" for k in locked]
        yield _Circle(name, others, _told(others, held, _product(before, row)))


def _factors(one: Equation) -> dict[Key, float]:
    """The factors of an equation by coordinate."""
    factors: dict[Key, float] = {}
    for term in one.terms:
        key = term.joint, term.coordinate
        factors[key] = factors.get(key, 0.0) + term.factor
    return factors


def _row(one: Equation, keys: list[Key]) -> Array:
    """The factors of an equation, in this order of coordinates and of unit size."""
    factors = _factors(one)
    row = np.array([factors.get(key, 0.0) for key in keys])
    return np.asarray(row / np.linalg.norm(row))


def _combined(rows: Array, wanted: Array) -> tuple[Array, float]:
    """Shares of the rows that come closest to the wanted one, and what is left of it."""
    share = np.linalg.lstsq(rows.T, wanted, rcond=None)[0]
    return np.asarray(share, float), float(np.linalg.norm(wanted - rows.T @ share))


def _locked(rows: Array) -> NDArray[np.bool_]:
    """Whether the rows, which are independent, determine each coordinate."""
    Q = np.linalg.qr(rows.T)[0]
    left = np.eye(rows.shape[1]) - Q @ Q.T
    locked: NDArray[np.bool_] = np.linalg.norm(left, axis=0) <= _NONE
    return locked


def _contradiction(
    one: Equation, others: tuple[str, ...], kept: dict[str, Equation], share: Array
) -> str | None:
    """What is wrong with a repeated equation: its constant, where all are absolute."""
    if one.relative or any(kept[name].relative for name in others):
        return None

    def scaled(e: Equation) -> float:
        return e.constant / float(np.linalg.norm([term.factor for term in e.terms]))

    constants = np.array([scaled(e) for e in kept.values()])
    if abs(share @ constants - scaled(one)) <= _NONE * max(1.0, np.abs(constants).max()):
        return None
    return (
        f"contradicts {_listed(others)}: they demand the same but for another constant; mend it, "
        "or leave one of them out"
    )


def _product(before: Array, row: Array) -> float | None:
    """The product of the ratios around a circle of couplers that have two terms each."""
    terms = np.flatnonzero(np.abs(row) > _NONE)
    if len(terms) != 2 or len(before) == 0:
        return None
    i, j = terms
    # The motions that the others allow, as those two coordinates see them.
    _, size, Vt = np.linalg.svd(before)
    allowed = Vt[int(np.sum(size > _NONE)) :, [i, j]]
    scale, directions = np.linalg.svd(allowed)[1:]
    if scale[1:].sum() > _NONE * scale.sum() or np.abs(directions[0]).min() <= _NONE:
        return None
    return float(-row[i] / row[j] * directions[0, 0] / directions[0, 1])


def _told(others: tuple[str, ...], held: list[str], product: float | None) -> str:
    circle = f"closes a circle with {_listed(others)} in which {_listed(held)} cannot move"
    if product is not None:
        circle += f", for its ratios multiply to {product:.6g} instead of 1"
    return circle + "; leave one of these couplers out, or make their ratios agree"


def _listed(names: tuple[str, ...] | list[str]) -> str:
    quoted = [f'"{name}"' for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)
