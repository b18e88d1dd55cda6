"""How positions move: q ∘ exp(δ) and q̇ = N(q) v. The only place that knows the orientation part."""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import compose
from flexmb.engine.records import Vector
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
    """Weighted size of a correction that positions cannot show."""
    bodies, weights, q = run.system.parts.bodies, run.system.weights, run.state.q
    size = _ROUND_OFF
    for k in range(bodies.shape[0]):
        i, o = bodies[k]["iq"], bodies[k]["iv"]
        for a in range(3):
            size = max(size, _LAST_PLACES * abs(q[i + a]) * weights[o + a])
    return size
