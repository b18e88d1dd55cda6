"""Where dense blocks in v order go in the panels of the factor.

`column` (nv,) is the column of each velocity coordinate in its panel, modes before the rigid part;
−1 leaves it out of the system (out of the plane of a planar model).
"""

from __future__ import annotations

from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import FINE
from flexmb.engine.records import Matrix
from flexmb.engine.state import Run


@kernel
def clear(B, n, m):
    """B[:n, :m] = 0."""
    for r in range(n):
        for c in range(m):
            B[r, c] = 0.0


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
    return FINE


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
    return FINE


@kernel
def put_jacobian_row(link, r, body, column, jac, start, values):
    """Place Jacobian row r of a group, in v order at jac[start:], by its link."""
    at, stride, o = link["at"], link["stride"], body["iv"]
    for c in range(6 + body["m"]):
        pc = column[o + c]
        if pc >= 0:
            p = at + pc * stride + r if link["flipped"] == 1 else at + r * stride + pc
            values[p] = jac[start + c]


@kernel
def row_compliance(body, panels, column, jac, start, low):
    """Σ Cq² / diag(S) of one row on one body, over the coordinates that have inertia."""
    panel, o = panels[body["panel"]], body["iv"]
    at, nc = panel["at"], panel["nc"]
    s = 0.0
    for c in range(6 + body["m"]):
        pc = column[o + c]
        if pc >= 0:
            d = abs(low[at + pc * nc + pc])
            if d > 0.0:
                s += jac[start + c] * jac[start + c] / d
    return s


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
