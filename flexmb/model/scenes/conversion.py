"""A scene as plain data: dictionaries, lists, numbers and texts, as JSON or TOML hold them.

Into a model, with all mistakes of the scene reported at once: first each table by itself, then the
references between them. And out of a model: a scene that reads back as the same model. Numbers are
resolved, in the model's unit system, such that reading gives the same to the last bit; functions of
time stay as they were written, with the parameters they use.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.folders import relative_path
from flexmb.model.body import BodySpec, MeshShape
from flexmb.model.flexible_body import FlexbodySpec
from flexmb.model.joints.curve import CurveSpec, read_curve_file
from flexmb.model.lookup import ModelData
from flexmb.model.markers import GroundSpec
from flexmb.model.plane import read_plane
from flexmb.model.quantities import Acceleration, plain, read_axis
from flexmb.model.reading import ReadContext, Spec, bad_name, quote, read_entry, under
from flexmb.model.scenes.consistency import model_problems
from flexmb.model.scenes.dynamics import (
    AssemblySpec,
    DynamicsSpec,
    KinematicsSpec,
    StaticsSpec,
    ValiditySpec,
)
from flexmb.model.scenes.effects import EffectsSpec, effects_table
from flexmb.model.scenes.parameters import resolve_parameters
from flexmb.model.scenes.sections import (
    CHECK_LISTS,
    SECTIONS,
    ResultsSpec,
    ViewSpec,
    check_kind,
    read_named,
    unknown_section,
)
from flexmb.model.scenes.study import StudySpec, resolve_knob
from flexmb.model.scenes.supports import PartSpec
from flexmb.model.scenes.sweep import SweepSpec
from flexmb.units import SI, UnitSystem, unit_system

# standard gravity [m/s^2], exact: 3rd General Conference on Weights and Measures, 1901
_STANDARD = 9.80665
_EARTH = re.compile(r"earth\s+(?P<down>[+-]?[xyz])\Z")


class _Gravity(Spec):
    gravity: Acceleration


def read_units(value: Any) -> tuple[UnitSystem, list[Problem]]:
    """The unit system of a scene; SI and the problem if there is no such system."""
    try:
        return unit_system(value), []
    except FlexmbError as error:
        return SI, list(error.problems)


def read_gravity(
    value: Any, names: ReadContext
) -> tuple[tuple[float, float, float] | None, list[Problem]]:
    """Acceleration of gravity in global axes [m/s^2]; None without gravity.

    ``"earth -z"`` is standard gravity along a global direction.
    """
    if value is None or value == "none":
        return None, []
    if isinstance(value, str):
        match = _EARTH.match(value)
        if match:
            x, y, z = (_STANDARD * c for c in read_axis(match["down"], names))
            return (x, y, z), []
        allowed = ("none", "[gx, gy, gz]", "earth -z", "earth -y")
        return None, [Problem("gravity", f'unknown gravity "{value}"', allowed)]
    if isinstance(value, int | float):
        what = f"is a vector or has a direction, given {value}"
        return None, [Problem("gravity", what, ("none", "[gx, gy, gz]", "earth -z", "earth -y"))]
    spec, problems = read_entry(_Gravity, {"gravity": value}, names)
    return (spec.gravity if spec else None), problems


def gravity_in_words(gravity: Iterable[float] | str | None, units: UnitSystem) -> str:
    """Gravity in words, given in the units of a scene: its components, or that there is none.

    >>> gravity_in_words([0, 0, -9810], unit_system("mm-t-s"))
    'gravity: (0, 0, -9810) mm/s²'
    """
    if gravity is None or isinstance(gravity, str):
        return "gravity: none"
    parts = ", ".join(f"{g:g}" for g in gravity)
    return f"gravity: ({parts}) {units.label('m/s^2', raised=True)}"


TOP_KEYS = (
    "title", "units", "plane", "gravity", "parameters", "effects", "budget", "ground", *SECTIONS,
    "assembly", "check", "dynamics", "kinematics", "part", "results", "statics", "study",
    "sweep", "validity", "view",
)  # fmt: skip
"""All keys allowed at the top level of a scene."""

SINGLE_TABLES: dict[str, type[Spec]] = {
    "assembly": AssemblySpec,
    "dynamics": DynamicsSpec,
    "effects": EffectsSpec,
    "kinematics": KinematicsSpec,
    "part": PartSpec,
    "results": ResultsSpec,
    "statics": StaticsSpec,
    "study": StudySpec,
    "sweep": SweepSpec,
    "validity": ValiditySpec,
}
"""Tables that occur at most once in a scene."""

M = TypeVar("M", bound=ModelData)
S = TypeVar("S", bound=Spec)


def build(create: Callable[..., M], scene: Mapping[str, Any], folder: Path) -> M:
    """Build and check a model.

    Raises
    ------
    SceneError
        All problems of the scene.
    """
    units, problems = read_units(scene.get("units", "SI"))
    model = create(folder=folder, units=units)
    builder = _Builder(model, scene)
    builder.problems += problems
    builder.head()
    for section in SECTIONS:
        builder.section(section)
    builder.rest()
    problems = [*builder.problems, *model_problems(model, {}, builder.broken)]
    if problems:
        raise SceneError.from_problems(problems)
    return model


class _Builder:
    """Fills a model; collects the raw tables of entries that could not be read in ``broken``."""

    def __init__(self, model: ModelData, scene: Mapping[str, Any]) -> None:
        self.model, self.scene = model, scene
        self.names = ReadContext({}, model.units, folder=model.folder)
        self.problems: list[Problem] = []
        self.broken: dict[str, dict[str, Any]] = {section: {} for section in SECTIONS}

    def head(self) -> None:
        self.problems += [unknown_section(k, TOP_KEYS) for k in self.scene if k not in TOP_KEYS]
        title = self.scene.get("title", "")
        if not isinstance(title, str):
            self.problems.append(Problem("title", f"text is expected, given {quote(title)}"))
            title = ""
        self.model.title = title
        parameters = plain(self.table("parameters"))
        values, problems = resolve_parameters(parameters, self.model.units)
        self.problems += problems
        self.model.parameter_sources, self.model.parameters = parameters, values
        # A wrong parameter is reported once, not wherever it is used: one with a bad name has its
        # number there, any other one is 1.
        sources = {str(name): value for name, value in parameters.items()}
        numbers = {n: float(x) if type(x) in (int, float) else 1.0 for n, x in sources.items()}
        numbers |= values
        self.names = ReadContext(numbers, self.model.units, folder=self.model.folder)
        self.model.plane, problems = read_plane(self.scene.get("plane"))
        self.problems += problems
        self.model.gravity, problems = read_gravity(self.scene.get("gravity"), self.names)
        self.problems += problems

    def table(self, key: str) -> Mapping[str, Any]:
        value = self.scene.get(key, {})
        if isinstance(value, Mapping):
            return value
        self.problems.append(Problem(key, f"a table is expected, given {quote(value)}"))
        return {}

    def section(self, section: str) -> None:
        entries = getattr(self.model, section)
        for name, data in self.table(section).items():
            spec, problems = read_named(section, name, data, self.names)
            self.problems += problems
            if spec is None:
                self.broken[section][str(name)] = data
            else:
                entries[name] = spec

    def rest(self) -> None:
        ground = self.single("ground", GroundSpec)
        if ground is not None:
            bad = [bad_name(name) for name in ground.markers]
            self.problems += [Problem("ground.markers", what) for what in bad if what]
            self.model.ground = ground
        for key, kind in SINGLE_TABLES.items():
            if key in self.scene or (key == "effects" and "budget" in self.scene):
                setattr(self.model, key, self.single(key, kind))
                if getattr(self.model, key) is None:
                    self.broken[key] = {key: self.scene.get(key)}
        for section in ("study", "sweep"):
            for name in getattr(getattr(self.model, section), "vary", ()):
                problem = resolve_knob(self.scene, name)[1]
                if problem is not None:
                    self.problems += under(f"{section}.vary.{name}", [problem])
        self.model.view = self.single("view", ViewSpec) or ViewSpec()
        checks = self.scene.get("check", [])
        if not isinstance(checks, list | tuple):
            self.problems.append(Problem("check", "is a list of tables: write [[check]]"))
            checks = []
        for i, data in enumerate(checks):
            table = data if isinstance(data, Mapping) else {}
            check = check_kind(table)
            unit = self.model.check_unit(table)
            context = ReadContext(self.names, self.model.units, unit)
            spec, problems = read_entry(check, data, context)
            self.problems += under(f"check[{i}]", problems)
            if spec is not None:
                getattr(self.model, CHECK_LISTS[check]).append(spec)

    def single(self, key: str, cls: type[S]) -> S | None:
        data = effects_table(self.scene) if key == "effects" else self.scene.get(key, {})
        spec, problems = read_entry(cls, data, self.names)
        self.problems += under(key, problems)
        return spec


Files = Mapping[str, str | Path]


def scene_dict(model: ModelData, folder: str | Path | None, flexbodies: Files) -> dict[str, Any]:
    """The scene of a model; see :meth:`Model.to_scene_dict`."""
    scene: dict[str, Any] = {
        "title": model.title,
        "units": model.units.name,
        "plane": model.plane,
        "gravity": _gravity(model),
        "parameters": dict(model.parameter_sources),
        "ground": _plain(model.ground, model.context),
        "bodies": {
            name: _body(model, name, spec, folder, flexbodies)
            for name, spec in model.bodies.items()
        },
    }
    if model.curves:
        scene["curves"] = {name: _curve(model, spec) for name, spec in model.curves.items()}
    for section in ("joints", "couplers", "drivers", "forces", "sensors", "states", "controllers"):
        scene[section] = {
            name: _plain(spec, model.context) for name, spec in getattr(model, section).items()
        }
    checks = [spec for checks in CHECK_LISTS.values() for spec in getattr(model, checks)]
    scene["check"] = [_plain(spec, model.check_context(vars(spec))) for spec in checks]
    for section in SINGLE_TABLES:
        spec = getattr(model, section)
        if spec is not None:
            scene[section] = _plain(spec, model.context)
    scene["view"] = _plain(model.view, model.context)
    return {key: value for key, value in scene.items() if value or key == "title"}


def reduced_scene(scene: Mapping[str, Any], flexbodies: Mapping[str, Path]) -> dict[str, Any]:
    """A scene with its flexible bodies from these files, so that no mesh is needed.

    A part by itself needs one, and is left out with its known answers.
    """
    bodies = dict(scene.get("bodies", {}))
    for name, path in flexbodies.items():
        fields = {key: value for key, value in bodies[name].items() if key in BodySpec.model_fields}
        bodies[name] = {**fields, "flexbody": str(path.resolve())}
    checks = [check for check in scene.get("check", []) if "part" not in check]
    rest = {key: value for key, value in scene.items() if key != "part"}
    return {**rest, "bodies": bodies, "check": checks}


def _gravity(model: ModelData) -> Any:
    if model.gravity is None:
        return "none"
    return [model.units.written(g, "m/s^2") for g in model.gravity]


def _plain(spec: Spec, terms: ReadContext) -> dict[str, Any]:
    return spec.model_dump(mode="json", exclude_none=True, context=terms)


def _curve(model: ModelData, spec: CurveSpec) -> dict[str, Any]:
    """The table of a curve; one from a file gets the points of the file."""
    if spec.file is None:
        table = _plain(spec, model.context)
        return {key: value for key, value in table.items() if key in spec.model_fields_set}
    points = read_curve_file(model.path(spec.file), model.units)
    rows = [[model.units.written(value, "m") for value in point] for point in points]
    return {"points": rows, "closed": spec.closed}


def _body(
    model: ModelData, name: str, spec: BodySpec, folder: str | Path | None, flexbodies: Files
) -> dict[str, Any]:
    if isinstance(spec, FlexbodySpec) and name in flexbodies:
        file = Path(flexbodies[name]).as_posix()
        return _plain(spec.model_copy(update={"flexbody": file}), model.context)
    if isinstance(spec, FlexbodySpec) and not isinstance(spec.flexbody, str):
        raise SceneError(
            f"bodies.{name}: the flexible body is an object in memory; save it and name its file"
        )
    table = _plain(spec, model.context)
    if table.get("interfaces") == {}:  # of a part by itself
        del table["interfaces"]
    if isinstance(table.get("mesh"), dict):
        del table["units"]  # units of mesh files
    shape = getattr(spec, "shape", None)
    if isinstance(shape, MeshShape) and folder is not None:  # the scene holds all of it
        table["shape"] = shape.packed
    for key in ("mesh", "flexbody", "modes"):
        if isinstance(table.get(key), str) and folder is not None:
            table[key] = relative_path(model.path(table[key]), Path(folder))
    return table
