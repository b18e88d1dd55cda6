"""Markers of which only the place matters: their rows hold points together and nothing else.

Such rows carry no moment and need no axes, so the position stage leaves out the turning of axes and
the velocity stage the angular velocity; `axes` completes them where they are read, at outputs and
for Python. The forces on them are those of `joints.point_joint`.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import cross, transform
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.bodies.kinematics import Markers
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run


@kernel
def _prepare(table, marker_now, rows):
    """What never changes: places of markers in their bodies, of those on ground at all."""
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], marker_now[rows[n]]
        for a in range(3):
            mn["s"][a] = mk["rho"][a]
            if mk["body"] < 0:
                mn["x"][a] = mk["rho"][a]
                mn["vx"][a] = 0.0
                mn["bx"][a] = 0.0


@unit
def prepare_points(run: Run, markers: Markers, at: Point) -> int:
    """What never changes in a run."""
    _prepare(run.system.parts.markers, run.work.now.marker, markers.rows)
    return FINE


@unit
def place_points(run: Run, markers: Markers, at: Point) -> int:
    """Position of the markers."""
    parts, now, q = run.system.parts, run.work.now, at.q
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk = table[rows[n]]
        b = mk["body"]
        if b >= 0:
            A, s, x, iq = body_now[b]["A"], mk["rho"], marker_now[rows[n]]["x"], bodies[b]["iq"]
            for a in range(3):
                x[a] = q[iq + a] + A[a, 0] * s[0] + A[a, 1] * s[1] + A[a, 2] * s[2]
    return FINE


@unit
def move_points(run: Run, markers: Markers, at: Point) -> int:
    """Velocity of the markers, global axes."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    body_now, marker_now = now.body, now.marker
    for n in range(rows.shape[0]):
        mk = table[rows[n]]
        b = mk["body"]
        if b >= 0:
            s, iv = mk["rho"], bodies[b]["iv"]
            ux, uy, uz = cross(v[iv + 3], v[iv + 4], v[iv + 5], s[0], s[1], s[2])
            ux, uy, uz = transform(body_now[b]["A"], ux, uy, uz)
            put(marker_now[rows[n]]["vx"], 0, v[iv] + ux, v[iv + 1] + uy, v[iv + 2] + uz)
    return FINE


@unit
def bias_points(run: Run, markers: Markers, at: Point) -> int:
    """Acceleration of the markers at zero v̇, global axes."""
    parts, now, v = run.system.parts, run.work.now, at.v
    rows, bodies, table = markers.rows, parts.bodies, parts.markers
    for n in range(rows.shape[0]):
        mk, mn = table[rows[n]], now.marker[rows[n]]
        b = mk["body"]
        put(mn["bom"], 0, 0.0, 0.0, 0.0)
        if b >= 0:
            s, iv = mk["rho"], bodies[b]["iv"]
            wx, wy, wz = v[iv + 3], v[iv + 4], v[iv + 5]
            cx, cy, cz = cross(wx, wy, wz, s[0], s[1], s[2])
            ax, ay, az = cross(wx, wy, wz, cx, cy, cz)
            ax, ay, az = transform(now.body[b]["A"], ax, ay, az)
            put(mn["bx"], 0, ax, ay, az)
    return FINE


@unit
def complete_points(run: Run, markers: Markers, at: Point) -> int:
    """Axes and angular velocities of the markers too, as those of rigid markers."""
    kinematics.place_rigid(run, markers, at)
    return kinematics.move_rigid(run, markers, at)


POINT_MARKERS = Kind(
    "point_markers",
    Markers,
    {
        "constants": prepare_points,
        "position": place_points,
        "velocity": move_points,
        "bias": bias_points,
        "axes": complete_points,
    },
)
