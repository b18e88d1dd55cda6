"""The error budget of a scene: the contribution of each knob to the error of each sensor.

In: a scene or a model. Out: a :class:`Budget`. The scene runs unchanged, then with one knob refined
at a time, once and twice; with the nodes of interfaces joined in the other way, on the mesh as it
is and on the finer one; and with all effects that it leaves out. If a share is smaller than the
target, cheaper settings are tried; finally the cheapest settings of all knobs run together. A
failure is reported and does not affect the other shares. Runs of an earlier call in the folder are
reused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError, SceneError
from flexmb.folders import writable_folder
from flexmb.model import Model
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.progress import Progress, silent
from flexmb.studies.budgets.budget_report import Budget, percent
from flexmb.studies.budgets.error_shares import (
    BOTH,
    CONSTRAINTS,
    CONVERGED,
    EFFECTS,
    INTEGRATION,
    INTERFACE,
    KINDS,
    MESH,
    NONE,
    NOT_CONVERGED,
    UNKNOWN,
    ChangedRuns,
    Estimate,
    Knob,
    Run,
    SensorErrors,
    Share,
    Shares,
    complete_effects,
    estimate_error,
    refinement_knobs,
)  # fmt: skip
from flexmb.studies.channel_errors import RunHistories, check_sensors
from flexmb.studies.record_table import lock_runs
from flexmb.studies.study_jobs import content_key
from flexmb.studies.study_settings import StudySource, change_model, label
from flexmb.workflow.cluster import open_cluster

_MAX_DOFS = 150_000  # degrees of freedom of a refined mesh; a larger one takes minutes to reduce
_MAX_FIRST = 2  # number of coarser settings that are tried at the same time
_ROUND_OFF_DRIFT = 1e-9  # m or rad


def budget(
    scene: str | Path | Model,
    *,
    overrides: Mapping[str, Any] | None = None,
    knobs: Sequence[str] = (),
    target: float = 0.01,
    sensors: Sequence[str] = (),
    output: str | Path | None = None,
    workers: int = 2,
    scheduler: str = "",
    limit: float = 0.0,
    fresh: bool = False,
    progress: Progress = silent,
) -> Budget:
    """Split the error of each sensor into mesh, modes, interface model, integration and effects.

    Parameters
    ----------
    scene : path or Model
        A scene file, or a model made in Python.
    overrides : mapping, optional
        Values of a scene file to change first.
    knobs : sequence of str
        Only these shares: mesh, modes, interface model, integration, constraints, effects.
    target : float
        Error over the peak-to-peak that each share is to meet; the cheapest settings refer to it.
    sensors : sequence of str
        Only these sensors or channels.
    output : path, optional
        Folder of all files; ``out/<scene>/budget`` by default.
    workers : int
        Runs at the same time.
    scheduler : str
        Address of a Dask scheduler whose workers are used instead.
    limit : float
        Wall time of one integration [s], after which it is given up; 0: none.
    fresh : bool
        Repeat runs that exist already.
    progress : Progress
        Called for every phase.

    Raises
    ------
    SceneError
        No sensor to judge by, unknown names, a target that is no share; all that is wrong with the
        scene.
    FlexmbError
        The scene itself does not run.
    """
    if not 0.0 < target < 1.0:
        raise SceneError(f"target: is an error over the peak-to-peak, between 0 and 1; is {target}")
    for knob in knobs:
        if knob not in KINDS:
            raise SceneError.unknown_name("knob", knob, KINDS)
    source = StudySource.of(scene, overrides, output, "budget")
    folder = source.output
    model = change_model(source, {})[0]
    if model.dynamics is None:
        raise SceneError("the scene has no [dynamics]: give its duration")
    names = (*model.sensors, *model.states, *model.controllers, *model.channels())
    for name in sensors:
        if name not in names:
            raise SceneError.unknown_name("sensor", name, names)
    check_sensors(model, sensors)
    sizes = _mesh_sizes(model)
    with (
        lock_runs(writable_folder(folder) / "budget.json"),
        open_cluster(workers, scheduler, limit=limit) as cluster,
    ):
        runs = ChangedRuns(source, folder, cluster, sensors, fresh, progress)
        return _Split(source, model, runs, knobs, target, sizes).budget()


def _mesh_sizes(model: Model) -> dict[str, tuple[int, int]]:
    """Degrees of freedom and dimension of the mesh of each body.

    Raises
    ------
    FlexmbError
        All that is wrong with the meshes.
    """
    from flexmb.fe.meshes.mesh import dimension
    from flexmb.workflow.flexible_bodies import survey_bodies

    if not any(isinstance(spec, MeshBodySpec) for spec in model.bodies.values()):
        return {}
    surveys, problems = survey_bodies(model)
    if problems:
        raise SceneError.from_problems(problems)
    return {
        name: (survey.dofs, max((dimension(kind) for kind in survey.elements), default=3))
        for name, survey in surveys.items()
    }


class _Split:
    """A budget during its runs."""

    def __init__(
        self, source: StudySource, model: Model, runs: ChangedRuns, kinds: Sequence[str],
        target: float, sizes: Mapping[str, tuple[int, int]],
    ) -> None:  # fmt: skip
        self.source, self.model, self.runs, self.target = source, model, runs, target
        self.sizes = sizes
        dynamics = model.to_scene_dict(source.folder)["dynamics"]
        knobs = [self._fit(knob) for knob in refinement_knobs(model, dynamics)]
        self.knobs = [knob for knob in knobs if not kinds or knob.kind in kinds]
        self.kinds = kinds
        self.effects = complete_effects(model) if not kinds or EFFECTS in kinds else {}
        self.notes: list[str] = []
        self.finest: list[RunHistories] = []  # histories with the finest refinement of each knob
        self.estimates: dict[str, Estimate] = {}

    def _fit(self, knob: Knob) -> Knob:
        """The knob without mesh refinements that would have too many degrees of freedom."""
        if knob.kind != MESH or knob.body not in self.sizes:
            return knob
        dofs, dim = self.sizes[knob.body]
        fine = [dofs * 2.0 ** (dim * k) for k in (1, 2)]
        steps = tuple(s for s, n in zip(knob.steps, fine, strict=True) if n <= _MAX_DOFS)
        if steps:
            return replace(knob, steps=steps)
        what = f"refined once it would have {fine[0]:.2g} degrees of freedom, more than {_MAX_DOFS}"
        return Knob(MESH, knob.body, why=f"{what}: vary it in a study")

    def budget(self) -> Budget:
        """Do all runs and estimate the shares."""
        self.runs.do("scene", [{}])
        base = self.runs[{}]
        if base.reading is None:
            what = "the run of the scene itself fails, so there is no error to split: "
            raise FlexmbError(what + base.reason)
        if not any(scale > 0.0 for scale in base.reading.scales):
            what = "no sensor and no reaction of the scene changes, so there is no error to split"
            raise FlexmbError(f"{what}: give it a load, a motion or other sensors")
        self.base, self.runs.bodies = base, base.folder
        self.errors = SensorErrors(base.reading)
        refined = [step for knob in self.knobs for step in knob.steps[:2]]
        refined += [{**knob.steps[0], **self._finer(knob)} for knob in self._interfaces()]
        effects = [self.effects] if self.effects else []
        self.runs.do("refine", [*refined, *effects], base.folder if effects else "")
        shares = [self._share(knob) for knob in self._ordered()]
        if not self.kinds or EFFECTS in self.kinds:
            shares.append(self._effects())
        self._try_coarser(shares)
        shares = [self._cheapest(share) for share in shares]
        order = {kind: k for k, kind in enumerate(KINDS)}
        shares.sort(key=lambda share: order[share.kind])
        return Budget(
            title=self.model.title or self.source.file, source=self.source.file,
            folder=self.runs.folder, target=self.target, shares=tuple(shares),
            sensors=tuple(dict.fromkeys(self.errors.names)), notes=tuple(self.notes),
            cpu=base.cpu, **self._together(shares),
        )  # fmt: skip

    def _interfaces(self) -> list[Knob]:
        return [k for k in self.knobs if k.kind == INTERFACE and k.steps and self._finer(k)]

    def _finer(self, knob: Knob) -> dict[str, Any]:
        """The first refinement of the mesh of the same body."""
        meshes = (k for k in self.knobs if k.kind == MESH and k.body == knob.body and k.steps)
        mesh = next(meshes, None)
        return {} if mesh is None else dict(mesh.steps[0])

    def _ordered(self) -> list[Knob]:
        """The knobs, the integration first: differences below its error belong to it."""
        return sorted(self.knobs, key=lambda knob: knob.kind != INTEGRATION)

    def _noise(self) -> Shares:
        estimate = self.estimates.get(INTEGRATION)
        return {} if estimate is None else estimate.values[0]

    def _share(self, knob: Knob) -> Share:
        if knob.kind == CONSTRAINTS:
            return self._constraints()
        if knob.why:
            return Share(knob.name, knob.kind, {}, UNKNOWN, note=knob.why)
        if knob.kind == INTERFACE:
            return self._interface(knob)
        runs, tried, note = [], [label(knob.base)] if knob.base else [], ""
        estimate = None
        for k, step in enumerate(knob.steps):
            if k > 1:  # only where it does not fall yet
                if estimate is None or estimate.state != NOT_CONVERGED:
                    break
                self.runs.do("refine", [step])
            run = self.runs[step]
            if run.reading is None:
                note = f"{label(step)} fails: {run.reason}"
                break
            runs.append(run.reading)
            tried.append(label(step))
            estimate = estimate_error(self.errors, runs, self._noise())
        if estimate is None:
            return Share(knob.name, knob.kind, {}, UNKNOWN, tried=tuple(tried), note=note)
        self.estimates[knob.name] = estimate
        self.finest.append(runs[-1])
        cost = self.runs[knob.steps[0]].cpu / max(self.base.cpu, 1e-9)
        return Share(knob.name, knob.kind, estimate.values[0], estimate.state, estimate.ratio,
                     tuple(tried), note, cost, estimate.rising)  # fmt: skip

    def _constraints(self) -> Share:
        drift = float(self.base.statistics.get("largest_position_drift", 0.0))
        knob = next((k for k in self.knobs if k.kind == INTEGRATION), None)
        finer = self.runs[knob.steps[0]] if knob is not None else Run(None)
        second = float(finer.statistics.get("largest_position_drift", drift))
        falls = drift <= _ROUND_OFF_DRIFT or second < drift
        note = f"drift {drift:.2g} m or rad"
        note += f", {second:.2g} with finer integration" if finer.reading is not None else ""
        ratio = drift / second if second > 0.0 and drift > _ROUND_OFF_DRIFT else None
        state = CONVERGED if falls else NOT_CONVERGED
        return Share(CONSTRAINTS, CONSTRAINTS, self.errors.of_drift(drift), state, ratio, note=note)

    def _interface(self, knob: Knob) -> Share:
        """The share of the interface model; RBE2 is too stiff, RBE3 too soft: their difference
        bounds it."""
        assert self.base.reading is not None
        joined = " and ".join(sorted({words["type"] for words in knob.steps[0].values()}))
        run = self.runs[knob.steps[0]]
        if run.reading is None:
            note = f"as {joined} it fails: {run.reason}"
            return Share(knob.name, INTERFACE, {}, UNKNOWN, note=note)
        values = self.errors.between(self.base.reading, run.reading)
        cost = run.cpu / max(self.base.cpu, 1e-9)
        note, finer = f"all interfaces as {joined}", self._finer(knob)
        if finer:
            one, other = self.runs[finer], self.runs[{**knob.steps[0], **finer}]
            if one.reading is not None and other.reading is not None:
                again = self.errors.between(one.reading, other.reading)
                worst = max(values, key=lambda key: values[key])
                note += f"; on the refined mesh {percent(again[worst])} at {worst}"
                values = {key: max(value, again[key]) for key, value in values.items()}
            else:
                note += f"; not confirmed on the refined mesh: {one.reason or other.reason}"
        note += "; the true seat lies between both"
        return Share(knob.name, INTERFACE, values, BOTH, None, (), note, cost)

    def _effects(self) -> Share:
        """The share of omitted effects: the audit's estimate, and a run with all effects."""
        if not self.effects:
            return Share(EFFECTS, EFFECTS, {}, NONE)
        words, run = label(self.effects), self.runs[self.effects]
        record = self.runs.audit
        estimate, note = record.get("shares", {}), ""
        if record.get("reason"):
            note = f"; no audit: {str(record['reason']).splitlines()[0]}"
        if run.reading is None:
            state = "estimated by the audit alone" if estimate else UNKNOWN
            note = f"with {words} the scene fails: {run.reason}" + note
            return Share(EFFECTS, EFFECTS, estimate, state, tried=(words,), note=note)
        assert self.base.reading is not None
        values = self.errors.between(self.base.reading, run.reading)
        worst = max(estimate.keys() & values.keys(), key=lambda key: values[key], default="")
        if worst:
            note = f"at {worst} {percent(values[worst])}, by the audit {percent(estimate[worst])}"
        cost = run.cpu / max(self.base.cpu, 1e-9)
        return Share(EFFECTS, EFFECTS, values, "run with them", None, (words,), note, cost)

    def _try_coarser(self, shares: Sequence[Share]) -> None:
        """Run cheaper settings for shares below the target."""
        room = {share.name for share in shares if share.worst[0] <= 0.5 * self.target}
        steps = [k.coarser for k in self.knobs if k.name in room and k.coarser]
        self.runs.do("cheaper", [step for one in steps for step in one[:_MAX_FIRST]])
        more = [one for one in steps if self._meets_coarser(one[:_MAX_FIRST], shares)]
        self.runs.do("cheaper", [step for one in more for step in one[_MAX_FIRST:]])

    def _meets_coarser(self, steps: Sequence[Mapping[str, Any]], shares: Sequence[Share]) -> bool:
        return all(self._coarse_error(step, {}) <= self.target for step in steps)

    def _coarse_error(self, step: Mapping[str, Any], own: Shares) -> float:
        """Upper bound of the error of a coarser setting: its difference from the base, plus the
        base's error."""
        run = self.runs.ended.get(content_key(step))
        if run is None or run.reading is None or self.base.reading is None:
            return math.inf
        apart = self.errors.between(run.reading, self.base.reading)
        return max((value + own.get(key, 0.0) for key, value in apart.items()), default=0.0)

    def _cheapest(self, share: Share) -> Share:
        """The share, with the cheapest setting of its knob that meets the target."""
        worst, _ = share.worst
        if share.kind in (INTERFACE, CONSTRAINTS) or share.state in (UNKNOWN, NONE):
            return replace(share, met=None if not share.values else worst <= self.target)
        if share.kind == EFFECTS:
            met = worst <= self.target
            return replace(share, met=True, cheapest={} if met else dict(self.effects))
        knob = next(one for one in self.knobs if one.name == share.name)
        if worst <= self.target:
            best: dict[str, Any] = {}
            for step in knob.coarser:
                if self._coarse_error(step, share.values) > self.target:
                    break
                best = dict(step)
            return replace(share, met=True, cheapest=best)
        estimate = self.estimates[share.name]
        for step, values in zip(knob.steps, estimate.values[1:], strict=False):
            if estimate.state != NOT_CONVERGED and max(values.values()) <= self.target:
                return replace(share, met=True, cheapest=dict(step))
        rest = max(estimate.values[-1].values(), default=math.inf)
        note = share.note
        if estimate.state != NOT_CONVERGED and estimate.ratio and math.isfinite(rest):
            more = math.ceil(math.log(rest / self.target) / math.log(estimate.ratio))
            note = "; ".join(filter(None, (note, f"{more} more refinements would meet it")))
        return replace(share, met=False, note=note)

    def _together(self, shares: Sequence[Share]) -> dict[str, Any]:
        """Run the cheapest settings of all knobs together, against all refinements together."""
        changes = {key: value for share in shares for key, value in share.cheapest.items()}
        if not changes or any(s.met is False and s.kind != INTERFACE for s in shares):
            return {"changes": changes}
        self.runs.do("together", [changes])
        run = self.runs[changes]
        if run.reading is None:
            return {"changes": changes, "together": (f"fails: {run.reason}", 0.0)}
        finest = list(self.finest)
        effects = self.runs.ended.get(content_key(self.effects)) if self.effects else None
        if effects is not None and effects.reading is not None:
            finest.append(effects.reading)
        apart = self.errors.between(run.reading, self.errors.combined(finest))
        worst = max(apart, key=lambda key: apart[key])
        return {"changes": changes, "together": (f"{percent(apart[worst])} at {worst}", run.cpu)}
