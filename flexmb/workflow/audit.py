"""The audit: what each effect contributes to the sensors of a run, whether it is on or left out.

In: a result. Out: a table of effects, each by a computation along the motion of the run: the same
scene with the effect on instead of off, or off instead of on, is linearised about that motion and
driven by what the motion leaves out of balance in it (`flexmb.analysis.effects`). Deformation is
judged from a rigid run of the scene, further modes from a finer reduction of the mesh.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexmb.errors import FlexmbError, ResultFileError, SceneError
from flexmb.progress import Progress, silent
from flexmb.workflow.effect import DEFORMATION, MEMBRANE, MODES, UNBOUNDED, Effect, percent
from flexmb.workflow.effect_estimates import Estimates
from flexmb.workflow.neighbours import ModelVariants
from flexmb.workflow.scene_effects import scene_effects

if TYPE_CHECKING:
    from flexmb.analysis.validity.validity_monitor import ValidityMonitor
    from flexmb.results import Result


TEXT = "audit"
"""Name of the text in a result that holds its audit."""
BUDGET = 0.01
"""Largest share of the peak-to-peak of a sensor that left out effects may contribute."""
_WASTED_SHARE = 0.1  # of the budget: an effect that contributes less does not pay for its time
_RINGING_SHARE = 1 / 3  # of the budget: vibration of a sensor that the rows do not resolve
# Factors by which the share of such a sensor may be too small: of any effect, of further modes.
_RINGING_DOUBT, _MODES_DOUBT = 100.0, 1000.0
_UNSETTLED = "much, not how much"
_TOLD_BEFORE = "as told of the run without it"
_AGAIN = "flexmb audit tells along this run what is on and was told of the run without it"
_MAX_ROWS = 800  # of a run, that are evaluated
MISSING, NEEDED, WASTED, SMALL, UNKNOWN = (
    "missing", "needed", "could be off", "may stay off", "not known",
)  # fmt: skip
COLUMNS = ("effect", "of", "", "indicator", "contribution", "at", "", "time", "")
"""Columns of the table of an audit."""
_BASIS = {
    "inertia_loads": "response to inertia",
    "node_loads": "response to loads at nodes",
    "truncation": "vibration of omitted modes",
}


@dataclass(frozen=True)
class EffectOutcome:
    """One effect of one body, or of the scene.

    ``share`` is its contribution to the worst sensor over the peak-to-peak of that, ``value`` the
    same in the scene's unit of it; None where there is no estimate, and ``why`` says what it needs:
    with ``shares`` where these are too rough to be one. With a share it says why that is rough.
    ``is_failure`` is an estimate that was tried and came to no end.
    ``cost`` is the time of one evaluation of the equations with the effect over that without, of
    deformation that of all evaluations of the run over those of the rigid one.
    """

    effect: str
    body: str
    on: bool
    indicator: str
    share: float | None
    value: str
    sensor: str
    cost: float | None
    verdict: str
    why: str = ""
    shares: dict[str, float] = field(default_factory=dict)  # of all sensors
    is_failure: bool = False


@dataclass(frozen=True)
class Audit:
    """The audit of a run: its effects, and sentences on where its answer is not valid."""

    title: str
    budget: float
    effects: tuple[EffectOutcome, ...]
    notes: tuple[str, ...]
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether no effect that is left out contributes more than the budget."""
        return not any(one.verdict == MISSING for one in self.effects)

    @property
    def missing(self) -> tuple[EffectOutcome, ...]:
        """Effects that are left out and contribute more than the budget."""
        return tuple(one for one in self.effects if one.verdict == MISSING)

    @property
    def wasted(self) -> tuple[EffectOutcome, ...]:
        """Effects that are on and contribute less than a tenth of the budget."""
        return tuple(one for one in self.effects if one.verdict == WASTED)

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Names of the columns, and a row for each effect."""
        return COLUMNS, [_row(one) for one in self.effects]

    def sentence(self) -> str:
        """The outcome in one line."""
        budget = f"the budget of {100 * self.budget:.3g} % of the peak-to-peak of every sensor"
        open_ = _listed([one for one in self.effects if one.verdict == UNKNOWN and not one.on])
        unknown = f"what {open_} would contribute is not known"
        if self.passed:
            return (
                f"{unknown + '; the rest' if open_ else 'what is left out'} stays within {budget}"
            )
        worst, *others = sorted(self.missing, key=lambda one: -(one.share or 0.0))
        share = f" and contributes {percent(worst.share)}: more than {budget}"
        if worst.share is None:
            share = f": {worst.indicator} of the deformation that the mesh has"
        also = f"so {'are' if others[1:] else 'is'} {_listed(others)}" if others else ""
        parts = f"{_listed([worst])} is left out{share}", also, unknown if open_ else ""
        return "; ".join(filter(None, parts))

    def text(self) -> str:
        """As JSON, for the result file."""
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> Audit:
        """From `text`."""
        data = json.loads(text)
        effects = tuple(EffectOutcome(**one) for one in data.pop("effects"))
        return cls(**{**data, "effects": effects, "notes": tuple(data["notes"])})


@dataclass
class EarlierAudits:
    """What was found of runs of one scene, each of which takes in more effects than the last.

    Attributes
    ----------
    rows : int
        Number of rows that the last run needed.
    last : dict
        By effect and body: the outcome of the last run that left the effect out, and the time of
        that run, as its evaluations take.
    """

    rows: int = 0
    last: dict[tuple[str, str], tuple[EffectOutcome, float]] = field(default_factory=dict)

    def add(self, outcomes: Iterable[EffectOutcome], of: Estimates) -> None:
        """Add what bodies of a run leave out."""
        off = [one for one in outcomes if one.body and not one.on]
        self.last.update({(one.effect, one.body): (one, of.run_time) for one in off})

    def outcome(self, effect: Effect, of: Estimates, budget: float) -> EffectOutcome | None:
        """An effect that a run has, as an earlier one told it that left it out; else None."""
        before, seconds = self.last.get((effect.name, effect.body), (None, 0.0))
        if before is None or not effect.on:
            return None
        verdict = NEEDED if before.share is None else _verdict(True, before.share, budget)
        cost = of.run_time / seconds if effect.name == DEFORMATION and seconds else before.cost
        why, words = before.why or _TOLD_BEFORE, effect.indicator
        return replace(before, on=True, indicator=words, verdict=verdict, cost=cost, why=why)


def _listed(effects: Sequence[EffectOutcome], most: int = 4) -> str:
    names = [f"{one.effect} of {one.body}" if one.body else one.effect for one in effects]
    more = f" and {len(names) - most} more" if names[most:] else ""
    return ", ".join(names[:most]) + more


def _row(one: EffectOutcome) -> tuple[str, ...]:
    return (
        one.effect, one.body, "on" if one.on else "off", one.indicator,
        percent(one.share), one.sensor, one.value,
        "" if one.cost is None else f"x {one.cost:.2f}",
        one.verdict if not one.why else f"{one.verdict}: {one.why}",
    )  # fmt: skip


def audit(
    result: Result | str | Path, *, budget: float | None = None, progress: Progress = silent
) -> Audit:
    """What each effect contributes to the sensors of a finished run; kept in its file as well.

    Parameters
    ----------
    result : Result or path
        The result, its file or its folder.
    budget : float, optional
        Largest share of the peak-to-peak of a sensor that left out effects may contribute; by
        default that of the scene, or 0.01.
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        The run is not finished, has no sensors, or did not store what is needed.
    """
    from flexmb.results import Result

    run = result if isinstance(result, Result) else Result(result)
    made = audit_until(run, budget, progress)
    assert made is not None
    return made


def _nothing(outcomes: Sequence[EffectOutcome]) -> bool:
    return False


def audit_until(
    run: Result, budget: float | None, progress: Progress,
    is_enough: Callable[[Sequence[EffectOutcome]], bool] = _nothing,
    comes_first: Callable[[Effect], bool] = lambda _: True, *,
    earlier: EarlierAudits | None = None,
) -> Audit | None:  # fmt: skip
    """The audit of a run; None if what is left out of its bodies is enough to know.

    Parameters
    ----------
    run : Result
        The run.
    budget, progress
        As for `audit`.
    is_enough : callable
        Takes what is known of effects that bodies leave out: called when those are known that come
        first, and when all are.
    comes_first : callable
        Whether an effect that a body leaves out is looked at before others.
    earlier : EarlierAudits, optional
        What was found of similar runs before, to which that of this one is added. Their effects are
        not estimated again where this run has them.
    """
    from flexmb.analysis.validity.validity_monitor import ValidityMonitor
    from flexmb.results.writer import store_text

    began = time.perf_counter()
    _check_run(run)
    earlier = EarlierAudits() if earlier is None else earlier
    neighbours = ModelVariants.of(run, _MAX_ROWS, progress, earlier.rows)
    earlier.rows = len(neighbours.motion.t)
    if budget is None:
        stated = neighbours.model.effects
        budget = BUDGET if stated is None else stated.budget
    estimates = Estimates(neighbours)
    todo = [*neighbours.effects(), *scene_effects(neighbours)]
    off = [k for k, one in enumerate(todo) if one.body and not one.on]
    early = [k for k in off if comes_first(todo[k])]
    later = [k for k in off if k not in early]
    outcomes: dict[int, EffectOutcome] = {}
    for some in (early, later, [k for k in range(len(todo)) if k not in off]):
        for k in some:
            progress("audit", len(outcomes) / len(todo), todo[k].name)
            taken_in = earlier.outcome(todo[k], estimates, budget)
            outcomes[k] = taken_in or _outcome(estimates, todo[k], budget)
        earlier.add(outcomes.values(), estimates)
        asks = later if some is early else some is later
        if asks and is_enough(tuple(outcomes.values())):
            return None
    effects = [outcomes[k] for k in range(len(todo))]
    progress("audit", 1.0)
    monitor = ValidityMonitor(neighbours.compiled, neighbours.model, neighbours.motion.q[0])
    monitor.add(neighbours.rows())
    effects += [*_membrane_forces(monitor, budget), *_basis(neighbours, monitor)]
    repeats = any(one.on and (one.name, one.body) in earlier.last for one in todo)
    notes = (*neighbours.notes, *monitor.notes(), *[_AGAIN] * repeats)
    made = Audit(run.title, budget, tuple(effects), notes, time.perf_counter() - began)
    store_text(run.path, TEXT, made.text())
    run.refresh()
    return made


def _check_run(run: Result) -> None:
    if run.status in ("running", "stopped"):
        raise ResultFileError(f"{run.path}: is {run.status}; finish it first: flexmb resume")
    if len(run.time) < 5:
        raise ResultFileError(f"{run.path}: holds {len(run.time)} rows; an audit needs 5 at least")
    if not run.layout.channels:
        body = run.layout.bodies[0].name
        raise SceneError(
            "the scene has no sensor to judge effects by; add one, such as\n"
            f'    [sensors.place]\n    type = "position"\n    of = "{body}"'
        )
    missing = [name for name in ("q", "v", "vd", "lam") if not run.has_columns(name)]
    if missing:
        raise ResultFileError(
            f"{run.path}: did not store {', '.join(missing)}; an audit needs the poses, "
            "velocities, accelerations and multipliers of all bodies: run without keep in [results]"
        )


def _outcome(estimates: Estimates, effect: Effect, budget: float) -> EffectOutcome:
    fixed = (effect.name, effect.body, effect.on, effect.indicator)
    if effect.why:
        return EffectOutcome(*fixed, None, "", "", None, UNKNOWN, effect.why)
    if effect.direct is not None:
        share, place = effect.direct
        return EffectOutcome(*fixed, share, "", place, None, _verdict(effect.on, share, budget))
    try:
        changes, cost = estimates.estimate(effect)
    except FlexmbError as error:
        why, verdict = str(error).splitlines()[0], NEEDED if effect.on else UNKNOWN
        return EffectOutcome(*fixed, None, "", "", None, verdict, why, is_failure=True)
    if not changes:
        return EffectOutcome(*fixed, 0.0, "", "", cost, WASTED if effect.on else SMALL)
    worst = max(changes, key=lambda one: (not one.by_symmetry, one.share))
    verdict = _verdict(effect.on, worst.share, budget)
    bounded = worst.unit and worst.share <= UNBOUNDED
    value = estimates.of.model.units.say(worst.value, worst.unit, 2) if bounded else ""
    shares = {one.sensor: one.share for one in changes}
    ringing = [one for one in changes if one.unresolved > _RINGING_SHARE * budget]
    doubt = _MODES_DOUBT if effect.name == MODES else _RINGING_DOUBT
    ringing = [one for one in ringing if doubt * one.share > budget]
    if verdict in (SMALL, WASTED) and ringing:
        names = ", ".join(one.sensor for one in ringing)
        why = f"{names} rings faster than the rows; {percent(worst.share)} as they see it"
        rough = NEEDED if effect.on else UNKNOWN
        return EffectOutcome(*fixed, None, "", "", cost, rough, why, shares)
    doubtful = [one.unsettled for one in changes if one.coarse > budget]
    if verdict in (SMALL, WASTED) and doubtful:
        rough = NEEDED if effect.on else UNKNOWN
        return EffectOutcome(*fixed, None, "", "", cost, rough, doubtful[0], shares)
    why = f"{_UNSETTLED}: {worst.unsettled}" if worst.unsettled and worst.share > budget else ""
    return EffectOutcome(*fixed, worst.share, value, worst.sensor, cost, verdict, why, shares)


def _verdict(on: bool, share: float, budget: float) -> str:
    if on:
        return NEEDED if share > _WASTED_SHARE * budget else WASTED
    return MISSING if share > budget else SMALL


def _membrane_forces(monitor: ValidityMonitor, budget: float) -> Iterator[EffectOutcome]:
    """What the membrane forces of plates and shells, which are left out, would contribute."""
    from flexmb.analysis.validity.membrane_forces import LARGEST_SENSOR_CHANGE

    for one in monitor.indicators():
        if one.quantity == "membrane_forces":
            seen = one.warning == LARGEST_SENSOR_CHANGE  # else the change of the deflection
            verdict = _verdict(False, one.value, budget if seen else one.warning)
            yield EffectOutcome(MEMBRANE, one.body, False, "", one.value, "", "", None, verdict)


def _basis(neighbours: ModelVariants, monitor: ValidityMonitor) -> Iterator[EffectOutcome]:
    """What the modes of each body lack of the full model, or that this is not known."""
    lacks = {(one.body, one.quantity): one for one in monitor.indicators()}
    for name, body in neighbours.compiled.flexbodies.items():
        has = {
            "inertia_loads": body.inertia_response is not None,
            "node_loads": body.load_response is not None,
            "truncation": body.omitted_modes is not None,
        }
        for quantity, effect in _BASIS.items():
            one = lacks.get((name, quantity))
            if one is None or not body.m:
                continue
            text, why, verdict = "", "", UNKNOWN
            if quantity == "truncation" and one.value <= one.warning and name in monitor.beyond:
                why = monitor.beyond[name].partition(": ")[2]
            elif has[quantity]:
                text = f"lacks {percent(one.value)}"
                verdict = _verdict(False, one.value, one.warning)
            elif quantity == "inertia_loads":
                why = "the body was not reduced from a mesh by this version"
            if text or why:
                yield EffectOutcome(effect, name, False, text, None, "", "", None, verdict, why)
