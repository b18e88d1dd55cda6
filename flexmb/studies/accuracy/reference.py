"""The reference of a group of settings: an accurate run of its finest model, confirmed by a second.

In: the settings of a group and their histories. Out: the histories of the reference, and for each
quantity the smallest error that can be distinguished from its own error. Two reference runs, with
another step or tolerance and if possible with another method, must agree to a tenth of the smallest
error shown. As long as they do not, the next ones are more accurate. If that would take too long,
errors smaller than ten times the disagreement are not shown; none are shown if the two differ by
more than 1 %.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from flexmb.model.scenes.dynamics import ACCURACY, OPTIONS
from flexmb.studies.channel_errors import Difference, RunHistories, difference, error_text
from flexmb.studies.study_settings import Setting

_AUTO = "auto"
# Methods that confirm each other; with error control only the last two, which are of high order.
_METHODS = ("generalized-alpha", "explicit-rk", "radau")
_AGREEMENT = 0.1  # largest difference of two reference runs, over the smallest error shown
_MAX_DISAGREEMENT = 0.01  # two reference runs that differ by more than this are no reference
_ROUND_OFF = 1e-12  # relative differences below this are accepted
_MAX_STAGES = 3
# longest time of a further reference run, over the processor time of all timed runs
_TIME_SHARE = 1.0
_SHORT_RUN = 20.0  # processor time [s] of a run that is always affordable
# longest time of a run by another method, over that of the first reference run
_OTHER_METHOD_LIMIT = 10.0
_TIME_GROWTH = 3.0  # expected growth of the time of a reference run from stage to stage


class ReferenceRun(NamedTuple):
    """A reference run: changes to the finest setting, its stage, and a time limit [s]."""

    label: str
    method: str
    changes: dict[str, Any]
    stage: int
    limit: float = 0.0


class Candidate(NamedTuple):
    """A reference run that has finished."""

    run: ReferenceRun
    reading: RunHistories
    seconds: float  # processor time [s]
    wall: float


@dataclass(frozen=True)
class Reference:
    """The run that errors are measured against; `reading` is None if there is none."""

    reading: RunHistories | None
    # smallest error that can be shown, by quantity
    floors: dict[str, float] = field(default_factory=dict)
    sentence: str = ""  # describes the run and what confirms it, or says why there is none
    physics: str = ""  # key of its model

    def shown(self, name: str) -> bool:
        """Whether errors of a quantity can be shown at all."""
        return self.reading is not None and self.floors[name] <= _MAX_DISAGREEMENT / _AGREEMENT


def _agreement_text(apart: Mapping[str, Difference]) -> str:
    return ", ".join(f"{name} to {error_text(one.value)}" for name, one in apart.items())


class ReferenceSearch:
    """The search for the reference of one group, stage by stage."""

    def __init__(self, settings: Sequence[Setting]) -> None:
        self.finest = max(settings, key=lambda setting: setting.rank)
        self.specs = [setting.dynamics for setting in settings]
        fixed = all(spec.get("step") is not None for spec in self.specs)
        available = _METHODS if fixed else _METHODS[1:]
        methods = dict.fromkeys(
            available[0] if spec["method"] == _AUTO else spec["method"] for spec in self.specs
        )
        first = available[0] if available[0] in methods else next(iter(methods))
        others = [name for name in (*methods, *available) if name != first]
        self.methods: tuple[str, ...] = (first, *others[:1])
        self.stage = 0
        self.candidates: list[Candidate] = []
        self.failures: list[str] = []

    def next_runs(self, readings: Sequence[RunHistories], seconds: float) -> list[ReferenceRun]:
        """The reference runs of the next stage; none if the reference is accurate enough.

        Parameters
        ----------
        readings : sequence of Reading
            The histories of the settings of the group.
        seconds : float
            Processor time of all their timed integrations.
        """
        if self.stage == _MAX_STAGES or (self.stage > 1 and self._takes_too_long(seconds)):
            return []
        if len(self.candidates) > 1 and self._best(readings)[0] <= 1.0:
            return []
        self.stage += 1
        first, *others = self.methods
        runs = [self._new_run(first, self.stage)]
        ended = {one.run.method for one in self.candidates}
        for other in others:
            if self.stage == 2 or (self.stage > 2 and other in ended):
                longest = max((one.wall for one in self.candidates), default=0.0)
                limit = max(_SHORT_RUN, _OTHER_METHOD_LIMIT * longest)
                runs.append(self._new_run(other, self.stage - 1, limit))
        return runs

    def add(
        self, run: ReferenceRun, reading: RunHistories | None, record: Mapping[str, Any]
    ) -> None:
        """Add a reference run that has ended, successfully or not."""
        if reading is None:
            self.failures.append(f"{run.label}: {record['reason']}")
        else:
            self.candidates.append(
                Candidate(run, reading, min(record["cpu_seconds"]), min(record["seconds"]))
            )

    def reference(self, readings: Sequence[RunHistories]) -> Reference:
        """The reference with the best confirmation."""
        if len(self.candidates) < 2:
            why = f" ({self.failures[0]})" if self.failures else ""
            what = "there is no reference, so no errors are shown: no two tight runs ended well"
            return Reference(None, {}, what + why, self.finest.complete_physics)
        _, apart, second, best = self._best(readings)
        floors = {name: max(one.value / _AGREEMENT, _ROUND_OFF) for name, one in apart.items()}
        reference = Reference(best.reading, floors)
        sentence = (
            f"reference: {best.run.label}; agrees with {second.run.label}: {_agreement_text(apart)}"
        )
        if second.run.method == best.run.method:
            sentence += self._other_method(best)
        bad = [name for name in floors if not reference.shown(name)]
        if bad:
            sentence += f"; it does not converge in {', '.join(bad)}, whose errors are not shown"
        return Reference(best.reading, floors, sentence, self.finest.complete_physics)

    def _other_method(self, best: Candidate) -> str:
        """The difference of the best run of another method from the reference, if one has
        finished."""
        others = [one for one in self.candidates if one.run.method != best.run.method]
        if not others:
            return ""
        nearest = max(others, key=lambda one: one.run.stage)
        return (
            f"; {nearest.run.label}: {_agreement_text(difference(nearest.reading, best.reading))}"
        )

    def _best(
        self, readings: Sequence[RunHistories]
    ) -> tuple[float, dict[str, Difference], Candidate, Candidate]:
        """Largest ratio of disagreement to the allowed one, disagreements by quantity, both runs.

        The more accurate run is the second.
        """
        pairs = []
        ordered = sorted(self.candidates, key=lambda one: one.run.stage)
        for second, best in itertools.combinations(ordered, 2):
            apart = difference(second.reading, best.reading)
            shown = [difference(reading, best.reading) for reading in readings]
            ratio = 0.0
            for name, one in apart.items():
                smallest = min((errors[name].value for errors in shown), default=1.0)
                ratio = max(ratio, one.value / (_AGREEMENT * max(smallest, 10 * _ROUND_OFF)))
            pairs.append((ratio, apart, second, best))
        return min(pairs, key=lambda one: one[0])

    def _takes_too_long(self, seconds: float) -> bool:
        """Whether the next tight run would take too long."""
        latest = max((one.seconds for one in self.candidates), default=0.0)
        return _TIME_GROWTH * latest > max(_SHORT_RUN, _TIME_SHARE * seconds)

    def _new_run(self, method: str, stage: int, limit: float = 0.0) -> ReferenceRun:
        """A reference run with a quarter of the smallest step, or a tenth of the smallest accuracy,
        per stage."""
        changes: dict[str, Any] = {"dynamics.method": method}
        steps, newton = self._values("step"), self._values("newton_tolerance")
        if len(steps) == len(self.specs):
            knob, value = "step", min(steps) * 0.5 ** (stage + 1)
        else:
            least = min(self._values("accuracy"), default=ACCURACY)
            knob, value = "accuracy", least * 0.1**stage
        changes[f"dynamics.{knob}"] = value = float(f"{value:.12g}")
        if newton and method in OPTIONS["newton_tolerance"]:
            changes["dynamics.newton_tolerance"] = max(0.01 * min(newton), min(*newton, _ROUND_OFF))
        return ReferenceRun(f"{method} with {knob} {value:.3g}", method, changes, stage, limit)

    def _values(self, name: str) -> list[float]:
        """Values of a field of `[dynamics]` in all settings that have it."""
        return [spec[name] for spec in self.specs if spec.get(name) is not None]
