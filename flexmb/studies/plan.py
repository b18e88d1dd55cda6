"""The plan of a study: every combination of the knobs' values, and which runs share a truth.

In: a scene or a model, and knobs with values. Out: settings, each with its model or the reason why
the model refuses it. What a knob changes decides what its error is measured against:

- numbers of the integration (accuracy, step, method, ...) leave the model as it is;
- modes, meshes, divisions of a mesh and body files say how well one and the same machine is
  described: their settings form one group, whose truth is the finest model of the group;
- anything else (a speed, a mass, a damping) makes another machine: a group and a truth of its own.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, SceneError
from flexmb.model import Model
from flexmb.model.bodies.meshbody import MeshBodySpec
from flexmb.model.tasks.dynamics import OPTIONS
from flexmb.model.tasks.study import override, resolve_knob
from flexmb.model.values.reading import under
from flexmb.studies.sensing import with_velocities
from flexmb.studies.store import content_key

if TYPE_CHECKING:
    from flexmb.studies.base import Base

__all__ = ["NUMERICAL", "Setting", "changed_model", "is_numerical", "settings_of"]

NUMERICAL = ("accuracy", "step", "method", *OPTIONS)
"""Fields of `[dynamics]` that say how a model is integrated, not what it is."""

_FIDELITY = ("modes", "mesh", "flexbody", "reduction", "mass_matrix", "stress")
_FINENESS = ("divisions", "elements")  # of the table of a mesh
_NAME = re.compile(r"[A-Za-z_]\w*")
_MOST = 10_000  # runs of one study


def is_numerical(knob: str) -> bool:
    """Whether a knob only changes how a model is integrated."""
    return knob.removeprefix("dynamics.") in NUMERICAL


@dataclass(frozen=True, eq=False)
class Setting:
    """One combination of values.

    Attributes
    ----------
    values : dict
        Knob to value, as given.
    model : Model or None
        The model; None where it refuses the values.
    scene : dict
        The scene of the model as plain data.
    dynamics : dict
        Its `[dynamics]` with all numbers worked out, as the scene would write them.
    refusal : str
        Why the model refuses the values.
    group : str
        Key of the machine that is described, however finely.
    physics : str
        Key of the model, apart from the numbers of its integration.
    rank : tuple
        The larger, the finer the model within its group.
    """

    values: dict[str, Any]
    model: Model | None = None
    scene: dict[str, Any] = field(default_factory=dict)
    dynamics: dict[str, Any] = field(default_factory=dict)
    refusal: str = ""
    group: str = ""
    physics: str = ""
    rank: tuple[int, ...] = ()


def settings_of(base: Base, vary: Mapping[str, tuple[Any, ...]]) -> list[Setting]:
    """All settings of a study.

    Raises
    ------
    SceneError
        Unknown knobs, knobs that exclude each other, or values of which the model takes none.
    """
    knobs = _resolved(base, vary)
    count = 1
    for values in knobs.values():
        count *= len(values)
    if count > _MOST:
        raise SceneError(f"the study has {count} combinations; {_MOST} are the most")
    settings = [
        _setting(base, dict(zip(knobs, (value for _, value in chosen), strict=True)), chosen)
        for chosen in itertools.product(*(enumerate(values) for values in knobs.values()))
    ]
    if all(setting.model is None for setting in settings):
        refusals = dict.fromkeys(setting.refusal for setting in settings)
        raise SceneError("the model refuses every setting of the study:\n" + "\n".join(refusals))
    return settings


def changed_model(base: Base, changes: Mapping[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The model of the base scene with some values changed, and that scene.

    Raises
    ------
    SceneError
        The model refuses the values.
    """
    scene, problems = override(base.scene, {**base.changes, **changes})
    if problems:
        raise SceneError.from_problems(problems)
    for section in ("check", "results", "view", "study"):
        scene.pop(section, None)
    scene = with_velocities(scene)
    return Model.from_scene_dict(scene, base.folder), scene


def _resolved(base: Base, vary: Mapping[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    knobs: dict[str, tuple[Any, ...]] = {}
    problems: list[Problem] = []
    for given, values in vary.items():
        name, problem = resolve_knob(base.scene, given)
        if problem is None and name in knobs:
            problem = Problem("", f'is the knob "{name}", which is given twice')
        if problem is None and base.resolved and name in base.scene.get("parameters", {}):
            what = "a model made in Python has worked its parameters into its numbers already"
            problem = Problem("", f"{what}: vary the numbers by their paths, or a scene file")
        if problem is not None:
            problems += under(f"vary {given}", [problem])
        knobs[name] = tuple(values)
    if not knobs:
        problems.append(Problem("vary", 'no knob is given, such as accuracy = "1e-2..1e-6"'))
    if {"dynamics.accuracy", "dynamics.step"} <= set(knobs):
        what = "accuracy and step exclude each other: fixed steps know no accuracy; study one"
        problems.append(Problem("vary", what))
    if problems:
        raise SceneError.from_problems(problems)
    return knobs


def _setting(base: Base, values: dict[str, Any], chosen: tuple[tuple[int, Any], ...]) -> Setting:
    try:
        model, scene = changed_model(base, values)
    except SceneError as error:
        return Setting(values, refusal=str(error))
    if model.dynamics is None:
        return Setting(values, refusal="the scene has no [dynamics]: give its duration")
    dynamics = model.to_scene_dict(base.folder)["dynamics"]
    machine, fidelity = _parts(model, base.folder)
    places = (i for i, value in chosen if isinstance(value, str))  # later in the list: finer
    specs = model.bodies.values()
    meshed = [spec for spec in specs if isinstance(spec, MeshBodySpec)]
    rank = (sum(spec.cells for spec in meshed), sum(spec.mode_count for spec in meshed))
    group = content_key(machine)
    physics = content_key([group, fidelity])
    return Setting(values, model, scene, dynamics, "", group, physics, (*places, *rank))


def _parts(model: Model, folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The scene that says which machine it is, and what says how finely it is described."""
    scene = model.to_scene_dict(folder)
    fidelity = {
        name: {key: _taken(body, key) for key in _FIDELITY if key in body}
        for name, body in scene["bodies"].items()
    }
    for name in NUMERICAL:
        scene["dynamics"].pop(name, None)
    scene["parameters"] = _used(scene)
    return scene, fidelity


def _taken(body: dict[str, Any], key: str) -> Any:
    """An entry of a body, taken out of it; of the table of a mesh only how it is divided."""
    value = body[key]
    if not isinstance(value, dict) or key != "mesh":
        return body.pop(key)
    return {word: value.pop(word) for word in _FINENESS if word in value}


_WITH_FUNCTIONS = ("drivers", "forces", "sensors", "states", "controllers")


def _used(scene: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters in functions of time, which alone are not worked into numbers."""
    parameters = scene.get("parameters", {})
    used: dict[str, Any] = {}
    texts = list(_texts([scene.get(section, {}) for section in _WITH_FUNCTIONS]))
    while texts:
        for name in _NAME.findall(texts.pop()):
            if name in parameters and name not in used:
                used[name] = parameters[name]
                texts.append(str(parameters[name]))
    return dict(sorted(used.items()))


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for inside in value.values():
            yield from _texts(inside)
    elif isinstance(value, list | tuple):
        for inside in value:
            yield from _texts(inside)
