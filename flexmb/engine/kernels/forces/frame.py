"""Bushing and beam: six forces and moments between two markers, linear in their relative motion.

With the deflection x = (u − u0, φ) of `pair` the potential is V = p0·x + ½ xᵀ K x, the dissipation
ẋᵀ C ẋ. The pull of J to I is f = ∂V/∂u + (C ẋ)_u and m = Gᵀ (∂V/∂φ + (C ẋ)_φ), φ̇ = G ω, so that
its power is exactly −dV/dt − ẋᵀ C ẋ, also at large angles (below half a turn). At small angles it
is the bushing and the beam of MSC Adams (BUSHING, BEAM), K of the latter that of Timoshenko's
cantilever (Przemieniecki, Theory of Matrix Structural Analysis, 1968, sec. 5.6).
A row of the pool holds u0 (3), p0 (6), K (6, 6), C (6, 6).
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.forces import pair

P0, STIFFNESS, DAMPING = 3, 9, 45  # where they begin in a row of the pool


@kernel
def _deflect(frame, pool, mi, mj, s):
    """s.x = deflection; the rate as in `pair`."""
    at = frame["at"]
    pair.relative_motion(mi, mj, s)
    for a in range(3):
        s.x[a] -= pool[at + a]


@kernel
def _rotation_rate(s):
    """φ̇ = G ω."""
    return pair.inverse_tangent(s.x, 3, 1.0, s.rate[3], s.rate[4], s.rate[5])


@kernel
def pull(frame, pool, mi, mj, s):
    """s.f, the pull of J to I in axes of I, with s.x, s.rate and s.p."""
    at = frame["at"]
    _deflect(frame, pool, mi, mj, s)
    for r in range(6):
        s.p[r] = pool[at + P0 + r]
        for c in range(6):
            s.p[r] += pool[at + STIFFNESS + 6 * r + c] * s.x[c]
    if frame["damped"] == 1:
        x, y, z = _rotation_rate(s)
        for r in range(6):
            k = at + DAMPING + 6 * r
            for c in range(3):
                s.p[r] += pool[k + c] * s.rate[c]
            s.p[r] += pool[k + 3] * x + pool[k + 4] * y + pool[k + 5] * z
    put(s.f, 0, s.p[0], s.p[1], s.p[2])
    x, y, z = pair.inverse_tangent(s.x, 3, -1.0, s.p[3], s.p[4], s.p[5])
    put(s.f, 3, x, y, z)


@kernel
def _times(pool, k, x, y, z):
    """Three numbers of the pool times (x, y, z)."""
    return pool[k] * x + pool[k + 1] * y + pool[k + 2] * z


@kernel
def linearise(frame, pool, s):
    """s.K and s.C after `pull`: change of s.f per (δu, δθ) at constant (u̇, ω), and per (u̇, ω)."""
    at, w, p, phi = frame["at"], s.rate, s.p, s.x
    for j in range(6):
        b = 0 if j < 3 else 3
        dx, dy, dz = 1.0 * (j == b), 1.0 * (j == b + 1), 1.0 * (j == b + 2)
        gx, gy, gz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if b == 3:
            dx, dy, dz = pair.inverse_tangent(phi, 3, 1.0, dx, dy, dz)
            gx, gy, gz = pair.inverse_tangent_slope(phi, 3, 1.0, w[3], w[4], w[5], dx, dy, dz)
            tx, ty, tz = pair.inverse_tangent_slope(phi, 3, -1.0, p[3], p[4], p[5], dx, dy, dz)
        for r in range(6):
            k, c = at + STIFFNESS + 6 * r, at + DAMPING + 6 * r
            s.K[r, j] = _times(pool, k + b, dx, dy, dz)
            s.C[r, j] = _times(pool, c + b, dx, dy, dz)
            if frame["damped"] == 1:
                s.K[r, j] += _times(pool, c + 3, gx, gy, gz)
        x, y, z = pair.inverse_tangent(phi, 3, -1.0, s.K[3, j], s.K[4, j], s.K[5, j])
        s.K[3, j], s.K[4, j], s.K[5, j] = x + tx, y + ty, z + tz
        x, y, z = pair.inverse_tangent(phi, 3, -1.0, s.C[3, j], s.C[4, j], s.C[5, j])
        s.C[3, j], s.C[4, j], s.C[5, j] = x, y, z


@kernel
def energy(frame, pool, mi, mj, s):
    """p0·x + ½ xᵀ K x, J."""
    at = frame["at"]
    _deflect(frame, pool, mi, mj, s)
    e = 0.0
    for r in range(6):
        e += pool[at + P0 + r] * s.x[r]
        for c in range(6):
            e += 0.5 * s.x[r] * pool[at + STIFFNESS + 6 * r + c] * s.x[c]
    return e


@kernel
def damper_power(frame, pool, mi, mj, s):
    """−ẋᵀ C ẋ, W."""
    if frame["damped"] == 0:
        return 0.0
    at, power = frame["at"], 0.0
    _deflect(frame, pool, mi, mj, s)
    x, y, z = _rotation_rate(s)
    put(s.rate, 3, x, y, z)
    for r in range(6):
        for c in range(6):
            power -= s.rate[r] * pool[at + DAMPING + 6 * r + c] * s.rate[c]
    return power
