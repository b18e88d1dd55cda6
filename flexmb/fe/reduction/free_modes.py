"""Elastic modes of a body without interfaces.

In: a finite-element model. Out: its lowest elastic free modes as a :class:`CraigBampton` basis
without constraint modes, with the six rigid motions in front. K is singular, so it is solved with
six statically determinate degrees of freedom held and the loads relieved of their resultant: the
pseudo-inverse.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, qr

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.reduction.craig_bampton import SPATIAL, CraigBampton
from flexmb.fe.reduction.eigen import dense_modes, lowest_modes, start_vector
from flexmb.fe.reduction.planar import Mirror, symmetric_modes
from flexmb.fe.solver.linear_solver import factor
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.progress import Progress, silent

__all__ = ["free_modes"]

_DENSE = 300


def free_modes(
    fe: FEMatrices, modes: int, progress: Progress = silent, mirror: Mirror | None = None
) -> CraigBampton:
    """Six rigid motions and the lowest elastic modes of the free body.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    modes : int
        Number of elastic modes.
    progress : Progress
        Told the phases ``"order"``, ``"factor"`` and ``"modes"``.
    mirror : Mirror, optional
        Keep what is symmetric about its plane alone.

    Raises
    ------
    ReductionError
        More modes than the model has.
    """
    n, R = fe.numbering.n, fe.rigid
    if modes > n - 6:
        raise ReductionError(f"modes: {modes} asked, but the model has only {n - 6} elastic modes")

    def lowest(count: int) -> tuple[FloatArray, FloatArray]:
        if n <= _DENSE or 2 * count + 12 >= n:
            omega2, found = dense_modes(fe.K, fe.M, count + 6)
            return omega2[6:], found[:, 6:]
        return _sparse(fe, R, count, progress)

    directions = SPATIAL if mirror is None else mirror.directions
    if mirror is None:
        _, V = lowest(modes)
    else:
        V = symmetric_modes(mirror.S, fe.M, lowest, modes, n - 6)[1][:, :modes]
        R = R[:, directions]
    R_M = fe.M @ R
    V = V - R @ np.linalg.solve(R.T @ R_M, R_M.T @ V)
    progress("modes", 1.0)
    basis = np.concatenate([R, V], axis=1)
    M = basis.T @ (fe.M @ basis)
    rigid = R.shape[1]
    K = block_diag(np.zeros((rigid, rigid)), V.T @ (fe.K @ V))
    labels = tuple(f"free {k + 1}" for k in range(modes))
    labels = ("rigid",) * rigid + labels
    return CraigBampton(basis, 0.5 * (K + K.T), 0.5 * (M + M.T), (), labels, directions)


def _sparse(
    fe: FEMatrices, R: FloatArray, modes: int, progress: Progress
) -> tuple[FloatArray, FloatArray]:
    held = _determinate(R)
    left = np.setdiff1d(np.arange(fe.numbering.n), held)
    inner = factor(fe.K[left][:, left], fe.dof_points[left], progress)
    R_M = fe.M @ R
    gram = cho_factor(R.T @ R_M)

    def relieved(f: FloatArray) -> FloatArray:
        f = f - R_M @ cho_solve(gram, R.T @ f)
        u = np.zeros_like(f)
        u[left] = inner.solve(f[left])
        return u - R @ cho_solve(gram, R_M.T @ u)

    return lowest_modes(fe.M, relieved, modes, progress, relieved(start_vector(len(R))))


def _determinate(R: FloatArray) -> IntArray:
    """Six degrees of freedom that hold all rigid motions, well spread (pivoted elimination)."""
    scaled = R / np.abs(R).max(axis=0)
    return np.sort(qr(scaled.T, mode="r", pivoting=True)[1][:6])
