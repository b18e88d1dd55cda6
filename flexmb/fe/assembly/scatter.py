"""Summing element matrices into a sparse matrix.

In: (ne, k, k) element matrices and their (ne, k) global numbers. Out: an (n, n) CSR matrix.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["scatter"]


def scatter(elements: FloatArray, numbers: IntArray, n: int) -> csr_array:
    """Sum element matrices at their global numbers."""
    k = numbers.shape[1]
    small = numbers.astype(np.int32)
    rows = np.repeat(small, k, axis=1).ravel()
    columns = np.tile(small, (1, k)).ravel()
    return coo_array((elements.ravel(), (rows, columns)), shape=(n, n)).tocsr()
