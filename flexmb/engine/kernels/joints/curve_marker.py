"""Curve markers: a marker that slides along a curve which is fixed to a body.

Its place is the curve's at the scalar coordinate s, x + R c(s) with x, R of the marker that carries
the curve; on a plane curve its axes turn with the tangent t, the normal n and z of the plane. The
curve is piecewise quintic with |c'| = 1, so s is the length along it. Beyond the ends of an open
curve it goes on with the curvature of its end, for Newton's method to come back from.

With J = (R c', φ' z) the twist per ṡ, φ the angle of the tangent, the marker has J ṡ beside the
motion of the material point under it; s has the equation −W·J = 0, W the wrench on the marker
(Haug, Computer Aided Kinematics and Dynamics, 1989, §3.5; Hong & Liu 2011, §1.3).
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.rotation import cross, transform, transform_back
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.joints import curve_marker_tangent
from flexmb.engine.kernels.joints.curve_marker_tangent import CurveMarkers
from flexmb.engine.kernels.joints.row import put_row_gradient
from flexmb.engine.kind import Kind
from flexmb.engine.method import CURVE_END, FINE
from flexmb.engine.state import Point, Run

# An open curve may be overrun by round-off, this share of its length.
_ROUND_OFF = 1e-9


@kernel
def _piece(pool, curve, s):
    """Number of the piece that holds s, and s from its beginning; s runs on past open ends."""
    at, n = curve["at"], curve["n"]
    length = pool[at + n]
    if curve["closed"] == 1:
        s -= length * np.floor(s / length)
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if pool[at + middle] <= s:
            low = middle
        else:
            high = middle
    return low, s - pool[at + low], pool[at + low + 1] - pool[at + low]


@kernel
def _component(pool, o, t):
    """Value and three derivatives of Σ pool[o + k] t^k, k to 5."""
    a, b, c, d, e, f = pool[o], pool[o + 1], pool[o + 2], pool[o + 3], pool[o + 4], pool[o + 5]
    return (
        a + t * (b + t * (c + t * (d + t * (e + t * f)))),
        b + t * (2.0 * c + t * (3.0 * d + t * (4.0 * e + t * 5.0 * f))),
        2.0 * c + t * (6.0 * d + t * (12.0 * e + t * 20.0 * f)),
        6.0 * d + t * (24.0 * e + t * 60.0 * f),
    )


@kernel
def _coordinate_of_curve(pool, curve, s, axis):
    """c(s) and three derivatives along one axis of the marker that carries the curve."""
    k, t, width = _piece(pool, curve, s)
    o = curve["at"] + curve["n"] + 1 + 18 * k + 6 * axis
    inside = min(max(t, 0.0), width)
    c, c1, c2, c3 = _component(pool, o, inside)
    d = t - inside
    if d == 0.0:
        return c, c1, c2, c3
    return c + d * (c1 + 0.5 * d * c2), c1 + d * c2, c2, 0.0


@unit
def place(run: Run, of: CurveMarkers, at: Point) -> int:
    """Position and axes of all curve markers, from those of the markers that carry the curves."""
    parts, now = run.system.parts, run.work.now
    markers = parts.curve_markers
    for k in range(markers.shape[0]):
        curve, cn = markers[k], now.curve_marker[k]
        mk, mn = parts.markers[curve["marker"]], now.marker[curve["marker"]]
        s = at.q[parts.coordinates[curve["coordinate"]]["iq"]]
        cx, px, qx, rx = _coordinate_of_curve(parts.pool, curve, s, 0)
        cy, py, qy, ry = _coordinate_of_curve(parts.pool, curve, s, 1)
        cz, pz, qz, _ = _coordinate_of_curve(parts.pool, curve, s, 2)
        R = mn["R"]
        x, y, z = transform(R, cx, cy, cz)
        _move(mk, mn, now, x, y, z)
        x, y, z = transform(R, px, py, pz)
        put(cn["J"], 0, x, y, z)
        x, y, z = transform(R, qx, qy, qz)
        put(cn["D"], 0, x, y, z)
        put(cn["J"], 3, 0.0, 0.0, 0.0)
        put(cn["D"], 3, 0.0, 0.0, 0.0)
        if curve["turns"] == 1:
            _turn(R, cn, px, py, qx, qy, rx, ry)
    return FINE


@kernel
def _move(mk, mn, now, x, y, z):
    """Shift a marker by (x, y, z), global; the shift turns with it like an arm."""
    a = mn["x"]
    put(a, 0, a[0] + x, a[1] + y, a[2] + z)
    if mk["body"] >= 0:
        x, y, z = transform_back(now.body[mk["body"]]["A"], x, y, z)
        s, arm = mn["s"], mn["arm"]
        put(s, 0, s[0] + x, s[1] + y, s[2] + z)
        if mk["modes"] >= 0:
            put(arm, 0, arm[0] + x, arm[1] + y, arm[2] + z)


@kernel
def _turn(R, cn, px, py, qx, qy, rx, ry):
    """Turn a marker about its z to the tangent (px, py); φ' and φ'' from two more derivatives."""
    p2 = px * px + py * py
    first = (px * qy - py * qx) / p2
    second = (px * ry - py * rx) / p2 - 2.0 * first * (px * qx + py * qy) / p2
    p = math.sqrt(p2)
    cos, sin = px / p, py / p
    for a in range(3):
        cn["J"][3 + a] = first * R[a, 2]
        cn["D"][3 + a] = second * R[a, 2]
        x, y = R[a, 0], R[a, 1]
        R[a, 0] = cos * x + sin * y
        R[a, 1] = cos * y - sin * x


@unit
def add_velocities(run: Run, of: CurveMarkers, at: Point) -> int:
    """The share of ṡ in the velocities of all curve markers."""
    parts, now, markers = run.system.parts, run.work.now, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        mn, J = now.marker[markers[k]["marker"]], now.curve_marker[k]["J"]
        rate = at.v[parts.coordinates[markers[k]["coordinate"]]["iv"]]
        for a in range(3):
            mn["vx"][a] += J[a] * rate
            mn["om"][a] += J[3 + a] * rate
    return FINE


@unit
def add_bias(run: Run, of: CurveMarkers, at: Point) -> int:
    """The share of ṡ in the accelerations of all curve markers at zero v̇ and s̈."""
    parts, now, markers = run.system.parts, run.work.now, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        mn, J, D = (
            now.marker[markers[k]["marker"]],
            now.curve_marker[k]["J"],
            now.curve_marker[k]["D"],
        )
        rate = at.v[parts.coordinates[markers[k]["coordinate"]]["iv"]]
        om = mn["om"]
        wx, wy, wz = om[0] - J[3] * rate, om[1] - J[4] * rate, om[2] - J[5] * rate
        ax, ay, az = cross(wx, wy, wz, J[0], J[1], J[2])
        bx, by, bz = cross(wx, wy, wz, J[3], J[4], J[5])
        b, e = mn["bx"], mn["bom"]
        put(b, 0, b[0] + 2.0 * rate * ax, b[1] + 2.0 * rate * ay, b[2] + 2.0 * rate * az)
        put(e, 0, e[0] + rate * bx, e[1] + rate * by, e[2] + rate * bz)
        for a in range(3):
            b[a] += D[a] * rate * rate
            e[a] += D[3 + a] * rate * rate
    return FINE


@unit
def subtract_forces(run: Run, of: CurveMarkers, at: Point) -> int:
    """res −= W·J of all curve markers, W the wrench on each."""
    parts, now, markers = run.system.parts, run.work.now, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        W, J = now.marker[markers[k]["marker"]]["W"], now.curve_marker[k]["J"]
        i = parts.coordinates[markers[k]["coordinate"]]["iv"]
        for c in range(6):
            run.work.trial.res[i] -= W[c] * J[c]
    return FINE


@unit
def put_rows(run: Run, of: CurveMarkers, at: Point) -> int:
    """∂C/∂s of the rows on curve markers; forces out of balance on s move nothing by themselves."""
    sys, work, markers = run.system, run.work, run.system.parts.curve_markers
    g, factor = work.row.g, work.factor
    for k in range(markers.shape[0]):
        curve, J = markers[k], work.now.curve_marker[k]["J"]
        group, link = sys.groups[curve["group"]], sys.kkt.links[curve["link"]]
        panel = sys.kkt.panels[sys.parts.coordinates[curve["coordinate"]]["panel"]]
        factor.diagonal[panel["col"]] = math.inf
        for r in range(group["n"]):
            put_row_gradient(run, sys.rows[group["row"] + r])
            s = 0.0
            for c in range(6):
                s += g[6 * curve["side"] + c] * J[c]
            place = link["at"] + r * (1 if link["flipped"] == 1 else link["stride"])
            factor.low[place] = s
            if factor.symmetric[0] == 0:
                factor.up[place] = s
    return FINE


@unit
def check_ends(run: Run, of: CurveMarkers, at: Point) -> int:
    """CURVE_END if a curve marker is beyond an end of its curve."""
    parts, markers = run.system.parts, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        length = parts.pool[markers[k]["at"] + markers[k]["n"]]
        s = at.q[parts.coordinates[markers[k]["coordinate"]]["iq"]]
        beyond = s < -_ROUND_OFF * length or s > (1.0 + _ROUND_OFF) * length
        if markers[k]["closed"] == 0 and beyond:
            return CURVE_END
    return FINE


CURVE_MARKERS = Kind(
    "curve_markers",
    CurveMarkers,
    {
        "position": place,
        "velocity": add_velocities,
        "bias": add_bias,
        "force": subtract_forces,
        "matrix": curve_marker_tangent.add_tangents,
        "jacobian": put_rows,
        "limits": check_ends,
    },
)
