"""A hard case: a scene, what makes it hard, what must hold and why that bound."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import flexmb
from flexmb.errors import FlexmbError, FlexmbWarning
from flexmb.model import Model
from flexmb.results import Result

# Error of velocities or reactions that no run of right positions states.
_ALARM = 0.3
_RINGS = "alternates from step to step"  # said of forces that are wrong by it alone
METHODS = ("auto", "generalized-alpha", "explicit-rk", "radau")


@dataclass(frozen=True)
class Hard:
    """A hard case.

    Attributes
    ----------
    why : str
        What makes it hard.
    bar : str
        What must hold, and why that bound.
    bound : float
        Of what `judge` returns.
    make : callable
        The model, without `dynamics`.
    judge : callable
        A number from a result that is not above the bound.
    run : mapping
        Fields of `dynamics`.
    methods : mapping of str to mapping
        Fields of their own by method; "fixed radau" is radau, in a column of its own.
    stops : mapping of str to str
        By method, "all" for all: what the sentence of a run contains that must not finish.
    misses : mapping of str to str
        By method: the sentence with which a run says that it did not reach what was asked.
    warns : str
        What one of the sentences of a run that finishes contains.
    seconds : bool
        Left out of the part of a minute, but not longer than some seconds.
    slow : bool
        Left out of both.
    quick : tuple of str
        Methods by which it is part of it all the same.
    """

    why: str
    bar: str
    bound: float
    make: Callable[[], Model]
    judge: Callable[[Result], float] = lambda _: 0.0
    run: Mapping[str, Any] = field(default_factory=dict)
    methods: Mapping[str, Mapping[str, Any]] = field(
        default_factory=lambda: {method: {} for method in METHODS}
    )
    stops: Mapping[str, str] = field(default_factory=dict)
    misses: Mapping[str, str] = field(default_factory=dict)
    warns: str = ""
    seconds: bool = False
    slow: bool = False
    quick: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """How a run ended: what was measured (NaN: it stopped), steps, and all its sentences.

    And the largest error that it states of velocities and reactions.
    """

    measured: float
    steps: int
    sentences: str
    stated: float = 0.0


def run_case(case: Hard, method: str) -> Outcome:
    """Run a case by a method."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", FlexmbWarning)
        try:
            model = case.make()
            model.set_dynamics(method=method.split()[-1], **{**case.run, **case.methods[method]})
            result = flexmb.simulate(model)
        except FlexmbError as error:
            return Outcome(np.nan, 0, str(error))
        measured = float(case.judge(result))
    steps = int(result.statistics["steps"])
    sentences = "; ".join(str(one.message) for one in told)
    keys = ("measured_error_of_velocities", "measured_error_of_reactions")
    stated = max(float(result.statistics.get(key, 0.0)) for key in keys)
    return Outcome(measured if np.isfinite(measured) else np.inf, steps, sentences, stated)


def failure(case: Hard, method: str, outcome: Outcome) -> str:
    """What is wrong with an outcome, or ""."""
    expected = case.stops.get(method, case.stops.get("all", ""))
    if np.isnan(outcome.measured):
        if expected and expected in outcome.sentences:
            return ""
        return f"it stopped: {outcome.sentences}"
    if expected:
        return f'it finished, where "{expected}" should stop it'
    if outcome.measured > case.bound:
        told = case.misses.get(method, "")
        if told and told in outcome.sentences:
            return ""
        return f"{outcome.measured:.3g} is above {case.bound:g}"
    if outcome.stated > _ALARM:
        return f"it states an error of velocities or reactions of {outcome.stated:.2g}"
    if _RINGS in outcome.sentences and _RINGS not in case.warns:
        return f"it says that forces alternate: {outcome.sentences}"
    if case.warns and case.warns not in outcome.sentences:
        return f'nothing says "{case.warns}": {outcome.sentences}'
    return ""


def largest(*differences: Any) -> float:
    """The largest absolute entry."""
    return max(float(np.abs(one).max()) for one in differences)
