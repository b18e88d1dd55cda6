"""Dense output: the state inside an accepted step, by cubic Hermite interpolation.

Translations, modes and scalar coordinates from values and rates at both ends; orientations by the
rotation vector ψ(s) from the start, with ψ̇ = ω' + ½ ψ×ω' + ⅟₁₂ ψ×(ψ×ω') at the ends
(Iserles et al., Lie-group methods, Acta Numerica 9 (2000) 215, eq. 2.42). Error of order h⁴.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import compose, cross
from flexmb.engine.method import FINE


@kernel
def hermite(s, h, y0, y1, d0, d1):
    """Value and rate at the share s of a step h of the cubic with values y and rates d."""
    a, b = y1 - y0, h * d0
    c2 = 3.0 * a - 2.0 * b - h * d1
    c3 = b + h * d1 - 2.0 * a
    return y0 + s * (b + s * (c2 + s * c3)), (b + s * (2.0 * c2 + 3.0 * s * c3)) / h


@kernel
def rotation_vector(p, i, q, j):
    """ψ with q = p ∘ exp(ψ), |ψ| ≤ π, of Euler parameters at p[i:] and q[j:]."""
    a, b, c, d = p[i], p[i + 1], p[i + 2], p[i + 3]
    e, f, g, k = q[j], q[j + 1], q[j + 2], q[j + 3]
    w = a * e + b * f + c * g + d * k
    x = a * f - b * e - c * k + d * g
    y = a * g + b * k - c * e - d * f
    z = a * k - b * g + c * f - d * e
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    n = math.sqrt(x * x + y * y + z * z)
    f = 2.0 * math.atan2(n, w) / n if n > 0.0 else 2.0
    return f * x, f * y, f * z


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
