"""Joints on curves: piecewise polynomial curves, initial contact points, and constraint rows.

A curve is approximated by polynomials of degree seven over its arc length. They match position,
unit tangent and curvature at both ends of every piece, position and tangent near its middle. So
curvature is continuous, and the error falls with the eighth power of the length of a piece. A curve
marker (`curve_marker`) adds one scalar coordinate, so a joint removes one freedom less than rows:

    pin-in-slot, cam-knife   t·h = 0, n·h = 0             h from the curve marker to J
    cam-roller               t·h = 0, n·h = ± radius
    cam-flat                 m·h = 0, m·t = 0             m normal to flat, h from J to the curve
    cam-cam                  t·h = 0, n·h = 0, t·n₂ = 0   h from the first curve to the second
    point-on-curve           h = 0                        in space, or in the plane of the model

The initial position along a curve is searched among samples; assembly closes the remaining gap.
The follower is on the side of its roller if it has one, else on the outside of a closed curve, or
on the side of the follower's centre of mass. The normal force is the multiplier of one row;
`Contact` has its sign while the parts press against each other.
Sources: Haug, Computer Aided Kinematics and Dynamics, 1989, §3.5; Hong & Liu 2011, §1.3.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.marker import MarkerTable
from flexmb.engine.geometry import marker_frame
from flexmb.engine.joints import DOT1, DOT2, POINT
from flexmb.engine.joints.coordinate import Contact, CurvePoint, CurvePoints
from flexmb.engine.joints.curve_marker import COEFFICIENTS, Pieces
from flexmb.errors import FlexmbWarning, Problem, SceneError
from flexmb.model import lookup
from flexmb.model.joints.curve import CurveShape, curve_shape
from flexmb.model.joints.joint import JointSpec
from flexmb.model.markers import PlacedMarker
from flexmb.model.model import Model
from flexmb.model.plane import plane_axes
from flexmb.model.reading import GROUND
from flexmb.model.scenes.dynamics import ACCURACY

Array = NDArray[np.float64]
_ROUND_OFF = 1e-13  # error of the pieces over the size of the curve that is round-off
# Largest allowed jump of the third derivative between pieces, over its largest value. At a jump the
# acceleration has a kink, where methods of high order need short steps.
_SMOOTH_JUMP = 1e-7
_MIN_PIECES, _MAX_PIECES = 64, 1024
_ASIDE = 1e-9  # distance from a break, over the piece, at which its curvature is taken
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(7)


@lru_cache(maxsize=64)  # the same shape has the same pieces in every joint
def pieces_of(shape: CurveShape) -> Pieces:
    """Pieces of a curve, halved until their error is round-off and the third derivative smooth."""
    per_break = max(1, -(-_MIN_PIECES // (len(shape.breaks) - 1)))
    pieces = _divide_curve(shape, per_break)
    while 2 * len(pieces.coefficients) <= _MAX_PIECES:
        exact, per_break = pieces.error <= _ROUND_OFF, 2 * per_break
        if exact and pieces.jump <= _SMOOTH_JUMP:
            break
        finer = _divide_curve(shape, per_break)
        if exact and finer.jump >= pieces.jump:
            break
        pieces = finer
    return pieces


def _divide_curve(shape: CurveShape, per_break: int) -> Pieces:
    b = shape.breaks
    u = np.interp(np.arange(per_break * (len(b) - 1) + 1) / per_break, np.arange(len(b)), b)
    lengths = _arc_lengths(shape, u[:-1], u[1:])
    ends = np.append(0.0, np.cumsum(lengths))
    nodes = _by_length(shape.at(u))
    nodes[-1] = nodes[0 if shape.closed else -1]
    first, last = nodes[:-1].copy(), nodes[1:].copy()
    k = np.arange(per_break, len(first) + shape.closed, per_break)  # breaks: the curvature may jump
    for sides, i, side in ((first, k % len(first), _ASIDE), (last, k - 1, 1.0 - _ASIDE)):
        sides[i, 2] = _by_length(shape.at(u[i] + side * (u[i + 1] - u[i])))[:, 2]
    middle, quarter = (share * u[1:] + (1.0 - share) * u[:-1] for share in (0.5, 0.25))
    half = _arc_lengths(shape, u[:-1], middle)
    pieces = Pieces(ends, _hermite(first, last, lengths, _by_length(shape.at(middle))[:, :2], half))
    places = ends[:-1] + _arc_lengths(shape, u[:-1], quarter)
    off = np.abs(pieces.at(places)[:, 0] - shape.at(quarter)[:, 0]).max()
    return _with_breaks(
        pieces._replace(error=float(off / _size(nodes[:, 0]))), per_break, shape.closed
    )


def _with_breaks(pieces: Pieces, per_break: int, closed: bool) -> Pieces:
    """Pieces with the largest jump of the third derivative within, and the breaks that bend."""
    c, h, n = pieces.coefficients, np.diff(pieces.ends)[:, None, None], np.arange(COEFFICIENTS)
    factors = n * (n - 1) * np.array([0.0 * n + 1.0, n - 2])
    powers = np.maximum(n - np.array([[2], [3]]), 0)
    end = np.einsum("kan,dn,kdn->kda", c, factors, h**powers)
    begin = c[:, :, 2:4].swapaxes(1, 2) * np.array([[2.0], [6.0]])
    jumps = np.abs(end - np.roll(begin, -1, axis=0)).max(axis=2)[: None if closed else -1]
    size, at = np.abs(begin).max(axis=(0, 2)), np.arange(per_break, len(jumps) + 1, per_break)
    within = np.delete(jumps[:, 1], at - 1).max(initial=0.0)
    edges = pieces.ends[::per_break]
    apart = np.diff(np.append(edges, edges[-1] + edges[1]) if closed else edges)
    apart = np.minimum(apart[:-1], apart[1:])
    kinks = np.where(jumps[at - 1, 1] > 10.0 * within, jumps[at - 1, 1], 0.0) * apart**3 / 6.0
    bends = jumps[at - 1, 0] > _SMOOTH_JUMP * max(size[0], 1.0 / pieces.ends[-1])
    change = (bends * jumps[at - 1, 0] * apart**2 / 2.0 + kinks) / _size(c[:, :, 0])
    relative = float(within / max(size[1], pieces.ends[-1] ** -2.0))  # for straight lines
    return pieces._replace(jump=relative, breaks=np.stack([pieces.ends[at], change], axis=1))


def _size(x: Array) -> float:
    """Diagonal of the box around points (n, 3) [m]."""
    return float(np.linalg.norm(np.ptp(x, axis=0)))


def _arc_lengths(shape: CurveShape, low: Array, high: Array) -> Array:
    """(n,) arc length between parameters, by Gauss quadrature of seven points."""
    half = 0.5 * (high - low)
    u = 0.5 * (high + low)[:, None] + half[:, None] * _GAUSS
    speed = np.linalg.norm(shape.at(u.ravel())[:, 1], axis=1).reshape(u.shape)
    return np.asarray(half * (speed @ _WEIGHTS))


def _by_length(derivatives: Array) -> Array:
    """(n, 3, 3) position, unit tangent, curvature vector from derivatives over any parameter."""
    place, first, second = derivatives.swapaxes(0, 1)
    speed = np.linalg.norm(first, axis=1)[:, None]
    tangent = first / speed
    along = np.einsum("ka,ka->k", second, tangent)[:, None]
    return np.stack([place, tangent, (second - along * tangent) / speed**2], axis=1)


def _hermite(first: Array, last: Array, lengths: Array, middles: Array, half: Array) -> Array:
    """(n, 3, 8) coefficients of the polynomials of degree seven between ends (n, 3, 3).

    They also have value and slope `middles` (n, 2, 3) at arc lengths `half` (n,) from their begin.
    """
    h, t, n = lengths[:, None], half[:, None], np.arange(3, COEFFICIENTS)
    (p, d, a), (q, e, b) = first.swapaxes(0, 1), last.swapaxes(0, 1)
    # conditions at the far end and the middle, less the parabola from the near end
    remainders = [q - p - h * (d + 0.5 * h * a), (e - d - h * a) * h, (b - a) * h * h]
    remainders += [middles[:, 0] - p - t * (d + 0.5 * t * a), (middles[:, 1] - d - t * a) * h]
    t = t / h
    rows = [0.0 * t + 1.0, n + 0.0 * t, n * (n - 1) + 0.0 * t, t**n, n * t ** (n - 1)]
    matrix = np.stack(np.broadcast_arrays(*rows), axis=1)
    higher = np.linalg.solve(matrix, np.stack(remainders, axis=1)).swapaxes(1, 2) / h[:, None] ** n
    return np.concatenate([np.stack([p, d, 0.5 * a], axis=2), higher], axis=2)


X, Y, Z = 0, 1, 2
_SAMPLES = 1440  # samples along a curve in the search for an initial position
# Newton's method from a sample: most corrections, most samples to the solution, least determinant.
_MAX_CORRECTIONS, _MAX_SHIFT, _SINGULAR = 8, 8.0, 1e-12
_WARNED_ERROR = 1e-9  # a larger error of the pieces, over the size of the curve, is reported


@dataclass(frozen=True)
class PlacedCurve:
    """A curve on the marker that carries it, in the initial pose: x (3,), R (3, 3), global."""

    name: str
    pieces: Pieces
    closed: bool
    turns: bool
    x: Array
    R: Array

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        return float(self.pieces.ends[-1])

    @property
    def samples(self) -> Array:
        """Arc lengths (n,) of the samples; without the end of a closed curve."""
        return np.linspace(0.0, self.length, _SAMPLES, endpoint=not self.closed)

    @property
    def outward(self) -> float:
        """1 if the normal, left of the tangent, points out of a closed curve, −1 if into it."""
        c = self.pieces.at(self.samples)
        area = np.sum(c[:, 0, X] * c[:, 1, Y] - c[:, 0, Y] * c[:, 1, X])
        return -1.0 if area > 0.0 else 1.0

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Global points, tangents and normals (n, 3) at arc lengths s (n,)."""
        c = self.pieces.at(s)
        t = c[:, 1]
        n = np.stack([-t[:, Y], t[:, X], 0.0 * t[:, X]], axis=1)
        return self.x + c[:, 0] @ self.R.T, t @ self.R.T, n @ self.R.T

    def bend(self, s: float) -> tuple[Array, Array, Array]:
        """Global point, tangent and curvature vector (3,) at arc length s."""
        c = self.pieces.at(np.array([s]))[0] @ self.R.T
        return self.x + c[0], c[1], c[2]


def place_curve(model: Model, curve: str, marker: PlacedMarker) -> PlacedCurve:
    """A curve on the marker that carries it, in the initial pose.

    Warns if the pieces approximate it badly, as an expression with a corner.
    """
    shape = curve_shape(model, curve)
    pieces = pieces_of(shape)
    if pieces.error > _WARNED_ERROR:
        what = f"is followed within {pieces.error:.2g} of its size only; has it a corner?"
        warnings.warn(f"curves.{curve} {what}", FlexmbWarning, stacklevel=2)
    return PlacedCurve(curve, pieces, shape.closed, shape.in_plane, *marker_frame(model, marker))


def _nearest_place(curve: PlacedCurve, point: Array, across: bool) -> float:
    """Arc length [m] nearest to a point; `across`: its height over the curve's plane is ignored."""
    s, seen = curve.samples, curve.R[:, : 2 if across else 3]
    nearest = s[np.argmin(np.linalg.norm((point - curve.at(s)[0]) @ seen, axis=1))]

    def gap(places: Array) -> tuple[Array, Array]:
        x, t, bend = curve.bend(places[0])
        apart = seen @ (seen.T @ (x - point))
        return np.array([apart @ t]), np.array([[1.0 + apart @ bend]])

    return _refine_places(gap, (curve,), (float(nearest),))[0]


def _tangent_place(curve: PlacedCurve, point: Array, normal: Array) -> float:
    """Arc length [m] where the curve is parallel to a flat through a point, nearest to the flat."""
    s = curve.samples
    x, t, _ = curve.at(s)
    slope, height = t @ normal, np.abs((x - point) @ normal)
    turning = slope * np.roll(slope, -1) <= 0.0
    if not curve.closed:
        turning[-1] = False
    if not turning.any():
        return float(s[np.argmin(np.abs(slope))])
    between = s[np.argmin(np.where(turning, height, np.inf))] + 0.5 * curve.length / len(s)

    def gap(places: Array) -> tuple[Array, Array]:
        _, t, bend = curve.bend(places[0])
        return np.array([t @ normal]), np.array([[bend @ normal]])

    return _refine_places(gap, (curve,), (float(between),))[0]


def _nearest_pair(
    first: PlacedCurve, second: PlacedCurve, start: float | None
) -> tuple[float, float]:
    """Arc lengths [m] on two curves where they are nearest to touching; `start` is the first."""
    s = first.samples[::4] if start is None else np.array([start])
    u = second.samples[::4]
    (x, t, _), (y, _, n) = first.at(s), second.at(u)
    size = 0.5 * (first.length + second.length)
    apart = np.linalg.norm(x[:, None] - y[None], axis=2) / size
    i, j = np.unravel_index(np.argmin(apart + 0.1 * (t @ n.T) ** 2), apart.shape)
    nearest = float(s[i]), float(u[j])
    if start is not None:
        return nearest

    def gap(places: Array) -> tuple[Array, Array]:
        (x, t, k), (y, w, b) = first.bend(places[0]), second.bend(places[1])
        n, bent = np.cross(second.R[:, Z], w), np.cross(second.R[:, Z], b)
        slopes = [[1.0 + (x - y) @ k, -w @ t], [k @ n, t @ bent]]
        return np.array([(x - y) @ t, t @ n]), np.array(slopes)

    return _refine_places(gap, (first, second), nearest)


def _refine_places(
    gap: Callable[[Array], tuple[Array, Array]], curves: tuple[PlacedCurve, ...],
    near: tuple[float, ...],
) -> tuple[float, ...]:  # fmt: skip
    """Arc lengths [m] near samples at which gaps are zero, by Newton's method with their slopes.

    From a sample itself assembly would move well-placed bodies by its distance from the solution.
    """
    places = np.array(near)
    for _ in range(_MAX_CORRECTIONS):
        gaps, slopes = gap(places)
        if abs(np.linalg.det(slopes)) < _SINGULAR:
            return near
        places = places - np.linalg.solve(slopes, gaps)
    ends, closed = np.array([(curve.length, curve.closed) for curve in curves]).T
    if not (np.abs(places - near) < _MAX_SHIFT * ends / _SAMPLES).all():
        return near
    return tuple(np.where(closed, places % ends, np.clip(places, 0.0, ends)).tolist())


def _inside(curve: PlacedCurve, points: Array) -> NDArray[np.bool_]:
    """Which of the points (n, 3) lie inside a closed curve, by the crossings of a ray."""
    ring = curve.pieces.at(curve.samples)[:, 0]
    local = (points - curve.x) @ curve.R
    a, b = ring, np.roll(ring, -1, axis=0)
    px, py = local[:, [X]], local[:, [Y]]
    spans = (a[:, Y] > py) != (b[:, Y] > py)
    rise = np.where(b[:, Y] == a[:, Y], 1.0, b[:, Y] - a[:, Y])
    crossing = a[:, X] + (py - a[:, Y]) * (b[:, X] - a[:, X]) / rise
    odd: NDArray[np.bool_] = (spans & (px < crossing)).sum(axis=1) % 2 == 1
    return odd


def _side_of_follower(curve: PlacedCurve, s: float, center: Array) -> float:
    """1 if a point lies on the side to which the normal at s points, −1 on the other."""
    x, _, n = curve.at(np.array([s]))
    return 1.0 if n[0] @ (center - x[0]) >= 0.0 else -1.0


class CurveJoint(NamedTuple):
    """Rows (kind, a, b, offset) between markers I and J; `reversed`: their I is the joint's J."""

    I: int  # noqa: E741
    J: int
    rows: tuple[tuple[int, int, int, float], ...]
    reversed: bool = False


@dataclass(frozen=True)
class JointContext:
    """Context in which a joint on curves is made: its frames I and J, its group and first row."""

    model: Model
    name: str
    frames: tuple[PlacedMarker, PlacedMarker]
    markers: MarkerTable
    curve_points: CurvePoints
    group: int
    row: int

    @property
    def joint(self) -> JointSpec:
        """Specification of the joint in the scene."""
        return self.model.joints[self.name]

    def add_curve_marker(
        self, curve: PlacedCurve, carrier: int, side: int, start: float, other: int = -1
    ) -> int:
        """Add a curve marker carried by frame I or J (0, 1); its rows see it as I or J (`side`)."""
        pool, n = self.markers.pool, len(curve.pieces.coefficients)
        pieces = curve.pieces
        dynamics, most = self.model.dynamics, math.inf  # of a jump that steps may cross
        if dynamics is not None and dynamics.step is None:
            most = dynamics.accuracy or ACCURACY
        breaks = pieces.breaks[pieces.breaks[:, 1] > most, 0]
        at = pool.add(np.concatenate([pieces.ends, pieces.coefficients.ravel(), breaks]))
        marker = self.markers.add_unshared(self.frames[carrier])
        shape = at, n, curve.closed, curve.turns
        self.curve_points.points.append(
            CurvePoint(self.name, marker, *shape, self.group, side, other, start, len(breaks))
        )
        return marker

    def add_contact(self, row: int, compressed: float) -> None:
        """Mark the joint as one that can only push: with this sign of the multiplier of a row."""
        self.curve_points.contacts.append(Contact(self.name, self.row + row, compressed))


def curve_joint(context: JointContext) -> CurveJoint:
    """Rows of a joint on curves, with its curve markers.

    Raises
    ------
    SceneError
        A roller larger than the curve is hollow.
    """
    model, joint = context.model, context.joint
    assert joint.curve is not None  # joints on curves have one
    curve = place_curve(model, joint.curve, context.frames[0])
    if joint.second_curve is not None:
        return _cams(context, (curve, place_curve(model, joint.second_curve, context.frames[1])))
    x, R = marker_frame(model, context.frames[1])
    if joint.type == "cam-flat":
        return _flat(context, curve, x, R[:, Z])
    across = joint.type != "point-on-curve"
    s = _nearest_place(curve, x, across) if joint.start is None else joint.start
    S, J = context.add_curve_marker(curve, 0, 0, s), context.markers.add(context.frames[1])
    if not across:
        axes = (X, Y, Z) if model.plane is None else plane_axes(model.plane)[:2]
        return CurveJoint(S, J, tuple((POINT, axis, axis, 0.0) for axis in axes))
    side, radius = _contact_side(context, curve, s, x), joint.radius or 0.0
    if joint.type != "pin-in-slot":
        context.add_contact(1, -side)
    if radius > 0.0:
        _check_roller(model, context.name, curve, side, radius)
    return CurveJoint(S, J, ((DOT2, X, X, 0.0), (DOT2, Y, Y, side * radius)))


def _flat(context: JointContext, curve: PlacedCurve, x: Array, normal: Array) -> CurveJoint:
    """A flat follower through x: the curve's point lies in the flat, its tangent along it."""
    s = context.joint.start
    s = _tangent_place(curve, x, normal) if s is None else s
    S, J = context.add_curve_marker(curve, 0, 1, s), context.markers.add(context.frames[1])
    _, _, n = curve.at(np.array([s]))
    context.add_contact(0, _contact_side(context, curve, s, x) * float(np.sign(n[0] @ normal)))
    return CurveJoint(J, S, ((DOT2, Z, Z, 0.0), (DOT1, Z, X, 0.0)), True)


def _cams(context: JointContext, curves: tuple[PlacedCurve, PlacedCurve]) -> CurveJoint:
    joint, k = context.joint, len(context.curve_points.points)
    first, second = _nearest_pair(*curves, joint.start)
    if joint.second_start is not None:
        second = joint.second_start
    S = context.add_curve_marker(curves[0], 0, 0, first, k + 1)
    T = context.add_curve_marker(curves[1], 1, 1, second, k)
    if curves[0].closed:
        within = _inside(curves[0], curves[1].at(curves[1].samples[::8])[0]).mean() > 0.5
        side = -curves[0].outward if within else curves[0].outward
    else:
        side = _side_of_follower(curves[0], first, _center(context.model, joint, curves[1].x))
    context.add_contact(1, -side)
    return CurveJoint(S, T, ((DOT2, X, X, 0.0), (DOT2, Y, Y, 0.0), (DOT1, X, Y, 0.0)))


def _contact_side(context: JointContext, curve: PlacedCurve, s: float, x: Array) -> float:
    """Side of the curve on which a follower is: 1 that to which the normal points, −1 the other."""
    joint = context.joint
    if joint.radius is not None:
        p, _, n = curve.at(np.array([s]))
        height = float(n[0] @ (x - p[0]))
        if abs(height) > 0.5 * joint.radius or not curve.closed:
            return 1.0 if height >= 0.0 else -1.0
    if curve.closed:
        return curve.outward
    return _side_of_follower(curve, s, _center(context.model, joint, x))


def _center(model: Model, joint: JointSpec, marker: Array) -> Array:
    """Centre of mass of the follower; if it is ground, the cam's mirrored at the marker."""
    I, J = (reference.partition(".")[0] for reference in joint.between)  # noqa: E741
    body = model.bodies[I if J == GROUND else J]
    if body.flexible:
        return marker
    center: Array = lookup.global_position(
        model, lookup.place_marker(model, f"{I if J == GROUND else J}.center")
    )
    return 2.0 * marker - center if J == GROUND else center


def _check_roller(model: Model, name: str, curve: PlacedCurve, side: float, radius: float) -> None:
    s = curve.samples
    c = curve.pieces.at(s)
    hollow = side * (c[:, 1, X] * c[:, 2, Y] - c[:, 1, Y] * c[:, 2, X])
    k = int(np.argmax(hollow))
    if hollow[k] * radius >= 1.0:
        say = model.units.say
        what = (
            f"the roller does not fit the curve, which is hollow {say(s[k], 'm')} along it with a "
            f"radius of {say(1.0 / hollow[k], 'm')}; take a smaller roller, or round the curve"
        )
        raise SceneError.from_problems([Problem(f"joints.{name}.radius", what)])
