"""Component mode synthesis: fixed-interface (Craig-Bampton, Guyan) and free-interface reduction.

In: a finite-element model, its interfaces, which modes. Out: a :class:`ReducedBasis`.

The Craig-Bampton basis has constraint modes (unit motions of the interfaces), fixed-interface modes
and residual vectors of loads. Constraint modes are K-orthogonal to all that leaves the interfaces
at rest, so the reduced stiffness is block diagonal: the static stiffness of the interfaces, then
the squared frequencies. Without modes it is static (Guyan) reduction. Sources: Craig, Bampton
(1968), AIAA Journal 6(7); Guyan (1965), AIAA Journal 3(2).

The free-interface basis has the rigid motions, the lowest elastic modes of the free body, and
residual attachment modes: the static responses of the free body to unit forces and moments at the
interfaces, minus what the retained modes contain of them. The response to any load at an interface
is exact in the static limit, and the residual vectors keep their mass (MacNeal leaves it out).
Without interfaces K is singular. It is then solved with six statically determinate degrees of
freedom fixed, for loads minus their resultant (inertia relief): this is the pseudo-inverse.
Sources: MacNeal (1971), Computers and Structures 1; Rubin (1975), AIAA Journal 13(8); Craig, Chang
(1977), AIAA/ASME 18th SDM conference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag, eigh
from scipy.sparse import csr_array

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.eigenmodes import (
    Modes,
    SymmetryPlane,
    lowest_modes,
    mode_signs,
    polynomial_fields,
    start_vector,
    symmetric_modes,
)
from flexmb.fe.reduction.fixed_interface import (
    FixedInterfaceModel,
    ModesLike,
    interface_shares,
    read_modes,
    select_modes,
)
from flexmb.fe.reduction.inertia_relief import (
    InertiaRelief,
    fixed_interface_responses,
    free_body_responses,
    inertia_loads,
    inertia_responses,
    load_columns,
    residual_kind,
    residual_vectors,
    with_residual_vectors,
)
from flexmb.fe.reduction.reduced_basis import (
    FixedResponse,
    ReducedBasis,
    directions_of,
    interface_labels,
    rigid_motion_of_interfaces,
)
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.mesh_options import ModesOptions
from flexmb.progress import Progress, silent

# modes computed beyond those requested, so that no pair of equal frequencies is cut, not even that
# of the first mode that is left out
_EXTRA_MODES = 4
# number of omitted modes stored with the body, from which a run estimates their effect
_MAX_OMITTED = 4


def craig_bampton(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    modes: ModesLike | ModesOptions = 20,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
    residual: str = "none",
) -> ReducedBasis:
    """Reduce a model with at least one interface.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple of RigidInterface or WeightedInterface
        The interfaces to be held fixed; at least one.
    modes : int, mapping or ModesOptions
        Fixed-interface modes: so many, all below ``{"frequency": f}`` [Hz], or the fewest with a
        share ``{"effective_mass": s}`` of the effective interface mass.
    progress : Progress
        Called with the phases ``"factor"`` and ``"modes"``.
    mirror : SymmetryPlane, optional
        Retain only modes that are symmetric about its plane.
    loads : tuple of LoadPattern
        Loads of the body; those with ``residual`` add their static responses to the basis.
    residual : str
        ``"inertia"`` adds the static responses to the body's own inertia loads.

    Raises
    ------
    ReductionError
        More modes than the model has, or a part that is not supported with the interfaces fixed.
    """
    selection = read_modes(modes)
    directions = directions_of(mirror)
    fixed = FixedInterfaceModel(fe, interfaces, directions, progress)

    def lowest(count: int) -> Modes:
        inside = lambda number: fixed.lowest(number, progress)  # noqa: E731
        return distinct_modes(fe, fixed.M, inside, count, fixed.count, mirror, fixed.dofs)

    omega2, inner, numbers = select_modes(
        selection,
        lowest,
        fixed.count,
        mode_noun("fixed-interface modes", mirror),
        lambda modes: interface_shares(fixed, modes),
    )
    if not len(omega2) and fixed.count:
        # one mode for `omitted`, from which a run estimates what it would do
        omega2, inner = lowest(1)
    left = np.setdiff1d(np.arange(len(omega2)), numbers)[:_MAX_OMITTED]
    omitted = np.zeros((fe.numbering.n, len(left)))
    omitted[fixed.dofs] = inner[:, left]
    omega2, V = omega2[numbers], np.zeros((fe.numbering.n, len(numbers)))
    V[fixed.dofs] = inner[:, numbers]
    relief = InertiaRelief(fe.M, fe.rigid[:, directions])
    inertia = fixed.solve(inertia_loads(fe, mirror))
    static = fixed_interface_responses(fixed, relief, loads)
    progress("modes", 1.0)

    def basis_with(residual: str) -> ReducedBasis:
        responses, without = static, None
        if residual == "inertia":
            without = with_residual_vectors(fe, (omega2, V), static)
            responses = np.concatenate([static, inertia_responses(fe, inertia, mirror)], axis=1)
        stiff, U = residual_vectors(fe, responses, V)
        swings = [fixed.solve(fe.M @ fixed.modes), V / omega2, fixed.solve(fe.M @ U)]
        kind = residual_kind(loads, residual)
        basis = np.concatenate([fixed.modes, V, U], axis=1)
        M = basis.T @ (fe.M @ basis)
        c, k = fixed.modes.shape[1], basis.shape[1]
        rigid, motion = np.zeros((k, len(directions))), np.zeros((len(interfaces), 6, k))
        rigid[:c] = rigid_motion_of_interfaces(fe, interfaces, directions)
        motion[:, directions, :c] = np.eye(c).reshape(len(interfaces), len(directions), c)
        names = (
            *interface_labels(interfaces, directions),
            *(f"fixed-interface {number + 1}" for number in numbers),
            *(f"{kind} residual {number + 1}" for number in range(len(stiff))),
        )
        kinds = ("constraint",) * c + ("fixed-interface",) * len(omega2) + (kind,) * len(stiff)
        K = block_diag(fixed.K_modes, np.diag(omega2), np.diag(stiff))
        return ReducedBasis(
            basis, K, 0.5 * (M + M.T), rigid, motion, interfaces, names, kinds, directions, loads,
            inertia, without, omitted, fixed.solve, np.concatenate(swings, axis=1),
            with_inertia=partial(basis_with, "inertia"),
        )  # fmt: skip

    return basis_with(residual)


def guyan(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    modes: ModesLike | ModesOptions = 0,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
    residual: str = "none",
) -> ReducedBasis:
    """Static reduction: the constraint modes alone; arguments as for :func:`craig_bampton`.

    Raises
    ------
    ReductionError
        Modes are requested, or a part that is not supported.
    """
    if read_modes(modes) != ModesOptions(count=0):
        raise ReductionError('modes: a static reduction ("guyan") has none; leave them out, or 0')
    return craig_bampton(fe, interfaces, 0, progress, mirror, loads, residual)


def distinct_modes(
    fe: FEMatrices,
    M: csr_array,
    lowest: Callable[[int], Modes],
    count: int,
    limit: int,
    mirror: SymmetryPlane | None,
    dofs: IntArray | None = None,
) -> Modes:
    """At least ``count`` modes, or all, unique in sign and direction; symmetric ones for a mirror.

    M is the mass matrix over ``dofs``, by default over all. ``lowest`` computes a number of modes,
    at most ``limit``.
    """
    if count == 0:
        return np.zeros(0), np.zeros((M.shape[0], 0))
    if mirror is None:
        omega2, V = lowest(min(count + _EXTRA_MODES, limit))
    else:
        S = mirror.S if dofs is None else mirror.on(dofs)
        omega2, V = symmetric_modes(S, M, lowest, count, limit)
    fields = polynomial_fields(fe)
    fields = fields if dofs is None else fields[dofs]
    return omega2, V @ mode_signs(omega2, fields.T @ (M @ V))


DENSE = 300  # number of degrees of freedom up to which full matrices are faster


def free_interface(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    modes: ModesLike | ModesOptions = 20,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
    residual: str = "none",
) -> ReducedBasis:
    """Reduce a model with at least one interface; the body has modes + residual coordinates.

    Parameters
    ----------
    fe, interfaces, progress, mirror, loads, residual
        As for :func:`flexmb.fe.craig_bampton`.
    modes : int, mapping or ModesOptions
        Elastic modes of the free body: so many, or all below ``{"frequency": f}`` [Hz].

    Raises
    ------
    ReductionError
        More modes than the model has, or a part that nothing holds.
    """
    selection = read_modes(modes)
    if selection.effective_mass is not None:
        what = "goes with fixed-interface modes; give a count or a frequency"
        raise ReductionError(f"modes.effective_mass: {what}")
    directions = directions_of(mirror)
    fixed = FixedInterfaceModel(fe, interfaces, directions, progress)
    relief = InertiaRelief(fe.M, fe.rigid[:, directions])
    omega2, V, rows = select_modes(
        selection,
        lambda count: free_modes_of(fixed, relief, count, mirror, progress),
        free_count(fixed),
        mode_noun("elastic modes", mirror),
    )
    omega2, V, omitted = omega2[rows], V[:, rows], omitted_modes_of(V, rows)
    F = np.concatenate([fixed.loads(), load_columns(fe, loads)], axis=1)
    inertia = fixed.solve(inertia_loads(fe, mirror))
    responses = free_body_responses(fixed, relief, F)
    progress("modes", 1.0)

    def basis_with(residual: str) -> ReducedBasis:
        modes, answers = (omega2, V), (inertia, omitted, fixed.solve)
        basis = free_basis(
            fe, interfaces, mirror, modes, responses, loads, answers, "attachment",
            residual, relief,
        )  # fmt: skip
        accelerations = fixed.solve(fe.M @ basis.basis)
        return replace(
            basis, accelerations=accelerations, with_inertia=partial(basis_with, "inertia")
        )

    return basis_with(residual)


def free_basis(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    mirror: SymmetryPlane | None,
    modes: Modes,
    responses: FloatArray,
    loads: tuple[LoadPattern, ...],
    answers: tuple[FloatArray, FloatArray, FixedResponse | None],
    kind: str,
    residual: str,
    relief: InertiaRelief,
) -> ReducedBasis:
    """The basis of the rigid motions, free modes and residual vectors of responses to loads.

    `answers` are the static responses to inertia loads, the omitted modes, and the static response
    with fixed interfaces. ``residual = "inertia"`` adds residual vectors of inertia loads.
    """
    inertia, omitted, fixed_response = answers
    directions, without = directions_of(mirror), None
    if residual == "inertia":
        without = with_residual_vectors(fe, modes, responses)
        further = inertia_responses(fe, relief.fields(inertia), mirror)
        responses = np.concatenate([responses, further], axis=1)
    stiff, U = residual_vectors(fe, responses, modes[1])
    R = fe.rigid[:, directions]
    basis = np.concatenate([R, modes[1], U], axis=1)
    M = basis.T @ (fe.M @ basis)
    # not omega^2, so that a motion without stiffness is detected
    K = modes[1].T @ (fe.K @ modes[1])
    r, m, k = R.shape[1], len(modes[0]), len(stiff)
    motion = np.zeros((len(interfaces), 6, r + m + k))
    for number, interface in enumerate(interfaces):
        motion[number, directions] = interface.motion(basis)[list(directions)]
    name = "residual attachment" if interfaces else f"{kind} residual"
    return ReducedBasis(
        basis,
        block_diag(np.zeros((r, r)), 0.5 * (K + K.T), np.diag(stiff)),
        0.5 * (M + M.T),
        np.eye(r + m + k)[:, :r],
        motion,
        interfaces,
        ("rigid",) * r
        + tuple(f"free {number + 1}" for number in range(m))
        + tuple(f"{name} {number + 1}" for number in range(k)),
        ("rigid",) * r + ("free",) * m + (kind,) * k,
        directions,
        loads,
        inertia,
        without,
        omitted,
        fixed_response,
    )


def omitted_modes_of(V: FloatArray, rows: IntArray) -> FloatArray:
    """(n, o) the lowest of the modes V (n, k) that are not among the retained ``rows``."""
    return V[:, np.setdiff1d(np.arange(V.shape[1]), rows)[:_MAX_OMITTED]]


def free_modes_of(
    fixed: FixedInterfaceModel,
    relief: InertiaRelief,
    count: int,
    mirror: SymmetryPlane | None = None,
    progress: Progress = silent,
) -> Modes:
    """At least ``count`` elastic modes of the free tied model, or all, unique in sign and
    direction.

    Parameters
    ----------
    fixed, relief
        The model with its interfaces held, and its inertia relief.
    count : int
        How many.
    mirror : SymmetryPlane, optional
        Only symmetric ones.
    progress : Progress
        Called with the phase ``"modes"``.
    """
    fe, limit = fixed.fe, free_count(fixed)

    def static(f: FloatArray) -> FloatArray:
        return relief.fields(fixed.free(relief.loads(f)))

    def lowest(number: int) -> Modes:
        if fe.numbering.n <= DENSE or 2 * number + 12 >= limit:
            omega2, V = _dense(fixed, number)
        else:
            start = static(start_vector(fe.numbering.n))
            omega2, V = lowest_modes(fe.M, static, number, progress, start)
        return omega2, relief.fields(V)

    return distinct_modes(fe, fe.M, lowest, count, limit, mirror)


def free_count(fixed: FixedInterfaceModel) -> int:
    """Number of elastic modes of the free tied model."""
    return fixed.modes.shape[1] + fixed.count - len(fixed.directions)


def mode_noun(modes: str, mirror: SymmetryPlane | None) -> str:
    return modes + (" in the plane" if mirror is not None else "")


def _dense(fixed: FixedInterfaceModel, count: int) -> Modes:
    fields, fe = fixed.fields(), fixed.fe
    K, M = fields.T @ (fe.K @ fields), fields.T @ (fe.M @ fields)
    rigid = len(fixed.directions)
    omega2, W = eigh(0.5 * (K + K.T), 0.5 * (M + M.T), subset_by_index=[0, count + rigid - 1])
    return omega2[rigid:], fields @ W[:, rigid:]
