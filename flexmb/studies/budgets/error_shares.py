"""The contribution of each knob of a scene to the error of its sensors, from refined runs.

In: changes of a scene, each run once and stored; histories of a run, of one with a knob refined
once and of one with it refined twice. Out: an estimate of the error due to the knob, by sensor,
over the peak-to-peak. If the differences decrease by a factor r from one refinement to the next,
the error after the second is d₂/(r - 1) (Richardson 1911; Roache, Verification and Validation,
1998); if they do not decrease the share is not converged.
"""

from __future__ import annotations

import itertools
import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.folders import read_json, read_regular, whole_file, writable_folder
from flexmb.model import Model
from flexmb.model.flexible_body import FlexibleBodySpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.reading import Spec
from flexmb.model.scenes.dynamics import ACCURACY, ROUND_OFF
from flexmb.model.scenes.effects import SWITCHES
from flexmb.progress import Progress
from flexmb.studies.channel_errors import RunHistories, read_run, read_statistics
from flexmb.studies.study_jobs import content_key, result_file, run_key
from flexmb.studies.study_settings import StudySource, change_model
from flexmb.workflow.cluster import Cluster
from flexmb.workflow.worker_processes import Record, RunTimer

MESH, MODES, INTERFACE, INTEGRATION, CONSTRAINTS, EFFECTS = KINDS = (
    "mesh", "modes", "interface model", "integration", "constraints", "effects",
)  # fmt: skip
CONVERGED, NOT_CONVERGED, ONE, NOISE, BOTH, UNKNOWN, NONE = (
    "converged", "not converged", "refined once", "within the error of the integration", "range",
    "not known", "none left out",
)  # fmt: skip
_MIN_RATIO = 1.5  # smallest ratio of consecutive differences that counts as convergence
_NOISY = 2.0  # differences smaller than this multiple of the integration error are noise
_ONE_RATIO = 2.0  # ratio assumed for a knob that could be refined only once
_LOOSEST = 0.1  # largest accuracy value that is tried
Shares = dict[str, float]


_FLOOR = 1e-11  # differences below this are round-off and need not decrease
_RECORD = "budget_run.json"
_AUDIT = "audit"


@dataclass(frozen=True)
class Knob:
    """Something that can be refined, with the changes for one and two refinements and for coarser
    ones."""

    kind: str
    body: str = ""
    steps: tuple[dict[str, Any], ...] = ()
    coarser: tuple[dict[str, Any], ...] = ()
    base: dict[str, Any] = field(default_factory=dict)  # changes that state the present value
    why: str = ""  # reason if there is nothing to refine

    @property
    def name(self) -> str:
        """``mesh of rod``."""
        return f"{self.kind} of {self.body}" if self.body else self.kind


@dataclass(frozen=True)
class Share:
    """The contribution of a knob to the error of the sensors.

    ``values`` are over the peak-to-peak of each sensor, empty if nothing is known; ``ratio`` is the
    first difference over the second; ``tried`` are the settings, starting with the scene's own;
    ``cheapest`` is the setting for the target, and ``met`` whether it meets it.
    """

    name: str
    kind: str
    values: Shares
    state: str
    ratio: float | None = None
    tried: tuple[str, ...] = ()
    note: str = ""
    cost: float | None = None
    rising: tuple[str, ...] = ()  # sensors for which the value is a lower bound
    cheapest: dict[str, Any] = field(default_factory=dict)
    met: bool | None = None

    @property
    def worst(self) -> tuple[float, str]:
        """The largest value and its sensor."""
        name = max(self.values, key=lambda key: self.values[key], default="")
        return self.values.get(name, math.nan), name


def refinement_knobs(model: Model, dynamics: Mapping[str, Any]) -> list[Knob]:
    """The knobs of a model: those of its flexible bodies, then integration and constraints.

    Parameters
    ----------
    model : Model
        The scene.
    dynamics : mapping
        Its ``[dynamics]`` with all numbers resolved, in the scene's units.
    """
    knobs: list[Knob] = []
    for name, spec in model.bodies.items():
        if isinstance(spec, FlexibleBodySpec) and spec.deformation != "rigid":
            if isinstance(spec, MeshBodySpec):
                knobs += [_mesh(name, spec), _modes(name, spec), _interface(name, spec)]
            else:
                why = "not known from a body file: give its mesh"
                knobs += [Knob(kind, name, why=why) for kind in (MESH, MODES, INTERFACE)]
    knobs.append(_integration(dynamics))
    return [*knobs, Knob(CONSTRAINTS)]


def _mesh(name: str, spec: MeshBodySpec) -> Knob:
    key = f"bodies.{name}.refine"
    coarser = tuple({key: k} for k in range(spec.refine - 1, -1, -1))
    divisions = getattr(spec.mesh, "divisions", None)
    if divisions is not None and not coarser:
        coarser = tuple(_coarser_divisions(f"bodies.{name}.mesh.divisions", divisions))
    steps = tuple({key: spec.refine + k} for k in (1, 2))
    return Knob(MESH, name, steps, coarser, {key: spec.refine})


def _coarser_divisions(key: str, divisions: Any) -> list[dict[str, Any]]:
    """Changes to half and a quarter of the divisions, if these are whole numbers."""
    listed = list(divisions) if isinstance(divisions, tuple) else [int(divisions)]
    coarser: list[dict[str, Any]] = []
    for factor in (2, 4):
        if any(n % factor and n > 1 for n in listed) or max(listed) <= factor:
            break
        halves = [max(n // factor, 1) for n in listed]
        coarser.append({key: halves if isinstance(divisions, tuple) else halves[0]})
    return coarser


def _modes(name: str, spec: MeshBodySpec) -> Knob:
    key, modes = f"bodies.{name}.modes", spec.modes
    if spec.reduction == "user":
        return Knob(MODES, name, why="modes of your own have no next ones: add some to the file")
    static = spec.reduction == "guyan"
    if isinstance(modes, Spec):
        words = modes.model_dump(exclude_none=True)
        ((word, value),) = words.items()
        if word == "effective_mass":
            return Knob(
                MODES, name, tuple({key: {word: 1 - (1 - value) / n}} for n in (4, 16)),
                base={key: words},
            )  # fmt: skip
        steps = tuple({key: {word: n * value}} for n in (2, 4))
        return Knob(MODES, name, steps, tuple({key: {word: value // n}} for n in (2, 4)),
                    {key: words})  # fmt: skip
    count = 0 if static else 20 if modes is None else int(modes)
    method = {f"bodies.{name}.reduction": "craig-bampton"} if static else {}
    first = max(2 * count, count + 4)
    fewer = dict.fromkeys(n for n in (count // 2, count // 4, 0) if n < count)
    return Knob(
        MODES, name, tuple({**method, key: n} for n in (first, 2 * first)),
        tuple({key: n} for n in fewer), {key: count},
    )  # fmt: skip


def _interface(name: str, spec: MeshBodySpec) -> Knob:
    """The knob that joins the nodes of all interfaces in the other way (rbe2 or rbe3)."""
    swapped: dict[str, Any] = {}
    for marker, nodes in spec.interfaces.items():
        words = {"group": nodes} if isinstance(nodes, str) else nodes.model_dump(exclude_none=True)
        if "node" in words or len(words.get("nodes", (0, 1))) < 2:
            continue
        old = words.pop("type", "rbe2")
        words.pop("weights", None)
        words |= {"type": "rbe3" if old == "rbe2" else "rbe2"}
        swapped[f"bodies.{name}.interfaces.{marker}"] = words
    why = "" if swapped else "its interfaces have one node each"
    return Knob(INTERFACE, name, (swapped,) if swapped else (), why=why)


def _integration(dynamics: Mapping[str, Any]) -> Knob:
    step = dynamics.get("step")
    finer: tuple[float, ...]
    ladder: tuple[float, ...]
    if step is not None:
        key, finer = "dynamics.step", (step / 2, step / 4, step / 8)
        ladder = (2 * step, 4 * step, 8 * step)
    else:
        key, own = "dynamics.accuracy", float(dynamics.get("accuracy") or ACCURACY)
        finer = tuple(max(own / n, 10 * ROUND_OFF) for n in (10, 100, 1000))
        ladder = tuple(x for x in (10 * own, 100 * own, 1000 * own) if x <= _LOOSEST)
        step = own
    return Knob(
        INTEGRATION, "", tuple({key: float(f"{x:.12g}")} for x in finer),
        tuple({key: float(f"{x:.12g}")} for x in ladder), {key: step},
    )  # fmt: skip


def complete_effects(model: Model) -> dict[str, Any]:
    """Changes by which a scene has all effects."""
    changes: dict[str, Any] = {}
    for name, spec in model.bodies.items():
        if not isinstance(spec, FlexibleBodySpec):
            continue
        whole = {"deformation": "dynamic", "inertia_coupling": "full"}
        if isinstance(spec, MeshBodySpec) and spec.interfaces:
            whole["geometric_stiffening"] = "full"
        changes |= {
            f"bodies.{name}.{word}": value
            for word, value in whole.items()
            if getattr(spec, word) != value
        }
    if model.effects is not None:
        off = [word for word in SWITCHES if word != "planar" and not getattr(model.effects, word)]
        changes |= {f"effects.{word}": True for word in off}
    return changes


class SensorErrors:
    """Differences of runs over the peak-to-peak of a base run, by sensor; reactions as one
    quantity."""

    def __init__(self, base: RunHistories) -> None:
        self.base = base
        positions = {one.name for one in base.histories if one.quantity == "positions"}
        self.names = [
            "reactions" if one.quantity == "reactions"
            else one.name if one.quantity == "positions" or one.name not in positions
            else f"{one.name}, {one.quantity}"
            for one in base.histories
        ]  # fmt: skip

    def between(self, run: RunHistories, other: RunHistories) -> Shares:
        """The largest difference of two runs over the outputs, by sensor."""
        shares: Shares = {}
        rows = zip(self.names, run.histories, other.histories, self.base.scales, strict=True)
        for name, mine, theirs, scale in rows:
            if scale > 0.0:
                error = float(np.abs(mine.values - theirs.values).max(initial=0.0)) / scale
                shares[name] = max(shares.get(name, 0.0), error)
        return shares

    def of_drift(self, drift: float) -> Shares:
        """The effect of a constraint violation (m or rad) on position sensors."""
        rows = zip(self.names, self.base.histories, self.base.scales, strict=True)
        return {
            name: drift / scale
            for name, one, scale in rows
            if one.quantity == "positions" and scale > 0.0 and one.unit in ("m", "rad")
        }

    def combined(self, runs: Sequence[RunHistories]) -> RunHistories:
        """The base plus the changes of several runs: an estimate of all changes together."""
        histories = []
        for k, one in enumerate(self.base.histories):
            change = sum(np.asarray(run.histories[k].values - one.values) for run in runs)
            histories.append(one._replace(values=one.values + change))
        return RunHistories(histories, self.base.scales)


@dataclass(frozen=True)
class Estimate:
    """Error by sensor due to a knob, as it is and after each refinement."""

    values: tuple[Shares, ...]
    state: str
    ratio: float | None
    rising: tuple[str, ...]  # sensors whose differences do not decrease


def estimate_error(
    errors: SensorErrors, runs: Sequence[RunHistories], noise: Shares | None = None
) -> Estimate:
    """The error due to a knob, from its refinements.

    Parameters
    ----------
    errors : SensorErrors
        Differences relative to the base run.
    runs : sequence of Reading
        Runs with the knob refined once, twice and so on.
    noise : mapping, optional
        Error of the integration by sensor, which differences may consist of.
    """
    chain = [errors.base, *runs]
    steps = [errors.between(one, other) for one, other in itertools.pairwise(chain)]
    last = steps[-1]
    noise = noise or {}
    quiet = {k for k in last if max(s[k] for s in steps) <= max(_NOISY * noise.get(k, 0.0), _FLOOR)}
    ratios = {k: steps[-2][k] / max(last[k], 1e-300) if len(runs) > 1 else _ONE_RATIO for k in last}
    rising = tuple(
        k
        for k, ratio in ratios.items()
        if ratio < _MIN_RATIO and k not in quiet and last[k] > _NOISY * noise.get(k, 0.0)
    )
    rest = {k: last[k] / (max(ratios[k], _MIN_RATIO) - 1.0) for k in last}
    values = []
    for k, run in enumerate(chain[:-1]):
        apart = errors.between(run, chain[-1])
        values.append({key: max(apart[key], steps[k][key]) + rest[key] for key in rest})
    worst = max(set(last) - quiet, key=lambda k: values[0][k], default="")
    state = NOT_CONVERGED if worst in rising else CONVERGED if len(runs) > 1 else ONE
    if not worst and any(noise.values()):
        state = NOISE
    ratio = ratios[worst] if worst and len(runs) > 1 and last[worst] > 0.0 else None
    return Estimate((*values, rest), state, ratio, rising)


class Run(NamedTuple):
    """A run that has ended: its histories, or the reason why there are none."""

    reading: RunHistories | None
    reason: str = ""
    cpu: float = 0.0
    statistics: Mapping[str, Any] = {}
    folder: str = ""


class ChangedRuns:
    """Runs of the scene with changes; each is done once."""

    def __init__(
        self, source: StudySource, folder: Path, cluster: Cluster, sensors: Sequence[str],
        fresh: bool, progress: Progress,
    ) -> None:  # fmt: skip
        self.source, self.folder, self.cluster = source, folder, cluster
        self.sensors, self.fresh, self.progress = sensors, fresh, progress
        self.ended: dict[str, Run] = {}
        self.audit: Record = {}
        self.names: list[tuple[str, str]] = []  # (quantity, name) of the histories
        self.bodies = ""  # folder of a run whose reduced bodies other runs may use

    def __getitem__(self, changes: Mapping[str, Any]) -> Run:
        return self.ended[content_key(changes)]

    def do(self, phase: str, several: Sequence[Mapping[str, Any]], audit: str = "") -> None:
        """Do those runs that have not been done, and the audit of the run in folder `audit`."""
        jobs: dict[str, dict[str, Any]] = {}
        models: dict[str, Model] = {}
        for changes in several:
            key = content_key(changes)
            if key in self.ended or key in jobs:
                continue
            try:
                models[key], scene = change_model(self.source, changes)
            except FlexmbError as error:
                self.ended[key] = Run(None, str(error).replace("\n", "; "))
                continue
            resolved = models[key].to_scene_dict(self.source.folder)
            folder = self.folder / "runs" / run_key(resolved, self.source.folder)
            jobs[key] = {
                "key": key, "scene": scene, "source": str(self.source.folder),
                "folder": str(folder.resolve()), "bodies": self.bodies, "fresh": self.fresh,
                "limit": self.cluster.limit,
            }  # fmt: skip
        todo = [*jobs.values()]
        if audit:
            todo.append({"key": _AUDIT, "audit": True, "folder": audit, "fresh": True})
        for job, record in self.cluster.run(run_changed, todo, progress=self.progress, phase=phase):
            if job["key"] == _AUDIT:
                self.audit = record
                continue
            self.ended[job["key"]] = self._read(models[job["key"]], job["folder"], record)

    def _read(self, model: Model, folder: str, record: Record) -> Run:
        if record["status"] != "finished":
            return Run(None, str(record["reason"]).replace("\n", "; "))
        try:
            reading = read_run(model, result_file(folder), self.sensors)
        except FlexmbError as error:
            return Run(None, str(error))
        names = [one[:2] for one in reading.histories]
        self.names = self.names or names
        if names != self.names:
            return Run(None, "it has other sensors or reactions than the scene as it is")
        return Run(reading, "", float(record["cpu"]), record["statistics"], folder)


def run_changed(job: Mapping[str, Any]) -> Record:
    """Run a scene given as plain data into its folder; its processor time and statistics."""
    from flexmb.analysis.chunked_run import one_thread
    from flexmb.results import Result
    from flexmb.workflow.simulate import run_model

    folder = Path(job["folder"])
    if job["key"] == _AUDIT:
        return {"shares": _audit_shares(folder)}
    file = folder / _RECORD
    if result_file(folder).is_file() and not job["fresh"] and (record := _stored(file)):
        return record
    writable_folder(folder)
    for body in Path(job["bodies"]).glob("*.flexbody.h5") if job["bodies"] else ():
        if not (folder / body.name).exists():
            shutil.copy2(body, folder / body.name)
    timer = RunTimer(float(job["limit"]))
    model = Model.from_scene_dict(job["scene"], Path(job["source"]))
    with one_thread():
        report = run_model(model, folder, pictures=False, analysis="dynamics", progress=timer)
    if Result(report.result).status == "stopped":  # by Ctrl-C: its record would say finished
        raise KeyboardInterrupt
    record = {"cpu": timer.cpu, "statistics": report.statistics}
    with whole_file(file) as partial:
        partial.write_text(json.dumps(record, default=float), encoding="utf-8")
    return record


def _stored(file: Path) -> Record | None:
    """The record of a run that has ended; None if it is missing or damaged."""
    try:
        record = read_json(read_regular(file))
        return {"cpu": float(record["cpu"]), "statistics": read_statistics(record["statistics"])}
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _audit_shares(folder: Path) -> Shares:
    """By sensor the sum over bodies of the largest contribution of an omitted effect."""
    from flexmb.workflow.audit import audit

    bodies: dict[str, Shares] = {}
    for one in audit(folder).effects:
        if not one.on and one.effect != "further modes":
            own = bodies.setdefault(one.body, {})
            for channel, value in one.shares.items():
                name = channel.split(".")[0]
                own[name] = max(own.get(name, 0.0), value)
    names = {name for own in bodies.values() for name in own}
    return {name: sum(own.get(name, 0.0) for own in bodies.values()) for name in names}
