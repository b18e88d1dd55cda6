"""The textbook's constraint primitives between two marker frames.

With x, R of the markers, a = column of R_I, b = column of R_J, h = x_J − x_I, every row is

    POINT     h·e_a                       coincidence along a global axis
    DOT1      a·b                         two axes stay perpendicular
    DOT2      a·h − f(t)                  no motion along a; a stroke if f is given
    DISTANCE  |h| − f(t)                  the multiplier is the force in the massless link
    ANGLE     angle of x_J about z_I from x_I, minus f(t), within ±π

f(t) where the row has a function of time. The gradient g (12) holds the partial derivatives for the
virtual motion (δx_I, δφ_I, δx_J, δφ_J) in global axes, so λ g is the pair of wrenches of the row
(Haug, Computer Aided Kinematics and Dynamics, 1989, ch. 9; Hong & Liu 2011, §2.3).
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.rotation import cross
from flexmb.engine.kernels.vector import put
from flexmb.engine.tables import ANGLE, DISTANCE, DOT1, DOT2, POINT


@kernel
def dot_columns(R, a, S, b):
    """Column a of R times column b of S."""
    return R[0, a] * S[0, b] + R[1, a] * S[1, b] + R[2, a] * S[2, b]


@kernel
def separation(mi, mj):
    """h = x_J − x_I."""
    a, b = mi["x"], mj["x"]
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


@kernel
def wrapped(angle):
    """Angle within ±π."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def joint_angle(Ri, Rj):
    """Angle of x_J about z_I from x_I, within ±π."""
    return math.atan2(dot_columns(Ri, 1, Rj, 0), dot_columns(Ri, 0, Rj, 0))


@kernel
def value(kind, a, b, mi, mj, f):
    """Value of one row between two markers; f is its function of time."""
    if kind == POINT:
        return mj["x"][a] - mi["x"][a]
    Ri, Rj = mi["R"], mj["R"]
    if kind == DOT1:
        return dot_columns(Ri, a, Rj, b)
    if kind == ANGLE:
        return wrapped(joint_angle(Ri, Rj) - f)
    hx, hy, hz = separation(mi, mj)
    if kind == DOT2:
        return Ri[0, a] * hx + Ri[1, a] * hy + Ri[2, a] * hz - f
    return math.sqrt(hx * hx + hy * hy + hz * hz) - f


@kernel
def _put_pair(g, o, x, y, z):
    """(x, y, z) for marker J at o + 6, the opposite for marker I at o."""
    put(g, o, -x, -y, -z)
    put(g, o + 6, x, y, z)


@kernel
def gradient(kind, a, b, mi, mj, g):
    """Gradient g (12) of one row."""
    for k in range(12):
        g[k] = 0.0
    Ri, Rj = mi["R"], mj["R"]
    if kind == POINT:
        g[a] = -1.0
        g[6 + a] = 1.0
    elif kind == DOT1:
        x, y, z = cross(Ri[0, a], Ri[1, a], Ri[2, a], Rj[0, b], Rj[1, b], Rj[2, b])
        _put_pair(g, 3, -x, -y, -z)
    elif kind == DOT2:
        hx, hy, hz = separation(mi, mj)
        _put_pair(g, 0, Ri[0, a], Ri[1, a], Ri[2, a])
        x, y, z = cross(Ri[0, a], Ri[1, a], Ri[2, a], hx, hy, hz)
        put(g, 3, x, y, z)
    elif kind == DISTANCE:
        hx, hy, hz = separation(mi, mj)
        n = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
        _put_pair(g, 0, hx * n, hy * n, hz * n)
    else:
        s = dot_columns(Ri, 1, Rj, 0)
        c = dot_columns(Ri, 0, Rj, 0)
        n = 1.0 / (s * s + c * c)
        ux = (c * Ri[0, 1] - s * Ri[0, 0]) * n
        uy = (c * Ri[1, 1] - s * Ri[1, 0]) * n
        uz = (c * Ri[2, 1] - s * Ri[2, 0]) * n
        x, y, z = cross(Rj[0, 0], Rj[1, 0], Rj[2, 0], ux, uy, uz)
        _put_pair(g, 3, x, y, z)


@kernel
def rate(g, mi, mj):
    """g times the velocities of the two markers."""
    r = 0.0
    for k in range(3):
        r += g[k] * mi["vx"][k] + g[3 + k] * mi["om"][k]
        r += g[6 + k] * mj["vx"][k] + g[9 + k] * mj["om"][k]
    return r


@kernel
def _column_rates(R, a, om):
    """Column a of R: its first derivative and its second at zero angular acceleration."""
    x, y, z = cross(om[0], om[1], om[2], R[0, a], R[1, a], R[2, a])
    u, v, w = cross(om[0], om[1], om[2], x, y, z)
    return x, y, z, u, v, w


@kernel
def _dot_rates(Ri, a, omi, Rj, b, omj):
    """a·b: first derivative, and second at zero angular accelerations."""
    px, py, pz, qx, qy, qz = _column_rates(Ri, a, omi)
    rx, ry, rz, sx, sy, sz = _column_rates(Rj, b, omj)
    bx, by, bz = Rj[0, b], Rj[1, b], Rj[2, b]
    ax, ay, az = Ri[0, a], Ri[1, a], Ri[2, a]
    first = px * bx + py * by + pz * bz + ax * rx + ay * ry + az * rz
    second = qx * bx + qy * by + qz * bz + ax * sx + ay * sy + az * sz
    return first, second + 2.0 * (px * rx + py * ry + pz * rz)


@kernel
def curvature(kind, a, b, mi, mj):
    """Second time derivative of a row (without f) at zero accelerations of both markers."""
    if kind == POINT:
        return 0.0
    Ri, Rj, omi, omj = mi["R"], mj["R"], mi["om"], mj["om"]
    if kind == DOT1:
        _, second = _dot_rates(Ri, a, omi, Rj, b, omj)
        return second
    if kind == ANGLE:
        s = dot_columns(Ri, 1, Rj, 0)
        c = dot_columns(Ri, 0, Rj, 0)
        s1, s2 = _dot_rates(Ri, 1, omi, Rj, 0, omj)
        c1, c2 = _dot_rates(Ri, 0, omi, Rj, 0, omj)
        n = 1.0 / (s * s + c * c)
        return (c * s2 - s * c2) * n - 2.0 * (c * c1 + s * s1) * (c * s1 - s * c1) * n * n
    hx, hy, hz = separation(mi, mj)
    ux = mj["vx"][0] - mi["vx"][0]
    uy = mj["vx"][1] - mi["vx"][1]
    uz = mj["vx"][2] - mi["vx"][2]
    if kind == DOT2:
        px, py, pz, qx, qy, qz = _column_rates(Ri, a, omi)
        return qx * hx + qy * hy + qz * hz + 2.0 * (px * ux + py * uy + pz * uz)
    d = math.sqrt(hx * hx + hy * hy + hz * hz)
    dd = (hx * ux + hy * uy + hz * uz) / d
    return (ux * ux + uy * uy + uz * uz - dd * dd) / d
