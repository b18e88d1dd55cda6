"""Orientation: three angles, in any sequence, from the axes of one marker to those of another.

R = R_Iᵀ R_J = R_i(α) R_j(β) R_k(γ), each turn about the axes that the turns before have left. With
s = ±1 for the parity of (i, j, third axis): three different axes (Cardan, Bryan) have
sin β = s R_ik, singular at ±90°; two (Euler, k = i) have cos β = R_ii, singular at 0 and 180°. Of
the two triples of angles, (α, β, γ) and (α + π, π − β or −β, γ + π), the one nearer to the angles
before is taken, so that they go on without a jump, through a singular pose too if the motion leads
through it; at it γ stays and α takes the whole turn (Shuster, A Survey of Attitude Representations,
J. Astronaut. Sci. 41 (1993) 439, sec. 6).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.row import dot_columns, put_pair, wrapped
from flexmb.engine.kind import ChannelKind, Kind, Measure, SensorKind, Term
from flexmb.engine.method import FINE
from flexmb.engine.records import Integers
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import Sensors

if TYPE_CHECKING:
    from flexmb.engine.sensors.sensor import Channels
    from flexmb.model.sensor import OrientationSensorSpec

# Row of FeedbackWork.g with the three angles.
_ANGLES = 3
# Sine or cosine of β below which the pose counts as singular: α and γ have no digits there.
_SINGULAR = 1e-8


@kernel
def _sequence(code):
    """Axes i, j, k of a sequence 9 i + 3 j + k, the third axis beside i and j, and the parity."""
    i, j, k = code // 9, (code // 3) % 3, code % 3
    return i, j, k, 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0


@kernel
def _angles(code, Ri, Rj, before, b1, b2):
    """α, β, γ nearest to those before, NaN for none: then β within 0..180° or ±90°."""
    i, j, k, m, s = _sequence(code)
    y = dot_columns(Ri, i, Rj, j)
    if i == k:
        x = dot_columns(Ri, i, Rj, m)
        across = math.hypot(x, y)
        first = math.atan2(dot_columns(Ri, j, Rj, i), -s * dot_columns(Ri, m, Rj, i))
        second = math.atan2(across, dot_columns(Ri, i, Rj, i))
        third = math.atan2(y, s * x)
    else:
        x = dot_columns(Ri, i, Rj, i)
        across = math.hypot(x, y)
        first = math.atan2(-s * dot_columns(Ri, j, Rj, k), dot_columns(Ri, k, Rj, k))
        second = math.atan2(s * dot_columns(Ri, i, Rj, k), across)
        third = math.atan2(-s * y, x)
    if across < _SINGULAR:
        third = 0.0 if math.isnan(b2) else b2
        first = _whole_turn(i, j, k, m, s, third, Ri, Rj)
    if math.isnan(before):
        return first, second, third
    other = -second if i == k else math.pi - second
    p, q, r = first + math.pi, other, third + math.pi
    near = abs(wrapped(first - before)) + abs(wrapped(second - b1)) + abs(wrapped(third - b2))
    far = abs(wrapped(p - before)) + abs(wrapped(q - b1)) + abs(wrapped(r - b2))
    if far < near and across >= _SINGULAR:
        first, second, third = p, q, r
    return before + wrapped(first - before), b1 + wrapped(second - b1), b2 + wrapped(third - b2)


@kernel
def _whole_turn(i, j, k, m, s, third, Ri, Rj):
    """α with γ given: column j of R R_k(−γ) is that of R_i(α)."""
    c, d = math.cos(third), s * math.sin(third)
    p, f = (m, -d) if i == k else (i, d)
    up = c * dot_columns(Ri, m, Rj, j) + f * dot_columns(Ri, m, Rj, p)
    on = c * dot_columns(Ri, j, Rj, j) + f * dot_columns(Ri, j, Rj, p)
    return math.atan2(s * up, on)


@kernel
def _gradient(code, number, Ri, Rj, first):
    """d with (rate of angle `number`) = d·(ω_J − ω_I), global axes; α is `first`.

    ω = α̇ n₁ + β̇ n₂ + γ̇ n₃ with the three axes as they are; d is the dual of its axis.
    """
    i, j, k, m, s = _sequence(code)
    c, d = math.cos(first), s * math.sin(first)
    x = c * Ri[0, j] + d * Ri[0, m]
    y = c * Ri[1, j] + d * Ri[1, m]
    z = c * Ri[2, j] + d * Ri[2, m]
    px, py, pz = cross(x, y, z, Rj[0, k], Rj[1, k], Rj[2, k])
    volume = Ri[0, i] * px + Ri[1, i] * py + Ri[2, i] * pz
    if number == 1:
        px, py, pz = cross(Rj[0, k], Rj[1, k], Rj[2, k], Ri[0, i], Ri[1, i], Ri[2, i])
    elif number == 2:
        px, py, pz = cross(Ri[0, i], Ri[1, i], Ri[2, i], x, y, z)
    return px / volume, py / volume, pz / volume


class TurningAngles(NamedTuple):
    """Channels of the first of three turning angles; the other two follow it."""

    channels: Integers


@unit
def put_angles(run: Run, t: int, c: int) -> int:
    """The three angles of term t to FeedbackWork.g, nearest to those of the channels from c on."""
    term, markers, near = run.system.sensors.terms[t], run.work.now.marker, run.work.feedback.near
    Ri, Rj = markers[term["I"]]["R"], markers[term["J"]]["R"]
    x, y, z = _angles(term["a"], Ri, Rj, near[c], near[c + 1], near[c + 2])
    put(run.work.feedback.g[_ANGLES], 0, x, y, z)
    return FINE


@unit
def turning_angle(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Term t, one of the three angles, on the branch of its last value."""
    term = sensors.terms[t]
    put_angles(run, t, term["channel"] - term["b"])
    return run.work.feedback.g[_ANGLES, term["b"]]  # type: ignore[no-any-return]


@unit
def turning_angle_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Its gradient."""
    term, markers, g = sensors.terms[t], run.work.now.marker, run.work.feedback.g
    put_angles(run, t, term["channel"] - term["b"])
    Ri, Rj = markers[term["I"]]["R"], markers[term["J"]]["R"]
    x, y, z = _gradient(term["a"], term["b"], Ri, Rj, g[_ANGLES, 0])
    put_pair(g[0], 3, (x, y, z))
    return 0.0


@unit
def turning_channel(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Channel c, the one term that it has."""
    return turning_angle(run, sensors, at, sensors.channels[c]["first"])


@unit
def carry_turning_angles(run: Run, of: TurningAngles, at: Point) -> int:
    """Carry turning angles to the present position; a NaN before gives those next to zero."""
    near, g, listed = run.work.feedback.near, run.work.feedback.g, of.channels
    for n in range(listed.shape[0]):
        c = listed[n]
        put_angles(run, run.system.sensors.channels[c]["first"], c)
        near[c], near[c + 1], near[c + 2] = g[_ANGLES, 0], g[_ANGLES, 1], g[_ANGLES, 2]
    return FINE


TURNING_ANGLES = Kind("turning_angles", TurningAngles, {"angles": carry_turning_angles})
TURNING_ANGLE = Measure(turning_angle, turning_angle_gradient, 0)
TURNING_CHANNEL = ChannelKind(turning_channel, "terms", counts_turns=True)


def add_orientation(channels: Channels, spec: OrientationSensorSpec) -> None:
    """Three channels of the angles that turn the axes of one marker into those of another."""
    lowering = channels.lowering
    i, j = lowering.marker(spec.relative_to or "ground"), lowering.marker(spec.of)
    first, second, third = ("xyz".index(axis) for axis in spec.sequence)
    for number in range(3):
        term = Term(TURNING_ANGLE, -1, i, j, 9 * first + 3 * second + third, number)
        channels.add_angle(TURNING_CHANNEL, term, number)


ORIENTATIONS = SensorKind(
    ("orientation",), add_orientation, measures=(TURNING_ANGLE,), channels=(TURNING_CHANNEL,)
)
