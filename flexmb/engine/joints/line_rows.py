"""Rows about the lines of two markers, along a = z_I and b = z_J, with h = x_J − x_I.

    RADIAL    |h − (a·h) a|    distance of the point J from the line a through I
    MOMENT    h·(a × b)        mutual moment: distance of the lines times the sine of their angle

What a row is, and the meaning of its units: `engine.kind.RowKind`. Source of the mutual moment:
Selig, Geometric Fundamentals of Robotics, ch. 6.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.row import (
    add_dot2,
    clear_gradient,
    column_rates,
    put_pair,
    relative_velocity,
    separation,
)
from flexmb.engine.kind import RowKind
from flexmb.engine.method import FINE
from flexmb.engine.state import RowWork

_Z = 2


@kernel
def _across(R, hx, hy, hz):
    """The part of h normal to a, and the part along it."""
    s = R[0, _Z] * hx + R[1, _Z] * hy + R[2, _Z] * hz
    return hx - s * R[0, _Z], hy - s * R[1, _Z], hz - s * R[2, _Z], s


@unit
def radial_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Distance of J from the line through I."""
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    px, py, pz, _ = _across(at.marker[i]["R"], hx, hy, hz)
    return math.sqrt(px * px + py * py + pz * pz)


@kernel
def _put_radial_gradient(mi, mj, g):
    """Put the gradient of the distance into g (12)."""
    R = mi["R"]
    hx, hy, hz = separation(mi, mj)
    px, py, pz, s = _across(R, hx, hy, hz)
    n = 1.0 / np.sqrt(px * px + py * py + pz * pz)
    clear_gradient(g)
    put_pair(g, 0, n * px, n * py, n * pz)
    x, y, z = cross(R[0, _Z], R[1, _Z], R[2, _Z], px, py, pz)
    put(g, 3, -s * n * x, -s * n * y, -s * n * z)


@unit
def radial_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of the distance; not finite where it is zero."""
    _put_radial_gradient(at.marker[i], at.marker[j], at.g)
    return FINE


@unit
def radial_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of the distance."""
    mi, mj = at.marker[i], at.marker[j]
    R = mi["R"]
    hx, hy, hz = separation(mi, mj)
    ux, uy, uz = relative_velocity(mi, mj)
    px, py, pz, qx, qy, qz = column_rates(R, _Z, mi["om"])
    nx, ny, nz, s = _across(R, hx, hy, hz)
    d = math.sqrt(nx * nx + ny * ny + nz * nz)
    s1 = px * hx + py * hy + pz * hz + R[0, _Z] * ux + R[1, _Z] * uy + R[2, _Z] * uz
    s2 = qx * hx + qy * hy + qz * hz + 2.0 * (px * ux + py * uy + pz * uz)
    d1 = (hx * ux + hy * uy + hz * uz - s * s1) / d
    return (ux * ux + uy * uy + uz * uz - s1 * s1 - s * s2 - d1 * d1) / d  # type: ignore[no-any-return]


@unit
def radial_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of d, from that of d²/2 = h·h/2 − s²/2 with s = a·h."""
    mi, mj, g, H = at.marker[i], at.marker[j], at.g, at.H
    R = mi["R"]
    hx, hy, hz = separation(mi, mj)
    px, py, pz, s = _across(R, hx, hy, hz)
    f /= math.sqrt(px * px + py * py + pz * pz)
    clear_gradient(g)
    put_pair(g, 0, R[0, _Z], R[1, _Z], R[2, _Z])
    x, y, z = cross(R[0, _Z], R[1, _Z], R[2, _Z], hx, hy, hz)
    put(g, 3, x, y, z)
    _subtract_square(g, f, H)
    add_dot2(R[0, _Z], R[1, _Z], R[2, _Z], hx, hy, hz, -f * s, H)
    for k in range(3):
        H[k, k] += f
        H[6 + k, 6 + k] += f
        H[k, 6 + k] -= f
        H[6 + k, k] -= f
    _put_radial_gradient(mi, mj, g)
    _subtract_square(g, f, H)
    return FINE


@kernel
def _subtract_square(g, f, H):
    """H −= f g gᵀ."""
    for k in range(12):
        for m in range(12):
            H[k, m] -= f * g[k] * g[m]


RADIAL = RowKind(
    "distance from the axis",
    radial_value,
    radial_gradient,
    radial_curvature,
    radial_tangent,
    is_distance=True,
)


@unit
def moment_value(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """h·(a × b)."""
    Ri, Rj = at.marker[i]["R"], at.marker[j]["R"]
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    cx, cy, cz = cross(Ri[0, _Z], Ri[1, _Z], Ri[2, _Z], Rj[0, _Z], Rj[1, _Z], Rj[2, _Z])
    return hx * cx + hy * cy + hz * cz  # type: ignore[no-any-return]


@unit
def moment_gradient(at: RowWork, a: int, b: int, i: int, j: int) -> int:
    """Gradient of h·(a × b)."""
    g, Ri, Rj = at.g, at.marker[i]["R"], at.marker[j]["R"]
    clear_gradient(g)
    ax, ay, az = Ri[0, _Z], Ri[1, _Z], Ri[2, _Z]
    bx, by, bz = Rj[0, _Z], Rj[1, _Z], Rj[2, _Z]
    hx, hy, hz = separation(at.marker[i], at.marker[j])
    x, y, z = cross(ax, ay, az, bx, by, bz)
    put_pair(g, 0, x, y, z)
    x, y, z = cross(bx, by, bz, hx, hy, hz)
    x, y, z = cross(ax, ay, az, x, y, z)
    put(g, 3, x, y, z)
    x, y, z = cross(hx, hy, hz, ax, ay, az)
    x, y, z = cross(bx, by, bz, x, y, z)
    put(g, 9, x, y, z)
    return FINE


@unit
def moment_curvature(at: RowWork, a: int, b: int, i: int, j: int) -> float:
    """Second derivative of h·(a × b)."""
    mi, mj = at.marker[i], at.marker[j]
    Ri, Rj = mi["R"], mj["R"]
    hx, hy, hz = separation(mi, mj)
    ux, uy, uz = relative_velocity(mi, mj)
    px, py, pz, qx, qy, qz = column_rates(Ri, _Z, mi["om"])
    rx, ry, rz, tx, ty, tz = column_rates(Rj, _Z, mj["om"])
    ax, ay, az = Ri[0, _Z], Ri[1, _Z], Ri[2, _Z]
    bx, by, bz = Rj[0, _Z], Rj[1, _Z], Rj[2, _Z]
    cx, cy, cz = cross(px, py, pz, bx, by, bz)
    dx, dy, dz = cross(ax, ay, az, rx, ry, rz)
    c2 = 2.0 * (ux * (cx + dx) + uy * (cy + dy) + uz * (cz + dz))
    ex, ey, ez = cross(qx, qy, qz, bx, by, bz)
    fx, fy, fz = cross(px, py, pz, rx, ry, rz)
    kx, ky, kz = cross(ax, ay, az, tx, ty, tz)
    c2 += hx * (ex + 2.0 * fx + kx) + hy * (ey + 2.0 * fy + ky)
    return c2 + hz * (ez + 2.0 * fz + kz)  # type: ignore[no-any-return]


@kernel
def _x(a, b):
    """Cross product of two tuples."""
    return cross(a[0], a[1], a[2], b[0], b[1], b[2])


@unit
def moment_tangent(at: RowWork, a: int, b: int, i: int, j: int, f: float) -> int:
    """f times the tangent of h·(a × b), column by column."""
    Ri, Rj, H = at.marker[i]["R"], at.marker[j]["R"], at.H
    h = separation(at.marker[i], at.marker[j])
    u, v = (Ri[0, _Z], Ri[1, _Z], Ri[2, _Z]), (Rj[0, _Z], Rj[1, _Z], Rj[2, _Z])
    vh, hu = _x(v, h), _x(h, u)
    for k in range(3):
        e = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
        ue, ve = _x(u, e), _x(v, e)
        vue, uve = _x(v, ue), _x(u, ve)
        vhue, uhve = _x(v, _x(h, ue)), _x(u, _x(h, ve))
        first, second = _x(vh, ue), _x(hu, ve)
        for r in range(3):
            H[6 + r, 3 + k] += f * vue[r]
            H[r, 3 + k] -= f * vue[r]
            H[6 + r, 9 + k] -= f * uve[r]
            H[r, 9 + k] += f * uve[r]
            H[3 + r, 6 + k] += f * uve[r]
            H[3 + r, k] -= f * uve[r]
            H[3 + r, 3 + k] += f * first[r]
            H[3 + r, 9 + k] += f * uhve[r]
            H[9 + r, 6 + k] -= f * vue[r]
            H[9 + r, k] += f * vue[r]
            H[9 + r, 3 + k] -= f * vhue[r]
            H[9 + r, 9 + k] += f * second[r]
    return FINE


MOMENT = RowKind(
    "distance of the axes", moment_value, moment_gradient, moment_curvature, moment_tangent
)
