"""The lowest vibration modes of a model whose stiffness is factorised already.

In: mass, and the solution operator of the stiffness. Out: squared circular frequencies, ascending,
and mass-normalised modes. Shift-invert Lanczos (ARPACK) at shift zero, which needs no scale, with
a fixed start vector, so that a second run gives the same numbers. Blocks of vectors were tried: at
92 000 unknowns four at a time took 128 solutions and 7.7 s against 82 and 9.3 s one by one.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from flexmb.errors import FlexmbWarning, ReductionError
from flexmb.fe.solver.threads import blas_threads
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

__all__ = ["dense_modes", "lowest_modes", "start_vector"]

_TOLERANCE = 1e-10  # of 1 / omega^2, relative; what is reached lies near rounding
# Largest |omega^2 K^-1 M v - v| in the norm of the mass, |v| = 1. Rounding leaves 1e-9 in a strip
# of solids 200 times as long as thick, 1e-6 at 1000 times; frequencies are then right to 2e-5.
_RESIDUAL = 1e-5
_DOUBTFUL = 1e-7  # told from here on: digits are lost


def lowest_modes(
    M: csr_array,
    solve: Callable[[FloatArray], FloatArray],
    count: int,
    progress: Progress = silent,
    start: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Lowest modes of K x = omega^2 M x by the inverse of K.

    Parameters
    ----------
    M : (n, n) sparse
        Mass.
    solve : callable
        K^-1 b for b (n,) or (n, k); a pseudo-inverse leaves the motions it maps to zero out.
    count : int
        How many, fewer than n.
    progress : Progress
        Told the phase ``"modes"``.
    start : (n,) float, optional
        Start vector; it must lie where ``solve`` maps to, if that is a pseudo-inverse.

    Returns
    -------
    omega2 : (count,) float
        Squared circular frequencies, ascending [1/s^2].
    V : (n, count) float
        Modes with V^T M V = I.

    Raises
    ------
    ReductionError
        The modes found do not fulfil the equation of vibration.
    """
    n = M.shape[0]
    if count == 0:
        return np.zeros(0), np.zeros((n, 0))
    expected, done = 4 * count + 20, 0

    def counted(b: FloatArray) -> FloatArray:
        nonlocal done
        done += 1
        progress("modes", min(0.99, done / expected), f"{done} solves")
        return solve(np.ravel(b))

    inverse = LinearOperator((n, n), matvec=counted, dtype=float)
    v0 = start_vector(n) if start is None else start
    try:
        with blas_threads():
            omega2, V = eigsh(M, k=count, M=M, sigma=0.0, OPinv=inverse, v0=v0, tol=_TOLERANCE)
    except ArpackError as error:
        raise ReductionError(f"modes: the lowest {count} were not found ({error})") from error
    order = np.argsort(omega2)
    omega2, V = omega2[order], V[:, order]
    _check(M, solve, omega2, V)
    return omega2, V


def _check(
    M: csr_array, solve: Callable[[FloatArray], FloatArray], omega2: FloatArray, V: FloatArray
) -> None:
    wrong = omega2 * solve(M @ V) - V
    residual = np.sqrt(np.sum(wrong * (M @ wrong), axis=0))
    worst = int(residual.argmax())
    if not residual[worst] <= _RESIDUAL:
        raise ReductionError(
            f"modes: mode {worst + 1} fulfils the equation of vibration only to "
            f"{residual[worst]:.1e}; stiffnesses or masses of the model may differ too much"
        )
    if residual[worst] > _DOUBTFUL:
        warnings.warn(
            f"rounding leaves mode {worst + 1} wrong by {residual[worst]:.0e} of itself: the body "
            "is very slender for solids (take beams or shells), or its stiffnesses differ too much",
            FlexmbWarning,
            stacklevel=2,
        )


def dense_modes(K: csr_array, M: csr_array, count: int) -> tuple[FloatArray, FloatArray]:
    """The same from full matrices, where many or all modes of a small model are asked."""
    if count == 0:
        return np.zeros(0), np.zeros((K.shape[0], 0))
    return eigh(K.toarray(), M.toarray(), subset_by_index=[0, count - 1])


def start_vector(n: int) -> FloatArray:
    """(n,) the fixed start vector: no symmetry of a mesh makes it miss a mode."""
    return np.random.default_rng(1).standard_normal(n)
