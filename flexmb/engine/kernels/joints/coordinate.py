"""Scalar coordinates beside the bodies: m s̈ + c ṡ + k (s − s0) = u(t) + reactions.

A row can follow coordinates in place of a function of time, C = (measure) − Σ f s: its reaction
then acts on each s, f times. Two rows that follow one coordinate are coupled, as gears are. Without
mass s is a parameter that rows decide; with mass and damping only, ṡ is a first-order state. States
beside the bodies have mass one and no row, ṡ is the state and u its rate; they have no energy.
Values and rates of the sums stand beside those of the functions in Constraints.fun.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel


@kernel
def put_values(coordinates, sys, q, fun):
    """Σ f s of all rows that follow coordinates, as the value of their slots."""
    if coordinates is not None:
        for k in range(sys.follows.shape[0]):
            follow = sys.follows[k]
            slot = sys.rows[follow["row"]]["fun"]
            if follow["first"] == 1:
                fun[slot, 0] = 0.0
                fun[slot, 2] = 0.0  # s̈ is an unknown
            fun[slot, 0] += follow["factor"] * q[coordinates[follow["coordinate"]]["iq"]]


@kernel
def put_rates(coordinates, sys, v, fun):
    """Σ f ṡ of all rows that follow coordinates, as the rate of their slots."""
    if coordinates is not None:
        for k in range(sys.follows.shape[0]):
            follow = sys.follows[k]
            slot = sys.rows[follow["row"]]["fun"]
            if follow["first"] == 1:
                fun[slot, 1] = 0.0
            fun[slot, 1] += follow["factor"] * v[coordinates[follow["coordinate"]]["iv"]]


@kernel
def put_forces(sys, coordinates, wk, q, v, vd, lam):
    """res = m s̈ + c ṡ + k (s − s0) − u + Cqᵀ λ of all coordinates."""
    if coordinates is not None:
        res = wk.trial.res
        for k in range(coordinates.shape[0]):
            s = coordinates[k]
            i = s["iv"]
            res[i] = s["m"] * vd[i] + s["c"] * v[i] + s["k"] * (q[s["iq"]] - s["s0"])
            if s["fun"] >= 0:
                res[i] -= wk.con.fun[s["fun"], 0]
        for k in range(sys.follows.shape[0]):
            follow = sys.follows[k]
            i = coordinates[follow["coordinate"]]["iv"]
            res[i] -= follow["factor"] * lam[follow["row"]]


@kernel
def add_tangents(coordinates, kkt, cv, cp, low, up):
    """m + cv c + cp k on the diagonal.

    At the acceleration level, cv = 0, stiffness stands beside the mass so that stiff modes do not
    spoil reactions; a coordinate without mass has no such mode.
    """
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            s = coordinates[k]
            at = kkt.panels[s["panel"]]["at"]
            diagonal = s["m"] + cv * s["c"]
            if s["m"] > 0.0 or cv != 0.0:
                diagonal += cp * s["k"]
            low[at] += diagonal
            up[at] += diagonal


@kernel
def put_metric(coordinates, kkt, metric, low):
    """The metric of all coordinates on the diagonal."""
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            low[kkt.panels[coordinates[k]["panel"]]["at"]] = metric[coordinates[k]["iv"]]


@kernel
def put_rows(sys, coordinates, factor):
    """−f of the rows that follow coordinates in the Jacobian."""
    if coordinates is not None:
        for k in range(sys.follows.shape[0]):
            follow = sys.follows[k]
            link, r = sys.kkt.links[follow["link"]], sys.rows[follow["row"]]["in_group"]
            at = link["at"] + r * (1 if link["flipped"] == 1 else link["stride"])
            factor.low[at] = -follow["factor"]
            if factor.symmetric[0] == 0:
                factor.up[at] = -follow["factor"]


@kernel
def move(coordinates, q, dq, out):
    """out = q + dq."""
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            out[coordinates[k]["iq"]] = q[coordinates[k]["iq"]] + dq[coordinates[k]["iv"]]


@kernel
def position_rate(coordinates, v, out):
    """out = v."""
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            out[coordinates[k]["iq"]] = v[coordinates[k]["iv"]]


@kernel
def kinetic(coordinates, v):
    """Σ ½ m ṡ², J."""
    e = 0.0
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            if coordinates[k]["state"] == 0:
                e += 0.5 * coordinates[k]["m"] * v[coordinates[k]["iv"]] ** 2
    return e


@kernel
def spring_energy(coordinates, q):
    """Σ ½ k (s − s0)², J."""
    e = 0.0
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            s = q[coordinates[k]["iq"]] - coordinates[k]["s0"]
            e += 0.5 * coordinates[k]["k"] * s * s
    return e


@kernel
def damper_power(coordinates, v):
    """−Σ c ṡ², W."""
    p = 0.0
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            p -= coordinates[k]["c"] * v[coordinates[k]["iv"]] ** 2
    return p


@kernel
def force_power(coordinates, fun, v):
    """Σ u ṡ, W."""
    p = 0.0
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            if coordinates[k]["fun"] >= 0 and coordinates[k]["state"] == 0:
                p += fun[coordinates[k]["fun"], 0] * v[coordinates[k]["iv"]]
    return p


@kernel
def multiply_mass(coordinates, x, out, place):
    """out[place] = m x."""
    if coordinates is not None:
        for k in range(coordinates.shape[0]):
            i = coordinates[k]["iv"]
            out[place[i]] = coordinates[k]["m"] * x[i]
