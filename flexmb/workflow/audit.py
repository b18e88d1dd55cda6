"""The audit: what each effect contributes to the sensors of a run, whether it is on or left out.

In: a result. Out: a table of effects, each by a computation along the motion of the run: the same
scene with the effect on instead of off, or off instead of on, is linearised about that motion and
driven by what the motion leaves out of balance in it (`flexmb.analysis.effects`). Deformation is
judged from a rigid run of the scene, further modes from a finer reduction of the mesh. Of contacts
and stops that are left out, what they would have met along the computed motion is measured in the
scene that has them: how far coordinates travel beyond a stop, and with what force bodies that
overlap would be pushed apart.
"""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbError, ResultFileError, SceneError
from flexmb.flexbody.arrays import Array
from flexmb.model.forces.contact import ContactSpec
from flexmb.model.forces.force_characteristic import AnyStop, JointStopSpec
from flexmb.model.plane import plane_axes
from flexmb.model.scenes.effects import EffectsSpec, active_model
from flexmb.progress import Progress, silent
from flexmb.workflow.effect import FRICTION, GRAVITY, OUT_OF_PLANE, Effect, percent
from flexmb.workflow.effect_estimates import Estimates
from flexmb.workflow.neighbours import ModelVariants

if TYPE_CHECKING:
    from flexmb.analysis.dynamics.validity import ValidityMonitor
    from flexmb.model import Model
    from flexmb.results import Result


TEXT = "audit"
"""Name of the text in a result that holds its audit."""
BUDGET = 0.01
"""Largest share of the peak-to-peak of a sensor that left out effects may contribute."""
_WASTED_SHARE = 0.1  # of the budget: an effect that contributes less does not pay for its time
_RINGING_SHARE = 1 / 3  # of the budget: vibration of a sensor that the rows do not resolve
_RINGING_DOUBT = 100.0  # factor by which the share of such a sensor may be too small
_UNSETTLED = "much, not how much: contacts, stops or friction act at other times with it"
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
_MEASURE = "audited_"
_STANDSTILL = 1e-6  # of the size of the model


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
    made = audit_until(run, budget, progress, lambda _: False)
    assert made is not None
    return made


def audit_until(
    run: Result, budget: float | None, progress: Progress,
    is_enough: Callable[[Sequence[EffectOutcome]], bool],
) -> Audit | None:  # fmt: skip
    """The audit of a run; None if what is left out of its bodies is enough to know.

    Parameters
    ----------
    run : Result
        The run.
    budget, progress
        As for `audit`.
    is_enough : callable
        Takes what bodies leave out, which is looked at first.
    """
    from flexmb.analysis.dynamics.validity import ValidityMonitor
    from flexmb.results.writer import store_text

    began = time.perf_counter()
    _check_run(run)
    neighbours = ModelVariants.of(run, _MAX_ROWS, progress)
    if budget is None:
        stated = neighbours.model.effects
        budget = BUDGET if stated is None else stated.budget
    estimates = Estimates(neighbours)
    todo = [*neighbours.effects(), *scene_effects(neighbours)]
    order = sorted(range(len(todo)), key=lambda k: todo[k].on or not todo[k].body)
    first = sum(bool(one.body) and not one.on for one in todo)
    outcomes: dict[int, EffectOutcome] = {}
    for n, k in enumerate(order):
        if n == first and is_enough(tuple(outcomes.values())):
            return None
        progress("audit", n / len(todo), todo[k].name)
        outcomes[k] = _outcome(estimates, todo[k], budget)
    if first == len(todo) and is_enough(tuple(outcomes.values())):
        return None
    effects = [outcomes[k] for k in range(len(todo))]
    progress("audit", 1.0)
    monitor = ValidityMonitor(neighbours.compiled, neighbours.model, neighbours.motion.q[0])
    monitor.add(neighbours.rows())
    effects += [*_membrane_forces(monitor, budget), *_basis(neighbours, monitor)]
    notes = (*neighbours.notes, *monitor.notes())
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
    value = estimates.of.model.units.say(worst.value, worst.unit, 2) if worst.unit else ""
    shares = {one.sensor: one.share for one in changes}
    ringing = [one for one in changes if one.unresolved > _RINGING_SHARE * budget]
    ringing = [one for one in ringing if _RINGING_DOUBT * one.share > budget]
    if verdict in (SMALL, WASTED) and ringing:
        names = ", ".join(one.sensor for one in ringing)
        why = f"{names} rings faster than the rows; {percent(worst.share)} as they see it"
        rough = NEEDED if effect.on else UNKNOWN
        return EffectOutcome(*fixed, None, "", "", cost, rough, why, shares)
    why = _UNSETTLED if worst.unsettled and worst.share > budget else ""
    return EffectOutcome(*fixed, worst.share, value, worst.sensor, cost, verdict, why, shares)


def _verdict(on: bool, share: float, budget: float) -> str:
    if on:
        return NEEDED if share > _WASTED_SHARE * budget else WASTED
    return MISSING if share > budget else SMALL


def _membrane_forces(monitor: ValidityMonitor, budget: float) -> Iterator[EffectOutcome]:
    """What the membrane forces of plates and shells, which are left out, would contribute."""
    from flexmb.analysis.dynamics.omitted_membrane_stiffness import LARGEST_SENSOR_CHANGE

    for one in monitor.indicators():
        if one.quantity == "membrane_forces":
            seen = one.warning == LARGEST_SENSOR_CHANGE  # else the change of the deflection
            verdict = _verdict(False, one.value, budget if seen else one.warning)
            yield EffectOutcome(
                "membrane forces", one.body, False, "", one.value, "", "", None, verdict
            )


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


def scene_effects(of: ModelVariants) -> Iterator[Effect]:
    """The effects of the scene, on or left out."""
    model, stated = of.model, of.model.effects or EffectsSpec()
    if any(model.gravity or ()):
        yield Effect(GRAVITY, "", stated.gravity, "", {"gravity": not stated.gravity})
    kinds = [(getattr(s, "type", ""), getattr(s, "friction", None)) for s in model.forces.values()]
    if any(kind == "joint-friction" or friction for kind, friction in kinds):
        yield Effect(FRICTION, "", stated.friction, "", {"friction": not stated.friction})
    for word, kind in (("contact", ContactSpec), ("stops", AnyStop)):
        specs = {name: s for name, s in model.forces.items() if isinstance(s, kind)}
        if specs:
            on, why, met = getattr(stated, word), "", None
            try:
                indicator, share, name = _largest(of, specs)
                met = (share, f"forces.{name}") if not on else None
            except FlexmbError as error:
                indicator, why = "", str(error).splitlines()[0]
            yield Effect(word, "", on, indicator, {word: not on}, why, met)
    if model.plane is not None and stated.planar:
        yield Effect(OUT_OF_PLANE, "", False, f"plane {model.plane}", {"planar": False})
    elif model.plane is not None:
        yield Effect(OUT_OF_PLANE, "", True, f"plane {model.plane}", direct=_off_plane(of))


def _off_plane(of: ModelVariants) -> tuple[float, str]:
    """How far bodies of a run in space leave the plane over the largest travel, or tilt [rad]."""
    from scipy.spatial.transform import Rotation  # takes 0.2 s

    normal, q, bodies = plane_axes(of.model.plane or "")[2], of.motion.q, of.compiled.layout.bodies
    travel = max(float(np.ptp(q[:, one.iq : one.iq + 3], axis=0).max()) for one in bodies)
    travel = max(travel, _STANDSTILL / of.compiled.system.weights.max())
    worst = 0.0, ""
    for body in bodies:
        e = np.roll(q[:, body.iq + 3 : body.iq + 7], -1, axis=1)
        axes = Rotation.from_quat(e).as_matrix()[:, normal]  # the normal in body axes
        tilt = float(np.linalg.norm(axes - axes[0], axis=1).max())
        share = max(tilt, float(np.ptp(q[:, body.iq + normal])) / travel)
        worst = max(worst, (share, f"bodies.{body.name}"))
    return worst


def _largest(of: ModelVariants, specs: Mapping[str, Any]) -> tuple[str, float, str]:
    """The contact or stop that is met most: in words, its share of the motion, its name.

    That is how far a coordinate travels beyond its stop, or bodies overlap, over the largest
    peak-to-peak of the coordinate or of the places of bodies.
    """
    measures = _measured(of, specs)
    places = [columns.iq for columns in of.compiled.layout.bodies]
    travel = max(float(np.ptp(of.motion.q[:, k : k + 3], axis=0).max()) for k in places)
    text, largest, worst = "never met", 0.0, ""
    for name, spec in specs.items():
        value = measures[name]
        if isinstance(spec, ContactSpec):
            force = float(np.linalg.norm(value, axis=1).max())
            beyond = (force / spec.stiffness) ** (1.0 / spec.exponent) if spec.stiffness else 0.0
            size, words = travel, f"{name} pushes with {of.model.units.say(force, 'N', 2)}"
            beyond = beyond if spec.stiffness or not force else travel
        else:
            low = -np.inf if spec.lower is None else spec.lower
            high = np.inf if spec.upper is None else spec.upper
            beyond = float(np.maximum(value[:, 0] - high, low - value[:, 0]).max().clip(0.0))
            turns = isinstance(spec, JointStopSpec) and "angle" in spec.coordinate
            size = float(np.ptp(value[:, 0]))
            words = f"{name} passed by {of.model.units.say(beyond, 'rad' if turns else 'm', 2)}"
        share = beyond / size if size > 0.0 else float(beyond > 0.0)
        if share > largest:
            text, largest, worst = words, share, name
    return text, largest, worst


def _measured(of: ModelVariants, specs: Mapping[str, Any]) -> dict[str, Array]:
    """(t, k) by name the coordinate of a stop, or the force of a contact, along the motion."""
    from flexmb.analysis.effects.stored_motion import carry_motion, equations_of
    from flexmb.engine.compile import compile_system

    model = copy.copy(of.model)
    stated = of.model.effects or EffectsSpec()
    model.effects = stated.model_copy(update={"contact": True, "stops": True})
    model = active_model(model)
    model.sensors = dict(model.sensors)
    for name, spec in specs.items():
        _add_measure(model, name, spec)
    other = compile_system(model, of.bodies)
    motion = of.motion
    wide = np.zeros((len(motion.t), len(other.layout.channels)))
    columns = {channel: k for k, channel in enumerate(other.layout.channels)}
    for k, channel in enumerate(of.compiled.layout.channels):
        wide[:, columns[channel]] = motion.channels[:, k]
    carried, _ = carry_motion(motion, of.compiled, other, {})
    still = np.zeros_like(carried.v)  # what is met by place alone, without damping and friction
    carried = replace(carried, channels=wide, v=still, vd=still)
    equations = equations_of(other)
    mine = {
        name: [k for channel, k in columns.items() if channel.split(".")[0] == _MEASURE + name]
        for name in specs
    }
    rows, measured = np.zeros((len(motion.t), len(columns))), sum(mine.values(), [])
    for k in range(len(motion.t)):
        wide[k, measured] = rows[k - 1, measured] if k else 0.0
        carried.put(k, equations)
        rows[k] = equations.channels()
    return {name: rows[:, places] for name, places in mine.items()}


def _add_measure(model: Model, name: str, spec: Any) -> None:
    """A sensor of what a contact or stop does."""
    if isinstance(spec, ContactSpec):
        model.add_sensor(_MEASURE + name, "reaction", force=name, axes="global")
    elif isinstance(spec, JointStopSpec):
        model.add_sensor(_MEASURE + name, spec.coordinate, joint=spec.joint)
    elif spec.axis is None:
        model.add_sensor(_MEASURE + name, "distance", between=spec.between)
    else:
        model.add_sensor(_MEASURE + name, "stroke", between=spec.between, axis=spec.axis)
