"""Tangents of the elements of `element`, added to the panels of the KKT matrix."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import add_body_block, add_coupling, clear
from flexmb.engine.kernels.algebra.rotation import transform
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.kernels.bodies.kinematics import add_pulled_back
from flexmb.engine.kernels.bodies.pair_tangent import add_levers, add_pair
from flexmb.engine.kernels.forces import frame, law, measure, mutual, pair


@kernel
def element_tangents(sys, elements, wk, v, cv, cp):
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all elements."""
    if elements is not None:
        _frame_tangents(sys, elements.frames, elements.pool, wk, v, cv, cp)
        _law_tangents(sys, elements.laws, elements, wk, v, cv, cp)
        _mutual_tangents(sys, elements.mutual, wk, cp)


@kernel
def _frame_tangents(sys, frames, pool, wk, v, cv, cp):
    if frames is not None:
        for k in range(frames.shape[0]):
            row, s, w = frames[k], wk.now.element, wk.dense.g[1]
            i, j, link = row["I"], row["J"], row["couple"]
            mi, mj = wk.now.marker[i], wk.now.marker[j]
            frame.pull(row, pool, mi, mj, s)
            frame.linearise(row, pool, s)
            clear(wk.dense.H, 12, 12)
            pair.add_tangent(mi, mj, s, row["damped"], cv, cp, wk.dense.H)
            add_pair(sys.parts, sys.kkt, wk, i, j, link, 1.0)
            if row["damped"] == 1 and cp != 0.0:
                _add_velocity_levers(sys.parts, sys.kkt, wk, i, j, link, v, cp)
            for c in range(12):
                w[c] = 0.0
            for c in range(6):
                s.f[c] = -s.f[c]
            pair.add_wrenches(mi, mj, s.f, w[0:6], w[6:12])
            add_levers(sys.parts, sys.kkt, wk, i, j, cp)


@kernel
def _law_tangents(sys, laws, elements, wk, v, cv, cp):
    if laws is not None:
        for k in range(laws.shape[0]):
            row, w = laws[k], wk.dense.g[1]
            if not measure.between_markers(row):
                continue
            i, j, link = row["I"], row["J"], row["couple"]
            clear(wk.dense.H, 12, 12)
            damped = measure.add_tangent(row, elements, wk.now, wk.con.fun, cv, cp, w, wk.dense.H)
            add_pair(sys.parts, sys.kkt, wk, i, j, link, 1.0)
            add_levers(sys.parts, sys.kkt, wk, i, j, cp)
            if damped and cp != 0.0:
                _add_velocity_levers(sys.parts, sys.kkt, wk, i, j, link, v, cp)


@kernel
def add_coordinate_tangents(elements, coordinates, kkt, wk, v, cv, cp):
    """cv ∂R/∂ṡ + cp ∂R/∂s of laws on scalar coordinates, on the diagonal.

    At the acceleration level, cv = 0, nothing: such a coordinate has no mass (see `coordinate`).
    """
    if elements is not None and cv != 0.0:
        _coordinate_tangents(elements.laws, elements, coordinates, kkt, wk, v, cv, cp)


@kernel
def _coordinate_tangents(laws, elements, coordinates, kkt, wk, v, cv, cp):
    if laws is not None and coordinates is not None:
        for k in range(laws.shape[0]):
            if not measure.between_markers(laws[k]):
                s = coordinates[laws[k]["coordinate"]]
                at, x = kkt.panels[s["panel"]]["at"], wk.now.element.s[laws[k]["coordinate"]]
                u, stack = measure.actuator(laws[k], wk.con.fun), wk.now.element.stack
                _, a, b = law.resistance(laws[k], elements, stack, x, v[s["iv"]], u)
                wk.factor.low[at] += cv * b + cp * a
                wk.factor.up[at] += cv * b + cp * a


@kernel
def _add_velocity_levers(parts, kkt, wk, i, j, link, v, cp):
    """Add cp Jᵀ W ∂(J v)/∂q: what the levers of the markers do to their velocities at constant v.

    W is the damping in the scratch of the elements; J of the markers is in dense.J.
    """
    d, s, low, up = wk.dense, wk.now.element, wk.factor.low, wk.factor.up
    for side in range(2):
        k = i if side == 0 else j
        b = parts.markers[k]["body"]
        if b < 0:
            continue
        n = 6 + parts.bodies[b]["m"]
        _put_velocity_slope(parts, wk, k, v)
        for row in range(2):
            a = parts.markers[i if row == 0 else j]["body"]
            if a < 0:
                continue
            m = 6 + parts.bodies[a]["m"]
            clear(d.B, m, n)
            tangent.add_product_block(s.W, row, side, d.J[row], m, s.N, n, cp, d.T, d.B)
            if row == side:
                add_body_block(parts.bodies[a], kkt, d.B, low, up)
            elif link >= 0:
                add_coupling(d.B, parts.bodies[a], parts.bodies[b], kkt, link, row == 1, low, up)


@kernel
def _put_velocity_slope(parts, wk, k, v):
    """N (6, 6 + m) = ∂(J v)/∂q of marker k: row by row vᵀ times a lever tangent."""
    d, s, w = wk.dense, wk.now.element, wk.dense.g[0]
    body = parts.bodies[parts.markers[k]["body"]]
    n, o = 6 + body["m"], body["iv"]
    put(w, 0, 0.0, 0.0, 0.0)
    put(w, 3, 0.0, 0.0, 0.0)
    for r in range(6):
        w[r] = 1.0
        clear(d.B, n, n)
        tangent.add_lever_tangent(parts, wk.now, k, w, 0, 1.0, d.B)
        for c in range(n):
            x = 0.0
            for a in range(n):
                x += v[o + a] * d.B[a, c]
            s.N[r, c] = x
        w[r] = 0.0


@kernel
def _mutual_tangents(sys, loads, wk, cp):
    if loads is not None:
        for k in range(loads.shape[0]):
            load, w, H = loads[k], wk.dense.g[1], wk.dense.H
            i, j, axes = load["other"], load["marker"], load["axes"]
            for c in range(12):
                w[c] = 0.0
            mutual.add_wrenches(load, wk.now.marker, wk.con.fun, -1.0, w[0:6], w[6:12])
            if i >= 0:
                clear(H, 12, 12)
                mutual.add_arm_tangent(load, wk.now.marker, wk.con.fun, H)
                add_pair(sys.parts, sys.kkt, wk, i, j, load["couple"], cp)
                add_levers(sys.parts, sys.kkt, wk, i, j, cp)
            else:
                for c in range(6):
                    w[c] = w[6 + c]
                add_levers(sys.parts, sys.kkt, wk, j, -1, cp)
            if axes >= 0:
                clear(H, 12, 12)
                mutual.add_turn_of_marker(load, wk.now.marker, wk.con.fun, H)
                _add_block(sys.parts, sys.kkt, wk, j, axes, load["couple_marker"], cp)
            if axes >= 0 and i >= 0:
                clear(H, 12, 12)
                mutual.add_turn_of_other(load, wk.now.marker, wk.con.fun, H)
                _add_block(sys.parts, sys.kkt, wk, i, axes, load["couple_other"], cp)


@kernel
def _add_block(parts, kkt, wk, i, j, link, f):
    """Add f J_iᵀ H[:6, 6:] J_j alone, for two markers that may be on one body."""
    d, low, up = wk.dense, wk.factor.low, wk.factor.up
    a, b = parts.markers[i]["body"], parts.markers[j]["body"]
    if a < 0 or b < 0:
        return
    n, m = 6 + parts.bodies[a]["m"], 6 + parts.bodies[b]["m"]
    tangent.marker_jacobian(parts, wk.now, i, d.J[0])
    tangent.marker_jacobian(parts, wk.now, j, d.J[1])
    clear(d.B, n, m)
    tangent.add_product_block(d.H, 0, 1, d.J[0], n, d.J[1], m, f, d.T, d.B)
    if a == b:
        add_body_block(parts.bodies[a], kkt, d.B, low, up)
    else:
        add_coupling(d.B, parts.bodies[a], parts.bodies[b], kkt, link, False, low, up)


@kernel
def put_unit_force(elements, parts, wk, k, a):
    """Generalised force per unit of what a function gives to an element, into live.left.

    Numbers k count the two sides of every mutual load (component a), then those of every law;
    returns the first coordinate of the body and how many it has.
    """
    w, marker = wk.dense.g[1], -1
    for c in range(12):
        w[c] = 0.0
    if elements is not None:
        n = _rows(elements.mutual)
        if k < 2 * n:
            marker = _put_unit_load(elements.mutual, wk.now.marker, k // 2, k % 2, a, w)
        else:
            marker = _put_unit_actuator(elements.laws, wk.now, k // 2 - n, k % 2, w)
    if marker < 0:
        return 0, 0
    body, left = parts.bodies[parts.markers[marker]["body"]], wk.live.left
    n = 6 + body["m"]
    for c in range(n):
        left[c] = 0.0
    add_pulled_back(parts, wk.now, marker, w, 6 * (1 - k % 2), 1.0, left, 0)
    return body["iv"], n


@kernel
def _rows(table):
    if table is not None:
        return table.shape[0]
    return 0


@kernel
def _put_unit_load(loads, markers, k, side, a, w):
    """Wrenches of a unit component a in w (12); the marker of the side (0: J, 1: I)."""
    if loads is not None:
        load = loads[k]
        x, y, z = 1.0 * (a == 0), 1.0 * (a == 1), 1.0 * (a == 2)
        if load["axes"] >= 0:
            x, y, z = transform(markers[load["axes"]]["R"], x, y, z)
        mutual.add_vector(load, markers, x, y, z, w[0:6], w[6:12])
        return load["marker"] if side == 0 else load["other"]
    return -1


@kernel
def _put_unit_actuator(laws, now, k, side, w):
    """Wrenches of a unit push apart in w (12); the marker of the side (0: J, 1: I)."""
    if laws is not None:
        row = laws[k]
        measure.between(row, now.marker[row["I"]], now.marker[row["J"]], w)
        return row["J"] if side == 0 else row["I"]
    return -1
