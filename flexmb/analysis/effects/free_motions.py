"""Small motions about a motion, and those that joints leave free, δq = Z y + g.

In: a compiled model and the rows of a motion. Out: coefficients of small motions row by row, those
of the free ones in M ÿ + D ẏ + K y = load, their frequencies, their equations of first order, and
the places about which they vibrate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import numerical_rank
from flexmb.analysis.effects.smooth_pieces import SmoothPieces
from flexmb.analysis.effects.stored_motion import Frames, Motion, blocks, equations_of
from flexmb.engine.compile import Compiled
from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array, IntArray

_NOTHING = 1e-20  # of the largest square of a row of Cq
_HELD = 1e-8  # of the largest square of rows of Cq, without modes: these hold what turns and moves
_NO_MASS = 1e-12  # of the inertia of all
_MODES_LAST = 1e-6  # preference of modes among dependent coordinates
_TABLES = ("M", "D", "K", "Cq", "F", "C", "Omega", "rows")
_TURNING = 2 * np.pi  # of a body over the run: so much makes its coordinates twice as dependent


@dataclass(frozen=True, eq=False)
class Coefficients:
    """M δv̇ + D δv + K δq + (Cqᵀ + friction) δλ = −F, Cq δq = −C, row by row, weighted coordinates.

    The rows of Cq are independent: combinations `rows` of those of the model, which are at right
    angles where the model has too many.
    D contains the turning of the axes in δv̇, Omega is that in δv. The larger `prefer`, the rather
    a coordinate depends on others.
    """

    frames: Frames
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
    friction: Array | None = None

    def part(self, rows: slice | IntArray, names: tuple[str, ...] = _TABLES) -> Coefficients:
        """Some of the rows, of all tables or of some."""
        tables = {name: getattr(self, name)[rows] for name in names}
        friction = None if self.friction is None else self.friction[rows]
        return replace(self, friction=friction, **tables)

    def between(self, load: Array, begins: bool, ends: bool) -> Coefficients:
        """With more F (n, nu); D, K, friction of ends at which a bristle changes: those beside."""
        if not (load.any() or begins or ends):
            return self
        rows = np.arange(len(self.F))
        if begins and len(rows) > 2:
            rows[0] = 1
        if ends:
            rows[-1] = rows[-2]
        return replace(self.part(rows, ("D", "K")), F=self.F + load[rows])

    def projection(self, Z: Array) -> Array:
        """Zᵀ (n, d, nu) of forces less the friction that the reactions to them make in joints."""
        Zt = Z.transpose(0, 2, 1)
        if self.friction is None:
            return np.asarray(Zt)
        squares = self.Cq @ (self.Cq.transpose(0, 2, 1) + self.friction)
        return np.asarray(Zt - Zt @ self.friction @ np.linalg.solve(squares, self.Cq))

    def closure(self, stiffness: Array) -> Array:
        """Motions (n, nu, rank) that change the rows of Cq by one, of the least M + stiffness."""
        W = self.M + stiffness
        W += _NO_MASS * np.trace(W, axis1=1, axis2=2).max() * np.eye(W.shape[1])
        moved = np.linalg.solve(W, self.Cq.transpose(0, 2, 1))
        return np.asarray(moved @ np.linalg.inv(self.Cq @ moved))

    def shares(self, force: Array, follows: NDArray[np.bool_]) -> Array:
        """λ (n, rank) of Cqᵀ λ next to forces (n, nu), but for those on motions that follow."""
        if self.friction is not None:
            force = times(self.projection(np.eye(force.shape[1])[None]), force)
        rows = self.Cq * ~follows
        squares = rows @ rows.transpose(0, 2, 1)
        least, most = np.linalg.eigvalsh(squares)[:, [0, -1]].T if rows.size else np.zeros((2, 1))
        if follows.any() and np.any(least < _HELD * most):  # joints need the compliance
            return replace(self, friction=None).shares(force, np.zeros_like(follows))
        squares += _NOTHING * max(most.max(), 1e-300) * np.eye(rows.shape[1])
        return np.asarray(np.linalg.solve(squares, rows @ force[:, :, None])[:, :, 0])


def small_motions(compiled: Compiled, motion: Motion, balance: Array) -> Coefficients:
    """The coefficients of a model about a motion, as for `perturbation.respond`."""
    frames, equations, n = Frames(compiled, motion), equations_of(compiled), len(motion.t)
    nv, used, scale = compiled.layout.nv, frames.used, compiled.system.row_weights
    nu, nc = len(used), len(scale)
    M, D, K, Omega = (np.zeros((n, nu, nu)) for _ in range(4))
    F, C, U = np.zeros((n, nv)), np.zeros((n, nc)), np.eye(nc)[None]
    Cq, friction = np.zeros((2, n, nc, nu))
    for part in blocks(n):
        own = range(n)[part]
        tangents = []
        for k in own:
            motion.put(k, equations)
            tangents.append(equations.tangents())
            F[k], C[k] = equations.work.trial.res, equations.work.con.C
        mass, *others = (np.stack([x[j] for x in tangents]) for j in range(5))
        M[part] = frames.both_turned(mass, part)
        D[part], K[part] = (frames.both_turned(X, part) for X in others[:2])
        Omega[part], shift = frames.spin(part)
        D[part] += M[part] @ shift
        Cq[part] = frames.turned(others[2], part)
        if np.any(loads := others[3].transpose(0, 2, 1) - others[2]):
            friction[part] = frames.turned(loads, part)
    F = frames.turned((F - balance)[:, None])[:, 0]
    rank = numerical_rank(np.linalg.svd(scale[:, None] * Cq[0], compute_uv=False))
    if rank < nc:  # what is right-angled to the others and has no length is left out
        U = np.linalg.svd(scale[:, None] * Cq, full_matrices=False)[0][:, :, :rank]
    rows = np.broadcast_to(U.transpose(0, 2, 1) * scale, (n, rank, nc))
    Cq, C = rows @ Cq, np.einsum("trc,tc->tr", rows, C)
    by_load = (rows @ friction).transpose(0, 2, 1) if friction.any() else None
    prefer, v = np.ones(compiled.layout.nv), motion.v
    for body in compiled.layout.bodies:
        prefer[body.iv + 6 : body.iv + 6 + body.m] = _MODES_LAST
        spin = np.linalg.norm(v[:, body.iv + 3 : body.iv + 6], axis=1).max()
        prefer[body.iv : body.iv + 6] += spin * (motion.t[-1] - motion.t[0]) / _TURNING
    weights = 1.0 / frames.inverse[used]
    return Coefficients(frames, weights, prefer[used], M, D, K, Cq, F, C, Omega, rows, by_load)


class FreeMotions:
    """The equations for y of δq = Z y + g: M ÿ + D ẏ + K y = load.

    With `calm` the second rate of g has no spikes.
    """

    def __init__(
        self, pieces: SmoothPieces, of: Coefficients, Z: Array, g: Array, calm: bool = False
    ) -> None:
        self.Z, self.g = Z, g
        self.Zd = pieces.rate(Z)
        self.V1 = self.Zd + of.Omega @ Z
        self.V1d = pieces.rate(self.V1)
        rate, turned = pieces.rate(g), times(of.Omega, g)
        self.a0, second = rate + turned, pieces.rate(rate)
        self.a0d = (pieces.calm_second(g, second) if calm else second) + pieces.rate(turned)
        n, _, d = Z.shape
        self.M, self.D, self.K = (np.zeros((n, d, d)) for _ in range(3))
        project, self._mean = of.projection(Z), np.zeros((2, d, d))
        for part in blocks(n):
            Zt, M, D, V1 = project[part], of.M[part], of.D[part], self.V1[part]
            inertia, springs = M @ Z[part], M @ self.V1d[part] + D @ V1 + of.K[part] @ Z[part]
            self.M[part], self.K[part] = Zt @ inertia, Zt @ springs
            self.D[part] = Zt @ (M @ (self.Zd[part] + V1) + D @ Z[part])
            if of.friction is not None:
                Zt = Z[part].transpose(0, 2, 1)
                self._mean += [(Zt @ X).sum(axis=0) / n for X in (springs, inertia)]
        if of.friction is None:
            self._mean[:] = self.K.mean(axis=0), self.M.mean(axis=0)
        force = of.F + times(of.M, self.a0d) + times(of.D, self.a0) + times(of.K, g)
        self.load = -times(project, force)

    def mean(self, X: Array) -> Array:
        """Mean Zᵀ X Z."""
        return np.asarray(np.tensordot(self.Z, X @ self.Z, ((0, 1), (0, 1))) / len(self.Z))

    def modes(self, least: float, further: Array | None = None) -> tuple[Array, Array]:
        """Frequencies ω (d,), `least` at least, and shapes (d, d) of the mean matrices.

        Without the friction that reactions make. `further` (nu, nu) is added to the mass.
        """
        from scipy.linalg import eigh

        stiffness, mass = (0.5 * (X + X.T) for X in self._mean)
        try:
            squares, T = eigh(stiffness, mass if further is None else mass + self.mean(further))
        except np.linalg.LinAlgError:
            what = "the motions about the computed one have no inertia in the mean"
            more = "the rows of the run are too far apart for them; ask for more outputs"
            raise FlexmbError(f"{what}: {more}") from None
        return np.maximum(np.sqrt(np.abs(squares)), least), T

    def motion(self, y: Array, yd: Array, ydd: Array) -> Array:
        """δq, δv and δv̇ (3, n, nu)."""
        dvd = times(self.Z, ydd) + times(self.Zd + self.V1, yd) + times(self.V1d, y) + self.a0d
        dv = times(self.Z, yd) + times(self.V1, y) + self.a0
        return np.array([times(self.Z, y) + self.g, dv, dvd])


def times(X: Array, x: Array) -> Array:
    """X x of all rows."""
    return np.asarray(np.einsum("tij,tj->ti", X, x))


def equilibria(
    M: Array, D: Array, K: Array, load: Array, omega: Array, quick: NDArray[np.bool_]
) -> Array:
    """Places (n, q, 2 s + r) of quick vibrations, per (y, ẏ/ω) of the s others and r loads.

    Those of equilibrium with the loads and the accelerations of the others: they ring about it.
    """
    slow = ~quick
    both = np.where(quick, K, M)  # of the places of quick ones and the accelerations of the others
    others = np.concatenate([K[:, :, slow], D[:, :, slow] * omega[slow], -load], axis=2)
    return -least_solution(both, others)[:, quick]


def least_solution(A: Array, b: Array) -> Array:
    """x of A x = b; the least one where A is singular, as of a contact that is open."""
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(A) @ b)


def first_order(
    M: Array, D: Array, K: Array, omega: Array, of: NDArray[np.bool_] | slice = slice(None)
) -> tuple[Array, Array]:
    """A (n, 2 d, 2 d) of x = (y, ẏ/ω), ẋ = A x + (0, M⁻¹ f/ω), and M⁻¹; of some of the y."""
    n, w = len(M), omega[of]
    d = len(w)
    inverse, A = np.zeros_like(M), np.zeros((n, 2 * d, 2 * d))
    A[:, :d, d:] = np.diag(w)
    for part in blocks(n):
        inverse[part] = np.linalg.inv(M[part])
        own = -inverse[part][:, of] / w[:, None]
        A[part, d:, :d] = own @ K[part][:, :, of]
        A[part, d:, d:] = own @ D[part][:, :, of] * w
    return A, inverse
