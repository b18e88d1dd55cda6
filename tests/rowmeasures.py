"""Markers, constraint rows and Jacobian in numpy, written once more: a check of the kernels.

Every row is a function of h = x_J − x_I and the axes A, B of its two markers; its gradient comes
from complex steps of that function, so nothing here is part of
`flexmb.engine.joints`, whose modules have the table. Velocity coordinates as in
`flexmb.engine.tables`; source of the complex step: Squire and Trapp, SIAM Review 40 (1998) 110.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine import joints
from flexmb.engine.compile import Compiled
from flexmb.engine.joints.curve_marker import Pieces
from flexmb.model.markers import rotation_matrix

__all__ = ["MEASURES", "Placed", "Rows", "gradient", "moved", "placed_markers", "rows_at"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_STEP = 1e-40  # no difference is formed, so none is too small
_STEPS = 1j * _STEP * np.eye(3)
_TURNS = -1j * _STEP * np.cross(np.eye(3)[:, None], np.eye(3)[None])  # e~ of each axis e
_X, _Y, _Z = 0, 1, 2


def _dot(u: Complex, v: Complex) -> Complex:
    return np.asarray(np.einsum("...i,...i->...", u, v))


def _length(u: Complex) -> Complex:
    return np.sqrt(_dot(u, u))


def _angle(s: Complex, c: Complex) -> Complex:
    """atan2 of complex numbers whose imaginary parts are steps."""
    step = (c.real * s.imag - s.real * c.imag) / (s.real**2 + c.real**2)
    return np.asarray(np.arctan2(s.real, c.real) + 1j * step)


def _off_axis(h: Complex, A: Complex) -> Complex:
    z = A[..., _Z]
    return h - _dot(z, h)[..., None] * z


Measure = Callable[[int, int, Complex, Complex, Complex], Complex]
MEASURES: dict[int, Measure] = {
    joints.POINT: lambda a, b, h, A, B: h[..., a],
    joints.DOT1: lambda a, b, h, A, B: _dot(A[..., a], B[..., b]),
    joints.DOT2: lambda a, b, h, A, B: _dot(A[..., a], h),
    joints.DISTANCE: lambda a, b, h, A, B: _length(h),
    joints.ANGLE: lambda a, b, h, A, B: _angle(
        _dot(A[..., _Y], B[..., b]), _dot(A[..., _X], B[..., b])
    ),
    joints.TWIST: lambda a, b, h, A, B: _dot(A[..., _X], B[..., _Y]) - _dot(A[..., _Y], B[..., _X]),
    joints.RADIAL: lambda a, b, h, A, B: _length(_off_axis(h, A)),
    joints.MOMENT: lambda a, b, h, A, B: _dot(h, np.cross(A[..., _Z], B[..., _Z])),
}
"""What each kind of row measures between axes a of marker I and b of marker J."""


@dataclass(frozen=True)
class Placed:
    """All markers in one pose.

    x (n, 3), R (n, 3, 3) in global axes; J[k] (6, 6 + m) leads from the velocity coordinates of
    the marker's body to its velocity and angular velocity in global axes, None on ground. Of a
    curve marker slides[k] is the velocity coordinate of its place along the curve, and the (6,)
    velocity that it adds.
    """

    x: Array
    R: Array
    J: tuple[Array | None, ...]
    slides: Mapping[int, tuple[int, Array]]


@dataclass(frozen=True)
class Rows:
    """Values C (nc,), gradients g (nc, 12) on both markers, Jacobian Cq (nc, nv) of all rows."""

    C: Array
    g: Array
    Cq: Array
    markers: Placed


def rows_at(compiled: Compiled, q: Array, t: float = 0.0) -> Rows:
    """All rows of a system at the positions q (nq,) and the time t [s]."""
    system = compiled.system
    markers = placed_markers(compiled, q)
    nc, nv = compiled.layout.nc, compiled.layout.nv
    C, g, Cq = np.zeros(nc), np.zeros((nc, 12)), np.zeros((nc, nv))
    asked = _asked(compiled, q, t)
    for k, row in enumerate(system.rows):
        kind, i, j = int(row["kind"]), int(row["I"]), int(row["J"])
        ends = markers.x[i], markers.R[i], markers.x[j], markers.R[j]
        axes = kind, int(row["a"]), int(row["b"])
        C[k] = float(_value(axes, *ends).real) - asked[k]
        if kind == joints.ANGLE:
            C[k] = np.remainder(C[k] + np.pi, 2 * np.pi) - np.pi
        g[k] = gradient(axes, *ends)
        for end, part in ((i, g[k, :6]), (j, g[k, 6:])):
            J = markers.J[end]
            if J is not None:
                iv = int(system.parts.bodies[system.parts.markers[end]["body"]]["iv"])
                Cq[k, iv : iv + J.shape[1]] += part @ J
            if end in markers.slides:
                column, slide = markers.slides[end]
                Cq[k, column] += part @ slide
    scalars: Any = system.parts.coordinates
    for entry in system.coupled:
        Cq[entry["row"], scalars[entry["coordinate"]]["iv"]] -= entry["factor"]
    return Rows(C, g, Cq, markers)


def gradient(axes: tuple[int, int, int], xi: Array, Ri: Array, xj: Array, Rj: Array) -> Array:
    """Gradient (12,) of a row (kind, a, b) for (δx_I, δφ_I, δx_J, δφ_J) in global axes."""
    x, y = np.empty((12, 3), complex), np.empty((12, 3), complex)
    A, B = np.empty((12, 3, 3), complex), np.empty((12, 3, 3), complex)
    x[:], A[:], y[:], B[:] = xi, Ri, xj, Rj
    x[0:3] += _STEPS
    A[3:6] += _TURNS @ Ri
    y[6:9] += _STEPS
    B[9:12] += _TURNS @ Rj
    found: Array = np.broadcast_to(_value(axes, x, A, y, B), (12,)).imag / _STEP
    return found


def _value(axes: tuple[int, int, int], xi: Any, Ri: Any, xj: Any, Rj: Any) -> Complex:
    kind, a, b = axes
    xi, Ri, xj, Rj = (np.asarray(part, dtype=complex) for part in (xi, Ri, xj, Rj))
    with np.errstate(all="ignore"):  # a length of zero has no direction: not finite
        return np.asarray(MEASURES[kind](a, b, xj - xi, Ri, Rj))


def _asked(compiled: Compiled, q: Array, t: float) -> Array:
    """What the measure of each row (nc,) should be: constant, function of time, coordinates."""
    system = compiled.system
    asked: Array = system.rows["offset"].astype(float)
    for k, row in enumerate(system.rows):
        if row["fun"] >= 0 and not row["coupled"]:
            asked[k] += compiled.functions[row["fun"]].value(t)[0]
    scalars: Any = system.parts.coordinates
    for entry in system.coupled:
        asked[entry["row"]] += entry["factor"] * q[scalars[entry["coordinate"]]["iq"]]
    return asked


def placed_markers(compiled: Compiled, q: Array) -> Placed:
    """All markers at the positions q (nq,)."""
    parts = compiled.system.parts
    turns = [rotation_matrix(q[b["iq"] + 3 : b["iq"] + 7]) for b in parts.bodies]
    x: list[Array] = []
    R: list[Array] = []
    J: list[Array | None] = []
    for marker in parts.markers:
        body = int(marker["body"])
        if body < 0:
            x.append(marker["rho"])
            R.append(marker["R"])
            J.append(None)
            continue
        row, A = parts.bodies[body], turns[body]
        s, E, modal = _carried(parts.pool, marker, int(row["m"]), q[row["iq"] + 7 :])
        x.append(q[row["iq"] : row["iq"] + 3] + A @ s)
        R.append(A @ E @ marker["R"])
        rigid = np.block([[np.eye(3), -A @ _skew(s)], [np.zeros((3, 3)), A]])
        J.append(np.hstack([rigid, np.vstack([A @ modal[:3], A @ modal[3:]])]))
    slides = _slid(compiled, q, x, R, J)
    return Placed(np.reshape(x, (-1, 3)), np.reshape(R, (-1, 3, 3)), tuple(J), slides)


def _slid(
    compiled: Compiled, q: Array, x: list[Array], R: list[Array], J: list[Array | None]
) -> dict[int, tuple[int, Array]]:
    """Move the curve markers, placed as the markers that carry their curves, along these."""
    parts, slides = compiled.system.parts, {}
    sliders: Any = parts.curve_markers
    scalars: Any = parts.coordinates
    for slider in sliders:
        k, at, n = (int(slider[word]) for word in ("marker", "at", "n"))
        ends, coordinate = parts.pool[at : at + n + 1], scalars[slider["coordinate"]]
        s = q[coordinate["iq"]] % ends[-1] if slider["closed"] else q[coordinate["iq"]]
        inside = min(max(s, 0.0), ends[-1])
        place, tangent, bend = Pieces.of_pool(parts.pool, at, n).at(np.array([inside]))[0]
        past = s - inside  # beyond the ends of an open curve
        place = place + past * (tangent + 0.5 * past * bend)
        tangent = tangent + past * bend
        arm = R[k] @ place
        x[k] = x[k] + arm
        carried = J[k]
        if carried is not None:
            J[k] = np.vstack([carried[:3] - _skew(arm) @ carried[3:], carried[3:]])
        slide = np.append(R[k] @ tangent, np.zeros(3))
        if slider["turns"]:
            size = float(np.hypot(tangent[0], tangent[1]))
            c, d = tangent[:2] / size
            slide[3:] = (tangent[0] * bend[1] - tangent[1] * bend[0]) / size**2 * R[k][:, 2]
            R[k] = R[k] @ np.array([[c, -d, 0.0], [d, c, 0.0], [0.0, 0.0, 1.0]])
        slides[k] = int(coordinate["iv"]), slide
    return slides


def _carried(pool: Array, marker: np.void, m: int, q: Array) -> tuple[Array, Array, Array]:
    """Place s (3,) and turn E (3, 3) of a marker in body axes, and what η̇ adds to its motion."""
    s, E, modal = marker["rho"] + marker["arm"], np.eye(3), np.zeros((6, m))
    if marker["modes"] < 0 or m == 0:
        return s, E, modal
    at = int(marker["modes"])
    Phi_t, Phi_r = pool[at : at + 6 * m].reshape(2, 3, m)
    theta = Phi_r @ q[:m]
    size = float(np.linalg.norm(theta))
    T = _skew(theta)
    sine, cosine = np.sinc(size / np.pi), 0.5 * np.sinc(size / (2 * np.pi)) ** 2
    E = np.eye(3) + sine * T + cosine * T @ T
    rest = (1.0 - sine) / size**2 if size > 1e-3 else (1.0 - size**2 / 20.0) / 6.0
    spin = (np.eye(3) + cosine * T + rest * T @ T) @ Phi_r  # Tᵀ(θ) Φ_r
    arm = E @ marker["arm"]
    s = marker["rho"] + Phi_t @ q[:m] + arm
    return s, E, np.vstack([Phi_t - _skew(arm) @ spin, spin])


def moved(compiled: Compiled, q: Array, d: Array) -> Array:
    """q ∘ exp(d) for a change d (nv,) of the velocity coordinates."""
    out: Array = q.copy()
    for row in compiled.system.parts.bodies:
        i, o, m = int(row["iq"]), int(row["iv"]), int(row["m"])
        out[i : i + 3] += d[o : o + 3]
        half = 0.5 * d[o + 3 : o + 6]
        size = float(np.linalg.norm(half))
        w, u = np.cos(size), np.sinc(size / np.pi) * half
        p = q[i + 3 : i + 7]
        turned = np.append(p[0] * w - p[1:] @ u, p[0] * u + w * p[1:] + np.cross(p[1:], u))
        out[i + 3 : i + 7] = turned / np.linalg.norm(turned)
        out[i + 7 : i + 7 + m] += d[o + 6 : o + 6 + m]
    scalars: Any = compiled.system.parts.coordinates
    for row in scalars:
        out[row["iq"]] += d[row["iv"]]
    return out


def _skew(s: Array) -> Array:
    return np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]], dtype=float)
