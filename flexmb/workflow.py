"""The whole chain in one call: scene to flexible bodies to system to run to files and pictures.

The command line and the Python API use the same functions. Flexible bodies are reduced once and
reused while mesh, material and options hash the same.
"""

from __future__ import annotations

import tempfile
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import BodyFileError, FlexmbWarning, OutputError, SceneError, SolverError
from flexmb.progress import Progress, silent

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = [
    "CheckOutcome",
    "CheckReport",
    "RunReport",
    "check_scene",
    "reduce_mesh",
    "run_model",
    "run_scene",
    "simulate",
]


@dataclass(frozen=True)
class CheckOutcome:
    """One known answer of a scene and what the run gave."""

    sensor: str
    time: float
    value: float
    expected: float
    tolerance: float
    source: str

    @property
    def passed(self) -> bool:
        """Whether the value lies within the tolerance."""
        return abs(self.value - self.expected) <= self.tolerance


@dataclass(frozen=True)
class RunReport:
    """What a run left behind."""

    output: Path
    result: Path
    flexbodies: dict[str, Path]
    picture: Path | None = None
    history: Path | None = None
    statistics: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    checks: list[CheckOutcome] = field(default_factory=list)


@dataclass(frozen=True)
class CheckReport:
    """What `flexmb check` tells of a valid scene."""

    title: str
    counts: dict[str, int]
    notes: list[str]


def run_scene(
    path: str | Path,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
    fresh: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Run a scene file from mesh to picture.

    Parameters
    ----------
    path : path
        The scene.
    output : path, optional
        Folder of the results; `out/<name of the scene's folder>` by default.
    overrides : mapping of str to str, optional
        Parameters or knobs to change, such as `{"r": "0.1", "dynamics.step": "1e-4"}`.
    fresh : bool
        Reduce meshes anew even if an equal reduction is there.
    pictures : bool
        Whether to draw the picture and the history.
    progress : Progress
        Told every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; results until a failure are kept.
    """
    from flexmb.model import load_scene

    path = Path(path)
    model = load_scene(path, dict(overrides or {}))
    if output is None:
        name = path.resolve().parent.name if path.stem == "scene" else path.stem
        output = Path("out") / name
    return run_model(model, output, fresh=fresh, pictures=pictures, progress=progress)


def run_model(
    model: Model,
    output: str | Path,
    *,
    fresh: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Run a model from mesh to picture; see :func:`run_scene`."""
    from flexmb.analysis.dynamics import dynamics, require_finished
    from flexmb.engine.compile import compile_system
    from flexmb.results import Result, ResultWriter

    model.validate()
    if model.dynamics is None:
        raise SceneError("the scene has no [dynamics]: give duration and step")
    folder = _writable(Path(output))
    started = time.perf_counter()
    bodies, files, notes = flexible_bodies(model, folder, fresh=fresh, progress=progress)
    reduced = time.perf_counter()
    compiled = compile_system(model, bodies)
    result = folder / "result.h5"
    scene = model.to_scene_dict(folder, {name: file.name for name, file in files.items()})
    texts = {"scene": model.source.text} if model.source else {}
    names = {name: file.name for name, file in files.items()}
    rows = model.dynamics.outputs + 1
    with ResultWriter(
        result, compiled.layout, rows, scene=scene, flexbodies=names, texts=texts
    ) as writer:
        outcome = dynamics(compiled, model, writer, progress=progress)
        statistics = {**outcome.statistics, "seconds_flexible_bodies": reduced - started}
        writer.finish(statistics, outcome.status, outcome.message)
    notes += outcome.notes
    if outcome.message:
        notes.append(outcome.message)
    run = Result(result)
    picture, history = _draw(model, run, folder, progress) if pictures else (None, None)
    if outcome.status == "failed":
        kept = f"{result} keeps the {len(run.time)} outputs until then"
        raise SolverError(f"{outcome.message}; {kept}")
    require_finished(outcome)
    return RunReport(
        folder, result, files, picture, history, statistics, notes, _checks(model, run)
    )


def simulate(
    model: Model,
    *,
    output: str | Path | None = None,
    progress: Progress = silent,
    **dynamics: Any,
) -> Result:
    """Run a model and open its result.

    Parameters
    ----------
    model : Model
        The model.
    output : path, optional
        Folder to keep the files in; a temporary one by default.
    progress : Progress
        Told every phase.
    **dynamics
        Fields of `[dynamics]`, such as `duration=0.1, step=1e-4`.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.results import Result

    if dynamics:
        given = {} if model.dynamics is None else model.dynamics.model_dump()
        model.set_dynamics(**{**given, **dynamics})
    folder = Path(output) if output is not None else Path(tempfile.mkdtemp(prefix="flexmb-"))
    report = run_model(model, folder, pictures=False, progress=progress)
    for note in report.notes:
        warnings.warn(note, FlexmbWarning, stacklevel=2)
    return Result(report.result)


def reduce_mesh(
    mesh: str | Path,
    *,
    material: Any,
    interfaces: Mapping[str, str] | None = None,
    sections: Mapping[str, Any] | None = None,
    output: str | Path | None = None,
    progress: Progress = silent,
    **options: Any,
) -> tuple[FlexBody, Path]:
    """Reduce a mesh to a flexible body and save it (`<mesh>.flexbody.h5` by default)."""
    from flexmb import fe
    from flexmb.flexbody import save

    body = fe.reduce(
        mesh,
        material=material,
        interfaces=interfaces or {},
        sections=sections or None,
        progress=progress,
        **options,
    )
    path = Path(output) if output is not None else Path(f"{Path(mesh).stem}.flexbody.h5")
    return body, save(body, path)


def check_scene(path: str | Path, overrides: Mapping[str, str] | None = None) -> CheckReport:
    """Validate a scene and count what it holds.

    Raises
    ------
    SceneError
        All that is wrong with it.
    """
    from flexmb.model import load_scene
    from flexmb.model.counts import count

    model = load_scene(Path(path), dict(overrides or {}))
    model.validate()
    counts = count(model)
    told = {
        "rigid bodies": counts.rigid_bodies,
        "flexible bodies": counts.flexible_bodies,
        **{f"{row.type} joints": row.joints for row in counts.joints},
        "drivers": counts.drivers,
        "forces": counts.forces,
        "sensors": counts.sensors,
        "coordinates of the bodies, without modes": counts.rigid_coordinates,
        "equations of the joints": counts.equations,
        "freedoms left by joints and drivers": counts.mobility,
    }
    notes = ["gravity: none" if model.gravity is None else f"gravity: {model.gravity} m/s^2"]
    if counts.flexible_bodies:
        notes.append("modes of flexible bodies add coordinates that are not counted here")
    if counts.mobility < 0:
        notes.append(
            "joints and drivers hold more than rigid bodies can move: flexible bodies must give "
            "way, or reactions are not unique"
        )
    return CheckReport(model.title or str(path), told, notes)


def flexible_bodies(
    model: Model, folder: Path, *, fresh: bool = False, progress: Progress = silent
) -> tuple[dict[str, FlexBody], dict[str, Path], list[str]]:
    """The reduced bodies of a model by name, their files in `folder`, and notes for the user."""
    from flexmb.flexbody import load, save
    from flexmb.model.bodies import FlexbodySpec, MeshBodySpec

    bodies: dict[str, FlexBody] = {}
    files: dict[str, Path] = {}
    notes: list[str] = []
    for name, spec in model.bodies.items():
        file = folder / f"{name}.flexbody.h5"
        if isinstance(spec, MeshBodySpec):
            bodies[name] = _reduced(model, name, spec, file, fresh, notes, progress)
        elif isinstance(spec, FlexbodySpec):
            held = spec.flexbody
            bodies[name] = load(model.path(held)) if isinstance(held, str) else held
            save(bodies[name], file)
        else:
            continue
        files[name] = file
    return bodies, files, notes


def _reduced(
    model: Model,
    name: str,
    spec: Any,
    file: Path,
    fresh: bool,
    notes: list[str],
    progress: Progress,
) -> FlexBody:
    """The body of a mesh, reused if its file was made from the same input."""
    from flexmb import fe
    from flexmb.flexbody import load, save

    options = {
        "units": spec.units,
        "material": spec.material,
        "interfaces": dict(spec.interfaces),
        "modes": spec.modes,
        "damping": spec.damping,
        "name": name,
        "sections": dict(spec.sections) or None,
    }
    mesh = model.path(spec.mesh)
    if not fresh and file.exists():
        try:
            body = load(file)
        except BodyFileError:
            body = None  # of another version, or cut off: made anew
        if body is not None and body.provenance.get("key") == fe.reduction_key(mesh, **options):
            notes.append(f"{name}: reduction reused from {file} (--fresh makes it anew)")
            return body
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FlexmbWarning)
        body = fe.reduce(mesh, **options, progress=progress)
    notes += [f"{name}: {entry.message}" for entry in caught]
    save(body, file)
    return body


def _writable(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise OutputError(f"cannot write to the output folder {folder}: {error.strerror}") from None


def _draw(
    model: Model, run: Result, folder: Path, progress: Progress
) -> tuple[Path | None, Path | None]:
    """Picture and history of a run that has at least one output."""
    from flexmb.view import plot_history, render

    if not len(run.time):
        return None, None
    progress("picture", 0.0)
    picture = render(run, output=folder / "picture.png")
    progress("picture", 1.0)
    history = None
    if model.channels():
        progress("history", 0.0)
        history = plot_history(run, output=folder / "history.png")
        progress("history", 1.0)
    return picture, history


def _checks(model: Model, run: Result) -> list[CheckOutcome]:
    """The scene's known answers at their times, by interpolation between outputs."""
    outcomes = []
    for check in model.checks:
        value = float(np.interp(check.time, run.time, run[check.sensor]))
        outcomes.append(
            CheckOutcome(
                check.sensor, check.time, value, check.value, check.tolerance, check.source
            )
        )
    return outcomes
