"""Energies of bodies and the power of their damping; the kinds of bodies."""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.rotation import transform
from flexmb.engine.kernels.algebra.triple import inner, part, turned
from flexmb.engine.kernels.algebra.vector import dot
from flexmb.engine.kernels.bodies import inertia, inertia_tangent
from flexmb.engine.kernels.bodies.inertia import Bodies
from flexmb.engine.kernels.bodies.kinematics import modal_vector
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run


@kernel
def rigid_kinetic(parts, now, v, i):
    """½ vᵀ M v of one body without its modes, J: ½ m ṙ² + ṙ·A(ω'×c) + ½ ω'·J ω'."""
    o, bn, mass = parts.bodies[i]["iv"], now.body[i], parts.bodies[i]["mass"]
    c, J = bn["c"], bn["J"]
    wx, wy, wz = v[o + 3], v[o + 4], v[o + 5]
    x = wy * c[2] - wz * c[1]
    y = wz * c[0] - wx * c[2]
    z = wx * c[1] - wy * c[0]
    x, y, z = transform(bn["A"], x, y, z)
    hx, hy, hz = transform(J, wx, wy, wz)
    e = 0.5 * mass * (v[o] * v[o] + v[o + 1] * v[o + 1] + v[o + 2] * v[o + 2])
    e += v[o] * x + v[o + 1] * y + v[o + 2] * z
    return e + 0.5 * (wx * hx + wy * hy + wz * hz)


@kernel
def _modal_form(parts, i, block, x, o):
    """yᵀ A y of one body, y = x[o:o+m], A an (m, m) block of its pool: 12 is M_ηη, 13 K, 14 D."""
    m, e = parts.bodies[i]["m"], 0.0
    at = parts.bodies[i]["flex"] + 12 * m + block * m * m
    for r in range(m):
        e += x[o + r] * dot(parts.pool, at + r * m, x, o, m)
    return e


@kernel
def _strain(parts, q, i):
    """½ ηᵀ K η of one body, J."""
    return 0.5 * _modal_form(parts, i, 13, q, parts.bodies[i]["iq"] + 7)


@kernel
def body_weight(parts, now, q, i):
    """−g·(m r + A c) of one body, J."""
    g, o, m = parts.gravity, parts.bodies[i]["iq"], parts.bodies[i]["mass"]
    c = now.body[i]["c"]
    x, y, z = transform(now.body[i]["A"], c[0], c[1], c[2])
    return -g[0] * (m * q[o] + x) - g[1] * (m * q[o + 1] + y) - g[2] * (m * q[o + 2] + z)


@unit
def frame_energy(run: Run, i: int, what: int, at: Point) -> float:
    """Kinetic energy (0), without what modes add, or gravity energy (2) of one body, J."""
    if what == 0:
        return rigid_kinetic(run.system.parts, run.work.now, at.v, i)
    return body_weight(run.system.parts, run.work.now, at.q, i)


@kernel
def _modal_kinetic(parts, now, v, i):
    """What the modes add to the kinetic energy: ṙ·A p η̇ + ω'·M_ωη η̇ + ½ η̇ᵀ M_ηη η̇."""
    body = parts.bodies[i]
    m, o = body["m"], body["iv"]
    x = turned(now.body[i]["A"], modal_vector(parts.pool, body["flex"], m, v, o + 6))
    y = modal_vector(now.Z, body["z"] + 9 * m, m, v, o + 6)
    e = inner(part(v, o), x) + inner(part(v, o + 3), y)
    return e + 0.5 * _modal_form(parts, i, 12, v, o + 6)


@unit
def body_energy(run: Run, i: int, what: int, at: Point) -> float:
    """Kinetic (0), strain (1) or gravity (2) energy of one body, J; after a velocity stage."""
    parts = run.system.parts
    if what == 1:
        return _strain(parts, at.q, i)
    e = frame_energy(run, i, what, at)
    if what == 0 and parts.bodies[i]["m"] > 0:
        e += _modal_kinetic(parts, run.work.now, at.v, i)
    return e


@unit
def rigid_energies(run: Run, of: Bodies, at: Point) -> int:
    """Kinetic and gravity energy of rigid bodies."""
    out, rows = run.work.energies, of.rows
    for n in range(rows.shape[0]):
        out[0] += frame_energy(run, rows[n], 0, at)
        out[2] += frame_energy(run, rows[n], 2, at)
    return FINE


@unit
def flexible_energies(run: Run, of: Bodies, at: Point) -> int:
    """Kinetic, strain and gravity energy of flexible bodies."""
    parts, rows, out = run.system.parts, of.rows, run.work.energies
    rigid_energies(run, of, at)
    for n in range(rows.shape[0]):
        out[0] += _modal_kinetic(parts, run.work.now, at.v, rows[n])
        out[1] += _strain(parts, at.q, rows[n])
    return FINE


@unit
def damping_power(run: Run, of: Bodies, at: Point) -> int:
    """−η̇ᵀ D η̇ of flexible bodies."""
    parts, rows, out = run.system.parts, of.rows, run.work.powers
    for n in range(rows.shape[0]):
        if parts.bodies[rows[n]]["damped"] == 1:
            out[1] -= _modal_form(parts, rows[n], 14, at.v, parts.bodies[rows[n]]["iv"] + 6)
    return FINE


RIGID_BODIES = Kind(
    "rigid_bodies",
    Bodies,
    {
        "constants": inertia.prepare_rigid,
        "position": inertia.turn_bodies,
        "force": inertia.rigid_inertia_forces,
        "matrix": inertia_tangent.rigid_matrix,
        "mass": inertia_tangent.rigid_mass_product,
        "energy": rigid_energies,
    },
)
FLEXIBLE_BODIES = Kind(
    "flexible_bodies",
    Bodies,
    {
        "position": inertia.turn_bodies,
        "inertia": inertia.prepare_flexible,
        "force": inertia.flexible_inertia_forces,
        "matrix": inertia_tangent.flexible_matrix,
        "mass": inertia_tangent.flexible_mass_product,
        "energy": flexible_energies,
        "power": damping_power,
    },
    stiff=True,
)
