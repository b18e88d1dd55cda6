"""The report of a run: files, pictures, statistics, notes, known answers of the scene; provenance.

The provenance of a result is a JSON text in it: version of flexmb, hash of the compiled code, the
scene file with its overrides, a hash of every flexible body. The error that a run states is that of
the integration only; a line of the report says which errors it does not contain.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import SolverError
from flexmb.flexbody.arrays import Array
from flexmb.folders import relative_path
from flexmb.model.flexible_body import FlexibleBodySpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.progress import Progress
from flexmb.workflow.flexible_bodies import REUSED

if TYPE_CHECKING:
    from flexmb.analysis.chunked_run import Outcome
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result


_SAME_TIME = 1e-9  # times that differ by less than this fraction of the run are equal
# factor on the difference of both interpolations to bound the error between outputs
_INTERPOLATION_SAFETY = 4.0
PROVENANCE = "origin"  # name of the text in the result


@dataclass(frozen=True)
class CheckOutcome:
    """A known answer of a scene and the computed value, in the scene's units.

    ``sensor`` is the channel, or the number of a natural frequency and its body; a frequency has no
    ``time``.
    """

    sensor: str
    time: float | None
    value: float
    expected: float
    tolerance: float
    source: str
    uncertainty: float = 0.0
    """Bound on the error of the value because its time lies between outputs."""

    @property
    def passed(self) -> bool:
        """Whether the value is within the tolerance."""
        return abs(self.value - self.expected) <= self.tolerance

    @property
    def is_open(self) -> bool:
        """Whether it does not pass, and the outputs near its time are too far apart to decide."""
        error = abs(self.value - self.expected)
        return self.tolerance < error <= self.tolerance + self.uncertainty

    def place(self, unit: str) -> str:
        """The sensor and its time, for a sentence."""
        return self.sensor if self.time is None else f"{self.sensor} at t = {self.time:g} {unit}"


@dataclass(frozen=True)
class RunReport:
    """Files and figures of a run."""

    output: Path
    result: Path
    flexbodies: dict[str, Path]
    picture: Path | None = None
    history: Path | None = None
    statistics: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    checks: list[CheckOutcome] = field(default_factory=list)
    resumable: bool = True
    tables: tuple[tuple[Sequence[str], Sequence[Sequence[str]]], ...] = ()  # columns, rows


def report_run(
    model: Model,
    run: Result,
    outcome: Outcome,
    notes: list[str],
    *,
    pictures: bool,
    progress: Progress,
    analysis: str = "dynamics",
) -> RunReport:
    """Draw a run and compare it with the known answers of its scene.

    An analysis that the scene has no section of, such as the equilibrium of a scene with
    ``[dynamics]``, has other answers than those of its sensors.

    Raises
    ------
    SolverError
        The run failed; it is drawn nevertheless.
    """
    from flexmb.flexbody import load

    remarks = [*notes, *outcome.notes]
    notes = [*remarks, *([outcome.message] if outcome.message else [])]
    picture, history = draw_run(run, progress) if pictures else (None, None)
    if pictures and len(run.time) and not run.has_columns("q"):
        notes.append('no picture: not all poses were kept (keep = ["poses"] in [results])')
    if outcome.status == "failed":
        rows = f"{run.path} keeps the {len(run.time)} outputs until then"
        causes = [f"note: {one}" for one in remarks if REUSED not in one]
        sentences = [f"{outcome.message}; {rows}", *causes]
        raise SolverError("\n".join(sentences))
    bodies = {check.body: load(run.flexbodies[check.body]) for check in model.frequency_checks}
    checks = check_frequencies(model, bodies)
    if getattr(model, analysis) is not None:
        checks = [*check_sensors(model, run), *checks]
    elif model.checks:
        notes.append(answers_of_another(model, "an equilibrium"))
    return RunReport(
        run.path.parent,
        run.path,
        run.flexbodies,
        picture,
        history,
        dict(run.statistics),
        notes,
        checks,
    )


def draw_run(run: Result, progress: Progress) -> tuple[Path | None, Path | None]:
    """Picture and history of a run with at least one output, from what it stored."""
    from flexmb.view.history import plot_history
    from flexmb.view.picture import render

    if not len(run.time):
        return None, None
    folder = run.path.parent
    picture = history = None
    if run.has_columns("q"):
        progress("picture", 0.0)
        picture = render(run, output=folder / "picture.png")
        progress("picture", 1.0)
    if run.channels():
        progress("history", 0.0)
        history = plot_history(run, output=folder / "history.png")
        progress("history", 1.0)
    return picture, history


def check_sensors(model: Model, run: Result) -> list[CheckOutcome]:
    """The scene's known answers at their times, interpolated between outputs.

    A check at a time that the run did not reach has the value NaN and fails; if the user stopped
    the run, it is left out.
    """
    outcomes = []
    for check in model.checks:
        unit = model.channel_unit(check.sensor) or ""
        expected = model.units.written(check.value, unit)
        tolerance = model.units.written(check.tolerance, unit)
        time = model.units.written(check.time, "s")
        reached = len(run.time) and time <= run.time[-1] * (1 + 1e-9) + 1e-12
        if not reached and run.status == "stopped":
            continue
        value, doubt = value_at(time, run.time, run[check.sensor]) if reached else (math.nan, 0.0)
        outcomes.append(
            CheckOutcome(check.sensor, time, value, expected, tolerance, check.source, doubt)
        )
    return outcomes


def answers_of_another(model: Model, analysis: str) -> str:
    """The note that the known answers of sensors do not belong to an analysis."""
    count = len(model.checks)
    what = "known answer" if count == 1 else "known answers"
    return f"{count} {what} of sensors in the scene not compared: of its motion, not of {analysis}"


def value_at(time: float, t: Array, x: Array) -> tuple[float, float]:
    """A channel x(t) at a time, and a bound on its error, which is 0 at an output.

    Between outputs the polynomial through six outputs is used; its difference from the one through
    the inner four gives the bound.
    """
    k = int(np.clip(np.searchsorted(t, time), 1, max(len(t) - 1, 1)))
    near = min((k - 1, min(k, len(t) - 1)), key=lambda i: abs(t[i] - time))
    if abs(t[near] - time) <= _SAME_TIME * max(abs(t[0]), abs(t[-1]), 1e-300):
        return float(x[near]), 0.0
    values = []
    for count in (6, 4):
        first = int(np.clip(k - count // 2, 0, max(len(t) - count, 0)))
        rows = slice(first, min(first + count, len(t)))
        values.append(_lagrange(time, t[rows], x[rows]))
    if len(t) <= 4:  # too few to tell
        values[1] = float(np.interp(time, t, x))
    return values[0], _INTERPOLATION_SAFETY * abs(values[0] - values[1])


def _lagrange(time: float, t: Array, x: Array) -> float:
    """The value at a time of the polynomial through points (k,)."""
    total = 0.0
    for i in range(len(t)):
        others = np.delete(t, i)
        total += float(x[i] * np.prod((time - others) / (t[i] - others)))
    return total


def check_frequencies(model: Model, bodies: Mapping[str, FlexBody]) -> list[CheckOutcome]:
    """One outcome for each known natural frequency of these bodies; a missing mode gives NaN."""
    from flexmb.flexbody.natural_modes import natural_frequencies

    outcomes = []
    for check in model.frequency_checks:
        if check.body not in bodies:
            continue
        frequencies = natural_frequencies(bodies[check.body], check.held)
        missing = check.mode > len(frequencies)
        value = math.nan if missing else float(frequencies[check.mode - 1])
        support = f"{', '.join(check.held)} held" if check.held else "free"
        what = f"frequency {check.mode} of {check.body}, {support}"
        numbers = (value, check.value, check.tolerance)
        computed, expected, tolerance = (model.units.written(each, "Hz") for each in numbers)
        outcomes.append(CheckOutcome(what, None, computed, expected, tolerance, check.source))
    return outcomes


def code_version() -> dict[str, str]:
    """This version of flexmb and the hash of its compiled code."""
    from flexmb import __version__
    from flexmb.engine.unit_cache import engine_hash

    return {"flexmb": __version__, "engine": engine_hash()}


def provenance_text(
    model: Model, folder: Path, bodies: Mapping[str, FlexBody], start_from: Path | None = None
) -> str:
    """The provenance of a result in `folder`."""
    data: dict[str, Any] = code_version()
    data["bodies"] = {
        name: {"hash": body_hash(body), "key": body.provenance.get("key", "")}
        for name, body in bodies.items()
    }
    if model.source is not None:
        data["scene_file"] = relative_path(model.source.path, folder)
        data["overrides"] = dict(model.source.overrides)
    if start_from is not None:
        data["from"] = str(start_from)
    return json.dumps(data, default=str)


def provenance(result: Result) -> dict[str, Any]:
    """The provenance in a result; empty if there is none."""
    from flexmb.results.crash_safe_file import reading

    with reading(result.path):
        data: dict[str, Any] = json.loads(result.texts.get(PROVENANCE, "{}"))
        return data | {"bodies": dict(data.get("bodies", {}))}


def body_hash(body: FlexBody) -> str:
    """Hash of all data of a flexible body except its provenance."""
    from flexmb.flexbody.body_file import to_datasets

    digest = hashlib.sha256(repr((body.name, body.mass)).encode())
    for path, value in sorted(to_datasets(body).items()):
        if not path.startswith("provenance/"):
            digest.update(path.encode())
            data = repr(value).encode() if isinstance(value, list) else np.asarray(value).tobytes()
            digest.update(data)
    return digest.hexdigest()


def not_contained(model: Model, bodies: Mapping[str, FlexBody]) -> str:
    """Errors not contained in that of the run, ``mesh, modes (20), interface model``; empty if
    none."""
    specs = {
        name: spec for name, spec in model.bodies.items() if isinstance(spec, FlexibleBodySpec)
    }
    elastic = {name: spec for name, spec in specs.items() if name in bodies and bodies[name].m}
    parts = []
    if elastic:
        counts = {name: _mode_count(spec, bodies[name]) for name, spec in elastic.items()}
        same = len(set(counts.values())) == 1
        words = [f"{n} of {name}" for name, n in counts.items()]
        parts = ["mesh", f"modes ({next(iter(counts.values())) if same else ', '.join(words)})"]
    if any(has_several_nodes(spec, bodies[name]) for name, spec in elastic.items()):
        parts.append("interface model")
    effects: dict[str, list[str]] = {}
    for name, spec in specs.items():
        for effect in _effects_left_out(spec, bodies.get(name)):
            effects.setdefault(effect, []).append(name)
    for effect, names in effects.items():
        every = len(names) == len(specs)
        parts.append(effect if every else f"{effect} of {' and '.join(names)}")
    return ", ".join([*parts, *(model.effects.absent if model.effects is not None else ())])


def _mode_count(spec: FlexibleBodySpec, body: FlexBody) -> int:
    """The number of modes stated in the scene, else of the body's coordinates."""
    if isinstance(spec, MeshBodySpec) and isinstance(spec.modes, int | None):
        return spec.mode_count
    return body.m


def has_several_nodes(spec: FlexibleBodySpec, body: FlexBody) -> bool:
    """Whether an interface has several nodes, so that its rigidity is a model assumption."""
    if not isinstance(spec, MeshBodySpec):
        return bool(body.interfaces)
    groups = {} if body.nodes is None else body.nodes.groups
    for nodes in spec.interfaces.values():
        group = nodes if isinstance(nodes, str) else nodes.group
        if group is not None:
            count = len(groups.get(group, (0, 1)))
        else:
            count = 1 if nodes.node is not None else len(nodes.nodes or (0, 1))
        if count > 1:
            return True
    return False


def _effects_left_out(spec: FlexibleBodySpec, body: FlexBody | None) -> Iterator[str]:
    if spec.deformation == "rigid":
        yield "deformation"
        return
    if spec.deformation == "quasi-static":
        yield "vibration"
    if spec.inertia_coupling != "full":
        yield "full inertia coupling"
    if body is not None and body.m and body.centrifugal_stiffness is None:
        yield "geometric stiffening"
