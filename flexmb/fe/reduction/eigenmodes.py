"""The lowest vibration modes of a factorised model, unique in sign and direction.

Shift-invert Lanczos (ARPACK) at shift zero, which needs no scale, with a fixed start vector, so
that a second run gives the same numbers. Blocks of vectors were tried: at 92 000 unknowns four at a
time took 128 solutions and 7.7 s against 82 and 9.3 s one by one. Within a cluster of equal
frequencies each mode is made the one with the largest product with a fixed displacement field, and
that product positive. The fields depend on position alone, so symmetric bodies give the same modes
in every run, on every machine, in every unit system and for any order of the nodes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import eigh, qr
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from flexmb.errors import FlexmbWarning, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.multifrontal import blas_threads
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

_TOLERANCE = 1e-10  # of 1 / omega^2, relative; what is reached lies near rounding
# Largest |omega^2 K^-1 M v - v| in the norm of the mass, |v| = 1. Rounding leaves 1e-9 in a strip
# of solids 200 times as long as thick, 1e-6 at 1000 times; frequencies are then right to 2e-5.
_MAX_RESIDUAL = 1e-5
_WARNING_RESIDUAL = 1e-7  # a warning from here on: digits are lost


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
        Called with the phase ``"modes"``.
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
    if not residual[worst] <= _MAX_RESIDUAL:
        raise ReductionError(
            f"modes: mode {worst + 1} fulfils the equation of vibration only to "
            f"{residual[worst]:.1e}; stiffnesses or masses of the model may differ too much"
        )
    if residual[worst] > _WARNING_RESIDUAL:
        warnings.warn(
            f"rounding leaves mode {worst + 1} wrong by {residual[worst]:.0e} of itself: the body "
            "is very slender for solids (take beams or shells), or its stiffnesses differ too much",
            FlexmbWarning,
            stacklevel=2,
        )


def dense_modes(K: csr_array, M: csr_array, count: int) -> tuple[FloatArray, FloatArray]:
    """The same from full matrices, where many or all modes of a small model are requested."""
    if count == 0:
        return np.zeros(0), np.zeros((K.shape[0], 0))
    return eigh(K.toarray(), M.toarray(), subset_by_index=[0, count - 1])


def start_vector(n: int) -> FloatArray:
    """(n,) the fixed start vector: no symmetry of a mesh makes it miss a mode."""
    return np.random.default_rng(1).standard_normal(n)


_EQUAL_FREQUENCIES = (
    1e-6  # relative gap of omega^2 below which the directions of modes are arbitrary
)
_MAX_DEGREE = 3
_WAVES = np.array(  # wave vectors without symmetry, for modes that no polynomial distinguishes
    [[1.7, 2.3, 3.1], [4.3, -2.9, 1.3], [-2.1, 5.3, 3.7], [7.1, 3.3, -4.7]]
)
_WAVE_WEIGHT = 0.01  # weight of the waves against the polynomials


def polynomial_fields(fe: FEMatrices) -> FloatArray:
    """(n, f) fields of the position: each motion times monomials, and times waves.

    Falling weights settle which of two fields counts when a symmetric mode shape likes both.
    Rotations count as displacements at the distance of the body's size.
    """
    table, nodes = fe.numbering.table, fe.numbering.nodes
    s = fe.mesh.points[nodes] - fe.center
    size = np.abs(s).max()
    shapes = _scalar_fields(s / size)
    motions = range(6 if len(fe.numbering.rotating) else 3)
    fields = np.zeros((fe.numbering.n_all, len(motions) * len(shapes)))
    for k, shape in enumerate(shapes):
        for c in motions:
            column = len(motions) * k + c
            there = table[nodes, c] >= 0
            scale = 1.0 if c < 3 else 1.0 / size
            fields[table[nodes[there], c], column] = scale * shape[there] / (1 + 0.05 * column)
    return fields[: fe.numbering.n]


def _scalar_fields(s: FloatArray) -> list[FloatArray]:
    """Monomials of the position (k, 3), of degree one first, then waves."""
    monomials = [
        np.prod(s[:, powers], axis=1)
        for degree in range(1, _MAX_DEGREE + 1)
        for powers in combinations_with_replacement(range(3), degree)
    ]
    return monomials + [_WAVE_WEIGHT * np.cos(s @ wave + k) for k, wave in enumerate(_WAVES)]


def mode_signs(omega2: FloatArray, products: FloatArray) -> FloatArray:
    """(k, k) orthogonal matrix Q such that the modes V Q are unique.

    Parameters
    ----------
    omega2 : (k,) float
        Squared frequencies, ascending.
    products : (f, k) float
        Mass products of the polynomial fields with the modes.
    """
    k = len(omega2)
    rotation = np.zeros((k, k))
    gaps = np.diff(omega2) > _EQUAL_FREQUENCIES * omega2[1:]
    for cluster in np.split(np.arange(k), np.flatnonzero(gaps) + 1):
        if not len(cluster):
            continue
        Q, R, _ = qr(products[:, cluster].T, pivoting=True)
        signs = np.where(np.diag(R) < 0, -1.0, 1.0)
        rotation[np.ix_(cluster, cluster)] = Q * signs
    return rotation
