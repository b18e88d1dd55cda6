"""Vectors in flat arrays, and vectors of three numbers as tuples, for all kernels."""

from __future__ import annotations

from flexmb.engine.algebra.rotation import cross, transform, transform_back
from flexmb.engine.jit import kernel

_SMALLEST = 1e-150  # products of two such numbers are still normal


@kernel
def put(out, o, x, y, z):
    """out[o:o+3] = (x, y, z)."""
    out[o] = x
    out[o + 1] = y
    out[o + 2] = z


@kernel
def copy(a, b):
    """b = a."""
    for i in range(a.shape[0]):
        b[i] = a[i]


@kernel
def store(a, b):
    """b = a, with numbers too small to matter set to zero.

    Motions that die out would end as denormal numbers, which cost a hundred times as much.
    """
    for i in range(a.shape[0]):
        b[i] = 0.0 if abs(a[i]) < _SMALLEST else a[i]


@kernel
def dot(a, i, b, j, n):
    """a[i:i+n]·b[j:j+n]."""
    s = 0.0
    for k in range(n):
        s += a[i + k] * b[j + k]
    return s


@kernel
def largest(x):
    """Largest |x_i|; NaN counts as largest."""
    s = 0.0
    for i in range(x.shape[0]):
        if not abs(x[i]) <= s:
            s = abs(x[i])
    return s


@kernel
def weighted_size(x, weights):
    """Largest |x_i| weight_i; NaN counts as largest."""
    size = 0.0
    for i in range(x.shape[0]):
        s = abs(x[i]) * weights[i]
        if not s <= size:
            size = s
    return size


@kernel
def scaled_size(x, weights, scale, noise):
    """Largest part of weighted |x_i| above the noise, over its scale; NaN counts as largest."""
    size = 0.0
    for i in range(x.shape[0]):
        s = (abs(x[i]) * weights[i] - noise) / scale[i]
        if not s <= size:
            size = s
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
    """The axis k."""
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
def outer(a, b):
    """a × b."""
    return cross(a[0], a[1], a[2], b[0], b[1], b[2])


@kernel
def turned(R, a):
    """R a."""
    return transform(R, a[0], a[1], a[2])


@kernel
def turned_back(R, a):
    """Rᵀ a."""
    return transform_back(R, a[0], a[1], a[2])


@kernel
def turned_by(th, f, g, a):
    """(I + f θ̃ + g θ̃²) a."""
    x = outer(th, a)
    return plus(plus(a, f, x), g, outer(th, x))


@kernel
def modal_vector(pool, at, m, v, o):
    """Three rows of the pool, starting at `at`, times v[o:o+m]."""
    a = 0.0
    b = 0.0
    c = 0.0
    for j in range(m):
        y = v[o + j]
        a += pool[at + j] * y
        b += pool[at + m + j] * y
        c += pool[at + 2 * m + j] * y
    return a, b, c


@kernel
def mode_vector(pool, at, m):
    """One column of three rows of the pool: that of a mode, which starts at `at`."""
    return pool[at], pool[at + m], pool[at + 2 * m]
