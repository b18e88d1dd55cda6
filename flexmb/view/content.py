"""What a picture shows, and from where, apart from how it is drawn.

:class:`Mechanism` is a mechanism at one time of a run: the scene in the result names its parts, the
flexible-body files say how the modes move their surfaces.

:class:`Content` holds rigid shapes, flexible surfaces with the values that colour them, joints,
ground, colour scale, captions and camera, in global axes [m]. Both renderers, VTK and matplotlib,
take it and show the same. A mechanism is seen along its joint axes if they are parallel, slightly
from above; up is against gravity where there is any, else z, else (for a mechanism seen nearly
along z) y. A body alone is seen from aside and above z, or lengthwise above its thinnest extent if
slender.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.errors import ViewError
from flexmb.flexbody import von_mises
from flexmb.model import Model
from flexmb.model.body import BodySpec
from flexmb.model.lookup import frames, place_marker
from flexmb.model.markers import PlacedMarker, rotation_matrix
from flexmb.model.reading import GROUND, split_reference
from flexmb.results import Pose, Result
from flexmb.units import SI, UnitSystem

Array = NDArray[np.float64]

_GROUND_POSE = Pose(np.zeros(3), np.eye(3), np.zeros(0))


class Mechanism:
    """The bodies, joints and markers of a result's scene at a time of the run.

    Parameters
    ----------
    result : Result
        The run.
    time : float, optional
        Within the run, in the scene's units; by default what its ``[view]`` says, else the end;
        the end, too, of a run that stopped before that.

    Raises
    ------
    ViewError
        The result holds no rows.
    BodyFileError
        A flexible-body file is missing or damaged.
    ResultFileError
        The time lies outside the run, or a flexible-body file is not the one of this run.
    """

    def __init__(self, result: Result, time: float | None = None) -> None:
        if not len(result.time):
            raise ViewError(f"{result.path}: the result holds no rows to draw")
        self.result = result
        self.flexbodies = {name: result.flexbody(name) for name in result.flexbodies}
        self.model = Model.from_scene_dict(_reduced(result), result.path.parent)
        if time is None and self.model.view.time is not None:
            time = min(result.units.outward(self.model.view.time, "s"), float(result.time[-1]))
        self.time = float(result.time[-1] if time is None else time)
        self._poses: dict[str, Pose] = {}
        self._markers: dict[str, PlacedMarker] = {}

    def at(self, time: float) -> Mechanism:
        """The same mechanism at another time [scene's unit]: they share what does not move."""
        other = copy(self)
        other.time, other._poses = time, {}
        return other

    def marker(self, reference: str) -> PlacedMarker:
        """The marker ``"body.marker"`` on its undeformed body."""
        if reference not in self._markers:
            self._markers[reference] = place_marker(self.model, reference, self.flexbodies)
        return self._markers[reference]

    def pose(self, body: str) -> Pose:
        """Origin, direction cosines and modal coordinates of a body or the ground."""
        if body == GROUND:
            return _GROUND_POSE
        if body not in self._poses:
            self._poses[body] = self.result.pose(body, self.time)
        return self._poses[body]

    def point(self, reference: str) -> Array:
        """Position (3,) of the marker ``"body.marker"``, its body deformed."""
        marker = self.marker(reference)
        pose = self.pose(marker.body)
        s = marker.position
        if marker.Phi_t is not None and marker.Phi_r is not None:
            turn = marker.Phi_r @ pose.eta
            s = s + marker.Phi_t @ pose.eta + np.cross(turn, marker.arm)
        return pose.r + pose.A @ s

    def travel(self, reference: str, axis: Array) -> tuple[float, float]:
        """Least and greatest position of a marker along an axis through the run, rigidly [m]."""
        body, _ = split_reference(reference)
        if body == GROUND:
            here = float(self.point(reference) @ axis)
            return here, here
        marker = self.marker(reference)
        times = np.linspace(self.result.time[0], self.result.time[-1], 60)
        poses = [self.result.pose(body, float(t)) for t in times]
        along = [float((p.r + p.A @ marker.position) @ axis) for p in poses]
        return min(along), max(along)

    def used_markers(self, body: str) -> list[str]:
        """References to the markers of a body that joints, forces and drivers use."""
        model = self.model
        return [
            reference
            for parts in (model.joints, model.forces, model.drivers)
            for spec in parts.values()
            for reference in getattr(spec, "between", None) or ()
            if split_reference(reference)[0] == body
        ]

    @cached_property
    def axes(self) -> dict[str, Array]:
        """Global direction (3,) of each joint's axis, in the pose of the scene."""
        axes = {}
        for name, spec in self.model.joints.items():
            marker, _ = frames(self.model, spec.between, spec.axis, self.flexbodies)
            A = np.eye(3)
            if marker.body != GROUND:
                A = rotation_matrix(self.model.bodies[marker.body].orientation)
            axes[name] = A @ marker.R[:, 2]
        return axes

    def surface(self, name: str, exaggeration: float) -> tuple[Array, Array, Array] | None:
        """Exaggerated and undeformed points (n, 3), true displacements (n,) of a flexible body.

        The undeformed body lies as its joints hold it: exaggerated, it stays on them. None where
        the body has no surface.
        """
        surface = self.flexbodies[name].surface
        if surface is None or not len(surface.points):
            return None
        pose = self.pose(name)
        A, r = self._joined_pose(name, size_of(surface.points))
        deformed = pose.r + (surface.points + surface.modes @ pose.eta) @ pose.A.T
        undeformed = r + surface.points @ A.T
        u = deformed - undeformed
        return undeformed + exaggeration * u, undeformed, np.linalg.norm(u, axis=1)

    def _joined_pose(self, name: str, size: float) -> tuple[Array, Array]:
        """Rotation (3, 3) and origin (3,) by which the undeformed body fits its joined markers.

        Of one marker with its rotation; of more by least squares, turned no more than they ask
        (Kabsch, Acta Crystallographica A32, 1976).
        """
        pose = self.pose(name)
        markers = [
            self.marker(reference)
            for spec in self.model.joints.values()
            for reference in spec.between
            if split_reference(reference)[0] == name
        ]
        if not markers or not pose.eta.any():
            return pose.A, pose.r
        points = np.array([m.position for m in markers])
        turns = np.array([np.zeros(3) if m.Phi_r is None else m.Phi_r @ pose.eta for m in markers])
        moved = points + [
            np.zeros(3) if m.Phi_t is None else m.Phi_t @ pose.eta + np.cross(turn, m.arm)
            for m, turn in zip(markers, turns, strict=True)
        ]
        c, d = points.mean(axis=0), moved.mean(axis=0)
        spread = (moved - d).T @ (points - c)
        if np.trace(spread) <= (_ROUND_OFF * size) ** 2:
            quaternion = np.array([1.0, *(0.5 * turns.mean(axis=0))])
            R = rotation_matrix(quaternion / np.linalg.norm(quaternion))
        else:
            U, _, V = np.linalg.svd(spread + 1e-6 * np.trace(spread) * np.eye(3))
            R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
        return pose.A @ R, pose.r + pose.A @ (d - R @ c)

    def von_mises(self, name: str, layer: str | None) -> Array | None:
        """(n,) the largest von Mises stress [Pa] over layers and sections at each surface point.

        NaN where the body has none there; None where it has none at all, or none in the layer.
        """
        body = self.flexbodies[name]
        if body.stress is None or body.surface is None:
            return None
        rows = body.stress.rows(layer=layer)
        if not len(rows):
            return None
        ids, nodes = body.stress.ids[rows], body.surface.node_ids
        largest = np.full(max(ids.max(), nodes.max()) + 1, np.nan)
        np.fmax.at(largest, ids, von_mises(body.stress.at(self.pose(name).eta, rows)))
        return largest[nodes] if np.isfinite(largest[nodes]).any() else None


def _reduced(result: Result) -> dict[str, Any]:
    """The scene with its flexible bodies as files next to the result: no mesh is needed."""
    bodies = dict(result.model.get("bodies", {}))
    for name, path in result.flexbodies.items():
        fields = {key: value for key, value in bodies[name].items() if key in BodySpec.model_fields}
        bodies[name] = {**fields, "flexbody": str(path.resolve())}
    return {**result.model, "bodies": bodies}


def size_of(points: Any) -> float:
    """Diagonal of the box around points (n, 3) [m]."""
    return float(np.linalg.norm(np.ptp(np.asarray(points), axis=0))) if len(points) else 0.0


_ROUND_OFF = 1e-6  # of a body's size: markers that close together are one point
_ABOVE, _ASIDE = 0.32, 0.22  # slopes by which the eye leaves the joint axis
_STEEP = 0.8  # cosine to the eye's direction above which an axis is not taken as upright
_PARALLEL = 0.999  # cosine above which two directions count as one
_SLENDER = 2.0  # times its next extent from which a body lies lengthwise
_SPATIAL = np.array([0.45, 0.42, 0.79])  # aside, above, towards, where no plane is preferred


@dataclass(frozen=True, eq=False)
class Triangles:
    """Points (n, 3) [m] and triangles (t, 3) as rows of indices into them."""

    points: Array
    faces: NDArray[np.int64]

    def moved(self, r: ArrayLike, A: ArrayLike) -> Triangles:
        """Turned by A (3, 3), then shifted by r (3,)."""
        return Triangles(self.points @ np.asarray(A).T + np.asarray(r), self.faces)


@dataclass(frozen=True, eq=False)
class Solid:
    """A rigid shape in one colour."""

    name: str
    triangles: Triangles
    color: str
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Deformed:
    """A flexible body: its drawn (exaggerated) and undeformed points, true displacements."""

    name: str
    points: Array  # (n, 3) with the deformation exaggerated
    undeformed: Array  # (n, 3) moved rigidly with the body frame
    faces: NDArray[np.int64]  # (t, 3)
    lines: NDArray[np.int64]  # (l, 2)
    displacement: Array  # (n,) magnitude relative to the body frame [m], not exaggerated
    color: str  # where no values are shown
    values: Array | None = None  # (n,) what the scale colours, SI; NaN where there is none


@dataclass(frozen=True, eq=False)
class Trace:
    """The path (n, 3) of a point through a motion."""

    name: str
    points: Array
    color: str


_SUITABLE = {  # units by the SI unit: below the limit, times the factor
    "m": ((1e-6, 1e9, "nm"), (1e-3, 1e6, "µm"), (1.0, 1e3, "mm"), (np.inf, 1.0, "m")),
    "Pa": ((1e3, 1.0, "Pa"), (1e6, 1e-3, "kPa"), (1e10, 1e-6, "MPa"), (np.inf, 1e-9, "GPa")),
}


@dataclass(frozen=True)
class Scale:
    """The colour scale of a quantity from 0: its SI value times `factor` is shown in `unit`."""

    largest: float  # SI
    factor: float
    unit: str
    quantity: str = "displacement"

    @classmethod
    def fitting(
        cls, largest: float, units: UnitSystem = SI, unit: str = "m", quantity: str = "displacement"
    ) -> Scale:
        """The scale for a largest value; in SI its unit is the one that suits it."""
        if units is not SI:
            return cls(largest, 1.0 / units.scale(unit), units.label(unit), quantity)
        factor, shown = next(row[1:] for row in _SUITABLE[unit] if largest < row[0])
        return cls(largest, factor, shown, quantity)

    @property
    def label(self) -> str:
        """The quantity with its unit, for the colour bar."""
        return f"{self.quantity} [{self.unit}]" if self.unit else self.quantity

    @property
    def top(self) -> float:
        """The largest value shown, in `unit`."""
        return self.largest * self.factor


@dataclass(frozen=True)
class Camera:
    """From where the scene is seen, in global axes."""

    direction: tuple[float, float, float]  # from the scene towards the eye, unit length
    up: tuple[float, float, float]

    @property
    def axes(self) -> Array:
        """Rows (3, 3): right, above and towards the eye in the picture."""
        towards = np.array(self.direction)
        right = np.cross(self.up, towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(towards, right), towards])


@dataclass(frozen=True, eq=False)
class Content:
    """Everything in one picture."""

    title: str
    caption: str
    solids: tuple[Solid, ...]
    deformed: tuple[Deformed, ...]
    joints: Array  # (j, 3)
    joint_radius: float
    scale: Scale | None  # None: no colour by values
    camera: Camera
    bar: bool = True  # whether the scale has its colour bar, if there is one
    traces: tuple[Trace, ...] = ()
    size: float = 0.0  # by which glyphs and links are drawn [m]
    box: Array | None = None  # (2, 3) what the view is fitted to, in the camera's axes

    def __post_init__(self) -> None:
        shown = any(body.values is not None for body in self.deformed)
        object.__setattr__(self, "bar", self.bar and self.scale is not None and shown)

    def all_points(self) -> Array:
        """Every drawn point (n, 3), to fit the view."""
        parts = [solid.triangles.points for solid in self.solids]
        parts += [body.points for body in self.deformed]
        if len(self.joints):
            parts.append(self.joints)
        parts += [trace.points for trace in self.traces]
        return np.vstack(parts) if parts else np.zeros((1, 3))

    def extent(self) -> tuple[Array, Array]:
        """Least and greatest coordinates (3,) of what the view is fitted to, in camera axes."""
        if self.box is not None:
            return self.box[0], self.box[1]
        spans = self.all_points() @ self.camera.axes.T
        return spans.min(axis=0), spans.max(axis=0)


def mechanism_camera(mechanism: Mechanism, direction: tuple[float, float, float] | None) -> Camera:
    """The camera for a direction from the scene towards the eye, or by the joint axes.

    Raises
    ------
    ViewError
        The direction has no length.
    """
    direction = direction if direction is not None else mechanism.model.view.direction
    if direction is not None:
        towards = _unit_direction(direction)
        return _camera(towards, _up(mechanism, towards))
    normal = _common_axis(mechanism)
    up = _up(mechanism, normal)
    if normal is None:
        back = np.array([0.0, -1.0, 0.0] if abs(up[1]) < _PARALLEL else [0.0, 0.0, 1.0])
        back -= (back @ up) * up
        aside = np.cross(up, back / np.linalg.norm(back))
        frame = np.stack([aside, up, np.cross(aside, up)], axis=1)
        return _camera(frame @ _SPATIAL, up)
    right = np.cross(up, normal) / np.linalg.norm(np.cross(up, normal))
    if right[int(np.argmax(np.abs(right)))] < 0:  # axes usually grow to the right
        normal, right = -normal, -right
    return _camera(normal + _ABOVE * up + _ASIDE * right, up)


def body_camera(points: Array, direction: tuple[float, float, float] | None) -> Camera:
    """The camera for a body alone, points (n, 3), in its own axes.

    Raises
    ------
    ViewError
        The direction has no length.
    """
    if direction is not None:
        towards = _unit_direction(direction)
        ups = (np.eye(3)[axis] for axis in (2, 1))
        return _camera(towards, next(up for up in ups if abs(up @ towards) < _PARALLEL))
    extent = np.ptp(points, axis=0)
    right = int(np.argmax(extent))
    if extent[right] < _SLENDER * np.sort(extent)[1]:
        return _camera(np.array([1.0, -1.0, 1.0]) * _SPATIAL[[0, 2, 1]], np.eye(3)[2])
    others = [axis for axis in (2, 1, 0) if axis != right]  # of equal ones z is up
    up = min(others, key=lambda axis: extent[axis])
    aside, above = np.eye(3)[right], np.eye(3)[up]
    frame = np.stack([aside, above, np.cross(aside, above)], axis=1)
    return _camera(frame @ _SPATIAL, above)


def _unit_direction(direction: tuple[float, float, float]) -> Array:
    towards = np.array(direction, dtype=float)
    length = float(np.linalg.norm(towards))
    if not (np.isfinite(length) and length > 0):
        raise ViewError(f"the direction {tuple(direction)} has no length")
    return np.asarray(towards / length)


def _common_axis(mechanism: Mechanism) -> Array | None:
    """The direction that all turning joints share; None if they share none."""
    turning = [
        mechanism.axes[name]
        for name, spec in mechanism.model.joints.items()
        if spec.type in ("revolute", "cylindrical")
    ]
    if not turning or any(abs(axis @ turning[0]) < _PARALLEL for axis in turning):
        return None
    return turning[0]


def _up(mechanism: Mechanism, towards: Array | None) -> Array:
    candidates = [np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])]
    gravity = mechanism.model.gravity
    if gravity is not None and np.linalg.norm(gravity) > 0:
        candidates.insert(0, -np.array(gravity) / np.linalg.norm(gravity))
    if towards is None:
        return candidates[0]
    steep = [_PARALLEL] * (len(candidates) - 3) + [_STEEP] * 3
    fitting = (abs(up @ towards) < limit for up, limit in zip(candidates, steep, strict=True))
    return next(up for up, fits in zip(candidates, fitting, strict=True) if fits)


def _camera(towards: Array, up: Array) -> Camera:
    t = towards / np.linalg.norm(towards)
    return Camera(
        (float(t[0]), float(t[1]), float(t[2])), (float(up[0]), float(up[1]), float(up[2]))
    )
