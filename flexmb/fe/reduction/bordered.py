"""Solving with a stiffness of which some weighted means are held.

In: K of a part of the model, and W whose rows are held or moved. Out: :class:`Bordered`, which
solves K u + W^T l = f, W u = g. K and its factor stay sparse: only the small Schur complement W
K^-1 W^T is full. Where nothing else holds the part, K has the rigid motions R as its null space;
it is solved with as many well-spread degrees of freedom held, and the border says that f - W^T l
has no resultant; that is exact. Source: Golub, Van Loan, Matrix Computations, 4th ed., section
2.1.4 (bordering); the degrees of freedom are chosen by a pivoted QR of R^T.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lu_factor, lu_solve, qr
from scipy.sparse import csr_array

from flexmb.fe.solver.linear_solver import Factor, factor
from flexmb.fe.solver.singular import SingularMatrix
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.progress import Progress

__all__ = ["Bordered", "determinate"]


class Bordered:
    """A factorised stiffness with held means.

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
        Told the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    SingularMatrix
        A part moves freely; ``dofs`` are its rows of K.
    """

    def __init__(
        self, K: csr_array, W: csr_array, R: FloatArray, points: FloatArray, progress: Progress
    ) -> None:
        self._W, self._n = W, K.shape[0]
        held = determinate(R) if R.shape[1] else np.zeros(0, dtype=int)
        self._left = np.setdiff1d(np.arange(self._n), held)
        self._factor: Factor | None = None
        if len(self._left):
            part = K if not len(held) else csr_array(K[self._left][:, self._left])
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
        for _ in range(2):  # once more, for what rounding leaves of the means
            gap = self._W @ u - (0.0 if g is None else g)
            right = np.concatenate([gap, resultant])
            scale = self._scale if right.ndim == 1 else self._scale[:, None]
            found = scale * lu_solve(self._small, scale * right)
            u = u - self._X @ found[:w] - self._R @ found[w:]
            resultant = np.zeros_like(resultant)
        return u

    def _border(self) -> None:
        """Factor the small matrix [[W K^+ W^T, W R], [R^T W^T, 0]] of (l, -c)."""
        w, r = self._W.shape[0], self._R.shape[1]
        if not w:
            return
        self._X = self._plain(self._W.T.toarray())
        S, WR = self._W @ self._X, self._W @ self._R
        scale = np.zeros(w + r)
        give = np.diag(S)  # none where a mean is that of degrees of freedom which hold R
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


def determinate(R: FloatArray) -> IntArray:
    """Degrees of freedom, as many as R has columns, that hold all rigid motions, well spread."""
    scaled = R / np.abs(R).max(axis=0)
    return np.sort(qr(scaled.T, mode="r", pivoting=True)[1][: R.shape[1]])
