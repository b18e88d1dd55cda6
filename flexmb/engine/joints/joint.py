"""The rows of every joint type between its two triads, in space and in a plane, and of drivers.

Axes x, y, z are 0, 1, 2. z_I is the axis of the joint, z_J its second axis if it has two. A row is
(kind, axis of I, axis of J, measured): a measured row keeps the value of the initial pose, all
others are zero. A composite joint (a massless link with a joint at each end) keeps the quantities
that the link leaves constant: their number is 6 less the freedoms of its two joints.

In a plane model the triads have the normal of the plane as z and, if the joint slides, the
direction of sliding as x. Their orientation is then one ANGLE row, which has no second solution at
180°, and a sliding joint has one offset row. Sources: Hong & Liu 2011, sections 1.3, 2.3; Haug,
Computer Aided Kinematics and Dynamics, 1989, ch. 3, 9.

Drivers: the coordinates of a marker are its offsets along the axes of the marker to which they are
relative (global axes for ground), and an angle about z of that marker or, in a plane, the normal. A
prescribed velocity or acceleration is integrated here, so that every row is holonomic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.geometry import Ends, Geometry, marker_frame
from flexmb.engine.joints import (
    ANGLE,
    DISTANCE,
    DOT1,
    DOT2,
    MOMENT,
    POINT,
    RADIAL,
    ROW_KINDS,
    TWIST,
)
from flexmb.engine.state import rows_between
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.functions.antiderivatives import antiderivative
from flexmb.model.functions.expression import Expression
from flexmb.model.joints.driver import DriverSpec, Start, closing_problem
from flexmb.model.joints.joint import JointSpec
from flexmb.model.markers import PlacedMarker, rotation_matrix
from flexmb.model.model import Model
from flexmb.model.plane import across, in_plane_triad, plane_axes
from flexmb.model.reading import GROUND
from flexmb.model.sensor import JointSensorSpec

Row = tuple[int, int, int, bool]
Array = NDArray[np.float64]
X, Y, Z = 0, 1, 2
_ROUND_OFF = 1e-12
_COINCIDENT = ((POINT, X, X, False), (POINT, Y, Y, False), (POINT, Z, Z, False))
_PARALLEL_AXES = ((DOT1, X, Z, False), (DOT1, Y, Z, False))
_EQUAL_AXES = ((DOT1, X, Y, False), (DOT1, Y, Z, False), (DOT1, Z, X, False))
_ON_AXIS = ((DOT2, X, X, False), (DOT2, Y, Y, False))
_PERPENDICULAR_AXES = ((DOT1, Z, Z, False),)
_IN_PLANE = ((DOT2, Z, Z, False),)
_LINK = ((DISTANCE, X, X, True),)
_CONSTANT_HEIGHT = ((DOT2, Z, Z, True),)
JOINT_ROWS: dict[str, tuple[Row, ...]] = {
    "fixed": _COINCIDENT + _EQUAL_AXES,
    "revolute": _COINCIDENT + _PARALLEL_AXES,
    "prismatic": _EQUAL_AXES + _ON_AXIS,
    "screw": _PARALLEL_AXES + _ON_AXIS,  # and the rows of its thread: `coordinate.screw_rows`
    "cylindrical": _PARALLEL_AXES + _ON_AXIS,
    "spherical": _COINCIDENT,
    "universal": _COINCIDENT + _PERPENDICULAR_AXES,
    "constant-velocity": (*_COINCIDENT, (TWIST, X, Y, False)),
    "planar": _PARALLEL_AXES + _IN_PLANE,
    "in-line": _ON_AXIS,
    "in-plane": _IN_PLANE,
    "parallel": _PARALLEL_AXES,
    "perpendicular": _PERPENDICULAR_AXES,
    "orientation": _EQUAL_AXES,
    "distance": _LINK,
    "revolute-spherical": _CONSTANT_HEIGHT + _LINK,
    "prismatic-spherical": ((DOT2, X, X, True), (DOT2, Y, Y, True)),
    "cylindrical-spherical": ((RADIAL, Z, Z, True),),
    "revolute-universal": _PERPENDICULAR_AXES + _CONSTANT_HEIGHT + _LINK,
    "spherical-universal": _LINK,
}
"""Rows by joint type, for types whose rows do not depend on the initial pose."""
DRIVER_ROWS = {"angle": (ANGLE, X, X), "stroke": (DOT2, Z, Z)}
_CROSS_ANGLE = (ANGLE, X, Z)  # angle of a universal joint: of z_J, its second axis, about z_I
SECOND_TURN = np.diag([-1.0, 1.0, -1.0])
"""Rotation of the triad of marker J for the second angle of a universal joint.

Seen from the turned triad, the first axis of the joint is at the second angle: that of J about its
own axis relative to the cross. It is 0 where the first angle is 0.
"""


def driver_row(joint: str, coordinate: str) -> tuple[int, int, int]:
    """Kind and axes of the row that measures a coordinate of a joint type."""
    return _CROSS_ANGLE if joint == "universal" else DRIVER_ROWS[coordinate]


def measured_coordinate(
    geometry: Geometry, spec: JointSensorSpec
) -> tuple[Ends, tuple[int, int, int]]:
    """Markers of a measured joint coordinate, and kind and axes of the row that measures it."""
    if spec.joint is None:
        assert spec.between is not None  # one of the two is given
        return geometry.frames(spec.between, spec.axis), driver_row("", spec.type)
    I, J = geometry.joint_frames(spec.joint)  # noqa: E741
    row = driver_row(geometry.model.joints[spec.joint].type, spec.type)
    if spec.type == "second_angle":
        return (replace(J, R=J.R @ SECOND_TURN), I), row
    return (I, J), row


def composite_rows(
    model: Model,
    name: str,
    I: PlacedMarker,  # noqa: E741
    J: PlacedMarker,
) -> tuple[Row, ...]:
    """Rows of a link between two axes; they depend on the relative position of the axes.

    Raises
    ------
    SceneError
        The relative position of the axes is not possible for this joint type.
    """
    (xi, Ri), (xj, Rj) = (marker_frame(model, marker) for marker in (I, J))
    a, b, h = Ri[:, Z], Rj[:, Z], xj - xi
    kind = model.joints[name].type
    parallel = np.linalg.norm(np.cross(a, b)) < lookup.PARALLEL
    if kind == "revolute-revolute":
        if parallel:
            return _PARALLEL_AXES + _CONSTANT_HEIGHT + _LINK
        if np.linalg.norm(h) <= _round_off(xi, xj):
            return (*_COINCIDENT, (DOT1, Z, Z, True))
        needed = "be parallel, or the markers lie where they meet"
    else:
        if parallel:
            return (*_PARALLEL_AXES, (RADIAL, Z, Z, True))
        if abs(a @ b) < lookup.PARALLEL:
            return _PERPENDICULAR_AXES + ((MOMENT, Z, Z, True),) + _CONSTANT_HEIGHT
        needed = "be parallel or at right angles"
    apart = np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b)))
    what = f"the axes of a {kind} joint must {needed}; they are {apart:.4g} deg apart"
    raise SceneError.from_problems([Problem(f"joints.{name}.second_axis", what)])


def row_constant(
    model: Model,
    row: Row,
    I: PlacedMarker,  # noqa: E741
    J: PlacedMarker,
) -> float:
    """The constant of a row: its value in the initial pose if it is a measured one, else zero.

    Raises
    ------
    ZeroDivisionError
        A measured length is zero, so that its direction is undefined.
    """
    number, a, b, is_measured = row
    if not is_measured:
        return 0.0
    (xi, Ri), (xj, Rj) = (marker_frame(model, marker) for marker in (I, J))
    kind = ROW_KINDS[number]
    value = float(kind.value(rows_between(xi, Ri, xj, Rj), a, b, 0, 1))
    if kind.is_distance and value <= _round_off(xi, xj):
        raise ZeroDivisionError
    return value


def _round_off(*points: Array) -> float:
    """Round-off of a distance between points of these magnitudes [m]."""
    return _ROUND_OFF * max(float(np.linalg.norm(point)) for point in points)


_PLANE_ANGLE = (ANGLE, X, X, False)
_PLANE_OFFSET = (DOT2, Y, Y, False)
_PLANAR_SLIDING_ROWS = {  # the axis of the joint lies in the plane and becomes x
    "prismatic": (_PLANE_ANGLE, _PLANE_OFFSET),
    "cylindrical": (_PLANE_ANGLE, _PLANE_OFFSET),
    "in-line": (_PLANE_OFFSET,),
    "prismatic-spherical": ((DOT2, Y, Y, True),),
    "in-plane": ((DOT2, X, X, False),),
}
_PLANAR_LINK_ROWS = {"distance": _LINK, "revolute-revolute": _LINK}
STROKE = (DOT2, X, X)
"""Row that measures the stroke of a joint with planar triads."""


def planar_joint(
    model: Model,
    joint: JointSpec,
    I: PlacedMarker,  # noqa: E741
    J: PlacedMarker,
) -> tuple[PlacedMarker, PlacedMarker, tuple[Row, ...]]:
    """Triads and rows of a joint in the plane, from those in space."""
    plane = model.plane
    assert plane is not None  # the caller knows
    first, second, _ = plane_axes(plane)
    together = ((POINT, first, first, False), (POINT, second, second, False))
    A = np.eye(3) if I.body == GROUND else rotation_matrix(model.bodies[I.body].orientation)
    triad = A @ I.R
    if joint.type in ("fixed", "orientation"):
        lies = [k for k in range(3) if not across(triad[:, k], plane)]
        turn = _turn_into_plane(triad, triad[:, lies[0]], plane)
        rows = (*together, _PLANE_ANGLE) if joint.type == "fixed" else (_PLANE_ANGLE,)
        return _turn_marker(I, turn), _turn_marker(J, turn), rows
    slides = _PLANAR_SLIDING_ROWS.get(joint.type)
    if joint.type == "cylindrical" and across(triad[:, 2], plane):
        slides = None
    if slides is not None:
        turn = _turn_into_plane(triad, triad[:, 2], plane)
        return _turn_marker(I, turn), _turn_marker(J, turn), slides
    return I, J, _PLANAR_LINK_ROWS.get(joint.type, together)


def _turn_into_plane(triad: np.ndarray, axis: np.ndarray, plane: str) -> np.ndarray:
    """Rotation (3, 3) of a triad, in its own axes, to z normal to the plane and x along `axis`."""
    z = np.array(PLANES[plane])
    x = axis - (axis @ z) * z
    x /= np.linalg.norm(x)
    turn: np.ndarray = triad.T @ np.column_stack([x, np.cross(z, x), z])
    return turn


def _turn_marker(marker: PlacedMarker, turn: np.ndarray) -> PlacedMarker:
    return replace(marker, R=marker.R @ turn)


Kind = tuple[int, int, int]


def marker_rows(
    model: Model, driver: DriverSpec, flexbodies: Mapping[str, FlexBody]
) -> tuple[PlacedMarker, PlacedMarker, list[Kind]]:
    """Both markers of a driver between markers, and the row of each of its motions."""
    I, J = lookup.frames(model, driver.ends, driver.axis, flexbodies)  # noqa: E741
    turn = np.eye(3)
    if model.plane is not None and driver.axis is None:
        turn = in_plane_triad(model.plane)
        I, J = lookup.with_axes(I, I.R @ turn), lookup.with_axes(J, J.R @ turn)  # noqa: E741
    rows = []
    for coordinate, _ in driver.motions(model.plane):
        if coordinate == "distance":
            rows.append((DISTANCE, X, X))
        elif coordinate == "angle":
            rows.append((ANGLE, X, X))
        else:
            axis = int(np.argmax(turn["xyz".index(coordinate)]))
            rows.append((DOT2, axis, axis))
    return I, J, rows


def driver_functions(model: Model, name: str, ends: Ends, rows: Sequence[Kind]) -> list[Expression]:
    """The displacement over time that each row follows.

    Raises
    ------
    SceneError
        A function cannot be integrated, or a distance becomes zero.
    """
    driver = model.drivers[name]
    expressions = []
    for k, motion in enumerate(driver.motions(model.plane)):
        expression = motion.function.expression
        if driver.order > 0:
            where = f"drivers.{name}.{motion.coordinate}"
            first = _initial_value(driver.start, k)
            try:
                if first is None:
                    first = row_constant(model, (*rows[k], True), *ends)
                line = (first, _initial_value(driver.start_velocity, k) or 0.0)
                expression = _integrate_rate(model, driver.order, expression, line)
            except ZeroDivisionError:
                what = "the distance begins with zero: its direction is not known"
                raise SceneError.from_problems([Problem(where, what)]) from None
            except SceneError as error:
                problems = [Problem(where, problem.what) for problem in error.problems]
                raise SceneError.from_problems(problems) from None
            what = closing_problem(model, expression) if motion.coordinate == "distance" else None
            if what is not None:
                raise SceneError.from_problems([Problem(where, what)])
        expressions.append(expression)
    return expressions


def _integrate_rate(
    model: Model, order: int, rate: Expression, line: tuple[float, float]
) -> Expression:
    """Displacement from a velocity (`order` 1) or acceleration (2).

    `line`: initial value and initial velocity.
    """
    spans = [spec.duration for spec in (model.dynamics, model.kinematics) if spec is not None]
    end = max(spans, default=None)
    first, speed = line
    start = (("t", 0.0), ("const", speed), ("*", 0.0), ("const", first), ("+", 0.0))
    return Expression(rate.text, (*antiderivative(rate.ops, order, end), *start, ("+", 0.0)))


def _initial_value(start: Start | None, k: int) -> float | None:
    return None if start is None else start.values[k]
