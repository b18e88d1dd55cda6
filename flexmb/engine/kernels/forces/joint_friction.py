"""Friction in joints, on a scalar coordinate without mass that follows the joint's.

The normal force N comes from the joint's reaction on J in the axes of I. A bearing of length L
carries the lateral force F and the bending moment M as two forces at its ends,
R₁,₂ = F/2 ± (M × z)/L, so N = |R₁| + |R₂|; a guide of width w carries a torque T about its axis
with |T|/w more; a preload adds to it. N belongs to the multipliers of the iterate; its slope over
them stands in the unsymmetric iteration matrix, while reported accelerations are iterated for.
Where friction grows as fast as the forces that cause it, neither settles: the joint locks itself.
Source of the bearing's share: Haug, Wu & Yang, Mech. Mach. Theory 21 (1986) 401.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.rotation import transform_back
from flexmb.engine.kernels.forces.friction import along
from flexmb.engine.kernels.joints import primitive
from flexmb.engine.kernels.joints.reaction import add_wrenches
from flexmb.engine.tables import SLIDES


@kernel
def rubs(frictions):
    """Whether there is friction in any joint."""
    if frictions is not None:
        return frictions.shape[0] > 0
    return False


@kernel
def put_grips(sys, frictions, wk, lam):
    """Normal forces of all joint frictions for these multipliers; returns the largest change."""
    change = 0.0
    if frictions is not None:
        for k in range(frictions.shape[0]):
            N = _normal_force(sys, frictions[k], wk, lam)
            step = abs(N - wk.now.grip[k, 0])
            if not step <= change:
                change = step
            wk.now.grip[k, 0] = N
    return change


@kernel
def _bearing(sys, f, markers, w):
    """The forces R₁ and R₂ across the axis (2 each), and T/w, of the wrench w on J."""
    R = markers[sys.rows[sys.groups[f["group"]]["row"]]["I"]]["R"]
    F = transform_back(R, w[6], w[7], w[8])
    M = transform_back(R, w[9], w[10], w[11])
    a, b = (f["axis"] + 1) % 3, (f["axis"] + 2) % 3
    x, y, u, v, turn = 0.5 * F[a], 0.5 * F[b], 0.0, 0.0, 0.0
    if f["length"] > 0.0:
        u, v = M[b] / f["length"], -M[a] / f["length"]
    if f["width"] > 0.0:
        turn = M[f["axis"]] / f["width"]
    return x + u, y + v, x - u, y - v, turn


@kernel
def _reaction(sys, f, wk, lam):
    """What `_bearing` says of the joint's own reaction."""
    w = wk.dense.g[1]
    for c in range(12):
        w[c] = 0.0
    group = sys.groups[f["group"]]
    add_wrenches(sys.lines, sys.rows, group, wk.now.marker, lam, wk.dense.g[0], w)
    return _bearing(sys, f, wk.now.marker, w)


@kernel
def _normal_force(sys, f, wk, lam):
    a, b, c, d, turn = _reaction(sys, f, wk, lam)
    return math.sqrt(a * a + b * b) + math.sqrt(c * c + d * d) + abs(turn) + f["preload"]


@kernel
def _surface(f, coordinates, grip, kept, q, v):
    """Friction at the surface for place and rate of its coordinate, as `friction.along`."""
    s = coordinates[f["coordinate"]]
    x, rate = f["radius"] * q[s["iq"]], f["radius"] * v[s["iv"]]
    return along(f, grip, x, rate, kept[f["kept"]])


@kernel
def put_forces(sys, frictions, wk, q, v):
    """res −= friction on its coordinate, for all joint frictions."""
    if frictions is not None:
        coordinates = sys.parts.coordinates
        for k in range(frictions.shape[0]):
            f, grip = frictions[k], wk.now.grip
            force, _, _, _, _, _ = _surface(f, coordinates, grip[k, 0], wk.now.kept, q, v)
            grip[k, 1] = force
            wk.trial.res[coordinates[f["coordinate"]]["iv"]] -= f["radius"] * force


@kernel
def add_tangents(sys, frictions, wk, v, cv, cp):
    """cv ∂F/∂v + cp ∂F/∂q on the diagonal of each coordinate.

    As all that acts on coordinates without mass, not at the acceleration level.
    """
    if frictions is not None and cv != 0.0:
        for k in range(frictions.shape[0]):
            f = frictions[k]
            s = sys.parts.coordinates[f["coordinate"]]
            at = sys.kkt.panels[s["panel"]]["at"]
            x = f["radius"] * wk.con.fun[sys.rows[f["row"]]["fun"], 0]
            rate, anchor = f["radius"] * v[s["iv"]], wk.now.kept[f["kept"]]
            _, _, _, _, stiff, viscous = along(f, wk.now.grip[k, 0], x, rate, anchor)
            diagonal = f["radius"] ** 2 * (cp * stiff + cv * viscous)
            wk.factor.low[at] += diagonal
            wk.factor.up[at] += diagonal


@kernel
def put_couplings(sys, frictions, wk, v, lam):
    """−∂(friction on its coordinate)/∂λ of all joint frictions, in the unsymmetric matrix."""
    if frictions is not None:
        for k in range(frictions.shape[0]):
            f, N = frictions[k], wk.now.grip[k, 0]
            s = sys.parts.coordinates[f["coordinate"]]
            x = f["radius"] * wk.con.fun[sys.rows[f["row"]]["fun"], 0]
            rate, anchor = f["radius"] * v[s["iv"]], wk.now.kept[f["kept"]]
            force, _, mode, _, _, _ = along(f, N, x, rate, anchor)
            if mode == SLIDES and N > 0.0:  # then the force is in proportion to N
                _put_coupling(sys, f, wk, lam, -f["radius"] * force / N)


@kernel
def _put_coupling(sys, f, wk, lam, factor):
    """factor ∂N/∂λ in the row of the coordinate, at the columns of the joint's rows."""
    group, link = sys.groups[f["group"]], sys.kkt.links[f["link"]]
    a, b, c, d, turn = _reaction(sys, f, wk, lam)
    first, second = math.sqrt(a * a + b * b), math.sqrt(c * c + d * d)
    g, markers = wk.dense.g[0], wk.now.marker
    for r in range(group["n"]):
        row = sys.rows[group["row"] + r]
        mi, mj = markers[row["I"]], markers[row["J"]]
        primitive.gradient(sys.lines, row["kind"], row["a"], row["b"], mi, mj, g)
        p, q, s, t, change = _bearing(sys, f, markers, g)  # of λ = −1
        slope = -change if turn > 0.0 else change if turn < 0.0 else 0.0
        if first > 0.0:
            slope -= (a * p + b * q) / first
        if second > 0.0:
            slope -= (c * s + d * t) / second
        if link["flipped"] == 1:
            wk.factor.low[link["at"] + r] = factor * slope
        else:
            wk.factor.up[link["at"] + r * link["stride"]] = factor * slope


@kernel
def power(frictions, coordinates, now, q, v):
    """Power of all joint frictions, that into bristles included, W."""
    p = 0.0
    if frictions is not None:
        for k in range(frictions.shape[0]):
            f = frictions[k]
            force, _, _, _, _, _ = _surface(f, coordinates, now.grip[k, 0], now.kept, q, v)
            p += force * f["radius"] * v[coordinates[f["coordinate"]]["iv"]]
    return p


@kernel
def bristle_energy(frictions, coordinates, now, q, v):
    """Energy in the bristles, ½ k s², J."""
    e = 0.0
    if frictions is not None:
        for k in range(frictions.shape[0]):
            f = frictions[k]
            _, anchor, _, _, _, _ = _surface(f, coordinates, now.grip[k, 0], now.kept, q, v)
            x = f["radius"] * q[coordinates[f["coordinate"]]["iq"]]
            e += 0.5 * f["k"] * (x - anchor) ** 2
    return e


@kernel
def begin(frictions, coordinates, q, kept):
    """Free all bristles at the first position."""
    if frictions is not None:
        for k in range(frictions.shape[0]):
            f = frictions[k]
            kept[f["kept"]] = f["radius"] * q[coordinates[f["coordinate"]]["iq"]]
            kept[f["kept"] + 1] = 0.0


@kernel
def keep(frictions, coordinates, now, q, v, kept):
    """Write the memory of all joint frictions at an accepted state."""
    if frictions is not None:
        for k in range(frictions.shape[0]):
            f = frictions[k]
            _, anchor, mode, _, _, _ = _surface(f, coordinates, now.grip[k, 0], now.kept, q, v)
            kept[f["kept"]] = anchor
            kept[f["kept"] + 1] = mode


@kernel
def slip(f, coordinates, grip, kept, q, v):
    """What crosses zero from below where it begins to slide, or to stick, as `contact.slip`."""
    _, _, _, excess, _, _ = _surface(f, coordinates, grip, kept, q, v)
    s = coordinates[f["coordinate"]]
    stretch = f["radius"] * q[s["iq"]] - kept[f["kept"]]
    if kept[f["kept"] + 1] != SLIDES or stretch == 0.0:
        return excess
    return -v[s["iv"]] * f["radius"] * (1.0 if stretch > 0.0 else -1.0)
