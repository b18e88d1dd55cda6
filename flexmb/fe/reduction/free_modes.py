"""Elastic modes of a body without interfaces.

In: a finite-element model. Out: its lowest elastic free modes, with the rigid motions in front and
the residual vectors of loads behind. K is singular, so it is solved with six statically determinate
degrees of freedom held and the loads relieved of their resultant: the pseudo-inverse.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.interfaces.make import ModelInterface
from flexmb.fe.reduction.basis import ReducedBasis, directions_of
from flexmb.fe.reduction.bordered import determinate
from flexmb.fe.reduction.canonical import canonical_rotation, polynomial_fields
from flexmb.fe.reduction.choice import ModeChoice, ModesLike, mode_choice
from flexmb.fe.reduction.eigen import dense_modes, lowest_modes, start_vector
from flexmb.fe.reduction.free_interface import free_basis
from flexmb.fe.reduction.loose import loose_part
from flexmb.fe.reduction.planar import Mirror, symmetric_modes
from flexmb.fe.reduction.relief import Relief
from flexmb.fe.reduction.residual import deforming, load_columns, residual_vectors
from flexmb.fe.solver.linear_solver import factor
from flexmb.fe.solver.singular import SingularMatrix
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

__all__ = ["free_modes", "lowest_free", "relieved_inverse"]

_DENSE = 300
_SPARE = 2  # modes computed beyond those asked, so that no pair of equal frequency is cut blindly
_FIRST = 20

Modes = tuple[FloatArray, FloatArray]


def free_modes(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...] = (),
    modes: ModesLike | ModeChoice = 20,
    progress: Progress = silent,
    mirror: Mirror | None = None,
    loads: tuple[LoadPattern, ...] = (),
) -> ReducedBasis:
    """Six rigid motions and the lowest elastic modes of the free body.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple
        None: this is for bodies without.
    modes : int, mapping or ModeChoice
        Elastic modes: so many, or all below ``{"frequency": f}`` [Hz].
    progress : Progress
        Told the phases ``"order"``, ``"factor"`` and ``"modes"``.
    mirror : Mirror, optional
        Keep what is symmetric about its plane alone.
    loads : tuple of LoadPattern
        Loads of the body; those with ``residual`` add their static responses.

    Raises
    ------
    ReductionError
        More modes than the model has, or a share of interface mass, which needs interfaces.
    """
    choice = mode_choice(modes)
    if interfaces or choice.effective_mass is not None:
        raise ReductionError("modes.effective_mass: the body has no interfaces; give a count")
    whole = Relief(fe.M, fe.rigid)
    static: list[Callable[[FloatArray], FloatArray]] = []

    def inverse(f: FloatArray) -> FloatArray:
        if not static:
            static.append(relieved_inverse(fe, whole, progress))
        return static[0](f)

    omega2, V = _chosen(fe, inverse, choice, mirror, progress)
    directions = directions_of(mirror)
    relief = Relief(fe.M, fe.rigid[:, directions])
    V = relief.fields(V)
    F = load_columns(fe, loads)
    responses = deforming(fe, relief.fields(inverse(F)), F) if F.shape[1] else F
    progress("modes", 1.0)
    residual = residual_vectors(fe, responses, V)
    return free_basis(fe, (), directions, (omega2, V), residual, loads)


def relieved_inverse(
    fe: FEMatrices, relief: Relief, progress: Progress
) -> Callable[[FloatArray], FloatArray]:
    """Deformation of the free body, about mean axes, under loads (n, ...): the pseudo-inverse."""
    left = np.setdiff1d(np.arange(fe.numbering.n), determinate(fe.rigid))
    try:
        inner = factor(fe.K[left][:, left], fe.dof_points[left], progress)
    except SingularMatrix as error:
        raise ReductionError(loose_part(fe, left[error.dofs])) from error

    def inverse(f: FloatArray) -> FloatArray:
        u = np.zeros_like(f)
        u[left] = inner.solve(relief.loads(f)[left])
        return relief.fields(u)

    return inverse


def _chosen(
    fe: FEMatrices,
    inverse: Callable[[FloatArray], FloatArray],
    choice: ModeChoice,
    mirror: Mirror | None,
    progress: Progress,
) -> Modes:
    limit = fe.numbering.n - 6
    count = _FIRST if choice.count is None else choice.count
    while True:
        omega2, V = lowest_free(fe, inverse, count, mirror, progress)
        complete = len(omega2) < count or count >= limit
        if choice.count is not None:
            if choice.count > len(omega2):
                where = "" if mirror is None else " in the plane"
                what = f"the model has only {len(omega2)} elastic modes{where}"
                raise ReductionError(f"modes: {choice.count} asked, but {what}")
            return omega2[:count], V[:, :count]
        below = int(np.searchsorted(omega2, (2 * np.pi * choice.frequency) ** 2))
        if complete or below < len(omega2):
            return omega2[:below], V[:, :below]
        count *= 2


def lowest_free(
    fe: FEMatrices,
    inverse: Callable[[FloatArray], FloatArray],
    count: int,
    mirror: Mirror | None,
    progress: Progress,
) -> Modes:
    """At least ``count`` elastic modes of the free model, or all, unique in direction."""
    n, limit = fe.numbering.n, fe.numbering.n - 6
    if count == 0:
        return np.zeros(0), np.zeros((n, 0))

    def lowest(number: int) -> Modes:
        number = min(number, limit)
        if n <= _DENSE or 2 * number + 12 >= n:
            omega2, found = dense_modes(fe.K, fe.M, number + 6)
            return omega2[6:], found[:, 6:]
        return lowest_modes(fe.M, inverse, number, progress, inverse(start_vector(n)))

    if mirror is None:
        omega2, V = lowest(count + _SPARE)
    else:
        omega2, V = symmetric_modes(mirror.S, fe.M, lowest, count, limit)
    return omega2, V @ canonical_rotation(omega2, polynomial_fields(fe).T @ (fe.M @ V))
