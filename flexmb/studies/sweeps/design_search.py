"""Questions of a designer, answered over runs: where a bound is met, what makes a scalar least.

In: questions, the ranges of the knobs, a function that runs settings. Out: an :class:`Answer`:
sentences, and the settings. For one knob and one bound the range is scanned, every change of sign
between two runs is narrowed to a root (Brent's method), and the parts of the range that meet the
bound are reported. Otherwise: Sobol samples, then a bounded minimisation with constraints from the
best of them (COBYQA, Ragonneau and Zhang 2023). Without a scalar to minimise the objective is the
distance from the present scene. Goals that were not reached are reported.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from flexmb.errors import Problem, SceneError
from flexmb.flexbody.arrays import Array
from flexmb.model.scenes.sweep import Distribution, Question
from flexmb.studies.sweeps.sampling import make_design

Row = Mapping[str, Any]
RunSettings = Callable[[list[dict[str, Any]]], Sequence[Row]]

SCAN = 17
"""Number of runs in the scan of one knob."""

_ROOT_TOLERANCE = 1e-9  # width of a bracket over the range at which a root is accepted
# a change by this fraction of the values' range within that width is a jump, not a root
_JUMP_SHARE = 1e-2
# tolerances of bounds, over the range of values in the scan; the smallest that any run meets counts
_MET = (0.0, 1e-6, 1e-4)
# distance from a bound, over the range of values, so that the answer meets the bound
_MARGIN = 1e-6
_RADIUS = (0.1, 1e-4)  # first and last trust-region radius in the unit cube
_DIGITS = 12


class Target(NamedTuple):
    """A question with its bound as a number, in the scene's units."""

    question: Question
    name: str  # of the scalar
    bound: float = float("nan")
    unit: str = ""

    @property
    def is_objective(self) -> bool:
        """Whether the question minimises or maximises a scalar instead of bounding it."""
        return self.question.relation in ("minimise", "maximise")

    def violation(self, value: float | Array) -> Any:
        """Amount by which a value violates the bound; 0 or negative if it is met."""
        off = np.asarray(value) - self.bound
        return {"<=": off, ">=": -off}.get(self.question.relation, abs(off))

    def say(self, value: float) -> str:
        """A value with its unit, as text."""
        return f"{value:.6g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Answer:
    """The answer to questions.

    Attributes
    ----------
    sentences : tuple of str
        The answer in words.
    settings : tuple of dict
        Values of the knobs that answer the questions; empty if there are none.
    """

    sentences: tuple[str, ...]
    settings: tuple[dict[str, Any], ...] = ()


@dataclass
class DesignSearch:
    """The search for an answer.

    Attributes
    ----------
    knobs : dict of str to Distribution
        The knobs with their ranges.
    targets : list of Target
        The questions.
    run : callable
        Runs settings; returns rows with status, reason and scalars.
    present : dict of str to float
        Values of the knobs in the present scene.
    samples, seed : int
        Number and random seed of the Sobol samples.
    stated : dict of str to (str, float)
        Units in which the scene states knobs; see `in_stated_units`.
    """

    knobs: dict[str, Distribution]
    targets: list[Target]
    run: RunSettings
    present: dict[str, float]
    samples: int = 64
    seed: int = 0
    stated: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        where = "has no range to search in: it is a choice; give low..high"
        wrong = [Problem(f"vary {k}", where) for k, d in self.knobs.items() if d.kind == "choice"]
        if sum(target.is_objective for target in self.targets) > 1:
            wrong.append(Problem("find", "one scalar can be minimised or maximised, not several"))
        if wrong:
            raise SceneError.from_problems(wrong)

    def answer(self) -> Answer:
        """Search, and report what was found and what was not."""
        single = len(self.knobs) == len(self.targets) == 1 and not self.targets[0].is_objective
        answer = self._scan_and_narrow() if single else self._minimise()
        sentences = (*answer.sentences, *dict.fromkeys(self.failures))
        return Answer(sentences, answer.settings)

    def _run_all(self, points: Array) -> tuple[list[dict[str, Any]], Sequence[Row]]:
        settings = [self._values(point) for point in points]
        rows = self.run(settings)
        bad = [i for i, row in enumerate(rows) if row["status"] != "finished"]
        if bad:
            what = f"{len(bad)} of {len(rows)} runs of the scan failed, first at "
            first = bad[0]
            self.failures.append(f"{what}{self._text(settings[first])}: {rows[first]['reason']}")
        if len(bad) == len(rows):
            raise SceneError(self.failures[-1])
        return settings, rows

    def _values(self, point: Array) -> dict[str, Any]:
        """Values of the knobs at a point of the unit cube."""
        values = {}
        for (name, one), share in zip(self.knobs.items(), point, strict=True):
            low, high = one.span
            logarithmic = one.kind == "log-uniform"
            value = low * (high / low) ** share if logarithmic else low + (high - low) * share
            values[name] = float(f"{value:.{_DIGITS}g}")
        return rounded_as_stated(values, self.stated)

    def _text(self, setting: Mapping[str, Any]) -> str:
        return setting_text(setting, self.stated)

    def _number(self, knob: str, value: float, digits: int = 6) -> str:
        """A value of a knob in the unit in which the scene states it."""
        text = in_stated_units({knob: value}, self.stated, digits)[knob]
        return text if isinstance(text, str) else f"{value:.{digits}g}"

    def _share(self, name: str, value: float) -> float:
        """Position of a value in the range of its knob, from 0 to 1."""
        one = self.knobs[name]
        low, high = one.span
        if one.kind == "log-uniform":
            share = np.log(max(value, low) / low) / np.log(high / low)
        else:
            share = (value - low) / (high - low)
        return float(np.clip(share, 0.0, 1.0))

    def _scan_and_narrow(self) -> Answer:
        """For one knob and one bound: all roots that the scan brackets."""
        [target], [(knob, one)] = self.targets, self.knobs.items()
        say = partial(self._number, knob)
        shares = np.linspace(0.0, 1.0, max(SCAN, one.levels))
        settings, rows = self._run_all(shares[:, None])
        at = [settings[i][knob] for i in range(len(shares))]
        values = np.array([row[target.name] for row in rows], float)
        off = values - target.bound
        covers = float(np.nanmax(values) - np.nanmin(values))
        edges: list[float] = []  # values of the knob at which the bound is crossed
        sentences: list[str] = []
        finite = np.flatnonzero(np.isfinite(off))
        for i, j in itertools.pairwise(finite):
            if off[i] * off[j] > 0.0 or (off[j] == 0.0 and j < finite[-1]):
                continue  # a root at the end of an interval belongs to the next interval
            if j > i + 1:
                between = f"between {knob} = {say(at[i])} and {say(at[j])}, where runs fail"
                sentences.append(f"{target.name} crosses {target.say(target.bound)} {between}")
                continue
            root, sentence = self._narrow(target, knob, shares[[i, j]], off[[i, j]], covers)
            edges += [root] if root is not None else []
            sentences += [sentence] if sentence else []
        low, high = at[0], at[-1]
        least, most = int(np.nanargmin(values)), int(np.nanargmax(values))
        within = (
            f"{target.name} is {target.say(values[least])} at {knob} = {say(at[least])} and "
            f"{target.say(values[most])} at {knob} = {say(at[most])}, the least and the largest of "
            f"{len(at)} runs"
        )
        if not edges and not sentences:
            met = target.violation(values) <= 0.0
            whole = f"from {say(low)} to {say(high)}"
            if target.question.relation != "=" and met[np.isfinite(values)].all():
                always = f"{target.question.text} holds for every {knob} {whole}: "
                return Answer((always + within,), tuple(settings[:1] + settings[-1:]))
            never = f"no {knob} {whole} gives {target.question.text}: {within}; "
            return Answer((f"{never}no two of them bracket it, so widen the range",))
        if target.question.relation == "=":
            sentences[:0] = [f"{target.question.text} at {knob} = {say(edge, 9)}" for edge in edges]
        else:
            sentences.insert(0, self._parts(target, knob, edges, at, values))
        sentences.append(f"between: {within}")
        return Answer(tuple(sentences), tuple({knob: edge} for edge in edges))

    def _narrow(
        self, target: Target, knob: str, ends: Array, off: Array, covers: float
    ) -> tuple[float | None, str]:
        """The root in a bracket, or a sentence on what is there instead."""
        from scipy.optimize import brentq

        seen = {float(ends[0]): float(off[0]), float(ends[1]): float(off[1])}

        def function(share: float) -> float:
            if share not in seen:
                setting = self._values(np.array([share]))
                [row] = self.run([setting])
                if row["status"] != "finished":
                    raise _RunFailed(f"at {self._text(setting)}: {row['reason']}")
                seen[share] = float(row[target.name]) - target.bound
            return seen[share]

        try:
            share = float(brentq(function, *ends, xtol=_ROOT_TOLERANCE, rtol=1e-12))
        except _RunFailed as error:
            return None, f"a root was not narrowed further: the run failed {error}"
        value = self._values(np.array([share]))[knob]
        below = max((s for s in seen if seen[s] * off[0] > 0.0), default=ends[0])
        above = min((s for s in seen if seen[s] * off[1] > 0.0), default=ends[1])
        gap = abs(seen[below] - seen[above]) if below in seen and above in seen else 0.0
        if abs(seen[share]) > 0.0 and above - below < 1e-4 and gap > _JUMP_SHARE * covers:
            ends_text = " to ".join(target.say(seen[s] + target.bound) for s in (below, above))
            place = self._number(knob, value, 9)
            jump = f"{target.name} jumps there: from {ends_text} at {knob} = {place}"
            return (None if target.question.relation == "=" else value), jump
        return value, ""

    def _parts(
        self, target: Target, knob: str, edges: list[float], at: list[float], values: Array
    ) -> str:
        """The parts of the range in which a bound is met, as text."""
        marks = [at[0], *edges, at[-1]]
        parts = []
        for low, high in zip(marks[:-1], marks[1:], strict=True):
            inside = [v for x, v in zip(at, values, strict=True) if low < x < high]
            inside = inside or [v for x, v in zip(at, values, strict=True) if low <= x <= high]
            finite = np.array([v for v in inside if np.isfinite(v)])
            if len(finite) and (target.violation(finite) <= 0.0).all():
                parts.append(" to ".join(self._number(knob, one, 9) for one in (low, high)))
        return f"{target.question.text} for {knob} from {', and from '.join(parts)}"

    def _minimise(self) -> Answer:
        """For several knobs or questions: samples, then a minimisation from the best of them."""
        from scipy.optimize import Bounds, NonlinearConstraint, minimize

        k = len(self.knobs)
        unit = {name: Distribution("uniform", (0.0, 1.0)) for name in self.knobs}
        points = make_design(unit, "sobol", self.samples, self.seed).points
        home = np.array([self._share(name, value) for name, value in self.present.items()])
        points = np.vstack([home, points])
        _, rows = self._run_all(points)
        bounds = [target for target in self.targets if not target.is_objective]
        goal = next((target for target in self.targets if target.is_objective), None)
        table = {t.name: np.array([row[t.name] for row in rows], float) for t in self.targets}
        scales = {name: float(np.nanmax(v) - np.nanmin(v)) or 1.0 for name, v in table.items()}
        cache: dict[bytes, Row] = {
            point.tobytes(): row for point, row in zip(points, rows, strict=True)
        }

        def row_at(point: Array) -> Row:
            point = np.clip(point, 0.0, 1.0)
            key = point.tobytes()
            if key not in cache:
                [cache[key]] = self.run([self._values(point)])
            return cache[key]

        def number(point: Array, target: Target) -> float:
            value = float(row_at(point)[target.name])
            return value if np.isfinite(value) else float("nan")

        def objective(point: Array) -> float:
            if goal is None:
                return float(((np.asarray(point) - home) ** 2).sum())
            sign = 1.0 if goal.question.relation == "minimise" else -1.0
            value = number(point, goal)
            worst = sign * float(np.nanmax(sign * table[goal.name]))
            return sign * (value if np.isfinite(value) else worst) / scales[goal.name]

        def misses(point: Array) -> Array:
            off = [float(t.violation(number(point, t))) / scales[t.name] for t in bounds]
            return np.asarray(np.nan_to_num(np.array(off), nan=1.0))

        def order(point: Array) -> tuple[float, float]:
            return float(np.maximum(misses(point), 0.0).max(initial=0.0)), objective(point)

        finite = [p for p in points if cache[p.tobytes()]["status"] == "finished"]
        start = min(finite, key=order)
        margins = {"<=": (-np.inf, -_MARGIN), ">=": (_MARGIN, np.inf), "=": (0.0, 0.0)}
        constraints = [
            NonlinearConstraint(
                lambda p, t=t: np.nan_to_num((number(p, t) - t.bound) / scales[t.name], nan=1e3),
                *margins[t.question.relation],
            )
            for t in bounds
        ]
        minimize(
            objective, start, method="COBYQA", bounds=Bounds(np.zeros(k), np.ones(k)),
            constraints=constraints, options={
                "initial_tr_radius": _RADIUS[0], "final_tr_radius": _RADIUS[1],
                "maxfev": 100 + 40 * k,
            },
        )  # fmt: skip
        good = [np.frombuffer(key) for key, row in cache.items() if row["status"] == "finished"]
        least = min(order(p)[0] for p in good)
        limit = next((one for one in _MET if least <= one), least)
        best = min(good, key=lambda p: (max(order(p)[0], limit), order(p)[1]))
        return self._say(best, cache[best.tobytes()], order(best)[0], len(cache))

    def _say(self, best: Array, row: Row, miss: float, runs: int) -> Answer:
        setting = self._values(best)
        values = ", ".join(f"{t.name} = {t.say(float(row[t.name]))}" for t in self.targets)
        questions = " and ".join(target.question.text for target in self.targets)
        names = list(self.knobs)
        edge = [names[i] for i in np.flatnonzero((best <= 0.0) | (best >= 1.0))]
        limit = f"; {', '.join(edge)} at the end of the range" if edge else ""
        what = f"{self._text(setting)}: {values} ({runs} runs)"
        if miss > _MET[-1]:
            return Answer((f"nothing was found that meets {questions}; nearest is {what}{limit}",))
        sentences = [f"{questions}: {what}{limit}"]
        if not any(target.is_objective for target in self.targets):
            sentences.append("of what meets it, this is nearest to the scene as it stands")
        return Answer(tuple(sentences), (setting,))


class _RunFailed(Exception):
    """Raised when a run within the search for a root fails."""


def rounded_as_stated(
    setting: Mapping[str, Any], stated: Mapping[str, tuple[str, float]]
) -> dict[str, Any]:
    """Values of knobs that have few digits in the unit in which the scene states them."""
    rounded = dict(setting)
    for name, value in setting.items():
        unit, ratio = stated.get(name, ("", 1.0))
        if unit and isinstance(value, int | float):
            rounded[name] = float(f"{value * ratio:.{_DIGITS}g}") * _back(ratio)
    return rounded


def _back(ratio: float) -> float:
    """The factor back from the stated unit to the scene's, rounded as reading a scene does."""
    return float(f"{1 / ratio:.15g}")


def in_stated_units(
    setting: Mapping[str, Any], stated: Mapping[str, tuple[str, float]], digits: int = 0
) -> dict[str, Any]:
    """Values of knobs; numbers as texts in the unit in which the scene states them.

    Parameters
    ----------
    setting : dict
        Values in the scene's units.
    stated : dict of str to (str, float)
        The unit of a knob, and how many of it are one unit of the scene.
    digits : int
        Digits of these texts; 0: as many as give the value to the last bit, or a number if none do.
    """
    texts = dict(setting)
    for name, value in setting.items():
        unit, ratio = stated.get(name, ("", 1.0))
        if unit and isinstance(value, int | float):
            for length in (digits,) if digits else range(1, 18):
                text = f"{value * ratio:.{length}g}"
                if digits or float(text) * _back(ratio) == value:
                    texts[name] = f"{text} {unit}"
                    break
    return texts


def setting_text(
    setting: Mapping[str, Any], stated: Mapping[str, tuple[str, float]] | None = None,
    digits: int = 9,
) -> str:  # fmt: skip
    """Values of knobs as a short text, in the units in which the scene states them."""
    from flexmb.studies.study_settings import headings

    short = headings(tuple(setting))
    return ", ".join(
        f"{short[name]} = {value:.{digits}g}"
        if isinstance(value, float)
        else f"{short[name]} = {value}"
        for name, value in in_stated_units(setting, stated or {}, digits).items()
    )
