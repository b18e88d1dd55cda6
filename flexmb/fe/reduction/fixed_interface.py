"""A model with all its interfaces fixed: the one factorisation that every method shares.

:class:`FixedInterfaceModel` gives the static response to loads with the interfaces fixed, the
constraint modes (unit motion of one interface, the others fixed), the lowest fixed-interface modes,
and the static response of the free body to loads without resultant. The degrees of freedom of rigid
interfaces are eliminated; the weighted means that define weighted interfaces are prescribed by
bordering. So both kinds may be mixed. With Psi the constraint modes and H the response with
interfaces fixed, the response of the free body is Psi q + H f with Psi^T K Psi q = Psi^T f, one
interface at rest.

:class:`BorderedSolver` solves K u + W^T l = f, W u = g: only the small Schur complement W K^-1 W^T
is full. If nothing but the means supports the part, K has the rigid motions R as its null space.
Then it is solved with as many well-spread degrees of freedom fixed (a pivoted QR of R^T), and the
border adds the condition that f - W^T l has no resultant, which is exact. Source: Golub, Van Loan,
Matrix Computations, 4th ed., section 2.1.4 (bordering).

Mass matrices are solved by conjugate gradients with the diagonal as preconditioner: a consistent
mass matrix scaled by its diagonal has a condition number that depends on the element kind alone.
Source: Wathen (1987), IMA Journal of Numerical Analysis 7(4).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, lu_factor, lu_solve, null_space, qr
from scipy.sparse import csr_array

from flexmb.errors import Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface, WeightedInterface
from flexmb.fe.linear_solver import Factor, SingularMatrix, factor
from flexmb.fe.reduction.eigenmodes import dense_modes, lowest_modes, start_vector
from flexmb.fe.reduction.reduced_basis import free_part
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.mesh_options import ModesOptions
from flexmb.flexbody.options import read_options
from flexmb.progress import Progress, silent

_TOLERANCE = 1e-13  # residual of the conjugate gradients relative to the right side
_MAX_ITERATIONS = 2000  # dozens of iterations are usual; rotations of thin shells take more


def mass_solve(M: csr_array, B: FloatArray) -> FloatArray:
    """(n, k) M^-1 B for all columns of B (n, k) together; zero where the diagonal of M is zero."""
    diagonal = M.diagonal()[:, None]
    inverse = np.where(diagonal > 0, 1.0 / np.where(diagonal > 0, diagonal, 1.0), 0.0)
    X, R = np.zeros_like(B), B.copy()
    Z = inverse * R
    P, energy = Z.copy(), np.sum(R * Z, axis=0)
    target = _TOLERANCE**2 * energy
    for _ in range(_MAX_ITERATIONS):
        going = energy > target
        if not going.any():
            break
        MP = M @ P
        step = np.where(going, energy / np.where(going, np.sum(P * MP, axis=0), 1.0), 0.0)
        X += step * P
        R -= step * MP
        Z = inverse * R
        before, energy = energy, np.sum(R * Z, axis=0)
        P = Z + np.where(going, energy / np.where(going, before, 1.0), 0.0) * P
    return X


def constrained_mass_solve(M: csr_array, W: csr_array, B: FloatArray) -> FloatArray:
    """(n, k) `mass_solve` under the constraint that the means W (w, n) of the solution are zero."""
    X = mass_solve(M, B)
    if not W.shape[0]:
        return X
    Y = mass_solve(M, W.T.toarray())
    return X - Y @ np.linalg.solve(W @ Y, W @ X)


class BorderedSolver:
    """A factorised stiffness with weighted means prescribed.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness.
    W : (w, n) sparse
        Weighted means; none is allowed.
    R : (n, r) float
        Null space of K; no columns where K is regular.
    points : (n, 3) float
        Place of each degree of freedom [m].
    progress : Progress
        Called with the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    SingularMatrix
        A part moves freely; ``dofs`` are its rows of K.
    """

    def __init__(
        self, K: csr_array, W: csr_array, R: FloatArray, points: FloatArray, progress: Progress
    ) -> None:
        self._W, self._n = W, K.shape[0]
        fixed = statically_determinate(R) if R.shape[1] else np.zeros(0, dtype=int)
        self._left = np.setdiff1d(np.arange(self._n), fixed)
        self._factor: Factor | None = None
        if len(self._left):
            part = K if not len(fixed) else csr_array(K[self._left][:, self._left])
            try:
                self._factor = factor(part, points[self._left], progress)
            except SingularMatrix as error:
                error.dofs = self._left[error.dofs]
                raise
        self._R = R
        self._border()

    def solve(self, f: FloatArray, g: FloatArray | None = None) -> FloatArray:
        """u (n,) or (n, k) for loads f and means g, (w,) or (w, k), zero by default."""
        u = self._plain(f)
        w = self._W.shape[0]
        if not w:
            return u
        resultant = self._R.T @ f
        for _ in range(2):  # iterative refinement of the means
            gap = self._W @ u - (0.0 if g is None else g)
            right = np.concatenate([gap, resultant])
            scale = self._scale if right.ndim == 1 else self._scale[:, None]
            border = scale * lu_solve(self._small, scale * right)
            u = u - self._X @ border[:w] - self._R @ border[w:]
            resultant = np.zeros_like(resultant)
        return u

    def _border(self) -> None:
        """Factorise the small matrix [[W K^+ W^T, W R], [R^T W^T, 0]] of the unknowns (l, -c)."""
        w, r = self._W.shape[0], self._R.shape[1]
        if not w:
            return
        self._X = self._plain(self._W.T.toarray())
        S, WR = self._W @ self._X, self._W @ self._R
        scale = np.zeros(w + r)
        # flexibility of each mean; zero if its degrees of freedom are those fixed against R
        give = np.diag(S)
        top = give.max() if give.max() > 0 else 1.0
        scale[:w] = 1.0 / np.sqrt(np.where(give > 1e-9 * top, give, top))
        scale[w:] = 1.0 / np.linalg.norm(scale[:w, None] * WR, axis=0) if r else 0.0
        small = np.block([[0.5 * (S + S.T), WR], [WR.T, np.zeros((r, r))]])
        self._scale = scale
        self._small = lu_factor(scale[:, None] * small * scale)

    def _plain(self, f: FloatArray) -> FloatArray:
        if self._factor is not None and len(self._left) == self._n:
            return self._factor.solve(f)
        u = np.zeros_like(f)
        if self._factor is not None:
            u[self._left] = self._factor.solve(f[self._left])
        return u


def statically_determinate(R: FloatArray) -> IntArray:
    """Well-spread degrees of freedom, as many as R has columns, that prevent all rigid motions."""
    scaled = R / np.abs(R).max(axis=0)
    return np.sort(qr(scaled.T, mode="r", pivoting=True)[1][: R.shape[1]])


_DENSE = 300  # up to this number of interior degrees of freedom full matrices are faster


class FixedInterfaceModel:
    """A model with its interfaces fixed.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple of RigidInterface or WeightedInterface
        At least one.
    directions : tuple of int
        Motions of an interface that are coordinates, of six; the others are always fixed.
    progress : Progress
        Called with the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    ReductionError
        No interface, or a part of the mesh that can move freely with all interfaces fixed.
    """

    def __init__(
        self,
        fe: FEMatrices,
        interfaces: tuple[ModelInterface, ...],
        directions: tuple[int, ...],
        progress: Progress = silent,
    ) -> None:
        if not interfaces:
            raise ReductionError("interfaces: at least one is needed to hold the body")
        self.fe, self.interfaces, self.directions = fe, interfaces, directions
        rigid = [part for part in interfaces if isinstance(part, RigidInterface)]
        self._b = np.concatenate([np.zeros(0, int), *(part.dofs for part in rigid)])
        self.dofs = np.setdiff1d(np.arange(fe.numbering.n), self._b)
        self.M = self._inner(fe.M)
        self._W = self._means()
        R = np.zeros((len(self.dofs), 0)) if rigid else fe.rigid
        points = fe.dof_points[self.dofs]
        try:
            self._bordered = BorderedSolver(self._inner(fe.K), self._W, R, points, progress)
        except SingularMatrix as error:
            raise ReductionError(free_part(fe, self.dofs[error.dofs])) from error
        self._motion = self._interface_motion()
        self.modes = self._constraint_modes()
        K = self.modes.T @ (fe.K @ self.modes)
        self.K_modes = 0.5 * (K + K.T)

    @property
    def count(self) -> int:
        """Number of fixed-interface modes of the model."""
        return len(self.dofs) - self._W.shape[0]

    def solve(self, f: FloatArray) -> FloatArray:
        """(n, ...) static response with the interfaces fixed to loads f (n, ...)."""
        u = np.zeros_like(f)
        u[self.dofs] = self._bordered.solve(f[self.dofs])
        return u

    def free(self, f: FloatArray) -> FloatArray:
        """(n, ...) response of the free body to loads f (n, ...) that have no resultant.

        The first interface is at rest in it; the rigid motion is arbitrary and may be removed.
        """
        d = len(self.directions)
        q = np.zeros((self.modes.shape[1], *f.shape[1:]))
        if len(q) > d:
            scale = 1.0 / np.sqrt(np.diag(self.K_modes)[d:])
            small = cho_factor(scale[:, None] * self.K_modes[d:, d:] * scale)
            across = scale if f.ndim == 1 else scale[:, None]
            q[d:] = across * cho_solve(small, across * (self.modes.T @ f)[d:])
        return self.modes @ q + self.solve(f)

    def loads(self) -> FloatArray:
        """(n, c) unit forces and moments on the motions of all interfaces."""
        F = np.zeros((self.fe.numbering.n, self.modes.shape[1]))
        d = len(self.directions)
        for k, interface in enumerate(self.interfaces):
            dofs, values = interface.loads()
            F[dofs, d * k : d * (k + 1)] = values[:, self.directions]
        return F

    def lowest(self, count: int, progress: Progress = silent) -> tuple[FloatArray, FloatArray]:
        """The lowest fixed-interface modes over the degrees of freedom that remain free."""
        if len(self.dofs) <= _DENSE or 2 * count >= self.count:
            return self._dense(count)
        start = self._bordered.solve(start_vector(len(self.dofs)))
        return lowest_modes(self.M, self._bordered.solve, count, progress, start)

    def mass_solve(self, B: FloatArray) -> FloatArray:
        """(k, ...) inverse of the mass matrix times B (k, ...), interfaces fixed, weighted means
        zero."""
        return constrained_mass_solve(self.M, self._W, B)

    def fields(self) -> FloatArray:
        """(n, x) a full basis of all displacement fields of the tied model; for small models
        only."""
        inner = np.zeros((self.fe.numbering.n, self.count))
        N = null_space(self._W.toarray()) if self._W.shape[0] else np.eye(len(self.dofs))
        inner[self.dofs] = N
        return np.concatenate([self.modes, inner], axis=1)

    def _dense(self, count: int) -> tuple[FloatArray, FloatArray]:
        """`lowest` from full matrices; fewer modes if motions have no mass. Weighted means are
        zero."""
        K, M = self._inner(self.fe.K).toarray(), self.M.toarray()
        N = null_space(self._W.toarray()) if self._W.shape[0] else np.eye(len(K))
        omega2, V = dense_modes(N.T @ K @ N, N.T @ M @ N, count)
        return omega2, N @ V

    def _means(self) -> csr_array:
        rows = [part for part in self.interfaces if isinstance(part, WeightedInterface)]
        values = np.concatenate([np.zeros(0), *(part.W.ravel() for part in rows)])
        dofs = np.concatenate([np.zeros(0, int), *(np.tile(part.dofs, 6) for part in rows)])
        at = [np.repeat(6 * k + np.arange(6), len(part.dofs)) for k, part in enumerate(rows)]
        numbers = np.concatenate([np.zeros(0, int), *at])
        columns = np.searchsorted(self.dofs, dofs)
        return csr_array((values, (numbers, columns)), shape=(6 * len(rows), len(self.dofs)))

    def _interface_motion(self) -> tuple[FloatArray, FloatArray]:
        """Motion of the eliminated degrees of freedom and of the means per unit motion of the
        interfaces."""
        columns, d = list(self.directions), len(self.directions)
        rigid, means = [], []
        for part in self.interfaces:
            is_rigid = isinstance(part, RigidInterface)
            rigid.append(part.T[:, columns] if is_rigid else np.zeros((0, d)))
            means.append(np.zeros((0, d)) if is_rigid else np.eye(6)[:, columns])
        return block_diag(*rigid), block_diag(*means)

    def _inner(self, matrix: csr_array) -> csr_array:
        """The part of a matrix (n, n) over the degrees of freedom that remain free."""
        if not len(self._b):
            return matrix
        return csr_array(matrix[self.dofs][:, self.dofs])

    def _constraint_modes(self) -> FloatArray:
        K_ib = self.fe.K[self._b][:, self.dofs].T
        T, g = self._motion
        modes = np.zeros((self.fe.numbering.n, T.shape[1]))
        modes[self._b] = T
        modes[self.dofs] = self._bordered.solve(-(K_ib @ T), g)
        return modes


_INITIAL_MODES = 20  # modes computed first if a frequency or a mass share decides their number
_MAX_MODES = 640  # largest number of modes computed to reach a mass share

ModesLike = int | Mapping[str, Any] | ModesOptions


def read_modes(modes: ModesLike) -> ModesOptions:
    """Read a number of modes, or a table with one key.

    Raises
    ------
    ReductionError
        No whole number, an unknown word, none or several words, or a value that cannot be.
    """
    if not isinstance(modes, Mapping | ModesOptions):
        whole = isinstance(modes, int | np.integer) and not isinstance(modes, bool)
        if not whole or modes < 0:
            what = f"must be a whole number >= 0, given {modes!r}"
            raise ReductionError.from_problems([Problem("modes", what)])
        return ModesOptions(count=int(modes))
    return read_options(ModesOptions, modes, "modes", ReductionError)


def select_modes(
    selection: ModesOptions,
    lowest: Callable[[int], tuple[FloatArray, FloatArray]],
    limit: int,
    noun: str,
    shares: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Compute modes until the selection is complete.

    Parameters
    ----------
    selection : ModesOptions
        A count, a frequency, or a share of the effective interface mass.
    lowest : callable
        Squared frequencies and fields of at least the given number of modes, or of all.
    limit : int
        Number of modes that the model has.
    noun : str
        What the modes are called in messages.
    shares : callable, optional
        Share of each mode in the effective interface mass.

    Returns
    -------
    omega2, V, rows
        Squared frequencies (k,), fields (n, k) and which of them are requested.

    Raises
    ------
    ReductionError
        More modes than the model has.
    """
    count = _INITIAL_MODES if selection.count is None else selection.count
    if selection.count is not None and count > limit:
        raise _too_many(count, limit, noun)
    while True:
        omega2, V = lowest(count)
        complete = len(omega2) < count or count >= limit
        if selection.count is not None:
            if count > len(omega2):
                raise _too_many(count, len(omega2), noun)
            return omega2, V, np.arange(count)
        if selection.frequency is not None:
            rows = np.flatnonzero(omega2 < (2 * np.pi * selection.frequency) ** 2)
            if complete or len(rows) < len(omega2):
                return omega2, V, rows
        elif shares is not None:
            part, wanted = shares(V), float(selection.effective_mass or 0.0)
            if complete or part.sum() >= wanted:
                return omega2, V, smallest_set(part, wanted)
            if count >= _MAX_MODES:
                what = f"the lowest {len(omega2)} fixed-interface modes hold {part.sum():.4f}"
                raise ReductionError(f"modes.effective_mass: {what}; ask for less, or for a count")
        count *= 2


def _too_many(count: int, present: int, noun: str) -> ReductionError:
    why = "" if present else ": its interfaces hold all its nodes"
    return ReductionError(f"modes: {count} requested, but the model has only {present} {noun}{why}")


def interface_shares(fixed: FixedInterfaceModel, V: FloatArray) -> FloatArray:
    """(k,) share of each fixed-interface mode in the effective interface mass; all modes sum to
    one.

    Parameters
    ----------
    fixed : FixedInterfaceModel
        The model with its interfaces held.
    V : (i, k) float
        Modes of unit modal mass over the degrees of freedom that remain free.
    """
    X = (fixed.fe.M @ fixed.modes)[fixed.dofs]
    total = np.sum(X * fixed.mass_solve(X), axis=0)
    counted = total > 1e-12 * np.diag(fixed.modes.T @ (fixed.fe.M @ fixed.modes))
    return np.asarray(((V.T @ X)[:, counted] ** 2 / total[counted]).sum(axis=1) / counted.sum())


def smallest_set(shares: FloatArray, wanted: float) -> FloatArray:
    """Rows, ascending, of the fewest modes whose shares sum to ``wanted``; all rows if they do
    not."""
    order = np.argsort(-shares, kind="stable")
    count = int(np.searchsorted(np.cumsum(shares[order]), wanted)) + 1
    return np.sort(order[:count])
