"""The tables of a scene: which specification each has, and how named entries are read.

In: section, name and raw table. Out: the specification or its problems with their scene path, for
files and Python alike. The tables of stored results, pictures and known answers are defined here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import StrictBool, ValidationInfo, model_validator

from flexmb.errors import Problem, nearest
from flexmb.model.body import RigidBodySpec
from flexmb.model.control import PidSpec, StateSpec, TransferFunctionSpec
from flexmb.model.forces.bushing import BeamForceSpec, BushingSpec
from flexmb.model.forces.contact import ContactSpec
from flexmb.model.forces.force_characteristic import (
    RotationalStopSpec,
    StopSpec,
    TranslationalStopSpec,
)
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.forces.load import BodyLoadSpec, ForceSpec, LineForceSpec, TorqueSpec
from flexmb.model.forces.spring_damper import (
    RotationalSpringSpec,
    SpringDamperSpec,
    TranslationalSpringSpec,
)
from flexmb.model.joints.coupler import LinearCouplerSpec
from flexmb.model.joints.curve import CurveSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.gear import GearSpec, RackSpec
from flexmb.model.joints.joint import JointSpec
from flexmb.model.lookup import Component
from flexmb.model.markers import MarkerSpec
from flexmb.model.mesh_body import body_kind
from flexmb.model.quantities import Axis, Integer, Measured, Quantity, Text, WordOr, plain
from flexmb.model.reading import (
    GROUND,
    ReadContext,
    Reader,
    Spec,
    bad_name,
    choice,
    fail,
    list_form,
    quote,
    read_entry,
    read_variant,
    under,
    unknown_key,
)
from flexmb.model.scenes.dynamics import DynamicsSpec
from flexmb.model.scenes.supports import PartCheckSpec
from flexmb.model.sensor import SENSOR_TYPES


class ResultsSpec(Spec):
    """What the result file stores.

    ``keep`` names what is stored at each output, by default everything: groups (sensors, poses,
    modal-coordinates, velocities, coordinates, accelerations, reactions, multipliers, energy),
    bodies, joints, drivers, sensors, or channels, also with wildcards such as ``"rod.eta.*"``.
    Times, constraint drift, and the channels of ``[[check]]`` and of ``[view] history`` are always
    stored.
    """

    keep: tuple[Text, ...] = ()


_PIXELS = Integer(64, 8192)  # smaller pictures show nothing, larger ones exceed graphics memory
CAMERAS = ("auto", "front", "back", "left", "right", "top", "bottom", "isometric")


def _names(value: Any, info: ValidationInfo) -> tuple[str, ...]:
    """One name, or a list of them."""
    value = plain(value)
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise fail(Problem("", f"a name or a list of names is expected, given {quote(value)}"))
    return tuple(names)


def _cameras(value: Any, info: ValidationInfo) -> tuple[str, ...]:
    names = _names(value, info)
    for name in names or ("none",):
        if name not in CAMERAS:
            what = f"unknown camera {quote(name)}"
            raise fail(Problem("", what, CAMERAS, nearest(name, CAMERAS)))
    return names


_Names = Annotated[
    tuple[str, ...],
    Reader(_names, form={"anyOf": [{"type": "string"}, list_form({"type": "string"})]}),
]
_Cameras = Annotated[
    tuple[str, ...], Reader(_cameras, form={"anyOf": [choice(CAMERAS), list_form(choice(CAMERAS))]})
]
_Share = Annotated[float, Quantity(limits=(0, 1))]
_Factor = Annotated[float, Quantity("", "positive")]


class ViewSpec(Spec):
    """Pictures and films of a run, and its plot.

    ``time`` of the picture, default the end. Flexible bodies: ``color`` by displacement, von Mises
    or principal stress or strain energy per volume, or ``"body"``, each its own; ``layer`` of the
    stress, default the largest of all; ``exaggeration`` of the deformation, ``"auto"`` chooses a
    round factor; ``reference``: markers that it is relative to, such as ``"rod.big_end"``, default
    the first that joins each body, or ``"mean-axes"``; ``outline``: the undeformed bodies.
    ``camera``: one or several standard views; ``direction`` from the scene towards the eye in its
    place, default along the joint axes from where bodies hide each other least; ``framing`` of the
    whole motion, of this moment, or ``"auto"``: of the motion unless the machine is small in it;
    ``follow`` a body; ``zoom``. ``labels``: names; ``forces``: arrows of loads, of
    reactions, and of contacts and other forces that a sensor of type reaction records; ``frames``
    of markers that are joined; ``grid`` on the ground. ``opacity`` of bodies, ``font_scale``,
    ``size`` in pixels; ``history`` the channels of the plot, default all.
    """

    time: Annotated[float, Quantity("s", "not negative")] | None = None
    color: Literal["displacement", "von_mises", "principal", "strain_energy", "body"] = (
        "displacement"
    )
    layer: Text | None = None
    exaggeration: Annotated[float | str, WordOr("auto", "a factor", "", "not negative")] = "auto"
    reference: _Names = ()
    outline: StrictBool = True
    camera: _Cameras = ("auto",)
    direction: Axis | None = None
    framing: Literal["auto", "motion", "moment"] = "auto"
    follow: Text | None = None
    zoom: _Factor = 1.0
    labels: Literal["none", "bodies", "joints", "all"] = "none"
    forces: Literal["none", "loads", "reactions", "all"] = "none"
    frames: StrictBool = False
    grid: Literal["auto", "on", "off"] = "auto"
    opacity: _Share = 1.0
    font_scale: _Factor = 1.0
    history: tuple[Text, ...] = ()
    size: tuple[Annotated[int, _PIXELS], Annotated[int, _PIXELS]] = (1280, 720)

    @model_validator(mode="after")
    def _check_direction(self) -> Self:
        if self.direction is not None and self.camera != ("auto",):
            what = '"camera" and "direction" both say from where; give one of them'
            raise fail(Problem("direction", what))
        return self


class CheckSpec(Spec):
    """Known answer: at ``time`` the channel ``sensor`` is ``value`` within ``tolerance``, by
    ``source``.

    Channels are those of sensors, and ``"rod.von_mises"``: the largest stress of a flexible body.
    """

    sensor: Text
    time: Annotated[float, Quantity("s", "not negative")]
    value: Annotated[float, Measured()]
    tolerance: Annotated[float, Measured(sign="positive")]
    source: Text


class FrequencyCheckSpec(Spec):
    """Known answer: natural frequency ``mode`` of ``body`` is ``value`` within ``tolerance``.

    ``held`` names interfaces that are fixed; without any the body is free, and its rigid motions
    are not counted.
    """

    body: Text
    held: tuple[Text, ...] = ()
    mode: Annotated[int, Integer(1)] = 1
    value: Annotated[float, Quantity("Hz", "positive")]
    tolerance: Annotated[float, Quantity("Hz", "positive")]
    source: Text


class ModeCheckSpec(Spec):
    """Known answer: linearised mode ``linear_mode`` has the frequency ``value``.

    The scene is linearised about its first state, with flexible bodies in equilibrium with loads
    and motion, as `flexmb modes` shows it. Modes that vibrate are numbered in the order of their
    frequencies. ``parameters`` are changed first.
    """

    linear_mode: Annotated[int, Integer(1)]
    parameters: dict[str, Annotated[float, Quantity("")]] = {}
    value: Annotated[float, Quantity("Hz", "positive")]
    tolerance: Annotated[float, Quantity("Hz", "positive")]
    source: Text


CHECK_LISTS: dict[type[Spec], str] = {
    CheckSpec: "checks",
    FrequencyCheckSpec: "frequency_checks",
    ModeCheckSpec: "mode_checks",
    PartCheckSpec: "part_checks",
}
"""The kinds of ``[[check]]``, and the list of the model that contains each kind."""


def check_kind(fields: Mapping[str, Any]) -> type[Spec]:
    """The kind of check that a table describes."""
    if "linear_mode" in fields:
        return ModeCheckSpec
    if "part" in fields:
        return PartCheckSpec
    return FrequencyCheckSpec if "body" in fields else CheckSpec


SECTIONS = (
    "bodies", "curves", "joints", "couplers", "drivers", "forces", "sensors", "states",
    "controllers",
)  # fmt: skip
"""Sections whose entries have names."""

FORCE_TYPES: dict[str, type[Component]] = {
    "force": ForceSpec,
    "torque": TorqueSpec,
    "spring-damper": SpringDamperSpec,
    "line-force": LineForceSpec,
    "body-load": BodyLoadSpec,
    "rotational-spring-damper": RotationalSpringSpec,
    "translational-spring-damper": TranslationalSpringSpec,
    "contact": ContactSpec,
    "joint-friction": JointFrictionSpec,
    "bushing": BushingSpec,
    "beam": BeamForceSpec,
    "stop": StopSpec,
    "rotational-stop": RotationalStopSpec,
    "translational-stop": TranslationalStopSpec,
}
COUPLER_TYPES: dict[str, type[Component]] = {
    "gear": GearSpec,
    "rack-and-pinion": RackSpec,
    "linear": LinearCouplerSpec,
}
CONTROLLER_TYPES: dict[str, type[Spec]] = {
    "pid": PidSpec,
    "transfer-function": TransferFunctionSpec,
}

_VARIANTS: dict[str, tuple[str, Mapping[str, type[Spec]]]] = {
    "couplers": ("coupler type", COUPLER_TYPES),
    "forces": ("force type", FORCE_TYPES),
    "sensors": ("sensor type", SENSOR_TYPES),
    "controllers": ("controller type", CONTROLLER_TYPES),
}
_SINGLE: dict[str, type[Spec]] = {
    "curves": CurveSpec,
    "joints": JointSpec,
    "drivers": DriverSpec,
    "states": StateSpec,
    "markers": MarkerSpec,
}


def read_named(
    section: str, name: str, data: Any, names: ReadContext
) -> tuple[Spec | None, list[Problem]]:
    """Read one named entry of a section."""
    where = f"{section}.{name}"
    if bad := bad_name(name):
        return None, [Problem(where, bad)]
    if section == "bodies" and name == GROUND:
        return None, [Problem(where, 'the name "ground" is taken: give its markers by [ground]')]
    if section in _VARIANTS:
        noun, kinds = _VARIANTS[section]
        if not isinstance(data, Mapping | Spec):
            return None, [Problem(where, f"a table is expected, given {quote(data)}")]
        if isinstance(data, Spec):
            return data, []
        spec, problems = read_variant(noun, kinds, data, names)
    elif section == "bodies":
        spec, problems = _read_body(data, names)
    else:
        spec, problems = read_entry(_SINGLE[section], data, names)
    return spec, under(where, problems)


def _read_body(data: Any, names: ReadContext) -> tuple[Spec | None, list[Problem]]:
    if isinstance(data, Spec):
        return data, []
    if not isinstance(data, Mapping):
        return None, [Problem("", f"a table is expected, given {quote(data)}")]
    kind = body_kind(data)
    if isinstance(kind, Problem):
        return None, [kind]
    spec, problems = read_entry(kind, data, names)
    markers = data.get("markers")
    bad = [bad_name(name) for name in markers] if isinstance(markers, Mapping) else []
    problems += [Problem("markers", what) for what in bad if what]
    return (None if problems else spec), problems


_HOMES = {"[dynamics]": DynamicsSpec.model_fields, "[bodies.NAME]": RigidBodySpec.model_fields}


def unknown_section(key: str, allowed: tuple[str, ...]) -> Problem:
    """The problem of a key that a scene does not have at its top.

    Of a key of bodies or of dynamics it says where it belongs.
    """
    home = next((table for table, keys in _HOMES.items() if key in keys), "")
    if home:
        return Problem(key, f'unknown key "{key}": it belongs under {home}')
    return unknown_key(key, allowed)
