"""Free-interface reduction: free elastic modes and what they leave out of the interfaces' response.

In: a finite-element model, its interfaces, which free modes. Out: a basis of the rigid motions, the
lowest elastic modes of the free body, and residual attachment modes: the static responses of the
free body to unit forces and moments at the interfaces, less the part of the kept modes. Response
to any load at an interface is exact in the static limit, and the residual vectors keep their mass
(MacNeal leaves it out). Sources: MacNeal (1971), Computers and Structures 1; Rubin (1975), AIAA
Journal 13(8); Craig, Chang (1977), AIAA/ASME 18th SDM conference.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag, eigh

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.interfaces.make import ModelInterface
from flexmb.fe.reduction.basis import ReducedBasis, directions_of
from flexmb.fe.reduction.canonical import canonical_rotation, polynomial_fields
from flexmb.fe.reduction.choice import ModeChoice, ModesLike, mode_choice
from flexmb.fe.reduction.eigen import lowest_modes, start_vector
from flexmb.fe.reduction.held import Held
from flexmb.fe.reduction.planar import Mirror, symmetric_modes
from flexmb.fe.reduction.relief import Relief
from flexmb.fe.reduction.residual import load_columns, relieved_responses, residual_vectors
from flexmb.flexbody.arrays import FloatArray
from flexmb.progress import Progress, silent

__all__ = ["free_interface", "free_modes_of"]

_DENSE = 300
_SPARE = 2
_FIRST = 20


def free_interface(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    modes: ModesLike | ModeChoice = 20,
    progress: Progress = silent,
    mirror: Mirror | None = None,
    loads: tuple[LoadPattern, ...] = (),
) -> ReducedBasis:
    """Reduce a model with at least one interface; the body has modes + residual coordinates.

    Parameters
    ----------
    fe, interfaces, progress, mirror, loads
        As for :func:`flexmb.fe.craig_bampton`.
    modes : int, mapping or ModeChoice
        Elastic modes of the free body: so many, or all below ``{"frequency": f}`` [Hz].

    Raises
    ------
    ReductionError
        More modes than the model has, or a part that nothing holds.
    """
    choice = mode_choice(modes)
    if choice.effective_mass is not None:
        what = "goes with fixed-interface modes; give a count or a frequency"
        raise ReductionError(f"modes.effective_mass: {what}")
    directions = directions_of(mirror)
    held = Held(fe, interfaces, directions, progress)
    relief = Relief(fe.M, fe.rigid[:, directions])
    omega2, V = _chosen(held, relief, choice, mirror, progress)
    F = np.concatenate([held.loads(), load_columns(fe, loads)], axis=1)
    stiff, U = residual_vectors(fe, relieved_responses(held, relief, F), V)
    progress("modes", 1.0)
    return free_basis(fe, interfaces, directions, (omega2, V), (stiff, U), loads)


def free_basis(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    directions: tuple[int, ...],
    modes: tuple[FloatArray, FloatArray],
    residual: tuple[FloatArray, FloatArray],
    loads: tuple[LoadPattern, ...],
) -> ReducedBasis:
    """The basis of rigid motions, free modes and residual vectors, of interfaces or else loads."""
    R = fe.rigid[:, directions]
    basis = np.concatenate([R, modes[1], residual[1]], axis=1)
    M = basis.T @ (fe.M @ basis)
    K = modes[1].T @ (fe.K @ modes[1])  # not omega^2: a motion without stiffness shall be seen
    r, m, k = R.shape[1], len(modes[0]), len(residual[0])
    motion = np.zeros((len(interfaces), 6, r + m + k))
    for number, interface in enumerate(interfaces):
        motion[number, directions] = interface.motion(basis)[list(directions)]
    kind, name = ("attachment", "residual attachment") if interfaces else ("load", "load residual")
    return ReducedBasis(
        basis,
        block_diag(np.zeros((r, r)), 0.5 * (K + K.T), np.diag(residual[0])),
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
    )


def free_modes_of(
    held: Held,
    relief: Relief,
    count: int,
    mirror: Mirror | None = None,
    progress: Progress = silent,
) -> tuple[FloatArray, FloatArray]:
    """At least ``count`` elastic modes of the free tied model, or all, unique in direction.

    Parameters
    ----------
    held, relief
        The model with its interfaces held, and its inertia relief.
    count : int
        How many.
    mirror : Mirror, optional
        Only symmetric ones.
    progress : Progress
        Told the phase ``"modes"``.
    """
    fe, limit = held.fe, free_count(held)
    if count == 0:
        return np.zeros(0), np.zeros((fe.numbering.n, 0))

    def lowest(number: int) -> tuple[FloatArray, FloatArray]:
        number = min(number, limit)
        if fe.numbering.n <= _DENSE or 2 * number + 12 >= limit:
            return _dense(held, number)

        def static(f: FloatArray) -> FloatArray:
            return relief.fields(held.free(relief.loads(f)))

        return lowest_modes(fe.M, static, number, progress, static(start_vector(fe.numbering.n)))

    if mirror is None:
        omega2, V = lowest(count + _SPARE)
    else:
        omega2, V = symmetric_modes(mirror.S, fe.M, lowest, count, limit)
    V = relief.fields(V)
    return omega2, V @ canonical_rotation(omega2, polynomial_fields(fe).T @ (fe.M @ V))


def free_count(held: Held) -> int:
    """How many elastic modes the free tied model has."""
    return held.modes.shape[1] + held.count - len(held.directions)


def _chosen(
    held: Held, relief: Relief, choice: ModeChoice, mirror: Mirror | None, progress: Progress
) -> tuple[FloatArray, FloatArray]:
    if choice.count is not None:
        omega2, V = free_modes_of(held, relief, choice.count, mirror, progress)
        if choice.count > len(omega2):
            where = "" if mirror is None else " in the plane"
            what = f"the model has only {len(omega2)} elastic modes{where}"
            raise ReductionError(f"modes: {choice.count} asked, but {what}")
        return omega2[: choice.count], V[:, : choice.count]
    count = _FIRST
    while True:
        omega2, V = free_modes_of(held, relief, count, mirror, progress)
        below = int(np.searchsorted(omega2, (2 * np.pi * choice.frequency) ** 2))
        if below < len(omega2) or len(omega2) < count or count >= free_count(held):
            return omega2[:below], V[:, :below]
        count *= 2


def _dense(held: Held, count: int) -> tuple[FloatArray, FloatArray]:
    fields, fe = held.fields(), held.fe
    K, M = fields.T @ (fe.K @ fields), fields.T @ (fe.M @ fields)
    rigid = len(held.directions)
    omega2, W = eigh(0.5 * (K + K.T), 0.5 * (M + M.T), subset_by_index=[0, count + rigid - 1])
    return omega2[rigid:], fields @ W[:, rigid:]
