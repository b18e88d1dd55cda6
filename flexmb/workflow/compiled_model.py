"""The compiled model of a scene file, a model or a result.

In: a scene file with changed values, a `Model`, or a `Result` (its folder, its file). Out: the
compiled system, the model, the run. Flexible bodies are reduced as for a run, into the folder of
the run; those of a model in memory into a temporary folder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, ResultFileError, SceneError
from flexmb.folders import output_folder, writable_folder
from flexmb.model.quantities import read_number
from flexmb.model.reading import ReadContext, under
from flexmb.model.scenes.parameters import Time
from flexmb.progress import Progress, silent
from flexmb.workflow.flexible_bodies import flexible_bodies
from flexmb.workflow.resume import load_bodies

if TYPE_CHECKING:
    from flexmb.analysis.assembly.initial_state import StartValues
    from flexmb.engine.compile import Compiled
    from flexmb.model import Model
    from flexmb.results import Result


@dataclass(frozen=True)
class CompiledModel:
    """A model, its compiled system, the run it belongs to if any, and notes on its flexible
    bodies."""

    model: Model
    compiled: Compiled
    result: Result | None = None
    notes: tuple[str, ...] = ()

    def state_at(self, time: Time | None) -> StartValues:
        """Positions and velocities of the run at the output nearest to a time; by default at the
        end.

        Raises
        ------
        ResultFileError
            The result has no rows or not all coordinates, or the time is outside of it.
        """
        from flexmb.analysis.assembly.initial_state import StartValues

        run = self.result
        assert run is not None
        if not len(run.time):
            raise ResultFileError(f"{run.path}: holds no output rows")
        before, fraction = run.row_at(run.time[-1] if time is None else time)
        k = before + round(fraction)
        q, v = self.compiled.layout.of_equations(run.q[k], run.v[k])
        return StartValues(q, v, float(run.table("time")[k]))


def compile_source(
    source: Model | Result | str | Path,
    *,
    overrides: Mapping[str, Any] | None = None,
    output: Path | None = None,
    progress: Progress = silent,
) -> CompiledModel:
    """Compile the model of a scene file, a model or a result.

    Parameters
    ----------
    source : Model, Result or path
        A scene file (.toml), a model, a result or its folder.
    overrides : mapping, optional
        Parameters or knobs of a scene file to change.
    output : path, optional
        Folder for the flexible bodies of a scene file; `out/<scene>` by default.
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong with it; a result of another model.
    """
    from flexmb.engine.compile import compile_system
    from flexmb.model import Model, load_scene
    from flexmb.results import Result
    from flexmb.results.reader import TemporaryFolder

    if isinstance(source, str | Path) and Path(source).suffix == ".toml":
        model = load_scene(Path(source), dict(overrides or {}))
        model.validate()
        folder = writable_folder(output or output_folder(source))
        bodies, _, notes = flexible_bodies(model, folder, progress=progress)
        return CompiledModel(model, compile_system(model, bodies), None, tuple(notes))
    if overrides:
        raise SceneError("values are changed in scene files; change the model itself")
    if isinstance(source, Model):
        source.validate()
        scratch = TemporaryFolder()
        bodies, _, notes = flexible_bodies(source, scratch.path, progress=progress)
        return CompiledModel(source, compile_system(source, bodies), None, tuple(notes))
    run = source if isinstance(source, Result) else Result(source)
    model = Model.from_scene_dict(run.model, run.path.parent)
    compiled = compile_system(model, load_bodies(run))
    if run.layout.fingerprint != compiled.layout.fingerprint:
        raise ResultFileError(
            f"{run.path}: this flexmb builds another system from its scene; run the scene again"
        )
    return CompiledModel(model, damped_as_run(compiled, model, run), run)


def damped_as_run(compiled: Compiled, model: Model, run: Result) -> Compiled:
    """The compiled model of a run with the damping that its flexible bodies had in the run."""
    from flexmb.analysis.assembly.body_damping import add_damping

    newest = run.last_state()
    first = None if newest is None else newest[1].get("first_q")
    return compiled if first is None else add_damping(compiled, model, first)[0]


def read_values(
    values: Sequence[float | str], parameter: str, times: ReadContext | None = None
) -> list[float]:
    """Values of what is varied, as plain numbers in the scene's units.

    With `times` they are times, which may have units of their own.

    Raises
    ------
    SceneError
        Whatever is no such value; all at once.
    """
    names, unit = times or ReadContext(), "" if times is None else "s"
    numbers: list[float] = []
    problems: list[Problem] = []
    for value in values:
        try:
            numbers.append(read_number(value, names, unit))
        except SceneError as error:
            problems += under(parameter, error.problems)
    if problems:
        raise SceneError.from_problems(problems)
    return numbers
