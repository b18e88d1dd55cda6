"""Symmetric and skew forms of many modes: half of each is kept, and read once a product.

`grouped_rows` are the upper triangle with half of its diagonal, rows in groups of four, from the
multiple of eight up to their first diagonal to the next multiple of eight after the last, filled
with zeros: M (M + 8) / 2 numbers of a form of m modes, M the next multiple of eight. So loops over
rows end with a whole vector of the processor. Short rows one by one would cost twice as much: each
loop over them as much as ten numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.engine.jit import kernel

_ROUND_OFF = 1e-12  # share of a form in a sum, as of the integrals themselves (`put_flags`)


def grouped_rows(forms: ArrayLike) -> NDArray[np.float64]:
    """The grouped rows of n symmetric or skew forms (n, m, m): (n, M (M + 8) / 2)."""
    forms = np.triu(np.asarray(forms, np.float64))
    diagonal = np.arange(forms.shape[1])
    forms[:, diagonal, diagonal] *= 0.5
    forms = np.pad(forms, ((0, 0), *[(0, -len(diagonal) % 8)] * 2))
    groups = [forms[:, k : k + 4, k // 8 * 8 :] for k in range(0, forms.shape[1], 4)]
    rows = [group.reshape(len(forms), -1) for group in groups]
    return np.concatenate([np.zeros((len(forms), 0)), *rows], axis=1)


@kernel
def size_of_form(m):
    """Numbers of a form of m modes, and the modes with those that fill the last group."""
    padded = (m + 7) // 8 * 8
    return padded * (padded + 8) // 2, padded


@kernel
def add_symmetric_and_skew(T, size, n, x, y, out):
    """out[:n] + out[n:2n] = S x[:n] + G y[:n], S symmetric, G skew and `size` numbers behind S.

    In two parts, as a processor waits for single numbers that were just stored where it reads a
    vector of them.
    """
    one, two, three, four = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(4)
    a, o, size, eight = np.uintp(0), np.uintp(0), np.uintp(size), np.uintp(8)
    for group in range(np.uintp(n // 4)):
        start = group // np.uintp(2) * eight
        length = np.uintp(n) - start
        b, c, d = a + length, a + two * length, a + three * length
        p, q, r, s = x[o], x[o + one], x[o + two], x[o + three]
        t, u, v, w = y[o], y[o + one], y[o + two], y[o + three]
        first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
        for i in range(length):
            e, f, g, h = T[a + i], T[b + i], T[c + i], T[d + i]
            j, k, m, z = T[size + a + i], T[size + b + i], T[size + c + i], T[size + d + i]
            first += e * x[start + i] + j * y[start + i]
            second += f * x[start + i] + k * y[start + i]
            third += g * x[start + i] + m * y[start + i]
            fourth += h * x[start + i] + z * y[start + i]
            out[start + i] += e * p + f * q + g * r + h * s - j * t - k * u - m * v - z * w
        o += np.uintp(n)
        out[o], out[o + one], out[o + two], out[o + three] = first, second, third, fourth
        a, o = d + length, o + four - np.uintp(n)


@kernel
def add_pair_to_block(T, size, m, padded, B, o):
    """B[o:o+m, o:o+m] += S + G, a symmetric form and a skew one behind it."""
    row = 0
    for k in range(m):
        for r in range(k, m):
            i = row + r - k // 8 * 8
            B[o + k, o + r] += T[i] + T[size + i]
            B[o + r, o + k] += T[i] - T[size + i]
        row += padded - k // 8 * 8


@kernel
def combine_forms(pool, at, size, f, w, out):
    """The grouped rows of Σ f_s S_s and of Σ w_k G_k, one after the other, into out.

    Forms of `size` numbers from `at` on: S_x, G_x, S_y, G_y, S_z, G_z, S_xy, S_yz, S_zx. What
    counts less than round-off is not read: three of six S where a body hardly leaves a plane.
    """
    pair, xy = 2 * size, at + 6 * size
    k = 0 if abs(f[0]) >= max(abs(f[1]), abs(f[2])) else 1 if abs(f[1]) >= abs(f[2]) else 2
    i, j = (k + 1) % 3, (k + 2) % 3
    if max(abs(f[i]), abs(f[j]), abs(f[3 + i])) <= _ROUND_OFF * abs(f[k]):
        own, after, before = at + k * pair, xy + k * size, xy + j * size
        _combine_three(pool, own, after, before, (f[k], f[3 + k], f[3 + j]), out, 0, size)
    else:
        x, y, z = np.uintp(at), np.uintp(at + pair), np.uintp(at + 2 * pair)
        xy, yz, zx = np.uintp(xy), np.uintp(xy + size), np.uintp(xy + pair)
        for n in range(np.uintp(size)):
            s = f[0] * pool[x + n] + f[1] * pool[y + n] + f[2] * pool[z + n]
            out[n] = s + f[3] * pool[xy + n] + f[4] * pool[yz + n] + f[5] * pool[zx + n]
    skew = at + size
    _combine_three(pool, skew, skew + pair, skew + 2 * pair, w, out, size, size)


@kernel
def _combine_three(pool, a, b, c, f, out, o, n):
    """out[o:o+n] = n numbers of the pool at each of three places, times f."""
    a, b, c, o = np.uintp(a), np.uintp(b), np.uintp(c), np.uintp(o)
    for i in range(np.uintp(n)):
        out[o + i] = f[0] * pool[a + i] + f[1] * pool[b + i] + f[2] * pool[c + i]
