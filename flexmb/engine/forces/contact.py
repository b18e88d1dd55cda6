"""Contact of a sphere (or a point, of radius 0) with a ball, a plane, a cylinder or a bore.

The force on I at the contact point (`contact_pair`) is f = N n + friction; the opposite force acts
on J. The normal force N depends on the speed of approach ḋ₀ at the onset of the contact, an
internal variable that `update_history` finds.

Tangents: the wrench pair is W = B f, and the relative velocity at the contact point is g = Bᵀ V,
V the velocities of both markers. With D = ∂f/∂g, ∂W/∂V = B D Bᵀ. With the positions of the markers
W changes by B (∂f at constant V) + ∂B f. V itself changes with the generalised coordinates at
constant v, through the moment arms of the markers; this adds B D ∂g.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import axis_vector as axis
from flexmb.engine.algebra.vector import (
    clear,
    column,
    cross,
    inner,
    plus,
    put_part,
    times,
    triple,
    zero,
)
from flexmb.engine.bodies.wrench import (
    add_moment_arms,
    add_pair_tangent,
    add_rate_arms,
    add_rate_tangent,
    marker_acceleration,
)
from flexmb.engine.forces.bristle import (
    BALL_HISTORY,
    POINT_HISTORY,
    bristle_before,
    bristle_change,
    put_bristle_event,
    slip_change,
    slip_since,
    store_bristle,
)
from flexmb.engine.forces.contact_pair import (
    IMPACT_HISTORY,
    PEAK,
    normal_change,
    normal_force,
    normal_parameters,
    penetration,
    place_sides,
    put_wrench,
    record_impact,
    relative_velocity,
    separation,
)
from flexmb.engine.forces.friction import (
    BRISTLE,
    FRICTION_FIELDS,
    LEAST_EXCESS,
    NO_FRICTION,
    friction_force,
    friction_force_change,
    friction_parameters,
)
from flexmb.engine.jit import Matrix, array_of, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import BRISTLE_ENERGY, DAMPER_POWER, SPRING_ENERGY, Point, Run

if TYPE_CHECKING:
    from flexmb.engine.lowering import Forces, Lowering
    from flexmb.model.forces.contact import ContactSpec

_I, _F = "i8", "f8"
# One contact between a round side I (a sphere, or a point of radius 0) and a side J. At a depth
# d > 0 the normal force is K d^n (1 + damping d'/d0'), d0' the speed of approach at the onset, at
# least `slow`. Internal variables: d0', the bristle of friction, and records of impacts.
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
        ("bristle", _I),  # index of the first internal variable of the bristle; -1: no bristle
        ("impacts", _I),  # index of the first number of the records of impacts
        ("last", _I),  # 1: the last point of its force
    ],
    align=True,
)

# State of one contact, global axes: normal n from J to I; rho, the signed length with which n turns
# (`penetration`); velocity g of I relative to J at the contact point; rate of the depth. Only while
# the sides touch: normal force N, friction on I, bristle s, excess |T| − μ N, overload k |s| − μ N
# for s without its limit, and slid, the sliding distance of a full bristle over its length.
_NUMBERS, _VECTORS = (
    ("rho", "rate", "N", "excess", "overload", "slid"),
    ("n", "g", "friction", "bristle"),
)
CONTACT_NOW = np.dtype(
    [(word, _F) for word in _NUMBERS] + [(word, _F, (3,)) for word in _VECTORS], align=True
)

# The speed of approach ḋ₀ at the onset is interpolated linearly between the ends of a step that
# ends within the first number, a fraction of the step, after the onset, or whose speeds at both
# ends differ by less than the second number, relatively. The speed before the onset alone would
# have an error of d̈ times the time until the onset, whatever the accuracy. If the sides did not
# approach when the step h began, a constant acceleration v/h is assumed: ḋ₀² = v² − 2 d v/h.
_ONSET_FRACTION, _EQUAL_SPEEDS = 0.05, 1e-3
_ZERO = (0.0, 0.0, 0.0)


class Scratch(NamedTuple):
    """Scratch of one contact."""

    now: array_of(CONTACT_NOW)  # (1,) the contact that was evaluated last
    D: Matrix  # (3, 3) ∂f/∂g of it, N s/m


class Contacts(NamedTuple):
    """Contacts of a model."""

    rows: array_of(CONTACT)
    first_event: int  # three event functions each: depth, |T| − μ N, bristle becomes full or free
    scratch: Scratch = None  # of one run


def lower_contacts(lowering: Lowering, forces: Forces) -> Contacts:
    """CONTACT rows of all contacts, one for each point of I; links are filled in later."""
    rows: list[tuple[object, ...]] = []
    for name, spec in forces:
        first = len(rows)
        rows += _contact_rows(lowering, spec)
        lowering.add_element(name, "contacts", first, len(rows) - first, spec.round_side == 1)
    return Contacts(np.array(rows, CONTACT), lowering.add_events(3 * len(rows)))


def _contact_rows(lowering: Lowering, spec: ContactSpec) -> Iterator[tuple[object, ...]]:
    surface, points, shape = place_sides(lowering, spec)
    J = lowering.markers.add(surface)
    law, friction = normal_parameters(lowering.model, spec), friction_parameters(spec.friction)
    for k, point in enumerate(points, 1):
        I = lowering.markers.add(point)  # noqa: E741
        history, bristle = lowering.add_history(1), -1
        if friction[0] == BRISTLE:
            bristle = lowering.add_history(BALL_HISTORY if shape[1] > 0.0 else POINT_HISTORY)
        impacts = lowering.add_history(IMPACT_HISTORY)
        yield I, J, *shape, *law, -1, *friction, history, bristle, impacts, k == len(points)


@unit
def evaluate_contact(run: Run, contacts: Contacts, k: int) -> float:
    """Return the depth of contact k, m; put the other quantities into `contacts.scratch.now`."""
    c, now, out = contacts.rows[k], run.work.now, contacts.scratch.now[0]
    mi, mj = now.marker[c["I"]], now.marker[c["J"]]
    d, n, rho = penetration(c, mi, mj)
    g = relative_velocity(c, n, mi, mj)
    rate = -inner(n, g)
    out["rho"], out["rate"] = rho, rate
    put_part(out["n"], 0, n)
    put_part(out["g"], 0, g)
    if d > 0.0:
        N, _, _ = normal_force(c, now.history, d, rate)
        f, s, excess, overload, slid = _ZERO, _ZERO, 0.0, 0.0, -1.0
        if c["model"] != NO_FRICTION:
            s0, slid = bristle_before(c, now.history, n, mj)
            way = slip_since(c, now.history, now.span[0], n, d, mi, mj)
            f, s, excess, overload, slid = friction_force(c, n, N, g, s0, way, slid)
        out["N"], out["excess"], out["overload"], out["slid"] = N, excess, overload, slid
        put_part(out["friction"], 0, f)
        put_part(out["bristle"], 0, s)
    return d


@kernel
def force(cn):
    """Force on I, global axes."""
    return plus(triple(cn["friction"]), cn["N"], triple(cn["n"]))


@unit
def add_wrenches(run: Run, contacts: Contacts, at: Point) -> int:
    """Add the wrenches of all contacts to their markers."""
    rows, cn = contacts.rows, contacts.scratch.now[0]
    markers, w = run.work.now.marker, run.work.dense.g[0]
    for k in range(rows.shape[0]):
        if evaluate_contact(run, contacts, k) > 0.0:
            c = rows[k]
            mi, mj = markers[c["I"]], markers[c["J"]]
            put_wrench(c, triple(cn["n"]), mi, mj, force(cn), w)
            for r in range(6):
                mi["W"][r] += w[r]
                mj["W"][r] += w[6 + r]
    return SUCCESS


@unit
def read_wrench(run: Run, contacts: Contacts, at: Point, channel: int) -> float:
    """Sum of the wrench pairs of all points of the contact that a channel reads.

    The moment on J is about its marker. The moments on I, each about the marker of one point, have
    no common reference point: of their sum only the force is meaningful.
    """
    rows, cn = contacts.rows, contacts.scratch.now[0]
    markers, dense = run.work.now.marker, run.work.dense
    row = run.system.sensors.channels[channel]
    first, g, w = row["first"], dense.g[0], dense.g[1]
    dense.pair[0], dense.pair[1] = rows[first]["I"], rows[first]["J"]
    zero(w)
    for k in range(first, first + row["n"]):
        if evaluate_contact(run, contacts, k) > 0.0:
            c = rows[k]
            put_wrench(c, triple(cn["n"]), markers[c["I"]], markers[c["J"]], force(cn), g)
            for r in range(12):
                w[r] += g[r]
    return 0.0


@unit
def add_energies(run: Run, contacts: Contacts, at: Point) -> int:
    """Elastic energy Σ K dⁿ⁺¹/(n + 1), and Σ ½ k s² in the bristles."""
    rows, cn, out = contacts.rows, contacts.scratch.now[0], run.work.energies
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        if d > 0.0:
            out[SPRING_ENERGY] += c["K"] * d ** (c["n"] + 1.0) / (c["n"] + 1.0)
            s = triple(cn["bristle"])
            out[BRISTLE_ENERGY] += 0.5 * c["k"] * inner(s, s)
    return SUCCESS


@unit
def add_powers(run: Run, contacts: Contacts, at: Point) -> int:
    """Power of damping and friction, including the power that bristles store."""
    rows, cn, out = contacts.rows, contacts.scratch.now[0], run.work.powers
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        if d > 0.0:
            out[DAMPER_POWER] += inner(triple(cn["friction"]), triple(cn["g"]))
            out[DAMPER_POWER] -= (cn["N"] - c["K"] * d ** c["n"]) * cn["rate"]
    return SUCCESS


@unit
def update_history(run: Run, contacts: Contacts, at: Point) -> int:
    """Write the internal variables of all contacts at an accepted state.

    `run.work.now.history` holds those with which the step was made.
    """
    rows, cn, now, history = contacts.rows, contacts.scratch.now[0], run.work.now, run.state.history
    total = _ZERO
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        o, rate = c["history"], cn["rate"]
        way, before = rate * now.span[0], now.history[o]
        if d <= 0.0:
            history[o] = max(rate, c["slow"])
        elif before <= c["slow"] and d <= way:
            history[o] = max(rate * math.sqrt(max(1.0 - 2.0 * d / way, 0.0)), c["slow"])
        elif d <= _ONSET_FRACTION * way or (
            d <= way and abs(rate - before) <= _EQUAL_SPEEDS * rate
        ):
            history[o] = max(rate + (before - rate) * d / way, c["slow"])
        damping = cn["N"] - c["K"] * max(d, 0.0) ** c["n"]
        record_impact(c, d, rate, damping, now.span[0], at.t[0], now.history, history)
        if d > 0.0:
            total = plus(total, cn["N"], triple(cn["n"]))
        if c["last"] == 1:
            peak = math.sqrt(inner(total, total))
            history[c["impacts"] + PEAK] = max(history[c["impacts"] + PEAK], peak)
            total = _ZERO
        if c["model"] == BRISTLE:
            mi, mj, n, g = now.marker[c["I"]], now.marker[c["J"]], triple(cn["n"]), triple(cn["g"])
            tilt, a = (
                _normal_rate_and_acceleration(run, c, n, cn["rho"], at)
                if d > 0.0
                else (_ZERO, _ZERO)
            )
            s, overload, slid = triple(cn["bristle"]), cn["overload"], cn["slid"]
            store_bristle(c, now.history, n, d, g, s, overload, slid, mi, mj, tilt, a, history)
    return SUCCESS


@kernel
def _normal_rate_and_acceleration(run, c, n, rho, at):
    """Rates of the normal n and of the relative velocity g at the contact point."""
    ai, aj = marker_acceleration(run, at, c["I"], 0), marker_acceleration(run, at, c["J"], 0)
    of_i, of_j = marker_acceleration(run, at, c["I"], 3), marker_acceleration(run, at, c["J"], 3)
    mi, mj = run.work.now.marker[c["I"]], run.work.now.marker[c["J"]]
    omi, omj, s = triple(mi["om"]), triple(mj["om"]), times(-c["ri"], n)
    u, du = separation(mi, mj), plus(triple(mi["vx"]), -1.0, triple(mj["vx"]))
    _, tilt = normal_change(c, n, rho, mi, mj, du, omj)
    ds = times(-c["ri"], tilt)
    a = plus(plus(ai, 1.0, cross(of_i, s)), 1.0, cross(omi, ds))
    a = plus(plus(a, -1.0, aj), -1.0, cross(of_j, plus(u, 1.0, s)))
    return tilt, plus(a, -1.0, cross(omj, plus(du, 1.0, ds)))


@unit
def put_events(run: Run, contacts: Contacts, at: Point) -> int:
    """Event functions of each contact: its depth, |T| − μ N, and that of `put_bristle_event`.

    |T| − μ N crosses zero where sliding begins or ends.
    """
    rows, cn, now, out = contacts.rows, contacts.scratch.now[0], run.work.now, run.work.events.now
    for k in range(rows.shape[0]):
        c, o, d = rows[k], contacts.first_event + 3 * k, evaluate_contact(run, contacts, k)
        touch, slip, length = out[o], out[o + 1], out[o + 2]
        touch["value"], touch["rate"] = d, cn["rate"]
        slip["value"], slip["rate"] = 0.0, math.nan
        length["value"], length["rate"] = 0.0, math.nan
        if c["model"] == BRISTLE and d > 0.0:
            n, g, s = triple(cn["n"]), triple(cn["g"]), triple(cn["bristle"])
            slip["value"] = cn["excess"] - LEAST_EXCESS * cn["N"]
            tilt, a = _normal_rate_and_acceleration(run, c, n, cn["rho"], at)
            put_bristle_event(c, now.history, n, d, g, s, cn["overload"], tilt, a, length)
    return SUCCESS


@kernel
def _force_change(c, now, n, d, g, mi, mj, dd, dn, dg, du, spin, turn):
    """Change of the force on I with d, n, g and u, and rotations of I (spin) and J (turn)."""
    rate = -inner(n, g)
    N, stiff, viscous = normal_force(c, now.history, d, rate)
    dN = stiff * dd - viscous * (inner(dn, g) + inner(n, dg))
    df = plus(times(N, dn), dN, n)
    if c["model"] == NO_FRICTION:
        return df
    s0, slid = bristle_before(c, now.history, n, mj)
    way = slip_since(c, now.history, now.span[0], n, d, mi, mj)
    ds0 = bristle_change(c, now.history, n, mj, dn, turn)
    h = now.span[0]
    dway = slip_change(c, now.history, h, n, d, mi, mj, dn, dd, du, spin, turn)
    more = friction_force_change(c, n, N, g, s0, way, slid, dn, dN, dg, ds0, dway)
    return plus(df, 1.0, more)


@kernel
def _add_column(H, k, f, df, mi, mj):
    """Column k of H += f (df, m_I, −df, m_J)."""
    for r in range(3):
        H[r, k] += f * df[r]
        H[3 + r, k] += f * mi[r]
        H[6 + r, k] -= f * df[r]
        H[9 + r, k] += f * mj[r]


@unit
def put_contact_changes(run: Run, contacts: Contacts, k: int, d: float, cp: float) -> int:
    """D = ∂f/∂g of contact k, and dense.H = −cp ∂W/∂position at constant velocities of its markers.

    Contact k must be the one that was evaluated last; its depth is d > 0.
    """
    c, s, now, H = contacts.rows[k], contacts.scratch, run.work.now, run.work.dense.H
    cn, D = s.now[0], s.D
    mi, mj, n, F = now.marker[c["I"]], now.marker[c["J"]], triple(cn["n"]), force(cn)
    rho, g, u, li = cn["rho"], triple(cn["g"]), separation(mi, mj), times(-c["ri"], n)
    lj = plus(u, 1.0, li)
    omi, omj = triple(mi["om"]), triple(mj["om"])
    clear(H, 12, 12)
    rolls = c["model"] == BRISTLE and c["ri"] > 0.0
    # a = 0..2: change of g; 3..5: of u; 6..8: rotation of J; 9..11: rotation of I
    for a in range(3 if cp == 0.0 else 12 if rolls else 9):
        dd, dn, dg, du = 0.0, _ZERO, axis(a), axis(a - 3)
        turn, spin = axis(a - 6), axis(a - 9)
        if 3 <= a < 9:
            dd, dn = normal_change(c, n, rho, mi, mj, du, turn)
            di = times(-c["ri"], dn)
            dg = plus(cross(omi, di), -1.0, cross(omj, plus(du, 1.0, di)))
        df = _force_change(c, now, n, d, g, mi, mj, dd, dn, dg, du, spin, turn)
        if a < 3:
            D[0, a], D[1, a], D[2, a] = df
            continue
        di = times(-c["ri"], dn)
        ti = plus(cross(di, F), 1.0, cross(li, df))
        tj = times(-1.0, plus(cross(plus(du, 1.0, di), F), 1.0, cross(lj, df)))
        if a < 6:
            _add_column(H, a - 3, -cp, df, ti, tj)
        _add_column(H, a - 6 if a >= 9 else a + 3, cp if a < 6 else -cp, df, ti, tj)
    return SUCCESS


@unit
def add_tangents(run: Run, contacts: Contacts, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all contacts."""
    if cv != 0.0 or cp != 0.0:
        for k in range(contacts.rows.shape[0]):
            d = evaluate_contact(run, contacts, k)
            if d > 0.0:
                _add_contact(run, contacts, k, at.v, cv, cp, d)
    return SUCCESS


@kernel
def _add_contact(run, contacts, k, v, cv, cp, d):
    c, s, markers, dense = contacts.rows[k], contacts.scratch, run.work.now.marker, run.work.dense
    cn, D = s.now[0], s.D
    i, j, couple = c["I"], c["J"], c["couple"]
    mi, mj, n = markers[i], markers[j], triple(cn["n"])
    put_contact_changes(run, contacts, k, d, cp)
    smooth = c["model"] == NO_FRICTION  # then D = −viscous n nᵀ
    rates = 1 if smooth else 3
    for a in range(rates):
        dfdg = times(D[0, 0] + D[1, 1] + D[2, 2], n) if smooth else column(D, a)
        put_wrench(c, n, mi, mj, dfdg, dense.X[a])
        put_wrench(c, n, mi, mj, n if smooth else axis(a), dense.U[a])
    add_rate_tangent(run, rates, -cv)
    add_pair_tangent(run, i, j, couple, 1.0)
    if cp != 0.0:
        add_rate_arms(run, v, i, j, couple, rates, -cp)
        put_wrench(c, n, mi, mj, times(-1.0, force(cn)), dense.g[1])
        add_moment_arms(run, i, j, cp)


CONTACTS = Kind(
    "contacts",
    Contacts,
    {
        "wrench": add_wrenches,
        "matrix": add_tangents,
        "energy": add_energies,
        "power": add_powers,
        "begin": update_history,
        "update_history": update_history,
        "events": put_events,
        "wrenches": read_wrench,
    },
    lower=lower_contacts,
    types=("contact",),
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    does_work=True,
    stiff=True,
    unsymmetric=lambda contacts: bool((contacts.rows["model"] != NO_FRICTION).any()),
    scratch=lambda contacts: Scratch(np.zeros(1, CONTACT_NOW), np.zeros((3, 3))),
)
