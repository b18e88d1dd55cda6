"""Joints: what they leave free between two markers, as data.

``axis`` is a global direction in the placed pose, where the joint angle is 0. Without it, the axis
is the z axis of both markers, and the angle is measured between their x axes. Joints with two axes
also take ``second_axis``, that of marker J. The stroke is the distance from marker I to marker J
along the axis. The angle of a universal joint is the rotation of its cross about the first axis,
the second angle that of J relative to the cross about its own axis. Composite joints replace a
massless link between the two markers with a joint at each end; their lengths and offsets are those
of the placed pose. Equations: Shabana, Dynamics of Multibody Systems, ch. 3; Hong & Liu 2011,
sections 1.3, 2.3.

Counts of a model are the numbers of its coordinates and equations. The mobility is the Grübler
number, coordinates minus equations; it is too small if equations are redundant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from pydantic import ValidationInfo, model_validator

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.body import RigidBodySpec
from flexmb.model.joints.curve import CurveShape, curve_shape
from flexmb.model.lookup import Bodies, Component, ModelData, Scope
from flexmb.model.plane import ALIGNED, across, axis_of_joint, keeps_plane, normal_in_body
from flexmb.model.quantities import Axis, Length, Pair, Size, Text
from flexmb.model.reading import GROUND, Reader, fail, fail_if, quote

COORDINATES = ("angle", "second_angle", "stroke")
"""Joint coordinates: angle [rad] about the axis or the second axis, stroke [m] along the axis."""


@dataclass(frozen=True)
class JointType:
    """One row of the table of joints.

    ``equations`` in space and in a plane (None: no meaning in a plane); number of ``axes``: 0, 1 or
    2, where the second is that of marker J; number of ``curves`` along which it slides, fixed to I,
    then to J.
    """

    name: str
    equations: int
    planar_equations: int | None
    coordinates: tuple[str, ...]
    axes: int
    summary: str
    curves: int = 0

    @property
    def has_axis(self) -> bool:
        """Whether it has any axis."""
        return self.axes > 0

    @property
    def freedoms(self) -> int:
        """Number of relative motions left free between two bodies in space."""
        return 6 - self.equations


# In a plane: joints whose axes are normal to it, and joints whose axes lie in it.
_ABOUT = ("revolute", "revolute-revolute")
_ALONG = ("prismatic", "in-line", "in-plane", "prismatic-spherical")
_BOTH = ("angle", "stroke")
_TABLE = (
    ("fixed", 6, 3, (), 0, "holds both markers together, place and axes"),
    ("revolute", 5, 2, ("angle",), 1, "turns about its axis"),
    ("prismatic", 5, 2, ("stroke",), 1, "slides along its axis"),
    ("screw", 5, None, _BOTH, 1, "moves along its axis by the pitch for every turn about it"),
    ("cylindrical", 4, 2, _BOTH, 1, "turns about and slides along its axis"),
    ("spherical", 3, 2, (), 0, "holds the markers' points together"),
    (
        "universal",
        4,
        None,
        ("angle", "second_angle"),
        2,
        "turns about an axis of I and one of J across it",
    ),
    ("constant-velocity", 4, None, (), 2, "joins two shafts that turn with equal speeds"),
    ("planar", 3, None, ("angle",), 1, "slides in the plane across its axis, and turns about it"),
    ("in-line", 2, 1, ("stroke",), 1, "keeps the point J on the axis through I"),
    ("in-plane", 1, 1, (), 1, "keeps the point J in the plane across the axis through I"),
    ("parallel", 2, None, ("angle",), 1, "keeps the axes of I and J parallel"),
    ("perpendicular", 1, None, (), 2, "keeps an axis of I and one of J at right angles"),
    ("orientation", 3, 1, (), 0, "keeps the axes of I and J parallel, all three"),
    ("distance", 1, 1, (), 0, "link with a spherical joint at each end (a rod)"),
    ("revolute-spherical", 2, None, (), 1, "link with a revolute joint at I, a spherical at J"),
    ("prismatic-spherical", 2, 1, ("stroke",), 1, "link that slides on I, spherical joint at J"),
    ("cylindrical-spherical", 1, None, (), 1, "link that turns and slides on I, spherical at J"),
    ("revolute-revolute", 4, 1, (), 2, "link with a revolute joint at each end"),
    ("revolute-cylindrical", 3, None, (), 2, "link with a revolute joint at I, cylindrical at J"),
    ("revolute-universal", 3, None, (), 2, "link with a revolute joint at I, universal at J"),
    ("spherical-universal", 1, None, (), 0, "link with a spherical joint at I, universal at J"),
    ("pin-in-slot", 1, 1, (), 0, "keeps the point J on the plane curve of I, free across it", 1),
    ("point-on-curve", 2, 1, (), 0, "keeps the point J on the curve of I, in space as well", 1),
    ("cam-knife", 1, 1, (), 0, "follower with its edge at J on the cam of I", 1),
    ("cam-roller", 1, 1, (), 0, "follower with a roller about J on the cam of I", 1),
    ("cam-flat", 1, 1, (), 1, "follower with a flat through J, the axis across it, on a cam", 1),
    ("cam-cam", 1, 1, (), 0, "two cams that touch, one of I and one of J", 2),
)
JOINT_TYPES: dict[str, JointType] = {row[0]: JointType(*row) for row in _TABLE}
"""All joints by name."""


def _type(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str) or value not in JOINT_TYPES:
        names = tuple(sorted(JOINT_TYPES))
        near = nearest(str(value), names)
        raise fail(Problem("", f"unknown joint type {quote(value)}", names, near))
    return value


class JointSpec(Component):
    """A joint between the markers ``between = [I, J]``; composite joints replace a massless link.

    ``length`` of a distance joint, by default the distance in the placed pose. ``pitch`` of a
    screw: the stroke along its axis per revolution, negative for a left-handed thread. Joints on a
    ``curve``: the curve is fixed in the axes of marker I, ``second_curve`` in those of J; ``start``
    (and ``second_start``) is the initial position along the curve, by default the nearest in the
    placed pose; ``radius`` of a roller.
    """

    type: Annotated[str, Reader(_type, form={"enum": list(JOINT_TYPES)})]
    between: Pair
    axis: Axis | None = None
    second_axis: Axis | None = None
    length: Size | None = None
    pitch: Length | None = None
    curve: Text | None = None
    second_curve: Text | None = None
    radius: Size | None = None
    start: Length | None = None
    second_start: Length | None = None

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        axes = JOINT_TYPES[self.type].axes
        problems = []
        if self.axis is not None and axes < 1:
            problems.append(Problem("axis", f"{self._one} has no axis; leave it out"))
        if self.second_axis is not None and axes < 2:
            what = f"{self._one} has no second axis; leave it out"
            problems.append(Problem("second_axis", what))
        elif self.second_axis is not None and self.axis is None:
            problems.append(Problem("axis", "is missing: with second_axis both are given"))
        if self.length is not None and self.type != "distance":
            what = "only a distance joint has a length that can be given"
            problems.append(Problem("length", what))
        problems += self._thread() + self._curve_words()
        fail_if(problems)
        return self

    def _thread(self) -> list[Problem]:
        """Problems of the pitch."""
        if self.type != "screw":
            what = "only a screw has a pitch; leave it out"
            return [] if self.pitch is None else [Problem("pitch", what)]
        if self.pitch is None:
            return [Problem("pitch", "is missing: how far the screw moves in one turn")]
        what = "is zero: a screw that turns and does not move is a revolute joint"
        return [Problem("pitch", what)] if self.pitch == 0 else []

    def _curve_words(self) -> list[Problem]:
        """Problems of options that joints on curves need and others do not have."""
        curves = JOINT_TYPES[self.type].curves
        roller = self.type == "cam-roller"
        needed = {"curve": curves > 0, "second_curve": curves > 1, "radius": roller}
        allowed = {**needed, "start": curves > 0, "second_start": curves > 1}
        problems = [
            Problem(key, f"is missing: a {self.type} joint needs it")
            for key, wanted in needed.items()
            if wanted and getattr(self, key) is None
        ]
        return problems + [
            Problem(key, f"{self._one} has no {key}; leave it out")
            for key, has in allowed.items()
            if not has and getattr(self, key) is not None
        ]

    @property
    def _one(self) -> str:
        return f"{'an' if self.type[0] in 'aeio' else 'a'} {self.type} joint"  # a universal joint

    @property
    def kind(self) -> JointType:
        """Its row of the joint table."""
        return JOINT_TYPES[self.type]

    @property
    def curves(self) -> tuple[str, ...]:
        """Names of the curves along which it slides: that of I, then that of J."""
        return tuple(name for name in (self.curve, self.second_curve) if name is not None)

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.pair(where, self.between, "a joint")
        starts = (self.start, self.second_start)
        words = ("curve", "second_curve"), ("start", "second_start")
        for word, start_word, curve, start in zip(*words, self.curves, starts, strict=False):
            yield from scope.unknown(f"{where}.{word}", "curve", curve, "curves")
            shape = _shape(scope.model, curve)
            if shape is None:
                continue
            if not shape.in_plane and self.type != "point-on-curve":
                what = f'a {self.type} joint needs a plane curve; "{curve}" has three coordinates'
                yield Problem(f"{where}.{word}", what, ("point-on-curve",))
            if start is not None and not shape.closed and not 0.0 <= start <= shape.length:
                length = scope.model.units.say(shape.length, "m")
                what = f'lies beyond the curve "{curve}", which is {length} long'
                yield Problem(f"{where}.{start_word}", what)

    def planar_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        if self.kind.planar_equations is None:
            names = tuple(row.name for row in JOINT_TYPES.values() if row.planar_equations)
            yield Problem(f"{where}.type", f"{self._one} has no meaning in a plane", names)
        elif self.kind.curves:
            yield from self._planar_curve_problems(scope, where, plane)
        elif self.kind.has_axis:
            try:
                axis = axis_of_joint(scope.model, where.partition(".")[2], scope.flexbodies)
            except FlexmbError:
                return  # its markers are reported elsewhere
            about, along = across(axis, plane), keeps_plane(axis, plane)
            if self.type in _ABOUT and not about:
                yield Problem(f"{where}.axis", f"must be normal to the plane {plane}")
            elif self.type in _ALONG and not along:
                yield Problem(f"{where}.axis", f"must lie in the plane {plane}")
            elif not (about or along):
                yield Problem(f"{where}.axis", f"must lie in the plane {plane} or be normal to it")

    def _planar_curve_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        """Problems of curves and flat followers in a planar scene."""
        model = scope.model
        try:
            markers = lookup.joint_frames(model, where.partition(".")[2], scope.flexbodies)
        except FlexmbError:
            return  # its markers are reported elsewhere
        normal = np.array(PLANES[plane])
        axes = [lookup.global_axes(model, marker)[:, 2] for marker in markers]
        for i, (z, curve) in enumerate(zip(axes, self.curves, strict=False)):
            if np.linalg.norm(np.cross(z, normal)) > ALIGNED:
                what = f"carries a curve in its plane x, y, which must lie in the plane {plane}"
                yield Problem(f"{where}.between[{i}]", f"{what}: turn the marker, or take another")
            shape = _shape(model, curve)
            if shape is not None and not shape.in_plane:
                what = f'the curve "{curve}" with three coordinates has no meaning in a plane'
                yield Problem(f"{where}.{('curve', 'second_curve')[i]}", what)
        if self.type == "cam-flat" and abs(axes[1] @ normal) > ALIGNED:
            yield Problem(f"{where}.axis", f"across the flat, it must lie in the plane {plane}")


def _shape(model: ModelData, curve: str) -> CurveShape | None:
    """The shape of a curve; None if it is wrong, which is reported elsewhere."""
    try:
        return curve_shape(model, curve) if curve in model.curves else None
    except SceneError:
        return None


@dataclass(frozen=True)
class JointCount:
    """The joints of one type and their number of equations."""

    type: str
    joints: int
    equations: int


@dataclass(frozen=True)
class Counts:
    """Counts of a model, in space or in a plane."""

    rigid_bodies: int
    flexible_bodies: int
    joints: tuple[JointCount, ...]
    drivers: int
    """Number of equations of all drivers, one for each prescribed coordinate."""
    forces: int
    sensors: int
    planar: bool
    couplers: int
    modes: int | None
    """Number of modal coordinates of all flexible bodies; None if one is not reduced yet."""

    @property
    def rigid_coordinates(self) -> int:
        """Coordinates without modes: six per body, three in a plane."""
        return (3 if self.planar else 6) * (self.rigid_bodies + self.flexible_bodies)

    @property
    def equations(self) -> int:
        """Equations of joints, plus one per coupler; without drivers."""
        return sum(row.equations for row in self.joints) + self.couplers

    @property
    def mobility(self) -> int:
        """Rigid coordinates minus equations of joints, couplers and drivers."""
        return self.rigid_coordinates - self.equations - self.drivers


def count(model: ModelData, flexbodies: Bodies | None = None) -> Counts:
    """Count the bodies, joints, equations and so on of a model."""
    flexbodies = flexbodies or {}
    flexible = [name for name, spec in model.bodies.items() if spec.flexible]
    flexbodies_of = [lookup.flexbody_of(model, name, flexbodies) for name in flexible]
    bodies = [body for body in flexbodies_of if body is not None]
    used = [spec.type for spec in model.joints.values()]
    joints = tuple(
        JointCount(name, n, n * ((row.planar_equations or 0) if model.plane else row.equations))
        for name, row in JOINT_TYPES.items()
        if (n := used.count(name))
    )
    return Counts(
        rigid_bodies=len(model.bodies) - len(flexible),
        flexible_bodies=len(flexible),
        joints=joints,
        drivers=sum(len(spec.motions(model.plane)) for spec in model.drivers.values()),
        forces=len(model.forces),
        sensors=len(model.sensors),
        planar=model.plane is not None,
        couplers=len(model.couplers),
        modes=sum(body.m for body in bodies) if len(bodies) == len(flexible) else None,
    )


# Inertia over mass times squared arm: below _LOST_INERTIA it is lost in round-off (joints have
# 1e-16), and a body with less than _USUAL_INERTIA is nearly a point.
_LOST_INERTIA, _USUAL_INERTIA = 1e-12, 1e-9
_GUIDES = ("fixed", "prismatic")  # joints that prevent any rotation


def lost_inertias(model: ModelData) -> Iterator[str]:
    """Sentences about rigid bodies whose inertia is round-off relative to mass times squared arm.

    They are checked about each principal axis, in a plane about its normal; the arm is the distance
    of a joint from the axis. Bodies whose rotation a joint with ground prevents are left out.
    """
    ends: dict[str, list[np.ndarray]] = {}
    guided = set()
    for joint in model.joints.values():
        names = {reference.partition(".")[0] for reference in joint.between}
        guided |= names if GROUND in names and joint.type in _GUIDES else set()
        for reference in joint.between:
            body = reference.partition(".")[0]
            if body in model.bodies and not model.bodies[body].flexible:
                ends.setdefault(body, []).append(lookup.place_marker(model, reference).rho)
    for name, places in ((name, of) for name, of in ends.items() if name not in guided):
        spec, say = model.bodies[name], model.units.say
        assert isinstance(spec, RigidBodySpec)
        of = spec.mass_properties
        axes = np.linalg.eigh(of.inertia)[1]
        if model.plane is not None:
            axes = normal_in_body(spec, model.plane)[:, None]
        inertia = np.einsum("ak,ab,bk->k", axes, of.inertia, axes)
        away = np.array(places) - of.center
        squares = ((away**2).sum(axis=1)[:, None] - (away @ axes) ** 2).max(axis=0)
        k = int(np.argmin(inertia - _LOST_INERTIA * of.mass * squares))
        if inertia[k] < _LOST_INERTIA * of.mass * squares[k]:
            yield (
                f"bodies.{name}.inertia: {say(inertia[k], 'kg m^2', 3)} is round-off beside its "
                f"mass times the square of its arm of {say(np.sqrt(squares[k]), 'm', 3)} to a "
                "joint: give it that of its size, at least "
                f"{say(_USUAL_INERTIA * of.mass * squares[k], 'kg m^2', 1)}"
            )
