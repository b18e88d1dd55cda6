"""Whether the couplers of a model fit their joints and each other.

In: the scope of a check. Out: problems: joints that do not exist or lack the coordinate, gears
without a common carrier, couplers that hold each other fast; and sentences on couplers that repeat
what others say. The couplers are linear equations A x = c between joint coordinates x: a row that
others combine to is a circle whose ratios agree; a coordinate that the rows determine is locked.
"""

from __future__ import annotations

from collections.abc import Iterator
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


class _Circle(NamedTuple):
    """A coupler that closes a circle: with which others; what is wrong, None if all agrees."""

    name: str
    others: tuple[str, ...]
    what: str | None


def _circles(model: Model, flexbodies: lookup.Bodies) -> Iterator[_Circle]:
    """Couplers that close a circle with earlier ones, in order."""
    found = dict(known_equations(model, flexbodies))
    keys = list(dict.fromkeys((t.joint, t.coordinate) for e in found.values() for t in e.terms))
    kept: dict[str, Equation] = {}
    rows = np.zeros((0, len(keys)))
    for name, one in found.items():
        row = np.zeros(len(keys))
        for term in one.terms:
            row[keys.index((term.joint, term.coordinate))] += term.factor
        row /= np.linalg.norm(row)
        share, left = _combined(rows, row)
        others = tuple(n for n, s in zip(kept, share, strict=True) if abs(s) > _NONE)
        if left <= _NONE:
            yield _Circle(name, others, _contradiction(one, others, kept, share))
            continue
        before, rows = rows, np.vstack([rows, row])
        kept[name] = one
        locked = np.flatnonzero(_locked(rows) & ~_locked(before))
        if len(locked):
            involved = np.abs(np.array([_combined(rows, np.eye(len(keys))[k])[0] for k in locked]))
            others = tuple(n for n, s in zip(kept, involved.max(axis=0), strict=True) if s > _NONE)
            others = tuple(n for n in others if n != name)
            held = [f"{keys[k][0]}.{keys[k][1]}" for k in locked]
            yield _Circle(name, others, _told(others, held, _product(before, row)))


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
