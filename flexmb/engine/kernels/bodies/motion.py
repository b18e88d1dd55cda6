"""How positions move: q ∘ exp(δ) and q̇ = N(q) v. The only place that knows the orientation part."""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import compose
from flexmb.engine.records import Vector
from flexmb.engine.tables import Parts


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
def normalise(bodies, q):
    """Scale the Euler parameters of all bodies to length one."""
    for k in range(bodies.shape[0]):
        i = bodies[k]["iq"] + 3
        s = q[i] * q[i] + q[i + 1] * q[i + 1] + q[i + 2] * q[i + 2] + q[i + 3] * q[i + 3]
        s = 1.0 / math.sqrt(s)
        for a in range(4):
            q[i + a] *= s
