"""Options of a part analysis: supports, loads, and what is computed.

Scenes (``[part]``, in their units) and :func:`flexmb.fe.part` (in SI) read these options. Vectors
are in the axes of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal

from flexmb.errors import Problem
from flexmb.flexbody.mesh_options import LOADS, Direction, NodeOptions
from flexmb.flexbody.options import Kind, OneOf, Position, Say, Unit, Whole
from flexmb.flexbody.section_options import Motion

MOTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
"""Translations and rotations, axes of the mesh."""
SUPPORTS = {
    "clamped": "no motion at all",
    "hinged": "no translation; about `axis` it turns freely, or about all axes without one",
    "sliding": "no translation along the normal of a plane",
    "symmetric": "a plane of symmetry: no translation along its normal, no rotation out of it",
    "antisymmetric": "a plane of antisymmetry: the motions that a plane of symmetry leaves",
}
"""Types of supports."""
_PLANAR = ("sliding", "symmetric", "antisymmetric")
_Motions = tuple[
    Annotated[float, Unit("m")], Annotated[float, Unit("m")], Annotated[float, Unit("m")]
]
_Angles = tuple[
    Annotated[float, Unit("rad")], Annotated[float, Unit("rad")], Annotated[float, Unit("rad")]
]
_Forces = tuple[
    Annotated[float, Unit("N")], Annotated[float, Unit("N")], Annotated[float, Unit("N")]
]
_Moments = tuple[
    Annotated[float, Unit("N m")], Annotated[float, Unit("N m")], Annotated[float, Unit("N m")]
]
_Spin = Annotated[float, Unit("rad/s")]
_SpinUp = Annotated[float, Unit("rad/s^2")]
Name = Annotated[str, Kind("group")]


@dataclass(frozen=True, kw_only=True)
class SupportOptions(NodeOptions):
    """What an interface, or each node of a group, cannot do.

    `type` is clamped, hinged, sliding, symmetric or antisymmetric; or `hold` lists the motions ux,
    uy, uz, rx, ry, rz. `normal` is that of the plane of a sliding or symmetric support, the plane
    of its nodes by default; `axis` that of a hinge. `displacement` and `rotation`, about `position`
    (the middle of the nodes by default), are imposed on what is held.
    """

    interface: Name | None = None
    type: Literal["clamped", "hinged", "sliding", "symmetric", "antisymmetric"] | None = None
    hold: tuple[Motion, ...] | None = None
    normal: Direction | None = None
    axis: Direction | None = None
    displacement: _Motions | None = None
    rotation: _Angles | None = None

    def check(self, say: Say) -> list[Problem]:
        """Exactly one place, one way to say what is held, and only options that belong to it."""
        problems = [] if self.interface is not None else NodeOptions.check(self, say)
        if self.interface is not None:
            nodes = [f.name for f in fields(NodeOptions) if getattr(self, f.name) is not None]
            if nodes:
                what = f'"interface" says where it is; remove {" and ".join(nodes)}'
                problems.append(Problem("interface", what))
        if self.weights is not None:
            problems.append(Problem("weights", "nodes of a support are held one by one: remove it"))
        if (self.type is None) == (self.hold is None):
            words = "neither" if self.type is None else "both"
            problems.append(Problem("", f'give "type" or "hold", given {words}', tuple(SUPPORTS)))
        if self.hold is not None and not self.hold:
            problems.append(Problem("hold", "holds nothing", MOTIONS))
        if self.normal is not None and self.type not in _PLANAR:
            problems.append(Problem("normal", f"belongs to the types {', '.join(_PLANAR)}"))
        if self.axis is not None and self.type != "hinged":
            problems.append(Problem("axis", "belongs to the type hinged"))
        return problems


@dataclass(frozen=True, kw_only=True)
class InterfaceLoad:
    """Force and moment, axes of the mesh, at an interface."""

    type: Literal["interface"]
    interface: Name
    force: _Forces | None = None
    moment: _Moments | None = None

    def check(self, say: Say) -> list[Problem]:
        """Force or moment must be given."""
        if self.force is None and self.moment is None:
            return [Problem("", 'give "force", "moment" or both')]
        return []


@dataclass(frozen=True, kw_only=True)
class SpinLoad:
    """The part turns: inertia loads of an angular velocity and acceleration about `position`."""

    type: Literal["spin"]
    angular_velocity: tuple[_Spin, _Spin, _Spin] = (0.0, 0.0, 0.0)
    angular_acceleration: tuple[_SpinUp, _SpinUp, _SpinUp] = (0.0, 0.0, 0.0)
    position: Position = (0.0, 0.0, 0.0)

    def check(self, say: Say) -> list[Problem]:
        """It must rotate or accelerate."""
        if not any((*self.angular_velocity, *self.angular_acceleration)):
            return [Problem("", 'give "angular_velocity", "angular_acceleration" or both')]
        return []


PART_LOADS: dict[str, type] = {**LOADS, "interface": InterfaceLoad, "spin": SpinLoad}
"""Loads on a part by type."""


@dataclass(frozen=True, kw_only=True)
class FrequenciesOptions:
    """Which natural frequencies: the lowest `count`, or all of a band."""

    count: Annotated[int, Whole(1)] | None = None
    band: tuple[Annotated[float, Unit("Hz")], Annotated[float, Unit("Hz")]] | None = None

    def check(self, say: Say) -> list[Problem]:
        """Exactly one of the two; a band ascends."""
        if (self.count is None) == (self.band is None):
            words = "neither" if self.count is None else "both"
            return [Problem("", f'give "count" or "band", given {words}')]
        if self.band is not None and not 0 <= self.band[0] < self.band[1]:
            return [Problem("band", "must be two frequencies, the lower one first")]
        return []


@dataclass(frozen=True, kw_only=True)
class PartAnalysisOptions:
    """A part by itself: its supports and loads; static solution, frequencies, buckling.

    Where there are loads, or imposed displacements, the static solution is found. `frequencies`
    are those of the part as supported, `buckling` is how many load factors are sought, and with
    `preload` the static stress (and spin) stiffens or softens the part in its frequencies.
    """

    supports: dict[str, SupportOptions] = field(default_factory=dict)
    loads: dict[str, Annotated[Any, OneOf("load type", PART_LOADS)]] = field(default_factory=dict)
    frequencies: FrequenciesOptions | None = None
    buckling: Annotated[int, Whole(0)] = 0
    preload: bool = False

    def check(self, say: Say) -> list[Problem]:
        """There must be something to compute, and loads where they are needed."""
        loaded, problems = is_static(self), []
        if not (loaded or self.frequencies or self.buckling):
            problems.append(Problem("", "nothing to compute: give loads, frequencies or both"))
        if self.buckling and not loaded:
            problems.append(Problem("buckling", "loads buckle a part, and there are none"))
        if self.preload and not (loaded and self.frequencies):
            problems.append(Problem("preload", "goes with loads and with frequencies"))
        return problems


def is_static(part: PartAnalysisOptions) -> bool:
    """Whether there are loads or imposed displacements, so that a static solution is needed."""
    moved = (s.displacement or s.rotation for s in part.supports.values())
    return bool(part.loads) or any(moved)
