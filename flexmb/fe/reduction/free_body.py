"""Reduction of a body without interfaces: its own free modes.

K is singular. It is solved with six statically determinate degrees of freedom fixed, for loads
minus their resultant (inertia relief): this is the pseudo-inverse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.linear_solver import SingularMatrix, factor
from flexmb.fe.reduction.component_modes import (
    DENSE,
    distinct_modes,
    free_basis,
    mode_noun,
    omitted_modes_of,
)
from flexmb.fe.reduction.eigenmodes import (
    Modes,
    SymmetryPlane,
    dense_modes,
    lowest_modes,
    start_vector,
)
from flexmb.fe.reduction.fixed_interface import (
    ModesLike,
    read_modes,
    select_modes,
    statically_determinate,
)
from flexmb.fe.reduction.inertia_relief import (
    InertiaRelief,
    deforming_responses,
    inertia_loads,
    load_columns,
    residual_kind,
)
from flexmb.fe.reduction.reduced_basis import FREE_HINGE, ReducedBasis, directions_of
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.mesh_options import ModesOptions
from flexmb.progress import Progress, silent


def free_modes(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...] = (),
    modes: ModesLike | ModesOptions = 20,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
    residual: str = "none",
) -> ReducedBasis:
    """Six rigid motions and the lowest elastic modes of the free body.

    Parameters
    ----------
    fe, progress, mirror, loads, residual
        As for :func:`flexmb.fe.craig_bampton`.
    interfaces : tuple
        Empty: this method is for bodies without interfaces.
    modes : int, mapping or ModesOptions
        Elastic modes: so many, or all below ``{"frequency": f}`` [Hz].

    Raises
    ------
    ReductionError
        More modes than the model has, or a share of interface mass, which needs interfaces.
    """
    selection = read_modes(modes)
    if interfaces or selection.effective_mass is not None:
        raise ReductionError("modes.effective_mass: the body has no interfaces; give a count")
    whole = InertiaRelief(fe.M, fe.rigid)
    static: list[Callable[[FloatArray], FloatArray]] = []

    def inverse(f: FloatArray) -> FloatArray:
        if not static:
            static.append(relieved_inverse(fe, whole, progress))
        return static[0](f)

    omega2, V, rows = select_modes(
        selection,
        lambda count: lowest_free(fe, inverse, count, mirror, progress),
        fe.numbering.n - 6,
        mode_noun("elastic modes", mirror),
    )
    omega2, V, omitted = omega2[rows], V[:, rows], omitted_modes_of(V, rows)
    directions = directions_of(mirror)
    relief = InertiaRelief(fe.M, fe.rigid[:, directions])
    V, omitted = relief.fields(V), relief.fields(omitted)
    F = load_columns(fe, loads)
    responses = deforming_responses(fe, relief.fields(inverse(F)), F) if F.shape[1] else F
    inertia = inverse(inertia_loads(fe, mirror, rigid=False))
    progress("modes", 1.0)

    def basis_with(residual: str) -> ReducedBasis:
        modes, answers, kind = (omega2, V), (inertia, omitted, None), residual_kind(loads, residual)
        basis = free_basis(
            fe, (), mirror, modes, responses, loads, answers, kind, residual, relief
        )  # fmt: skip
        return replace(basis, with_inertia=partial(basis_with, "inertia"))

    return basis_with(residual)


def relieved_inverse(
    fe: FEMatrices, relief: InertiaRelief, progress: Progress
) -> Callable[[FloatArray], FloatArray]:
    """The pseudo-inverse: loads (n, ...) to the deformation of the free body about its mean
    axes."""
    left = np.setdiff1d(np.arange(fe.numbering.n), statically_determinate(fe.rigid))
    try:
        inner = factor(fe.K[left][:, left], fe.dof_points[left], progress)
    except SingularMatrix as error:
        raise ReductionError(FREE_HINGE) from error

    def inverse(f: FloatArray) -> FloatArray:
        u = np.zeros_like(f)
        u[left] = inner.solve(relief.loads(f)[left])
        return relief.fields(u)

    return inverse


def dense_free_modes(K: FloatArray, M: FloatArray, rigid: FloatArray, count: int) -> Modes:
    """The lowest elastic modes from full matrices (n, n) of a model with rigid motions (n, r).

    As many degrees of freedom are fixed; the rigid motion is then removed mass-orthogonally.
    """
    left = np.setdiff1d(np.arange(len(K)), statically_determinate(rigid))
    fields = InertiaRelief(M, rigid).fields(np.eye(len(K))[:, left])
    omega2, y = dense_modes(K[np.ix_(left, left)], fields.T @ M @ fields, count)
    return omega2, fields @ y


def lowest_free(
    fe: FEMatrices,
    inverse: Callable[[FloatArray], FloatArray],
    count: int,
    mirror: SymmetryPlane | None,
    progress: Progress,
) -> Modes:
    """At least ``count`` elastic modes of the free model, or all, unique in sign and direction."""
    n = fe.numbering.n

    def lowest(number: int) -> Modes:
        if n <= DENSE or 2 * number + 12 >= n:
            inverse(fe.rigid[:, 0])  # raises if a part can move by itself
            return dense_free_modes(fe.K.toarray(), fe.M.toarray(), fe.rigid, number)
        return lowest_modes(fe.M, inverse, number, progress, inverse(start_vector(n)))

    return distinct_modes(fe, fe.M, lowest, count, n - 6, mirror)
