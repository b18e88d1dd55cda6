"""Loops that the couplers of a model close with each other, and whether their ratios agree.

In: the scope of a check. Out: problems: couplers that lock each other; and sentences on couplers
that repeat others. The couplers are linear equations A x = c between joint coordinates x: a row
that others combine to closes a loop whose ratios agree; a coordinate that the rows determine is
locked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem
from flexmb.model.joints.coupler import Equation, Key, coupler_equations
from flexmb.model.lookup import Bodies, ModelData
from flexmb.model.references import Scope

Array = NDArray[np.float64]
_ROUND_OFF = 1e-9  # share of a row that round-off of ratios leaves


def coupler_loop_problems(scope: Scope) -> Iterator[Problem]:
    """Loops of couplers that contradict or lock; asked where each coupler fits by itself."""
    for loop in _loops(scope.model, scope.flexbodies):
        if loop.problem is not None:
            yield Problem(f"couplers.{loop.name}", loop.problem)


def repeated_couplers(model: ModelData, flexbodies: Bodies) -> Iterator[str]:
    """Sentences on couplers that close a loop in which all ratios agree."""
    for loop in _loops(model, flexbodies):
        if loop.problem is None:
            yield (
                f"couplers.{loop.name} repeats what {_join(loop.others)} already demand: "
                "the motion is the same, but how the loop shares its loads is not unique; "
                "without this coupler it is"
            )


@dataclass
class _Independent:
    """The couplers so far that repeat no others, and the coordinates that they relate."""

    equations: list[tuple[str, Equation]] = field(default_factory=list)
    relating: dict[Key, list[int]] = field(default_factory=dict)  # their numbers by coordinate
    locked: set[Key] = field(default_factory=set)

    def add(self, name: str, equation: Equation) -> None:
        """Append a coupler."""
        for key in _factors(equation):
            self.relating.setdefault(key, []).append(len(self.equations))
        self.equations.append((name, equation))

    def extends(self, equation: Equation) -> bool:
        """Whether a coupler reaches coordinates that no other relates, and locks none.

        It locks none if there are two such, or one that follows one which can move.
        """
        factors = _factors(equation)
        least = _ROUND_OFF * math.hypot(*factors.values())
        keys = [key for key, factor in factors.items() if abs(factor) > least]
        old = [key for key in keys if key in self.relating]
        new = len(keys) - len(old)
        return new > 1 or (new == 1 and len(old) == 1 and old[0] not in self.locked)

    def connected(self, equation: Equation) -> dict[str, Equation]:
        """All couplers that shared coordinates join to one, in order."""
        numbers: set[int] = set()
        left = list(_factors(equation))
        while left:
            more = set(self.relating.get(left.pop(), ())) - numbers
            numbers |= more
            left += [key for k in more for key in _factors(self.equations[k][1])]
        return dict(self.equations[k] for k in sorted(numbers))


class _Loop(NamedTuple):
    """A coupler that closes a loop: with which others; what is wrong, None if all agrees."""

    name: str
    others: tuple[str, ...]
    problem: str | None


def _loops(model: ModelData, flexbodies: Bodies) -> Iterator[_Loop]:
    """Couplers that close a loop with earlier ones, in order."""
    couplers = _Independent()
    for name, equation in coupler_equations(model, flexbodies):
        if couplers.extends(equation):
            couplers.add(name, equation)
        else:
            yield from _closed_loop(couplers, name, equation)


def _closed_loop(couplers: _Independent, name: str, equation: Equation) -> Iterator[_Loop]:
    """The loop that a coupler closes with others, if it does; an independent one is added."""
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
    """The factors of an equation, in this order of coordinates and of unit size."""
    factors = _factors(equation)
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
    locked: NDArray[np.bool_] = np.linalg.norm(left, axis=0) <= _ROUND_OFF
    return locked


def _contradiction(
    equation: Equation, others: tuple[str, ...], connected: dict[str, Equation], share: Array
) -> str | None:
    """What is wrong with a repeated equation: its constant, where all are absolute."""
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
    """The product of the ratios around a loop of couplers that have two terms each."""
    terms = np.flatnonzero(np.abs(row) > _ROUND_OFF)
    if len(terms) != 2 or len(before) == 0:
        return None
    i, j = terms
    # The motions that the others allow, as those two coordinates see them.
    _, size, Vt = np.linalg.svd(before)
    allowed = Vt[int(np.sum(size > _ROUND_OFF)) :, [i, j]]
    scale, directions = np.linalg.svd(allowed)[1:]
    if scale[1:].sum() > _ROUND_OFF * scale.sum() or np.abs(directions[0]).min() <= _ROUND_OFF:
        return None
    return float(-row[i] / row[j] * directions[0, 0] / directions[0, 1])


def _join(names: Sequence[str]) -> str:
    quoted = [f'"{name}"' for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)
