"""Time derivatives of rows, piece by piece between the rows after which a load or driver jumps.

For a run with kinetostatic bodies also velocities and accelerations that are the derivatives of its
positions, and their jumps. Such a run has no rates of kinetostatic modes without a past: in its
first row, after a jump, with short steps. If velocities of a motion are not the derivatives of its
positions, the first values of vibrations are not defined.

The coordinates of a small motion are in body axes. Where a wheel spins on an arm that bends, the
axes of the wheel turn beside the arm, by up to a radian from row to row, and so do the components
of its tilt, which splines do not follow then. In the axes of the ground they do not turn:
d(Rx)/dt = R (ẋ + Ω x), with R the rotation from body axes to those and Ω that of δv = δq̇ + Ω δq.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from flexmb.analysis.effects.stored_motion import Motion
from flexmb.analysis.effects.variational_equations import VariationalEquations, times
from flexmb.analysis.functions_of_time import rows_behind_jumps
from flexmb.engine.compile import Compiled
from flexmb.flexbody.arrays import Array, IntArray

_COLUMNS = 64  # number of columns whose splines fit into the cache of a processor
_SLOW = 0.1  # largest change of coefficients between two rows for which the series is used [rad]
# A change is a jump if it is this many times the larger one of the changes before and after it; a
# smooth motion has at most one such change.
_JUMP = 5.0
_VISIBLE = 1e-3  # least jump over the largest deformation
_ROUGH = 0.01  # largest difference (rms) of modal rates of a run from derivatives of positions

# Change in the axes of the ground over that in body axes, below which the former are used.
_SLOWER = 0.25


@dataclass(frozen=True, eq=False)
class SmoothPieces:
    """Times (n,) of rows, and the rows at which a piece begins, except the first.

    Quantities in equilibrium with the loads jump with them; derivatives are those of either side.
    """

    t: Array
    begins: IntArray

    def part(self, rows: slice) -> SmoothPieces:
        """The pieces of some successive rows."""
        t = self.t[rows]
        first = rows.start or 0
        begins = self.begins[(self.begins > first) & (self.begins < first + len(t))]
        return SmoothPieces(t, begins - first)

    def rate(self, values: Array, order: int = 1) -> Array:
        """First or second time derivative of rows, by cubic splines."""
        from scipy.interpolate import CubicSpline

        flat = values.reshape(len(values), -1)
        rates, changing = np.zeros(flat.shape), np.flatnonzero((flat != flat[0]).any(axis=0))
        for piece in self._pieces():
            t = self.t[piece]
            for k in range(0, len(changing) if len(t) > 1 else 0, _COLUMNS):
                columns = changing[k : k + _COLUMNS]
                spline = CubicSpline(t, flat[piece, columns])
                rates[piece.start : piece.stop - 1, columns] = order * spline.c[3 - order]
                rates[piece.stop - 1, columns] = spline(t[-1], order)
        return rates.reshape(values.shape)

    def slow_rates(self, values: Array, span: float) -> tuple[Array, Array]:
        """First and second time derivative of rows (n, d), by differences over at least `span` [s].

        Faster changes, such as kinks of loads and noise, are smoothed over that time.
        """
        first, second = np.zeros((2, *values.shape))
        for piece in self._pieces():
            t, x = self.t[piece], values[piece]
            n = len(t)
            if n < 3:
                continue
            wide = int(np.clip(np.ceil(span * (n - 1) / (t[-1] - t[0])), 1, (n - 1) // 2))
            k = np.clip(np.arange(n), wide, n - 1 - wide)
            before, after = (t[k] - t[k - wide])[:, None], (t[k + wide] - t[k])[:, None]
            slopes = (x[k] - x[k - wide]) / before, (x[k + wide] - x[k]) / after
            second[piece] = 2.0 * (slopes[1] - slopes[0]) / (before + after)
            middle = (slopes[0] * after + slopes[1] * before) / (before + after)
            first[piece] = middle + (t - t[k])[:, None] * second[piece]
        return first, second

    def jumps(self, values: Array, rates: Array) -> Array:
        """Jump from one piece to the next, in the first row of the next; 0 in all other rows."""
        jumps, k = np.zeros_like(values), self.begins
        h = (self.t[k] - self.t[k - 1])[:, None]
        jumps[k] = values[k] - values[k - 1] - 0.5 * h * (rates[k] + rates[k - 1])
        return jumps

    def series(self, A: Array) -> Array:
        """Fourth-order term of Magnus' series for ẋ = A x, in addition to the mean of both ends.

        (n - 1, d, d). Without it a long oscillation, whose disturbance grows with time, would have
        another period than its disturbance. Zero in intervals in which A jumps.

        Source: Blanes, Casas, Oteo & Ros, Phys. Reports 470 (2009) 151, section 5.
        """
        h = np.diff(self.t)[:, None, None]
        slopes = np.zeros_like(A)
        for piece in self._pieces():
            if piece.stop - piece.start > 2:
                slopes[piece] = np.gradient(A[piece], self.t[piece], axis=0)
        commutator = A[:-1] @ A[1:] - A[1:] @ A[:-1]
        further = -h / 12.0 * (np.diff(slopes, axis=0) + commutator)
        jump = np.isin(np.arange(1, len(self.t)), self.begins)
        large = np.abs(h * further).sum(axis=2).max(axis=1, initial=0.0) > _SLOW
        further[large | jump] = 0.0
        return np.asarray(further)

    def _pieces(self) -> Iterator[slice]:
        for first, end in pairwise([0, *self.begins.tolist(), len(self.t)]):
            yield slice(first, end)


@dataclass(frozen=True, eq=False)
class Jumps:
    """Rows (k,) that are the first after a jump; the jumps of positions and velocities (k, nv), in
    velocity coordinates."""

    rows: IntArray
    places: Array
    velocities: Array


def follow_places(
    compiled: Compiled, motion: Motion, bodies: Sequence[str]
) -> tuple[Motion, Jumps]:
    """The motion with velocities that are the derivatives of its positions, and its jumps.

    Parameters
    ----------
    compiled : Compiled
        A model with the coordinates of the motion, SI.
    motion : Motion
        Rows of a run.
    bodies : sequence of str
        Bodies that are kinetostatic in the run.
    """
    t, columns = motion.t, [one for one in compiled.layout.bodies if one.name in bodies]
    scaled, rates = [], []  # a unit of them is the root of twice an energy
    for body in columns:
        root = np.sqrt(np.diag(compiled.flexbodies[body.name].K))
        scaled.append(motion.q[:, body.iq + 7 : body.iq + 7 + body.m] * root)
        rates.append(motion.v[:, body.iv + 6 : body.iv + 6 + body.m] * root)
    eta, own = np.concatenate(scaled, axis=1), np.concatenate(rates, axis=1)
    behind = {*rows_behind_jumps(compiled, t), *_jumps_of(t, eta)}
    pieces = SmoothPieces(t, np.array(sorted(behind), np.int64))
    true = pieces.rate(eta)
    size = float(np.sqrt((true**2).sum(axis=1).mean()))
    rough = np.linalg.norm(own - true, axis=1) > _ROUGH * size
    v = np.where(rough[:, None], _rates(compiled, motion.q, pieces), motion.v)
    moved = replace(motion, v=v, vd=pieces.rate(v))
    return moved, _measure_jumps(compiled, moved, pieces.begins)


def follow_velocities(compiled: Compiled, motion: Motion, bodies: Sequence[str]) -> Motion:
    """The motion with modal accelerations of `bodies` that are the derivatives of their velocities.

    Accelerations of modes without mass take part in no force, so that a run has them only to a
    tenth and less. The inertia that such modes do not have is computed from them.
    """
    pieces = SmoothPieces(motion.t, np.array(rows_behind_jumps(compiled, motion.t), np.int64))
    vd = motion.vd.copy()
    for body in compiled.layout.bodies:
        own = slice(body.iv + 6, body.iv + 6 + body.m)
        if body.name in bodies:
            vd[:, own] = pieces.rate(motion.v[:, own])
    return replace(motion, vd=vd)


def _jumps_of(t: Array, eta: Array) -> list[int]:
    """Rows after changes that are far larger than the changes before and after them."""
    speed = np.linalg.norm(np.diff(eta, axis=0), axis=1) / np.diff(t)
    beside = np.maximum(np.append(0.0, speed[:-1]), np.append(speed[1:], 0.0))
    size = np.linalg.norm(eta - eta.mean(axis=0), axis=1).max(initial=0.0)
    large = (speed > _JUMP * beside) & (speed * np.diff(t) > _VISIBLE * size)
    large[[0, -1]] = False  # which have changes on one side only
    return (np.flatnonzero(large) + 1).tolist()


def _rates(compiled: Compiled, q: Array, pieces: SmoothPieces) -> Array:
    """Velocities (n, nv) as derivatives of positions (n, nq)."""
    qd, v = pieces.rate(q), np.zeros((len(q), compiled.layout.nv))
    for body in compiled.layout.bodies:
        a, b, m = body.iq, body.iv, body.m
        e, ed = q[:, a + 3 : a + 7], qd[:, a + 3 : a + 7]
        v[:, b : b + 3] = qd[:, a : a + 3]
        turn = e[:, :1] * ed[:, 1:] - ed[:, :1] * e[:, 1:] - np.cross(e[:, 1:], ed[:, 1:])
        v[:, b + 3 : b + 6] = 2.0 * turn
        v[:, b + 6 : b + 6 + m] = qd[:, a + 7 : a + 7 + m]
    if n := len(compiled.layout.coordinates):
        v[:, -n:] = qd[:, -n:]
    return v


def _measure_jumps(compiled: Compiled, motion: Motion, rows: IntArray) -> Jumps:
    """Jumps: change between rows minus that of the cubic by the rates on both sides."""
    from scipy.spatial.transform import Rotation

    before, h = rows - 1, (motion.t[rows] - motion.t[rows - 1])[:, None]
    q, change = motion.q, np.zeros((len(rows), compiled.layout.nv))
    for body in compiled.layout.bodies:
        a, b, m = body.iq, body.iv, body.m
        change[:, b : b + 3] = q[rows, a : a + 3] - q[before, a : a + 3]
        if len(rows):
            e = np.roll(q[:, a + 3 : a + 7], -1, axis=1)
            turn = Rotation.from_quat(e[before]).inv() * Rotation.from_quat(e[rows])
            change[:, b + 3 : b + 6] = turn.as_rotvec()
        change[:, b + 6 : b + 6 + m] = q[rows, a + 7 : a + 7 + m] - q[before, a + 7 : a + 7 + m]
    if n := len(compiled.layout.coordinates):
        change[:, -n:] = q[rows, -n:] - q[before, -n:]
    v, vd = motion.v, motion.vd
    smooth = 0.5 * h * (v[rows] + v[before]) + h**2 / 12.0 * (vd[before] - vd[rows])
    faster = v[rows] - v[before] - 0.5 * h * (vd[rows] + vd[before])
    return Jumps(rows, change - smooth, faster)


@dataclass(frozen=True, eq=False)
class SlowAxes:
    """Rotations R from body axes to axes in which motions change slowly, and the Ω of what they
    turn: for each vector of three coordinates or fewer its places `at`, R and Ω (n, at, at)."""

    pieces: SmoothPieces
    turns: list[tuple[IntArray, Array, Array]]

    @classmethod
    def of(cls, pieces: SmoothPieces, equations: VariationalEquations, Z: Array) -> SlowAxes:
        """Axes for motions Z (n, nu, d): those of the ground for vectors that change less there."""
        turns = []
        for at in equations.frames.vectors():
            own = np.ix_(np.arange(len(Z)), at, at)
            R = equations.turns[own]
            if _roughness(R @ Z[:, at]) < _SLOWER * _roughness(Z[:, at]):
                turns.append((at, R, equations.Omega[own]))
        return cls(pieces, turns)

    def among(self, rows: IntArray) -> SlowAxes:
        """The axes for motions of some coordinates only, those of vectors among them."""
        turns = [(np.searchsorted(rows, at), R, Omega) for at, R, Omega in self.turns]
        return replace(self, turns=turns)

    def rate(self, motions: Array) -> Array:
        """Time derivative of the components (n, nu) or (n, nu, d) of motions in body axes."""
        x = motions if motions.ndim == 3 else motions[:, :, None]
        rates = self.pieces.rate(self._turned(x))
        for at, R, Omega in self.turns:
            rates[:, at] = R.transpose(0, 2, 1) @ rates[:, at] - Omega @ x[:, at]
        return rates.reshape(motions.shape)

    def slow_rates(self, motion: Array, span: float) -> tuple[Array, Array]:
        """First and second time derivative of the components (n, nu) of a motion, by differences
        over at least `span` [s]."""
        first, second = self.pieces.slow_rates(self._turned(motion[..., None])[..., 0], span)
        for at, R, Omega in self.turns:
            back, x = R.transpose(0, 2, 1), motion[:, at]
            turned = times(Omega, x)
            first[:, at] = times(back, first[:, at]) - turned
            spin = back @ self.pieces.rate(R @ Omega @ back) @ R
            further = times(spin, x) + times(Omega, turned + 2.0 * first[:, at])
            second[:, at] = times(back, second[:, at]) - further
        return first, second

    def _turned(self, x: Array) -> Array:
        """Components (n, nu, d) in these axes."""
        turned = x.copy() if self.turns else x
        for at, R, _ in self.turns:
            turned[:, at] = R @ x[:, at]
        return turned


def _roughness(values: Array) -> float:
    """Size of the second differences of rows."""
    return float(np.linalg.norm(np.diff(values, 2, axis=0)))
