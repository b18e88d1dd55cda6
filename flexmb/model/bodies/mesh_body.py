"""Flexible bodies that are made of a mesh: their options, and how many modes.

In: the words of a scene. Out: numbers and specifications in SI with the words of
``flexmb.fe.reduction``.

In: the words of a scene. Out: :class:`MeshBodySpec` in SI; :meth:`MeshBodySpec.words` are the
options of ``flexmb.fe.reduce``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.bodies.body import BodySpec, FlexbodySpec, RigidBodySpec, UnitsName
from flexmb.model.bodies.interfaces import (
    Interfaces,
    MassSpec,
    MeshLoads,
    NodeSpringSpec,
    TieSpec,
)
from flexmb.model.bodies.material import MaterialField
from flexmb.model.bodies.meshes import MeshSource, MeshTableSpec
from flexmb.model.bodies.sections import Sections
from flexmb.model.values.quantities import Integer, Quantity
from flexmb.model.values.reading import (
    Entry,
    Reader,
    Spec,
    fail,
    given,
    names_of,
    read_entry,
    reference,
)

Method = Literal["craig-bampton", "free-interface", "guyan", "user"]

METHODS = {
    "craig-bampton": "static modes of the interfaces and modes with the interfaces held: "
    "6 interfaces + modes - 6 coordinates",
    "free-interface": "modes of the free body and residual attachment modes: up to modes + "
    "6 interfaces coordinates",
    "guyan": "static modes of the interfaces alone: 6 interfaces - 6 coordinates",
    "user": "modes of an .npz file, by modes = path",
}
"""What each method keeps."""


class ModesSpec(Spec):
    """How many modes: a count, those below a frequency, a share of effective interface mass."""

    count: Annotated[int, Integer(0)] | None = None
    frequency: Annotated[float, Quantity("Hz", "positive")] | None = None
    effective_mass: Annotated[float, Quantity("", "positive")] | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        words = ("count", "frequency", "effective_mass")
        told = [key for key in words if getattr(self, key) is not None]
        if len(told) != 1:
            what = f"give one of them, given {' and '.join(told) or 'none'}"
            raise fail(Problem("", what, words))
        if self.effective_mass is not None and self.effective_mass >= 1:
            what = f"must be a share below 1, is {self.effective_mass:g}"
            raise fail(Problem("effective_mass", what))
        return self


def _read_modes(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Mapping | ModesSpec):
        spec, problems = read_entry(ModesSpec, value, names_of(info))
        if spec is None:
            raise fail(*problems)
        return spec
    if isinstance(value, Path) or (isinstance(value, str) and value.strip().endswith(".npz")):
        return Path(value).as_posix()
    if isinstance(value, list | tuple):
        what = f"a whole number, a table or an .npz file is expected, given {given(value)}"
        raise fail(Problem("", what))
    return Integer(0).read(value, info)


def _write_modes(value: Any, info: SerializationInfo) -> Any:
    if not isinstance(value, ModesSpec):
        return value
    return value.model_dump(mode="json", exclude_none=True, context=info.context)


_MODES = {"anyOf": [{"type": ["integer", "string"], "minimum": 0}, reference(ModesSpec)]}
Modes = Annotated[Any, Reader(_read_modes, _write_modes, _MODES)]
"""A number of modes, a :class:`ModesSpec`, or the .npz file of the user's own."""


def mode_count(modes: Any, default: int = 20) -> int:
    """How many modes are asked for by number; the default where it is not told by number."""
    if isinstance(modes, ModesSpec):
        return default if modes.count is None else modes.count
    return modes if isinstance(modes, int) else default


_OPTIONS = ("sections", "ties", "masses", "springs", "loads", "mass_matrix", "reduction", "stress")


class MeshBodySpec(BodySpec):
    """A flexible body to be reduced from a mesh; the mesh's own frame is the body frame.

    `units` are those of a mesh file's coordinates, by default the scene's; all else is told in the
    scene's. `modes` counts fixed-interface modes, 20 by default (free modes without interfaces).
    """

    mesh: MeshSource
    units: UnitsName = Field("scene", validate_default=True)
    material: MaterialField
    sections: Sections = {}
    interfaces: Interfaces
    ties: dict[str, Annotated[TieSpec, Entry()]] = {}
    masses: dict[str, Annotated[MassSpec, Entry()]] = {}
    springs: dict[str, Annotated[NodeSpringSpec, Entry()]] = {}
    loads: MeshLoads = {}
    reduction: Method = "craig-bampton"
    modes: Modes | None = None
    damping: Annotated[float, Quantity("", "not negative")] = 0.0
    mass_matrix: Literal["consistent", "hrz"] = "consistent"
    stress: Literal["surface", "all", "none"] = "surface"

    @model_validator(mode="after")
    def _fits(self) -> Self:
        problems = []
        if isinstance(self.mesh, MeshTableSpec) and "units" in self.model_fields_set:
            what = "are those of mesh files; the sizes of a shape are in the scene's units"
            problems.append(Problem("units", what))
        own = isinstance(self.modes, str)
        if own != (self.reduction == "user"):
            what = 'must be the .npz file of your own modes with reduction = "user"'
            what = what if not own else 'an .npz file goes with reduction = "user"'
            problems.append(Problem("modes", what))
        if self.reduction == "guyan" and self.modes not in (None, 0):
            problems.append(Problem("modes", "a static reduction (guyan) keeps none; leave it out"))
        if problems:
            raise fail(*problems)
        return self

    @property
    def mode_count(self) -> int:
        """How many modes are asked for by number."""
        return 0 if self.reduction == "guyan" else mode_count(self.modes)

    @property
    def cells(self) -> int:
        """How finely the table of a mesh divides it; 0 for files."""
        return self.mesh.cells if isinstance(self.mesh, MeshTableSpec) else 0

    def words(self) -> dict[str, Any]:
        """The options of a reduction as plain data in SI; those left out are at their defaults."""
        units = "SI" if isinstance(self.mesh, MeshTableSpec) else self.units
        told: dict[str, Any] = {
            "units": units,
            "material": self.material,
            "interfaces": {name: _plain(chosen) for name, chosen in self.interfaces.items()},
            "damping": self.damping,
        }
        if self.reduction != "guyan":
            told["modes"] = 20 if self.modes is None else _plain(self.modes)
        for key in _OPTIONS:
            value = getattr(self, key)
            if value != type(self).model_fields[key].default:
                told[key] = _plain(value)
        return told


def _plain(value: Any) -> Any:
    """Specifications as plain data in SI."""
    if isinstance(value, Spec):
        return value.model_dump(exclude_none=True)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value


def body_kind(keys: Any) -> type[BodySpec] | Problem:
    """Which kind of body a table with these keys is."""
    flexible = [key for key in ("mesh", "flexbody") if key in keys]
    rigid = [key for key in ("mass", "inertia", "shape", "density", "center") if key in keys]
    if len(flexible) > 1 or (flexible and rigid):
        several = " and ".join(f'"{key}"' for key in (*flexible, *rigid))
        return Problem("", f"is either rigid, or from a mesh, or a reduced body; given {several}")
    if not flexible:
        return RigidBodySpec
    return MeshBodySpec if flexible == ["mesh"] else FlexbodySpec
