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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import numerical_rank, one_blas_thread
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.engine import equations_of_motion as stages
from flexmb.engine.compile import Compiled
from flexmb.engine.units import call, hand_over, prepare_units
from flexmb.engine.work import new_run, new_state, new_work, units_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MAX_FREE = 120
"""Motions up to which the dense equations of small motions are affordable."""
_EVALUATIONS = 50  # of the equations, to time them
_UNBOUNDED = 1e12  # a small motion this many times the model is not followed any further


@dataclass(frozen=True, eq=False)
class Motion:
    """Rows of a run, SI: t (n,), q (n, nq), v, vd (n, nv), lam (n, nc), channels (n, k)."""

    t: Array
    q: Array
    v: Array
    vd: Array
    lam: Array
    channels: Array

    def put(self, k: int, equations: StateEquations) -> None:
        """Make row number k the state of the equations."""
        state = equations.state
        state.t[0], state.angles[:] = self.t[k], self.channels[k]
        for name in ("q", "v", "vd", "lam"):
            getattr(state, name)[:] = getattr(self, name)[k]

    def gap(self, compiled: Compiled) -> float:
        """How far velocities of bodies depart from the sum of their accelerations, relative (rms).

        Large where rows are too far apart to tell what happens between them.
        """
        rigid = [body.iv + k for body in compiled.layout.bodies for k in range(6)]
        weights = compiled.system.weights[rigid]
        change = np.diff(self.v[:, rigid] * weights, axis=0)
        mean = 0.5 * (self.vd[1:, rigid] + self.vd[:-1, rigid]) * weights
        missing = change - mean * np.diff(self.t)[:, None]
        total = float(np.sqrt((change**2).sum()))
        return float(np.sqrt((missing**2).sum())) / total if total > 0.0 else 0.0

    def thinned(self, most: int) -> Motion:
        """At most so many rows of it, at equal numbers of rows."""
        every = slice(None, None, -(-len(self.t) // most))
        return Motion(*(table[every] for table in vars(self).values()))


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
    system, n = compiled.system, len(motion.t)
    used = np.flatnonzero(system.kkt.column >= 0).astype(np.int64)
    equations = equations_of(compiled)
    weights = np.where(system.weights > 0.0, system.weights, 1.0)[used]
    inverse, nu = 1.0 / weights, len(used)
    rows = system.row_weights[:, None]
    Z: Array = np.zeros((n, nu, 0))
    g, F = np.zeros((n, nu)), np.zeros((n, nu))
    M, D, K = (np.zeros((n, nu, nu)) for _ in range(3))
    Omega = np.zeros((n, nu, nu))
    jacobians = np.zeros((n, len(rows), nu))
    spin = _Spin(compiled, used, weights)
    for k in range(n):
        motion.put(k, equations)
        at = equations.tangents()
        residual, C = equations.residual(), equations.work.con.C
        F[k] = inverse * (residual - balance[k])[used]
        for out, matrix in ((M, at.M), (D, at.D), (K, at.K)):
            out[k] = inverse[:, None] * matrix[np.ix_(used, used)] * inverse
        Omega[k] = spin.at(motion.v[k])
        jacobians[k] = A = rows * at.Cq[:, used] * inverse
        U, S, Vt = np.linalg.svd(A) if len(A) else (A, np.zeros(0), np.eye(nu))
        if k == 0:
            rank = numerical_rank(S)
            Z = np.zeros((n, nu, nu - rank))
        Z[k] = Vt[rank:].T
        if k:
            left, _, right = np.linalg.svd(Z[k].T @ Z[k - 1])
            Z[k] = Z[k] @ (left @ right)
        g[k] = -Vt[:rank].T @ ((U.T @ (rows[:, 0] * C))[:rank] / S[:rank])
    first = _first(start, used, weights)
    elastic = _elastic(compiled, used, inverse) if quasi_static else None
    dq, dv, dvd, bounded = _solve(motion.t, M, D, K, Z, g, Omega, F, first, elastic)
    change = np.zeros_like(motion.channels)
    full = np.zeros((3, n, compiled.layout.nv))
    for out, part in zip(full, (dq, dv, dvd), strict=True):
        out[:, used] = inverse * part
    state = equations.state
    for k in range(bounded):
        out_of_balance = F[k] + M[k] @ dvd[k] + D[k] @ dv[k] + K[k] @ dq[k]
        dlam = -np.linalg.lstsq(jacobians[k].T, out_of_balance, rcond=1e-10)[0] * rows[:, 0]
        motion.put(k, equations)
        state.q[:] = equations.moved(motion.q[k], full[0, k])
        state.v[:] += full[1, k]
        state.vd[:] += full[2, k]
        state.lam[:] += dlam
        change[k] = equations.channels() - motion.channels[k]
    change[bounded:] = np.inf
    return Response(change, full[0], bounded)


def out_of_balance(compiled: Compiled, motion: Motion) -> Array:
    """F (n, nv) that the rows of a run leave in their own model."""
    equations, rows = equations_of(compiled), np.zeros((len(motion.t), compiled.layout.nv))
    for k in range(len(rows)):
        motion.put(k, equations)
        rows[k] = equations.residual()
    return rows


def evaluation_time(compiled: Compiled) -> float:
    """Seconds that one evaluation of the forces and one of their matrix take."""
    system, state = compiled.system, new_state(compiled.system, len(compiled.layout.channels))
    state.q[:] = compiled.initial_q
    prepare_units([stages.begin_run, stages.residual, stages.put_matrix, *units_of(system)])
    run = hand_over(new_run(system, state, new_work(system, len(state.angles))))
    at, best = hand_over(run.record.state_point), np.inf
    call(stages.begin_run, run, at)
    for _ in range(5):
        began = time.process_time()
        for _ in range(_EVALUATIONS):
            call(stages.residual, run, at)
            call(stages.put_matrix, run, at, 1.0, 1.0)
        best = min(best, time.process_time() - began)
    return best / _EVALUATIONS


def equations_of(compiled: Compiled) -> StateEquations:
    """The equations of a model, at no state yet."""
    return StateEquations(compiled, new_state(compiled.system, len(compiled.layout.channels)))


class _Spin:
    """δv = δq̇ + Ω δq in weighted coordinates: the angular velocities of the bodies."""

    def __init__(self, compiled: Compiled, used: Indices, weights: Array) -> None:
        place = np.full(compiled.layout.nv, -1)
        place[used] = np.arange(len(used))
        self._bodies = [(body.iv + 3, place[body.iv + 3 : body.iv + 6]) for body in
                        compiled.layout.bodies]  # fmt: skip
        self._weights, self._n = weights, len(used)

    def at(self, v: Array) -> Array:
        Omega = np.zeros((self._n, self._n))
        for first, places in self._bodies:
            x, y, z = v[first : first + 3]
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            here = places >= 0
            if here.any():
                p = places[here]
                block = cross[np.ix_(here, here)]
                Omega[np.ix_(p, p)] = self._weights[p, None] * block / self._weights[p]
        return Omega


def _first(
    start: tuple[Array, Array] | None, used: Indices, weights: Array
) -> tuple[Array, Array] | None:
    return None if start is None else (weights * start[0][used], weights * start[1][used])


def _elastic(compiled: Compiled, used: Indices, inverse: Array) -> Array:
    """Stiffness (nu, nu) of the modes of all bodies, in weighted coordinates."""
    K = np.zeros((compiled.layout.nv,) * 2)
    for body in compiled.layout.bodies:
        own = slice(body.iv + 6, body.iv + 6 + body.m)
        if body.m:
            K[own, own] = compiled.flexbodies[body.name].K
    return np.asarray(inverse[:, None] * K[np.ix_(used, used)] * inverse)


def _solve(
    t: Array, M: Array, D: Array, K: Array, Z: Array, g: Array, Omega: Array, F: Array,
    start: tuple[Array, Array] | None, elastic: Array | None,
) -> tuple[Array, Array, Array, int]:  # fmt: skip
    """δq, δv and δv̇ (n, nu) in weighted coordinates, and how many rows are bounded.

    With `elastic`, vibrations whose stiffness is mostly that of bodies follow their loads.
    """
    from scipy.linalg import eigh, expm

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
    load = F + np.einsum("tij,tj->ti", M, a0d) + np.einsum("tij,tj->ti", D, a0)
    load = -np.einsum("tij,ti->tj", Z, load + np.einsum("tij,tj->ti", K, g))
    # modal coordinates of the mean matrices, rates over their frequencies: entries of like size
    stiffness = 0.5 * (Kr + Kr.transpose(0, 2, 1)).mean(axis=0)
    squares, T = eigh(stiffness, 0.5 * (Mr + Mr.transpose(0, 2, 1)).mean(axis=0))
    omega = np.maximum(np.sqrt(np.abs(squares)), 1.0 / (t[-1] - t[0]))
    Mt, Dt, Kt = (T.T @ A @ T for A in (Mr, Dr, Kr))
    inverse = np.linalg.inv(Mt)
    A = np.zeros((n, 2 * d, 2 * d))
    A[:, :d, d:] = np.diag(omega)
    A[:, d:, :d] = -(inverse @ Kt) / omega[:, None]
    A[:, d:, d:] = -(inverse @ Dt) * omega / omega[:, None]
    b = np.zeros((n, 2 * d))
    b[:, d:] = np.einsum("tij,tj->ti", inverse, load @ T) / omega
    x = np.zeros((n, 2 * d))
    if start is not None:
        y = np.linalg.lstsq(Z[0], start[0] - g[0], rcond=None)[0]
        yd = np.linalg.lstsq(Z[0], start[1] - V1[0] @ y - a0[0], rcond=None)[0]
        back = np.linalg.inv(T)
        x[0] = np.concatenate([back @ y, (back @ yd) / omega])
    fast = np.zeros(d, bool)
    if elastic is not None:
        strain = np.einsum("tij,ik,tkl->jl", Z, elastic, Z) / n
        fast = np.einsum("ij,ik,kj->j", T, strain, T) > 0.5 * np.abs(squares)
        y, inner = np.zeros((n, d)), np.ix_(range(n), fast, fast)
        y[:, fast] = np.linalg.solve(Kt[inner], (load @ T)[:, fast, None])[..., 0]
        b[:, d:] -= np.einsum("tij,tj->ti", inverse @ Kt, y) / omega
        held = np.tile(fast, 2)
        A[:, held], A[:, :, held], b[:, held], x[0, held] = 0.0, 0.0, 0.0, 0.0
    bounded = n
    for k in range(n - 1):
        h = t[k + 1] - t[k]
        step = np.zeros((2 * d + 2, 2 * d + 2))
        step[: 2 * d, : 2 * d] = 0.5 * h * (A[k] + A[k + 1])
        step[: 2 * d, 2 * d] = h * b[k]
        step[: 2 * d, 2 * d + 1] = h * (b[k + 1] - b[k])
        step[2 * d + 1, 2 * d] = 1.0
        x[k + 1] = (expm(step) @ np.append(x[k], (1.0, 0.0)))[: 2 * d]
        if not np.abs(T @ x[k + 1, :d]).max(initial=0.0) < _UNBOUNDED:
            bounded = k + 1
            x[k + 1 :] = 0.0
            break
    xd = np.einsum("tij,tj->ti", A, x) + b
    if fast.any():
        x[:, :d] += y
        x[:, d:] += _rate(t, y) / omega
        xd[:, d:] += _rate(t, _rate(t, y)) / omega
    y, yd, ydd = x[:, :d] @ T.T, (x[:, d:] * omega) @ T.T, (xd[:, d:] * omega) @ T.T
    dq = np.einsum("tij,tj->ti", Z, y) + g
    dv = np.einsum("tij,tj->ti", Z, yd) + np.einsum("tij,tj->ti", V1, y) + a0
    dvd = np.einsum("tij,tj->ti", Z, ydd) + np.einsum("tij,tj->ti", Zd + V1, yd)
    dvd += np.einsum("tij,tj->ti", V1d, y) + a0d
    return dq, dv, dvd, bounded


def _rate(t: Array, values: Array) -> Array:
    """Time derivative of rows, by cubic splines."""
    from scipy.interpolate import CubicSpline

    if len(t) < 3 or not np.any(values):
        return np.zeros_like(values)
    return np.asarray(CubicSpline(t, values)(t, 1))
