"""Running a scene file or a model, with stated or with selected effects.

Also row by row, for Python loops that read the motion while it is computed.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from flexmb.errors import FlexmbWarning, SolverError
from flexmb.flexbody.arrays import Array
from flexmb.folders import output_folder, writable_folder
from flexmb.progress import Progress, silent
from flexmb.workflow.run import run_single
from flexmb.workflow.run_report import RunReport

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result


def run_scene(
    path: str | Path,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
    analysis: str | None = None,
    start_from: Result | str | Path | None = None,
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
    analysis : {"dynamics", "kinematics", "statics"}, optional
        Name of the analysis; by default that of the scene's section, if it has only one.
    start_from : Result or path, optional
        Another run from whose last row this one starts, at time 0; bodies are matched by name.
    fresh : bool
        Reduce meshes again even if an equal reduction is there.
    pictures : bool
        Whether to draw the picture and the history.
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; results until a failure are kept.
    """
    from flexmb.model import load_scene

    return run_model(
        load_scene(Path(path), dict(overrides or {})),
        output_folder(path) if output is None else output,
        analysis=analysis,
        start_from=start_from,
        fresh=fresh,
        pictures=pictures,
        progress=progress,
    )


def run_model(
    model: Model,
    output: str | Path,
    *,
    analysis: str | None = None,
    start_from: Result | str | Path | None = None,
    fresh: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Run a model from mesh to picture; see :func:`run_scene`."""
    auto = model.dynamics is not None and getattr(model.effects, "choice", "") == "auto"
    run: Callable[..., RunReport] = run_single
    if auto and analysis in (None, "dynamics"):
        from flexmb.workflow.effect_selection import run_with_selected_effects

        run = run_with_selected_effects
    return run(
        model, writable_folder(Path(output)), analysis=analysis, start_from=start_from, fresh=fresh,
        pictures=pictures, progress=progress,
    )  # fmt: skip


def simulate(
    model: Model | str | Path,
    *,
    output: str | Path | None = None,
    start_from: Result | str | Path | None = None,
    progress: Progress = silent,
    **dynamics: Any,
) -> Result:
    """Run a model and open its result.

    Parameters
    ----------
    model : Model or path
        The model, or a scene file.
    output : path, optional
        Folder of the files. By default a temporary one, which is removed with the last `Result` of
        it: `Result.save` copies it.
    start_from : Result or path, optional
        Another run from whose last row this one starts, at time 0; bodies are matched by name.
    progress : Progress
        Called for every phase.
    **dynamics
        Fields of `[dynamics]`, such as `duration=0.1, step=1e-4`, in the model's units.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.model import as_model
    from flexmb.model.scenes.dynamics import INSTEAD, drop_idle_options

    model = as_model(model)
    if dynamics:
        spec = model.dynamics
        fields = {} if spec is None else spec.model_dump(context=model.context)
        for new in dynamics:
            fields.pop(INSTEAD.get(new, ""), None)
        model = copy.copy(model)
        fields |= dynamics
        drop_idle_options(fields, dynamics)
        model.set_dynamics(**fields)
    return _run_and_open(model, "dynamics", output, start_from, progress)


def kinematics(
    model: Model | str | Path,
    *,
    output: str | Path | None = None,
    progress: Progress = silent,
    **fields: Any,
) -> Result:
    """Compute the motion that joints and drivers determine, and open its result.

    Positions, velocities and accelerations at each output, exact to round-off, and the reactions
    and driving forces of that motion (inverse dynamics). Flexible bodies stay undeformed.

    Parameters
    ----------
    model : Model or path
        The model, or a scene file.
    output : path, optional
        Folder of the files; as in :func:`simulate`.
    progress : Progress
        Called for every phase.
    **fields
        Fields of `[kinematics]`, such as `duration=1.0, outputs=400`, in the model's units.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message: motions without driver, drivers that contradict each
        other, singular poses.
    """
    return _run_and_open(
        _changed(model, "kinematics", fields), "kinematics", output, None, progress
    )


def statics(
    model: Model | str | Path,
    *,
    output: str | Path | None = None,
    progress: Progress = silent,
    **fields: Any,
) -> Result:
    """Compute the equilibrium of a model at rest, or a series of them, and open its result.

    Rigid and flexible bodies under weight, springs, loads and drivers, with their values at a time.

    Parameters
    ----------
    model : Model or path
        The model, or a scene file.
    output : path, optional
        Folder of the files; as in :func:`simulate`.
    progress : Progress
        Called for every phase.
    **fields
        Fields of `[statics]`, such as `time=0.5`, or `duration=1.0, outputs=20`.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; without an equilibrium, what keeps moving.
    """
    return _run_and_open(_changed(model, "statics", fields), "statics", output, None, progress)


def _changed(model: Model | str | Path, section: str, fields: dict[str, Any]) -> Model:
    """A model or scene with changed fields in the section of an analysis."""
    from flexmb.model import as_model

    model = as_model(model)
    if not fields:
        return model
    spec = getattr(model, section)
    present = {} if spec is None else spec.model_dump(context=model.context)
    model = copy.copy(model)
    getattr(model, f"set_{section}")(**{**present, **fields})
    return model


def _run_and_open(
    model: Model,
    analysis: str,
    output: str | Path | None,
    start_from: Result | str | Path | None,
    progress: Progress,
) -> Result:
    """Run a model without pictures and open its result; notes become warnings."""
    from flexmb.results import Result
    from flexmb.results.reader import TemporaryFolder

    scratch = None if output is not None else TemporaryFolder()
    folder = scratch.path if scratch is not None else Path(output or ".")
    try:
        report = run_model(
            model, folder, analysis=analysis, start_from=start_from, pictures=False,
            progress=progress,
        )  # fmt: skip
    except SolverError:  # its message says where the rows up to the failure are
        if scratch is not None:
            scratch.preserve()
        raise
    unit = model.units.label("s")
    failed = [
        f"check of {c.place(unit)} {'is not decided between outputs' if c.is_open else 'failed'}: "
        f"{c.value:.12g}, not {c.expected:.12g} within {c.tolerance:g} ({c.source})"
        for c in report.checks
        if not c.passed
    ]
    for note in [*report.notes, *failed]:
        warnings.warn(note, FlexmbWarning, stacklevel=3)
    return Result(report.result)


class MotionState(NamedTuple):
    """The state at an output: time and sensors in the scene's units, everything else in SI."""

    time: float
    sensors: dict[str, float]
    q: Array  # (nq,)
    v: Array  # (nv,)
    vd: Array  # (nv,)
    lam: Array  # (nc,)


def iterate_motion(model: Model | str | Path, **dynamics: Any) -> Iterator[MotionState]:
    """Integrate a model and yield the state at each output as soon as it is reached.

    It is one run without a comparison run, so its error is estimated, not measured; nothing is
    stored. A loop may end it at any time.

    Parameters
    ----------
    model : Model or path
        The model, or a scene file.
    **dynamics
        Fields of `[dynamics]`, as of `simulate`.

    Yields
    ------
    MotionState
        At each output, from the first state on.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; SolverError if the run fails.
    """
    from flexmb.analysis.dynamics.dynamics import prepare_dynamics
    from flexmb.analysis.failure_messages import failure_sentence
    from flexmb.engine.method import SUCCESS
    from flexmb.model import as_model
    from flexmb.model.scenes.dynamics import INSTEAD, drop_idle_options
    from flexmb.results.channels import Columns, all_channels
    from flexmb.workflow.compiled_model import compile_source

    model = as_model(model)
    spec = model.dynamics
    fields = {} if spec is None else spec.model_dump(context=model.context)
    for new in dynamics:
        fields.pop(INSTEAD.get(new, ""), None)
    fields |= dynamics
    drop_idle_options(fields, dynamics)
    fields["verify"] = False
    model = copy.copy(model)
    model.set_dynamics(**fields)
    system = compile_source(model)
    prepared = prepare_dynamics(system.compiled, model)
    run, names = prepared.run, system.compiled.layout.channels
    scene = model.to_scene_dict(model.folder, dict.fromkeys(model.bodies, ""))
    channels = all_channels(Columns.of(system.compiled.layout), scene)
    scales = [float(model.units.outward(1.0, channels[name].unit or "")) for name in names]
    steps = 0
    while True:
        status = run.integrate(steps)
        rows = run.rows.read().in_global_frame(system.compiled.layout)
        for k in range(len(rows.t)):
            values = (float(x * f) for x, f in zip(rows.sensors[k], scales, strict=True))
            time = float(model.units.outward(rows.t[k], "s"))
            sensors = dict(zip(names, values, strict=True))
            yield MotionState(time, sensors, rows.q[k], rows.v[k], rows.vd[k], rows.lam[k])
        if status != SUCCESS:
            at, step = float(run.state.t[0]), float(run.state.memory[0]["next_step"])
            raise SolverError(
                failure_sentence(status, run.compiled, prepared.model, run.work, at, step)
            )
        if run.finished:
            return
        steps = 1
