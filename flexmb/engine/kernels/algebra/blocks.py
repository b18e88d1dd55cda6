"""Where dense blocks in v order go in the panels of the factor.

`column` (nv,) is the column of each velocity coordinate in its panel, modes before the rigid part;
−1 leaves it out of the system (out of the plane of a planar model).
"""

from __future__ import annotations

from flexmb.engine.jit import kernel


@kernel
def clear(B, n, m):
    """B[:n, :m] = 0."""
    for r in range(n):
        for c in range(m):
            B[r, c] = 0.0


@kernel
def add_body_block(body, kkt, B, low, up):
    """Add a dense block to the diagonal block of a body."""
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


@kernel
def add_coupling(B, first, second, kkt, k, swapped, low, up):
    """Add B as the block of two bodies; link k is that of the transpose if swapped."""
    link, column = kkt.links[k], kkt.column
    at, stride = link["at"], link["stride"]
    early = (link["flipped"] == 1) != swapped  # the rows' body is eliminated first
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


@kernel
def put_row(link, r, body, column, jac, start, values):
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
