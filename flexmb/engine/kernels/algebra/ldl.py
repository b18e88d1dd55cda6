"""Supernodal factorisation of the KKT matrix on dense panels, and its solves.

The symbolic part (`engine.symbolic`) gives panels of columns in elimination order; each holds its
diagonal block and the dense rows below, row by row, so every inner loop is a dot product over
neighbouring numbers. Symmetric: A = L D Lᵀ on `low`. Unsymmetric with the same pattern:
A = L D U, where `up` holds U by columns in the same places. No pivoting: every pivot has a known
sign (+ coordinate, − constraint row); one of the wrong sign or nearly zero is replaced and counted.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.vector import dot
from flexmb.engine.method import FINE
from flexmb.engine.records import Vector
from flexmb.engine.state import Factor
from flexmb.engine.tables import Kkt

# A pivot this small against its own diagonal entry carries no digits.
_TINY = 1e-13
# What replaces it, against the same entry: the square root of round-off, lost as much by the
# growth of the factor as by the error of the matrix.
_SMALL = 1e-8


@kernel
def _guarded(d, a, sign):
    """Pivot d, or a replacement if it has the wrong sign or no digits; and whether it was.

    a is its diagonal entry. One of the wrong sign becomes |a|, a step of Newton's method in a safe
    direction. One without digits becomes small, so that refinement takes it back.
    """
    if d * sign > _TINY * abs(a) and math.isfinite(d):
        return d, 0
    if abs(d) > _TINY * abs(a) and math.isfinite(d):
        return sign * max(abs(a), abs(d)), 1
    return sign * _SMALL * (abs(a) if abs(a) > 0.0 else 1.0), 1


@unit
def factor(kkt: Kkt, fac: Factor) -> int:
    """Factor fac.low (and fac.up) in place; returns the number of replaced pivots."""
    if fac.symmetric[0] == 1:
        return factor_symmetric(kkt, fac)
    return factor_pair(kkt, fac)


@unit
def factor_pair(kkt: Kkt, fac: Factor) -> int:
    """Factor fac.low and fac.up in place; returns the number of replaced pivots."""
    panels, updates, low, up, d = kkt.panels, kkt.updates, fac.low, fac.up, fac.d
    Wl, Wu = fac.Wl, fac.Wu
    fixes = 0
    for p in range(panels.shape[0]):
        fixes += _factor_panel_pair(panels[p], low, up, Wl, Wu, d)
        _update_pair(panels[p], updates, low, up, Wl, Wu)
    return fixes


@unit
def factor_symmetric(kkt: Kkt, fac: Factor) -> int:
    """Factor fac.low in place; returns the number of replaced pivots."""
    panels, updates, low, Wl, d = kkt.panels, kkt.updates, fac.low, fac.Wl, fac.d
    fixes = 0
    for p in range(panels.shape[0]):
        fixes += _factor_panel(panels[p], low, Wl, d)
        _update_low(panels[p], updates, low, Wl)
    return fixes


@kernel
def _factor_panel(panel, L, W, d):
    at, nc, col = panel["at"], panel["nc"], panel["col"]
    fixes = 0
    for i in range(nc + panel["nr"]):
        row = at + i * nc
        w = i * nc
        for j in range(min(i, nc)):
            s = L[row + j]
            lj = at + j * nc
            for k in range(j):
                s -= W[w + k] * L[lj + k]
            W[w + j] = s
        for j in range(min(i, nc)):
            L[row + j] = W[w + j] / d[col + j]
        if i < nc:
            s = L[row + i]
            for k in range(i):
                s -= W[w + k] * L[row + k]
            d[col + i], fixed = _guarded(s, L[row + i], panel["sign"])
            fixes += fixed
    return fixes


@kernel
def _update_low(panel, updates, L, W):
    at, nc = panel["at"], panel["nc"]
    for u in range(panel["update"], panel["update"] + panel["n_update"]):
        up = updates[u]
        for i in range(up["nx"]):
            w = (up["x"] + i) * nc
            target = up["at"] + i * up["stride"]
            for j in range(i + 1 if up["diagonal"] == 1 else up["ny"]):
                L[target + j] -= dot(W, w, L, at + (up["y"] + j) * nc, nc)


@kernel
def _factor_panel_pair(panel, L, U, W, V, d):
    at, nc, col = panel["at"], panel["nc"], panel["col"]
    fixes = 0
    for i in range(nc + panel["nr"]):
        row = at + i * nc
        w = i * nc
        for j in range(min(i, nc)):
            s = L[row + j]
            t = U[row + j]
            lj = at + j * nc
            for k in range(j):
                s -= W[w + k] * U[lj + k]
                t -= V[w + k] * L[lj + k]
            W[w + j] = s
            V[w + j] = t
        for j in range(min(i, nc)):
            L[row + j] = W[w + j] / d[col + j]
            U[row + j] = V[w + j] / d[col + j]
        if i < nc:
            s = L[row + i]
            for k in range(i):
                s -= W[w + k] * U[row + k]
            d[col + i], fixed = _guarded(s, L[row + i], panel["sign"])
            fixes += fixed
    return fixes


@kernel
def _update_pair(panel, updates, L, U, W, V):
    at, nc = panel["at"], panel["nc"]
    for u in range(panel["update"], panel["update"] + panel["n_update"]):
        up = updates[u]
        for i in range(up["nx"]):
            w = (up["x"] + i) * nc
            target = up["at"] + i * up["stride"]
            for j in range(i + 1 if up["diagonal"] == 1 else up["ny"]):
                y = at + (up["y"] + j) * nc
                L[target + j] -= dot(W, w, U, y, nc)
                U[target + j] -= dot(V, w, L, y, nc)


@unit
def solve(kkt: Kkt, fac: Factor, b: Vector) -> int:
    """Solve in place with the factor; b is in elimination order."""
    b[b.shape[0] - 1] = 0.0  # the place of all coordinates that are left out
    if fac.symmetric[0] == 1:
        _solve(kkt.panels, kkt.rows, fac.low, fac.low, fac.d, b)
    else:
        _solve(kkt.panels, kkt.rows, fac.low, fac.up, fac.d, b)
    return FINE


@kernel
def _solve(panels, rows_of, L, U, d, b):
    for p in range(panels.shape[0]):
        panel = panels[p]
        at, nc, col, rows = panel["at"], panel["nc"], panel["col"], panel["rows"]
        for i in range(1, nc):
            b[col + i] -= dot(L, at + i * nc, b, col, i)
        for i in range(panel["nr"]):
            b[rows_of[rows + i]] -= dot(L, at + (nc + i) * nc, b, col, nc)
    for i in range(b.shape[0]):
        b[i] /= d[i]
    for q in range(panels.shape[0]):
        panel = panels[panels.shape[0] - 1 - q]
        at, nc, col, rows = panel["at"], panel["nc"], panel["col"], panel["rows"]
        for i in range(panel["nr"]):
            x = b[rows_of[rows + i]]
            o = at + (nc + i) * nc
            for k in range(nc):
                b[col + k] -= U[o + k] * x
        for j in range(nc - 1):
            i = nc - 1 - j
            x = b[col + i]
            o = at + i * nc
            for k in range(i):
                b[col + k] -= U[o + k] * x


@unit
def multiply(kkt: Kkt, fac: Factor, x: Vector, y: Vector) -> int:
    """y = S x with the unregularised matrix; both in elimination order."""
    if fac.symmetric[0] == 1:
        _multiply(kkt.panels, kkt.rows, fac.low0, fac.low0, fac.eps, x, y)
    else:
        _multiply(kkt.panels, kkt.rows, fac.low0, fac.up0, fac.eps, x, y)
    return FINE


@kernel
def _multiply(panels, rows_of, L, U, eps, x, y):
    for i in range(y.shape[0]):
        y[i] = 0.0
    for p in range(panels.shape[0]):
        panel = panels[p]
        at, nc, col, rows = panel["at"], panel["nc"], panel["col"], panel["rows"]
        for i in range(nc + panel["nr"]):
            r = col + i if i < nc else rows_of[rows + i - nc]
            o = at + i * nc
            n = min(i, nc)
            y[r] += dot(L, o, x, col, n)
            xr = x[r]
            for k in range(n):
                y[col + k] += U[o + k] * xr
            if i < nc:
                y[r] += (L[o + i] + eps[r]) * x[r]


@unit
def solve_refined(kkt: Kkt, fac: Factor, rounds: int) -> int:
    """fac.sol = S⁻¹ fac.rhs, refined against the matrix without regularisation."""
    rhs, x, tmp = fac.rhs, fac.sol, fac.tmp
    for i in range(rhs.shape[0]):
        x[i] = rhs[i]
    solve(kkt, fac, x)
    for _ in range(rounds):
        multiply(kkt, fac, x, tmp)
        for i in range(rhs.shape[0]):
            tmp[i] = rhs[i] - tmp[i]
        solve(kkt, fac, tmp)
        for i in range(rhs.shape[0]):
            x[i] += tmp[i]
    return FINE
