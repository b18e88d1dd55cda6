"""The textbook's constraint primitives between two marker frames.

With x, R of the markers, a = column of R_I, b = column of R_J, h = x_J − x_I, every row is

    POINT     h·e_a                       coincidence along a global axis
    DOT1      a·b − f                     two axes keep their angle, 90 deg for f = 0
    DOT2      a·h − f                     no motion along a; a stroke if f varies
    DISTANCE  |h| − f                     the multiplier is the force in the massless link
    ANGLE     angle of b about z_I from x_I, minus f, within ±π
    TWIST     x_I·y_J − y_I·x_J           no twist about the bisector of z_I and z_J
    RADIAL    |h − (z_I·h) z_I| − f       distance from the line z_I
    MOMENT    h·(z_I × z_J) − f           mutual moment of the lines z_I and z_J

f is the row's constant and its function of time, if it has one. The gradient g (12) holds the
partial derivatives for the virtual motion (δx_I, δφ_I, δx_J, δφ_J) in global axes, so λ g is the
pair of wrenches of the row (Haug, Computer Aided Kinematics and Dynamics, 1989, ch. 9; Hong & Liu
2011, §2.3).
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.joints import line
from flexmb.engine.kernels.joints.dots import (
    column_rates,
    dot_columns,
    dot_rates,
    put_pair,
    separation,
)
from flexmb.engine.method import FINE
from flexmb.engine.state import Run
from flexmb.engine.tables import ANGLE, DISTANCE, DOT1, DOT2, POINT, TWIST


@kernel
def wrapped(angle):
    """Angle within ±π."""
    return angle - 2.0 * math.pi * np.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def joint_angle(Ri, Rj, b):
    """Angle of axis b of J about z_I from x_I, within ±π."""
    return math.atan2(dot_columns(Ri, 1, Rj, b), dot_columns(Ri, 0, Rj, b))


@kernel
def value(kind, a, b, mi, mj, f):
    """Value of one row between two markers; f is its constant and its function of time."""
    if kind == POINT:
        return mj["x"][a] - mi["x"][a]
    if kind >= TWIST:
        return line.value(kind, mi, mj) - f
    Ri, Rj = mi["R"], mj["R"]
    if kind == DOT1:
        return dot_columns(Ri, a, Rj, b) - f
    if kind == ANGLE:
        return wrapped(joint_angle(Ri, Rj, b) - f)
    hx, hy, hz = separation(mi, mj)
    if kind == DOT2:
        return Ri[0, a] * hx + Ri[1, a] * hy + Ri[2, a] * hz - f
    return math.sqrt(hx * hx + hy * hy + hz * hz) - f


@unit
def put_gradient(run: Run, kind: int, a: int, b: int, i: int, j: int) -> int:
    """Gradient of one row between markers i and j to dense.g[0]."""
    markers = run.work.now.marker
    gradient(kind, a, b, markers[i], markers[j], run.work.dense.g[0])
    return FINE


@kernel
def gradient(kind, a, b, mi, mj, g):
    """Gradient g (12) of one row."""
    if kind >= TWIST:
        for k in range(12):
            g[k] = 0.0
        line.gradient(kind, mi, mj, g)
    else:
        axis_gradient(kind, a, b, mi, mj, g)


@kernel
def axis_gradient(kind, a, b, mi, mj, g):
    """Gradient g (12) of one row between points and axes, not between lines."""
    for k in range(12):
        g[k] = 0.0
    Ri, Rj = mi["R"], mj["R"]
    if kind == POINT:
        g[a] = -1.0
        g[6 + a] = 1.0
    elif kind == DOT1:
        x, y, z = cross(Ri[0, a], Ri[1, a], Ri[2, a], Rj[0, b], Rj[1, b], Rj[2, b])
        put_pair(g, 3, -x, -y, -z)
    elif kind == DOT2:
        put_component_gradient(a, mi, mj, g)
    elif kind == DISTANCE:
        put_distance_gradient(mi, mj, g)
    else:
        s = dot_columns(Ri, 1, Rj, b)
        c = dot_columns(Ri, 0, Rj, b)
        n = 1.0 / (s * s + c * c)
        ux = (c * Ri[0, 1] - s * Ri[0, 0]) * n
        uy = (c * Ri[1, 1] - s * Ri[1, 0]) * n
        uz = (c * Ri[2, 1] - s * Ri[2, 0]) * n
        x, y, z = cross(Rj[0, b], Rj[1, b], Rj[2, b], ux, uy, uz)
        put_pair(g, 3, x, y, z)


@kernel
def put_component_gradient(a, mi, mj, g):
    """Put the gradient of a·h into g (12), zero elsewhere."""
    R = mi["R"]
    hx, hy, hz = separation(mi, mj)
    put_pair(g, 0, R[0, a], R[1, a], R[2, a])
    x, y, z = cross(R[0, a], R[1, a], R[2, a], hx, hy, hz)
    put(g, 3, x, y, z)


@kernel
def put_distance_gradient(mi, mj, g):
    """Put the gradient of |h| into g (12), zero elsewhere."""
    hx, hy, hz = separation(mi, mj)
    n = 1.0 / np.sqrt(hx * hx + hy * hy + hz * hz)
    put_pair(g, 0, hx * n, hy * n, hz * n)


@kernel
def rate(g, mi, mj):
    """g times the velocities of the two markers."""
    r = 0.0
    for k in range(3):
        r += g[k] * mi["vx"][k] + g[3 + k] * mi["om"][k]
        r += g[6 + k] * mj["vx"][k] + g[9 + k] * mj["om"][k]
    return r


@unit
def curvature_between(run: Run, kind: int, a: int, b: int, i: int, j: int) -> float:
    """Curvature of one row between markers i and j."""
    markers = run.work.now.marker
    return curvature(kind, a, b, markers[i], markers[j])


@kernel
def curvature(kind, a, b, mi, mj):
    """Second time derivative of a row (without f) at zero accelerations of both markers."""
    if kind == POINT:
        return 0.0
    if kind >= TWIST:
        return line.curvature(kind, mi, mj)
    Ri, Rj, omi, omj = mi["R"], mj["R"], mi["om"], mj["om"]
    if kind == DOT1:
        _, second = dot_rates(Ri, a, omi, Rj, b, omj)
        return second
    if kind == ANGLE:
        s = dot_columns(Ri, 1, Rj, b)
        c = dot_columns(Ri, 0, Rj, b)
        s1, s2 = dot_rates(Ri, 1, omi, Rj, b, omj)
        c1, c2 = dot_rates(Ri, 0, omi, Rj, b, omj)
        n = 1.0 / (s * s + c * c)
        return (c * s2 - s * c2) * n - 2.0 * (c * c1 + s * s1) * (c * s1 - s * c1) * n * n
    hx, hy, hz = separation(mi, mj)
    ux = mj["vx"][0] - mi["vx"][0]
    uy = mj["vx"][1] - mi["vx"][1]
    uz = mj["vx"][2] - mi["vx"][2]
    if kind == DOT2:
        px, py, pz, qx, qy, qz = column_rates(Ri, a, omi)
        return qx * hx + qy * hy + qz * hz + 2.0 * (px * ux + py * uy + pz * uz)
    d = math.sqrt(hx * hx + hy * hy + hz * hz)
    dd = (hx * ux + hy * uy + hz * uz) / d
    return (ux * ux + uy * uy + uz * uz - dd * dd) / d
