"""Contact of a sphere (or a point, of radius 0) with a ball, a plane, a cylinder or a bore.

With u = x_I − x_J, a = z_J, p = u − (a·u) a, ρ the distance, n the normal that leads from J to I:

    BALL       n = u/ρ,  d = r_I + r_J − ρ,   ρ = |u|
    PLANE      n = a,    d = r_I − n·u
    CYLINDER   n = p/ρ,  d = r_I + r_J − ρ,   ρ = |p|
    BORE       n = −p/ρ, d = r_I − r_J + ρ

Both bodies meet at one point c = x_I − r_I n, where the force on I is N n and friction, and its
opposite acts on J. N = K dⁿ (1 + χ ḋ/ḋ₀) and never pulls (Hunt & Crossley, J. Appl. Mech. 42 (1975)
440), ḋ₀ the speed of approach at the end of the step that ends just at the onset, or of the last
one before, which the history keeps. A cylinder touches over its length only, its ends do not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import (
    column,
    inner,
    outer,
    part,
    plus,
    put_part,
    times,
    triple,
    turned,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.forces.friction import (
    FRICTION_FIELDS,
    NO_FRICTION,
    OPEN,
    tangential,
)
from flexmb.engine.records import Matrix, array_of
from flexmb.engine.state import Run

# Sides J of contacts.
BALL, PLANE, CYLINDER, BORE = 0, 1, 2, 3

_I, _F = "i8", "f8"
# One contact between a round side I (a sphere, or a point of radius 0) and a side J. Depth d > 0:
# normal force K d^n (1 + c d'/d0'), d0' the speed of approach at the onset, at least `slow`.
# It remembers d0', and with friction whether it slides, then the bristle (3) in axes of J.
CONTACT = np.dtype(
    [
        ("I", _I),
        ("J", _I),
        ("kind", _I),  # BALL, PLANE, CYLINDER, BORE: of side J
        ("ri", _F),
        ("rj", _F),
        ("half", _F),  # half the length of a cylinder, m
        ("K", _F),  # N/m^n
        ("n", _F),
        ("damping", _F),
        ("slow", _F),  # m/s
        ("couple", _I),
        *FRICTION_FIELDS,
    ],
    align=True,
)

# One contact now: all that follows from the motion of its two markers, global axes.
CONTACT_NOW = np.dtype(
    [
        ("n", _F, (3,)),  # normal, from J to I
        ("rho", _F),  # length by which n turns (0: with J; negative: in a bore)
        ("g", _F, (3,)),  # velocity of I relative to J where they meet
        ("rate", _F),  # of the depth
        ("N", _F),  # normal force; this and what follows only where they touch
        ("friction", _F, (3,)),  # force on I
        ("bristle", _F, (3,)),
        ("mode", _F),  # OPEN, STICKS, SLIDES
        ("excess", _F),  # |T| − μ N
    ],
    align=True,
)

_ZERO = (0.0, 0.0, 0.0)


class Scratch(NamedTuple):
    """Scratch of one contact."""

    now: array_of(CONTACT_NOW)  # (1,) the contact that was evaluated last
    D: Matrix  # (3, 3) its force per relative velocity


class Contacts(NamedTuple):
    """Contacts of a model."""

    rows: array_of(CONTACT)
    first_event: int  # each has two: its depth, and what makes it slide or stick
    scratch: Scratch = None  # of one run


def new_scratch(contacts: Contacts) -> Scratch:
    """Scratch that holds nothing yet."""
    return Scratch(np.zeros(1, CONTACT_NOW), np.zeros((3, 3)))


@kernel
def separation(mi, mj):
    """u = x_I − x_J."""
    return plus(triple(mi["x"]), -1.0, triple(mj["x"]))


@kernel
def _penetration(c, mi, mj):
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
def _relative_velocity(c, n, mi, mj):
    """Velocity of I relative to J where they meet."""
    s = times(-c["ri"], n)
    g = plus(triple(mi["vx"]), -1.0, triple(mj["vx"]))
    g = plus(g, 1.0, outer(triple(mi["om"]), s))
    return plus(g, -1.0, outer(triple(mj["om"]), plus(separation(mi, mj), 1.0, s)))


@kernel
def normal_force(c, history, d, rate):
    """N and its slopes over d and ḋ; d > 0."""
    speed = max(history[c["history"]], c["slow"])
    elastic, factor = c["K"] * d ** c["n"], 1.0 + c["damping"] * rate / speed
    if factor <= 0.0:
        return 0.0, 0.0, 0.0
    return elastic * factor, c["n"] * elastic / d * factor, elastic * c["damping"] / speed


@kernel
def bristle(c, history, mj):
    """The bristle of the last accepted step, global axes."""
    o = c["history"] + 2
    return turned(mj["R"], part(history, o))


@unit
def evaluate_contact(run: Run, contacts: Contacts, k: int) -> float:
    """Depth of contact k, and all else of it into `contacts.scratch.now`."""
    c, now, out = contacts.rows[k], run.work.now, contacts.scratch.now[0]
    mi, mj = now.marker[c["I"]], now.marker[c["J"]]
    d, n, rho = _penetration(c, mi, mj)
    g = _relative_velocity(c, n, mi, mj)
    rate = -inner(n, g)
    out["rho"], out["rate"], out["mode"] = rho, rate, OPEN
    put_part(out["n"], 0, n)
    put_part(out["g"], 0, g)
    if d > 0.0:
        N, _, _ = normal_force(c, now.history, d, rate)
        f, s, mode, excess = _ZERO, _ZERO, OPEN, 0.0
        if c["model"] != NO_FRICTION:
            before = bristle(c, now.history, mj)
            f, s, mode, excess = tangential(c, n, N, g, before, now.span[0])
        out["N"], out["mode"], out["excess"] = N, mode, excess
        put_part(out["friction"], 0, f)
        put_part(out["bristle"], 0, s)
    return d


@kernel
def force(cn):
    """Force on I, global axes."""
    return plus(triple(cn["friction"]), cn["N"], triple(cn["n"]))


@kernel
def put_wrench(c, n, mi, mj, f, w):
    """w (12) = the wrench pair of the force f on I, the opposite on J, where they meet."""
    s = times(-c["ri"], n)
    put_part(w, 0, f)
    put_part(w, 3, outer(s, f))
    put_part(w, 6, times(-1.0, f))
    put_part(w, 9, outer(f, plus(separation(mi, mj), 1.0, s)))
