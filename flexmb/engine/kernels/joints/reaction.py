"""Reactions of joints and drivers: the wrench on both markers in their own axes, from λ."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import transform_back
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.joints import primitive


@kernel
def add_wrenches(lines, rows, group, markers, lam, g, w):
    """Add the wrenches on markers I and J of one group to w (12), global; g (12) is scratch."""
    for r in range(group["row"], group["row"] + group["n"]):
        row = rows[r]
        mi, mj = markers[row["I"]], markers[row["J"]]
        primitive.gradient(lines, row["kind"], row["a"], row["b"], mi, mj, g)
        for c in range(12):
            w[c] -= lam[r] * g[c]


@kernel
def read(sys, markers, lam, g, out):
    """out (12 groups): force and moment on the joint's marker J in its axes, then on its marker I.

    g (2, 12) is scratch.
    """
    for k in range(sys.groups.shape[0]):
        group, w = sys.groups[k], g[1]
        i, j = sys.rows[group["row"]]["I"], sys.rows[group["row"]]["J"]
        for c in range(12):
            w[c] = 0.0
        add_wrenches(sys.lines, sys.rows, group, markers, lam, g[0], w)
        for part in range(4):
            of_J = (part < 2) != (group["reversed"] == 1)
            R = markers[j]["R"] if of_J else markers[i]["R"]
            at = 3 * (part % 2) + (6 if of_J else 0)
            x, y, z = transform_back(R, w[at], w[at + 1], w[at + 2])
            put(out, 12 * k + 3 * part, x, y, z)
