"""Panels of one to six columns without inner loops: of bodies, scalar coordinates and most joints.

A loop over two or three numbers costs several times as much as the products in it. Names are those
of `ldl`: the panel has nc columns from `col` on; its diagonal block and nr rows are stored row by
row from index `at` on; W holds the rows before the division by the pivots, for the updates.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel

# A pivot below this share of its own diagonal entry is round-off.
_PIVOT_TOLERANCE = 1e-13
# Its replacement over the same entry: the square root of round-off, so that growth of the factor
# and change of the matrix cost the same number of digits.
_REPLACED_PIVOT = 1e-8


@kernel
def guarded(d, a, sign):
    """Pivot d, or its replacement if it is round-off; and whether it was replaced.

    a is its diagonal entry before elimination. The replacement is small, so that iterative
    refinement removes its effect. A pivot of the wrong sign that is not round-off is kept: forces
    and reactions may make a body unstable that joints constrain, and any other pivot would spoil
    the convergence of Newton's method.
    """
    if abs(d) > _PIVOT_TOLERANCE * abs(a) and math.isfinite(abs(d)):
        return d, 0
    return 0.0 * a + sign * _REPLACED_PIVOT * (abs(a) if abs(a) > 0.0 else 1.0), 1


@kernel
def factor_two(panel, updates, L, W, d):
    """Factor the panel of two columns and subtract it from later ones; returns pivots replaced."""
    at, col, sign = panel["at"], panel["col"], panel["sign"]
    p, fixes = guarded(L[at], L[at], sign)
    i = 1.0 / p
    x = L[at + 2]
    f = x * i
    q, fixed = guarded(L[at + 3] - x * f, L[at + 3], sign)
    j = 1.0 / q
    L[at + 2], d[col], d[col + 1] = f, p, q
    for o in range(at + 4, at + 4 + 2 * panel["nr"], 2):
        x = L[o]
        y = L[o + 1] - x * f
        W[o - at], W[o - at + 1] = x, y
        L[o], L[o + 1] = x * i, y * j
    for u in range(panel["update"], panel["update"] + panel["n_update"]):
        up = updates[u]
        ny, low = up["ny"], at + 2 * up["y"]
        for r in range(up["nx"]):
            w, to = 2 * (up["x"] + r), up["at"] + r * up["stride"]
            x, y = W[w], W[w + 1]
            for c in range(r + 1 if up["diagonal"] == 1 else ny):
                o = low + 2 * c
                L[to + c] -= x * L[o] + y * L[o + 1]
    return fixes + fixed


@kernel
def factor_three(panel, updates, L, W, d):
    """`factor_two` for three columns: a body in a plane."""
    at, col, sign = panel["at"], panel["col"], panel["sign"]
    p, fixes = guarded(L[at], L[at], sign)
    i = 1.0 / p
    x = L[at + 3]
    f = x * i
    q, fixed = guarded(L[at + 4] - x * f, L[at + 4], sign)
    j, fixes = 1.0 / q, fixes + fixed
    x = L[at + 6]
    g = x * i
    y = L[at + 7] - x * f
    h = y * j
    s, fixed = guarded(L[at + 8] - x * g - y * h, L[at + 8], sign)
    k = 1.0 / s
    L[at + 3], L[at + 6], L[at + 7] = f, g, h
    d[col], d[col + 1], d[col + 2] = p, q, s
    for o in range(at + 9, at + 9 + 3 * panel["nr"], 3):
        x = L[o]
        y = L[o + 1] - x * f
        z = L[o + 2] - x * g - y * h
        w = o - at
        W[w], W[w + 1], W[w + 2] = x, y, z
        L[o], L[o + 1], L[o + 2] = x * i, y * j, z * k
    for u in range(panel["update"], panel["update"] + panel["n_update"]):
        up = updates[u]
        ny, low = up["ny"], at + 3 * up["y"]
        for r in range(up["nx"]):
            w, to = 3 * (up["x"] + r), up["at"] + r * up["stride"]
            x, y, z = W[w], W[w + 1], W[w + 2]
            for c in range(r + 1 if up["diagonal"] == 1 else ny):
                o = low + 3 * c
                L[to + c] -= x * L[o] + y * L[o + 1] + z * L[o + 2]
    return fixes + fixed


@kernel
def factor_several(panel, updates, L, W, d):
    """`factor_two` for four to six columns: a body in space, a joint."""
    at, nc, col, sign = panel["at"], panel["nc"], panel["col"], panel["sign"]
    none = 0.0 * L[at]  # for products with columns that do not exist
    f40 = f41 = f42 = f43 = f50 = f51 = f52 = f53 = f54 = f = g = m = n = none
    p, fixed = guarded(L[at], L[at], sign)
    i, d[col] = 1.0 / p, p
    fixes = fixed
    o = at + nc
    x = L[o]
    f10 = x * i
    p, fixed = guarded(L[o + 1] - x * f10, L[o + 1], sign)
    j, d[col + 1] = 1.0 / p, p
    fixes += fixed
    L[o] = f10
    o = at + 2 * nc
    x = L[o]
    y = L[o + 1] - x * f10
    f20, f21 = x * i, y * j
    p, fixed = guarded(L[o + 2] - x * f20 - y * f21, L[o + 2], sign)
    k, d[col + 2] = 1.0 / p, p
    fixes += fixed
    L[o], L[o + 1] = f20, f21
    o = at + 3 * nc
    x = L[o]
    y = L[o + 1] - x * f10
    z = L[o + 2] - x * f20 - y * f21
    f30, f31, f32 = x * i, y * j, z * k
    p, fixed = guarded(L[o + 3] - x * f30 - y * f31 - z * f32, L[o + 3], sign)
    t, d[col + 3] = 1.0 / p, p
    fixes += fixed
    L[o], L[o + 1], L[o + 2] = f30, f31, f32
    if nc > 4:
        o = at + 4 * nc
        x = L[o]
        y = L[o + 1] - x * f10
        z = L[o + 2] - x * f20 - y * f21
        e = L[o + 3] - x * f30 - y * f31 - z * f32
        f40, f41, f42, f43 = x * i, y * j, z * k, e * t
        p, fixed = guarded(L[o + 4] - x * f40 - y * f41 - z * f42 - e * f43, L[o + 4], sign)
        m, d[col + 4] = 1.0 / p, p
        fixes += fixed
        L[o], L[o + 1], L[o + 2], L[o + 3] = f40, f41, f42, f43
    if nc > 5:
        o = at + 5 * nc
        x = L[o]
        y = L[o + 1] - x * f10
        z = L[o + 2] - x * f20 - y * f21
        e = L[o + 3] - x * f30 - y * f31 - z * f32
        f = L[o + 4] - x * f40 - y * f41 - z * f42 - e * f43
        f50, f51, f52, f53, f54 = x * i, y * j, z * k, e * t, f * m
        p, fixed = guarded(
            L[o + 5] - x * f50 - y * f51 - z * f52 - e * f53 - f * f54, L[o + 5], sign
        )
        n, d[col + 5] = 1.0 / p, p
        fixes += fixed
        L[o], L[o + 1], L[o + 2], L[o + 3], L[o + 4] = f50, f51, f52, f53, f54
    for r in range(nc, nc + panel["nr"]):
        w = r * nc
        o = at + w
        x = L[o]
        y = L[o + 1] - x * f10
        z = L[o + 2] - x * f20 - y * f21
        e = L[o + 3] - x * f30 - y * f31 - z * f32
        if nc > 4:
            f = L[o + 4] - x * f40 - y * f41 - z * f42 - e * f43
            W[w + 4], L[o + 4] = f, f * m
        if nc > 5:
            g = L[o + 5] - x * f50 - y * f51 - z * f52 - e * f53 - f * f54
            W[w + 5], L[o + 5] = g, g * n
        W[w], W[w + 1], W[w + 2], W[w + 3] = x, y, z, e
        L[o], L[o + 1], L[o + 2], L[o + 3] = x * i, y * j, z * k, e * t
    for u in range(panel["update"], panel["update"] + panel["n_update"]):
        up = updates[u]
        ny, low = up["ny"], at + nc * up["y"]
        for r in range(up["nx"]):
            w, to = nc * (up["x"] + r), up["at"] + r * up["stride"]
            x, y, z, e = W[w], W[w + 1], W[w + 2], W[w + 3]
            if nc > 4:
                f = W[w + 4]
            if nc > 5:
                g = W[w + 5]
            for c in range(r + 1 if up["diagonal"] == 1 else ny):
                o = low + nc * c
                s = x * L[o] + y * L[o + 1] + z * L[o + 2] + e * L[o + 3]
                if nc > 4:
                    s += f * L[o + 4]
                if nc > 5:
                    s += g * L[o + 5]
                L[to + c] -= s
    return fixes


@kernel
def forward_small(at, nc, col, rows, nr, rows_of, L, b):
    """The panel of one to three columns."""
    x = b[col]
    if nc == 1:
        for i in range(nr):
            b[rows_of[rows + i]] -= L[at + 1 + i] * x
        return
    y = b[col + 1] - L[at + nc] * x
    b[col + 1] = y
    if nc == 2:
        for i in range(nr):
            o = at + 4 + 2 * i
            b[rows_of[rows + i]] -= L[o] * x + L[o + 1] * y
        return
    z = b[col + 2] - L[at + 6] * x - L[at + 7] * y
    b[col + 2] = z
    for i in range(nr):
        o = at + 9 + 3 * i
        b[rows_of[rows + i]] -= L[o] * x + L[o + 1] * y + L[o + 2] * z


@kernel
def backward_small(at, nc, col, rows, nr, rows_of, U, b):
    """The panel of one to three columns."""
    if nc == 1:
        s = b[col]
        for i in range(nr):
            s -= U[at + 1 + i] * b[rows_of[rows + i]]
        b[col] = s
    elif nc == 2:
        s, t = b[col], b[col + 1]
        for i in range(nr):
            x, o = b[rows_of[rows + i]], at + 4 + 2 * i
            s -= U[o] * x
            t -= U[o + 1] * x
        b[col + 1] = t
        b[col] = s - U[at + 2] * t
    else:
        s, t, u = b[col], b[col + 1], b[col + 2]
        for i in range(nr):
            x, o = b[rows_of[rows + i]], at + 9 + 3 * i
            s -= U[o] * x
            t -= U[o + 1] * x
            u -= U[o + 2] * x
        t -= U[at + 7] * u
        b[col + 2] = u
        b[col + 1] = t
        b[col] = s - U[at + 6] * u - U[at + 3] * t


@kernel
def forward_several(at, nc, col, rows, nr, rows_of, L, b):
    """The panel of four to six columns: a body in space, a joint."""
    x, o = b[col], at + nc
    y = b[col + 1] - L[o] * x
    o += nc
    z = b[col + 2] - L[o] * x - L[o + 1] * y
    o += nc
    u = b[col + 3] - L[o] * x - L[o + 1] * y - L[o + 2] * z
    b[col + 1], b[col + 2], b[col + 3] = y, z, u
    v = w = 0.0 * x
    if nc > 4:
        o += nc
        v = b[col + 4] - L[o] * x - L[o + 1] * y - L[o + 2] * z - L[o + 3] * u
        b[col + 4] = v
    if nc > 5:
        o += nc
        w = b[col + 5] - L[o] * x - L[o + 1] * y - L[o + 2] * z - L[o + 3] * u - L[o + 4] * v
        b[col + 5] = w
    for i in range(nr):
        o += nc
        s = L[o] * x + L[o + 1] * y + L[o + 2] * z + L[o + 3] * u
        if nc > 4:
            s += L[o + 4] * v
        if nc > 5:
            s += L[o + 5] * w
        b[rows_of[rows + i]] -= s


@kernel
def backward_several(at, nc, col, rows, nr, rows_of, U, b):
    """The panel of four to six columns: a body in space, a joint."""
    x, y, z, u = b[col], b[col + 1], b[col + 2], b[col + 3]
    v = w = 0.0 * x
    if nc > 4:
        v = b[col + 4]
    if nc > 5:
        w = b[col + 5]
    o = at + nc * nc
    for i in range(nr):
        s = b[rows_of[rows + i]]
        x -= U[o] * s
        y -= U[o + 1] * s
        z -= U[o + 2] * s
        u -= U[o + 3] * s
        if nc > 4:
            v -= U[o + 4] * s
        if nc > 5:
            w -= U[o + 5] * s
        o += nc
    if nc > 5:
        o = at + 5 * nc
        x, y, z = x - U[o] * w, y - U[o + 1] * w, z - U[o + 2] * w
        u, v = u - U[o + 3] * w, v - U[o + 4] * w
        b[col + 5] = w
    if nc > 4:
        o = at + 4 * nc
        x, y, z, u = x - U[o] * v, y - U[o + 1] * v, z - U[o + 2] * v, u - U[o + 3] * v
        b[col + 4] = v
    o = at + 3 * nc
    x, y, z = x - U[o] * u, y - U[o + 1] * u, z - U[o + 2] * u
    o = at + 2 * nc
    x, y = x - U[o] * z, y - U[o + 1] * z
    x -= U[at + nc] * y
    b[col], b[col + 1], b[col + 2], b[col + 3] = x, y, z, u
