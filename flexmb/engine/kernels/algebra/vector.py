"""Short loops over vectors in flat arrays, shared by all kernels."""

from __future__ import annotations

from flexmb.engine.jit import kernel

_NOTHING = 1e-150  # products of two such numbers are still normal


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
        b[i] = 0.0 if abs(a[i]) < _NOTHING else a[i]


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
