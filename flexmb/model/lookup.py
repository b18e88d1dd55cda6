"""Finding objects by name: markers and their positions, frames of joints; and the checks of names.

Every body has the marker ``origin``. A rigid body, or a reduced one without modes, has ``center``
as well; a flexible body has a marker for each of its interfaces. Out: specifications, and
:class:`PlacedMarker` for the engine.

:class:`Scope` checks that the markers, joints and coordinates exist that parts of a model refer to.
In: a model, the flexible bodies that are reduced so far, and the raw tables of entries that could
not be read: their names count as existing, and their references are checked too. Out: problems with
scene paths.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.flexbody.arrays import Array
from flexmb.model.body import BodySpec, RigidBodySpec
from flexmb.model.flexible_body import FlexbodySpec
from flexmb.model.markers import (
    GroundSpec,
    MarkerSpec,
    PlacedMarker,
    place,
    rotation_matrices,
    rotation_matrix,
    triad,
)
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.reading import GROUND, ReadContext, Spec, split_reference
from flexmb.units import UnitSystem

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody


PARALLEL = 1e-9  # sine of the angle below which axes are parallel
_ORIGIN = MarkerSpec()
Bodies = Mapping[str, "FlexBody"]


class ModelData(Protocol):
    """The data of a model, as checks and lookups read them; see :class:`flexmb.Model`."""

    title: str
    folder: Path
    units: UnitSystem
    parameter_sources: dict[str, Any]
    parameters: dict[str, float]
    gravity: tuple[float, float, float] | None
    plane: str | None
    ground: GroundSpec
    bodies: dict[str, BodySpec]
    curves: dict[str, Any]
    joints: dict[str, Any]
    couplers: dict[str, Any]
    drivers: dict[str, Any]
    forces: dict[str, Any]
    sensors: dict[str, Any]
    states: dict[str, Any]
    controllers: dict[str, Any]
    checks: list[Any]
    frequency_checks: list[Any]
    mode_checks: list[Any]
    part_checks: list[Any]
    part: Any
    assembly: Any
    dynamics: Any
    effects: Any
    kinematics: Any
    statics: Any
    results: Any
    study: Any
    view: Any

    @property
    def context(self) -> ReadContext: ...

    def check_context(self, fields: Mapping[str, Any]) -> ReadContext: ...

    def check_unit(self, fields: Mapping[str, Any]) -> str | None: ...

    def channels(self) -> tuple[str, ...]: ...

    def stress_channels(self) -> tuple[str, ...]: ...

    def channel_unit(self, channel: str) -> str | None: ...

    def path(self, name: str) -> Path: ...


class NamedMarker(NamedTuple):
    """A marker by name."""

    body: str
    name: str
    spec: MarkerSpec


def flexbody_of(model: ModelData, body: str, flexbodies: Bodies) -> FlexBody | None:
    """The FlexBody of a body, if it is known."""
    spec = model.bodies.get(body)
    if body in flexbodies:
        return flexbodies[body]
    if isinstance(spec, FlexbodySpec) and not isinstance(spec.flexbody, str):
        return spec.flexbody  # type: ignore[no-any-return]
    return None


def has_all_markers(model: ModelData, body: str, flexbodies: Bodies) -> bool:
    """Whether all markers of the body are known before it is reduced or read."""
    spec = model.bodies.get(body)
    return not isinstance(spec, FlexbodySpec) or flexbody_of(model, body, flexbodies) is not None


def automatic_markers(model: ModelData, body: str, flexbodies: Bodies) -> tuple[str, ...]:
    """Names of the markers a body has automatically."""
    center = () if _center(model, body, flexbodies) is None else ("center",)
    return tuple(dict.fromkeys(("origin", *center, *_interfaces(model, body, flexbodies))))


def _interfaces(model: ModelData, body: str, flexbodies: Bodies) -> tuple[str, ...]:
    """Names of the interfaces of a body."""
    flexbody = flexbody_of(model, body, flexbodies)
    if flexbody is not None:
        return tuple(interface.name for interface in flexbody.interfaces)
    spec = model.bodies.get(body)
    return tuple(spec.interfaces) if isinstance(spec, MeshBodySpec) else ()


def _center(model: ModelData, body: str, flexbodies: Bodies) -> tuple[float, float, float] | None:
    """Centre of mass (3,) of a body without deformation, in its frame [m]; None for others."""
    spec = model.bodies.get(body)
    if isinstance(spec, RigidBodySpec):
        return spec.center
    flexbody = flexbody_of(model, body, flexbodies)
    if flexbody is None or flexbody.m > 0 or not isinstance(spec, FlexbodySpec):
        return None
    x, y, z = flexbody.center.tolist()
    return x, y, z


def _own_markers(model: ModelData, body: str) -> Mapping[str, MarkerSpec]:
    """The markers that the scene defines on a body."""
    return (model.ground if body == GROUND else model.bodies[body]).markers


def marker_names(model: ModelData, body: str, flexbodies: Bodies | None = None) -> tuple[str, ...]:
    """Names of the markers of a body."""
    automatic = automatic_markers(model, body, flexbodies or {})
    return tuple(dict.fromkeys((*automatic, *_own_markers(model, body))))


def has_marker(model: ModelData, body: str, name: str, flexbodies: Bodies | None = None) -> bool:
    """Whether a body has a marker of that name."""
    if name == "origin" or name in _own_markers(model, body):
        return True
    return name in automatic_markers(model, body, flexbodies or {})


def _automatic(model: ModelData, body: str, name: str, flexbodies: Bodies) -> MarkerSpec:
    """An automatic marker of a body; any other name is an interface of the reduced body."""
    if name not in _interfaces(model, body, flexbodies):
        center = _center(model, body, flexbodies)
        if name == "origin":
            return _ORIGIN
        if name == "center" and center is not None:
            return MarkerSpec.model_construct(position=center)
    return MarkerSpec(interface=name)


def missing(model: ModelData, reference: str, flexbodies: Bodies) -> Problem | None:
    """The problem of a reference to a marker that does not exist; its ``where`` is empty."""
    body, marker = split_reference(reference)
    if body != GROUND and body not in model.bodies:
        bodies = (*model.bodies, GROUND)
        return Problem("", f'unknown body "{body}"', bodies, nearest(body, bodies))
    if has_marker(model, body, marker, flexbodies) or not has_all_markers(model, body, flexbodies):
        return None
    names = marker_names(model, body, flexbodies)
    what = f'body "{body}" has no marker "{marker}"'
    return Problem("", what, names, nearest(marker, names))


def find(model: ModelData, reference: str, flexbodies: Bodies | None = None) -> NamedMarker:
    """The marker that a reference names.

    Raises
    ------
    SceneError
        No such body or marker.
    """
    flexbodies = flexbodies or {}
    problem = missing(model, reference, flexbodies)
    if problem is not None:
        raise SceneError.from_problems([problem])
    body, name = split_reference(reference)
    own = _own_markers(model, body)
    spec = own[name] if name in own else _automatic(model, body, name, flexbodies)
    return NamedMarker(body, name, spec)


def pose(body: BodySpec) -> tuple[Array, Array]:
    """Placed position r (3,) [m] and Euler parameters p (4,), scalar first, of a body frame."""
    return np.array(body.position), np.array(body.orientation)


def places(model: ModelData, body: str, flexbodies: Bodies) -> list[Sequence[float] | Array]:
    """Positions (3,) of all markers of a body, undeformed and in its frame [m]."""
    if flexbody_of(model, body, flexbodies) is not None:
        names = marker_names(model, body, flexbodies)
        return [place_marker(model, f"{body}.{name}", flexbodies).position for name in names]
    origin = (0.0, 0.0, 0.0)
    own = [marker.position or origin for marker in _own_markers(model, body).values()]
    return [origin, _center(model, body, flexbodies) or origin, *own]


def poses(model: ModelData) -> tuple[Array, Array]:
    """Placed positions r (n + 1, 3) [m] and axes A (n + 1, 3, 3) of all bodies, ground the last."""
    specs = model.bodies.values()
    r = np.array([*(spec.position for spec in specs), (0.0, 0.0, 0.0)])
    p = np.array([*(spec.orientation for spec in specs), (1.0, 0.0, 0.0, 0.0)])
    return r, rotation_matrices(p)


def place_marker(
    model: ModelData, reference: str, flexbodies: Bodies | None = None
) -> PlacedMarker:
    """The marker in the form that the engine needs; flexible bodies must be given.

    Raises
    ------
    SceneError
        No such body, marker, node or interface.
    """
    flexbodies = flexbodies or {}
    body, _, spec = find(model, reference, flexbodies)
    return place(body, spec, flexbody_of(model, body, flexbodies))


def frames(
    model: ModelData, between: tuple[str, str], axis: Any, flexbodies: Bodies | None = None
) -> tuple[PlacedMarker, PlacedMarker]:
    """Markers I and J of a joint whose axes R are the joint's triad (z: the axis).

    Parameters
    ----------
    model : ModelData
        The model.
    between : pair of str
        References I and J.
    axis : (3,) float or None
        Global direction in the placed pose, where both triads then coincide (angle 0); None: the
        markers' own axes.
    flexbodies : mapping, optional
        The flexible bodies by name.
    """
    I, J = (place_marker(model, reference, flexbodies) for reference in between)  # noqa: E741
    if axis is None:
        return I, J
    R = triad(axis)
    return _with_global_axes(model, I, R), _with_global_axes(model, J, R)


def joint_frames(
    model: ModelData, name: str, flexbodies: Bodies | None = None
) -> tuple[PlacedMarker, PlacedMarker]:
    """Markers I and J of a joint with its triads; if it has two axes, z_I is the first, z_J the
    second.

    With two axes, x_I lies in their plane, normal to the first and towards the second; x_J is x_I
    after the rotation that takes the first axis to the second. Parallel axes give equal triads.
    """
    joint = model.joints[name]
    if joint.kind.curves:  # the curve lies in the axes of its marker
        I, J = (place_marker(model, reference, flexbodies) for reference in joint.between)  # noqa: E741
        return I, J if joint.axis is None else _with_global_axes(model, J, triad(joint.axis))
    if joint.axis is None or joint.second_axis is None:
        return frames(model, joint.between, joint.axis, flexbodies)
    I, J = (place_marker(model, reference, flexbodies) for reference in joint.between)  # noqa: E741
    first, second = (
        np.array(axis) / np.linalg.norm(axis) for axis in (joint.axis, joint.second_axis)
    )
    across = np.cross(first, second)
    if np.linalg.norm(across) < PARALLEL:
        R = R_J = triad(first)
    else:
        y = across / np.linalg.norm(across)
        R, R_J = (np.column_stack([np.cross(y, z), y, z]) for z in (first, second))
    return _with_global_axes(model, I, R), _with_global_axes(model, J, R_J)


def _with_global_axes(model: ModelData, marker: PlacedMarker, R: Array) -> PlacedMarker:
    """The marker with axes R (3, 3) that are global in the placed pose."""
    return with_axes(marker, R if marker.body == GROUND else body_axes(model, marker.body).T @ R)


def with_axes(marker: PlacedMarker, R: Array) -> PlacedMarker:
    """The marker with axes R (3, 3) in body axes."""
    return replace(marker, R=R)


def body_axes(model: ModelData, body: str) -> Array:
    """Axes A (3, 3) of a body or of ground in the placed pose, as global columns."""
    return np.eye(3) if body == GROUND else rotation_matrix(model.bodies[body].orientation)


def global_axes(model: ModelData, marker: PlacedMarker) -> Array:
    """Axes (3, 3) of a marker in the placed pose, global."""
    axes: Array = body_axes(model, marker.body) @ marker.R
    return axes


def global_position(model: ModelData, marker: PlacedMarker) -> Array:
    """Position (3,) of a marker in the placed, undeformed pose, global [m]."""
    if marker.body == GROUND:
        return marker.position
    r, p = pose(model.bodies[marker.body])
    moved: Array = r + rotation_matrix(p) @ marker.position
    return moved


Broken = Mapping[str, Mapping[str, Any]]
_REFERENCES = ("between", "at", "of", "relative_to", "marker")


class Component(Spec):
    """Base of joints, couplers, drivers, forces and sensors: what acts on bodies or measures
    them."""

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        """Problems of the entry in its model; ``where`` is its scene path."""
        yield from ()

    def planar_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        """Problems of the entry in a planar scene; called only if `problems` has none."""
        yield from ()


@dataclass(frozen=True)
class Scope:
    """A model under check."""

    model: ModelData
    flexbodies: Bodies
    broken: Broken

    def names(self, section: str) -> tuple[str, ...]:
        """Names in a section, including those of entries that could not be read."""
        return (*getattr(self.model, section), *self.broken.get(section, {}))

    def has(self, section: str, name: str) -> bool:
        """Whether a section has an entry of that name, even if it could not be read."""
        return name in getattr(self.model, section) or name in self.broken.get(section, {})

    def unknown(self, where: str, noun: str, name: str, section: str) -> Iterator[Problem]:
        """The problem of a name that its section does not have."""
        if not self.has(section, name):
            names = self.names(section)
            yield Problem(where, f'unknown {noun} "{name}"', names, nearest(name, names))

    def markers(self, section: str) -> Iterator[Problem]:
        """Problems of references to markers, in entries that were read and in those that were
        not."""
        tables = {name: vars(spec) for name, spec in getattr(self.model, section).items()}
        for name, table in {**tables, **self.broken.get(section, {})}.items():
            for key in _REFERENCES if isinstance(table, Mapping) else ():
                value = table.get(key)
                pair = isinstance(value, list | tuple)
                for i, reference in enumerate(value if pair else (value,)):
                    where = f"{section}.{name}.{key}" + (f"[{i}]" if pair else "")
                    if isinstance(reference, str):
                        yield from self.marker(where, reference)

    def marker(self, where: str, reference: str, *words: str) -> Iterator[Problem]:
        """The problem of a marker that does not exist; of axes that are none of `words` either."""
        body = split_reference(reference)[0]
        if reference in words:
            return
        if body != GROUND and not self.has("bodies", body):
            noun, also = ("axes", words) if words and body == reference else ("body", ())
            names = (*also, *self.names("bodies"), GROUND)
            yield Problem(where, f'unknown {noun} "{body}"', names, nearest(body, names))
        elif body not in self.broken.get("bodies", {}):
            problem = missing(self.model, reference, self.flexbodies)
            if problem is not None:
                yield Problem(where, problem.what, problem.allowed, problem.nearest)

    def pair(self, where: str, between: tuple[str, str], noun: str) -> Iterator[Problem]:
        """Problems of two markers: they must be on different bodies, at material points."""
        first, second = (split_reference(reference)[0] for reference in between)
        if first == second:
            what = f'{noun} connects two bodies, both markers are on "{first}"'
            yield Problem(f"{where}.between", what)
        for i, reference in enumerate(between):
            yield from self.material(f"{where}.between[{i}]", reference)

    def material(self, where: str, reference: str) -> Iterator[Problem]:
        """The problem of the floating frame of a flexible body, which is no material point of
        it."""
        body = split_reference(reference)[0]
        spec = self.model.bodies.get(body)
        if spec is None or not spec.flexible or any(self.marker(where, reference)):
            return
        flexbody = flexbody_of(self.model, body, self.flexbodies)
        rigid = flexbody is not None and flexbody.m == 0
        if find(self.model, reference, self.flexbodies).spec.is_frame and not rigid:
            names = marker_names(self.model, body, self.flexbodies)
            names = tuple(f"{body}.{name}" for name in names if name != "origin")
            what = f'"{reference}" is the floating frame of a flexible body, no material point'
            yield Problem(where, what, names)

    def line(self, between: tuple[str, str]) -> Array | None:
        """The vector from marker I to J (3,) [m] in the placed pose; None if it is not known
        yet."""
        model = self.model
        try:
            ends = [place_marker(model, marker, self.flexbodies) for marker in between]
        except FlexmbError:
            return None
        for body in {end.body for end in ends} - {GROUND}:
            flexbody = flexbody_of(model, body, self.flexbodies)
            if model.bodies[body].flexible and flexbody is None:
                return None
        I, J = (global_position(model, end) for end in ends)  # noqa: E741
        return J - I

    def line_problems(self, where: str, between: tuple[str, str], noun: str) -> Iterator[Problem]:
        """The problem of two markers at one point, between which no direction is defined."""
        line = self.line(between)
        if line is not None and np.linalg.norm(line) == 0:
            what = f"its markers coincide in the placed pose: the direction of the {noun} is "
            yield Problem(f"{where}.between", what + "undefined (zero length)")

    def coordinate(self, where: str, joint: str, coordinate: str) -> Iterator[Problem]:
        """Problems of a joint that does not exist, or does not have this coordinate."""
        yield from self.unknown(f"{where}.joint", "joint", joint, "joints")
        if joint in self.model.joints:
            kind = self.model.joints[joint].kind
            if coordinate not in kind.coordinates:
                has = " and ".join(kind.coordinates) or "no coordinate"
                what = f'the {kind.name} joint "{joint}" has no {coordinate}; it has: {has}'
                yield Problem(f"{where}.{coordinate}", what)
