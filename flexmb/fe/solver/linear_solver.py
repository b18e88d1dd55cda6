"""Solving with a sparse symmetric positive definite matrix, behind one small interface.

In: a stiffness matrix, and where its unknowns are. Out: a :class:`Factor` that solves for one or
many right sides. Small models go to SuperLU, large ones to a multifrontal Cholesky factorisation
on BLAS with nested dissection, or to PARDISO if that is installed. A matrix that leaves a motion
free is refused with the part that moves, and one whose factors do not fit into memory before they
are computed. Elimination without pivoting is stable here: residuals are at rounding of |K| |x|, so
that a step of refinement (tried) changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from scipy.sparse import csr_array, diags_array

from flexmb.errors import ReductionError
from flexmb.fe.solver.dissection import dissect
from flexmb.fe.solver.graph import matrix_graph
from flexmb.fe.solver.memory import require_memory
from flexmb.fe.solver.multifrontal import Multifrontal
from flexmb.fe.solver.pardiso import FOUND, Pardiso
from flexmb.fe.solver.singular import (
    SHIFT,
    NotPositive,
    free_part,
    require_stiff,
    softest,
    stiffness_scale,
)
from flexmb.fe.solver.superlu import SuperLU
from flexmb.fe.solver.symbolic import Fronts, fronts
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

__all__ = ["Factor", "factor"]

_SMALL = 5000  # unknowns up to which SuperLU is as fast


class Factor(Protocol):
    """A factorised matrix."""

    nnz: int  # entries of the factors

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        ...


Compute = Callable[[csr_array], Factor]


def factor(K: csr_array, points: FloatArray | None = None, progress: Progress = silent) -> Factor:
    """Factorise a sparse symmetric positive definite matrix.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness, both triangles.
    points : (n, 3) float, optional
        Position of the node of each unknown: a better order of elimination, and errors that say
        where.
    progress : Progress
        Told the phases ``"order"`` and ``"factor"``.

    Raises
    ------
    SingularMatrix
        A part of the model moves freely: it is held neither by elements nor by an interface.
    ReductionError
        The matrix is not positive definite, or its factors do not fit into memory.
    """
    K = _canonical(K)
    scale = stiffness_scale(K)
    if K.shape[0] <= _SMALL:
        compute = _small(scale)
    else:
        compute = _pardiso(progress) if FOUND else _large(K, points, progress)
    found = None
    with suppress(NotPositive):  # left behind at once, with all the memory its traceback holds
        found = compute(K)
    if found is None:
        raise _why(K, compute, points)
    require_stiff(K, found.solve, points)
    progress("factor", 1.0)
    return found


def _canonical(K: csr_array) -> csr_array:
    """The matrix with one entry for each place."""
    K = csr_array(K)
    if not K.has_canonical_format:
        K = K.copy()
        K.sum_duplicates()
    return K


def _small(scale: FloatArray) -> Compute:
    return lambda matrix: SuperLU(matrix, scale)


def _pardiso(progress: Progress) -> Compute:
    return lambda matrix: Pardiso(matrix, progress)


def _large(K: csr_array, points: FloatArray | None, progress: Progress) -> Compute:
    plan = _plan(K, points, progress)
    return lambda matrix: Multifrontal(matrix, plan, progress)


def _plan(K: csr_array, points: FloatArray | None, progress: Progress) -> Fronts:
    progress("order", 0.0, f"{K.shape[0]} unknowns")
    graph = matrix_graph(K, points)
    progress("order", 0.4)
    plan = fronts(graph, dissect(graph))
    progress("order", 1.0)
    what = f"the factorisation of {K.shape[0]} unknowns ({plan.nnz:.2g} entries)"
    require_memory(plan.memory, what)
    return plan


def _why(K: csr_array, compute: Compute, points: FloatArray | None) -> ReductionError:
    """What a matrix without factors lacks: a little stiffness everywhere makes free parts move."""
    try:
        shifted = compute(K + SHIFT * diags_array(K.diagonal()))
    except NotPositive as worse:
        return ReductionError(f"the stiffness matrix is not positive definite{_at(worse, points)}")
    return free_part(K, softest(K, shifted.solve, 4)[1], points)


def _at(error: NotPositive, points: FloatArray | None) -> str:
    if error.index < 0:
        return ""
    what = f": degree of freedom {error.index}"
    if points is not None:
        what += f" at ({', '.join(f'{value:.4g}' for value in points[error.index])}) m"
    return f"{what} has a negative stiffness"
