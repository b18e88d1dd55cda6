"""How positions move: q ∘ exp(δ), q̇ = N(q) v, and the state within an accepted step.

The only place that knows the orientation part. Dense output is a cubic Hermite interpolation:
translations, modes and scalar coordinates from values and rates at both ends; orientations by the
rotation vector ψ(s) from the start, with ψ̇ = ω' + ½ ψ×ω' + ⅟₁₂ ψ×(ψ×ω') at the ends
(Iserles et al., Lie-group methods, Acta Numerica 9 (2000) 215, eq. 2.42). Error of order h⁴.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import compose, cross, rotation_vector
from flexmb.engine.jit import Vector, kernel, unit
from flexmb.engine.method import FINE
from flexmb.engine.state import Run
from flexmb.engine.tables import Parts

# Corrections of this size relative to the model, or of this many units in the last place of the
# positions where the model is far from the origin, are round-off.
_ROUND_OFF = 2e-15


_LAST_PLACES = 1e-15


@unit
def move(parts: Parts, q: Vector, dq: Vector, out: Vector) -> int:
    """out = q ∘ exp(dq): translations and modes add, rotation vectors act on the right."""
    bodies, coordinates = parts.bodies, parts.coordinates
    for k in range(coordinates.shape[0]):
        out[coordinates[k]["iq"]] = q[coordinates[k]["iq"]] + dq[coordinates[k]["iv"]]
    for k in range(bodies.shape[0]):
        body = bodies[k]
        i, o = body["iq"], body["iv"]
        out[i] = q[i] + dq[o]
        out[i + 1] = q[i + 1] + dq[o + 1]
        out[i + 2] = q[i + 2] + dq[o + 2]
        compose(q, i + 3, dq[o + 3], dq[o + 4], dq[o + 5], out, i + 3)
        for j in range(body["m"]):
            out[i + 7 + j] = q[i + 7 + j] + dq[o + 6 + j]
    return 0


@kernel
def position_rate(parts, q, v, out):
    """out (nq) = N(q) v; Euler parameters: ṗ = ½ p ∘ (0, ω')."""
    coordinates = parts.coordinates
    for k in range(coordinates.shape[0]):
        out[coordinates[k]["iq"]] = v[coordinates[k]["iv"]]
    for k in range(parts.bodies.shape[0]):
        body = parts.bodies[k]
        i, o = body["iq"], body["iv"]
        for a in range(3):
            out[i + a] = v[o + a]
        x, y, z = 0.5 * v[o + 3], 0.5 * v[o + 4], 0.5 * v[o + 5]
        e0, e1, e2, e3 = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        out[i + 3] = -e1 * x - e2 * y - e3 * z
        out[i + 4] = e0 * x + e2 * z - e3 * y
        out[i + 5] = e0 * y + e3 * x - e1 * z
        out[i + 6] = e0 * z + e1 * y - e2 * x
        for j in range(body["m"]):
            out[i + 7 + j] = v[o + 6 + j]


@kernel
def motion_of_rate(parts, q, rate, out):
    """out (nv): the velocities whose N(q) v is nearest to rate (nq)."""
    coordinates = parts.coordinates
    for k in range(coordinates.shape[0]):
        out[coordinates[k]["iv"]] = rate[coordinates[k]["iq"]]
    for k in range(parts.bodies.shape[0]):
        body = parts.bodies[k]
        i, o = body["iq"], body["iv"]
        for a in range(3):
            out[o + a] = rate[i + a]
        e0, e1, e2, e3 = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        d0, d1, d2, d3 = rate[i + 3], rate[i + 4], rate[i + 5], rate[i + 6]
        out[o + 3] = 2.0 * (e0 * d1 - e1 * d0 - e2 * d3 + e3 * d2)
        out[o + 4] = 2.0 * (e0 * d2 - e2 * d0 - e3 * d1 + e1 * d3)
        out[o + 5] = 2.0 * (e0 * d3 - e3 * d0 - e1 * d2 + e2 * d1)
        for j in range(body["m"]):
            out[o + 6 + j] = rate[i + 7 + j]


@kernel
def normalise(bodies, q):
    """Scale the Euler parameters of all bodies to length one."""
    for k in range(bodies.shape[0]):
        i = bodies[k]["iq"] + 3
        s = q[i] * q[i] + q[i + 1] * q[i + 1] + q[i + 2] * q[i + 2] + q[i + 3] * q[i + 3]
        s = 1.0 / math.sqrt(s)
        for a in range(4):
            q[i + a] *= s


@unit
def last_places(run: Run) -> float:
    """Weighted size of a correction that positions cannot show, nor what drivers turn or move."""
    bodies, weights, q = run.system.parts.bodies, run.system.weights, run.state.q
    rows, size = run.system.rows, _ROUND_OFF
    for k in range(bodies.shape[0]):
        i, o = bodies[k]["iq"], bodies[k]["iv"]
        for a in range(3):
            size = max(size, _LAST_PLACES * abs(q[i + a]) * weights[o + a])
    for r in range(rows.shape[0]):
        if rows[r]["fun"] >= 0:
            driven = abs(run.work.con.fun[rows[r]["fun"], 0])
            size = max(size, _LAST_PLACES * driven * run.system.row_weights[r])
    return size


@kernel
def hermite(s, h, y0, y1, d0, d1):
    """Value and rate at the share s of a step h of the cubic with values y and rates d."""
    a, b = y1 - y0, h * d0
    c2 = 3.0 * a - 2.0 * b - h * d1
    c3 = b + h * d1 - 2.0 * a
    return y0 + s * (b + s * (c2 + s * c3)), (b + s * (2.0 * c2 + 3.0 * s * c3)) / h


@kernel
def interpolate_step(run, share):
    """Put q, v and works at a share of the last accepted step into the trial state."""
    st, tr, before = run.state, run.work.trial, run.work.trial.before
    h = st.t[0] - before.t[0]
    _interpolate_state(run.system.parts, before, h, st.q, st.v, share, tr.q, tr.v)
    for k in range(3):
        tr.work_done[k], _ = hermite(
            share, h, before.work_done[k], st.work_done[k], before.power[k], st.power[k]
        )
    return FINE


@kernel
def _interpolate_state(parts, before, h, q1, v1, share, q, v):
    """q and v at the share of the step h from `before` to q1, v1."""
    for k in range(parts.bodies.shape[0]):
        iq, iv = parts.bodies[k]["iq"], parts.bodies[k]["iv"]
        _interpolate_rotation(before.q, before.v, q1, v1, iq + 3, iv + 3, share, h, q, v)
        for i in range(3):
            q[iq + i], v[iv + i] = hermite(
                share, h, before.q[iq + i], q1[iq + i], before.v[iv + i], v1[iv + i]
            )
        for i in range(parts.bodies[k]["m"]):
            a, b = iq + 7 + i, iv + 6 + i
            q[a], v[b] = hermite(share, h, before.q[a], q1[a], before.v[b], v1[b])
    _interpolate_coordinates(parts.coordinates, before, h, q1, v1, share, q, v)


@kernel
def _interpolate_rotation(q0, v0, q1, v1, i, j, share, h, q, v):
    x, y, z = rotation_vector(q0, i, q1, i)
    a, b, c = v1[j], v1[j + 1], v1[j + 2]
    ax, ay, az = cross(x, y, z, a, b, c)
    bx, by, bz = cross(x, y, z, ax, ay, az)
    x, u = hermite(share, h, 0.0, x, v0[j], a + 0.5 * ax + bx / 12.0)
    y, w = hermite(share, h, 0.0, y, v0[j + 1], b + 0.5 * ay + by / 12.0)
    z, r = hermite(share, h, 0.0, z, v0[j + 2], c + 0.5 * az + bz / 12.0)
    compose(q0, i, x, y, z, q, i)
    ax, ay, az = cross(x, y, z, u, w, r)
    bx, by, bz = cross(x, y, z, ax, ay, az)
    v[j] = u - 0.5 * ax + bx / 6.0
    v[j + 1] = w - 0.5 * ay + by / 6.0
    v[j + 2] = r - 0.5 * az + bz / 6.0


@kernel
def _interpolate_coordinates(coordinates, before, h, q1, v1, share, q, v):
    for k in range(coordinates.shape[0]):
        a, b = coordinates[k]["iq"], coordinates[k]["iv"]
        q[a], v[b] = hermite(share, h, before.q[a], q1[a], before.v[b], v1[b])
