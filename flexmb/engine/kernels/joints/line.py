"""Rows about lines: twist between two shafts, distance from a line, mutual moment of two lines.

With a = z_I, b = z_J and h = x_J − x_I the measures are

    TWIST     x_I·y_J − y_I·x_J      zero for shafts that turn with equal speed at any angle
    RADIAL    |h − (a·h) a|          distance of the point J from the line a through I
    MOMENT    h·(a × b)              distance of the lines times the sine of their angle

Gradient, curvature and tangent as in
`primitive` and `row_tangent`. Source of the homokinetic condition: Shabana, Dynamics of Multibody
Systems, ch. 3; of the mutual moment: Selig, Geometric Fundamentals of Robotics, ch. 6.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.joints.dots import (
    add_dot,
    add_dot2,
    column_rates,
    dot_columns,
    dot_rates,
    put_pair,
    separation,
)
from flexmb.engine.tables import MOMENT, RADIAL, TWIST

X, Y, Z = 0, 1, 2


@kernel
def value(kind, mi, mj):
    """Measure of one row."""
    Ri, Rj = mi["R"], mj["R"]
    if kind == TWIST:
        return dot_columns(Ri, X, Rj, Y) - dot_columns(Ri, Y, Rj, X)
    hx, hy, hz = separation(mi, mj)
    if kind == RADIAL:
        px, py, pz, _ = _across(Ri, hx, hy, hz)
        return math.sqrt(px * px + py * py + pz * pz)
    cx, cy, cz = cross(Ri[0, Z], Ri[1, Z], Ri[2, Z], Rj[0, Z], Rj[1, Z], Rj[2, Z])
    return hx * cx + hy * cy + hz * cz


@kernel
def _across(Ri, hx, hy, hz):
    """The part of h normal to a, and the part along it."""
    s = Ri[0, Z] * hx + Ri[1, Z] * hy + Ri[2, Z] * hz
    return hx - s * Ri[0, Z], hy - s * Ri[1, Z], hz - s * Ri[2, Z], s


@kernel
def gradient(kind, mi, mj, g):
    """Gradient g (12), zero before, of one row."""
    Ri, Rj = mi["R"], mj["R"]
    ax, ay, az = Ri[0, Z], Ri[1, Z], Ri[2, Z]
    bx, by, bz = Rj[0, Z], Rj[1, Z], Rj[2, Z]
    hx, hy, hz = separation(mi, mj)
    if kind == TWIST:
        x, y, z = cross(Ri[0, X], Ri[1, X], Ri[2, X], Rj[0, Y], Rj[1, Y], Rj[2, Y])
        u, v, w = cross(Ri[0, Y], Ri[1, Y], Ri[2, Y], Rj[0, X], Rj[1, X], Rj[2, X])
        put_pair(g, 3, u - x, v - y, w - z)
    elif kind == RADIAL:
        px, py, pz, s = _across(Ri, hx, hy, hz)
        n = 1.0 / np.sqrt(px * px + py * py + pz * pz)
        put_pair(g, 0, n * px, n * py, n * pz)
        x, y, z = cross(ax, ay, az, px, py, pz)
        put(g, 3, -s * n * x, -s * n * y, -s * n * z)
    elif kind == MOMENT:
        x, y, z = cross(ax, ay, az, bx, by, bz)
        put_pair(g, 0, x, y, z)
        x, y, z = cross(bx, by, bz, hx, hy, hz)
        x, y, z = cross(ax, ay, az, x, y, z)
        put(g, 3, x, y, z)
        x, y, z = cross(hx, hy, hz, ax, ay, az)
        x, y, z = cross(bx, by, bz, x, y, z)
        put(g, 9, x, y, z)


@kernel
def curvature(kind, mi, mj):
    """Second time derivative of a row at zero accelerations of both markers."""
    Ri, Rj, omi, omj = mi["R"], mj["R"], mi["om"], mj["om"]
    if kind == TWIST:
        return dot_rates(Ri, X, omi, Rj, Y, omj)[1] - dot_rates(Ri, Y, omi, Rj, X, omj)[1]
    hx, hy, hz = separation(mi, mj)
    ux = mj["vx"][0] - mi["vx"][0]
    uy = mj["vx"][1] - mi["vx"][1]
    uz = mj["vx"][2] - mi["vx"][2]
    px, py, pz, qx, qy, qz = column_rates(Ri, Z, omi)
    if kind == RADIAL:
        nx, ny, nz, s = _across(Ri, hx, hy, hz)
        d = math.sqrt(nx * nx + ny * ny + nz * nz)
        s1 = px * hx + py * hy + pz * hz + Ri[0, Z] * ux + Ri[1, Z] * uy + Ri[2, Z] * uz
        s2 = qx * hx + qy * hy + qz * hz + 2.0 * (px * ux + py * uy + pz * uz)
        d1 = (hx * ux + hy * uy + hz * uz - s * s1) / d
        return (ux * ux + uy * uy + uz * uz - s1 * s1 - s * s2 - d1 * d1) / d
    ax, ay, az = Ri[0, Z], Ri[1, Z], Ri[2, Z]
    bx, by, bz = Rj[0, Z], Rj[1, Z], Rj[2, Z]
    rx, ry, rz, tx, ty, tz = column_rates(Rj, Z, omj)
    cx, cy, cz = cross(px, py, pz, bx, by, bz)
    dx, dy, dz = cross(ax, ay, az, rx, ry, rz)
    c2 = 2.0 * (ux * (cx + dx) + uy * (cy + dy) + uz * (cz + dz))
    ex, ey, ez = cross(qx, qy, qz, bx, by, bz)
    fx, fy, fz = cross(px, py, pz, rx, ry, rz)
    kx, ky, kz = cross(ax, ay, az, tx, ty, tz)
    c2 += hx * (ex + 2.0 * fx + kx) + hy * (ey + 2.0 * fy + ky)
    return c2 + hz * (ez + 2.0 * fz + kz)


@kernel
def add_tangent(kind, mi, mj, lam, g, H):
    """Add the tangent of λ g of one row to H (12, 12); g (12) is scratch."""
    Ri, Rj = mi["R"], mj["R"]
    hx, hy, hz = separation(mi, mj)
    if kind == TWIST:
        add_dot(Ri, X, Rj, Y, lam, H)
        add_dot(Ri, Y, Rj, X, -lam, H)
    elif kind == RADIAL:
        _add_radial(mi, mj, lam, g, H)
    elif kind == MOMENT:
        a = (Ri[0, Z], Ri[1, Z], Ri[2, Z])
        b = (Rj[0, Z], Rj[1, Z], Rj[2, Z])
        _add_moment(a, b, (hx, hy, hz), lam, H)


@kernel
def _add_radial(mi, mj, f, g, H):
    """f times the tangent of d, from that of d²/2 = h·h/2 − s²/2 with s = a·h."""
    Ri = mi["R"]
    hx, hy, hz = separation(mi, mj)
    px, py, pz, s = _across(Ri, hx, hy, hz)
    d = math.sqrt(px * px + py * py + pz * pz)
    f /= d
    for k in range(12):
        g[k] = 0.0
    put_pair(g, 0, Ri[0, Z], Ri[1, Z], Ri[2, Z])
    x, y, z = cross(Ri[0, Z], Ri[1, Z], Ri[2, Z], hx, hy, hz)
    put(g, 3, x, y, z)
    for i in range(12):
        for j in range(12):
            H[i, j] -= f * g[i] * g[j]
    add_dot2(Ri[0, Z], Ri[1, Z], Ri[2, Z], hx, hy, hz, -f * s, H)
    for i in range(3):
        H[i, i] += f
        H[6 + i, 6 + i] += f
        H[i, 6 + i] -= f
        H[6 + i, i] -= f
    for k in range(12):
        g[k] = 0.0
    gradient(RADIAL, mi, mj, g)
    for i in range(12):
        for j in range(12):
            H[i, j] -= f * g[i] * g[j]


@kernel
def _x(a, b):
    """Cross product of two tuples."""
    return cross(a[0], a[1], a[2], b[0], b[1], b[2])


@kernel
def _add_moment(a, b, h, f, H):
    """f times the tangent of h·(a × b), column by column."""
    bh, ha = _x(b, h), _x(h, a)
    for k in range(3):
        e = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
        ae, be = _x(a, e), _x(b, e)
        bae, abe = _x(b, ae), _x(a, be)
        bhae, ahbe = _x(b, _x(h, ae)), _x(a, _x(h, be))
        first, second = _x(bh, ae), _x(ha, be)
        for i in range(3):
            H[6 + i, 3 + k] += f * bae[i]
            H[i, 3 + k] -= f * bae[i]
            H[6 + i, 9 + k] -= f * abe[i]
            H[i, 9 + k] += f * abe[i]
            H[3 + i, 6 + k] += f * abe[i]
            H[3 + i, k] -= f * abe[i]
            H[3 + i, 3 + k] += f * first[i]
            H[3 + i, 9 + k] += f * ahbe[i]
            H[9 + i, 6 + k] -= f * bae[i]
            H[9 + i, k] += f * bae[i]
            H[9 + i, 3 + k] -= f * bhae[i]
            H[9 + i, 9 + k] += f * second[i]
