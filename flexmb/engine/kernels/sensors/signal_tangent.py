"""Tangents of functions over channels: rank-one blocks −(what acts) (∂f/∂m) (∂m/∂q, ∂m/∂v)ᵀ.

∂f/∂m of a channel m is the first derivative of the program with the rate of that channel alone set
to one. ∂m/∂q has two parts: the gradient with the motions of the markers, and, for velocities, what
their lever arms do at constant v. Exact for positions, velocities and states; of accelerations the
part with v̇ is kept, what the pose does to them and to reactions is left to Newton's iteration.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.blocks import clear
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.kernels.bodies.kinematics import add_pulled_back
from flexmb.engine.kernels.forces.force_tangent import put_unit_force
from flexmb.engine.kernels.functions.function import evaluate
from flexmb.engine.kernels.joints import primitive, row_tangent
from flexmb.engine.kernels.sensors import turning
from flexmb.engine.sensor_tables import (
    ALONG,
    ALONG_A,
    ALONG_OM,
    ALONG_OMD,
    ALONG_V,
    ALONG_X,
    TURNING,
)

_POSITION, _VELOCITY, _ACCELERATION = 0, 1, 2


@kernel
def signal_tangents(signals, sys, wk, v, cv, cp):
    """Add the tangents of all functions over channels to the matrix of a step."""
    if signals is not None:
        _partial_derivatives(signals, sys, wk)
        live, low, up = wk.live, wk.factor.low, wk.factor.up
        for k in range(signals.pulls.shape[0]):
            pull = signals.pulls[k]
            slope = live.slopes[pull["partial"]]
            if slope == 0.0:
                continue
            iv, n = _left(sys, wk, pull)
            if pull["state"] >= 0:
                jv, m = pull["state"], 1
                live.right[0] = cv
            else:
                channel = signals.partials[pull["partial"]]["channel"]
                jv, m = _right(sys, wk, channel, pull, v, cv, cp)
            _add_outer(sys.kkt, pull, iv, n, jv, m, -slope, live, low, up)


@kernel
def _partial_derivatives(signals, sys, wk):
    """Slopes of the programs with each of their channels; none where there is no finite one."""
    x, t, live = wk.trial.variables, wk.live.t[0], wk.live
    for k in range(signals.partials.shape[0]):
        p, c = signals.partials[k]["program"], signals.partials[k]["channel"]
        _, own, _ = evaluate(sys.functions, p, t, x, wk.trial.stack)
        x[c, 1] = 1.0
        _, slope, _ = evaluate(sys.functions, p, t, x, wk.trial.stack)
        x[c, 1] = 0.0
        live.slopes[k] = slope - own if math.isfinite(slope - own) else 0.0


@kernel
def _left(sys, wk, pull):
    """Generalised force per unit of what acts, into live.left; first coordinate, and how many."""
    left = wk.live.left
    if pull["load"] < 0:
        left[0] = 1.0
        return pull["iv"], 1
    beyond = pull["load"] - sys.loads.shape[0]
    if beyond >= 0:
        return put_unit_force(sys.elements, sys.parts, wk, beyond, pull["a"])
    load, a, w = sys.loads[pull["load"]], pull["a"], wk.dense.g[1]
    k, o = load["marker"], 3 * load["torque"]
    body = sys.parts.bodies[sys.parts.markers[k]["body"]]
    for c in range(6):
        w[c] = 0.0
    if load["follower"] == 1:
        R = wk.now.marker[k]["R"]
        put(w, o, R[0, a], R[1, a], R[2, a])
    else:
        w[o + a] = 1.0
    n = 6 + body["m"]
    for c in range(n):
        left[c] = 0.0
    add_pulled_back(sys.parts, wk.now, k, w, 0, 1.0, left, 0)
    return body["iv"], n


@kernel
def _right(sys, wk, channel, pull, v, cv, cp):
    """cp ∂m/∂q + cv ∂m/∂v (+ ∂m/∂v̇) of one term on one side, into live.right; as `_left`."""
    term, live = sys.sensors.terms[pull["term"]], wk.live
    g, right, B = live.g, live.right, wk.dense.B
    level = _gradients(sys, wk, term, channel)
    k, o = term["I"] if pull["side"] == 0 else term["J"], 6 * pull["side"]
    body = sys.parts.bodies[sys.parts.markers[k]["body"]]
    n, iv = 6 + body["m"], body["iv"]
    for c in range(n):
        right[c] = 0.0
    f = term["factor"]
    if level == _ACCELERATION:
        add_pulled_back(sys.parts, wk.now, k, g[1], o, f, right, 0)
        return iv, n
    add_pulled_back(sys.parts, wk.now, k, g[0], o, cp * f, right, 0)
    if level == _VELOCITY:
        add_pulled_back(sys.parts, wk.now, k, g[1], o, cv * f, right, 0)
        clear(B, n, n)
        tangent.add_lever_tangent(sys.parts, wk.now, k, g[1], o, cp * f, B)
        for r in range(n):
            for c in range(n):
                right[c] += v[iv + r] * B[r, c]
    return iv, n


@kernel
def _gradients(sys, wk, term, channel):
    """Gradients of a term with poses (g[0]) and velocities (g[1]) of its markers; its level."""
    g, kind = wk.live.g, term["kind"]
    for c in range(12):
        g[0, c] = 0.0
        g[1, c] = 0.0
    markers = wk.now.marker
    if kind >= ALONG:
        return _along(markers, term, g)
    mi, mj, a, b = markers[term["I"]], markers[term["J"]], term["a"], term["b"]
    if kind == TURNING:
        _turning(term, channel - b, mi["R"], mj["R"], wk.live, g[0])
        return _POSITION
    if term["level"] == _POSITION:
        primitive.gradient(sys.lines, kind, a, b, mi, mj, g[0])
        return _POSITION
    primitive.gradient(sys.lines, kind, a, b, mi, mj, g[1])
    if term["level"] == _VELOCITY:
        # the rate is g·u, and its change with the poses Hᵀ u
        H, u = wk.dense.H, g[2]
        clear(H, 12, 12)
        row_tangent.add_row_tangent(sys.lines, kind, a, b, mi, mj, 1.0, g[3], H)
        for c in range(3):
            u[c], u[3 + c], u[6 + c], u[9 + c] = mi["vx"][c], mi["om"][c], mj["vx"][c], mj["om"][c]
        for c in range(12):
            for r in range(12):
                g[0, c] += H[r, c] * u[r]
    return term["level"]


@kernel
def _along(markers, term, g):
    """d·u of a motion u of marker J along an axis d of marker I."""
    kind, a, mj = term["kind"], term["a"], markers[term["J"]]
    u = mj["x"] if kind == ALONG_X else mj["vx"] if kind in (ALONG_V, ALONG_A) else mj["om"]
    dx, dy, dz = 1.0 * (a == 0), 1.0 * (a == 1), 1.0 * (a == 2)
    ux, uy, uz = u[0], u[1], u[2]
    if term["I"] >= 0:
        R, om = markers[term["I"]]["R"], markers[term["I"]]["om"]
        dx, dy, dz = R[0, a], R[1, a], R[2, a]
        if kind > ALONG_OMD:  # d·(ω_I × ω_J)
            x, y, z = cross(ux, uy, uz, dx, dy, dz)
            put(g[1], 3, x, y, z)
            x, y, z = cross(dx, dy, dz, om[0], om[1], om[2])
            put(g[1], 9, x, y, z)
            ux, uy, uz = cross(om[0], om[1], om[2], ux, uy, uz)
        x, y, z = cross(dx, dy, dz, ux, uy, uz)
        put(g[0], 3, x, y, z)
    if kind == ALONG_X:
        put(g[0], 6, dx, dy, dz)
        return _POSITION
    if kind <= ALONG_OMD:
        put(g[1], 9 if kind in (ALONG_OM, ALONG_OMD) else 6, dx, dy, dz)
    return _ACCELERATION if kind in (ALONG_A, ALONG_OMD) else _VELOCITY


@kernel
def _turning(term, c, Ri, Rj, live, g):
    """One of three turning angles, the first being channel c, on the branch of its last value."""
    near = live.near
    first, _, _ = turning.angles(term["a"], Ri, Rj, near[c], near[c + 1], near[c + 2])
    x, y, z = turning.gradient(term["a"], term["b"], Ri, Rj, first)
    put(g, 3, -x, -y, -z)
    put(g, 9, x, y, z)


@kernel
def _add_outer(kkt, pull, iv, n, jv, m, f, live, low, up):
    """Add f left rightᵀ as the block of two sets of coordinates, or on the diagonal of one."""
    column, diagonal = kkt.column, pull["link"] < 0
    early = False
    at, stride = kkt.panels[pull["panel"]]["at"], kkt.panels[pull["panel"]]["nc"]
    if not diagonal:
        link = kkt.links[pull["link"]]
        at, stride, early = link["at"], link["stride"], link["flipped"] == 1
    for r in range(n):
        pr = column[iv + r]
        for c in range(m):
            pc = column[jv + c]
            if pr < 0 or pc < 0:
                continue
            x = f * live.left[r] * live.right[c]
            if early or (diagonal and pr <= pc):
                up[at + pc * stride + pr] += x
            if not early and (not diagonal or pr >= pc):
                low[at + pr * stride + pc] += x
