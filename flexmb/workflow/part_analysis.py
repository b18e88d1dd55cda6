"""Analysis of a part, from a scene with ``[part]``: solved, stored, drawn, checked."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexmb.errors import FlexmbError, FlexmbWarning, Problem, SceneError, nearest
from flexmb.folders import output_folder, writable_folder
from flexmb.progress import Progress, silent
from flexmb.units import lengths_in
from flexmb.workflow.flexible_bodies import reduction_input, under_body
from flexmb.workflow.run_report import CheckOutcome

if TYPE_CHECKING:
    from flexmb.fe.model_checks import Survey
    from flexmb.flexbody import PartResult
    from flexmb.model import Model

_OPTIONS = ("units", "material", "sections", "interfaces", "ties", "masses", "springs",
            "mass_matrix")  # fmt: skip


@dataclass(frozen=True)
class PartReport:
    """A solved part, its files, and the known answers of its scene."""

    result: PartResult
    path: Path
    units: str
    pictures: tuple[Path, ...] = ()
    notes: list[str] = field(default_factory=list)
    checks: list[CheckOutcome] = field(default_factory=list)


def run_part(
    path: str | Path,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
    pictures: bool = True,
    progress: Progress = silent,
) -> PartReport:
    """Solve the part of a scene: one of its bodies, with the supports and loads of ``[part]``.

    Parameters
    ----------
    path : path
        The scene.
    output : path, optional
        Folder of the files; `out/<name of the scene's folder>` by default.
    overrides : mapping of str to str, optional
        Parameters or knobs to change, such as `{"part.buckling": "3"}`.
    pictures : bool
        Whether to draw the deformed part and its modes.
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.fe import part
    from flexmb.flexbody import save_part
    from flexmb.model import load_scene
    from flexmb.model.scenes.supports import select_part_body

    model = load_scene(Path(path), dict(overrides or {}))
    if model.part is None:
        what = "the scene has none: say how the body is supported and loaded by itself"
        raise SceneError.from_problems([Problem("part", what)])
    name, _ = select_part_body(model)
    folder = writable_folder(Path(output) if output is not None else output_folder(path))
    mesh, options = reduction_input(model, name)
    notes: list[str] = []
    with warnings.catch_warnings(record=True) as caught, lengths_in(model.units):
        warnings.simplefilter("always", FlexmbWarning)
        try:
            result = part(
                mesh,
                name=name,
                progress=progress,
                **{key: options[key] for key in _OPTIONS if key in options},
                **model.part.words(),
            )
        except FlexmbError as error:
            raise type(error).from_problems(_in_scene(name, error)) from None
    notes += [*result.notes, *(str(entry.message) for entry in caught)]
    if model.gravity is not None and not any(
        s.type == "gravity" for s in model.part.loads.values()
    ):
        notes.append("the scene's gravity does not act on the part: give a load of type gravity")
    provenance = {**result.provenance, "scene units": model.units.name}
    result = replace(result, provenance=provenance)
    stored = save_part(result, folder / f"{name}.part.h5")
    drawn: tuple[Path, ...] = ()
    if pictures:
        from flexmb.view.part_pictures import render_part

        progress("picture", 0.0)
        drawn = render_part(result, units=model.units, output=folder / f"{name}.part.png")
        progress("picture", 1.0)
    checks = check_part(model, result)
    return PartReport(result, stored, model.units.name, drawn, notes, checks)


def check_part(model: Model, result: PartResult) -> list[CheckOutcome]:
    """The known answers of a part, in the scene's units."""
    outcomes, problems = [], []
    for i, check in enumerate(model.part_checks):
        try:
            computed = result.quantity(check.part)
        except FlexmbError as error:
            problems.append(Problem(f"check[{i}].part", str(error)))
            continue
        unit = model.check_unit(vars(check)) or ""
        values = (computed, check.value, check.tolerance)
        computed, value, tolerance = (model.units.written(each, unit) for each in values)
        outcomes.append(CheckOutcome(check.part, None, computed, value, tolerance, check.source))
    if problems:
        raise SceneError.from_problems(problems)
    return outcomes


def part_group_problems(model: Model, surveys: Mapping[str, Survey]) -> list[Problem]:
    """Groups named in supports and loads of ``[part]`` that the mesh does not have."""
    from flexmb.model.scenes.supports import select_part_body

    if model.part is None or (body := select_part_body(model)[0]) not in surveys:
        return []
    places = {f"part.supports.{k}.group": s for k, s in model.part.supports.items()}
    places |= {f"part.loads.{k}.group": s for k, s in model.part.loads.items()}
    groups, problems = tuple(surveys[body].groups), []
    for where, spec in places.items():
        group = getattr(spec, "group", None)
        if group is not None and group not in groups:
            what = f'the mesh has no group "{group}"'
            problems.append(Problem(where, what, groups, nearest(group, groups)))
    return problems


def _in_scene(name: str, error: FlexmbError) -> list[Problem]:
    """The problems of an error under ``part`` or under the body, depending on their origin."""
    own = ("supports", "loads", "frequencies", "buckling", "preload")
    problems: list[Problem] = []
    for problem in error.problems:
        if problem.where.split(".")[0] in own:
            where = f"part.{problem.where}"
            problems.append(Problem(where, problem.what, problem.allowed, problem.nearest))
        else:
            problems += under_body(name, [problem])
    return problems
