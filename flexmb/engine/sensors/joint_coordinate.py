"""Joint coordinates and distances: quantities that constraint rows measure, and their derivatives.

Angles count turns: of all values that differ by full turns, an angle has the one nearest to that of
the last accepted state, at the begin to zero. Where a spring, stop, screw or gear has a scalar
coordinate that counts the turns of the same joint, it is the one nearest to that coordinate.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from flexmb.engine.algebra.vector import clear, wrapped
from flexmb.engine.bodies.wrench import marker_acceleration
from flexmb.engine.jit import Integers, kernel, unit
from flexmb.engine.joints import DISTANCE, ROW_KINDS
from flexmb.engine.joints.row import (
    add_row_tangent,
    put_row_gradient,
    rate,
    row_curvature,
    row_value,
)
from flexmb.engine.kind import ChannelKind, Kind, Measure, SensorKind, Term
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import Sensors

if TYPE_CHECKING:
    from flexmb.engine.lowering import Lowering
    from flexmb.engine.sensors.sensor import Channels
    from flexmb.model.sensor import DistanceSensorSpec, JointSensorSpec


@unit
def coordinate(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Value of the quantity that the row of term t measures."""
    return row_value(run, sensors.terms[t])  # type: ignore[no-any-return]


@unit
def coordinate_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradient of this quantity with respect to the motion of the markers."""
    _copy_gradient(run, sensors.terms[t], 0)
    return 0.0


@kernel
def _copy_gradient(run, term, level):
    """Copy the gradient of a row to FeedbackWork.g[level]."""
    put_row_gradient(run, term)
    g, out = run.work.row.g, run.work.feedback.g[level]
    for c in range(12):
        out[c] = g[c]


@unit
def coordinate_rate(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Rate g·u of the measured quantity, u the velocities of both markers."""
    term, markers = sensors.terms[t], run.work.now.marker
    put_row_gradient(run, term)
    return rate(run.work.row.g, markers[term["I"]], markers[term["J"]])  # type: ignore[no-any-return]


@unit
def coordinate_rate_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradients of g·u: g with respect to velocities, Hᵀ u with respect to positions."""
    term, g, H = sensors.terms[t], run.work.feedback.g, run.work.row.H
    _copy_gradient(run, term, 1)
    clear(H, 12, 12)
    if add_row_tangent(run, term, 1.0) == 0:
        return 0.0
    mi, mj, u = run.work.now.marker[term["I"]], run.work.now.marker[term["J"]], g[2]
    for c in range(3):
        u[c], u[3 + c], u[6 + c], u[9 + c] = mi["vx"][c], mi["om"][c], mj["vx"][c], mj["om"][c]
    for c in range(12):
        for r in range(12):
            g[0, c] += H[r, c] * u[r]
    return 0.0


@unit
def coordinate_acceleration(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Second time derivative of the measured quantity."""
    term, g = sensors.terms[t], run.work.row.g
    put_row_gradient(run, term)
    s = row_curvature(run, term)
    for side in range(2):
        k, o = (term["I"], 0) if side == 0 else (term["J"], 6)
        for p in range(2):
            x, y, z = marker_acceleration(run, at, k, 3 * p)
            q = o + 3 * p
            s += g[q] * x + g[q + 1] * y + g[q + 2] * z
    return s  # type: ignore[no-any-return]


@unit
def coordinate_acceleration_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Its gradient with respect to the accelerations of the markers."""
    _copy_gradient(run, sensors.terms[t], 1)
    return 0.0


COORDINATE = Measure(
    coordinate, coordinate_gradient, 0, ("value", "gradient"), ("gradient",)
)  # angles that count turns need the gradient for their rate too
COORDINATE_RATE = Measure(
    coordinate_rate, coordinate_rate_gradient, 1, ("gradient",), ("gradient", "tangent")
)
COORDINATE_ACCELERATION = Measure(
    coordinate_acceleration,
    coordinate_acceleration_gradient,
    2,
    ("gradient", "curvature"),
    ("gradient",),
)
ROW_MEASURES = (COORDINATE, COORDINATE_RATE, COORDINATE_ACCELERATION)
"""Measures of a row: its value, first and second time derivative."""


# If an angle is expected to change by more than this in one step, its rate predicts the new value.
_QUARTER_TURN = 0.5 * math.pi


class JointAngles(NamedTuple):
    """Channels of joint angles that count turns."""

    channels: Integers


@unit
def joint_angle(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Angle that the only term of channel c measures, nearest to its counter or to
    FeedbackWork.near."""
    channel = sensors.channels[c]
    angle = row_value(run, sensors.terms[channel["first"]])
    near, counter = run.work.feedback.near[c], channel["kind"]
    if counter >= 0:
        near = at.q[run.system.parts.coordinates[counter]["iq"]]
    return angle if math.isnan(near) else near + wrapped(angle - near)  # type: ignore[no-any-return]


@unit
def continue_joint_angles(run: Run, of: JointAngles, at: Point) -> int:
    """Update FeedbackWork.near of joint angles to the present position.

    They are NaN at the begin. In a long step a body may turn by
    more than half a turn; then the rate of the angle decides on the number of turns.
    """
    near, listed, sensors = run.work.feedback.near, of.channels, run.system.sensors
    passed = at.t[0] - run.state.t[0]
    for n in range(listed.shape[0]):
        c = listed[n]
        ahead = passed * coordinate_rate(run, sensors, at, sensors.channels[c]["first"])
        if abs(ahead) > _QUARTER_TURN:  # false for NaN
            near[c] += ahead
        near[c] = joint_angle(run, sensors, at, c)
    return SUCCESS


JOINT_ANGLES = Kind("joint_angles", JointAngles, {"angles": continue_joint_angles})
JOINT_ANGLE = ChannelKind(joint_angle, "terms", counts_turns=True)


def add_joint_coordinate(channels: Channels, spec: JointSensorSpec | DistanceSensorSpec) -> None:
    """A channel of a coordinate of a joint or between markers, or of its rate or acceleration."""
    lowering, counts_turns = channels.lowering, False
    if spec.type == "distance":
        i, j = (lowering.marker(reference) for reference in spec.between)
        kind, a, b = DISTANCE, 0, 0
    else:
        frames, (kind, a, b) = channels.joint_coordinate(spec)
        i, j = (lowering.markers.add(marker) for marker in frames)
        counts_turns = ROW_KINDS[kind].period > 0.0 and spec.derivative == 0
    term = Term(ROW_MEASURES[spec.derivative], kind, i, j, a, b)
    if counts_turns:
        channels.add_angle(JOINT_ANGLE, term, kind=_counter(lowering, spec))
    else:
        channels.add_sum([term])


def _counter(lowering: Lowering, spec: JointSensorSpec | DistanceSensorSpec) -> int:
    """Number of a scalar coordinate that counts the turns of the sensor's joint; −1: none does."""
    joint, second, model = getattr(spec, "joint", None), spec.type == "second_angle", lowering.model
    names = [f"joints.{joint}", *(f"couplers.{name}.{joint}" for name in model.couplers)]
    if second:
        names = []
    names += [
        f"forces.{name}"
        for name, force in model.forces.items()
        if joint is not None
        and getattr(force, "joint", None) == joint
        and (getattr(force, "about", "axis") == "second_axis") == second
    ]
    numbers = {scalar.name: k for k, scalar in enumerate(lowering.scalars) if scalar.angular}
    return next((numbers[name] for name in names if name in numbers), -1)


JOINT_COORDINATES = SensorKind(
    ("angle", "second_angle", "stroke", "distance"),
    add_joint_coordinate,
    measures=ROW_MEASURES,
    channels=(JOINT_ANGLE,),
)
