"""The direction from which a mechanism or a body is seen.

A mechanism is seen along its joint axes if they are parallel, slightly from above. If the axes are
vertical, this holds only for flat mechanisms; and if a panel that is wide along the axes would be
seen edge-on, the mechanism is seen from aside. Up is opposite to gravity, else z, else (for a
mechanism seen nearly along z) y. Among the remaining sides the one is taken from which the bodies
hide each other least, over the whole motion. A body alone is seen from aside and above z; a slender
one lengthwise, from above its thinnest extent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from flexmb.errors import ViewError
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.model.scenes.sections import CAMERAS
from flexmb.results.run_summary import MODE_SHAPE
from flexmb.view.mechanism import Mechanism
from flexmb.view.shapes import spread_points, triangle_areas

_ABOVE, _ASIDE = 0.32, 0.22  # slopes of the eye's direction against the joint axis
_STEEP = 0.8  # cosine to the eye's direction above which an axis cannot be vertical in the picture
_PARALLEL = 0.999  # cosine above which two directions are parallel
_FLAT = 0.4  # extent over that across the joint axes, below which a mechanism is seen from above
_THIN = 0.1  # thickness over width below which a body is a panel
_ALONG = 0.7  # cosine between a vibration and the joint axes above which it is not seen along them
_EDGE_ON = 0.5  # cosine between a panel's normal and the joint axes below which it is seen edge-on
_SLENDER = 2.0  # extent over the next one above which a body lies lengthwise
_SPATIAL = np.array([0.45, 0.42, 0.79])  # right, above, towards: direction if no plane is preferred
_CELLS = 60  # cells along the longer side of a coarse picture, which shows what hides what
_HIDDEN = 0.1  # visible share of its points below which a body cannot be seen
_FILL = 6.0  # points of a surface per cell of that picture, so that it has no gaps
_CLOUD = (250, 40_000)  # smallest and largest number of points of a part
# gain of visibility that each other side must have over the first; back is last
_GAINS = (0.0, 0.06, 0.8, 0.86)

# Right, above and towards the eye, for a scene whose up is above and whose front faces the eye.
STANDARD: Final = {
    "front": (0.0, 0.0, 1.0),
    "back": (0.0, 0.0, -1.0),
    "right": (1.0, 0.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "top": (0.0, 1.0, 0.0),
    "bottom": (0.0, -1.0, 0.0),
    "isometric": (0.6, 0.55, 0.7),
}


@dataclass(frozen=True)
class Camera:
    """The direction and orientation in which the scene is seen, in global axes."""

    direction: tuple[float, float, float]  # from the scene towards the eye, unit length
    up: tuple[float, float, float]

    @property
    def axes(self) -> Array:
        """Rows (3, 3): the directions right, above and towards the eye of the picture."""
        towards = np.array(self.direction)
        right = np.cross(self.up, towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(towards, right), towards])


def mechanism_camera(
    mechanism: Mechanism,
    name: str = "auto",
    direction: Sequence[float] | None = None,
    parts: Sequence[Sequence[Array]] = (),
) -> Camera:
    """The camera of a given name or direction, or by default according to the joint axes.

    Parameters
    ----------
    mechanism : Mechanism
        What is seen.
    name : str
        One of ``CAMERAS``.
    direction : three floats, optional
        Direction from the scene towards the eye, instead of a name.
    parts : sequence of sequence of (n, 3) float
        Points on each body at some times: the automatic camera takes the side from which they hide
        each other least.

    Raises
    ------
    ViewError
        The direction has no length, or there is no camera of that name.
    """
    if direction is not None:
        towards = _unit_direction(direction)
        return _camera(towards, _up(mechanism, towards))
    if name not in CAMERAS:
        raise ViewError.unknown_name("camera", name, CAMERAS)
    normal = _normal(mechanism, parts if name == "auto" else ())
    up = _up(mechanism, normal)
    if name != "auto":
        front = _front(up) if normal is None else _facing(normal, up)
        frame = np.stack([np.cross(up, front), up, front], axis=1)
        towards = frame @ np.array(STANDARD[name])
        above = float(towards @ up)  # from above and below, x still points to the right
        return _camera(towards, -np.sign(above) * front if abs(above) > _PARALLEL else up)
    if normal is None:
        front = _front(up)
        frame = np.stack([np.cross(up, front), up, front], axis=1)
        sides = [(a, b) for b in (1, -1) for a in (1, -1)]
        views = [_camera(frame @ (_SPATIAL * (a, 1, b)), up) for a, b in sides]
    else:
        front = _facing(normal, up)
        right = np.cross(up, front)
        around = [(front, right), (front, -right), (-front, -right), (-front, right)]
        views = [_camera(n + _ABOVE * up + _ASIDE * r, up) for n, r in around]
    return _clearest(views, parts)


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
    others = [axis for axis in (2, 1, 0) if axis != right]  # among equal extents z is up
    up = min(others, key=lambda axis: extent[axis])
    aside, above = np.eye(3)[right], np.eye(3)[up]
    frame = np.stack([aside, above, np.cross(aside, above)], axis=1)
    return _camera(frame @ _SPATIAL, above)


def visible_shares(camera: Camera, parts: Sequence[Array]) -> Array:
    """Visible share of each part's points (n, 3): those with no other part in front."""
    return np.array([1.0 - covers.any(axis=0).mean() for covers in _covers(camera, parts)])


def hiding_bodies(
    camera: Camera, moments: Sequence[Sequence[tuple[str, Array, IntArray]]]
) -> frozenset[str]:
    """The bodies that hide another body so that it cannot be seen, on average over some moments.

    Parameters
    ----------
    moments : sequence of sequence of (str, (n, 3) float, (t, 3) int)
        For each body its name, points and triangles, in one or several parts.
    """
    random, names = np.random.default_rng(7), sorted({name for name, _, _ in moments[0]})
    if len(names) < 2:
        return frozenset()
    visible, covered = np.zeros(len(names)), np.zeros((len(names), len(names)))
    for parts in moments:
        size = np.ptp(np.vstack([points for _, points, _ in parts]) @ camera.axes[:2].T, axis=0)
        density = _FILL * (_CELLS / max(float(size.max()), 1e-300)) ** 2
        clouds: dict[str, list[Array]] = {name: [] for name in names}
        for name, points, faces in parts:
            count = int(np.clip(density * triangle_areas(points, faces).sum(), *_CLOUD))
            clouds[name].append(spread_points(points, faces, count, random))
        for k, covers in enumerate(_covers(camera, [np.vstack(clouds[name]) for name in names])):
            visible[k] += 1.0 - covers.any(axis=0).mean()
            covered[k] += covers.mean(axis=1)
    least = _HIDDEN * len(moments)
    hides = np.any(covered[visible < least] > least, axis=0)
    return frozenset(names[k] for k in np.flatnonzero(hides))


def _covers(camera: Camera, parts: Sequence[Array]) -> Iterator[Array]:
    """For each part (n, 3), which parts are in front of its points: (parts, n)."""
    flat = [np.asarray(points) @ camera.axes.T for points in parts]
    everything = np.vstack(flat)
    low, size = everything.min(axis=0), np.ptp(everything, axis=0)
    cell = max(size[0], size[1], 1e-300) / _CELLS
    columns = int(size[0] / cell) + 1
    cells = [
        ((points[:, 1] - low[1]) / cell).astype(int) * columns
        + ((points[:, 0] - low[0]) / cell).astype(int)
        for points in flat
    ]
    front = np.full((len(parts), columns * (int(size[1] / cell) + 1)), -np.inf)
    for k, (points, where) in enumerate(zip(flat, cells, strict=True)):
        np.maximum.at(front[k], where, points[:, 2])
    for k, (points, where) in enumerate(zip(flat, cells, strict=True)):
        covers = front[:, where] > points[:, 2] + cell
        covers[k] = False
        yield covers


def _clearest(views: list[Camera], parts: Sequence[Sequence[Array]]) -> Camera:
    """The view with the best visible worst hidden part and worst panel; of equal ones the first."""
    best, score = views[0], -np.inf
    panels = [normal for moment in parts for _, normal in _panels(moment)]
    for view, gain in zip(views, _GAINS, strict=True):
        shares = [visible_shares(view, moment) for moment in parts if len(moment) > 1]
        worst = float(np.mean([s.min() + s.mean() for s in shares])) if shares else 0.0
        worst += min((abs(float(normal @ view.direction)) for normal in panels), default=0.0)
        if worst - gain > score:
            best, score = view, worst - gain
    return best


def _unit_direction(direction: Sequence[float]) -> Array:
    towards = np.array(direction, dtype=float)
    length = float(np.linalg.norm(towards))
    if not (np.isfinite(length) and length > 0):
        raise ViewError(f"the direction {tuple(direction)} has no length")
    return np.asarray(towards / length)


def _front(up: Array) -> Array:
    """The front side if no joint axis defines it."""
    front = np.array([0.0, -1.0, 0.0] if abs(up[1]) < _PARALLEL else [0.0, 0.0, 1.0])
    front -= (front @ up) * up
    return np.asarray(front / np.linalg.norm(front))


def _facing(normal: Array, up: Array) -> Array:
    """Normal of a mechanism's plane, with the sign for which axes point to the right, normal to
    up."""
    front = normal - (normal @ up) * up
    front = front / np.linalg.norm(front)
    right = np.cross(up, front)
    return np.asarray(-front if right[int(np.argmax(np.abs(right)))] < 0 else front)


def common_axis(mechanism: Mechanism) -> Array | None:
    """The common direction of all rotating joints; None if they have none."""
    turning = [
        mechanism.joint_axis(name)
        for name, spec in mechanism.model.joints.items()
        if spec.type in ("revolute", "cylindrical")
    ]
    if not turning or any(abs(axis @ turning[0]) < _PARALLEL for axis in turning):
        return None
    return turning[0]


def _normal(mechanism: Mechanism, parts: Sequence[Sequence[Array]]) -> Array | None:
    """The common axis, if the mechanism is to be seen along it; None if the axis is vertical and
    the bodies extend far along it."""
    normal, gravity = common_axis(mechanism), np.array(mechanism.model.gravity or np.zeros(3))
    if normal is None or _vibrates_along(normal, mechanism, parts):
        return None
    points = [points for moment in parts for points in moment]
    if not abs(normal @ gravity) > _PARALLEL * np.linalg.norm(gravity):
        return None if points and _has_panel_edge_on(normal, parts[0]) else normal
    if not points:
        return None
    everything = np.vstack(points)
    across = everything - np.outer(everything @ normal, normal)
    flat = np.ptp(everything @ normal) < _FLAT * np.ptp(across, axis=0).max()
    return normal if flat else None


def _vibrates_along(normal: Array, mechanism: Mechanism, parts: Sequence[Sequence[Array]]) -> bool:
    """Whether the bodies of a mode shape move along a direction, so that the vibration is not
    seen."""
    if len(parts) < 2 or MODE_SHAPE not in mechanism.result.statistics:
        return False
    steps = np.stack([b.mean(axis=0) - a.mean(axis=0) for a, b in zip(*parts[:2], strict=True)])
    return bool(abs(np.linalg.svd(steps)[2][0] @ normal) > _ALONG)


def _has_panel_edge_on(normal: Array, bodies: Sequence[Array]) -> bool:
    """Whether a thin body that is wide along the normal would be seen edge-on along it."""
    size = np.ptp(np.vstack(bodies), axis=0).max()
    return any(
        abs(across @ normal) < _EDGE_ON and np.ptp(points @ normal) > _FLAT * size
        for points, across in _panels(bodies)
    )


def _panels(bodies: Sequence[Array]) -> Iterator[tuple[Array, Array]]:
    """The thin and wide bodies among bodies (n, 3), with their normals."""
    for points in bodies:
        _, extents, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        is_thin = len(extents) == len(axes.T) and extents[2] < _THIN * extents[1]
        if is_thin and extents[1] > _THIN * extents[0]:
            yield points, axes[2]


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
