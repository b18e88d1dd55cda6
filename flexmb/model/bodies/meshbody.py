"""Flexible bodies that are made of a mesh, and which kind of body a table is.

In: the words of a scene. Out: :class:`MeshBodySpec` in SI; :meth:`MeshBodySpec.words` are the
options of ``flexmb.fe.reduce``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from flexmb.errors import Problem
from flexmb.model.bodies.body import BodySpec, FlexbodySpec, RigidBodySpec
from flexmb.model.bodies.flexible import UnitsName
from flexmb.model.bodies.interfaces import Interfaces, MassSpec, NodeSpringSpec, TieSpec
from flexmb.model.bodies.material import MaterialField
from flexmb.model.bodies.meshes import MeshSource, MeshTableSpec
from flexmb.model.bodies.meshloads import MeshLoads
from flexmb.model.bodies.reduction import Method, Modes, mode_count
from flexmb.model.bodies.sections import Sections
from flexmb.model.values.quantities import Quantity
from flexmb.model.values.reading import Entry, Spec, fail

__all__ = ["MeshBodySpec", "body_kind"]

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
