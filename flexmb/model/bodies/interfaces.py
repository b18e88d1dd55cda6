"""What joins and loads the nodes of a mesh: interfaces, ties, masses, springs, load patterns.

In: groups and node numbers, places and values in the scene's units. Out: specifications in SI with
the words of ``flexmb.fe.interfaces`` and ``flexmb.fe.assembly``. Nodes are counted from 0 in the
order of the mesh.

In: groups and values in the scene's units, body axes. Out: specifications in SI with the words of
``flexmb.fe.assembly.loads``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.bodies.mass_properties import Inertia
from flexmb.model.values.names import bad_name
from flexmb.model.values.quantities import (
    Acceleration,
    Axis,
    Integer,
    Position,
    Quantity,
    Size,
    plain,
)
from flexmb.model.values.reading import (
    NAME,
    NUMBER,
    Reader,
    Spec,
    Variant,
    fail,
    given,
    list_form,
    names_of,
    read_entry,
    reference,
    under,
)


def _group_name(value: Any, info: ValidationInfo) -> str:
    """The name of a mesh group; a number is the name of a group that a file only numbers."""
    if isinstance(value, bool) or not isinstance(value, str | int) or not str(value).strip():
        raise fail(Problem("", f"the name of a mesh group is expected, given {given(value)}"))
    return str(value)


def _node_or_group(value: Any, info: ValidationInfo) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int):
        what = "the name of a mesh group or the number of a node is expected, given "
        raise fail(Problem("", what + given(value)))
    return value if isinstance(value, str) else Integer(0).read(value, info)


def _weights(value: Any, info: ValidationInfo) -> str | tuple[float, ...]:
    value = plain(value)
    if isinstance(value, str) and value in ("uniform", "area"):
        return value
    if not isinstance(value, list):
        what = f"unknown choice {given(value)}"
        raise fail(Problem("", what, ("uniform", "area", "one number for each node")))
    return tuple(Quantity("", "positive").read(item, info) for item in value)


GroupName = Annotated[str, Reader(_group_name, form=NAME)]
NodeOrGroup = Annotated[str | int, Reader(_node_or_group, form=NAME)]
"""A group of the mesh, or the number of a node."""

Nodes = Annotated[tuple[Annotated[int, Integer(0)], ...], BeforeValidator(plain)]
_WEIGHTS = {"anyOf": [{"enum": ["uniform", "area"]}, list_form(NUMBER)]}
Weights = Annotated[Any, Reader(_weights, form=_WEIGHTS)]


class NodeChoice(Spec):
    """Nodes of a mesh: a group, one node, several, or all within a radius of a center."""

    group: GroupName | None = None
    node: Annotated[int, Integer(0)] | None = None
    nodes: Nodes | None = None
    center: Position | None = None
    radius: Size | None = None
    weights: Weights | None = None
    position: Position | None = None

    @model_validator(mode="after")
    def _one_choice(self) -> Self:
        words = ("group", "node", "nodes", "center")
        told = [key for key in words if getattr(self, key) is not None]
        if len(told) != 1:
            what = f"is told by {' and '.join(told)}" if told else "has no nodes"
            raise fail(Problem("", f"{what}; give one of them", words))
        if (self.center is None) != (self.radius is None):
            raise fail(Problem("", '"center" and "radius" go together'))
        return self


class InterfaceSpec(NodeChoice):
    """Nodes that carry a marker: a group, one node, several, or all within a radius of a center.

    They move rigidly with the marker (rbe2), or the marker with their weighted mean (rbe3);
    `weights` are uniform, the area of each node, or one number for each. The marker lies in the
    centroid of a group, or at `position`.
    """

    type: Literal["rbe2", "rbe3"] = "rbe2"

    @model_validator(mode="after")
    def _weights_of_a_mean(self) -> Self:
        if self.weights is not None and self.type == "rbe2":
            raise fail(Problem("weights", 'are for type = "rbe3"; nodes of an rbe2 move rigidly'))
        return self


def _read_interfaces(value: Any, info: ValidationInfo) -> dict[str, str | InterfaceSpec]:
    if not isinstance(value, Mapping) or not value:
        what = "a table {name = mesh group, ...} of at least one interface is expected"
        raise fail(Problem("", f"{what}, given {given(value)}"))
    problems: list[Problem] = []
    found: dict[str, str | InterfaceSpec] = {}
    for name, chosen in value.items():
        if bad := bad_name(name):
            problems.append(Problem(str(name), bad))
        elif isinstance(chosen, Mapping | InterfaceSpec):
            spec, wrong = read_entry(InterfaceSpec, chosen, names_of(info))
            problems += under(name, wrong)
            found |= {name: spec} if spec is not None else {}
        elif isinstance(chosen, bool) or not isinstance(chosen, str | int):
            what = "the name of a mesh group, or a table, is expected, given "
            problems.append(Problem(name, what + given(chosen)))
        else:
            found[name] = str(chosen)
    if problems:
        raise fail(*problems)
    return found


def _write_interfaces(value: Mapping[str, Any], info: SerializationInfo) -> dict[str, Any]:
    return {
        name: chosen
        if isinstance(chosen, str)
        else chosen.model_dump(mode="json", exclude_none=True, context=info.context)
        for name, chosen in value.items()
    }


_INTERFACES = {
    "type": "object",
    "additionalProperties": {"anyOf": [NAME, reference(InterfaceSpec)]},
    "minProperties": 1,
}
Interfaces = Annotated[dict[str, Any], Reader(_read_interfaces, _write_interfaces, _INTERFACES)]
"""Name of a marker to the mesh group that carries it, or to an :class:`InterfaceSpec`."""


class TieSpec(Spec):
    """Nodes that follow a reference node rigidly (rbe2), or a reference that follows their mean."""

    type: Literal["rbe2", "rbe3"] = "rbe2"
    reference: NodeOrGroup
    nodes: GroupName


class MassSpec(Spec):
    """A mass at a node, with an inertia about its own center and an offset to that; or one spread
    over the nodes of a group."""

    at: NodeOrGroup
    mass: Annotated[float, Quantity("kg", "not negative")]
    inertia: Inertia | None = None
    offset: Position | None = None

    @model_validator(mode="after")
    def _has_mass(self) -> Self:
        if self.mass == 0 and self.inertia is None:
            raise fail(Problem("mass", "must be positive where there is no inertia, is 0"))
        return self


_UNITS = ("N/m", "N/m", "N/m", "N m/rad", "N m/rad", "N m/rad")


def _read_stiffness(value: Any, info: ValidationInfo) -> float | tuple[float, ...]:
    value = plain(value)
    if not isinstance(value, list):
        return Quantity("N/m", "positive").read(value, info)
    if len(value) != len(_UNITS):
        what = "one stiffness, or six along and about the axes are expected, given "
        raise fail(Problem("", what + given(value)))
    pairs = zip(_UNITS, value, strict=True)
    found = tuple(Quantity(unit, "not negative").read(item, info) for unit, item in pairs)
    if not any(found):
        raise fail(Problem("", "one of the six must be positive"))
    return found


def _write_stiffness(value: Any, info: SerializationInfo) -> Any:
    if not isinstance(value, tuple):
        return Quantity("N/m").write(value, info)
    return [Quantity(u).write(k, info) for u, k in zip(_UNITS, value, strict=True)]


_STIFFNESS = {"anyOf": [NUMBER, list_form(NUMBER, 6)], "description": "[N/m, N m/rad]"}
Stiffness = Annotated[Any, Reader(_read_stiffness, _write_stiffness, _STIFFNESS)]
"""One number [N/m], or six [N/m, N m/rad]."""


class NodeSpringSpec(Spec):
    """A spring between two nodes: along their line, or along and about axes halfway between them.

    `axes` are the directions of the first and the second of them; the body's by default.
    """

    between: tuple[NodeOrGroup, NodeOrGroup]
    stiffness: Stiffness
    axes: tuple[Axis, Axis] | None = None

    @model_validator(mode="after")
    def _axes_of_six(self) -> Self:
        if self.axes is not None and not isinstance(self.stiffness, tuple):
            raise fail(Problem("axes", "belong to a spring with six stiffnesses"))
        return self


_Pressure = Annotated[float, Quantity("Pa")]
_PerLength = Annotated[float, Quantity("N/m")]
_Force = Annotated[float, Quantity("N")]
_Moment = Annotated[float, Quantity("N m")]


class PressureLoad(Spec):
    """Pressure on a group of surfaces: it pushes on solids, and along the normal of shells."""

    type: Literal["pressure"]
    group: GroupName
    pressure: _Pressure
    residual: bool = True


class TractionLoad(Spec):
    """Force per area, body axes, on a group of surfaces."""

    type: Literal["traction"]
    group: GroupName
    traction: Annotated[tuple[_Pressure, _Pressure, _Pressure], BeforeValidator(plain)]
    residual: bool = True


class LineLoad(Spec):
    """Force per length, body axes, on a group of lines."""

    type: Literal["line"]
    group: GroupName
    force: Annotated[tuple[_PerLength, _PerLength, _PerLength], BeforeValidator(plain)]
    residual: bool = True


class PointLoad(NodeChoice):
    """Force and moment, body axes, on nodes chosen as for an interface."""

    type: Literal["force"]
    force: Annotated[tuple[_Force, _Force, _Force], BeforeValidator(plain)] | None = None
    moment: Annotated[tuple[_Moment, _Moment, _Moment], BeforeValidator(plain)] | None = None
    residual: bool = True

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.force is None and self.moment is None:
            raise fail(Problem("", 'give "force", "moment" or both'))
        return self


class GravityLoad(Spec):
    """The weight in a field of gravity, body axes; it deforms no free body."""

    type: Literal["gravity"]
    acceleration: Acceleration
    residual: bool = False


LOAD_TYPES: dict[str, type[Spec]] = {
    "pressure": PressureLoad,
    "traction": TractionLoad,
    "line": LineLoad,
    "force": PointLoad,
    "gravity": GravityLoad,
}

MeshLoads = dict[str, Annotated[Any, Variant("load type", lambda: LOAD_TYPES)]]
"""Loads on a mesh by name."""
