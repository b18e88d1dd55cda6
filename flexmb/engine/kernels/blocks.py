"""Where dense blocks in v order go in the panels of the factor (modes before the rigid part)."""

from __future__ import annotations

from flexmb.engine.jit import kernel


@kernel
def local_column(c, m):
    """Column in the panel of velocity coordinate c of a body with m modes."""
    return c + m if c < 6 else c - 6


@kernel
def clear(B, n, m):
    """B[:n, :m] = 0."""
    for r in range(n):
        for c in range(m):
            B[r, c] = 0.0


@kernel
def add_body_block(body, panel, B, low, up):
    """Add a dense block to the diagonal block of a body."""
    m, at, nc = body["m"], panel["at"], panel["nc"]
    for r in range(6 + m):
        pr = local_column(r, m)
        for c in range(6 + m):
            pc = local_column(c, m)
            if pr >= pc:
                low[at + pr * nc + pc] += B[r, c]
            if pr <= pc:
                up[at + pc * nc + pr] += B[r, c]


@kernel
def add_coupling(B, m, n, link, swapped, low, up):
    """Add B (6+m, 6+n) as the block of two bodies; the link is that of the transpose if swapped."""
    at, stride = link["at"], link["stride"]
    early = (link["flipped"] == 1) != swapped  # the rows' body is eliminated first
    for r in range(6 + m):
        pr = local_column(r, m)
        for c in range(6 + n):
            pc = local_column(c, n)
            if early:
                up[at + pc * stride + pr] += B[r, c]
            else:
                low[at + pr * stride + pc] += B[r, c]


@kernel
def put_row(link, r, jac, start, m, values):
    """Place Jacobian row r of a group, in v order at jac[start:], by its link."""
    at, stride = link["at"], link["stride"]
    for c in range(6 + m):
        pc = local_column(c, m)
        p = at + pc * stride + r if link["flipped"] == 1 else at + r * stride + pc
        values[p] = jac[start + c]


@kernel
def row_compliance(panel, m, jac, start, low):
    """Σ Cq² / diag(S) of one row on one body, over the coordinates that have inertia."""
    at, nc = panel["at"], panel["nc"]
    s = 0.0
    for c in range(6 + m):
        pc = local_column(c, m)
        d = abs(low[at + pc * nc + pc])
        if d > 0.0:
            s += jac[start + c] * jac[start + c] / d
    return s
