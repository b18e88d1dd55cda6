"""Meshes of bodies as a scene names them: a file, or the table of a simple shape.

In: a path, or ``{type = "box", size = [1, 0.1, 0.1], divisions = [10, 2, 2]}`` with sizes in the
scene's units. Out: the path, or a specification in SI whose fields are the words of
``flexmb.fe.meshes.mesh_shapes``.
"""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.values.quantities import Angle, Integer, Position, Quantity, Size, Sizes, plain
from flexmb.model.values.reading import (
    Reader,
    Spec,
    fail,
    given,
    names_of,
    read_variant,
    reference,
    under,
)

__all__ = ["MESH_TYPES", "Divisions", "MeshSource", "MeshTableSpec"]


def _read_divisions(value: Any, info: ValidationInfo) -> int | tuple[int, ...]:
    value, whole = plain(value), Integer(1)
    if not isinstance(value, list):
        return whole.read(value, info)
    if not value:
        raise fail(Problem("", "whole numbers of elements are expected, given []"))
    return tuple(whole.read(item, info) for item in value)


Divisions = Annotated[
    Annotated[int, Integer(1)] | tuple[Annotated[int, Integer(1)], ...],
    Reader(_read_divisions),
]
"""One number of elements for all directions, or one for each."""


Surface = Literal["quad", "triangle"]
Solid = Literal["hexahedron20", "hexahedron27", "hexahedron", "tetra10", "tetra", "wedge15"]
Either = Literal[
    "hexahedron20", "hexahedron27", "hexahedron", "tetra10", "tetra", "wedge15", "quad", "triangle"
]


class MeshTableSpec(Spec):
    """Base of the shapes."""

    @property
    def cells(self) -> int:
        """Product of the divisions that are told; 0 without any."""
        told = getattr(self, "divisions", None)
        return 0 if told is None else prod(told) if isinstance(told, tuple) else told**3


class BeamMesh(MeshTableSpec):
    """Lines along x from the origin, or along `points`; groups start, end, leg1, corner1, ..."""

    type: Literal["beam"]
    length: Size | None = None
    points: Annotated[tuple[Position, ...], BeforeValidator(plain)] | None = None
    divisions: Divisions | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.length is None) == (self.points is None):
            told = "neither" if self.length is None else "both"
            raise fail(Problem("", f'give either "length" or "points", given {told}'))
        return self


class PlateMesh(MeshTableSpec):
    """Surfaces in the xy plane, x from 0, centred in y; groups surface, x0, x1, y0, y1, corners."""

    type: Literal["plate"]
    length: Size
    width: Size
    divisions: Divisions | None = None
    elements: Surface = "quad"
    skew: Angle = 0.0


class BoxMesh(MeshTableSpec):
    """A box of solids, x from 0, centred in y and z; groups x0, x1, y0, y1, z0, z1."""

    type: Literal["box"]
    size: Sizes
    divisions: Divisions | None = None
    elements: Solid = "hexahedron20"


class TubeMesh(MeshTableSpec):
    """A hollow cylinder along x, of solids if it has `inner`; groups start, end, inner, outer."""

    type: Literal["tube"]
    length: Size
    radius: Size
    inner: Size | None = None
    divisions: Divisions | None = None
    elements: Either | None = None


class DiskMesh(MeshTableSpec):
    """A disk around the origin, normal z, of solids if it has `thickness`; groups inner, outer,
    bottom, top."""

    type: Literal["disk"]
    radius: Size
    inner: Annotated[float, Quantity("m", "not negative")] = 0.0
    thickness: Size | None = None
    divisions: Divisions | None = None
    elements: Either | None = None


MESH_TYPES: dict[str, type[MeshTableSpec]] = {
    "beam": BeamMesh,
    "plate": PlateMesh,
    "box": BoxMesh,
    "tube": TubeMesh,
    "disk": DiskMesh,
}


def _read_source(value: Any, info: ValidationInfo) -> str | MeshTableSpec:
    if isinstance(value, MeshTableSpec):
        return value
    if isinstance(value, str | Path) and str(value).isprintable() and str(value).strip():
        return str(value)
    if isinstance(value, str | Path) or not hasattr(value, "keys"):
        what = "a mesh file, or a table {type = ...} of a simple shape is expected, given "
        raise fail(Problem("", what + given(value), tuple(MESH_TYPES)))
    spec, problems = read_variant("shape of a mesh", MESH_TYPES, value, names_of(info))
    if spec is None:
        raise fail(*under("", problems))
    return spec


def _write_source(value: Any, info: SerializationInfo) -> Any:
    if isinstance(value, str):
        return value
    return value.model_dump(mode="json", exclude_none=True, context=info.context)


_MESH = {"anyOf": [{"type": "string"}, *map(reference, MESH_TYPES.values())]}
MeshSource = Annotated[Any, Reader(_read_source, _write_source, _MESH)]
"""Path of a mesh file, or the table of a simple shape."""
