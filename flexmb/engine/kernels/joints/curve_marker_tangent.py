"""Tangents of joints on curve markers: what their scalar coordinates add to those of the bodies.

With w the wrench Cqᵀλ on the curve marker, J its twist per ṡ, D = ∂J/∂s and H the change of the
wrench pair with the motion of the markers: bodies × s gets the pull-back of H J and of the moment
c' × f (the lever grows along the curve), s × bodies that of Hᵀ J and of (c' × f, φ' z × m) (the
curve turns with its body), s × s gets Jᵀ H J + w·D.
"""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.bodies.wrench import add_pulled_back
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.joints.group_tangent import put_group_tangent
from flexmb.engine.method import FINE
from flexmb.engine.state import Point, Run


class CurveMarkers(NamedTuple):
    """Markers that slide along curves (`Parts.curve_markers`)."""


@unit
def add_tangents(run: Run, of: CurveMarkers, at: Point, cv: float, cp: float) -> int:
    """cp ∂(Cqᵀ λ)/∂q of all rows on curve markers, where s has a part in it."""
    sys, wk = run.system, run.work
    curves = sys.parts.curve_markers
    if cv == 0.0 and cp == 0.0:
        return FINE
    for k in range(curves.shape[0]):
        curve = curves[k]
        put_group_tangent(run, at.lam, curve["group"])
        row = sys.rows[sys.groups[curve["group"]]["row"]]
        _put_columns(sys.parts, curve, wk, row, cp, k)
        for side in range(2):
            link = curve["link_I"] if side == 0 else curve["link_J"]
            if link >= 0:
                b = sys.parts.markers[row["I"] if side == 0 else row["J"]]["body"]
                _add_border(sys.parts.bodies[b], sys.kkt, link, side, wk)
        _add_own(sys, curve, wk, cp, k)
        if curve["link_other"] >= 0:
            _add_other(sys, curve, wk, cp, k)
    return FINE


@kernel
def _put_columns(parts, curve, wk, row, cp, k):
    """Pull back what s and a body do to each other: columns to dense.T[side], rows to 2 + side."""
    d, J, o = wk.dense, wk.now.curve_marker[k]["J"], 6 * curve["side"]
    g, w = d.g[0], d.g[1]
    lx, ly, lz = cross(J[0], J[1], J[2], w[o], w[o + 1], w[o + 2])
    mx, my, mz = cross(J[3], J[4], J[5], w[o + 3], w[o + 4], w[o + 5])
    for part in range(2):
        for c in range(12):
            g[c] = 0.0
            for j in range(6):
                g[c] += (d.H[c, o + j] if part == 0 else d.H[o + j, c]) * J[j]
        g[o + 3] += lx + part * mx
        g[o + 4] += ly + part * my
        g[o + 5] += lz + part * mz
        for side in range(2):
            marker = row["I"] if side == 0 else row["J"]
            if parts.markers[marker]["body"] >= 0:
                out = d.T[2 * part + side]
                for c in range(out.shape[0]):
                    out[c] = 0.0
                add_pulled_back(parts, wk.now, marker, g, 6 * side, cp, out, 0)


@kernel
def _add_border(body, kkt, k, side, wk):
    """Add the column and the row of s on one body; link k is that of (body, s)."""
    link, column, low, up = kkt.links[k], kkt.column, wk.factor.low, wk.factor.up
    for c in range(6 + body["m"]):
        p = column[body["iv"] + c]
        if p >= 0:
            if link["flipped"] == 1:  # the body is eliminated first
                low[link["at"] + p] += wk.dense.T[2 + side, c]
                up[link["at"] + p] += wk.dense.T[side, c]
            else:
                low[link["at"] + p * link["stride"]] += wk.dense.T[side, c]
                up[link["at"] + p * link["stride"]] += wk.dense.T[2 + side, c]


@kernel
def _product(H, i, first, j, second):
    """first (6) · H[i:i+6, j:j+6] second (6)."""
    s = 0.0
    for a in range(6):
        for b in range(6):
            s += first[a] * H[i + a, j + b] * second[b]
    return s


@kernel
def _add_own(sys, curve, wk, cp, k):
    d, sn, o = wk.dense, wk.now.curve_marker[k], 6 * curve["side"]
    s = _product(d.H, o, sn["J"], o, sn["J"])
    for c in range(6):
        s += d.g[1, o + c] * sn["D"][c]
    at = sys.kkt.panels[sys.parts.coordinates[curve["coordinate"]]["panel"]]["at"]
    wk.factor.low[at] += cp * s
    wk.factor.up[at] += cp * s


@kernel
def _add_other(sys, curve, wk, cp, k):
    """Add the pair of entries of two curve markers of one joint; the link is that of (k, other)."""
    H, link, o = wk.dense.H, sys.kkt.links[curve["link_other"]], 6 * curve["side"]
    J, K = wk.now.curve_marker[k]["J"], wk.now.curve_marker[curve["other"]]["J"]
    mine, theirs = cp * _product(H, o, J, 6 - o, K), cp * _product(H, 6 - o, K, o, J)
    if link["flipped"] == 1:
        wk.factor.low[link["at"]] += theirs
        wk.factor.up[link["at"]] += mine
    else:
        wk.factor.low[link["at"]] += mine
        wk.factor.up[link["at"]] += theirs
