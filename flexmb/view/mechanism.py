"""A mechanism at one time of a run, and the poses in which its parts are drawn.

:class:`Mechanism` is undistorted: the scene in the result names the parts, the rows give their
poses, the flexible-body files give the motion of markers and surfaces by modes.

:class:`Display` is what is drawn: deformations multiplied by a factor. The deformation of a body is
relative to one of its markers, by default the first that a joint connects to ground directly or
through other bodies; there it is zero. If joints hold the body at more points, as a connecting rod
or a beam on a pin and a roller, the reference rotates with the line through them. A body connected
to an exaggerated one moves with it, a body in a loop is moved to fit its joints best, so all parts
stay at their joints. With the factor 1 nothing is moved.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from flexmb.errors import ViewError
from flexmb.flexbody.arrays import Array
from flexmb.model import Model
from flexmb.model.lookup import joint_frames, marker_names, place_marker
from flexmb.model.markers import PlacedMarker
from flexmb.model.reading import GROUND, split_reference
from flexmb.model.scenes.conversion import reduced_scene
from flexmb.results import Pose, Result

_GROUND_POSE = Pose(np.zeros(3), np.eye(3), np.zeros(0))
MEAN_AXES = "mean-axes"
_HOLDING = (
    "fixed", "revolute", "spherical", "universal", "constant-velocity", "cylindrical", "screw",
    "prismatic", "planar", "in-line",
)  # fmt: skip
# joints that guide a point of a body that other joints hold
_GUIDING = ("in-plane", "pin-in-slot", "point-on-curve")
_ROUND_OFF = 1e-6  # fraction of the distance of two markers below which their line has not rotated


def transform(A: Array, r: Array) -> Array:
    """The matrix (4, 4) that rotates by A (3, 3), then translates by r (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = A, r
    return T


def inverse(T: Array) -> Array:
    """The inverse of a rigid transform (4, 4)."""
    return transform(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def applied(T: Array, points: Array) -> Array:
    """Points (n, 3) moved by a transform (4, 4)."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def rotation(vector: Array) -> Array:
    """The rotation matrix (3, 3) of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-300:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K))


class Mechanism:
    """The bodies, joints and markers of a result's scene at a time of the run.

    Parameters
    ----------
    result : Result
        The run.
    time : float, optional
        Time within the run, in the scene's units; by default that of its ``[view]``, else the end.
        The end also if the run stopped before that time.

    Raises
    ------
    ViewError
        The result has no rows.
    BodyFileError
        A flexible-body file is missing or damaged.
    ResultFileError
        The time is outside the run, or a flexible-body file is not the one of this run.
    """

    def __init__(self, result: Result, time: float | None = None) -> None:
        if not len(result.time):
            raise ViewError(f"{result.path}: the result holds no rows to draw")
        self.result = result
        self.flexbodies = {name: result.flexbody(name) for name in result.flexbodies}
        scene = reduced_scene(result.model, result.flexbodies)
        self.model = Model.from_scene_dict(scene, result.path.parent)
        if time is None and self.model.view.time is not None:
            time = min(result.units.outward(self.model.view.time, "s"), float(result.time[-1]))
        self.time = float(result.time[-1] if time is None else time)
        self._markers: dict[str, PlacedMarker] = {}
        self._poses: dict[str, Pose] = {}

    def at(self, time: float) -> Mechanism:
        """The same mechanism at another time, in the scene's units."""
        other = copy.copy(self)
        other.time, other._poses = float(time), {}
        return other

    def pose(self, body: str) -> Pose:
        """Origin, direction cosines and modal coordinates of a body or the ground."""
        if body == GROUND:
            return _GROUND_POSE
        if body not in self._poses:
            self._poses[body] = self.result.pose(body, self.time)
        return self._poses[body]

    def frame(self, body: str) -> Array:
        """The transform (4, 4) from body axes to global ones."""
        pose = self.pose(body)
        return transform(pose.A, pose.r)

    def marker(self, reference: str) -> PlacedMarker:
        """The marker ``"body.marker"`` on its undeformed body."""
        if reference not in self._markers:
            self._markers[reference] = place_marker(self.model, reference, self.flexbodies)
        return self._markers[reference]

    def motion(self, reference: str) -> tuple[Array, Array]:
        """Displacement (3,) [m] and small rotation (3,) of a marker by deformation, body axes."""
        marker = self.marker(reference)
        if marker.Phi_t is None or marker.Phi_r is None:
            return np.zeros(3), np.zeros(3)
        eta = self.pose(marker.body).eta
        turn = marker.Phi_r @ eta
        return marker.Phi_t @ eta + np.cross(turn, marker.arm), turn

    def marker_frame(self, reference: str) -> Array:
        """The transform (4, 4) of a marker to global axes, on its deformed body."""
        marker, (u, turn) = self.marker(reference), self.motion(reference)
        return self.frame(marker.body) @ transform(rotation(turn) @ marker.R, marker.position + u)

    def point(self, reference: str) -> Array:
        """Position (3,) of the marker ``"body.marker"`` on its deformed body."""
        return np.asarray(self.marker_frame(reference)[:3, 3])

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
    def joint_axes(self) -> dict[str, tuple[Array, Array]]:
        """The axes (3, 3) of each joint at marker I and at J, in those of the markers."""
        axes = {}
        for name, spec in self.model.joints.items():
            both = joint_frames(self.model, name, self.flexbodies)
            own = (self.marker(reference).R for reference in spec.between)
            first, second = (R.T @ frame.R for R, frame in zip(own, both, strict=True))
            axes[name] = first, second
        return axes

    def joint_axis(self, name: str) -> Array:
        """Global direction (3,) of a joint's axis."""
        reference = self.model.joints[name].between[0]
        return np.asarray(self.marker_frame(reference)[:3, :3] @ self.joint_axes[name][0][:, 2])

    @cached_property
    def chain(self) -> tuple[Link, ...]:
        """All bodies, each after those that hold it, starting at ground."""
        pairs = [
            (spec.between, spec.type)
            for spec in self.model.joints.values()
            if spec.type in _HOLDING
        ]
        guided = [(s.between, s.type) for s in self.model.joints.values() if s.type in _GUIDING]
        forces: Iterable[Any] = self.model.forces.values()
        loose = [(spec.between, spec.type) for spec in forces if spec.type in ("bushing", "beam")]
        links, done = [], {GROUND}
        left = list(self.model.bodies)
        while left:
            level = [link for name in left if (link := _link(name, pairs, done, guided)).holds]
            if not level:
                level = [link for name in left if (link := _link(name, loose, done)).holds][:1]
            if not level:  # bodies that nothing holds: the first is where it is
                own = [pair for pair, _ in pairs for end in pair if _body(end) == left[0]]
                first = next((end for pair in own for end in pair if _body(end) == left[0]), None)
                level = [Link(left[0], (), first)]
            links += level
            done |= {link.body for link in level}
            left = [name for name in left if name not in done]
        return tuple(links)

    def surface(self, name: str, exaggeration: float) -> tuple[Array, Array, Array] | None:
        """Exaggerated and undeformed points (n, 3), and true displacements (n,) of a flexible body.

        None if the body has no surface.
        """
        return Display(self, exaggeration).surface(name)


def _body(reference: str) -> str:
    return split_reference(reference)[0]


@dataclass(frozen=True)
class Link:
    """A body with its holding joints: its own marker, the other body's marker, the type."""

    body: str
    holds: tuple[tuple[str, str, str], ...]
    # for a body without joints that hold it: its first marker in a joint
    free_reference: str | None = None

    @property
    def reference(self) -> str | None:
        """The marker to which its deformation is relative."""
        return self.holds[0][0] if self.holds else self.free_reference


def _link(name: str, pairs: list[Any], done: set[str], guided: Sequence[Any] = ()) -> Link:
    """The joints that hold a body, a clamp first, and those that guide a point of it, as a
    roller."""
    holds = _holds(name, pairs, done)
    holds.sort(key=lambda hold: hold[2] != "fixed")
    return Link(name, (*holds, *(_holds(name, guided, done) if holds else ())))


def _holds(name: str, pairs: Sequence[Any], done: set[str]) -> list[tuple[str, str, str]]:
    return [
        (own, other, kind)
        for between, kind in pairs
        for own, other in (between, between[::-1])
        if _body(own) == name and _body(other) in done
    ]


class Display:
    """The drawn poses: the mechanism with its deformation multiplied by a factor.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism at its time.
    factor : float
        Factor on deformations.
    references : sequence of str
        Markers to which the deformation of their bodies is relative, such as ``"rod.big_end"``;
        ``"mean-axes"``: the mean axes of all bodies without such a marker.

    Raises
    ------
    ViewError
        A reference to a body or marker that does not exist.
    """

    def __init__(
        self, mechanism: Mechanism, factor: float = 1.0, references: Sequence[str] = ()
    ) -> None:
        self.mechanism, self.factor = mechanism, factor
        self._named = named_references(mechanism, references)
        self._mean = MEAN_AXES in references
        self._references: dict[str, tuple[Array, Array]] = {}
        self._frames = {GROUND: np.eye(4)}
        for link in mechanism.chain:
            self._references[link.body] = self._reference(link)
            self._frames[link.body] = self._carried(link) @ mechanism.frame(link.body)

    @property
    def time(self) -> float:
        """Of the mechanism, in the scene's units."""
        return self.mechanism.time

    def frame(self, body: str) -> Array:
        """The transform (4, 4) from undeformed body axes to the drawn pose."""
        if body == GROUND:
            return np.eye(4)
        return self._frames[body] @ self._undeformed(body)

    def marker(self, reference: str) -> Array:
        """The transform (4, 4) of a marker to its drawn pose."""
        body = _body(reference)
        if body == GROUND or not len(self.mechanism.pose(body).eta):
            marker = self.mechanism.marker(reference)
            return self._frames[body] @ transform(marker.R, marker.position)
        return self._frames[body] @ self._local(reference)

    def point(self, reference: str) -> Array:
        """The drawn position (3,) of a marker."""
        return np.asarray(self.marker(reference)[:3, 3])

    def surface(self, name: str) -> tuple[Array, Array, Array] | None:
        """Drawn and undeformed points (n, 3), true displacements (n,) of a flexible body."""
        surface = self.mechanism.flexbodies[name].surface
        if surface is None or not len(surface.points):
            return None
        u = self.displacements(name, surface.points, surface.modes)
        undeformed = applied(self._undeformed(name), surface.points)
        drawn = applied(self._frames[name], undeformed + self.factor * u)
        return drawn, applied(self._frames[name], undeformed), np.linalg.norm(u, axis=1)

    def displacements(self, name: str, points: Array, modes: Array) -> Array:
        """True displacements (n, 3) of points relative to the body's reference, body axes."""
        eta = self.mechanism.pose(name).eta
        return np.asarray(points + modes @ eta - applied(self._undeformed(name), points))

    def reference_of(self, body: str) -> str:
        """The marker to which the deformation of a body is relative, or ``"mean-axes"``."""
        if body in self._named:
            return self._named[body]
        link = next(link for link in self.mechanism.chain if link.body == body)
        return MEAN_AXES if self._mean or link.reference is None else link.reference

    def _undeformed(self, body: str) -> Array:
        """The transform (4, 4) of the undeformed body to its reference, in body axes."""
        return transform(*self._references[body])

    def _reference(self, link: Link) -> tuple[Array, Array]:
        """Rotation (3, 3) and translation (3,) of the undeformed body to its reference, body
        axes."""
        mechanism, marker = self.mechanism, self.reference_of(link.body)
        if marker == MEAN_AXES or not mechanism.pose(link.body).eta.any():
            return np.eye(3), np.zeros(3)
        u, turn = mechanism.motion(marker)
        x, R = mechanism.marker(marker).position, rotation(turn)
        if marker == link.reference and link.holds and link.holds[0][2] != "fixed":
            others = [own for own, *_ in link.holds]
            before = np.array([mechanism.marker(own).position for own in others]) - x
            after = before + [mechanism.motion(own)[0] for own in others] - u
            R = _turned(before @ R.T, after) @ R
        return R, x + u - R @ x

    def _local(self, reference: str) -> Array:
        """A marker's transform (4, 4) in body axes, with its deformation times the factor."""
        mechanism = self.mechanism
        marker, (u, turn) = mechanism.marker(reference), mechanism.motion(reference)
        R, d = self._references[marker.body]
        rest = R @ marker.position + d
        relative = _rotation_vector(R.T @ rotation(turn))
        place = rest + self.factor * (marker.position + u - rest)
        return transform(R @ rotation(self.factor * relative) @ marker.R, place)

    def _carried(self, link: Link) -> Array:
        """The transform (4, 4) by which the body is moved from its true pose to stay at its
        joints."""
        if self.factor == 1.0 or not link.holds:
            return np.eye(4)
        mechanism, sources, targets, moves = self.mechanism, [], [], []
        frame = mechanism.frame(link.body)
        for own, other, _ in link.holds:
            offset = inverse(mechanism.marker_frame(other)) @ mechanism.marker_frame(own)
            target, source = self.marker(other) @ offset, frame @ self._local(own)
            sources.append(source[:3, 3])
            targets.append(target[:3, 3])
            moves.append(target @ inverse(source))
        first = moves[0]
        if len(moves) == 1 or link.holds[0][2] == "fixed":
            return np.asarray(first)
        x, y = np.array(sources), np.array(targets)
        R = first[:3, :3]
        R = _turned((x - x.mean(axis=0)) @ R.T, y - y.mean(axis=0)) @ R
        return transform(R, y.mean(axis=0) - R @ x.mean(axis=0))


def named_references(mechanism: Mechanism, references: Sequence[str]) -> dict[str, str]:
    """Markers to which deformations are relative, by body."""
    model, named = mechanism.model, {}
    for reference in references:
        if reference == MEAN_AXES:
            continue
        body, _, marker = reference.partition(".")
        if body not in model.bodies:
            names = [*model.bodies, MEAN_AXES]
            raise ViewError.unknown(f'there is no body "{body}" to be relative to', body, names)
        markers = marker_names(model, body, mechanism.flexbodies)
        if marker not in markers:
            raise ViewError.unknown(f'body "{body}" has no marker "{marker}"', marker, markers)
        named[body] = reference
    return named


def _turned(before: Array, after: Array) -> Array:
    """The smallest rotation (3, 3) that takes vectors (k, 3) onto others.

    In the least-squares sense (Kabsch, Acta Crystallographica A32, 1976).
    """
    size = float(np.trace(before @ before.T))
    if np.trace(after.T @ before) <= _ROUND_OFF**2 * max(size, 1e-300):
        return np.eye(3)
    R = np.eye(3)
    for _ in range(2):  # what holds a turn about the line of two vectors leaves 1e-6 of the rest
        spread = after.T @ before @ R.T
        U, _, V = np.linalg.svd(spread + 1e-6 * np.trace(spread) * np.eye(3))
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V @ R
    return np.asarray(R)


def _rotation_vector(R: Array) -> Array:
    """The rotation vector [rad] of a matrix (3, 3), for angles below 180 degrees."""
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(R) - 1)))
    return np.asarray(axis * (angle / sine if sine > 1e-300 else 1.0))
