"""A model from a scene as plain data, with all mistakes of the scene found at once.

In: the dictionaries of a scene. Out: the model, or one :class:`SceneError` with every problem:
first each table by itself, then how they fit together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flexmb.errors import Problem, SceneError
from flexmb.model.bodies.markers import GroundSpec
from flexmb.model.plane import read_plane
from flexmb.model.scenes import references
from flexmb.model.scenes.entries import SECTIONS, read_named
from flexmb.model.scenes.head import read_gravity, read_units
from flexmb.model.tasks.assembly import AssemblySpec
from flexmb.model.tasks.checks import CheckSpec, FrequencyCheckSpec
from flexmb.model.tasks.dynamics import DynamicsSpec
from flexmb.model.tasks.kinematics import KinematicsSpec
from flexmb.model.tasks.knobs import resolve_knob
from flexmb.model.tasks.results import ResultsSpec
from flexmb.model.tasks.study import StudySpec
from flexmb.model.tasks.view import ViewSpec
from flexmb.model.values.names import bad_name
from flexmb.model.values.parameters import resolve
from flexmb.model.values.quantities import plain
from flexmb.model.values.reading import Spec, Terms, given, read_entry, under, unknown_key

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["TOP_KEYS", "build"]

TOP_KEYS = (
    "title", "units", "plane", "gravity", "parameters", "ground", *SECTIONS, "assembly", "check",
    "dynamics", "kinematics", "results", "study", "view",
)  # fmt: skip
"""Everything a scene may say at its top level."""

M = TypeVar("M", bound="Model")
S = TypeVar("S", bound=Spec)


def build(cls: type[M], scene: Mapping[str, Any], folder: Path) -> M:
    """Build and check a model.

    Raises
    ------
    SceneError
        All problems of the scene.
    """
    units, problems = read_units(scene.get("units", "SI"))
    builder = _Builder(cls(folder=folder, units=units), scene)
    builder.problems += problems
    builder.head()
    for section in SECTIONS:
        builder.section(section)
    builder.rest()
    found = builder.problems
    found += references.problems(builder.model, {}, builder.broken)
    if found:
        raise SceneError.from_problems(found)
    model: M = builder.model  # type: ignore[assignment]
    return model


class _Builder:
    """Fills a model; keeps the raw tables of entries that cannot be read in ``broken``."""

    def __init__(self, model: Model, scene: Mapping[str, Any]) -> None:
        self.model, self.scene = model, scene
        self.names = Terms({}, model.units, folder=model.folder)
        self.problems: list[Problem] = []
        self.broken: dict[str, dict[str, Any]] = {section: {} for section in SECTIONS}

    def head(self) -> None:
        self.problems += [unknown_key(key, TOP_KEYS) for key in self.scene if key not in TOP_KEYS]
        title = self.scene.get("title", "")
        if not isinstance(title, str):
            self.problems.append(Problem("title", f"text is expected, given {given(title)}"))
            title = ""
        self.model.title = title
        parameters = plain(self.table("parameters"))
        values, problems = resolve(parameters, self.model.units)
        self.problems += problems
        self.model.given_parameters, self.model.parameters = parameters, values
        # A wrong parameter is reported once, not again wherever it is used.
        known = {**dict.fromkeys(map(str, parameters), 1.0), **values}
        self.names = Terms(known, self.model.units, folder=self.model.folder)
        self.model.plane, problems = read_plane(self.scene.get("plane"))
        self.problems += problems
        self.model.gravity, problems = read_gravity(self.scene.get("gravity"), self.names)
        self.problems += problems

    def table(self, key: str) -> Mapping[str, Any]:
        value = self.scene.get(key, {})
        if isinstance(value, Mapping):
            return value
        self.problems.append(Problem(key, f"a table is expected, given {given(value)}"))
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
        if "dynamics" in self.scene:
            self.model.dynamics = self.single("dynamics", DynamicsSpec)
        if "kinematics" in self.scene:
            self.model.kinematics = self.single("kinematics", KinematicsSpec)
        if "assembly" in self.scene:
            self.model.assembly = self.single("assembly", AssemblySpec)
        if "results" in self.scene:
            self.model.results = self.single("results", ResultsSpec)
        if "study" in self.scene:
            self.model.study = self.single("study", StudySpec)
            self.knobs(self.model.study.vary if self.model.study else ())
        self.model.view = self.single("view", ViewSpec) or ViewSpec()
        checks = self.scene.get("check", [])
        if not isinstance(checks, list | tuple):
            self.problems.append(Problem("check", "is a list of tables: write [[check]]"))
            checks = []
        for i, data in enumerate(checks):
            if isinstance(data, Mapping) and "body" in data:
                frequency, problems = read_entry(FrequencyCheckSpec, data, self.names)
                self.problems += under(f"check[{i}]", problems)
                if frequency is not None:
                    self.model.frequency_checks.append(frequency)
                continue
            channel = data.get("sensor") if isinstance(data, Mapping) else None
            slot = self.model.channel_unit(channel) if isinstance(channel, str) else None
            terms = Terms(self.names, self.model.units, slot)
            spec, problems = read_entry(CheckSpec, data, terms)
            self.problems += under(f"check[{i}]", problems)
            if spec is not None:
                self.model.checks.append(spec)

    def knobs(self, names: Iterable[str]) -> None:
        for name in names:
            problem = resolve_knob(self.scene, name)[1]
            if problem is not None:
                self.problems += under(f"study.vary.{name}", [problem])

    def single(self, key: str, cls: type[S]) -> S | None:
        spec, problems = read_entry(cls, self.scene.get(key, {}), self.names)
        self.problems += under(key, problems)
        return spec
