"""Rotations on arrays: Euler parameters, the exponential map and its tangent.

Euler parameters p = (e0, e1, e2, e3), scalar first, map body axes to global axes: x = A(p) x'.
A rotation vector θ in body axes is applied on the right, p ∘ exp(θ). The tangent
T(θ) = I − c1 θ̃ + c2 θ̃², c1 = (1 − cos θ)/θ², c2 = (θ − sin θ)/θ³, gives the angular velocity of
exp(θ̃) in the axes it starts from as Tᵀ θ̇ (Géradin & Cardona, Flexible Multibody Dynamics, 2001,
ch. 4).
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel

# Below this angle² the closed forms lose digits to cancellation; the series used instead have a
# remainder of x⁴/10⁶, below round-off there.
_SERIES = 1e-3


# Squares of lengths this near to one need no square root.
_NEAR_ONE = 1e-8


@kernel
def rotation_matrix(p, o, A):
    """Direction-cosine matrix A (3, 3) of the Euler parameters p[o:o+4]."""
    e0, e1, e2, e3 = p[o], p[o + 1], p[o + 2], p[o + 3]
    A[0, 0] = 1.0 - 2.0 * (e2 * e2 + e3 * e3)
    A[0, 1] = 2.0 * (e1 * e2 - e0 * e3)
    A[0, 2] = 2.0 * (e1 * e3 + e0 * e2)
    A[1, 0] = 2.0 * (e1 * e2 + e0 * e3)
    A[1, 1] = 1.0 - 2.0 * (e1 * e1 + e3 * e3)
    A[1, 2] = 2.0 * (e2 * e3 - e0 * e1)
    A[2, 0] = 2.0 * (e1 * e3 - e0 * e2)
    A[2, 1] = 2.0 * (e2 * e3 + e0 * e1)
    A[2, 2] = 1.0 - 2.0 * (e1 * e1 + e2 * e2)


@kernel
def compose(p, o, x, y, z, out, oo):
    """out[oo:oo+4] = p[o:o+4] ∘ exp((x, y, z)), normalised; rotation vector in body axes."""
    s2 = 0.25 * (x * x + y * y + z * z)
    if s2 < _SERIES:
        c = 1.0 - s2 * (0.5 - s2 * (1.0 / 24.0 - s2 / 720.0))
        s = 0.5 * (1.0 - s2 * (1.0 / 6.0 - s2 * (1.0 / 120.0 - s2 / 5040.0)))
    else:
        half = math.sqrt(s2)
        c = math.cos(half)
        s = 0.5 * math.sin(half) / half
    f1, f2, f3 = s * x, s * y, s * z
    e0, e1, e2, e3 = p[o], p[o + 1], p[o + 2], p[o + 3]
    a = e0 * c - e1 * f1 - e2 * f2 - e3 * f3
    b = e0 * f1 + e1 * c + e2 * f3 - e3 * f2
    d = e0 * f2 - e1 * f3 + e2 * c + e3 * f1
    g = e0 * f3 + e1 * f2 - e2 * f1 + e3 * c
    n2 = a * a + b * b + d * d + g * g
    # near one a step of Newton's method, exact to the square of the distance
    n = 1.5 - 0.5 * n2 if abs(n2 - 1.0) < _NEAR_ONE else 1.0 / math.sqrt(n2)
    out[oo] = a * n
    out[oo + 1] = b * n
    out[oo + 2] = d * n
    out[oo + 3] = g * n


@kernel
def tangent_coefficients(x):
    """c1, c2 of T(θ) and their derivatives with respect to x = θ² (four numbers)."""
    if x < 1e-2:
        c1 = 0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x * (1.0 / 40320.0 - x / 3628800.0)))
        c2 = 1.0 / 362880.0 - x / 39916800.0
        c2 = 1.0 / 6.0 - x * (1.0 / 120.0 - x * (1.0 / 5040.0 - x * c2))
        d1 = -1.0 / 24.0 + x * (1.0 / 360.0 - x * (1.0 / 13440.0 - x / 907200.0))
        d2 = -1.0 / 120.0 + x * (1.0 / 2520.0 - x * (1.0 / 120960.0 - x / 9979200.0))
        return c1, c2, d1, d2
    t = math.sqrt(x)
    sn, cs = math.sin(t), math.cos(t)
    c1 = (1.0 - cs) / x
    c2 = (t - sn) / (x * t)
    d1 = (0.5 * sn / t - c1) / x
    d2 = 0.5 * (c1 - 3.0 * c2) / x
    return c1, c2, d1, d2


@kernel
def transform(A, x, y, z):
    """A (x, y, z) as three numbers."""
    return (
        A[0, 0] * x + A[0, 1] * y + A[0, 2] * z,
        A[1, 0] * x + A[1, 1] * y + A[1, 2] * z,
        A[2, 0] * x + A[2, 1] * y + A[2, 2] * z,
    )


@kernel
def transform_back(A, x, y, z):
    """Aᵀ (x, y, z) as three numbers."""
    return (
        A[0, 0] * x + A[1, 0] * y + A[2, 0] * z,
        A[0, 1] * x + A[1, 1] * y + A[2, 1] * z,
        A[0, 2] * x + A[1, 2] * y + A[2, 2] * z,
    )


@kernel
def cross(ax, ay, az, bx, by, bz):
    """a × b as three numbers."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


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
