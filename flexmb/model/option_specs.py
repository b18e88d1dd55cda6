"""Options of a mesh body as specifications of a scene: in the scene's units, with expressions.

:func:`spec_of` makes the pydantic class of a dataclass of :mod:`flexmb.flexbody.options`, so that
scene, JSON schema, lists and the finite-element half share one description. Fields that each half
reads in its own way are defined here: groups and nodes of a mesh, weights, stiffnesses, divisions,
materials and inertias.

An inertia is three principal moments, a 3x3 matrix, or a table of moments and products. No
principal moment may exceed the sum of the other two.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, asdict, is_dataclass, replace
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BeforeValidator,
    SerializationInfo,
    ValidationInfo,
    create_model,
    model_validator,
)

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.flexbody.damping import (
    PRESETS,
    Band,
    DampingOptions,
    RatioTable,
    Rayleigh,
    damping_table,
    plain_options,
    read_damping,
)
from flexmb.flexbody.mesh_options import MATERIALS, MaterialOptions, OrthotropicOptions
from flexmb.flexbody.options import Kind, OneOf, Unit, Whole, option_types
from flexmb.materials import LIBRARY, AnyMaterial, Material, OrthotropicMaterial, material
from flexmb.model.quantities import Axis, Integer, Quantity, plain, read_number
from flexmb.model.reading import (
    NAME,
    NUMBER,
    Entry,
    ReadContext,
    Reader,
    Spec,
    Variant,
    choice,
    context_of,
    fail,
    list_form,
    quote,
    read_entry,
    reference,
    unknown_key,
)
from flexmb.units import UnitSystem


@cache
def spec_of(options: type) -> type[Spec]:
    """The scene's specification with the fields of a dataclass of options."""
    defined: dict[str, Any] = {
        name: (_annotation(hint), ... if default is MISSING else default)
        for name, (hint, default) in option_types(options).items()
    }
    validators: dict[str, Any] = {}
    if hasattr(options, "check"):

        def check(self: Any, info: ValidationInfo) -> Any:
            problems = options.check(self, context_of(info).units.say)
            if problems:
                raise fail(*problems)
            return self

        validators["check"] = model_validator(mode="after")(check)
    return create_model(
        options.__name__.removesuffix("Options") + "Spec",
        __base__=Spec,
        __doc__=options.__doc__,
        __module__=__name__,
        __validators__=validators,
        **defined,
    )


def _annotation(hint: Any) -> Any:
    """The annotation of a scene's field for that of an option."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        mark = parts[1]
        if isinstance(mark, Unit):
            return Annotated[float, Quantity(mark.unit, mark.sign)]
        if isinstance(mark, Whole):
            return Annotated[int, Integer(mark.minimum)]
        if isinstance(mark, OneOf):
            return Annotated[Any, Variant(mark.noun, lambda: specs_of(mark.kinds))]
        assert isinstance(mark, Kind)
        return _KINDS[mark.name]
    if origin in (Union, types.UnionType):
        return Union[tuple(_annotation(part) for part in parts)]  # noqa: UP007
    if origin is tuple:
        items = tuple(part if part is Ellipsis else _annotation(part) for part in parts)
        return Annotated[tuple[items], BeforeValidator(plain)]  # type: ignore[valid-type]
    if origin is dict:
        return dict.__class_getitem__((parts[0], _annotation(parts[1])))
    if is_dataclass(hint):
        return Annotated[spec_of(hint), Entry()]  # type: ignore[arg-type]
    return hint


def specs_of(kinds: Mapping[str, type]) -> dict[str, type[Spec]]:
    """The scene's specifications of options, by type."""
    return {name: spec_of(options) for name, options in kinds.items()}


def _group_name(value: Any, info: ValidationInfo) -> str:
    """The name of a mesh group; a number is the name of a group that the file only numbers."""
    if isinstance(value, bool) or not isinstance(value, str | int) or not str(value).strip():
        raise fail(Problem("", f"the name of a mesh group is expected, given {quote(value)}"))
    return str(value)


def _node_or_group(value: Any, info: ValidationInfo) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int):
        what = "the name of a mesh group or the number of a node is expected, given "
        raise fail(Problem("", what + quote(value)))
    return value if isinstance(value, str) else Integer(0).read(value, info)


def _weights(value: Any, info: ValidationInfo) -> str | tuple[float, ...]:
    value = plain(value)
    if isinstance(value, str) and value in ("uniform", "area"):
        return value
    if not isinstance(value, list):
        what = f"unknown choice {quote(value)}"
        raise fail(Problem("", what, ("uniform", "area", "one number for each node")))
    return tuple(Quantity("", "positive").read(item, info) for item in value)


GroupName = Annotated[str, Reader(_group_name, form=NAME)]
NodeOrGroup = Annotated[str | int, Reader(_node_or_group, form=NAME)]
"""A group of the mesh, or the number of a node."""

_WEIGHTS = {"anyOf": [{"enum": ["uniform", "area"]}, list_form(NUMBER)]}
Weights = Annotated[Any, Reader(_weights, form=_WEIGHTS)]


_UNITS = ("N/m", "N/m", "N/m", "N m/rad", "N m/rad", "N m/rad")


def _read_stiffness(value: Any, info: ValidationInfo) -> float | tuple[float, ...]:
    value = plain(value)
    if not isinstance(value, list):
        return Quantity("N/m", "positive").read(value, info)
    if len(value) != len(_UNITS):
        what = "one stiffness, or six along and about the axes are expected, given "
        raise fail(Problem("", what + quote(value)))
    pairs = zip(_UNITS, value, strict=True)
    values = tuple(Quantity(unit, "not negative").read(item, info) for unit, item in pairs)
    if not any(values):
        raise fail(Problem("", "one of the six must be positive"))
    return values


def _write_stiffness(value: Any, info: SerializationInfo) -> Any:
    if not isinstance(value, tuple):
        return Quantity("N/m").write(value, info)
    return [Quantity(u).write(k, info) for u, k in zip(_UNITS, value, strict=True)]


_STIFFNESS = {"anyOf": [NUMBER, list_form(NUMBER, 6)], "description": "[N/m, N m/rad]"}
Stiffness = Annotated[Any, Reader(_read_stiffness, _write_stiffness, _STIFFNESS)]
"""One number [N/m], or six [N/m, N m/rad]."""


def _read_divisions(value: Any, info: ValidationInfo) -> int | tuple[int, ...]:
    value, whole = plain(value), Integer(1)
    if not isinstance(value, list):
        return whole.read(value, info)
    if not value:
        raise fail(Problem("", "whole numbers of elements are expected, given []"))
    return tuple(whole.read(item, info) for item in value)


Divisions = Annotated[
    Annotated[int, Integer(1)] | tuple[Annotated[int, Integer(1)], ...], Reader(_read_divisions)
]
"""One number of elements for all directions, or one for each."""


def _read_material(value: Any, info: ValidationInfo) -> AnyMaterial:
    try:
        if isinstance(value, OrthotropicMaterial):
            return value
        if isinstance(value, str | Material):
            return material(value)
        directed = isinstance(value, Mapping) and (
            "G" in value or isinstance(plain(value.get("E")), list)
        )
        kind = spec_of(OrthotropicOptions if directed else MaterialOptions)
        values, problems = read_entry(kind, value, context_of(info))
        if values is None:
            raise fail(*problems)
        made = OrthotropicMaterial if directed else Material
        return made(**values.model_dump())
    except FlexmbError as error:
        places = (p.where.removeprefix("material").removeprefix(".") for p in error.problems)
        pairs = zip(places, error.problems, strict=True)
        raise fail(*(Problem(at, p.what, p.allowed, p.nearest) for at, p in pairs)) from None


def _write_material(value: AnyMaterial, info: SerializationInfo) -> Any:
    if LIBRARY.get(value.name) == value:
        return value.name
    kind = spec_of(MaterialOptions if isinstance(value, Material) else OrthotropicOptions)
    return kind.model_construct(**asdict(value)).model_dump(mode="json", context=info.context)


MATERIAL_KINDS = specs_of(MATERIALS)
"""What a table of a material may be."""
_MATERIAL = {"anyOf": [*choice(LIBRARY)["anyOf"], *map(reference, MATERIAL_KINDS.values())]}
MaterialField = Annotated[AnyMaterial, Reader(_read_material, _write_material, _MATERIAL)]
"""A name of the library, or a table of values in the scene's units."""


def _read_damping(value: Any, info: ValidationInfo) -> DampingOptions | None:
    if isinstance(value, DampingOptions):
        return value
    value = plain(value)
    if isinstance(value, str) and value not in PRESETS:
        if value.isidentifier() and value not in context_of(info):
            names = (*PRESETS, "a ratio, or a table")
            raise fail(Problem("", f'unknown name "{value}"', names, nearest(value, PRESETS)))
        value = Quantity("", "not negative").read(value, info)
    spec, problems = read_entry(DAMPING_KINDS["damping"], damping_table(value), context_of(info))
    if spec is None:
        alone = not isinstance(value, Mapping)
        raise fail(*(replace(p, where="") if alone else p for p in problems))
    return read_damping(spec.model_dump(exclude_none=True))


def _write_damping(value: DampingOptions | None, info: SerializationInfo) -> Any:
    if value is None or value == DampingOptions(ratio=value.ratio):
        return None if value is None else value.ratio
    spec, _ = read_entry(DAMPING_KINDS["damping"], plain_options(value), ReadContext())
    assert spec is not None  # its text was read before
    return spec.model_dump(mode="json", exclude_none=True, context=info.context)


DAMPING_KINDS = specs_of(
    {"damping": DampingOptions, "a band": Band, "a table of ratios": RatioTable,
     "Rayleigh damping": Rayleigh}
)  # fmt: skip
"""The tables that the options of damping contain."""
_DAMPING = {"anyOf": [NUMBER, choice(PRESETS), reference(DAMPING_KINDS["damping"])]}
DampingField = Annotated[Any, Reader(_read_damping, _write_damping, _DAMPING)]
"""A damping ratio of all modes, the name of a preset, or a table."""


Rows = tuple[tuple[float, float, float], ...]
_DIAGONAL = ("xx", "yy", "zz")
_PRODUCTS = ("xy", "xz", "yz")
_UNIT = "kg m^2"
# relative; numbers typed with seven digits pass, and a thin plate lies exactly on the limit
_ROUNDING = 1e-6


def _inertia_matrix(value: Any, names: ReadContext) -> NDArray[np.float64]:
    if isinstance(value, Mapping):
        return _from_table(value, names)
    if isinstance(value, list | tuple) and len(value) == 3:
        if all(isinstance(row, list | tuple) and len(row) == 3 for row in value):
            return np.array([[read_number(item, names, _UNIT) for item in row] for row in value])
        if not any(isinstance(row, list | tuple) for row in value):
            return np.diag([read_number(item, names, _UNIT) for item in value])
    raise SceneError(
        "an inertia is [Ixx, Iyy, Izz], a 3x3 matrix or a table {xx, yy, zz, xy, xz, yz}, "
        f"given {quote(value)}"
    )


def _from_table(table: Mapping[str, Any], names: ReadContext) -> NDArray[np.float64]:
    keys = (*_DIAGONAL, *_PRODUCTS)
    problems = [unknown_key(key, keys) for key in table if key not in keys]
    problems += [Problem(key, "is missing") for key in _DIAGONAL if key not in table]
    matrix = np.zeros((3, 3))
    for key in keys:
        i, j = ("xyz".index(letter) for letter in key)
        try:
            matrix[i, j] = matrix[j, i] = read_number(table.get(key, 0.0), names, _UNIT)
        except SceneError as error:
            problems += [Problem(key, p.what, p.allowed, p.nearest) for p in error.problems]
    if problems:
        raise SceneError.from_problems(problems)
    return matrix


def _check_inertia(matrix: NDArray[np.float64], units: UnitSystem) -> None:
    scale = float(np.abs(matrix).max())
    for i, j in ((0, 1), (0, 2), (1, 2)):
        if abs(matrix[i, j] - matrix[j, i]) > _ROUNDING * scale:
            unit = units.label(_UNIT)
            a, b = f"I{'xyz'[i]}{'xyz'[j]}", f"I{'xyz'[j]}{'xyz'[i]}"
            raise SceneError(
                f"the inertia is not symmetric: {a} = {matrix[i, j]:g} {unit} "
                f"but {b} = {matrix[j, i]:g} {unit}"
            )
    moments = _principal(matrix)
    exceeds = moments[2] > (moments[0] + moments[1]) * (1 + _ROUNDING)
    if not (moments[0] <= 0 or exceeds):
        return
    shown, unit = ", ".join(f"{moment:g}" for moment in moments), units.label(_UNIT)
    if moments[0] <= 0:
        raise SceneError(
            f"the inertia is impossible: its principal moments {shown} {unit} must all be positive"
        )
    raise SceneError(
        f"the inertia is impossible: of its principal moments {shown} {unit} the largest, "
        f"{moments[2]:g}, exceeds the sum of the other two, {moments[0] + moments[1]:g}; "
        "no distribution of mass has it"
    )


def _principal(matrix: NDArray[np.float64]) -> list[float]:
    """Principal moments of inertia, ascending."""
    diagonal: list[float] = matrix.diagonal().tolist()
    if np.count_nonzero(matrix) == np.count_nonzero(diagonal):
        return sorted(diagonal)
    moments: list[float] = np.linalg.eigvalsh((matrix + matrix.T) / 2).tolist()
    return moments


def _read_inertia(value: Any, info: ValidationInfo) -> Rows:
    names = context_of(info)
    value = value.tolist() if hasattr(value, "tolist") else value
    try:
        matrix = _inertia_matrix(value, names)
        _check_inertia(matrix, names.units)
    except SceneError as error:
        raise fail(*error.problems) from None
    matrix = matrix * names.units.scale(_UNIT)
    if not np.isfinite(matrix).all():
        raise fail(Problem("", f"finite numbers are expected, given {quote(value)}"))
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)


def _write_inertia(value: Rows, info: SerializationInfo) -> list[list[float]]:
    units = context_of(info).units
    return [[units.written(item, _UNIT) for item in row] for row in value]


_INERTIA = {
    "anyOf": [
        list_form(NUMBER, 3),
        list_form(list_form(NUMBER, 3), 3),
        {
            "type": "object",
            "properties": {key: NUMBER for key in (*_DIAGONAL, *_PRODUCTS)},
            "required": list(_DIAGONAL),
            "additionalProperties": False,
        },
    ],
    "description": "[kg m^2]",
}
Inertia = Annotated[Rows, Reader(_read_inertia, _write_inertia, _INERTIA)]
"""Inertia about the centre of mass, body axes, that some distribution of mass can have."""


_KINDS: dict[str, Any] = {
    "group": GroupName,
    "node or group": NodeOrGroup,
    "weights": Weights,
    "stiffness": Stiffness,
    "divisions": Divisions,
    "direction": Axis,
    "inertia": Inertia,
    "material": MaterialField,
}
