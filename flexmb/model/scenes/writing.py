"""The model as plain data: a scene that reads back into the same model.

In: a model. Out: dictionaries, lists, numbers and texts as JSON or TOML hold them. Numbers are
resolved, in the model's unit system and such that reading gives the same to the bit; functions of
time stay as given, beside the parameters they use.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import SceneError
from flexmb.model.bodies.body import BodySpec, FlexbodySpec
from flexmb.model.joints.curves import CurveSpec, read_points
from flexmb.model.values.reading import Spec, Terms

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["scene_dict"]

Files = Mapping[str, str | Path]


def scene_dict(model: Model, folder: str | Path | None, flexbodies: Files) -> dict[str, Any]:
    """The scene of a model; see :meth:`Model.to_scene_dict`."""
    scene: dict[str, Any] = {
        "title": model.title,
        "units": model.units.name,
        "plane": model.plane,
        "gravity": _gravity(model),
        "parameters": dict(model.given_parameters),
        "ground": _plain(model.ground, model.terms),
        "bodies": {
            name: _body(model, name, spec, folder, flexbodies)
            for name, spec in model.bodies.items()
        },
    }
    if model.curves:
        scene["curves"] = {name: _curve(model, spec) for name, spec in model.curves.items()}
    for section in ("joints", "couplers", "drivers", "forces", "sensors", "states", "controllers"):
        scene[section] = {
            name: _plain(spec, model.terms) for name, spec in getattr(model, section).items()
        }
    scene["check"] = [_plain(spec, model.check_terms(spec.sensor)) for spec in model.checks]
    scene["check"] += [_plain(spec, model.terms) for spec in model.frequency_checks]
    for section in ("assembly", "dynamics", "kinematics", "results", "study"):
        spec = getattr(model, section)
        if spec is not None:
            scene[section] = _plain(spec, model.terms)
    scene["view"] = _plain(model.view, model.terms)
    return {key: value for key, value in scene.items() if value or key == "title"}


def _gravity(model: Model) -> Any:
    if model.gravity is None:
        return "none"
    return [model.units.written(g, "m/s^2") for g in model.gravity]


def _plain(spec: Spec, terms: Terms) -> dict[str, Any]:
    return spec.model_dump(mode="json", exclude_none=True, context=terms)


def _curve(model: Model, spec: CurveSpec) -> dict[str, Any]:
    """A curve; one from a file with the points of the file, so that the scene holds all of it."""
    if spec.file is None:
        table = _plain(spec, model.terms)
        return {key: value for key, value in table.items() if key in spec.model_fields_set}
    points = read_points(model.path(spec.file), model.units)
    rows = [[model.units.written(value, "m") for value in point] for point in points]
    return {"points": rows, "closed": spec.closed}


def _body(
    model: Model, name: str, spec: BodySpec, folder: str | Path | None, flexbodies: Files
) -> dict[str, Any]:
    if isinstance(spec, FlexbodySpec) and name in flexbodies:
        file = Path(flexbodies[name]).as_posix()
        return _plain(spec.model_copy(update={"flexbody": file}), model.terms)
    if isinstance(spec, FlexbodySpec) and not isinstance(spec.flexbody, str):
        raise SceneError(
            f"bodies.{name}: the flexible body is an object in memory; save it and name its file"
        )
    table = _plain(spec, model.terms)
    if isinstance(table.get("mesh"), dict):
        del table["units"]  # of mesh files
    for key in ("mesh", "flexbody", "modes"):
        if isinstance(table.get(key), str) and folder is not None:
            table[key] = _relative(model.path(table[key]), Path(folder))
    return table


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.as_posix()
