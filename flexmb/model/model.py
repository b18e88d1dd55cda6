"""The model: bodies, joints, forces and so on by name, validated and ready to be compiled.

In: a scene file (:func:`flexmb.load_scene`) or calls with the same words. Out: dictionaries of
frozen specifications in SI. The model stores and names them; :mod:`flexmb.model.scenes.consistency`
checks whether its parts fit together, the engine compiles it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeVar

from flexmb.errors import FlexmbWarning, Problem, SceneError
from flexmb.model import lookup
from flexmb.model.body import BodySpec
from flexmb.model.control import ControllerSpec, StateSpec
from flexmb.model.joints.coupler import Coupler, repeated_couplers
from flexmb.model.joints.curve import CurveSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.gear import unequal_teeth
from flexmb.model.joints.joint import JointSpec
from flexmb.model.lookup import Component
from flexmb.model.markers import GroundSpec, MarkerSpec
from flexmb.model.plane import read_plane
from flexmb.model.quantities import plain
from flexmb.model.reading import GROUND, ReadContext, Spec, read_entry, split_reference, under
from flexmb.model.scenes.consistency import model_problems, model_warnings
from flexmb.model.scenes.conversion import build, read_gravity, scene_dict
from flexmb.model.scenes.dynamics import (
    AssemblySpec,
    DynamicsSpec,
    KinematicsSpec,
    StaticsSpec,
    ValiditySpec,
)
from flexmb.model.scenes.effects import EffectsSpec
from flexmb.model.scenes.parameters import resolve_parameters
from flexmb.model.scenes.sections import (
    CHECK_LISTS,
    CheckSpec,
    FrequencyCheckSpec,
    ModeCheckSpec,
    ResultsSpec,
    ViewSpec,
    check_kind,
    read_named,
)
from flexmb.model.scenes.study import StudySpec
from flexmb.model.scenes.supports import PartCheckSpec, PartSpec, part_unit
from flexmb.model.scenes.sweep import SweepSpec
from flexmb.model.sensor import SensorSpec, channels_of, unit_of
from flexmb.units import UnitSystem, unit_system

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody

S = TypeVar("S", bound=Spec)


class Source(NamedTuple):
    """The scene file that a model was read from, and the overrides applied to it."""

    path: Path
    text: str
    overrides: Mapping[str, Any] = MappingProxyType({})


_LISTED = 12  # names listed per section in notebooks


class Model:
    """A flexible multibody model.

    Parameters
    ----------
    title : str
        Name of the model.
    units : str
        Unit system of all numbers given to the model, such as ``"mm-t-s"``, and of its
        results; internally everything is in SI, and angles are in rad.
    parameters : mapping, optional
        Numbers or expressions that all other numbers may use by name.
    gravity : three numbers or str, optional
        Acceleration of gravity, global axes, or ``"earth -z"``; none by default.
    plane : {"xy", "yz", "zx"}, optional
        The global plane in which everything moves; None: motion in space.
    folder : path, optional
        Folder that relative paths of meshes start from; the current folder by default.
    """

    def __init__(
        self,
        title: str = "",
        *,
        units: str | UnitSystem = "SI",
        parameters: Mapping[str, Any] | None = None,
        gravity: Any = None,
        plane: str | None = None,
        folder: str | Path = ".",
    ) -> None:
        self.title = title
        self.folder = Path(folder)
        self.parameter_sources: dict[str, Any] = plain(parameters or {})
        self.units = unit_system(units)
        self.parameters, problems = resolve_parameters(self.parameter_sources, self.units)
        _raise(problems)
        self.gravity: tuple[float, float, float] | None = None
        self.set_gravity(gravity)
        self.plane, problems = read_plane(plane)
        _raise(problems)
        self.ground = GroundSpec()
        self.bodies: dict[str, BodySpec] = {}
        self.curves: dict[str, CurveSpec] = {}
        self.joints: dict[str, JointSpec] = {}
        self.couplers: dict[str, Coupler] = {}
        self.drivers: dict[str, DriverSpec] = {}
        self.forces: dict[str, Component] = {}
        self.sensors: dict[str, SensorSpec] = {}
        self.states: dict[str, StateSpec] = {}
        self.controllers: dict[str, ControllerSpec] = {}
        self.checks: list[CheckSpec] = []
        self.frequency_checks: list[FrequencyCheckSpec] = []
        self.mode_checks: list[ModeCheckSpec] = []
        self.part_checks: list[PartCheckSpec] = []
        self.assembly: AssemblySpec | None = None
        self.dynamics: DynamicsSpec | None = None
        self.effects: EffectsSpec | None = None
        self.results: ResultsSpec | None = None
        self.kinematics: KinematicsSpec | None = None
        self.statics: StaticsSpec | None = None
        self.part: PartSpec | None = None
        self.study: StudySpec | None = None
        self.sweep: SweepSpec | None = None
        self.validity: ValiditySpec | None = None
        self.view = ViewSpec()
        self.budget = 0.01
        self.source: Source | None = None

    def __repr__(self) -> str:
        counts = ", ".join(
            f"{len(getattr(self, section))} {section}"
            for section in ("bodies", "joints", "couplers", "drivers", "forces", "sensors")
        )
        return f"Model({self.title!r}: {counts})"

    def _repr_html_(self) -> str:
        """What notebooks show: the names in each section, and how bodies are joined."""
        rows = []
        for section in ("bodies", "joints", "couplers", "drivers", "forces", "sensors"):
            parts = getattr(self, section)
            names = [
                f"{name} ({', '.join(getattr(part, 'between', None) or ())})".replace(" ()", "")
                for name, part in parts.items()
            ]
            more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
            if names:
                cells = f"{len(names)} {section}", ", ".join(names[:_LISTED]) + more
                rows.append("".join(f'<td style="text-align:left">{escape(c)}</td>' for c in cells))
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<div><strong>{escape(self.title)}</strong><table>{body}</table></div>"

    @property
    def context(self) -> ReadContext:
        """Parameters and units by which numbers given to this model are read."""
        return ReadContext(self.parameters, self.units, folder=self.folder)

    def add_body(
        self, name: str, body: FlexBody | BodySpec | None = None, **fields: Any
    ) -> BodySpec:
        """Add a body: a FlexBody, or the fields of ``[bodies.name]``."""
        data: Any = fields
        if isinstance(body, Spec):
            data = body
        elif body is not None:
            data = {"flexbody": body, **fields}
        spec = self._add("bodies", name, data)
        assert isinstance(spec, BodySpec)
        return spec

    def add_marker(self, reference: str, **fields: Any) -> MarkerSpec:
        """Add the marker ``"body.name"`` (or ``"ground.name"``)."""
        body, name = split_reference(reference)
        owner = self.ground if body == GROUND else self.bodies.get(body)
        if owner is None:
            lookup.find(self, body)  # raises an error that lists the bodies
        assert owner is not None
        spec, problems = read_named("markers", name, fields, self.context)
        where = f"{body}.markers.{name}" if body == GROUND else f"bodies.{body}.markers.{name}"
        own = f"markers.{name}"
        problems = [replace(p, where=where + p.where.removeprefix(own)) for p in problems]
        if lookup.has_marker(self, body, name):
            cure = "" if "." in reference else f'; a marker is named as "{body}.tip"'
            problems.append(Problem(where, f'the name "{name}" is used twice{cure}'))
        _raise(problems)
        assert isinstance(spec, MarkerSpec)
        if isinstance(owner, BodySpec):  # perhaps the body of another model as well
            owner = owner.model_copy(update={"markers": {**owner.markers, name: spec}})
            self.bodies[body] = owner
        else:
            owner.markers[name] = spec
        return spec

    def add_curve(self, name: str, **fields: Any) -> Spec:
        """Add the shape of a curve that joints slide along: ``points``, ``polar``, ..."""
        return self._add("curves", name, fields)

    def add_joint(self, name: str, type: str, **fields: Any) -> JointSpec:
        """Add a joint: ``between=[I, J]``, ``axis``."""
        spec = self._add("joints", name, {"type": type, **fields})
        assert isinstance(spec, JointSpec)
        return spec

    def add_coupler(self, name: str, type: str, **fields: Any) -> Spec:
        """Add a gear, a rack and pinion, or a linear coupler of joint coordinates."""
        return self._add("couplers", name, {"type": type, **fields})

    def add_driver(self, name: str, **fields: Any) -> DriverSpec:
        """Add a driver: ``joint`` and one of ``angle`` and ``stroke``."""
        spec = self._add("drivers", name, fields)
        assert isinstance(spec, DriverSpec)
        return spec

    def add_force(self, name: str, type: str, **fields: Any) -> Spec:
        """Add a force, a torque, a spring-damper, bushing, beam or stop."""
        return self._add("forces", name, {"type": type, **fields})

    def add_sensor(self, name: str, type: str, **fields: Any) -> Spec:
        """Add a sensor."""
        return self._add("sensors", name, {"type": type, **fields})

    def add_state(self, name: str, **fields: Any) -> Spec:
        """Add a state: ``rate``, an expression over channels and t, and its ``start``."""
        return self._add("states", name, fields)

    def add_controller(self, name: str, type: str, **fields: Any) -> Spec:
        """Add a controller: ``input``, an expression over channels and t; its name is a channel."""
        return self._add("controllers", name, {"type": type, **fields})

    def add_check(
        self, **fields: Any
    ) -> CheckSpec | FrequencyCheckSpec | ModeCheckSpec | PartCheckSpec:
        """Add a known answer: ``sensor``, ``time``, ``value``, ``tolerance``, ``source``.

        Of a natural frequency: ``body``, ``held``, ``mode``, ``value``, ``tolerance``, ``source``.
        Of a linearised mode: ``linear_mode``, ``parameters`` and these. Of a part by itself:
        ``part``, its quantity, and these.
        """
        kind = check_kind(fields)
        checks: list[Any] = getattr(self, CHECK_LISTS[kind])
        spec, problems = read_entry(kind, fields, self.check_context(fields))
        _raise(under(f"check[{len(checks)}]", problems))
        checks.append(spec)
        return spec  # type: ignore[return-value]

    def set_gravity(self, gravity: Any) -> None:
        """Set gravity: its acceleration (3,) in global axes, ``"earth -z"`` or ``"none"``."""
        self.gravity, problems = read_gravity(gravity, self.context)
        _raise(problems)

    def set_effects(self, **fields: Any) -> EffectsSpec:
        """Say which effects of the scene are left out, such as ``friction=False``."""
        self.effects = self._single("effects", EffectsSpec, fields)
        return self.effects

    def set_dynamics(self, **fields: Any) -> DynamicsSpec:
        """Say how to run in time: ``duration``, ``step``, ..."""
        self.dynamics = self._single("dynamics", DynamicsSpec, fields)
        return self.dynamics

    def set_kinematics(self, **fields: Any) -> KinematicsSpec:
        """Say how to run as a kinematic analysis: ``duration``, ``outputs``."""
        self.kinematics = self._single("kinematics", KinematicsSpec, fields)
        return self.kinematics

    def set_statics(self, **fields: Any) -> StaticsSpec:
        """Say of which times equilibria are sought: ``time``, or ``duration`` and ``outputs``."""
        self.statics = self._single("statics", StaticsSpec, fields)
        return self.statics

    def set_part(self, **fields: Any) -> PartSpec:
        """Say how one body is solved by itself: ``supports``, ``loads``, ``frequencies``, ..."""
        self.part = self._single("part", PartSpec, fields)
        return self.part

    def set_assembly(self, **fields: Any) -> AssemblySpec:
        """Say how the first pose is found: ``weights`` by body, ``guess`` by joint."""
        self.assembly = self._single("assembly", AssemblySpec, fields)
        return self.assembly

    def set_validity(self, **fields: Any) -> ValiditySpec:
        """Say how far flexible bodies may leave their equations: ``deflection``, ``speed``, ..."""
        self.validity = self._single("validity", ValiditySpec, fields)
        return self.validity

    def set_study(self, **fields: Any) -> StudySpec:
        """Say what a study varies: ``vary``, ``repeats``, ``target``, ``sensors``."""
        self.study = self._single("study", StudySpec, fields)
        return self.study

    def set_sweep(self, **fields: Any) -> SweepSpec:
        """Say what a sweep varies: ``vary``, ``method``, ``samples``, ``sensors``, ``find``, ..."""
        self.sweep = self._single("sweep", SweepSpec, fields)
        return self.sweep

    def set_results(self, **fields: Any) -> ResultsSpec:
        """Say what of a run is stored: ``keep``."""
        self.results = self._single("results", ResultsSpec, fields)
        return self.results

    def set_view(self, **fields: Any) -> ViewSpec:
        """Say what to draw: ``time``, ``exaggeration``, ``direction``, ``history``, ``size``."""
        self.view = self._single("view", ViewSpec, fields)
        return self.view

    def _single(self, section: str, kind: type[S], fields: Any) -> S:
        spec, problems = read_entry(kind, fields, self.context)
        _raise(under(section, problems))
        assert spec is not None
        return spec

    def _add(self, section: str, name: str, data: Any) -> Spec:
        entries = getattr(self, section)
        if name in entries:
            _raise([Problem(f"{section}.{name}", f'the name "{name}" is used twice')])
        spec, problems = read_named(section, name, data, self.context)
        _raise(problems)
        assert spec is not None
        entries[name] = spec
        return spec

    def channels(self) -> tuple[str, ...]:
        """Names of all channels of sensors, states and controllers, in order."""
        pairs = self.sensors.items()
        sensed = tuple(channel for name, spec in pairs for channel in channels_of(name, spec))
        return (*sensed, *self.states, *self.controllers)

    def stress_channels(self) -> tuple[str, ...]:
        """The largest von Mises stress of each flexible body that has stress in its file."""
        flexible = (name for name, spec in self.bodies.items() if spec.flexible)
        return tuple(
            f"{name}.von_mises"
            for name in flexible
            if getattr(self.bodies[name], "stress", None) != "none"
        )

    def channel_unit(self, channel: str) -> str | None:
        """SI unit of a channel; None where there is no such sensor, state, controller or body."""
        if channel in self.stress_channels():
            return "Pa"
        sections: tuple[Mapping[str, Spec], ...] = (self.controllers, self.states, self.sensors)
        for name in (channel, channel.rpartition(".")[0]):
            for owners in sections:
                if name in owners:
                    return unit_of(vars(owners[name]))
        return None

    def check_unit(self, fields: Mapping[str, Any]) -> str | None:
        """SI unit of the channel, or of the quantity of a part, that a check compares."""
        if "part" in fields:
            return part_unit(fields["part"])
        channel = fields.get("sensor")
        return self.channel_unit(channel) if isinstance(channel, str) else None

    def check_context(self, fields: Mapping[str, Any]) -> ReadContext:
        """Parameters, units and expected unit by which the numbers of a check are read."""
        unit = self.check_unit(fields)
        return ReadContext(self.parameters, self.units, expected_unit=unit, folder=self.folder)

    def marker(self, reference: str) -> lookup.NamedMarker:
        """Body, name and specification of ``"body.marker"``, automatic markers included.

        Raises
        ------
        SceneError
            No such body or marker; lists those there are, nearest first.
        """
        return lookup.find(self, reference)

    def path(self, name: str) -> Path:
        """A path of the scene, made absolute."""
        return (self.folder / name).resolve()

    def problems(self, flexbodies: Mapping[str, FlexBody] | None = None) -> list[Problem]:
        """All problems of parts that do not fit together.

        Parameters
        ----------
        flexbodies : mapping, optional
            The flexible bodies by name that are reduced so far; their markers are checked.
        """
        return model_problems(self, flexbodies or {})

    def validate(self, flexbodies: Mapping[str, FlexBody] | None = None) -> None:
        """Raise a :class:`SceneError` with all problems if there are any; else issue `warnings`."""
        _raise(self.problems(flexbodies))
        for sentence in self.warnings(flexbodies):
            warnings.warn(sentence, FlexmbWarning, stacklevel=2)

    def warnings(self, flexbodies: Mapping[str, FlexBody] | None = None) -> list[str]:
        """Sentences about what is probably a mistake.

        Markers far from the flexible body they are on, if the body is given; couplers that repeat
        others; drivers whose velocity jumps; densities that no material has.
        """
        bodies = flexbodies or {}
        return [
            *model_warnings(self, bodies),
            *(repeated_couplers(self, bodies) if self.couplers else ()),
            *unequal_teeth(self, bodies),
        ]

    def to_scene_dict(
        self, folder: str | Path | None = None, flexbodies: Mapping[str, str | Path] | None = None
    ) -> dict[str, Any]:
        """The model as a scene: plain data in its unit system with all numbers resolved.

        Parameters
        ----------
        folder : path, optional
            Write paths relative to this folder; as given by default.
        flexbodies : mapping, optional
            Files of reduced bodies by name, written as they are; needed for those given as objects.
        """
        return scene_dict(self, folder, flexbodies or {})

    @classmethod
    def from_scene_dict(cls, scene: Mapping[str, Any], folder: str | Path = ".") -> Self:
        """The model of a scene given as plain data.

        Raises
        ------
        SceneError
            All that is wrong with it.
        """
        return build(cls, scene, Path(folder))


def _raise(problems: list[Problem]) -> None:
    if problems:
        raise SceneError.from_problems(problems)
