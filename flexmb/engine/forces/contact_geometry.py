"""Geometry of contacts: depth, normal and common point of two surfaces, and how they change.

With u = x_I − x_J, a = z_J, p = u − (a·u) a, ρ the distance, n the normal that leads from J to I:

    BALL       n = u/ρ,  d = r_I + r_J − ρ,   ρ = |u|
    PLANE      n = a,    d = r_I − n·u
    CYLINDER   n = p/ρ,  d = r_I + r_J − ρ,   ρ = |p|
    BORE       n = −p/ρ, d = r_I − r_J + ρ

Both bodies meet at one point c = x_I − r_I n. A cylinder touches over its length only, its ends do
not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from flexmb.engine.algebra.vector import (
    column,
    inner,
    outer,
    plus,
    put_part,
    times,
    triple,
)
from flexmb.engine.jit import kernel

if TYPE_CHECKING:
    from flexmb.engine.lowering import Lowering
    from flexmb.model.forces.contact import ContactSpec
    from flexmb.model.markers import PlacedMarker

# Sides J of contacts.
BALL, PLANE, CYLINDER, BORE = 0, 1, 2, 3

_ZERO = (0.0, 0.0, 0.0)


@kernel
def separation(mi, mj):
    """u = x_I − x_J."""
    return plus(triple(mi["x"]), -1.0, triple(mj["x"]))


@kernel
def penetration(c, mi, mj):
    """Depth d, normal n, and the length ρ by which n turns (0: with J; negative: in a bore)."""
    u = separation(mi, mj)
    if c["kind"] == PLANE:
        n = column(mj["R"], 2)
        return c["ri"] - inner(n, u), n, 0.0
    room = math.inf
    if c["kind"] != BALL:
        a = column(mj["R"], 2)
        s = inner(a, u)
        room = c["half"] - abs(s)
        u = plus(u, -s, a)
    r = math.sqrt(inner(u, u))
    inside = c["kind"] == BORE
    d = c["ri"] - c["rj"] + r if inside else c["ri"] + c["rj"] - r
    if r == 0.0:
        return -c["rj"], _ZERO, 0.0
    r = -r if inside else r
    return min(d, room) if room < 0.0 else d, times(1.0 / r, u), r


@kernel
def relative_velocity(c, n, mi, mj):
    """Velocity of I relative to J where they meet."""
    s = times(-c["ri"], n)
    g = plus(triple(mi["vx"]), -1.0, triple(mj["vx"]))
    g = plus(g, 1.0, outer(triple(mi["om"]), s))
    return plus(g, -1.0, outer(triple(mj["om"]), plus(separation(mi, mj), 1.0, s)))


@kernel
def normal_change(c, n, rho, mi, mj, du, turn):
    """Changes of d and n with u by du and a rotation of J."""
    u = separation(mi, mj)
    if c["kind"] == PLANE:
        dn = outer(turn, n)
        return -inner(dn, u) - inner(n, du), dn
    if c["kind"] != BALL:  # p of u and the turning axis
        a = column(mj["R"], 2)
        da, s = outer(turn, a), inner(a, u)
        du = plus(du, -s, da)
        du = plus(du, -inner(da, u) - inner(a, du), a)
    across = -inner(n, du)
    return across, times(1.0 / rho, plus(du, across, n))


@kernel
def put_wrench(c, n, mi, mj, f, w):
    """w (12) = the wrench pair of the force f on I, the opposite on J, where they meet."""
    s = times(-c["ri"], n)
    put_part(w, 0, f)
    put_part(w, 3, outer(s, f))
    put_part(w, 6, times(-1.0, f))
    put_part(w, 9, outer(f, plus(separation(mi, mj), 1.0, s)))


def place_sides(
    lowering: Lowering, spec: ContactSpec
) -> tuple[PlacedMarker, Iterator[PlacedMarker], tuple[int, float, float, float]]:
    """Marker of the side J, markers of the side I; kind, both radii, half length of a cylinder.

    z of J is its normal or axis; the side I is the centre of a sphere, or points.
    """
    k = spec.round_side
    side, surface, reference = spec.shapes[k], spec.shapes[1 - k], spec.between[1 - k]
    J = lowering.geometry.frames((reference, reference), getattr(surface, "axis", None))[0]
    if side.type == "sphere":
        points, ri = iter([lowering.geometry.marker(spec.between[k])]), side.radius
    else:
        points, ri = lowering.geometry.contact_points(spec.between[k], side), 0.0
    if surface.type == "sphere":
        return J, points, (BALL, ri, surface.radius, 0.0)
    if surface.type == "plane":
        return J, points, (PLANE, ri, 0.0, 0.0)
    half = math.inf if surface.length is None else 0.5 * surface.length
    return J, points, (BORE if surface.side == "inside" else CYLINDER, ri, surface.radius, half)
