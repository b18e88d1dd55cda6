"""Force elements beside plain springs and loads: what they do to markers and coordinates.

`elements` holds bushings and beams (`frame`), laws of one measure (`law`, `measure`) and mutual
loads (`mutual`); a table that is None costs nothing.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.forces import frame, law, measure, mutual, pair
from flexmb.engine.sensor_tables import FRAME_WRENCH, LAW_WRENCH, MUTUAL_WRENCH


@kernel
def position(elements, coordinates, now, q):
    """Keep the scalar coordinates of q, for the laws that act on them; part of a position stage."""
    if elements is not None and coordinates is not None:
        for k in range(coordinates.shape[0]):
            now.element.s[k] = q[coordinates[k]["iq"]]


@kernel
def add_wrenches(elements, now, fun):
    """Add the wrenches of all elements between markers; returns a law of no length, or −1."""
    if elements is not None:
        _add_frames(elements.frames, elements.pool, now)
        _add_mutual(elements.mutual, now, fun)
        return _add_laws(elements.laws, elements, now, fun)
    return -1


@kernel
def _add_frames(frames, pool, now):
    if frames is not None:
        for k in range(frames.shape[0]):
            mi, mj = now.marker[frames[k]["I"]], now.marker[frames[k]["J"]]
            frame.pull(frames[k], pool, mi, mj, now.element)
            pair.add_wrenches(mi, mj, now.element.f, mi["W"], mj["W"])


@kernel
def _add_laws(laws, elements, now, fun):
    if laws is not None:
        for k in range(laws.shape[0]):
            row = laws[k]
            if measure.between_markers(row):
                mi, mj, g = now.marker[row["I"]], now.marker[row["J"]], now.element.E[0]
                if not measure.defined(row, mi, mj):
                    return k
                x, v = measure.between(row, mi, mj, g)
                u = measure.actuator(row, fun)
                f, _, _ = law.resistance(row, elements, now.element.stack, x, v, u)
                for c in range(6):
                    mi["W"][c] -= f * g[c]
                    mj["W"][c] -= f * g[6 + c]
    return -1


@kernel
def _add_mutual(loads, now, fun):
    if loads is not None:
        for k in range(loads.shape[0]):
            wj = now.marker[loads[k]["marker"]]["W"]
            wi = now.marker[loads[k]["other"]]["W"] if loads[k]["other"] >= 0 else wj
            mutual.add_wrenches(loads[k], now.marker, fun, 1.0, wi, wj)


@kernel
def put_coordinate_forces(elements, coordinates, now, fun, v, res):
    """Add the resistance of laws on scalar coordinates to the residual."""
    if elements is not None:
        _put_coordinate_forces(elements.laws, elements, coordinates, now, fun, v, res)


@kernel
def _put_coordinate_forces(laws, elements, coordinates, now, fun, v, res):
    if laws is not None and coordinates is not None:
        for k in range(laws.shape[0]):
            row = laws[k]
            if not measure.between_markers(row):
                s = coordinates[row["coordinate"]]
                x, rate = now.element.s[row["coordinate"]], v[s["iv"]]
                u = measure.actuator(row, fun)
                f, _, _ = law.resistance(row, elements, now.element.stack, x, rate, u)
                res[s["iv"]] += f


@kernel
def energy(elements, coordinates, now, v):
    """Energy stored in all elements, J; after position and velocity stages."""
    e = 0.0
    if elements is not None:
        e += _frame_energy(elements.frames, elements.pool, now)
        e += _law_energy(elements.laws, elements, coordinates, now, v)
    return e


@kernel
def _frame_energy(frames, pool, now):
    e = 0.0
    if frames is not None:
        for k in range(frames.shape[0]):
            mi, mj = now.marker[frames[k]["I"]], now.marker[frames[k]["J"]]
            e += frame.energy(frames[k], pool, mi, mj, now.element)
    return e


@kernel
def _law_energy(laws, elements, coordinates, now, v):
    e = 0.0
    if laws is not None:
        for k in range(laws.shape[0]):
            x, _ = measure.present(laws[k], coordinates, now, v)
            e += law.energy(laws[k], elements, now.element.stack, x)
    return e


@kernel
def damper_power(elements, coordinates, now, v):
    """Power of all dissipation on the system, W."""
    p = 0.0
    if elements is not None:
        p += _frame_dissipation(elements.frames, elements.pool, now)
        p += _law_dissipation(elements.laws, elements, coordinates, now, v)
    return p


@kernel
def _frame_dissipation(frames, pool, now):
    p = 0.0
    if frames is not None:
        for k in range(frames.shape[0]):
            mi, mj = now.marker[frames[k]["I"]], now.marker[frames[k]["J"]]
            p += frame.damper_power(frames[k], pool, mi, mj, now.element)
    return p


@kernel
def _law_dissipation(laws, elements, coordinates, now, v):
    p = 0.0
    if laws is not None:
        for k in range(laws.shape[0]):
            x, rate = measure.present(laws[k], coordinates, now, v)
            p += law.damper_power(laws[k], elements, now.element.stack, x, rate)
    return p


@kernel
def applied_power(elements, coordinates, now, fun, v):
    """Power of actuators and mutual loads on the system, W."""
    p = 0.0
    if elements is not None:
        p += _actuator_power(elements.laws, coordinates, now, fun, v)
        p += _mutual_power(elements.mutual, now, fun)
    return p


@kernel
def _actuator_power(laws, coordinates, now, fun, v):
    p = 0.0
    if laws is not None:
        for k in range(laws.shape[0]):
            _, rate = measure.present(laws[k], coordinates, now, v)
            p += measure.actuator(laws[k], fun) * rate
    return p


@kernel
def _mutual_power(loads, now, fun):
    p = 0.0
    if loads is not None:
        for k in range(loads.shape[0]):
            p += mutual.power(loads[k], now.marker, fun)
    return p


@kernel
def wrenches(elements, now, fun, what, k, w):
    """Add the wrenches of one element to w (12), global axes; returns its markers I and J.

    `what` is FRAME_WRENCH, LAW_WRENCH (between markers; on a coordinate it acts through the rows
    that follow it) or MUTUAL_WRENCH (without another marker on its own one alone).
    """
    if elements is not None:
        if what == FRAME_WRENCH:
            return _frame_wrenches(elements.frames, elements.pool, now, k, w)
        if what == LAW_WRENCH:
            return _law_wrenches(elements.laws, elements, now, fun, k, w)
        if what == MUTUAL_WRENCH:
            return _mutual_wrenches(elements.mutual, now, fun, k, w)
    return 0, 0


@kernel
def _frame_wrenches(frames, pool, now, k, w):
    if frames is not None:
        i, j = frames[k]["I"], frames[k]["J"]
        mi, mj = now.marker[i], now.marker[j]
        frame.pull(frames[k], pool, mi, mj, now.element)
        pair.add_wrenches(mi, mj, now.element.f, w[0:6], w[6:12])
        return i, j
    return 0, 0


@kernel
def _law_wrenches(laws, elements, now, fun, k, w):
    if laws is not None:
        row, g = laws[k], now.element.E[0]
        x, v = measure.between(row, now.marker[row["I"]], now.marker[row["J"]], g)
        u = measure.actuator(row, fun)
        f, _, _ = law.resistance(row, elements, now.element.stack, x, v, u)
        for c in range(12):
            w[c] -= f * g[c]
        return row["I"], row["J"]
    return 0, 0


@kernel
def _mutual_wrenches(loads, now, fun, k, w):
    if loads is not None:
        j = loads[k]["marker"]
        i = loads[k]["other"] if loads[k]["other"] >= 0 else j
        mutual.add_wrenches(loads[k], now.marker, fun, 1.0, w[0:6], w[6:12])
        return i, j
    return 0, 0
