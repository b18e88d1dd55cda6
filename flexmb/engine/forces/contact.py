"""Contact of a sphere (or a point, of radius 0) with a ball, a plane, a cylinder or a bore.

Both bodies meet at one point (`contact_pair`), where the force on I is f = N n and friction,
and its opposite acts on J; N as in `contact_pair`, ḋ₀ the speed of approach at the end of the step
that ends just at the onset, or of the last one before, an internal variable.

Tangents: the wrench pair is W = B f, the velocity where they meet g = Bᵀ V, V the velocities of
both markers. With D = ∂f/∂g: ∂W/∂V = B D Bᵀ, and with position W changes by B (∂f at constant V) +
∂B f. What the moment arms of the markers do to V at constant v adds B D ∂g.
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
    inner,
    outer,
    part,
    plus,
    put_part,
    times,
    triple,
    turned,
    turned_back,
    zero,
)
from flexmb.engine.bodies.wrench import add_moment_arms, add_pair, add_rate_arms, add_rates
from flexmb.engine.forces.contact_pair import (
    normal_change,
    normal_force,
    normal_parameters,
    penetration,
    place_sides,
    put_wrench,
    relative_velocity,
    separation,
)
from flexmb.engine.forces.friction import (
    BRISTLE,
    FRICTION_FIELDS,
    LEAST_EXCESS,
    NO_FRICTION,
    OPEN,
    SLIDES,
    STICKS,
    friction_force,
    friction_force_change,
    friction_parameters,
    next_mode,
    tangential_part,
)
from flexmb.engine.jit import Matrix, array_of, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.state import BRISTLE_ENERGY, DAMPER_POWER, SPRING_ENERGY, Point, Run

if TYPE_CHECKING:
    from flexmb.engine.lowering import Forces, Lowering
    from flexmb.model.forces.contact import ContactSpec

_I, _F = "i8", "f8"
# One contact between a round side I (a sphere, or a point of radius 0) and a side J. Depth d > 0:
# normal force K d^n (1 + c d'/d0'), d0' the speed of approach at the onset, at least `slow`.
# It remembers d0', and with friction whether it slides, then in axes of J the bristle (3) and where
# I is (3).
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
        ("impacts", _I),  # where their history stands
    ],
    align=True,
)

# One contact now, global axes: normal n from J to I, length rho by which it turns (0: with J;
# negative: in a bore), velocity g of I relative to J where they meet, rate of the depth; only where
# they touch the normal force N, friction on I, the bristle, its mode and |T| − μ N.
_NUMBERS, _VECTORS = ("rho", "rate", "N", "mode", "excess"), ("n", "g", "friction", "bristle")
CONTACT_NOW = np.dtype(
    [(word, _F) for word in _NUMBERS] + [(word, _F, (3,)) for word in _VECTORS], align=True
)

# A step that ends within this fraction of itself after an onset, or at whose ends the speeds differ
# by as little, gives the speed of the impact: that between them. With the speed before the onset
# alone an error of d'' times the time until it is left, whatever the accuracy; so does a step that
# did not approach when it began.
_ONSET_FRACTION, _ALIKE = 0.05, 1e-3
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


# Numbers of history of a point: speed of approach; with friction its mode, bristle and place too.
_HISTORY, _FRICTION_HISTORY = 1, 8
_MODE_PLACE, _BRISTLE_PLACE, _PLACE = 1, 2, 5  # where they begin
# Of impacts: speed of the last one (< 0: it lasts; 0: there was none), its beginning and depth; the
# fastest one so far, and the widest gap after one slower than the least speed.
IMPACT, ONSET, DEEPEST, FASTEST, REBOUND, _IMPACT_HISTORY = range(6)
_BRIEF = 10.0  # depths over speed: what lasts longer is pressed together and no impact


def lower_contacts(lowering: Lowering, forces: Forces) -> Contacts:
    """CONTACT rows of all contacts, one for each point; links are filled in later."""
    rows: list[tuple[object, ...]] = []
    for name, spec in forces:
        first = len(rows)
        rows += _contact_rows(lowering, spec)
        lowering.add_element(name, "contacts", first, len(rows) - first, spec.round_side == 1)
    return Contacts(np.array(rows, CONTACT), lowering.add_events(2 * len(rows)))


def _contact_rows(lowering: Lowering, spec: ContactSpec) -> Iterator[tuple[object, ...]]:
    surface, points, shape = place_sides(lowering, spec)
    J = lowering.markers.add(surface)
    law, friction = normal_parameters(lowering.model, spec), friction_parameters(spec.friction)
    for point in points:
        I = lowering.markers.add(point)  # noqa: E741
        history = lowering.add_history(_HISTORY if spec.friction is None else _FRICTION_HISTORY)
        impacts = lowering.add_history(_IMPACT_HISTORY)
        yield I, J, *shape, *law, -1, *friction, history, impacts


@kernel
def _bristle(c, now, mj):
    """The bristle of the last accepted step, global axes."""
    return turned(mj["R"], part(now.history, c["history"] + _BRISTLE_PLACE))


@kernel
def _trial_bristle(c, now, g, mi, mj):
    """The bristle if it sticks; what of it turns with J; its changes with g and with the way.

    That of the last accepted step, and the way since: of a point exactly, by its places in axes of
    J; of a ball, which rolls, by its velocity now (backward Euler). It begins free.
    """
    if now.history[c["history"] + _MODE_PLACE] == OPEN:
        return _ZERO, _ZERO, 0.0, 0.0
    s0 = _bristle(c, now, mj)
    if c["ri"] > 0.0:
        return plus(s0, now.span[0], g), s0, now.span[0], 0.0
    s0 = plus(s0, -1.0, turned(mj["R"], part(now.history, c["history"] + _PLACE)))
    return plus(s0, 1.0, separation(mi, mj)), s0, 0.0, 1.0


@unit
def evaluate_contact(run: Run, contacts: Contacts, k: int) -> float:
    """Depth of contact k, and all else of it into `contacts.scratch.now`."""
    c, now, out = contacts.rows[k], run.work.now, contacts.scratch.now[0]
    mi, mj = now.marker[c["I"]], now.marker[c["J"]]
    d, n, rho = penetration(c, mi, mj)
    g = relative_velocity(c, n, mi, mj)
    rate = -inner(n, g)
    out["rho"], out["rate"], out["mode"] = rho, rate, OPEN
    put_part(out["n"], 0, n)
    put_part(out["g"], 0, g)
    if d > 0.0:
        N, _, _ = normal_force(c, now.history, d, rate)
        f, s, mode, excess = _ZERO, _ZERO, OPEN, 0.0
        if c["model"] != NO_FRICTION:
            z, _, _, _ = _trial_bristle(c, now, g, mi, mj)
            f, s, mode, excess = friction_force(c, n, N, g, z)
        out["N"], out["mode"], out["excess"] = N, mode, excess
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
    return FINE


@unit
def read_wrench(run: Run, contacts: Contacts, at: Point, channel: int) -> float:
    """Wrench pair of all points of the contact that a channel reads, on J; of I their force."""
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
    return FINE


@unit
def add_powers(run: Run, contacts: Contacts, at: Point) -> int:
    """Power of damping and friction, that into bristles included."""
    rows, cn, out = contacts.rows, contacts.scratch.now[0], run.work.powers
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        if d > 0.0:
            out[DAMPER_POWER] += inner(triple(cn["friction"]), triple(cn["g"]))
            out[DAMPER_POWER] -= (cn["N"] - c["K"] * d ** c["n"]) * cn["rate"]
    return FINE


@unit
def remember(run: Run, contacts: Contacts, at: Point) -> int:
    """Write the history of all contacts at an accepted state; `now` has that of the step."""
    rows, cn, now, history = contacts.rows, contacts.scratch.now[0], run.work.now, run.state.history
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        o, rate = c["history"], cn["rate"]
        way, before = rate * now.span[0], now.history[o]
        if d <= 0.0:
            history[o] = max(rate, c["slow"])
        elif d <= _ONSET_FRACTION * way or (
            d <= way and (abs(rate - before) <= _ALIKE * rate or before <= c["slow"])
        ):
            history[o] = max(rate + (before - rate) * d / way, c["slow"])
        _note_impact(run, c, d, rate, at.t[0])
        if c["model"] != NO_FRICTION:
            mj = now.marker[c["J"]]
            s = turned_back(mj["R"], triple(cn["bristle"]))
            u = separation(now.marker[c["I"]], mj)
            along = -inner(triple(cn["friction"]), triple(cn["g"]))
            history[o + _MODE_PLACE] = next_mode(history[o + _MODE_PLACE], cn["mode"], along)
            put_part(history, o + _BRISTLE_PLACE, s if d > 0.0 else _ZERO)
            put_part(history, o + _PLACE, turned_back(mj["R"], u))
    return FINE


@kernel
def _note_impact(run, c, d, rate, t):
    """Speeds of impacts, and how far slow ones rebound; c a contact of depth d, t the time."""
    now, history, o = run.work.now, run.state.history, c["impacts"]
    impact, before = history[o + IMPACT], now.history[c["history"]]
    if d > 0.0 and impact >= 0.0:
        before = before if before > c["slow"] else 0.0
        speed = max(rate, before, 1e-300) if now.span[0] > 0.0 else math.inf  # it begins deep
        history[o + IMPACT], history[o + ONSET], history[o + DEEPEST] = -speed, t, 0.0
        if speed < math.inf:
            history[o + FASTEST] = max(history[o + FASTEST], speed)
    elif d <= 0.0 and impact < 0.0:
        brief = (t - history[o + ONSET]) * -impact <= _BRIEF * history[o + DEEPEST]
        history[o + IMPACT] = -impact if brief else 0.0
    if d > 0.0:
        history[o + DEEPEST] = max(history[o + DEEPEST], d)
    elif 0.0 < history[o + IMPACT] < c["slow"]:
        history[o + REBOUND] = max(history[o + REBOUND], -d)


@unit
def put_events(run: Run, contacts: Contacts, at: Point) -> int:
    """Depth of each contact with its rate, and what makes it slide or stick.

    That crosses zero from below where it begins to slide, or to stick: |T| − μ N while it sticks,
    the speed against its bristle while it slides.
    """
    rows, cn, now, out = contacts.rows, contacts.scratch.now[0], run.work.now, run.work.events.now
    for k in range(rows.shape[0]):
        c, o, d = rows[k], contacts.first_event + 2 * k, evaluate_contact(run, contacts, k)
        touch, slip = out[o], out[o + 1]
        touch["value"], touch["rate"] = d, cn["rate"]
        slip["value"], slip["rate"] = 0.0, math.nan
        if c["model"] == BRISTLE and d > 0.0:
            mode = now.history[c["history"] + _MODE_PLACE]
            if mode == SLIDES:
                s = _bristle(c, now, now.marker[c["J"]])
                v = tangential_part(triple(cn["n"]), triple(cn["g"]))
                size = math.sqrt(inner(s, s))
                slip["value"] = -inner(s, v) / size if size > 0.0 else 0.0
            elif mode == STICKS:
                slip["value"] = cn["excess"] - LEAST_EXCESS * cn["N"]
    return FINE


@kernel
def _force_change(c, now, n, d, g, mi, mj, dd, dn, dg, du, turn):
    """Change of the force on I."""
    rate = -inner(n, g)
    N, stiff, viscous = normal_force(c, now.history, d, rate)
    dN = stiff * dd - viscous * (inner(dn, g) + inner(n, dg))
    df = plus(times(N, dn), dN, n)
    if c["model"] == NO_FRICTION:
        return df
    z, s0, with_g, with_way = _trial_bristle(c, now, g, mi, mj)
    dz = plus(plus(outer(turn, s0), with_g, dg), with_way, du)
    more = friction_force_change(c, n, N, g, z, dn, dN, dg, dz)
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

    It is the contact that was evaluated last, of depth d > 0.
    """
    c, s, now, H = contacts.rows[k], contacts.scratch, run.work.now, run.work.dense.H
    cn, D = s.now[0], s.D
    mi, mj, n, F = now.marker[c["I"]], now.marker[c["J"]], triple(cn["n"]), force(cn)
    rho, g, u, li = cn["rho"], triple(cn["g"]), separation(mi, mj), times(-c["ri"], n)
    lj = plus(u, 1.0, li)
    omi, omj = triple(mi["om"]), triple(mj["om"])
    clear(H, 12, 12)
    for a in range(3 if cp == 0.0 else 9):  # with g; with u; with a rotation of J
        dd, dn, dg, du, turn = 0.0, _ZERO, axis(a), axis(a - 3), axis(a - 6)
        if a >= 3:
            dd, dn = normal_change(c, n, rho, mi, mj, du, turn)
            di = times(-c["ri"], dn)
            dg = plus(outer(omi, di), -1.0, outer(omj, plus(du, 1.0, di)))
        df = _force_change(c, now, n, d, g, mi, mj, dd, dn, dg, du, turn)
        if a < 3:
            D[0, a], D[1, a], D[2, a] = df
            continue
        di = times(-c["ri"], dn)
        ti = plus(outer(di, F), 1.0, outer(li, df))
        tj = times(-1.0, plus(outer(plus(du, 1.0, di), F), 1.0, outer(lj, df)))
        if a < 6:
            _add_column(H, a - 3, -cp, df, ti, tj)
        _add_column(H, a + 3, cp if a < 6 else -cp, df, ti, tj)
    return FINE


@unit
def add_tangents(run: Run, contacts: Contacts, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all contacts."""
    if cv != 0.0 or cp != 0.0:
        for k in range(contacts.rows.shape[0]):
            d = evaluate_contact(run, contacts, k)
            if d > 0.0:
                _add_contact(run, contacts, k, at.v, cv, cp, d)
    return FINE


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
    add_rates(run, rates, -cv)
    add_pair(run, i, j, couple, 1.0)
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
        "begin": remember,
        "remember": remember,
        "events": put_events,
        "wrenches": read_wrench,
    },
    lower=lower_contacts,
    types=("contact",),
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    works=True,
    stiff=True,
    unsymmetric=lambda contacts: bool((contacts.rows["model"] != NO_FRICTION).any()),
    scratch=lambda contacts: Scratch(np.zeros(1, CONTACT_NOW), np.zeros((3, 3))),
)
