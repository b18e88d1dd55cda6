"""Force elements beside plain springs and loads: what they do to markers and coordinates.

`elements` holds bushings and beams (`frame`), laws of one measure (`law`, `measure`) and mutual
loads (`mutual`); a table that is None costs nothing.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels import frame, law, measure, mutual, pair
from flexmb.engine.kernels.rotation import transform_back
from flexmb.engine.kernels.vector import put


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
def put_coordinate_forces(elements, coordinates, now, fun, q, v, res):
    """Add the resistance of laws on scalar coordinates to the residual."""
    if elements is not None:
        _put_coordinate_forces(elements.laws, elements, coordinates, now, fun, q, v, res)


@kernel
def _put_coordinate_forces(laws, elements, coordinates, now, fun, q, v, res):
    if laws is not None and coordinates is not None:
        for k in range(laws.shape[0]):
            row = laws[k]
            if not measure.between_markers(row):
                s = coordinates[row["coordinate"]]
                x, rate, u = q[s["iq"]], v[s["iv"]], measure.actuator(row, fun)
                f, _, _ = law.resistance(row, elements, now.element.stack, x, rate, u)
                res[s["iv"]] += f


@kernel
def energy(elements, coordinates, now, fun, v):
    """Energy stored in all elements, J; after position and velocity stages."""
    e = 0.0
    if elements is not None:
        e += _frame_energy(elements.frames, elements.pool, now)
        e += _law_energy(elements.laws, elements, coordinates, now, fun, v)
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
def _law_energy(laws, elements, coordinates, now, fun, v):
    e = 0.0
    if laws is not None:
        for k in range(laws.shape[0]):
            x, _ = measure.present(laws[k], coordinates, now, fun, v)
            e += law.energy(laws[k], elements, now.element.stack, x)
    return e


@kernel
def damper_power(elements, coordinates, now, fun, v):
    """Power of all dissipation on the system, W."""
    p = 0.0
    if elements is not None:
        p += _frame_dissipation(elements.frames, elements.pool, now)
        p += _law_dissipation(elements.laws, elements, coordinates, now, fun, v)
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
def _law_dissipation(laws, elements, coordinates, now, fun, v):
    p = 0.0
    if laws is not None:
        for k in range(laws.shape[0]):
            x, rate = measure.present(laws[k], coordinates, now, fun, v)
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
            _, rate = measure.present(laws[k], coordinates, now, fun, v)
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
def frame_wrench(frames, pool, now, k, out):
    """out (6): force and moment of bushing or beam k on marker J, in the axes of marker I."""
    if frames is not None:
        mi, mj = now.marker[frames[k]["I"]], now.marker[frames[k]["J"]]
        frame.pull(frames[k], pool, mi, mj, now.element)
        for c in range(6):
            out[c] = -now.element.f[c]


@kernel
def law_wrench(laws, elements, coordinates, now, fun, v, k, out):
    """out (6): force and moment of law k on marker J, in the axes of marker I.

    A law on a coordinate acts through the rows that follow it: see their reactions.
    """
    put(out, 0, 0.0, 0.0, 0.0)
    put(out, 3, 0.0, 0.0, 0.0)
    if laws is not None and measure.between_markers(laws[k]):
        row, g, R = laws[k], now.element.E[0], now.marker[laws[k]["I"]]["R"]
        x, rate = measure.present(row, coordinates, now, fun, v)
        u = measure.actuator(row, fun)
        f, _, _ = law.resistance(row, elements, now.element.stack, x, rate, u)
        x, y, z = transform_back(R, -f * g[6], -f * g[7], -f * g[8])
        put(out, 0, x, y, z)
