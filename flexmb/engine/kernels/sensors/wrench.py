"""Wrenches of single elements and energies of single bodies, as sensors read them."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels import energy as energies_of
from flexmb.engine.kernels.forces import contact, element, force
from flexmb.engine.kernels.joints import reaction
from flexmb.engine.sensor_tables import CONTACT_WRENCH, LOAD_WRENCH, REACTION, SPRING_WRENCH


@kernel
def component(sys, wk, channel, lam):
    """One component of the force or moment that an element has on one of its two markers."""
    w, k, axes = wk.dense.g[1], channel["first"], channel["axes"]
    for c in range(12):
        w[c] = 0.0
    i, j = 0, 0
    if channel["what"] == REACTION:
        row = sys.rows[sys.groups[k]["row"]]
        i, j = row["I"], row["J"]
        reaction.add_wrenches(
            sys.lines, sys.rows, sys.groups[k], wk.now.marker, lam, wk.dense.g[0], w
        )
    elif channel["what"] == LOAD_WRENCH:
        i, j = sys.loads[k]["marker"], sys.loads[k]["marker"]
        o = 6 + 3 * sys.loads[k]["torque"]
        w[o], w[o + 1], w[o + 2] = force.load_vector(sys.loads[k], wk.now.marker, wk.con.fun)
    elif channel["what"] == SPRING_WRENCH:
        i, j = _spring(sys.springs, wk.now.marker, k, w)
    elif channel["what"] == CONTACT_WRENCH:
        i, j = contact.wrenches(sys.contacts, wk.now, k, channel["n"], wk.dense.g[0], w)
    else:
        i, j = element.wrenches(sys.elements, wk.now, wk.con.fun, channel["what"], k, w)
    o = 6 * (1 - channel["side"]) + 3 * channel["quantity"]
    if axes == -1:
        return w[o + channel["a"]]
    own = j if channel["side"] == 0 else i
    R, a = wk.now.marker[own if axes < 0 else axes]["R"], channel["a"]
    return R[0, a] * w[o] + R[1, a] * w[o + 1] + R[2, a] * w[o + 2]


@kernel
def _spring(springs, markers, k, w):
    """Forces of one spring–damper into w (12); returns its two markers."""
    if springs is not None:
        i, j = springs[k]["I"], springs[k]["J"]
        d, x, y, z = force.direction(markers[i], markers[j])
        f = force.spring_force(springs[k], markers[i], markers[j], d, x, y, z)
        force.add_pair(w[0:6], w[6:12], f * x, f * y, f * z)
        return i, j
    return 0, 0


@kernel
def energy(sys, wk, channel, q, v, energies):
    """An energy of the whole model, their sum (4), or one of a single body."""
    what, body = channel["first"], channel["n"]
    if what == 4:
        return energies[0] + energies[1] + energies[2] + energies[3]
    if body < 0:
        return energies[what]
    if what == 0:
        return energies_of.body_kinetic(sys.parts, wk.now, v, body, wk.dense.B)
    if what == 1:
        return energies_of.body_strain(sys.parts, q, body)
    return energies_of.body_weight(sys.parts, wk.now, q, body)
