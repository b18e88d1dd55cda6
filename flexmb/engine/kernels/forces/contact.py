"""Contact of a sphere (or a point, of radius 0) with a ball, a plane, a cylinder or a bore.

With u = x_I − x_J, a = z_J, p = u − (a·u) a, ρ the distance, n the normal that leads from J to I:

    BALL       n = u/ρ,  d = r_I + r_J − ρ,   ρ = |u|
    PLANE      n = a,    d = r_I − n·u
    CYLINDER   n = p/ρ,  d = r_I + r_J − ρ,   ρ = |p|
    BORE       n = −p/ρ, d = r_I − r_J + ρ

Both bodies meet at one point c = x_I − r_I n, where the force on I is N n and friction, and its
opposite acts on J. N = K dⁿ (1 + χ ḋ/ḋ₀) and never pulls (Hunt & Crossley, J. Appl. Mech. 42 (1975)
440), ḋ₀ the speed of approach at the end of the step that ends just at the onset, or of the last
one before, which is kept. A cylinder touches over its length only, its ends do not.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.triple import (
    column,
    inner,
    outer,
    plus,
    times,
    triple,
    turned,
    turned_back,
)
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.forces.friction import across, tangential
from flexmb.engine.tables import BALL, BORE, NO_FRICTION, OPEN, PLANE, SLIDES

_NOWHERE = (0.0, 0.0, 0.0)
# A step that ends within this share of itself after an onset tells the speed of the impact.
_JUST = 0.05


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
        return -c["rj"], _NOWHERE, 0.0
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
def normal_force(c, kept, d, rate):
    """N and its slopes over d and ḋ; d > 0."""
    speed = max(kept[c["kept"]], c["slow"])
    elastic, factor = c["K"] * d ** c["n"], 1.0 + c["damping"] * rate / speed
    if factor <= 0.0:
        return 0.0, 0.0, 0.0
    return elastic * factor, c["n"] * elastic / d * factor, elastic * c["damping"] / speed


@kernel
def bristle(c, kept, mj):
    """The bristle of the last accepted step, global axes."""
    o = c["kept"] + 2
    return turned(mj["R"], (kept[o], kept[o + 1], kept[o + 2]))


@kernel
def friction_force(c, now, n, N, g, mj):
    """Force of friction on I, bristle, stick or slide, and |T| − μ N."""
    if c["model"] == NO_FRICTION:
        return _NOWHERE, _NOWHERE, OPEN, 0.0
    return tangential(c, n, N, g, bristle(c, now.kept, mj), now.span[0])


@kernel
def force(c, now, n, d, g, mj):
    """Force on I, global axes."""
    N, _, _ = normal_force(c, now.kept, d, -inner(n, g))
    f, _, _, _ = friction_force(c, now, n, N, g, mj)
    return plus(f, N, n)


@kernel
def put_wrench(c, n, mi, mj, f, w):
    """w (12) = the wrench pair of the force f on I, the opposite on J, where they meet."""
    s = times(-c["ri"], n)
    x, y, z = outer(s, f)
    put(w, 0, f[0], f[1], f[2])
    put(w, 3, x, y, z)
    x, y, z = outer(plus(separation(mi, mj), 1.0, s), f)
    put(w, 6, -f[0], -f[1], -f[2])
    put(w, 9, -x, -y, -z)


@kernel
def add_wrenches(contacts, now, w):
    """Add the wrenches of all contacts to their markers; w (12) is scratch."""
    if contacts is not None:
        for k in range(contacts.shape[0]):
            c = contacts[k]
            mi, mj = now.marker[c["I"]], now.marker[c["J"]]
            d, n, _ = penetration(c, mi, mj)
            if d > 0.0:
                g = relative_velocity(c, n, mi, mj)
                put_wrench(c, n, mi, mj, force(c, now, n, d, g, mj), w)
                for r in range(6):
                    mi["W"][r] += w[r]
                    mj["W"][r] += w[6 + r]


@kernel
def wrenches(contacts, now, first, n, g, w):
    """Add the wrenches of n contacts to w (12): on the marker I of the first, and on J.

    Returns the two markers; g (12) is scratch.
    """
    if contacts is not None:
        i, j = contacts[first]["I"], contacts[first]["J"]
        for k in range(first, first + n):
            c = contacts[k]
            mi, mj = now.marker[c["I"]], now.marker[c["J"]]
            d, normal, _ = penetration(c, mi, mj)
            if d > 0.0:
                f = force(c, now, normal, d, relative_velocity(c, normal, mi, mj), mj)
                put_wrench(c, normal, mi, mj, f, g)
                for r in range(12):
                    w[r] += g[r]
                x, y, z = outer(separation(now.marker[i], mi), f)
                w[3] += x
                w[4] += y
                w[5] += z
        return i, j
    return 0, 0


@kernel
def energy(contacts, markers):
    """Elastic energy Σ K dⁿ⁺¹/(n + 1), J."""
    e = 0.0
    if contacts is not None:
        for k in range(contacts.shape[0]):
            c = contacts[k]
            d, _, _ = penetration(c, markers[c["I"]], markers[c["J"]])
            if d > 0.0:
                e += c["K"] * d ** (c["n"] + 1.0) / (c["n"] + 1.0)
    return e


@kernel
def power(contacts, now):
    """Power of damping and friction, that into bristles included, W."""
    p = 0.0
    if contacts is not None:
        for k in range(contacts.shape[0]):
            c = contacts[k]
            mi, mj = now.marker[c["I"]], now.marker[c["J"]]
            d, n, _ = penetration(c, mi, mj)
            if d > 0.0:
                g = relative_velocity(c, n, mi, mj)
                rate = -inner(n, g)
                N, _, _ = normal_force(c, now.kept, d, rate)
                f, _, _, _ = friction_force(c, now, n, N, g, mj)
                p += inner(f, g) - (N - c["K"] * d ** c["n"]) * rate
    return p


@kernel
def bristle_energy(contacts, now):
    """Energy in the bristles, ½ k s², J."""
    e = 0.0
    if contacts is not None:
        for k in range(contacts.shape[0]):
            c = contacts[k]
            mi, mj = now.marker[c["I"]], now.marker[c["J"]]
            d, n, _ = penetration(c, mi, mj)
            if d > 0.0 and c["model"] != NO_FRICTION:
                g = relative_velocity(c, n, mi, mj)
                N, _, _ = normal_force(c, now.kept, d, -inner(n, g))
                _, s, _, _ = friction_force(c, now, n, N, g, mj)
                e += 0.5 * c["k"] * inner(s, s)
    return e


@kernel
def keep(contacts, now, kept):
    """Write the memory of all contacts at an accepted state; it is that of the step in `now`."""
    if contacts is not None:
        for k in range(contacts.shape[0]):
            c = contacts[k]
            o = c["kept"]
            mi, mj = now.marker[c["I"]], now.marker[c["J"]]
            d, n, _ = penetration(c, mi, mj)
            g = relative_velocity(c, n, mi, mj)
            rate = -inner(n, g)
            if d <= 0.0 or d <= _JUST * rate * now.span[0]:
                kept[o] = max(rate, c["slow"])
            if c["model"] == NO_FRICTION:
                continue
            s, mode = _NOWHERE, OPEN
            if d > 0.0:
                N, _, _ = normal_force(c, now.kept, d, rate)
                _, s, mode, _ = friction_force(c, now, n, N, g, mj)
            x, y, z = turned_back(mj["R"], s)
            kept[o + 1] = mode
            put(kept, o + 2, x, y, z)


@kernel
def slip(c, kept, n, g, mj, excess):
    """What crosses zero from below where it begins to slide, or to stick.

    |T| − μ N while it sticks, the speed against its bristle while it slides.
    """
    if kept[c["kept"] + 1] != SLIDES:
        return excess
    s = bristle(c, kept, mj)
    return -inner(s, across(n, g)) / math.sqrt(inner(s, s))
