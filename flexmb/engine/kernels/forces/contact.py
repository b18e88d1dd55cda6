"""Contacts as a kind: wrenches, energy and power, history, events, what sensors read."""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import add_part, inner, outer, put_part, triple, turned_back
from flexmb.engine.jit import unit
from flexmb.engine.kernels.forces.contact_force import (
    Contacts,
    bristle,
    evaluate_contact,
    force,
    new_scratch,
    put_wrench,
    separation,
)
from flexmb.engine.kernels.forces.contact_tangent import contact_tangents
from flexmb.engine.kernels.forces.friction import BRISTLE, NO_FRICTION, OPEN, SLIDES, across
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run

# A step that ends within this share of itself after an onset tells the speed of the impact.
_ONSET_SHARE = 0.05
_ZERO = (0.0, 0.0, 0.0)


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
    """Wrench pair of all points of the contact that a channel reads: on its first I, and on J."""
    rows, cn = contacts.rows, contacts.scratch.now[0]
    markers, dense = run.work.now.marker, run.work.dense
    row = run.system.sensors.channels[channel]
    first, g, w = row["first"], dense.g[0], dense.g[1]
    i, j = rows[first]["I"], rows[first]["J"]
    dense.pair[0], dense.pair[1] = i, j
    for r in range(12):
        w[r] = 0.0
    for k in range(first, first + row["n"]):
        if evaluate_contact(run, contacts, k) > 0.0:
            c, f = rows[k], force(cn)
            mi, mj = markers[c["I"]], markers[c["J"]]
            put_wrench(c, triple(cn["n"]), mi, mj, f, g)
            for r in range(12):
                w[r] += g[r]
            add_part(w, 3, 1.0, outer(separation(markers[i], mi), f))
    return 0.0


@unit
def add_energies(run: Run, contacts: Contacts, at: Point) -> int:
    """Elastic energy Σ K dⁿ⁺¹/(n + 1), and Σ ½ k s² in the bristles."""
    rows, cn, out = contacts.rows, contacts.scratch.now[0], run.work.energies
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        if d > 0.0:
            out[3] += c["K"] * d ** (c["n"] + 1.0) / (c["n"] + 1.0)
            s = triple(cn["bristle"])
            out[4] += 0.5 * c["k"] * inner(s, s)
    return FINE


@unit
def add_powers(run: Run, contacts: Contacts, at: Point) -> int:
    """Power of damping and friction, that into bristles included."""
    rows, cn, out = contacts.rows, contacts.scratch.now[0], run.work.powers
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        if d > 0.0:
            out[1] += inner(triple(cn["friction"]), triple(cn["g"]))
            out[1] -= (cn["N"] - c["K"] * d ** c["n"]) * cn["rate"]
    return FINE


@unit
def remember(run: Run, contacts: Contacts, at: Point) -> int:
    """Write the history of all contacts at an accepted state; `now` has that of the step."""
    rows, cn, now, history = contacts.rows, contacts.scratch.now[0], run.work.now, run.state.history
    for k in range(rows.shape[0]):
        c, d = rows[k], evaluate_contact(run, contacts, k)
        o, rate = c["history"], cn["rate"]
        if d <= 0.0 or d <= _ONSET_SHARE * rate * now.span[0]:
            history[o] = max(rate, c["slow"])
        if c["model"] != NO_FRICTION:
            s = turned_back(now.marker[c["J"]]["R"], triple(cn["bristle"]))
            history[o + 1] = cn["mode"]
            put_part(history, o + 2, s if d > 0.0 else _ZERO)
    return FINE


@unit
def watch(run: Run, contacts: Contacts, at: Point) -> int:
    """Depth of each contact with its rate, and what makes it slide or stick.

    That crosses zero from below where it begins to slide, or to stick: |T| − μ N while it sticks,
    the speed against its bristle while it slides.
    """
    rows, cn, now, out = contacts.rows, contacts.scratch.now[0], run.work.now, run.work.events.now
    for k in range(rows.shape[0]):
        c, o, d = rows[k], contacts.first_event + 2 * k, evaluate_contact(run, contacts, k)
        out[o, 0], out[o, 1] = d, cn["rate"]
        out[o + 1, 0], out[o + 1, 1] = 0.0, math.nan
        if c["model"] == BRISTLE and d > 0.0:
            mode = now.history[c["history"] + 1]
            if mode == SLIDES:
                s = bristle(c, now.history, now.marker[c["J"]])
                v = across(triple(cn["n"]), triple(cn["g"]))
                out[o + 1, 0] = -inner(s, v) / math.sqrt(inner(s, s))
            elif mode != OPEN:
                out[o + 1, 0] = cn["excess"]
    return FINE


def _has_friction(contacts: Contacts) -> bool:
    return bool((contacts.rows["model"] != NO_FRICTION).any())


CONTACTS = Kind(
    "contacts",
    Contacts,
    {
        "wrench": add_wrenches,
        "matrix": contact_tangents,
        "energy": add_energies,
        "power": add_powers,
        "begin": remember,
        "remember": remember,
        "events": watch,
        "wrenches": read_wrench,
    },
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    works=True,
    stiff=True,
    unsymmetric=_has_friction,
    scratch=new_scratch,
)
