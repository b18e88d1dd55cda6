"""PARDISO of Intel's MKL through pypardiso, where that is installed (`pip install flexmb[mkl]`).

In: a sparse symmetric positive definite matrix. Out: :class:`Pardiso`. Used for large models if it
is found. At 92 000 unknowns on one core it took 8.9 s of CPU where the multifrontal factorisation
of flexmb takes 7, and as long for a solution; it has the advantage where there are many cores. Its
last digits may change from run to run. Its own steps of refinement are left out: they double the
time of a solution and the residual is at rounding without.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, csr_matrix, triu

from flexmb.fe.solver.memory import require_memory
from flexmb.fe.solver.singular import NotPositive
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

try:
    import pypardiso
except ImportError:
    pypardiso = None

__all__ = ["FOUND", "Pardiso"]

FOUND = pypardiso is not None
"""Whether pypardiso is installed."""

_POSITIVE_DEFINITE = 2  # type of matrix, of which PARDISO wants the upper triangle
_ANALYSE, _FACTOR, _SOLVE = 11, 22, 33  # phases
_REFINEMENT, _KEPT, _WORK, _NNZ = 8, 16, 17, 18  # places in its table of parameters, from 1
_NOT_POSITIVE = "-4"


class Pardiso:
    """The factors of a matrix, kept by MKL.

    Parameters
    ----------
    K : (n, n) sparse
        Symmetric positive definite; both triangles are stored.
    progress : Progress
        Told the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    NotPositive
        The matrix is not positive definite.
    ReductionError
        The factors do not fit into memory.
    """

    def __init__(self, K: csr_array, progress: Progress = silent) -> None:
        self._matrix = csr_matrix(triu(K, format="csr"))
        self._solver = pypardiso.PyPardisoSolver(mtype=_POSITIVE_DEFINITE)
        self._solver.set_iparm(_REFINEMENT, 0)
        nothing = np.zeros((K.shape[0], 1), order="F")
        progress("order", 0.0, f"{K.shape[0]} unknowns")
        self._call(_ANALYSE, nothing)
        progress("order", 1.0)
        self.nnz = int(self._solver.get_iparm(_NNZ))
        kilobytes = self._solver.get_iparm(_KEPT) + self._solver.get_iparm(_WORK)
        what = f"the factorisation of {K.shape[0]} unknowns ({self.nnz:.2g} entries)"
        require_memory(1024.0 * kilobytes, what)
        progress("factor", 0.0, f"{K.shape[0]} unknowns, {self.nnz:.3g} entries")
        self._call(_FACTOR, nothing)

    def __del__(self) -> None:
        solver = getattr(self, "_solver", None)
        if solver is not None:
            solver.free_memory(everything=True)

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        return self._call(_SOLVE, np.asfortranarray(b.reshape(len(b), -1))).reshape(b.shape)

    def _call(self, phase: int, b: FloatArray) -> FloatArray:
        self._solver.set_phase(phase)
        try:
            return self._solver._call_pardiso(self._matrix, b)
        except pypardiso.pardiso_wrapper.PyPardisoError as error:
            if str(error.value) == _NOT_POSITIVE:
                raise NotPositive(-1) from error
            raise
