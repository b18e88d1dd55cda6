"""Vectors in flat arrays, vectors of three numbers as tuples, and rotations, for all kernels.

Euler parameters p = (e0, e1, e2, e3), scalar first, map body axes to global axes: x = A(p) x'.
A rotation vector θ in body axes is applied on the right, p ∘ exp(θ). The tangent
T(θ) = I − c1 θ̃ + c2 θ̃², c1 = (1 − cos θ)/θ², c2 = (θ − sin θ)/θ³, gives the angular velocity of
exp(θ̃) in the axes it starts from as Tᵀ θ̇ (Géradin & Cardona, Flexible Multibody Dynamics, 2001,
ch. 4).
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.engine.jit import kernel

# Below this angle² the closed forms lose digits by cancellation; the series that replace them have
# a remainder of x⁴/10⁶, which is below round-off there.
_SERIES = 1e-3
# If a squared length differs from one by less than this, no square root is needed to normalise.
_NEAR_ONE = 1e-8
_TURN = 2.0 * math.pi


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
    # near one: a step of Newton's method, whose error is the square of the difference
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


_SMALLEST = 1e-150  # products of two such numbers are still normal


@kernel
def zero(a):
    """a = 0."""
    for i in range(a.shape[0]):
        a[i] = 0.0


@kernel
def copy(a, b):
    """b = a."""
    for i in range(a.shape[0]):
        b[i] = a[i]


@kernel
def store(a, b):
    """b = a, with numbers below `_SMALLEST` set to zero.

    A decaying motion would end in denormal numbers, with which operations take a hundred times as
    long.
    """
    for i in range(a.shape[0]):
        b[i] = 0.0 if abs(a[i]) < _SMALLEST else a[i]


@kernel
def dot(a, i, b, j, n):
    """a[i:i+n]·b[j:j+n].

    Unsigned indices cannot count from the end, so that the compiler vectorises the loop.
    """
    s, i, j = 0.0, np.uintp(i), np.uintp(j)
    for k in range(np.uintp(n)):
        s += a[i + k] * b[j + k]
    return s


@kernel
def add_multiple(f, a, i, b, j, n):
    """b[j:j+n] += f a[i:i+n]."""
    i, j = np.uintp(i), np.uintp(j)
    for k in range(np.uintp(n)):
        b[j + k] += f * a[i + k]


@kernel
def larger(a, b):
    """The larger of two numbers; NaN counts as largest."""
    return a if a > b or a != a else b


@kernel
def largest(x):
    """Largest |x_i|; NaN counts as largest."""
    s = 0.0
    for i in range(x.shape[0]):
        if not abs(x[i]) <= s:
            s = abs(x[i])
            if s != s:
                break
    return s


@kernel
def weighted_max(x, weights):
    """Largest |x_i| weight_i; NaN counts as largest."""
    size = 0.0
    for i in range(x.shape[0]):
        s = abs(x[i]) * weights[i]
        if not s <= size:
            size = s
            if s != s:
                break
    return size


@kernel
def scaled_max(x, weights, scale):
    """Largest ratio of weighted |x_i| to its scale; NaN counts as largest."""
    size = 0.0
    for i in range(x.shape[0]):
        s = abs(x[i]) * weights[i] / scale[i]
        if not s <= size:
            size = s
            if s != s:
                break
    return size


@kernel
def scaled_max_above(x, weights, scale, times, noise):
    """Largest weighted |x_i| beyond `times` its noise, over its scale; NaN counts as largest."""
    size = 0.0
    for i in range(x.shape[0]):
        s = (abs(x[i]) * weights[i] - times * noise[i]) / scale[i]
        if not s <= size:
            size = s
            if s != s:
                break
    return size


@kernel
def triple(a):
    """The first three numbers of an array."""
    return a[0], a[1], a[2]


@kernel
def part(a, o):
    """Three numbers of an array from o on."""
    return a[o], a[o + 1], a[o + 2]


@kernel
def put_part(out, o, a):
    """out[o:o+3] = a."""
    out[o], out[o + 1], out[o + 2] = a


@kernel
def add_part(out, o, f, a):
    """out[o:o+3] += f a."""
    out[o] += f * a[0]
    out[o + 1] += f * a[1]
    out[o + 2] += f * a[2]


@kernel
def column(R, k):
    """Column k of a matrix."""
    return R[0, k], R[1, k], R[2, k]


@kernel
def put_column(R, k, a):
    """Column k of a matrix = a."""
    R[0, k], R[1, k], R[2, k] = a


@kernel
def axis_vector(k):
    """Unit vector of axis k."""
    return 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0


@kernel
def plus(a, f, b):
    """a + f b."""
    return a[0] + f * b[0], a[1] + f * b[1], a[2] + f * b[2]


@kernel
def times(f, a):
    """f a."""
    return f * a[0], f * a[1], f * a[2]


@kernel
def inner(a, b):
    """a·b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def turned(R, a):
    """R a."""
    x, y, z = a[0], a[1], a[2]
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@kernel
def symmetric_times(d, s, a):
    """A symmetric matrix by its diagonal d and s = (xy, yz, zx), times a."""
    y = s[0] * a[0] + d[1] * a[1] + s[1] * a[2]
    return d[0] * a[0] + s[0] * a[1] + s[2] * a[2], y, s[2] * a[0] + s[1] * a[1] + d[2] * a[2]


@kernel
def turned_back(R, a):
    """Rᵀ a."""
    x, y, z = a[0], a[1], a[2]
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@kernel
def turned_by(th, f, g, a):
    """(I + f θ̃ + g θ̃²) a."""
    x = cross(th, a)
    return plus(plus(a, f, x), g, cross(th, x))


@kernel
def modal_vector(pool, at, m, v, o):
    """Three rows of the pool, starting at `at`, times v[o:o+m]."""
    return rows_times(pool, at, m, m, v, o)


@kernel
def rows_times(a, at, apart, m, v, o):
    """Three rows of m numbers of a, the first at `at`, `apart` from each other, times v[o:o+m]."""
    x, y, z = 0.0, 0.0, 0.0
    i, o = np.uintp(at), np.uintp(o)
    j, k = i + np.uintp(apart), i + np.uintp(2 * apart)
    for n in range(np.uintp(m)):
        s = v[o + n]
        x += a[i + n] * s
        y += a[j + n] * s
        z += a[k + n] * s
    return x, y, z


@kernel
def mode_vector(pool, at, m):
    """One column, of a mode, of three rows of m numbers of the pool; it begins at `at`."""
    return pool[at], pool[at + m], pool[at + 2 * m]


@kernel
def wrapped(angle):
    """Angle within ±π."""
    return angle - _TURN * np.floor(angle / _TURN + 0.5)


@kernel
def add_skew_product(H, i, j, f, p, q):
    """Add f p~ q~ = f (q pᵀ − (p·q) I) to the 3 × 3 block at (i, j)."""
    dot = f * inner(p, q)
    for k in range(3):
        add_column(H, i, j + k, f * p[k], q)
        H[i + k, j + k] -= dot


@kernel
def clear(B, n, m):
    """B[:n, :m] = 0."""
    for r in range(n):
        for c in range(m):
            B[r, c] = 0.0


@kernel
def add_column(B, i, j, f, a):
    """Add f a to column j of B from row i."""
    B[i, j] += f * a[0]
    B[i + 1, j] += f * a[1]
    B[i + 2, j] += f * a[2]


@kernel
def add_skew(B, i, j, f, a):
    """Add f ã to the 3 × 3 block of B at (i, j)."""
    add_column(B, i, j, f, (0.0, a[2], -a[1]))
    add_column(B, i, j + 1, f, (-a[2], 0.0, a[0]))
    add_column(B, i, j + 2, f, (a[1], -a[0], 0.0))
