"""Vectors as three numbers in a tuple: sums, products and axes, for formulas with many of them."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import cross, transform, transform_back


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
def unit(k):
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
