"""Flexible bodies made of a mesh, and the kind of body that a table describes.

The fields are those of :mod:`flexmb.flexbody.mesh_options` in the scene's units;
:meth:`MeshBodySpec.words` gives them in SI, as ``flexmb.fe.reduce`` takes them.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias

from pydantic import Field, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.flexbody.mesh_options import (
    LOADS,
    MASS_MATRICES,
    MESHES,
    REDUCTIONS,
    RESIDUALS,
    STRESS_OPTIONS,
    InterfaceOptions,
    MassOptions,
    ModesOptions,
    NodeSpringOptions,
    TieOptions,
)
from flexmb.flexbody.section_options import SECTIONS
from flexmb.model.body import BodySpec, RigidBodySpec, UnitsName
from flexmb.model.flexible_body import FlexbodySpec, FlexibleBodySpec
from flexmb.model.option_specs import MaterialField, spec_of, specs_of
from flexmb.model.quantities import Integer
from flexmb.model.reading import (
    NAME,
    Entry,
    Reader,
    Spec,
    Variant,
    bad_name,
    context_of,
    fail,
    quote,
    read_entry,
    read_variant,
    reference,
    under,
)

InterfaceSpec, ModesSpec = spec_of(InterfaceOptions), spec_of(ModesOptions)
MESH_TYPES, SECTION_TYPES, LOAD_TYPES = specs_of(MESHES), specs_of(SECTIONS), specs_of(LOADS)

Sections = dict[str, Annotated[Any, Variant("section", lambda: SECTION_TYPES)]]
"""Element group, or ``"all"``, to its section."""
if TYPE_CHECKING:
    Ties: TypeAlias = dict[str, Any]
    Masses: TypeAlias = dict[str, Any]
    Springs: TypeAlias = dict[str, Any]
    Method: TypeAlias = str
    MassMatrix: TypeAlias = str
    StressOption: TypeAlias = str
    Residual: TypeAlias = str
else:
    Ties = dict[str, Annotated[spec_of(TieOptions), Entry()]]
    Masses = dict[str, Annotated[spec_of(MassOptions), Entry()]]
    Springs = dict[str, Annotated[spec_of(NodeSpringOptions), Entry()]]
    Method = Literal[*REDUCTIONS]
    MassMatrix = Literal[MASS_MATRICES]
    StressOption = Literal[STRESS_OPTIONS]
    Residual = Literal["auto", *RESIDUALS]
MeshLoads = dict[str, Annotated[Any, Variant("load type", lambda: LOAD_TYPES)]]
"""Loads on a mesh by name."""


def _read_interfaces(value: Any, info: ValidationInfo) -> dict[str, Any]:
    if not isinstance(value, Mapping) or not value:
        what = "a table {name = mesh group, ...} of at least one interface is expected"
        raise fail(Problem("", f"{what}, given {quote(value)}"))
    problems: list[Problem] = []
    interfaces: dict[str, Any] = {}
    for name, nodes in value.items():
        if bad := bad_name(name):
            problems.append(Problem(str(name), bad))
        elif isinstance(nodes, Mapping | Spec):
            spec, wrong = read_entry(InterfaceSpec, nodes, context_of(info))
            problems += under(name, wrong)
            interfaces |= {name: spec} if spec is not None else {}
        elif isinstance(nodes, bool) or not isinstance(nodes, str | int):
            what = "the name of a mesh group, or a table, is expected, given "
            problems.append(Problem(name, what + quote(nodes)))
        else:
            interfaces[name] = str(nodes)
    if problems:
        raise fail(*problems)
    return interfaces


def _write_interfaces(value: Mapping[str, Any], info: SerializationInfo) -> dict[str, Any]:
    return {
        name: nodes
        if isinstance(nodes, str)
        else nodes.model_dump(mode="json", exclude_none=True, context=info.context)
        for name, nodes in value.items()
    }


_INTERFACES = {
    "type": "object",
    "additionalProperties": {"anyOf": [NAME, reference(InterfaceSpec)]},
    "minProperties": 1,
}
Interfaces = Annotated[dict[str, Any], Reader(_read_interfaces, _write_interfaces, _INTERFACES)]
"""Name of a marker to the mesh group that carries it, or to an :class:`InterfaceSpec`."""


def _read_source(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Spec):
        return value
    if isinstance(value, str | Path) and str(value).isprintable() and str(value).strip():
        return str(value)
    if isinstance(value, str | Path) or not hasattr(value, "keys"):
        what = "a mesh file, or a table {type = ...} of a simple shape is expected, given "
        raise fail(Problem("", what + quote(value), tuple(MESH_TYPES)))
    spec, problems = read_variant("shape of a mesh", MESH_TYPES, value, context_of(info))
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


def _read_modes(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Mapping | Spec):
        spec, problems = read_entry(ModesSpec, value, context_of(info))
        if spec is None:
            raise fail(*problems)
        return spec
    if isinstance(value, Path) or (isinstance(value, str) and value.strip().endswith(".npz")):
        return Path(value).as_posix()
    if isinstance(value, list | tuple):
        what = f"a whole number, a table or an .npz file is expected, given {quote(value)}"
        raise fail(Problem("", what))
    return Integer(0).read(value, info)


def _write_modes(value: Any, info: SerializationInfo) -> Any:
    if not isinstance(value, Spec):
        return value
    return value.model_dump(mode="json", exclude_none=True, context=info.context)


_MODES = {"anyOf": [{"type": ["integer", "string"], "minimum": 0}, reference(ModesSpec)]}
Modes = Annotated[Any, Reader(_read_modes, _write_modes, _MODES)]
"""A number of modes, a :class:`ModesSpec`, or the .npz file of the user's own."""


def mode_count(modes: Any, default: int = 20) -> int:
    """The number of modes; the default if a frequency or share decides it."""
    count = getattr(modes, "count", None) if isinstance(modes, Spec) else modes
    return count if isinstance(count, int) else default


_OPTIONS = (
    "reduction", "residual",  # of modes
    "sections", "ties", "masses", "springs", "loads", "mass_matrix", "stress", "refine",
)  # fmt: skip


_MAX_REFINEMENTS = 6
_MAX_RESIDUALS = 12  # static responses to inertia loads that may be added to the modes


class MeshBodySpec(FlexibleBodySpec):
    """A flexible body to be reduced from a mesh; the mesh's own frame is the body frame.

    `units` are those of a mesh file's coordinates, by default the scene's; everything else is in
    the scene's units. `modes` counts fixed-interface modes, 20 by default (modes of the free body
    without interfaces). With `geometric_stiffening = "full"` internal forces stiffen or soften the
    body. `residual = "inertia"` adds the static responses to the body's own inertia loads to its
    modes, so that it expands and is stressed as it rotates; `"auto"` does so if a driver or an
    initial spin causes inertia loads whose response the modes lack. `refine = 1` halves all
    elements of the mesh in every direction, `refine = 2` twice; nodes keep their numbers except in
    tubes and disks, whose divisions it doubles.
    """

    mesh: MeshSource
    units: UnitsName = Field("scene", validate_default=True)
    material: MaterialField
    sections: Sections = {}
    interfaces: Interfaces = {}
    ties: Ties = {}
    masses: Masses = {}
    springs: Springs = {}
    loads: MeshLoads = {}
    reduction: Method = "craig-bampton"
    modes: Modes | None = None
    mass_matrix: MassMatrix = "consistent"
    stress: StressOption = "surface"
    residual: Residual = "auto"
    refine: Annotated[int, Integer(0)] = 0

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        problems = []
        if isinstance(self.mesh, Spec) and "units" in self.model_fields_set:
            what = "are those of mesh files; the sizes of a shape are in the scene's units"
            problems.append(Problem("units", what))
        own = isinstance(self.modes, str)
        if own != (self.reduction == "user"):
            what = 'must be the .npz file of your own modes with reduction = "user"'
            what = what if not own else 'an .npz file goes with reduction = "user"'
            problems.append(Problem("modes", what))
        problems += self.frame_problems(tuple(self.interfaces))
        if isinstance(self.modes, int | None):
            most = 6 * len(self.interfaces) + self.mode_count + _MAX_RESIDUALS + 2 * len(self.loads)
            ratios = () if self.damping is None else self.damping.modes or {}
            for number in (n for n in ratios if int(n) > most):
                what = f"there is no such mode: the body has at most {most}"
                problems.append(Problem(f"damping.modes.{number}", what))
            problems += self.mode_problems(most, "at most ")
        if self.reduction == "guyan" and self.modes not in (None, 0):
            problems.append(Problem("modes", "a static reduction (guyan) keeps none; leave it out"))
        if self.refine > _MAX_REFINEMENTS:
            what = f"must be at most {_MAX_REFINEMENTS}, is {self.refine}"
            problems.append(Problem("refine", what))
        if problems:
            raise fail(*problems)
        return self

    @property
    def mode_count(self) -> int:
        """The number of modes, if a number is given."""
        return 0 if self.reduction == "guyan" else mode_count(self.modes)

    @property
    def cells(self) -> int:
        """Number of refinements and divisions, to compare meshes of the same body."""
        divisions = getattr(self.mesh, "divisions", None)
        finer = 1 << 3 * self.refine
        if divisions is None:
            return finer - 1
        return finer * (prod(divisions) if isinstance(divisions, tuple) else int(divisions) ** 3)

    def words(self) -> dict[str, Any]:
        """The options of a reduction as plain data in SI; options at their defaults are left
        out."""
        units = "SI" if isinstance(self.mesh, Spec) else self.units
        words: dict[str, Any] = {
            "units": units,
            "material": self.material,
            "interfaces": {name: _plain(part) for name, part in self.interfaces.items()},
        }
        rigid = self.deformation == "rigid"
        words |= {"rigid": True} if rigid else {}
        if self.reduction != "guyan" and not rigid:
            words["modes"] = 20 if self.modes is None else _plain(self.modes)
        for key in _OPTIONS[2 * rigid :]:
            value = getattr(self, key)
            if value != type(self).model_fields[key].default:
                words[key] = _plain(value)
        if self.geometric_stiffening == "full" and not rigid:
            words["geometric_stiffening"] = "full"
        return words


def _plain(value: Any) -> Any:
    """Specifications as plain data in SI."""
    if isinstance(value, Spec):
        return value.model_dump(exclude_none=True)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value


def body_kind(keys: Any) -> type[BodySpec] | Problem:
    """The specification class for a table with these keys, or the problem."""
    flexible = [key for key in ("mesh", "flexbody") if key in keys]
    rigid = [key for key in ("mass", "inertia", "shape", "density", "center") if key in keys]
    if len(flexible) > 1 or (flexible and rigid):
        several = " and ".join(f'"{key}"' for key in (*flexible, *rigid))
        return Problem("", f"is either rigid, or from a mesh, or a reduced body; given {several}")
    if not flexible:
        return RigidBodySpec
    return MeshBodySpec if flexible == ["mesh"] else FlexbodySpec
