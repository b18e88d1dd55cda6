"""SuperLU on a sparse symmetric positive definite matrix, for models of a few thousand unknowns.

In: a stiffness matrix. Out: :class:`SuperLU`. With a column ordering and no pivoting, which on
stiffness matrices was measured faster than its symmetric mode; rows and columns scaled to a unit
diagonal, so that units do not matter.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from flexmb.fe.solver.singular import NotPositive
from flexmb.flexbody.arrays import FloatArray

__all__ = ["SuperLU"]


class SuperLU:
    """The factors L and U of the scaled matrix.

    Raises
    ------
    NotPositive
        The matrix is not positive definite.
    """

    def __init__(self, K: csr_array, scale: FloatArray) -> None:
        scaled = K.multiply(scale[:, None]).multiply(scale[None, :]).tocsc()
        try:
            self._lu = splu(scaled, permc_spec="COLAMD", diag_pivot_thresh=0.0)
        except RuntimeError as error:  # a pivot is exactly zero
            raise NotPositive(-1) from error
        pivots = self._lu.U.diagonal()
        worst = int(pivots.argmin())
        if not pivots[worst] > 0:
            raise NotPositive(int(np.flatnonzero(self._lu.perm_c == worst)[0]))
        self._scale = scale
        self.nnz = int(self._lu.nnz)

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        scale = self._scale if b.ndim == 1 else self._scale[:, None]
        return scale * self._lu.solve(np.ascontiguousarray(scale * b))
