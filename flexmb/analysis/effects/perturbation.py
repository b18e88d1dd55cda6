"""How the motion of one model differs from that of a neighbouring one: a first-order perturbation.

In: the rows of a run, and the compiled model of the same scene with one effect more or less. Out:
the change of every sensor, row by row. What the run leaves out of balance in the other model, its
defect F and C, drives the small motions of that model about the computed motion,

    M δv̇ + D δv + K δq + Cqᵀ δλ = −F,   Cq δq = −C,   δv = δq̇ + Ω δq

(Ω the turning of body axes). With δq = Z y + g, the columns of Z the motions that the rows of Cq
leave free, this is an ordinary linear equation for y, whose coefficients are averaged over each
interval and whose solution there is exact (matrix exponential, forces linear in time): modes far
faster than the rows vibrate and resonate as they would. Source of the idea: defect correction
(Stetter, Numer. Math. 29 (1978) 425); of the estimate: Padilla & von Flotow, J. Guidance 15 (1992)
149, who linearise about the motion as well.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from flexmb.analysis.assembly.jacobian import numerical_rank, one_blas_thread
from flexmb.analysis.effects.stored_motion import Motion, equations_of
from flexmb.engine import equations_of_motion as stages
from flexmb.engine.bodies.static_modes import static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.iteration_matrix import put_matrix
from flexmb.engine.units import call, hand_over, prepare_units
from flexmb.engine.work import new_run, new_state, new_work, units_of
from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array, IntArray, skew

_UNRESOLVED = 1.0  # rad of a vibration between two rows from which on they do not resolve it
_ROUNDS = 2  # of what such vibrations do slowly
_MODES_LAST = 0.02  # preference of modes among dependent coordinates
_TURNING = 2 * np.pi  # of a body over the run: so much makes its coordinates twice as dependent
_WORSE = 30.0  # motion of dependent coordinates per independent one that asks for others
_LEAST_ROWS = 8  # with one choice of them
_EVALUATIONS = 50  # of the equations, to time them
_NO_TIME = 0.01  # of an interval, which modes without inertia take
_MOST_VIBRATIONS = 80  # the slowest of many; what the rows do not resolve beyond only follows loads
_NOTHING = 1e-20  # of the largest square of a row of Cq
_SMALL = 1e-5  # of the size of the model: a change of the motion that is linear in all sensors
_UNBOUNDED = 1e12  # a small motion this many times the model is not followed any further


@dataclass(frozen=True, eq=False)
class Response:
    """Change of the channels (n, k) that another model makes, and the motions behind it (n, nv).

    From row `bounded` on the small motions are no longer small: the linear equations are unstable
    there, or the change is as large as the model.
    """

    channels: Array
    dq: Array
    bounded: int


@one_blas_thread()
def respond(
    compiled: Compiled, motion: Motion, balance: Array, start: tuple[Array, Array] | None = None,
    *, quasi_static: bool = False,
) -> Response:  # fmt: skip
    """Small motions of a model about a motion that is not its own.

    Parameters
    ----------
    compiled : Compiled
        The other model.
    motion : Motion
        A computed motion in its coordinates; channels are those of the run itself.
    balance : (n, nv) array
        What the rows leave out of balance in their own model: the noise of reported accelerations
        and reactions, which is no effect.
    start : (nv,) and (nv,) arrays, optional
        First changes of positions and velocities; none by default.
    quasi_static : bool
        Leave out the inertia of vibrations: deformations follow their loads.
    """
    n = len(motion.t)
    coefficients = _coefficients(compiled, motion, balance)
    frames = coefficients.frames
    state = (np.zeros(len(coefficients.weights)),) * 2
    if start is not None:
        state = frames.inward(0, start[0]), frames.inward(0, start[1])
    static = static_coordinates(compiled.system)
    springs = (
        _elastic(compiled, frames) if quasi_static else None,
        _elastic(compiled, frames, static) if len(static) else None,
    )
    parts = np.zeros((3, n, len(coefficients.weights)))
    first, bounded = 0, n
    while first < n - 1 and bounded == n:
        segment = _segment(coefficients, first)
        rows = slice(first, first + len(segment.Z))
        moved, bounded = _solve(motion.t[rows], coefficients.part(rows), segment, state, springs)
        parts[:, rows] = moved
        bounded = n if bounded == len(segment.Z) else first + bounded
        first += len(segment.Z) - 1
        state = parts[0, first], parts[1, first]
    change = np.zeros_like(motion.channels)
    equations, one = equations_of(compiled), coefficients
    force = one.F + sum(
        np.einsum("tij,tj->ti", C, x)
        for C, x in zip((one.M, one.D, one.K), parts[::-1], strict=True)
    )
    multipliers = np.einsum("tr,trc->tc", one.shares(force), one.rows)
    sizes = np.abs(parts[0]).max(axis=1, initial=0.0)
    dq, dv, dvd = (frames.outward(part) for part in parts)
    now = equations.state
    for k in range(bounded):
        changes = []
        # joints are closed to first order only: at full size large turns may take away, not add
        for f in (1.0, min(1.0, _SMALL / sizes[k]) if sizes[k] > 0.0 else 1.0):
            motion.put(k, equations)
            now.q[:] = equations.moved(motion.q[k], f * dq[k])
            now.v[:] += f * dv[k]
            now.vd[:] += f * dvd[k]
            now.lam[:] -= f * multipliers[k]
            changes.append((equations.channels() - motion.channels[k]) / f)
        change[k] = np.where(np.abs(changes[0]) < np.abs(changes[1]), *changes)
    dq[bounded:] = 0.0
    change[bounded:] = np.inf
    return Response(change, dq, bounded)


class _Frames:
    """Weighted coordinates of small motions: translations and rotations of bodies in their axes."""

    def __init__(self, compiled: Compiled, motion: Motion) -> None:
        from scipy.spatial.transform import Rotation

        self.compiled, system = compiled, compiled.system
        still = static_coordinates(system, kinetostatic=True)  # their modes have no motion here
        self.used = np.setdiff1d(np.flatnonzero(system.kkt.column >= 0), still).astype(np.int64)
        weights = np.where(system.weights > 0.0, system.weights, 1.0)
        self.inverse = 1.0 / weights
        axes = [
            Rotation.from_quat(np.roll(motion.q[:, body.iq + 3 : body.iq + 7], -1, axis=1))
            for body in compiled.layout.bodies
        ]
        self._axes = [one.as_matrix() for one in axes]
        self._v = motion.v

    def turned(self, X: Array, rows: slice = slice(None)) -> Array:
        """X S of matrices (n, i, nv) in velocity coordinates of these rows: (n, i, used)."""
        X = X.copy()
        for body, A in zip(self.compiled.layout.bodies, self._axes, strict=True):
            X[..., body.iv : body.iv + 3] = X[..., body.iv : body.iv + 3] @ A[rows]
        return np.asarray((X * self.inverse)[..., self.used])

    def both_turned(self, X: Array, rows: slice = slice(None)) -> Array:
        """Sᵀ X S of matrices (n, nv, nv) of these rows."""
        half = self.turned(X, rows).transpose(0, 2, 1)
        return self.turned(half, rows).transpose(0, 2, 1)

    def spin(self) -> tuple[Array, Array]:
        """Ω of δv = δq̇ + Ω δq and Ω of δv̇ = d δv/dt + Ω δv, (n, used, used)."""
        n, nv = self._v.shape
        both, shift = np.zeros((n, nv, nv)), np.zeros((n, nv, nv))
        for body in self.compiled.layout.bodies:
            cross = skew(self._v[:, body.iv + 3 : body.iv + 6])
            for first in (body.iv, body.iv + 3):
                both[:, first : first + 3, first : first + 3] = cross
            shift[:, body.iv : body.iv + 3, body.iv : body.iv + 3] = cross
        factors, used = self.inverse / self.inverse[:, None], self.used
        both, shift = ((W * factors)[:, used][:, :, used] for W in (both, shift))
        return both, shift

    def inward(self, k: int, motion: Array) -> Array:
        """Weighted coordinates in row k of a motion (nv,); columns of S are at right angles."""
        turned = self.turned(motion[None, None], slice(k, k + 1))[0, 0]
        return np.asarray(turned / self.inverse[self.used] ** 2)

    def outward(self, part: Array) -> Array:
        """Motions (n, nv) of weighted coordinates (n, used) in all rows."""
        motion = np.zeros((len(part), len(self.inverse)))
        motion[:, self.used] = part * self.inverse[self.used]
        for body, A in zip(self.compiled.layout.bodies, self._axes, strict=True):
            own = slice(body.iv, body.iv + 3)
            motion[:, own] = np.einsum("tij,tj->ti", A, motion[:, own])
        return motion


@dataclass(frozen=True, eq=False)
class _Coefficients:
    """M δv̇ + D δv + K δq + Cqᵀ δλ = −F, Cq δq = −C, row by row, in weighted coordinates.

    The rows of Cq are independent, and at right angles: combinations `rows` of those of the model.
    D contains the turning of the axes in δv̇, Omega is that in δv. The larger `prefer`, the rather
    a coordinate depends on others.
    """

    frames: _Frames
    weights: Array
    prefer: Array
    M: Array
    D: Array
    K: Array
    Cq: Array
    F: Array
    C: Array
    Omega: Array
    rows: Array

    def part(self, rows: slice) -> _Coefficients:
        """Some of the rows."""
        tables = {name: getattr(self, name)[rows] for name in _TABLES}
        return replace(self, **tables)

    def shares(self, force: Array) -> Array:
        """λ (n, rank) of Cqᵀ λ next to forces (n, nu)."""
        squares = (self.Cq**2).sum(axis=2)
        least = _NOTHING * squares.max(axis=1, initial=0.0)[:, None]
        along = np.einsum("trj,tj->tr", self.Cq, force)
        return np.asarray(along / np.where(squares > least, squares, np.inf))


_TABLES = ("M", "D", "K", "Cq", "F", "C", "Omega", "rows")


def _coefficients(compiled: Compiled, motion: Motion, balance: Array) -> _Coefficients:
    frames, equations, n = _Frames(compiled, motion), equations_of(compiled), len(motion.t)
    nv, used, scale = compiled.layout.nv, frames.used, compiled.system.row_weights
    M, D, K = (np.zeros((n, nv, nv)) for _ in range(3))
    F, Cq, C = np.zeros((n, nv)), np.zeros((n, len(scale), nv)), np.zeros((n, len(scale)))
    for k in range(n):
        motion.put(k, equations)
        M[k], D[k], K[k], Cq[k], _ = equations.tangents()
        F[k], C[k] = equations.work.trial.res, equations.work.con.C
    F = frames.turned((F - balance)[:, None])[:, 0]
    M, D, K = (frames.both_turned(X) for X in (M, D, K))
    Omega, shift = frames.spin()
    D += M @ shift
    U, sizes, _ = np.linalg.svd(scale[:, None] * frames.turned(Cq), full_matrices=False)
    rank = numerical_rank(sizes[0])
    rows = U[:, :, :rank].transpose(0, 2, 1) * scale
    Cq, C = rows @ frames.turned(Cq), np.einsum("trc,tc->tr", rows, C)
    prefer, v = np.ones(compiled.layout.nv), motion.v
    for body in compiled.layout.bodies:
        prefer[body.iv + 6 : body.iv + 6 + body.m] = _MODES_LAST
        spin = np.linalg.norm(v[:, body.iv + 3 : body.iv + 6], axis=1).max()
        prefer[body.iv : body.iv + 6] += spin * (motion.t[-1] - motion.t[0]) / _TURNING
    weights = 1.0 / frames.inverse[used]
    return _Coefficients(frames, weights, prefer[used], M, D, K, Cq, F, C, Omega, rows)


@dataclass(frozen=True, eq=False)
class _Segment:
    """Motions (rows, nu, d) per unit of independent coordinates, and what closes the rows of Cq."""

    Z: Array
    g: Array
    free: IntArray  # (d,) the independent coordinates


def _segment(of: _Coefficients, first: int) -> _Segment:
    """Rows from `first` on along which one choice of independent coordinates serves.

    Modes and bodies that turn little are independent where they can be: nothing turns with motion.
    """
    from scipy.linalg import qr

    n, rank, nu = of.Cq.shape
    order = qr(of.Cq[first] * of.prefer, mode="r", pivoting=True)[1] if rank else np.arange(nu)
    dependent, free = order[:rank], np.sort(order[rank:])
    Z, g = np.zeros((n - first, nu, nu - rank)), np.zeros((n - first, nu))
    Z[:, free] = np.eye(nu - rank)
    limit = np.inf
    for k in range(first, n):
        if rank:
            both = np.column_stack([of.Cq[k][:, free], of.C[k]])
            solution = -np.linalg.solve(of.Cq[k][:, dependent], both)
            size = float(np.abs(solution[:, :-1]).max(initial=1.0))
            limit = max(_WORSE * size, _WORSE) if k == first else limit
            if size > limit and k - first >= _LEAST_ROWS:
                return _Segment(Z[: k - first], g[: k - first], free)
            Z[k - first, dependent], g[k - first, dependent] = solution[:, :-1], solution[:, -1]
    return _Segment(Z, g, free)


def evaluation_time(compiled: Compiled) -> float:
    """Seconds that one evaluation of the forces and one of their matrix take."""
    system, state = compiled.system, new_state(compiled.system, len(compiled.layout.channels))
    state.q[:] = compiled.initial_q
    prepare_units([stages.begin_run, stages.residual, put_matrix, *units_of(system)])
    run = hand_over(new_run(system, state, new_work(system, len(state.angles))))
    at, best = hand_over(run.record.state_point), np.inf
    call(stages.begin_run, run, at)
    for _ in range(5):
        began = time.thread_time()
        for _ in range(_EVALUATIONS):
            call(stages.residual, run, at)
            call(put_matrix, run, at, 1.0, 1.0)
        best = min(best, time.thread_time() - began)
    return best / _EVALUATIONS


def _elastic(compiled: Compiled, frames: _Frames, places: IntArray | None = None) -> Array:
    """Stiffness of the modes of all bodies, or of those at some places, in weighted coordinates."""
    K = np.zeros((compiled.layout.nv,) * 2)
    for body in compiled.layout.bodies:
        own = slice(body.iv + 6, body.iv + 6 + body.m)
        if body.m:
            K[own, own] = compiled.flexbodies[body.name].K
    if places is not None:
        K *= np.outer(*2 * [np.isin(np.arange(len(K)), places)])
    return np.asarray(frames.both_turned(K[None], slice(0, 1))[0])


def _solve(
    t: Array, of: _Coefficients, segment: _Segment, state: tuple[Array, Array],
    springs: tuple[Array | None, Array | None],
) -> tuple[Array, int]:  # fmt: skip
    """δq, δv and δv̇ (3, n, nu) from the first two on, and how many rows are bounded.

    With the first of `springs`, vibrations whose stiffness is mostly that of bodies follow their
    loads; the second is the stiffness of modes without inertia.
    """
    from scipy.linalg import eigh, expm

    M, D, K, Omega, Z, g = of.M, of.D, of.K, of.Omega, segment.Z, segment.g
    elastic, massless = springs
    n, nu, d = Z.shape
    Zd = _rate(t, Z)
    V1 = Zd + Omega @ Z
    V1d = _rate(t, V1)
    a0 = _rate(t, g) + np.einsum("tij,tj->ti", Omega, g)
    a0d = _rate(t, a0)
    Zt = Z.transpose(0, 2, 1)
    Mr = Zt @ M @ Z
    Dr = Zt @ (M @ (Zd + V1) + D @ Z)
    Kr = Zt @ (M @ V1d + D @ V1 + K @ Z)
    load = of.F + np.einsum("tij,tj->ti", M, a0d) + np.einsum("tij,tj->ti", D, a0)
    load = -np.einsum("tij,ti->tj", Z, load + np.einsum("tij,tj->ti", K, g))
    # modal coordinates of the mean matrices, rates over their frequencies: entries of like size
    stiffness = 0.5 * (Kr + Kr.transpose(0, 2, 1)).mean(axis=0)
    mass, interval = 0.5 * (Mr + Mr.transpose(0, 2, 1)).mean(axis=0), np.median(np.diff(t))
    if massless is not None:
        strain = np.tensordot(Z, massless @ Z, ((0, 1), (0, 1))) / n
        mass = mass + (_NO_TIME * interval) ** 2 * strain
    try:
        squares, T = eigh(stiffness, mass)
    except np.linalg.LinAlgError:
        what = "the motions about the computed one have no inertia in the mean: the rows of the run"
        raise FlexmbError(f"{what} are too far apart for them; ask for more outputs") from None
    omega = np.maximum(np.sqrt(np.abs(squares)), 1.0 / (t[-1] - t[0]))
    Mt, Dt, Kt = (T.T @ A @ T for A in (Mr, Dr, Kr))
    # what modes that the rows do not resolve do slowly is taken out of the forces first
    fast = omega * interval > _UNRESOLVED
    if elastic is not None:
        strain = np.tensordot(Z, elastic @ Z, ((0, 1), (0, 1))) / n
        fast = np.einsum("ij,ik,kj->j", T, strain, T) > 0.5 * np.abs(squares)
    slowest = np.argsort(np.argsort(omega)) < _MOST_VIBRATIONS
    still = fast & ~(slowest & (elastic is None))
    still |= (massless is not None) & (omega * interval * _NO_TIME > 0.5)
    rest, slow, inner = load @ T, np.zeros((3, n, d)), np.ix_(range(n), fast, fast)
    for _ in range(_ROUNDS if elastic is None else 1):
        y = np.zeros((n, d))
        y[:, fast] = np.linalg.solve(Kt[inner], rest[:, fast, None])[..., 0]
        motion = np.array([y, _rate(t, y), _rate(t, y, 2)])
        rest = rest - sum(
            np.einsum("tij,tj->ti", C, z) for C, z in zip((Kt, Dt, Mt), motion, strict=True)
        )
        slow += motion
    y0 = state[0][segment.free]  # stiff modes do not share what closes joints at full size only
    yd0 = (state[1] - V1[0] @ y0 - a0[0])[segment.free]
    back, on = np.linalg.inv(T), np.flatnonzero(~still)
    u, w = len(on), omega[on]
    x = np.zeros((n, 2 * u))
    x[0] = np.concatenate([(back @ y0)[on], (back @ yd0)[on] / w])
    x[0] -= np.concatenate([slow[0, 0, on], slow[1, 0, on] / w])
    pick = np.ix_(np.arange(n), on, on)
    Mt, Dt, Kt, rest = Mt[pick], Dt[pick], Kt[pick], rest[:, on]
    M, D, K = (0.5 * (C[1:] + C[:-1]) for C in (Mt, Dt, Kt))  # symmetric: they make no energy
    A, inverse = _first_order(M, D, K, w)
    bounded = n
    for k in range(n - 1):
        h = t[k + 1] - t[k]
        step = np.zeros((2 * u + 2, 2 * u + 2))
        step[: 2 * u, : 2 * u] = h * A[k]
        step[u : 2 * u, 2 * u] = h * (inverse[k] @ rest[k]) / w
        step[u : 2 * u, 2 * u + 1] = h * (inverse[k] @ (rest[k + 1] - rest[k])) / w
        step[2 * u + 1, 2 * u] = 1.0
        x[k + 1] = (expm(step) @ np.append(x[k], (1.0, 0.0)))[: 2 * u]
        if not np.abs(T[:, on] @ x[k + 1, :u]).max(initial=0.0) < _UNBOUNDED:
            bounded = k + 1
            x[k + 1 :] = 0.0
            break
    y, yd = x[:, :u], x[:, u:] * w
    rest = rest - np.einsum("tij,tj->ti", Kt, y) - np.einsum("tij,tj->ti", Dt, yd)
    slow[:, :, on] += np.array([y, yd, np.linalg.solve(Mt, rest[..., None])[..., 0]])
    y, yd, ydd = (z @ T.T for z in slow)
    dq = np.einsum("tij,tj->ti", Z, y) + g
    dv = np.einsum("tij,tj->ti", Z, yd) + np.einsum("tij,tj->ti", V1, y) + a0
    dvd = np.einsum("tij,tj->ti", Z, ydd) + np.einsum("tij,tj->ti", Zd + V1, yd)
    dvd += np.einsum("tij,tj->ti", V1d, y) + a0d
    return np.array([dq, dv, dvd]), bounded


def _first_order(M: Array, D: Array, K: Array, omega: Array) -> tuple[Array, Array]:
    """A (n, 2 d, 2 d) of x = (y, ẏ/ω), ẋ = A x + (0, M⁻¹ f/ω), and M⁻¹."""
    n, d, _ = M.shape
    inverse: Array = np.asarray(np.linalg.inv(M), np.float64)
    A = np.zeros((n, 2 * d, 2 * d))
    A[:, :d, d:] = np.diag(omega)
    A[:, d:, :d] = -(inverse @ K) / omega[:, None]
    A[:, d:, d:] = -(inverse @ D) * omega / omega[:, None]
    return A, inverse


def _rate(t: Array, values: Array, order: int = 1) -> Array:
    """Time derivative of rows, by cubic splines."""
    from scipy.interpolate import CubicSpline

    rates, changing = np.zeros_like(values), (values != values[0]).any(axis=0)
    if len(t) > 2:
        rates[:, changing] = CubicSpline(t, values[:, changing])(t, order)
    return rates
