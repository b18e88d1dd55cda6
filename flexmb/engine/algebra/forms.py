"""Symmetric and skew matrices (forms) of many modes: a half is stored, and read once a product.

`grouped_rows` is the upper triangle with half of its diagonal. Its rows are grouped by four. A
group begins at the multiple of eight at or below its first diagonal element and ends at M, the next
multiple of eight after the number of modes m, filled with zeros: M (M + 8) / 2 numbers in all. So
loops along rows have whole processor vectors. Short single rows would cost twice as much, since the
start of each loop costs as much as ten numbers.

The forms of a marker are stored whole (`rows_of_bend`). Row j holds the rows j of all of
them, so a product adds multiples of long rows and needs no sum along a row. With 20 modes this
takes half of the time; with 50 modes as much or a fifth more, since the rows leave the first cache.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.engine.algebra.vector import copy, modal_vector, times, triple, zero
from flexmb.engine.jit import kernel, separate
from flexmb.engine.tables import half_of_forms, whole_vectors

_ROUND_OFF = 1e-12  # weight of a form in a sum that is round-off, as of the integrals (`put_flags`)


def grouped_rows(forms: ArrayLike) -> NDArray[np.float64]:
    """The grouped rows of n symmetric or skew forms (n, m, m): (n, M (M + 8) / 2)."""
    forms = np.triu(np.asarray(forms, np.float64))
    diagonal = np.arange(forms.shape[1])
    forms[:, diagonal, diagonal] *= 0.5
    forms = np.pad(forms, ((0, 0), *[(0, -len(diagonal) % 8)] * 2))
    return forms[:, half_of_forms(len(diagonal))]


def bend_with_axis(bend: NDArray[np.float64], turn: float) -> tuple[NDArray[np.float64], ...]:
    """The forms that matter of those of a marker (6, m, m), and an axis (3,).

    They are six; or three if second-order rotations are round-off of squares of `turn`, those of
    its modes; or four if all these are about one axis.
    """
    axes, sizes, _ = np.linalg.svd(bend[3:].reshape(3, -1), full_matrices=False)
    if sizes[0] <= _ROUND_OFF * turn**2:
        return bend[:3], np.zeros(3)
    if sizes[1:].max(initial=0.0) <= _ROUND_OFF * sizes[0]:
        return np.concatenate([bend[:3], np.tensordot(axes[:, :1].T, bend[3:], 1)]), axes[:, 0]
    return bend, np.zeros(3)


def rows_of_bend(forms: ArrayLike) -> NDArray[np.float64]:
    """The rows that the pool stores of n symmetric forms K (n, m, m) of a marker.

    Row j is K[:, j], n m numbers padded to whole processor vectors, so that a product with the
    modal coordinates reads all forms row by row.
    """
    rows = np.swapaxes(forms, 0, 1).reshape(np.shape(forms)[1], -1)
    return np.pad(rows, ((0, 0), (0, whole_vectors(rows.shape[1]) - rows.shape[1])))


def bend_of(marker: np.void, m: int, pool: NDArray[np.float64]) -> NDArray[np.float64]:
    """K (m, 3 or 6, m) of a marker, from its rows in the pool (`rows_of_bend`)."""
    n, at = marker["forms"] * m, marker["bend"]
    rows = pool[at : at + m * whole_vectors(n)].reshape(m, -1)
    K = rows[:, :n].reshape(m, -1, m)
    if marker["forms"] != 4:
        return K
    return np.concatenate([K[:, :3], marker["turn"][:, None] * K[:, 3:]], axis=1)


@kernel
def size_of_form(m):
    """Number of elements stored of a form of m modes, and m rounded up to a multiple of eight."""
    padded = whole_vectors(m)
    return padded * (padded + 8) // 2, padded


@kernel
def _four(T, i, apart=1):
    """Four numbers of T from index i on, `apart` from each other."""
    apart = np.uintp(apart)
    j = i + apart
    return T[i], T[j], T[j + apart], T[j + apart + apart]


@kernel
def _put_four(T, i, a):
    one = np.uintp(1)
    T[i], T[i + one], T[i + one + one], T[i + np.uintp(3)] = a


@kernel
def _plus(a, f, b):
    """a + f b of four numbers."""
    return a[0] + f * b[0], a[1] + f * b[1], a[2] + f * b[2], a[3] + f * b[3]


@kernel
def _inner(a, b):
    """a·b of four numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@separate
def add_symmetric_and_skew(T, size, n, x, y, out):
    """out[:n] + out[n:2n] = S x[:n] + G y[:n], S symmetric, G skew and `size` numbers after S.

    The result has two parts because a processor stalls when it reads a vector whose elements were
    just stored one by one.
    """
    a, n, size = np.uintp(0), np.uintp(n), np.uintp(size)
    four, eight = np.uintp(4), np.uintp(8)
    for o in range(np.uintp(0), n, four):
        start, p, q, sums = o // eight * eight, _four(x, o), _four(y, o), (0.0, 0.0, 0.0, 0.0)
        length = n - start
        for i in range(length):
            s, g = _four(T, a + i, length), _four(T, a + size + i, length)
            sums = _plus(_plus(sums, x[start + i], s), y[start + i], g)
            out[start + i] += _inner(s, p) - _inner(g, q)
        _put_four(out, n + o, sums)
        a += four * length


@separate
def subtract_products(T, at, n, m, x, o, out):
    """out[:n] −= Σ_j x[o+j] T[at + j n : at + (j+1) n], j < m: −K_d x of symmetric forms."""
    a, n, four = np.uintp(at), np.uintp(n), m // 4 * 4
    for j in range(0, four, 4):
        p, q, r, s = x[o + j], x[o + j + 1], x[o + j + 2], x[o + j + 3]
        b, c, d = a + n, a + n + n, a + n + n + n
        for i in range(n):
            out[i] -= p * T[a + i] + q * T[b + i] + r * T[c + i] + s * T[d + i]
        a = d + n
    for j in range(four, m):
        for i in range(n):
            out[i] -= x[o + j] * T[a + i]
        a += n


@kernel
def put_bent_modes(mk, pool, q, o, m, phi):
    """phi[:6m] = Φ − ηᵀ K_d of a marker at η = q[o:o+m]; the rest of phi is scratch."""
    at, one_axis, axis = mk["modes"] + 3 * m, mk["forms"] == 4, mk["turn"]
    copy(pool[mk["modes"] : mk["modes"] + 6 * m], phi)
    if one_axis:
        zero(phi[3 * m : 4 * m])
    subtract_products(pool, mk["bend"], whole_vectors(mk["forms"] * m), m, q, o, phi)
    if one_axis:
        for j in range(m):
            turned = phi[3 * m + j]
            for a in range(3):
                phi[(3 + a) * m + j] = pool[at + a * m + j] + axis[a] * turned


@kernel
def bending_acceleration(mk, pool, v, o, m, phi):
    """−η̇ᵀ K_d η̇ of a marker, η̇ = v[o:o+m]; uses the scratch behind phi."""
    first, n = whole_vectors(6 * m), whole_vectors(mk["forms"] * m)
    zero(phi[first : first + n])
    subtract_products(pool, mk["bend"], n, m, v, o, phi[first:])
    point, turning = modal_vector(phi, first, m, v, o), (0.0, 0.0, 0.0)
    if mk["forms"] == 6:
        turning = modal_vector(phi, first + 3 * m, m, v, o)
    elif mk["forms"] == 4:
        turned = 0.0
        for j in range(m):
            turned += phi[first + 3 * m + j] * v[o + j]
        turning = times(turned, triple(mk["turn"]))
    return point, turning


@separate
def add_symmetric_rows(T, at, n, m, f, B, o):
    """B[o:o+m, o:o+m] += Σ_d f_d K_d of three of the forms of `subtract_products`."""
    a, n, m, o = np.uintp(at), np.uintp(n), np.uintp(m), np.uintp(o)
    for j in range(m):
        row, b, c = B[o + j], a + m, a + m + m
        for r in range(m):
            row[o + r] += f[0] * T[a + r] + f[1] * T[b + r] + f[2] * T[c + r]
        a += n


@kernel
def add_pair_to_block(T, size, m, padded, B, o):
    """B[o:o+m, o:o+m] += S + G, a symmetric form and the skew one after it."""
    row = 0
    for k in range(m):
        for r in range(k, m):
            i = row + r - k // 8 * 8
            B[o + k, o + r] += T[i] + T[size + i]
            B[o + r, o + k] += T[i] - T[size + i]
        row += padded - k // 8 * 8


@separate
def combine_forms(pool, at, size, f, w, out):
    """out = grouped rows of Σ f_s S_s, then those of Σ w_k G_k.

    The forms, of `size` numbers each, begin at pool[at]: S_x, G_x, S_y, G_y, S_z, G_z, S_xy, S_yz,
    S_zx.
    """
    size = np.uintp(size)
    x, z, yz = np.uintp(at), np.uintp(at) + np.uintp(4) * size, np.uintp(at) + np.uintp(7) * size
    y, xy, zx = x + size + size, z + size + size, yz + size
    for n in range(size):
        s = f[0] * pool[x + n] + f[1] * pool[y + n] + f[2] * pool[z + n]
        out[n] = s + f[3] * pool[xy + n] + f[4] * pool[yz + n] + f[5] * pool[zx + n]
        i = size + n
        out[i] = w[0] * pool[x + i] + w[1] * pool[y + i] + w[2] * pool[z + i]


@kernel
def leading_form(f):
    """The axis k if only S_k and the two mixed forms of k have weights above round-off; else −1."""
    k = 0 if abs(f[0]) >= max(abs(f[1]), abs(f[2])) else 1 if abs(f[1]) >= abs(f[2]) else 2
    i, j = (k + 1) % 3, (k + 2) % 3
    return k if max(abs(f[i]), abs(f[j]), abs(f[3 + i])) <= _ROUND_OFF * abs(f[k]) else -1


@separate
def add_mixed_forms(pool, at, size, k, f, w, n, x, y, out):
    """`add_symmetric_and_skew` for the sums of `combine_forms` without S_k and G_k.

    For a leading axis k (`leading_form`), where few forms have a weight: no sum is stored.
    """
    a, n, four, eight = np.uintp(0), np.uintp(n), np.uintp(4), np.uintp(8)
    i, j = (k + 1) % 3, (k + 2) % 3
    b, c = np.uintp(at + (6 + k) * size), np.uintp(at + (6 + j) * size)
    d, e = np.uintp(at + (2 * i + 1) * size), np.uintp(at + (2 * j + 1) * size)
    none, (t, u, v, z) = (0.0, 0.0, 0.0, 0.0), (f[3 + k], f[3 + j], w[i], w[j])
    for o in range(np.uintp(0), n, four):
        start, p, q, sums = o // eight * eight, _four(x, o), _four(y, o), none
        length = n - start
        for m in range(length):
            s = _plus(none, t, _four(pool, b + a + m, length))
            s = _plus(s, u, _four(pool, c + a + m, length))
            g = _plus(none, v, _four(pool, d + a + m, length))
            g = _plus(g, z, _four(pool, e + a + m, length))
            sums = _plus(_plus(sums, x[start + m], s), y[start + m], g)
            out[start + m] += _inner(s, p) - _inner(g, q)
        _put_four(out, n + o, sums)
        a += four * length
