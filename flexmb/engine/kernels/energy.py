"""Energies of the system and the powers of what is not conservative."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import transform
from flexmb.engine.kernels.algebra.vector import dot
from flexmb.engine.kernels.bodies.inertia_tangent import mass_block
from flexmb.engine.kernels.forces import contact, element, force
from flexmb.engine.kernels.joints import coordinate


@kernel
def kinetic(parts, now, v, B):
    """½ vᵀ M v, J; after a position stage. B is scratch for one body's M."""
    e = coordinate.kinetic(parts.coordinates, v)
    for i in range(parts.bodies.shape[0]):
        e += body_kinetic(parts, now, v, i, B)
    return e


@kernel
def body_kinetic(parts, now, v, i, B):
    """½ vᵀ M v of one body, J."""
    e = 0.0
    o, n = parts.bodies[i]["iv"], 6 + parts.bodies[i]["m"]
    mass_block(parts.bodies[i], now.body[i], parts.pool, now.Z, B)
    for r in range(n):
        for c in range(n):
            e += 0.5 * v[o + r] * B[r, c] * v[o + c]
    return e


@kernel
def strain(parts, q):
    """½ ηᵀ K η, J."""
    e = 0.0
    for i in range(parts.bodies.shape[0]):
        e += body_strain(parts, q, i)
    return e


@kernel
def body_strain(parts, q, i):
    """½ ηᵀ K η of one body, J."""
    body, e = parts.bodies[i], 0.0
    m, o = body["m"], body["iq"] + 7
    at = body["flex"] + 12 * m + 13 * m * m
    for r in range(m):
        e += 0.5 * q[o + r] * dot(parts.pool, at + r * m, q, o, m)
    return e


@kernel
def gravitational(parts, now, q):
    """−Σ g·(m r + A c), J."""
    e = 0.0
    for i in range(parts.bodies.shape[0]):
        e += body_weight(parts, now, q, i)
    return e


@kernel
def body_weight(parts, now, q, i):
    """−g·(m r + A c) of one body, J."""
    g, o, m = parts.gravity, parts.bodies[i]["iq"], parts.bodies[i]["mass"]
    c = now.body[i]["c"]
    x, y, z = transform(now.body[i]["A"], c[0], c[1], c[2])
    return -g[0] * (m * q[o] + x) - g[1] * (m * q[o + 1] + y) - g[2] * (m * q[o + 2] + z)


@kernel
def _modal_damping_power(parts, v):
    """−η̇ᵀ D η̇, W."""
    p = 0.0
    for i in range(parts.bodies.shape[0]):
        body = parts.bodies[i]
        if body["damped"] == 1:
            m, o = body["m"], body["iv"] + 6
            at = body["flex"] + 12 * m + 14 * m * m
            for r in range(m):
                p -= v[o + r] * dot(parts.pool, at + r * m, v, o, m)
    return p


@kernel
def _driver_power(rows, fun, lam):
    """Σ −λ ḟ over the rows with a function of time, W."""
    p = 0.0
    for k in range(rows.shape[0]):
        f = rows[k]["fun"]
        if f >= 0 and rows[k]["follows"] == 0:
            p -= lam[k] * fun[f, 1]
    return p


@kernel
def powers(sys, now, fun, v, lam, out):
    """out (3): power of drivers, of dampers, of applied forces; after the velocity stage."""
    out[0] = _driver_power(sys.rows, fun, lam)
    out[1] = force.damper_power(sys.springs, now.marker) + _modal_damping_power(sys.parts, v)
    out[1] += coordinate.damper_power(sys.parts.coordinates, v)
    out[1] += contact.power(sys.contacts, now)
    out[1] += element.damper_power(sys.elements, sys.parts.coordinates, now, v)
    out[2] = force.load_power(sys.loads, now.marker, fun)
    out[2] += coordinate.force_power(sys.parts.coordinates, fun, v)
    out[2] += element.applied_power(sys.elements, sys.parts.coordinates, now, fun, v)
