"""Options of a body made of a mesh: interfaces, connections, loads, modes, material.

Scenes (in their units) and :func:`flexmb.fe.reduce` (in SI) read these options. Nodes are numbered
from 0 in the order of the mesh; vectors are in body axes. Sections are in
:mod:`flexmb.flexbody.section_options`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from flexmb.errors import Problem
from flexmb.flexbody.options import Kind, Number, Position, Say, Size, Unit, Whole

Group = Annotated[str, Kind("group")]
NodeOrGroup = Annotated[Any, Kind("node or group")]
Direction = Annotated[Any, Kind("direction")]
MaterialOption = Annotated[Any, Kind("material")]
Divisions = Annotated[Any, Kind("divisions")]
Surface = Literal["quad", "triangle"]
Solid = Literal["hexahedron20", "hexahedron27", "hexahedron", "tetra10", "tetra", "wedge15"]
Either = Literal[
    "hexahedron20", "hexahedron27", "hexahedron", "tetra10", "tetra", "wedge15", "quad", "triangle"
]
_Pressure = Annotated[float, Unit("Pa")]
_PerLength = Annotated[float, Unit("N/m")]
_Force = Annotated[float, Unit("N")]
_Moment = Annotated[float, Unit("N m")]
_Acceleration = Annotated[float, Unit("m/s^2")]
_Modulus = Annotated[float, Unit("Pa", "positive")]
_Density = Annotated[float, Unit("kg/m^3", "positive")]

_SELECTORS = ("group", "node", "nodes", "center")


@dataclass(frozen=True, kw_only=True)
class NodeOptions:
    """Nodes of a mesh: a group, one node, several, or all within a radius of a center."""

    group: Group | None = None
    node: Annotated[int, Whole(0)] | None = None
    nodes: tuple[Annotated[int, Whole(0)], ...] | None = None
    center: Position | None = None
    radius: Size | None = None
    weights: Annotated[Any, Kind("weights")] | None = None
    position: Position | None = None

    def check(self, say: Say) -> list[Problem]:
        """Exactly one way to select nodes; a radius belongs to a center."""
        words = [key for key in _SELECTORS if getattr(self, key) is not None]
        if len(words) != 1:
            what = f"has {' and '.join(words)}" if words else "has no nodes"
            what += "; give one of group, node, nodes, or center with radius"
            return [Problem("", what, _SELECTORS)]
        if (self.center is None) != (self.radius is None):
            return [Problem("", '"center" and "radius" go together')]
        return []


@dataclass(frozen=True, kw_only=True)
class InterfaceOptions(NodeOptions):
    """Nodes that carry a marker: a group, one node, several, or all within a radius of a center.

    They move rigidly with the marker (rbe2), or the marker with their weighted mean (rbe3);
    `weights` are uniform, the area of each node, or one number for each. The marker lies in the
    centroid of a group, or at `position`.
    """

    type: Literal["rbe2", "rbe3"] = "rbe2"

    def check(self, say: Say) -> list[Problem]:
        """Weights are allowed for the mean motion (rbe3) only."""
        problems = NodeOptions.check(self, say)
        if self.weights is not None and self.type == "rbe2":
            what = 'are for type = "rbe3"; nodes of an rbe2 move rigidly'
            problems.append(Problem("weights", what))
        return problems


@dataclass(frozen=True, kw_only=True)
class TieOptions:
    """Nodes that follow a reference node rigidly (rbe2), or a reference that follows their mean."""

    type: Literal["rbe2", "rbe3"] = "rbe2"
    reference: NodeOrGroup
    nodes: Group


@dataclass(frozen=True, kw_only=True)
class MassOptions:
    """A mass at a node, with an inertia about its own center and an offset to that; or one spread
    over the nodes of a group."""

    at: NodeOrGroup
    mass: Annotated[float, Unit("kg", "not negative")]
    inertia: Annotated[Any, Kind("inertia")] | None = None
    offset: Position | None = None

    def check(self, say: Say) -> list[Problem]:
        """Mass or inertia must be given."""
        if self.mass == 0 and self.inertia is None:
            return [Problem("mass", "must be positive where there is no inertia, is 0")]
        return []


@dataclass(frozen=True, kw_only=True)
class NodeSpringOptions:
    """A spring between two nodes: along their line, or along and about axes halfway between them.

    `axes` are the directions of the first and the second of them; the body's by default.
    """

    between: tuple[NodeOrGroup, NodeOrGroup]
    stiffness: Annotated[Any, Kind("stiffness")]
    axes: tuple[Direction, Direction] | None = None

    def check(self, say: Say) -> list[Problem]:
        """Axes are allowed with six stiffnesses only."""
        if self.axes is not None and not hasattr(self.stiffness, "__len__"):
            return [Problem("axes", "belong to a spring with six stiffnesses")]
        return []


@dataclass(frozen=True, kw_only=True)
class PressureLoad:
    """Pressure on a group of surfaces: it pushes on solids, and along the normal of shells."""

    type: Literal["pressure"]
    group: Group
    pressure: _Pressure
    residual: bool = True


@dataclass(frozen=True, kw_only=True)
class TractionLoad:
    """Force per area, body axes, on a group of surfaces."""

    type: Literal["traction"]
    group: Group
    traction: tuple[_Pressure, _Pressure, _Pressure]
    residual: bool = True


@dataclass(frozen=True, kw_only=True)
class LineLoad:
    """Force per length, body axes, on a group of lines."""

    type: Literal["line"]
    group: Group
    force: tuple[_PerLength, _PerLength, _PerLength]
    residual: bool = True


@dataclass(frozen=True, kw_only=True)
class PointLoad(NodeOptions):
    """Force and moment, body axes, on nodes selected as for an interface."""

    type: Literal["force"]
    force: tuple[_Force, _Force, _Force] | None = None
    moment: tuple[_Moment, _Moment, _Moment] | None = None
    residual: bool = True

    def check(self, say: Say) -> list[Problem]:
        """Force or moment must be given."""
        problems = NodeOptions.check(self, say)
        if self.force is None and self.moment is None:
            problems.append(Problem("", 'give "force", "moment" or both'))
        return problems


@dataclass(frozen=True, kw_only=True)
class GravityLoad:
    """The weight in a field of gravity, body axes; it deforms no free body."""

    type: Literal["gravity"]
    acceleration: tuple[_Acceleration, _Acceleration, _Acceleration]
    residual: bool = False


LOADS: dict[str, type] = {
    "pressure": PressureLoad,
    "traction": TractionLoad,
    "line": LineLoad,
    "force": PointLoad,
    "gravity": GravityLoad,
}
"""Load patterns by type."""


@dataclass(frozen=True, kw_only=True)
class ModesOptions:
    """How many modes: a count, those below a frequency, a share of effective interface mass."""

    count: Annotated[int, Whole(0)] | None = None
    frequency: Annotated[float, Unit("Hz", "positive")] | None = None
    effective_mass: Annotated[float, Unit("", "positive")] | None = None

    def check(self, say: Say) -> list[Problem]:
        """Exactly one of the three; a share is below one."""
        names = ("count", "frequency", "effective_mass")
        words = [key for key in names if getattr(self, key) is not None]
        if len(words) != 1:
            what = f"give one of them, given {' and '.join(words) or 'none'}"
            return [Problem("", what, names)]
        if self.effective_mass is not None and self.effective_mass >= 1:
            what = f"must be a share below 1, is {self.effective_mass:g}"
            return [Problem("effective_mass", what)]
        return []


REDUCTIONS = {
    "craig-bampton": "static modes of the interfaces and modes with the interfaces fixed: "
    "6 interfaces + modes - 6 coordinates",
    "free-interface": "modes of the free body and residual attachment modes: up to modes + "
    "6 interfaces coordinates",
    "guyan": "static modes of the interfaces alone: 6 interfaces - 6 coordinates",
    "user": "modes of an .npz file, by modes = path",
}
"""What each reduction method keeps."""
MASS_MATRICES = ("consistent", "hrz")
"""Ways to build the mass matrix."""
STIFFENINGS = ("none", "full")
"""Words of ``geometric_stiffening``."""
RESIDUALS = {
    "none": "the modes alone",
    "inertia": "and the static responses to the body's own inertia loads, up to 12",
}
"""What residual vectors a reduction adds to its modes."""
STRESS_OPTIONS = ("surface", "all", "none")
"""Where stress is recovered."""


@dataclass(frozen=True, kw_only=True)
class BeamMesh:
    """Lines along x from the origin, or along `points`; groups start, end, leg1, corner1, ..."""

    type: Literal["beam"]
    length: Size | None = None
    points: tuple[Position, ...] | None = None
    divisions: Divisions | None = None

    def check(self, say: Say) -> list[Problem]:
        """Either length or points."""
        if (self.length is None) == (self.points is None):
            words = "neither" if self.length is None else "both"
            return [Problem("", f'give either "length" or "points", given {words}')]
        return []


@dataclass(frozen=True, kw_only=True)
class PlateMesh:
    """Surfaces in the xy plane, x from 0, centred in y; groups surface, x0, x1, y0, y1, corners.
    Divisions along x, y."""

    type: Literal["plate"]
    length: Size
    width: Size
    divisions: Divisions | None = None
    elements: Surface = "quad"
    skew: Annotated[float, Unit("rad")] = 0.0


@dataclass(frozen=True, kw_only=True)
class BoxMesh:
    """A box of solids, x from 0, centred in y and z; groups x0, x1, y0, y1, z0, z1. Divisions along
    x, y, z."""

    type: Literal["box"]
    size: tuple[Size, Size, Size]
    divisions: Divisions | None = None
    elements: Solid = "hexahedron20"


@dataclass(frozen=True, kw_only=True)
class TubeMesh:
    """A hollow cylinder along x, of solids if it has `inner`; groups start, end, inner, outer.
    Divisions through the wall (of solids), around, along."""

    type: Literal["tube"]
    length: Size
    radius: Size
    inner: Size | None = None
    divisions: Divisions | None = None
    elements: Either | None = None


@dataclass(frozen=True, kw_only=True)
class DiskMesh:
    """A disk around the origin, normal z, of solids if it has `thickness`; groups inner, outer,
    bottom, top. Divisions along the radius, around, through the thickness (of solids)."""

    type: Literal["disk"]
    radius: Size
    inner: Annotated[float, Unit("m", "not negative")] = 0.0
    thickness: Size | None = None
    divisions: Divisions | None = None
    elements: Either | None = None


MESHES: dict[str, type] = {
    "beam": BeamMesh,
    "plate": PlateMesh,
    "box": BoxMesh,
    "tube": TubeMesh,
    "disk": DiskMesh,
}
"""Meshes of simple shapes by type."""


@dataclass(frozen=True, kw_only=True)
class MaterialOptions:
    """The same in all directions: Young's modulus, Poisson's ratio, density."""

    name: str = "given"
    E: _Modulus
    nu: Number
    density: _Density
    source: str = "given by the user"


@dataclass(frozen=True, kw_only=True)
class OrthotropicOptions:
    """Three directions 1, 2, 3: E of each, nu and G of the planes 12, 23, 13, density."""

    name: str = "given"
    E: tuple[_Modulus, _Modulus, _Modulus]
    nu: tuple[Number, Number, Number]
    G: tuple[_Modulus, _Modulus, _Modulus]
    density: _Density
    source: str = "given by the user"


MATERIALS: dict[str, type] = {"isotropic": MaterialOptions, "orthotropic": OrthotropicOptions}
"""What a table of a material may be."""
