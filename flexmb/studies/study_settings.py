"""The settings of a study: its source, and all combinations of the knobs' values.

In: a scene or a model, and knobs with values. Out: settings, each with its model or the reason why
the model refuses it. The kind of a knob determines what the error of a setting is measured against:

- integration options (accuracy, step, method, ...) do not change the model;
- modes, meshes, divisions of a mesh and body files are finer or coarser descriptions of the same
  machine: their settings form one group, whose reference is the finest model of the group;
- effects of flexible bodies and of the scene may be left out of the model of a machine: the
  reference has all those that the study varies;
- anything else (a speed, a mass, several dampings) makes another machine, which is a group of its
  own.
"""

from __future__ import annotations

import itertools
import math
import re
import shlex
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from flexmb.errors import FlexmbError, FlexmbWarning, Problem, SceneError
from flexmb.folders import output_folder
from flexmb.model import Model
from flexmb.model.flexible_body import MEAN_AXIS, FlexbodySpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.reading import under
from flexmb.model.scenes.dynamics import OPTIONS
from flexmb.model.scenes.effects import SWITCHES
from flexmb.model.scenes.scene import load_scene, raw_scene
from flexmb.model.scenes.study import override, resolve_knob, units_of_values
from flexmb.studies.channel_errors import add_velocity_sensors
from flexmb.studies.study_jobs import content_key, texts_of

NUMERICAL = ("accuracy", "step", "method", *OPTIONS)
"""Fields of `[dynamics]` that affect the integration only, not the model."""

_FIDELITY = (
    "modes", "mesh", "refine", "flexbody", "reduction", "mass_matrix", "stress", "residual",
)  # fmt: skip
_FINENESS = ("divisions", "elements")  # keys in the table of a mesh
_WITH_FUNCTIONS = ("drivers", "forces", "sensors", "states", "controllers")
_NAME = re.compile(r"[A-Za-z_]\w*")
_MAX_RUNS = 10_000
_DECIMAL = 1e-3  # smaller values are written with an exponent


@dataclass(frozen=True)
class StudySource:
    """A scene before knobs are changed."""

    model: Model
    scene: dict[str, Any]  # as plain data
    folder: Path  # folder that relative paths of the scene start from
    output: Path  # folder of the study
    overrides: dict[str, Any] = field(default_factory=dict)  # values changed for all settings
    file: str = ""  # the scene file; empty for a model from Python

    @classmethod
    def of(
        cls, scene: str | Path | Model, overrides: Mapping[str, Any] | None,
        output: str | Path | None, kind: str,
    ) -> StudySource:  # fmt: skip
        """The source for a scene file, with values changed for all settings, or for a model.

        Bodies of a model that are objects in memory are written to the folder.

        Raises
        ------
        SceneError
            All that is wrong with the scene.
        """
        if isinstance(scene, str | Path):
            model, home = load_scene(scene, overrides), Path(scene).resolve().parent
            folder = output_folder(scene) / kind if output is None else Path(output)
            return cls(model, raw_scene(scene), home, folder, dict(overrides or {}), str(scene))
        if overrides:
            raise SceneError("overrides are for scene files; change the model itself")
        from flexmb.flexbody import save

        model = scene
        model.validate()
        name = re.sub(r"\W+", "_", model.title.lower()).strip("_") or "model"
        folder = (Path("out") / name / kind if output is None else Path(output)).resolve()
        files: dict[str, Path] = {}
        for body, spec in model.bodies.items():
            if isinstance(spec, FlexbodySpec) and not isinstance(spec.flexbody, str):
                files[body] = Path("given") / f"{body}.flexbody.h5"
                (folder / "given").mkdir(parents=True, exist_ok=True)
                save(spec.flexbody, folder / files[body])
        return cls(model, model.to_scene_dict(folder, files), folder, folder)


def value_text(value: Any) -> str:
    """A knob's value as text; of a path its last part."""
    if isinstance(value, float):
        if not 0 < abs(value) < _DECIMAL:
            return f"{value:g}"
        mantissa, _, exponent = f"{value:.5e}".partition("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    if isinstance(value, Mapping | list | bool):
        return toml_text(value)
    return PurePath(value).name if isinstance(value, str) and "/" in value else str(value)


def toml_text(value: Any, inside: bool = False) -> str:
    """A knob's value as ``--set`` reads it; texts in tables and lists are quoted."""
    if isinstance(value, Mapping):
        parts = (f"{key} = {toml_text(one, True)}" for key, one in value.items())
        return f"{{ {', '.join(parts)} }}"
    if isinstance(value, list):
        return f"[{', '.join(toml_text(one, True) for one in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if inside and isinstance(value, str) else str(value)


def run_command(source: str, values: Mapping[str, Any]) -> str:
    """The command that runs a scene with values of its knobs."""
    changes = [f"--set {shlex.quote(f'{k}={toml_text(value)}')}" for k, value in values.items()]
    return " ".join([f"flexmb run {shlex.quote(source)}", *changes])


def markdown_table(
    columns: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[int]
) -> list[str]:
    """Lines of a table in Markdown; `right` are the columns of numbers."""
    head, *body = (" | ".join(c.replace("|", "\\|") for c in row) for row in (columns, *rows))
    rule = "|".join("---:" if i in right else "---" for i in range(len(columns)))
    return [f"| {head} |", f"|{rule}|", *(f"| {row} |" for row in body)]


def headings(knobs: Sequence[str]) -> dict[str, str]:
    """For each knob the shortest end of its path that no other knob has."""
    short: dict[str, str] = {}
    for knob in knobs:
        parts = knob.split(".")
        ends = [".".join(parts[i:]) for i in range(len(parts) - 1, -1, -1)]
        others = [other for other in knobs if other != knob]
        short[knob] = next(
            (end for end in ends if not any(f".{o}".endswith(f".{end}") for o in others)), knob
        )
    return short


def label(values: Mapping[str, Any]) -> str:
    """``modes=4, step=1e-05``."""
    short = headings(tuple(values))
    return ", ".join(f"{short[knob]}={value_text(value)}" for knob, value in values.items())


def is_numerical(knob: str) -> bool:
    """Whether a knob changes only the integration of a model."""
    return knob.removeprefix("dynamics.") in NUMERICAL


@dataclass(frozen=True, eq=False)
class Setting:
    """One combination of values of the knobs."""

    values: dict[str, Any]  # by knob
    model: Model | None = None  # None if the model refuses the values
    scene: dict[str, Any] = field(default_factory=dict)  # of the model, as plain data
    # its [dynamics] with all numbers resolved
    dynamics: dict[str, Any] = field(default_factory=dict)
    refusal: str = ""  # why the model refuses the values
    group: str = ""  # key of the machine, independent of the fineness of its description
    physics: str = ""  # key of the model, independent of its integration options
    rank: tuple[int, ...] = ()  # a larger rank is a finer model within the group
    complete: dict[str, Any] = field(default_factory=dict)  # values with all varied effects present
    complete_physics: str = ""  # key of the model with these values


def make_settings(source: StudySource, vary: Mapping[str, tuple[Any, ...]]) -> list[Setting]:
    """All settings of a study.

    Raises
    ------
    SceneError
        Unknown knobs, knobs that exclude each other, or no value that the model accepts.
    """
    knobs = resolve_knobs(source, vary, exclusive=False)
    tables = _without_conflict(knobs)
    count = sum(math.prod(len(values) for values in table.values()) for table in tables)
    if count > _MAX_RUNS:
        raise SceneError(f"the study has {count} combinations; {_MAX_RUNS} are the most")
    effects = _complete_effects(source, knobs)
    settings = [
        _make_setting(
            source, dict(zip(table, (value for _, value in choice), strict=True)), choice, effects
        )
        for table in tables
        for choice in itertools.product(*(enumerate(values) for values in table.values()))
    ]
    if all(setting.model is None for setting in settings):
        refusals = dict.fromkeys(setting.refusal for setting in settings)
        raise SceneError("the model refuses every setting of the study:\n" + "\n".join(refusals))
    return settings


def refused_values(settings: Sequence[Setting]) -> list[Problem]:
    """Values that the model refuses for all values of the other knobs."""
    good = {
        (knob, repr(value))
        for one in settings
        if one.model is not None
        for knob, value in one.values.items()
    }
    problems: dict[str, Problem] = {}
    for setting in settings:
        bad = {k: value for k, value in setting.values.items() if (k, repr(value)) not in good}
        if len(bad) == 1 or (bad and not good):  # the reason is not that of another value
            reason = setting.refusal
            where = "" if reason.startswith(f"{next(iter(bad))}:") else f"vary {label(bad)}"
            problems.setdefault(f"{where}{reason}", Problem(where, reason))
    return list(problems.values())


def change_model(source: StudySource, changes: Mapping[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The model of the source with some values changed, and its scene.

    Raises
    ------
    SceneError
        The model refuses the values.
    """
    scene, problems = override(source.scene, {**source.overrides, **changes})
    if problems:
        raise SceneError.from_problems(problems)
    for section in ("check", "results", "view", "study"):
        scene.pop(section, None)
    scene = add_velocity_sensors(scene)
    return Model.from_scene_dict(scene, source.folder), scene


def check_units(source: StudySource, vary: Mapping[str, Iterable[Any]]) -> list[Problem]:
    """Problems of values of another quantity than the unit that the scene states for their knob. A
    warning is given for numbers without that unit that seem to be in it."""
    problems: list[Problem] = []
    scene = override(source.scene, source.overrides)[0]
    for text, values in vary.items():
        name = resolve_knob(scene, text)[0]
        wrong, notes = units_of_values(scene, f"vary {text}", name, values)
        problems += wrong
        for note in notes:
            warnings.warn(note, FlexmbWarning, stacklevel=4)
    return problems


def resolve_knobs(
    source: StudySource, vary: Mapping[str, tuple[Any, ...]], *, exclusive: bool = True
) -> dict[str, tuple[Any, ...]]:
    """The knobs by their full names; accuracy and step exclude each other if `exclusive`.

    Raises
    ------
    SceneError
        Knobs that are unknown, given twice, or exclude each other.
    """
    knobs: dict[str, tuple[Any, ...]] = {}
    problems: list[Problem] = []
    for text, values in vary.items():
        name, problem = resolve_knob(source.scene, text)
        if problem is None and name in knobs:
            problem = Problem("", f'is the knob "{name}", which is given twice')
        if problem is None and not source.file and name in source.scene.get("parameters", {}):
            what = "a model made in Python has worked its parameters into its numbers already"
            problem = Problem("", f"{what}: vary the numbers by their paths, or a scene file")
        if problem is not None:
            problems += under(f"vary {text}", [problem])
        knobs[name] = tuple(values)
    if not knobs:
        problems.append(Problem("vary", 'no knob is given, such as accuracy = "1e-2..1e-6"'))
    if exclusive and set(_EITHER) <= set(knobs):
        what = "accuracy and step exclude each other: fixed steps have no accuracy; vary one"
        problems.append(Problem("vary", what))
    if problems:
        raise SceneError.from_problems(problems)
    return knobs


_EITHER = ("dynamics.accuracy", "dynamics.step")


def _without_conflict(knobs: Mapping[str, tuple[Any, ...]]) -> list[dict[str, tuple[Any, ...]]]:
    """Separate tables for knobs that exclude each other: fixed steps have no accuracy."""
    if not set(_EITHER) <= set(knobs):
        return [dict(knobs)]
    return [{k: v for k, v in knobs.items() if k != other} for other in reversed(_EITHER)]


_COMPLETE: dict[str, Any] = {
    "deformation": "dynamic", "inertia_coupling": "full", "geometric_stiffening": "full",
    "membrane_forces": "full", "frame": MEAN_AXIS, **dict.fromkeys(SWITCHES, True), "planar": False,
}  # fmt: skip


def _complete_effects(source: StudySource, knobs: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
    """Values of the effect knobs in a model that leaves nothing out.

    Raises
    ------
    SceneError
        Values of effects that the scene cannot have; all of them.
    """
    complete: dict[str, Any] = {}
    problems: list[Problem] = []
    for knob, values in knobs.items():
        section, word = knob.partition(".")[0], knob.rpartition(".")[2]
        if section == ("effects" if word in SWITCHES else "bodies") and word in _COMPLETE:
            whole = _COMPLETE[word]
        elif (
            section == "bodies" and word == "damping" and [bool(v) for v in values].count(True) == 1
        ):
            whole = next(filter(None, values))
        else:
            continue
        for value in values:
            problems += _effect_problems(source, {knob: value})
        if len(values) > 1 and not problems:
            refused = whole not in values and _effect_problems(source, {knob: whole})
            complete[knob] = values[-1] if refused else whole
    if problems:
        raise SceneError.from_problems(list(dict.fromkeys(problems)))
    return complete


def _effect_problems(source: StudySource, changes: Mapping[str, Any]) -> list[Problem]:
    """Problems of a value, and data that files of reduced bodies lack for it."""
    from flexmb.flexbody import load

    try:
        model = change_model(source, changes)[0]
    except SceneError as error:
        return list(error.problems)
    problems: list[Problem] = []
    for name, spec in model.bodies.items():
        if isinstance(spec, FlexbodySpec) and isinstance(spec.flexbody, str):
            try:
                spec.simulated(load(model.path(spec.flexbody)))
            except FlexmbError as error:
                problems += under(f"bodies.{name}", error.problems)
    return problems


def _make_setting(
    source: StudySource,
    values: dict[str, Any],
    choice: tuple[tuple[int, Any], ...],
    effects: Mapping[str, Any],
) -> Setting:
    try:
        model, scene = change_model(source, values)
    except SceneError as error:
        return Setting(values, refusal=str(error))
    if model.dynamics is None:
        return Setting(values, refusal="the scene has no [dynamics]: give its duration")
    dynamics = model.to_scene_dict(source.folder)["dynamics"]
    machine, fidelity = _split_scene(model, source.folder)
    texts = zip(values, choice, strict=True)  # values later in the list are finer
    places = (i for knob, (i, value) in texts if isinstance(value, str) and knob not in effects)
    meshed = [spec for spec in model.bodies.values() if isinstance(spec, MeshBodySpec)]
    rank = (sum(spec.cells for spec in meshed), sum(spec.mode_count for spec in meshed))
    complete = {**values, **effects}
    whole = machine, fidelity
    if complete != values:
        try:
            whole = _split_scene(change_model(source, complete)[0], source.folder)
        except SceneError as error:
            return Setting(values, refusal=str(error))
    return Setting(
        values, model, scene, dynamics, "", content_key(whole[0]), content_key([machine, fidelity]),
        (*places, *rank), complete, content_key(whole),
    )  # fmt: skip


def _split_scene(model: Model, folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The part of a scene that defines the machine, and the fineness of its description."""
    scene = model.to_scene_dict(folder)
    fidelity = {
        name: {key: _take_out(body, key) for key in _FIDELITY if key in body}
        for name, body in scene["bodies"].items()
    }
    for name in NUMERICAL:
        scene["dynamics"].pop(name, None)
    scene["parameters"] = _parameters_in_functions(scene)
    return scene, fidelity


def _take_out(body: dict[str, Any], key: str) -> Any:
    """Remove an entry of a body and return it; of the table of a mesh only its divisions."""
    value = body[key]
    if not isinstance(value, dict) or key != "mesh":
        return body.pop(key)
    return {word: value.pop(word) for word in _FINENESS if word in value}


def _parameters_in_functions(scene: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters in functions of time, the only ones that are not resolved to numbers."""
    parameters = scene.get("parameters", {})
    used: dict[str, Any] = {}
    texts = list(texts_of([scene.get(section, {}) for section in _WITH_FUNCTIONS]))
    while texts:
        for name in _NAME.findall(texts.pop()):
            if name in parameters and name not in used:
                used[name] = parameters[name]
                texts.append(str(parameters[name]))
    return dict(sorted(used.items()))
