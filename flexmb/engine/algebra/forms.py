"""Symmetric and skew forms of many modes: half of each is kept, and read once a product.

`grouped_rows` are the upper triangle with half of its diagonal, rows in groups of four, each group
from its first diagonal on, filled with zeros below the diagonals and up to the next multiple of
four: M (M + 4) / 2 numbers of a form of m modes, M the next multiple of four. Short rows one by one
would cost twice as much: each loop over them as much as ten numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.engine.jit import kernel


def grouped_rows(forms: ArrayLike) -> NDArray[np.float64]:
    """The grouped rows of n symmetric or skew forms (n, m, m): (n, M (M + 4) / 2)."""
    forms = np.triu(np.asarray(forms, np.float64))
    diagonal = np.arange(forms.shape[1])
    forms[:, diagonal, diagonal] *= 0.5
    forms = np.pad(forms, ((0, 0), *[(0, -len(diagonal) % 4)] * 2))
    groups = [forms[:, k : k + 4, k:] for k in range(0, forms.shape[1], 4)]
    rows = [group.reshape(len(forms), -1) for group in groups]
    return np.concatenate([np.zeros((len(forms), 0)), *rows], axis=1)


@kernel
def size_of_form(m):
    """Numbers of a form of m modes, and the modes with those that fill the last group."""
    padded = (m + 3) // 4 * 4
    return padded * (padded + 4) // 2, padded


@kernel
def add_symmetric_and_skew(T, size, n, x, y, out):
    """out[:n] += S x[:n] + G y[:n], S symmetric, G skew and `size` numbers behind S."""
    one, two, three, four = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(4)
    a, o, size = np.uintp(0), np.uintp(0), np.uintp(size)
    for left in range(np.uintp(n // 4), np.uintp(0), -1):
        length = four * np.uintp(left)
        b, c, d = a + length, a + two * length, a + three * length
        p, q, r, s = x[o], x[o + one], x[o + two], x[o + three]
        t, u, v, w = y[o], y[o + one], y[o + two], y[o + three]
        first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
        for i in range(length):
            e, f, g, h = T[a + i], T[b + i], T[c + i], T[d + i]
            j, k, m, z = T[size + a + i], T[size + b + i], T[size + c + i], T[size + d + i]
            first += e * x[o + i] + j * y[o + i]
            second += f * x[o + i] + k * y[o + i]
            third += g * x[o + i] + m * y[o + i]
            fourth += h * x[o + i] + z * y[o + i]
            out[o + i] += e * p + f * q + g * r + h * s - j * t - k * u - m * v - z * w
        out[o] += first
        out[o + one] += second
        out[o + two] += third
        out[o + three] += fourth
        a, o = d + length, o + four


@kernel
def add_pair_to_block(T, size, m, padded, B, o):
    """B[o:o+m, o:o+m] += S + G, a symmetric form and a skew one behind it."""
    row = 0
    for k in range(m):
        for r in range(k, m):
            i = row + r
            B[o + k, o + r] += T[i] + T[size + i]
            B[o + r, o + k] += T[i] - T[size + i]
        row += padded - k // 4 * 4 - (4 if k % 4 == 3 else 0)


@kernel
def combine_forms(pool, at, size, f, w, out):
    """The grouped rows of Σ f_s S_s and of Σ w_k G_k, one after the other, into out.

    Forms of `size` numbers from `at` on: S_x, G_x, S_y, G_y, S_z, G_z, S_xy, S_yz, S_zx.
    """
    size, x = np.uintp(size), np.uintp(at)
    y, z, xy = x + size + size, x + np.uintp(4) * size, x + np.uintp(6) * size
    yz, zx = xy + size, xy + size + size
    for i in range(size):
        s = f[0] * pool[x + i] + f[1] * pool[y + i] + f[2] * pool[z + i]
        out[i] = s + f[3] * pool[xy + i] + f[4] * pool[yz + i] + f[5] * pool[zx + i]
    for i in range(size, size + size):
        out[i] = w[0] * pool[x + i] + w[1] * pool[y + i] + w[2] * pool[z + i]
