"""Reactions of joints and drivers: the wrench on both markers in their own axes, from λ."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels import primitive
from flexmb.engine.kernels.rotation import transform_back
from flexmb.engine.kernels.vector import put


@kernel
def put_wrench(sys, markers, group, lam, g, w):
    """w (12): the wrenches −Σ λ_k ∂C_k/∂(motion) of a group on I and J, global axes; g: scratch."""
    for c in range(12):
        w[c] = 0.0
    for r in range(group["row"], group["row"] + group["n"]):
        row = sys.rows[r]
        mi, mj = markers[row["I"]], markers[row["J"]]
        primitive.gradient(sys.lines, row["kind"], row["a"], row["b"], mi, mj, g)
        for c in range(12):
            w[c] -= lam[r] * g[c]


@kernel
def read(sys, markers, lam, g, out):
    """out (12 groups): force and moment on marker J in its axes, then on marker I in its axes.

    g (2, 12) is scratch.
    """
    for k in range(sys.groups.shape[0]):
        group, w = sys.groups[k], g[1]
        i, j = sys.rows[group["row"]]["I"], sys.rows[group["row"]]["J"]
        put_wrench(sys, markers, group, lam, g[0], w)
        for part in range(4):
            R = markers[j]["R"] if part < 2 else markers[i]["R"]
            at = 6 + 3 * part if part < 2 else 3 * part - 6
            x, y, z = transform_back(R, w[at], w[at + 1], w[at + 2])
            put(out, 12 * k + 3 * part, x, y, z)
