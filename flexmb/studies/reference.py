"""The truth of a group of settings: a tight run of its finest model that a second one confirms.

In: the settings of a group and what they gave. Out: the reading of the reference, and by quantity
the smallest error that can be told from its own. Two tight runs, with another step or tolerance
and where possible by another method, must agree to a tenth of the smallest error shown. As long as
they do not, the next ones are tighter; where that would take too long, smaller errors than ten
times the disagreement are not shown, and none at all where the two differ by more than 1 %.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from flexmb.model.tasks.dynamics import ACCURACY, OPTIONS
from flexmb.studies.measure import Difference, Reading, difference
from flexmb.studies.plan import Setting
from flexmb.studies.words import error_text

__all__ = ["Search", "Tight", "Truth"]

_AUTO = "auto"
# Methods that confirm each other; under error control the last two, which are of high order.
_METHODS = ("generalized-alpha", "explicit-rk", "radau")
_AGREEMENT = 0.1  # of the smallest error shown: how far two tight runs may be apart
_HOPELESS = 0.01  # two tight runs further apart than this are no reference
_ROUND_OFF = 1e-12  # relative; below it there is nothing to agree on
_STAGES = 3
_PATIENCE = 1.0  # of the seconds of all timed runs: how long a further tight one may take
_SHORT = 20.0  # s: a run that is always worth its time
_OTHER_METHOD = 10.0  # times the seconds of the first tight run before another method is given up
_GROWTH = 3.0  # of the time from one stage to the next


class Tight(NamedTuple):
    """A tight run: changes to the finest setting, its stage, seconds after which to give it up."""

    label: str
    method: str
    changes: dict[str, Any]
    stage: int
    limit: float = 0.0


class Candidate(NamedTuple):
    """A tight run that has ended well."""

    tight: Tight
    reading: Reading
    seconds: float


@dataclass(frozen=True)
class Truth:
    """What errors are measured against.

    Attributes
    ----------
    reading : Reading or None
        The reference; None where there is none.
    floors : dict
        Smallest error that can be shown, by quantity.
    sentence : str
        Which run it is and what confirms it, or why there is none.
    physics : str
        Key of its model.
    """

    reading: Reading | None
    floors: dict[str, float] = field(default_factory=dict)
    sentence: str = ""
    physics: str = ""

    def shown(self, name: str) -> bool:
        """Whether errors of a quantity can be shown at all."""
        return self.reading is not None and self.floors[name] <= _HOPELESS / _AGREEMENT


def _told(apart: Mapping[str, Difference]) -> str:
    return ", ".join(f"{name} to {error_text(one.value)}" for name, one in apart.items())


class Search:
    """Finds the truth of one group, stage by stage."""

    def __init__(self, settings: Sequence[Setting]) -> None:
        self.finest = max(settings, key=lambda setting: setting.rank)
        self.specs = [setting.dynamics for setting in settings]
        fixed = any(spec.get("step") is not None for spec in self.specs)
        known = _METHODS if fixed else _METHODS[1:]
        methods = dict.fromkeys(
            known[0] if spec["method"] == _AUTO else spec["method"] for spec in self.specs
        )
        first = known[0] if known[0] in methods else next(iter(methods))
        others = [name for name in (*methods, *known) if name != first]
        self.methods: tuple[str, ...] = (first, *others[:1])
        self.stage = 0
        self.candidates: list[Candidate] = []
        self.failures: list[str] = []

    def next_runs(self, readings: Sequence[Reading], seconds: float) -> list[Tight]:
        """The tight runs of the next stage; none once the truth is good enough.

        Parameters
        ----------
        readings : sequence of Reading
            What the settings of the group gave.
        seconds : float
            What all their timed integrations took.
        """
        if self.stage == _STAGES or (self.stage > 1 and self._impatient(seconds)):
            return []
        if len(self.candidates) > 1 and self._best(readings)[0] <= 1.0:
            return []
        self.stage += 1
        first, *others = self.methods
        runs = [self._tight(first, self.stage)]
        ended = {one.tight.method for one in self.candidates}
        for other in others:
            if self.stage == 2 or (self.stage > 2 and other in ended):
                longest = max((one.seconds for one in self.candidates), default=0.0)
                limit = max(_SHORT, _OTHER_METHOD * longest)
                runs.append(self._tight(other, self.stage - 1, limit))
        return runs

    def take(self, tight: Tight, reading: Reading | None, record: Mapping[str, Any]) -> None:
        """Add a tight run that has ended, well or not."""
        if reading is None:
            self.failures.append(f"{tight.label}: {record['reason']}")
        else:
            self.candidates.append(Candidate(tight, reading, min(record["seconds"])))

    def truth(self, readings: Sequence[Reading]) -> Truth:
        """The reference that is best confirmed."""
        if len(self.candidates) < 2:
            why = f" ({self.failures[0]})" if self.failures else ""
            what = "there is no reference, so no errors are shown: no two tight runs ended well"
            return Truth(None, {}, what + why, self.finest.physics)
        _, apart, second, best = self._best(readings)
        floors = {name: max(one.value / _AGREEMENT, _ROUND_OFF) for name, one in apart.items()}
        found = Truth(best.reading, floors)
        sentence = (
            f"reference: {best.tight.label}; agrees with {second.tight.label}: {_told(apart)}"
        )
        if second.tight.method == best.tight.method:
            sentence += self._other_method(best)
        bad = [name for name in floors if not found.shown(name)]
        if bad:
            sentence += f"; it does not converge in {', '.join(bad)}, whose errors are not shown"
        return Truth(best.reading, floors, sentence, self.finest.physics)

    def _other_method(self, best: Candidate) -> str:
        """How far the tightest run of another method is from the reference, if one ended well."""
        others = [one for one in self.candidates if one.tight.method != best.tight.method]
        if not others:
            return ""
        nearest = max(others, key=lambda one: one.tight.stage)
        return f"; {nearest.tight.label}: {_told(difference(nearest.reading, best.reading))}"

    def _best(
        self, readings: Sequence[Reading]
    ) -> tuple[float, dict[str, Difference], Candidate, Candidate]:
        """Disagreement over what is allowed, by quantity, and the two runs, tighter one last."""
        found = []
        ordered = sorted(self.candidates, key=lambda one: one.tight.stage)
        for second, best in itertools.combinations(ordered, 2):
            apart = difference(second.reading, best.reading)
            shown = [difference(reading, best.reading) for reading in readings]
            ratio = 0.0
            for name, one in apart.items():
                smallest = min((errors[name].value for errors in shown), default=1.0)
                ratio = max(ratio, one.value / (_AGREEMENT * max(smallest, 10 * _ROUND_OFF)))
            found.append((ratio, apart, second, best))
        return min(found, key=lambda one: one[0])

    def _impatient(self, seconds: float) -> bool:
        """Whether the next tight run would take too long."""
        latest = max((one.seconds for one in self.candidates), default=0.0)
        return _GROWTH * latest > max(_SHORT, _PATIENCE * seconds)

    def _tight(self, method: str, stage: int, limit: float = 0.0) -> Tight:
        """A quarter of the smallest step, or a tenth of the smallest accuracy, and so on."""
        changes: dict[str, Any] = {"dynamics.method": method}
        steps, newton = self._given("step"), self._given("newton_tolerance")
        if steps:
            knob, value = "step", min(steps) * 0.5 ** (stage + 1)
        else:
            least = min(self._given("accuracy"), default=ACCURACY)
            knob, value = "accuracy", least * 0.1**stage
        changes[f"dynamics.{knob}"] = value = float(f"{value:.12g}")
        if newton and method in OPTIONS["newton_tolerance"]:
            changes["dynamics.newton_tolerance"] = max(0.01 * min(newton), min(*newton, _ROUND_OFF))
        return Tight(f"{method} with {knob} {value:.3g}", method, changes, stage, limit)

    def _given(self, name: str) -> list[float]:
        """Values of a number of the integration in all settings that say it."""
        return [spec[name] for spec in self.specs if spec.get(name) is not None]
