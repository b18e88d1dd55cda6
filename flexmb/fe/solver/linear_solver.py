"""Solving with a sparse symmetric positive definite matrix, behind one small interface.

In: a stiffness matrix. Out: a :class:`Factor` that solves for one or many right sides. Other
factorisations (supernodal, multifrontal) fit behind the same two names. SuperLU with a column
ordering and no pivoting: on stiffness matrices this was measured faster than its symmetric mode.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from flexmb.errors import ReductionError
from flexmb.flexbody.arrays import FloatArray

__all__ = ["Factor", "factor"]

_SINGULAR = 1e14  # growth of a solution of the scaled system: above this K is singular, not stiff


class Factor(Protocol):
    """A factorised matrix."""

    nnz: int  # entries of the factors

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        ...


class _SuperLU:
    def __init__(self, K: csr_array) -> None:
        scale = 1.0 / np.sqrt(K.diagonal())
        scaled = (K.multiply(scale[:, None]).multiply(scale[None, :])).tocsc()
        self._lu = splu(scaled, permc_spec="COLAMD", diag_pivot_thresh=0.0)
        self._scale = scale
        self.nnz = int(self._lu.nnz)
        probe = np.cos(np.arange(K.shape[0]))
        if not np.abs(self._lu.solve(probe)).max() < _SINGULAR:
            raise RuntimeError("a pivot vanishes")

    def solve(self, b: FloatArray) -> FloatArray:
        scale = self._scale if b.ndim == 1 else self._scale[:, None]
        return scale * self._lu.solve(np.ascontiguousarray(scale * b))


def factor(K: csr_array) -> Factor:
    """Factorise a sparse symmetric positive definite matrix.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness.

    Raises
    ------
    ReductionError
        K is singular: something is held neither by elements nor by an interface.
    """
    if K.shape[0] and not K.diagonal().min() > 0:
        raise ReductionError("the stiffness matrix has a degree of freedom without stiffness")
    try:
        return _SuperLU(K)
    except RuntimeError as error:
        raise ReductionError(
            f"the stiffness matrix with all interfaces held is singular ({error}): a part of the "
            "mesh is connected to the rest by too few nodes"
        ) from error
