"""Constraint rows of the whole system: values, wrenches, rates, right sides, Jacobian rows."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.bodies.kinematics import add_pulled_back
from flexmb.engine.kernels.joints import primitive
from flexmb.engine.tables import POINT


@kernel
def evaluate(lines, rows, markers, con):
    """C of all rows."""
    for k in range(rows.shape[0]):
        row = rows[k]
        f = row["offset"]
        if row["fun"] >= 0:
            f += con.fun[row["fun"], 0]
        con.C[k] = primitive.value(
            lines, row["kind"], row["a"], row["b"], markers[row["I"]], markers[row["J"]], f
        )


@kernel
def subtract_reactions(lines, rows, markers, lam, g):
    """Wrenches of the markers −= λ g of all rows; g (12) is scratch."""
    for k in range(rows.shape[0]):
        row = rows[k]
        mi, mj = markers[row["I"]], markers[row["J"]]
        if row["kind"] == POINT:
            mi["W"][row["a"]] += lam[k]
            mj["W"][row["a"]] -= lam[k]
            continue
        primitive.gradient(lines, row["kind"], row["a"], row["b"], mi, mj, g)
        for c in range(6):
            mi["W"][c] -= lam[k] * g[c]
            mj["W"][c] -= lam[k] * g[6 + c]


@kernel
def rates(lines, rows, markers, con, g):
    """Cq v + C_t of all rows, from the velocities of the markers."""
    for k in range(rows.shape[0]):
        row = rows[k]
        mi, mj = markers[row["I"]], markers[row["J"]]
        if row["kind"] == POINT:
            con.rate[k] = mj["vx"][row["a"]] - mi["vx"][row["a"]]
            continue
        primitive.gradient(lines, row["kind"], row["a"], row["b"], mi, mj, g)
        con.rate[k] = primitive.rate(g, mi, mj)
        if row["fun"] >= 0:
            con.rate[k] -= con.fun[row["fun"], 1]


@kernel
def right_side(lines, rows, markers, con, g):
    """γ of Cq v̇ = γ, from the velocities and acceleration biases of the markers."""
    for k in range(rows.shape[0]):
        row = rows[k]
        mi, mj = markers[row["I"]], markers[row["J"]]
        primitive.gradient(lines, row["kind"], row["a"], row["b"], mi, mj, g)
        s = primitive.curvature(lines, row["kind"], row["a"], row["b"], mi, mj)
        for c in range(3):
            s += g[c] * mi["bx"][c] + g[3 + c] * mi["bom"][c]
            s += g[6 + c] * mj["bx"][c] + g[9 + c] * mj["bom"][c]
        if row["fun"] >= 0:
            s -= con.fun[row["fun"], 2]
        con.gamma[k] = -s


@kernel
def jacobian(lines, parts, now, rows, dense):
    """Rows of Cq on the bodies of their two markers, into dense.jac."""
    g = dense.g[0]
    for k in range(rows.shape[0]):
        row = rows[k]
        i, j = row["I"], row["J"]
        primitive.gradient(lines, row["kind"], row["a"], row["b"], now.marker[i], now.marker[j], g)
        for side in range(2):
            at = row["jac_I"] if side == 0 else row["jac_J"]
            if at >= 0:
                k_side = i if side == 0 else j
                _pull_back_row(parts, now, k_side, g, 6 * side, dense.jac, at)


@kernel
def _pull_back_row(parts, now, k, g, i, jac, at):
    n = 6 + parts.bodies[parts.markers[k]["body"]]["m"]
    for c in range(n):
        jac[at + c] = 0.0
    add_pulled_back(parts, now, k, g, i, 1.0, jac, at)
