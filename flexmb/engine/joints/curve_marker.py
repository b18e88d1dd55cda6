"""Curve markers: markers that slide along a curve which is fixed to a body.

The position of a curve marker is x + R c(s), with x and R of the marker that carries the curve and
the scalar coordinate s. On a plane curve its axes are the tangent t, the normal n and z of the
plane. The curve consists of polynomials of degree seven with |c'| = 1, so s is the arc length.
Beyond the ends of an open curve it is continued with the curvature of its end, so that iterates of
Newton's method can return from there.

J = (R c', φ' z) is the twist of the marker per ṡ, φ the angle of the tangent. The velocity of the
marker is J ṡ in addition to that of the material point at its place. The equation of s is
−W·J = 0, W the wrench on the marker (Haug, Computer Aided Kinematics and Dynamics, 1989, §3.5;
Hong & Liu 2011, §1.3).

Tangents: w = (f, m) is the wrench Cqᵀλ on the curve marker, D = ∂J/∂s, and H the derivative of the
wrench pair with respect to the positions of the markers. The blocks of the matrix are:
bodies × s: H J and the moment c' × f, since the moment arm changes along the curve;
s × bodies: Hᵀ J and (c' × f, φ' z × m), since the curve turns with its body;
s × s: Jᵀ H J + w·D. The first two are pulled back from the markers to the bodies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.algebra.vector import cross, put_part, turned, turned_back, zero
from flexmb.engine.bodies.wrench import add_generalized_force
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.constraint import put_group_tangent
from flexmb.engine.joints.row import put_row_gradient
from flexmb.engine.kind import Kind
from flexmb.engine.method import CURVE_END, SUCCESS
from flexmb.engine.state import Point, Run

Array = NDArray[np.float64]
COEFFICIENTS = 8
"""Coefficients of the polynomial of a piece of a curve, of degree seven."""


class Pieces(NamedTuple):
    """Ends of pieces along the curve (n + 1,) [m], coefficients (n, 3, 8), relative error, jump.

    `breaks` (k, 2) are arc lengths [m] at which the curvature or its slope jumps, and how far a
    jump moves the curve until the next break, over its size.
    """

    ends: Array
    coefficients: Array
    error: float = 0.0
    jump: float = 0.0
    breaks: Array = np.zeros((0, 2))

    @classmethod
    def of_pool(cls, pool: Array, at: int, n: int) -> Pieces:
        """The pieces of a curve from the pool of numbers, n pieces from index `at` on."""
        first, size = at + n + 1, 3 * COEFFICIENTS * n
        return cls(pool[at:first], pool[first : first + size].reshape(n, 3, COEFFICIENTS))

    def at(self, s: Array) -> Array:
        """(n, 3, 3) position, unit tangent and curvature vector at arc lengths s (n,)."""
        k = np.clip(np.searchsorted(self.ends, s, side="right") - 1, 0, len(self.coefficients) - 1)
        t, n = (s - self.ends[k])[:, None], np.arange(COEFFICIENTS)
        first, second = n * t ** np.maximum(n - 1, 0), n * (n - 1) * t ** np.maximum(n - 2, 0)
        powers = np.stack([t**n, first, second], axis=1)
        return np.einsum("kdn,kan->kda", powers, self.coefficients[k])


class CurveMarkers(NamedTuple):
    """Markers that slide along curves (`Parts.curve_markers`)."""


# A curve marker may be beyond the end of an open curve by this fraction of the length: round-off.
_ROUND_OFF = 1e-9


@kernel
def _piece(pool, curve, s):
    """Number of the piece that contains s, s from its begin, and its length.

    s is taken modulo the length of a closed curve; it may be beyond the ends of an open one.
    """
    at, n = curve["at"], curve["n"]
    length = pool[at + n]
    if curve["closed"] == 1:
        s -= length * np.floor(s / length)
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if pool[at + middle] <= s:
            low = middle
        else:
            high = middle
    return low, s - pool[at + low], pool[at + low + 1] - pool[at + low]


@kernel
def _component(pool, o, t):
    """Value and three derivatives at t of the polynomial Σ pool[o + k] t^k, k = 0..7."""
    a, b, c, d, e, f = pool[o], pool[o + 1], pool[o + 2], pool[o + 3], pool[o + 4], pool[o + 5]
    g, h = pool[o + 6], pool[o + 7]
    return (
        a + t * (b + t * (c + t * (d + t * (e + t * (f + t * (g + t * h)))))),
        b
        + t
        * (2.0 * c + t * (3.0 * d + t * (4.0 * e + t * (5.0 * f + t * (6.0 * g + t * 7.0 * h))))),
        2.0 * c + t * (6.0 * d + t * (12.0 * e + t * (20.0 * f + t * (30.0 * g + t * 42.0 * h)))),
        6.0 * d + t * (24.0 * e + t * (60.0 * f + t * (120.0 * g + t * 210.0 * h))),
    )


@kernel
def _coordinate_of_curve(pool, curve, s, axis):
    """c(s) and three derivatives along one axis of the marker that carries the curve."""
    k, t, width = _piece(pool, curve, s)
    o = curve["at"] + curve["n"] + 1 + 24 * k + 8 * axis
    inside = min(max(t, 0.0), width)
    c, c1, c2, c3 = _component(pool, o, inside)
    d = t - inside
    if d == 0.0:
        return c, c1, c2, c3
    return c + d * (c1 + 0.5 * d * c2), c1 + d * c2, c2, 0.0


@unit
def place_curve_markers(run: Run, of: CurveMarkers, at: Point) -> int:
    """Put position and axes of all curve markers, which are those of their carriers before."""
    parts, now = run.system.parts, run.work.now
    markers = parts.curve_markers
    for k in range(markers.shape[0]):
        curve, cn = markers[k], now.curve_marker[k]
        mk, mn = parts.markers[curve["marker"]], now.marker[curve["marker"]]
        s = at.q[parts.coordinates[curve["coordinate"]]["iq"]]
        cx, px, qx, rx = _coordinate_of_curve(parts.pool, curve, s, 0)
        cy, py, qy, ry = _coordinate_of_curve(parts.pool, curve, s, 1)
        cz, pz, qz, _ = _coordinate_of_curve(parts.pool, curve, s, 2)
        R = mn["R"]
        x, y, z = turned(R, (cx, cy, cz))
        _shift_marker(mk, mn, now, x, y, z)
        put_part(cn["J"], 0, turned(R, (px, py, pz)))
        put_part(cn["D"], 0, turned(R, (qx, qy, qz)))
        put_part(cn["J"], 3, (0.0, 0.0, 0.0))
        put_part(cn["D"], 3, (0.0, 0.0, 0.0))
        if curve["turns"] == 1:
            _turn_to_tangent(R, cn, px, py, qx, qy, rx, ry)
    return SUCCESS


@kernel
def _shift_marker(mk, mn, now, x, y, z):
    """Shift a marker by (x, y, z), global, so that the shift is part of its moment arm."""
    a = mn["x"]
    put_part(a, 0, (a[0] + x, a[1] + y, a[2] + z))
    if mk["body"] >= 0:
        x, y, z = turned_back(now.body[mk["body"]]["A"], (x, y, z))
        s, arm = mn["s"], mn["arm"]
        put_part(s, 0, (s[0] + x, s[1] + y, s[2] + z))
        if mk["modes"] >= 0:
            put_part(arm, 0, (arm[0] + x, arm[1] + y, arm[2] + z))


@kernel
def _turn_to_tangent(R, cn, px, py, qx, qy, rx, ry):
    """Turn a marker about its z to the tangent (px, py), and put φ' z and φ'' z into J and D.

    (qx, qy) and (rx, ry): derivatives of the tangent with respect to s.
    """
    p2 = px * px + py * py
    first = (px * qy - py * qx) / p2
    second = (px * ry - py * rx) / p2 - 2.0 * first * (px * qx + py * qy) / p2
    p = math.sqrt(p2)
    cos, sin = px / p, py / p
    for a in range(3):
        cn["J"][3 + a] = first * R[a, 2]
        cn["D"][3 + a] = second * R[a, 2]
        x, y = R[a, 0], R[a, 1]
        R[a, 0] = cos * x + sin * y
        R[a, 1] = cos * y - sin * x


@unit
def add_velocities(run: Run, of: CurveMarkers, at: Point) -> int:
    """Add J ṡ to the velocities of all curve markers."""
    parts, now, markers = run.system.parts, run.work.now, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        mn, J = now.marker[markers[k]["marker"]], now.curve_marker[k]["J"]
        rate = at.v[parts.coordinates[markers[k]["coordinate"]]["iv"]]
        for a in range(3):
            mn["vx"][a] += J[a] * rate
            mn["om"][a] += J[3 + a] * rate
    return SUCCESS


@unit
def add_bias(run: Run, of: CurveMarkers, at: Point) -> int:
    """Add the terms with ṡ to the accelerations of all curve markers at zero v̇ and s̈."""
    parts, now, markers = run.system.parts, run.work.now, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        mn, J, D = (
            now.marker[markers[k]["marker"]],
            now.curve_marker[k]["J"],
            now.curve_marker[k]["D"],
        )
        rate = at.v[parts.coordinates[markers[k]["coordinate"]]["iv"]]
        om = mn["om"]
        wx, wy, wz = om[0] - J[3] * rate, om[1] - J[4] * rate, om[2] - J[5] * rate
        ax, ay, az = cross((wx, wy, wz), J)
        bx, by, bz = cross((wx, wy, wz), (J[3], J[4], J[5]))
        b, e = mn["bx"], mn["bom"]
        put_part(b, 0, (b[0] + 2.0 * rate * ax, b[1] + 2.0 * rate * ay, b[2] + 2.0 * rate * az))
        put_part(e, 0, (e[0] + rate * bx, e[1] + rate * by, e[2] + rate * bz))
        for a in range(3):
            b[a] += D[a] * rate * rate
            e[a] += D[3 + a] * rate * rate
    return SUCCESS


@unit
def subtract_forces(run: Run, of: CurveMarkers, at: Point) -> int:
    """res −= W·J of all curve markers, W the wrench on each."""
    parts, now, markers = run.system.parts, run.work.now, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        W, J = now.marker[markers[k]["marker"]]["W"], now.curve_marker[k]["J"]
        i = parts.coordinates[markers[k]["coordinate"]]["iv"]
        for c in range(6):
            run.work.trial.res[i] -= W[c] * J[c]
    return SUCCESS


@unit
def put_jacobian_entries(run: Run, of: CurveMarkers, at: Point) -> int:
    """Put ∂C/∂s of the rows on curve markers into the Jacobian part of the matrix.

    The stored diagonal of s is set to infinity, so that a residual force on s does not count as a
    displacement (`iteration_matrix`).
    """
    sys, work, markers = run.system, run.work, run.system.parts.curve_markers
    g, factor = work.row.g, work.factor
    for k in range(markers.shape[0]):
        curve, J = markers[k], work.now.curve_marker[k]["J"]
        group, link = sys.groups[curve["group"]], sys.kkt.links[curve["link"]]
        panel = sys.kkt.panels[sys.parts.coordinates[curve["coordinate"]]["panel"]]
        factor.diagonal[panel["col"]] = math.inf
        for r in range(group["n"]):
            put_row_gradient(run, sys.rows[group["row"] + r])
            s = 0.0
            for c in range(6):
                s += g[6 * curve["side"] + c] * J[c]
            place = link["at"] + r * (1 if link["flipped"] == 1 else link["stride"])
            factor.low[place] = s
            if factor.symmetric[0] == 0:
                factor.up[place] = s
    return SUCCESS


@unit
def add_tangents(run: Run, of: CurveMarkers, at: Point, cv: float, cp: float) -> int:
    """Add the part of cp ∂(Cqᵀ λ)/∂q that involves s, for all rows on curve markers."""
    sys, wk = run.system, run.work
    curves = sys.parts.curve_markers
    if cv == 0.0 and cp == 0.0:
        return SUCCESS
    for k in range(curves.shape[0]):
        curve = curves[k]
        put_group_tangent(run, at.lam, curve["group"])
        row = sys.rows[sys.groups[curve["group"]]["row"]]
        _put_coupling_vectors(sys.parts, curve, wk, row, cp, k)
        for side in range(2):
            link = curve["link_I"] if side == 0 else curve["link_J"]
            if link >= 0:
                b = sys.parts.markers[row["I"] if side == 0 else row["J"]]["body"]
                _add_body_coupling(sys.parts.bodies[b], sys.kkt, link, side, wk)
        _add_diagonal_entry(sys, curve, wk, cp, k)
        if curve["link_other"] >= 0:
            _add_pair_entries(sys, curve, wk, cp, k)
    return SUCCESS


@kernel
def _put_coupling_vectors(parts, curve, wk, row, cp, k):
    """Blocks between s and the body on each side: column in dense.T[side], row in T[2 + side]."""
    d, J, o = wk.dense, wk.now.curve_marker[k]["J"], 6 * curve["side"]
    g, w = d.g[0], d.g[1]
    lx, ly, lz = cross(J, (w[o], w[o + 1], w[o + 2]))
    mx, my, mz = cross((J[3], J[4], J[5]), (w[o + 3], w[o + 4], w[o + 5]))
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
                zero(out)
                add_generalized_force(parts, wk.now, marker, g, 6 * side, cp, out, 0)


@kernel
def _add_body_coupling(body, kkt, k, side, wk):
    """Add the column and the row of s on one body; link k is that of (body, s)."""
    link, column, low, up = kkt.links[k], kkt.column, wk.factor.low, wk.factor.up
    for c in range(6 + body["m"]):
        p = column[body["iv"] + c]
        if p >= 0:
            if link["flipped"] == 1:  # the body is eliminated before s
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
def _add_diagonal_entry(sys, curve, wk, cp, k):
    """Add cp (Jᵀ H J + w·D) to the diagonal of s."""
    d, sn, o = wk.dense, wk.now.curve_marker[k], 6 * curve["side"]
    s = _product(d.H, o, sn["J"], o, sn["J"])
    for c in range(6):
        s += d.g[1, o + c] * sn["D"][c]
    at = sys.kkt.panels[sys.parts.coordinates[curve["coordinate"]]["panel"]]["at"]
    wk.factor.low[at] += cp * s
    wk.factor.up[at] += cp * s


@kernel
def _add_pair_entries(sys, curve, wk, cp, k):
    """Add both entries between the coordinates s of two curve markers of one joint."""
    H, link, o = wk.dense.H, sys.kkt.links[curve["link_other"]], 6 * curve["side"]
    J, K = wk.now.curve_marker[k]["J"], wk.now.curve_marker[curve["other"]]["J"]
    mine, theirs = cp * _product(H, o, J, 6 - o, K), cp * _product(H, 6 - o, K, o, J)
    if link["flipped"] == 1:
        wk.factor.low[link["at"]] += theirs
        wk.factor.up[link["at"]] += mine
    else:
        wk.factor.low[link["at"]] += mine
        wk.factor.up[link["at"]] += theirs


@unit
def check_ends(run: Run, of: CurveMarkers, at: Point) -> int:
    """Return CURVE_END if a curve marker is beyond an end of its curve."""
    parts, markers = run.system.parts, run.system.parts.curve_markers
    for k in range(markers.shape[0]):
        length = parts.pool[markers[k]["at"] + markers[k]["n"]]
        s = at.q[parts.coordinates[markers[k]["coordinate"]]["iq"]]
        beyond = s < -_ROUND_OFF * length or s > (1.0 + _ROUND_OFF) * length
        if markers[k]["closed"] == 0 and beyond:
            return CURVE_END
    return SUCCESS


@unit
def put_events(run: Run, of: CurveMarkers, at: Point) -> int:
    """Event functions of all curve markers: zero at the breaks of their curves."""
    parts, out = run.system.parts, run.work.events.now
    for k in range(parts.curve_markers.shape[0]):
        curve = parts.curve_markers[k]
        if curve["breaks"] > 0:
            coordinate, event = parts.coordinates[curve["coordinate"]], out[curve["event"]]
            value, slope = _bump_between_breaks(parts.pool, curve, at.q[coordinate["iq"]])
            event["value"], event["rate"] = value, slope * at.v[coordinate["iv"]]
            event["of_law"] = 1.0
    return SUCCESS


@kernel
def _bump_between_breaks(pool, curve, s):
    """Value and slope of a smooth function of s that is zero at the breaks and changes sign there.

    It is a parabola between two breaks, and a straight line before the first and beyond the last.
    """
    m, length = curve["breaks"], pool[curve["at"] + curve["n"]]
    first, turns = curve["at"] + (1 + 24) * curve["n"] + 1, 0.0
    if curve["closed"] == 1:
        turns = np.floor(s / length)
        s -= length * turns
    k = 0
    while k < m and pool[first + k] <= s:
        k += 1
    low, high = pool[first + max(k - 1, 0)], pool[first + min(k, m - 1)]
    sign = 1.0 if (k + m * turns) % 2.0 == 0.0 else -1.0
    if curve["closed"] == 0 and (k == 0 or k == m):
        side = -1.0 if k == 0 else 1.0
        return sign * side * (s - low), sign * side
    if k == 0:
        low = pool[first + m - 1] - length
    if k == m:
        high = pool[first] + length
    width = high - low
    return sign * (s - low) * (high - s) / width, sign * (low + high - 2.0 * s) / width


CURVE_MARKERS = Kind(
    "curve_markers",
    CurveMarkers,
    {
        "position": place_curve_markers,
        "velocity": add_velocities,
        "bias": add_bias,
        "force": subtract_forces,
        "matrix": add_tangents,
        "jacobian": put_jacobian_entries,
        "limits": check_ends,
        "events": put_events,
    },
)
