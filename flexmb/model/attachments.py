"""What a mesh does not hold: masses, springs and ties at the nodes of a flexible body.

In: ``masses = {lamp = {at = "tip", mass = 2}}``, ``springs = {strut = {between = ["a", "b"],
stiffness = 1e6}}``, ``ties = {seat = {type = "rbe2", reference = "root", nodes = "face"}}``. Out:
the same in SI, in the words of :func:`flexmb.fe.reduce`. A node is its number or a group.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import Problem, SceneError
from flexmb.model.inertia import Inertia
from flexmb.model.quantities import Axis, Position, Quantity, Text, read_number
from flexmb.model.reading import Entry, Reader, Spec, fail, given, names_of, units_of

__all__ = ["MassSpec", "Masses", "MeshSpringSpec", "Springs", "TieSpec", "Ties"]

_UNITS = ("N/m",) * 3 + ("N m/rad",) * 3


def _read_place(value: Any, info: ValidationInfo) -> str | int:
    good = isinstance(value, str | int) and not isinstance(value, bool)
    if not good or (isinstance(value, int) and value < 0) or value == "":
        raise fail(Problem("", f"a node number or a mesh group is expected, given {given(value)}"))
    place: str | int = value
    return place


NodeOrGroup = Annotated[str | int, Reader(_read_place)]


def _read_stiffness(value: Any, info: ValidationInfo) -> float | list[float]:
    names = names_of(info)
    value = value.tolist() if hasattr(value, "tolist") else value
    several = isinstance(value, list | tuple)
    if several and len(value) != 6:
        what = f"one number or six are expected, given {given(value)}"
        raise fail(Problem("", f"{what}: three along and three about the axes"))
    problems: list[Problem] = []
    found: list[float] = []
    for number, unit in zip(value if several else [value], _UNITS, strict=False):
        try:
            found.append(read_number(number, names, unit) * units_of(names).scale(unit))
        except SceneError as error:
            problems += error.problems
    if not problems and (min(found) < 0 or max(found) == 0):
        problems.append(Problem("", f"must be positive, given {given(value)}"))
    if problems:
        raise fail(*problems)
    return found if several else found[0]


def _write_stiffness(value: float | list[float], info: SerializationInfo) -> Any:
    units = units_of(names_of(info))
    if isinstance(value, list):
        return [units.written(one, unit) for one, unit in zip(value, _UNITS, strict=True)]
    return units.written(value, _UNITS[0])


class MassSpec(Spec):
    """A mass at a node, or spread over a group by its area.

    ``inertia`` is about its own centre, ``offset`` leads there from the node.
    """

    at: NodeOrGroup
    mass: Annotated[float, Quantity("kg", "positive")]
    inertia: Inertia | None = None
    offset: Position | None = None


class MeshSpringSpec(Spec):
    """A spring between two nodes: along their line, or six stiffnesses along and about axes."""

    between: tuple[NodeOrGroup, NodeOrGroup]
    stiffness: Annotated[Any, Reader(_read_stiffness, _write_stiffness)]
    axes: tuple[Axis, Axis] | None = None


class TieSpec(Spec):
    """Nodes that follow a reference node (rbe2), or a reference that follows nodes (rbe3)."""

    type: Literal["rbe2", "rbe3"]
    reference: NodeOrGroup
    nodes: Text


Masses = dict[str, Annotated[MassSpec, Entry()]]
Springs = dict[str, Annotated[MeshSpringSpec, Entry()]]
Ties = dict[str, Annotated[TieSpec, Entry()]]
