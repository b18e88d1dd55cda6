"""Supernodal factorisation of the KKT matrix on dense panels, and its solves.

The symbolic part (`engine.symbolic`) gives panels of columns in elimination order; each holds its
diagonal block and the dense rows below, row by row, so every inner loop is a dot product over
neighbouring numbers. Symmetric: A = L D Lᵀ on `low`. Unsymmetric with the same pattern:
A = L D U, where `up` holds U by columns in the same places. There is no pivoting. A pivot that is
round-off is replaced by a small one of the expected sign (+ coordinate, − constraint row) and
counted.

Dense blocks in the order of v are added to the panels by `column` (nv,): the column of each
velocity coordinate in its panel, modes before the rigid part; −1 leaves it out (out of the plane of
a planar model).
"""

from __future__ import annotations

from flexmb.engine.algebra.small_panels import (
    backward_several,
    backward_small,
    factor_several,
    factor_three,
    factor_two,
    forward_several,
    forward_small,
    guarded,
)
from flexmb.engine.algebra.vector import add_multiple, copy, dot, zero
from flexmb.engine.jit import Matrix, Vector, kernel, unit
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import ComplexFactor, Factor, Run
from flexmb.engine.tables import Kkt


@unit
def factor(kkt: Kkt, fac: Factor) -> int:
    """Factor fac.low (and fac.up) in place; returns the number of replaced pivots."""
    return _factor(kkt.panels, kkt.updates, fac)


@unit
def factor_complex(kkt: Kkt, fac: ComplexFactor) -> int:
    """Factor a complex matrix in place; returns the number of replaced pivots."""
    return _factor(kkt.panels, kkt.updates, fac)


@kernel
def _factor(panels, updates, fac):
    low, up, Wl, Wu, d = fac.low, fac.up, fac.Wl, fac.Wu, fac.d
    symmetric, fixes = fac.symmetric[0] == 1, 0
    for p in range(panels.shape[0]):
        panel, nc = panels[p], panels[p]["nc"]
        if not symmetric:
            fixes += _factor_panel_pair(panel, low, up, Wl, Wu, d)
            _update_pair(panel, updates, low, up, Wl, Wu)
        elif nc == 2:
            fixes += factor_two(panel, updates, low, Wl, d)
        elif nc == 3:
            fixes += factor_three(panel, updates, low, Wl, d)
        elif 4 <= nc <= 6:
            fixes += factor_several(panel, updates, low, Wl, d)
        else:
            fixes += _factor_panel(panel, low, Wl, d)
            _update_low(panel, updates, low, Wl)
    return fixes


@unit
def solve_complex(kkt: Kkt, fac: ComplexFactor) -> int:
    """Solve for fac.sol in place."""
    fac.sol[fac.sol.shape[0] - 1] = 0.0
    if fac.symmetric[0] == 1:
        _solve(kkt.panels, kkt.rows, fac.low, fac.low, fac.d, fac.sol)
    else:
        _solve(kkt.panels, kkt.rows, fac.low, fac.up, fac.d, fac.sol)
    return SUCCESS


@kernel
def _factor_panel(panel, L, W, d):
    at, nc, col = panel["at"], panel["nc"], panel["col"]
    fixes = 0
    for i in range(nc + panel["nr"]):
        row = at + i * nc
        w = i * nc
        for j in range(min(i, nc)):
            W[w + j] = L[row + j] - dot(W, w, L, at + j * nc, j)
        for j in range(min(i, nc)):
            L[row + j] = W[w + j] * W[j * nc + j]
        if i < nc:
            s = L[row + i] - dot(W, w, L, row, i)
            d[col + i], fixed = guarded(s, L[row + i], panel["sign"])
            W[w + i] = 1.0 / d[col + i]
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
            lj = at + j * nc
            W[w + j] = L[row + j] - dot(W, w, U, lj, j)
            V[w + j] = U[row + j] - dot(V, w, L, lj, j)
        for j in range(min(i, nc)):
            L[row + j] = W[w + j] * W[j * nc + j]
            U[row + j] = V[w + j] * W[j * nc + j]
        if i < nc:
            s = L[row + i] - dot(W, w, U, row, i)
            d[col + i], fixed = guarded(s, L[row + i], panel["sign"])
            W[w + i] = 1.0 / d[col + i]
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
    b[b.shape[0] - 1] = 0.0  # the entry of all coordinates that are not in the matrix
    if fac.symmetric[0] == 1:
        _solve(kkt.panels, kkt.rows, fac.low, fac.low, fac.d, b)
    else:
        _solve(kkt.panels, kkt.rows, fac.low, fac.up, fac.d, b)
    return SUCCESS


@kernel
def _solve(panels, rows_of, L, U, d, b):
    """b = U⁻¹ D⁻¹ L⁻¹ b; without inner loops for panels of few columns, as most are."""
    n = panels.shape[0]
    for p in range(n):
        panel = panels[p]
        at, nc, col, rows, nr = panel["at"], panel["nc"], panel["col"], panel["rows"], panel["nr"]
        if nc <= 3:
            forward_small(at, nc, col, rows, nr, rows_of, L, b)
        elif nc <= 6:
            forward_several(at, nc, col, rows, nr, rows_of, L, b)
        else:
            for i in range(1, nc):
                b[col + i] -= dot(L, at + i * nc, b, col, i)
            for i in range(nr):
                b[rows_of[rows + i]] -= dot(L, at + (nc + i) * nc, b, col, nc)
    for i in range(b.shape[0]):
        b[i] /= d[i]
    for q in range(n):
        panel = panels[n - 1 - q]
        at, nc, col, rows, nr = panel["at"], panel["nc"], panel["col"], panel["rows"], panel["nr"]
        if nc <= 3:
            backward_small(at, nc, col, rows, nr, rows_of, U, b)
        elif nc <= 6:
            backward_several(at, nc, col, rows, nr, rows_of, U, b)
        else:
            _backward(at, nc, col, rows, nr, rows_of, U, b)


@kernel
def _backward(at, nc, col, rows, nr, rows_of, U, b):
    for i in range(nr):
        add_multiple(-b[rows_of[rows + i]], U, at + (nc + i) * nc, b, col, nc)
    for j in range(nc - 1):
        i = nc - 1 - j
        add_multiple(-b[col + i], U, at + i * nc, b, col, i)


@unit
def multiply(kkt: Kkt, fac: Factor, x: Vector, y: Vector) -> int:
    """y = S x with the unregularised matrix; both in elimination order."""
    if fac.symmetric[0] == 1:
        _multiply(kkt.panels, kkt.rows, fac.low0, fac.low0, fac.eps, x, y)
    else:
        _multiply(kkt.panels, kkt.rows, fac.low0, fac.up0, fac.eps, x, y)
    return SUCCESS


@kernel
def _multiply(panels, rows_of, L, U, eps, x, y):
    zero(y)
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
    """fac.sol = S⁻¹ fac.rhs, with iterative refinement by the matrix without regularisation."""
    copy(fac.rhs, fac.sol)
    solve(kkt, fac, fac.sol)
    for _ in range(rounds):
        refine(kkt, fac)
    return SUCCESS


@unit
def refine(kkt: Kkt, fac: Factor) -> int:
    """One round of iterative refinement of fac.sol = S⁻¹ fac.rhs."""
    rhs, x, tmp = fac.rhs, fac.sol, fac.tmp
    multiply(kkt, fac, x, tmp)
    for i in range(rhs.shape[0]):
        tmp[i] = rhs[i] - tmp[i]
    solve(kkt, fac, tmp)
    for i in range(rhs.shape[0]):
        x[i] += tmp[i]
    return SUCCESS


@unit
def add_body_block(run: Run, b: int, B: Matrix) -> int:
    """Add a dense block to the diagonal block of body b."""
    body, kkt, low, up = (
        run.system.parts.bodies[b],
        run.system.kkt,
        run.work.factor.low,
        run.work.factor.up,
    )
    panel, column, o = kkt.panels[body["panel"]], kkt.column, body["iv"]
    at, nc = panel["at"], panel["nc"]
    for r in range(6 + body["m"]):
        pr = column[o + r]
        if pr < 0:
            continue
        for c in range(6 + body["m"]):
            pc = column[o + c]
            if pr >= pc and pc >= 0:
                low[at + pr * nc + pc] += B[r, c]
            if pr <= pc:
                up[at + pc * nc + pr] += B[r, c]
    return SUCCESS


@unit
def add_coupling(run: Run, a: int, b: int, k: int, swapped: int, B: Matrix) -> int:
    """Add B as the block of bodies a and b; link k is that of the transpose if swapped is 1."""
    bodies, link, column = run.system.parts.bodies, run.system.kkt.links[k], run.system.kkt.column
    first, second, low, up = bodies[a], bodies[b], run.work.factor.low, run.work.factor.up
    at, stride = link["at"], link["stride"]
    early = (link["flipped"] == 1) != (swapped == 1)  # the rows' body is eliminated first
    for r in range(6 + first["m"]):
        pr = column[first["iv"] + r]
        if pr < 0:
            continue
        for c in range(6 + second["m"]):
            pc = column[second["iv"] + c]
            if pc < 0:
                continue
            if early:
                up[at + pc * stride + pr] += B[r, c]
            else:
                low[at + pr * stride + pc] += B[r, c]
    return SUCCESS


@kernel
def put_jacobian_row(link, r, body, kkt, jac, start, diagonal, values):
    """Put row r of a group, jac[start:] in the order of v, to its link; returns Σ Cq² / |diag|.

    The entries of the matrix must be zero before.
    """
    at, stride, o, column = link["at"], link["stride"], body["iv"], kkt.column
    first, s, flipped = kkt.panels[body["panel"]]["col"], 0.0, link["flipped"] == 1
    for c in range(6 + body["m"]):
        pc, x = column[o + c], jac[start + c]
        if x != 0.0 and pc >= 0:
            values[at + pc * stride + r if flipped else at + r * stride + pc] = x
            s += x * x / diagonal[first + pc]
    return s
