"""Craig-Bampton reduction: unit motions of the interfaces and modes with the interfaces held.

In: a finite-element model, its interfaces, which fixed-interface modes. Out: a basis of constraint
modes, fixed-interface modes and residual vectors of loads. Constraint modes are K-orthogonal to all
that leaves the interfaces at rest, so the reduced stiffness is block diagonal: the static stiffness
of the interfaces, then the squared frequencies. Without modes it is static (Guyan) reduction.
Sources: Craig, Bampton (1968), AIAA Journal 6(7); Guyan (1965), AIAA Journal 3(2).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.eigenmodes import mode_signs, polynomial_fields
from flexmb.fe.reduction.fixed_interface import (
    FixedInterfaceModel,
    ModesLike,
    interface_shares,
    read_modes,
    select_modes,
)
from flexmb.fe.reduction.reduced_basis import (
    ReducedBasis,
    directions_of,
    interface_labels,
    rigid_motion_of_interfaces,
)
from flexmb.fe.reduction.residual_vectors import (
    InertiaRelief,
    fixed_interface_responses,
    residual_vectors,
)
from flexmb.fe.reduction.symmetry_plane import SymmetryPlane, symmetric_modes
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.mesh_options import ModesOptions
from flexmb.progress import Progress, silent

_SPARE = 2  # modes beyond those requested, so that no pair of equal frequency is cut


def craig_bampton(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    modes: ModesLike | ModesOptions = 20,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
) -> ReducedBasis:
    """Reduce a model with at least one interface.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple of RigidInterface or WeightedInterface
        What is held; at least one.
    modes : int, mapping or ModesOptions
        Fixed-interface modes: so many, all below ``{"frequency": f}`` [Hz], or the fewest with a
        share ``{"effective_mass": s}`` of the effective interface mass.
    progress : Progress
        Called with the phases ``"factor"`` and ``"modes"``.
    mirror : Mirror, optional
        Keep what is symmetric about its plane alone.
    loads : tuple of LoadPattern
        Loads of the body; those with ``residual`` add their static responses.

    Raises
    ------
    ReductionError
        More modes than the model has, or a part that nothing holds.
    """
    selection = read_modes(modes)
    directions = directions_of(mirror)
    fixed = FixedInterfaceModel(fe, interfaces, directions, progress)
    noun = "fixed-interface modes" + (" in the plane" if mirror is not None else "")
    omega2, inner, numbers = select_modes(
        selection,
        lambda count: _lowest(fixed, count, mirror, progress),
        fixed.count,
        noun,
        lambda modes: interface_shares(fixed, modes),
    )
    omega2, V = omega2[numbers], np.zeros((fe.numbering.n, len(numbers)))
    V[fixed.dofs] = inner[:, numbers]
    relief = InertiaRelief(fe.M, fe.rigid[:, directions])
    stiff, U = residual_vectors(fe, fixed_interface_responses(fixed, relief, loads), V)
    progress("modes", 1.0)
    basis = np.concatenate([fixed.modes, V, U], axis=1)
    M = basis.T @ (fe.M @ basis)
    c, k = fixed.modes.shape[1], basis.shape[1]
    rigid, motion = np.zeros((k, len(directions))), np.zeros((len(interfaces), 6, k))
    rigid[:c] = rigid_motion_of_interfaces(fe, interfaces, directions)
    motion[:, directions, :c] = np.eye(c).reshape(len(interfaces), len(directions), c)
    return ReducedBasis(
        basis,
        block_diag(fixed.K_modes, np.diag(omega2), np.diag(stiff)),
        0.5 * (M + M.T),
        rigid,
        motion,
        interfaces,
        (
            *interface_labels(interfaces, directions),
            *(f"fixed-interface {number + 1}" for number in numbers),
            *(f"load residual {number + 1}" for number in range(len(stiff))),
        ),
        ("constraint",) * c + ("fixed-interface",) * len(omega2) + ("load",) * len(stiff),
        directions,
        loads,
    )


def guyan(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    modes: ModesLike | ModesOptions = 0,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
) -> ReducedBasis:
    """Static reduction: the constraint modes alone; arguments as for :func:`craig_bampton`.

    Raises
    ------
    ReductionError
        Modes are requested, or a part that is not supported.
    """
    if read_modes(modes) != ModesOptions(count=0):
        raise ReductionError('modes: a static reduction ("guyan") has none; leave them out, or 0')
    return craig_bampton(fe, interfaces, 0, progress, mirror, loads)


def _lowest(
    fixed: FixedInterfaceModel, count: int, mirror: SymmetryPlane | None, progress: Progress
) -> tuple[FloatArray, FloatArray]:
    """At least ``count`` fixed-interface modes, or all, unique in sign and direction."""
    if count == 0:
        return np.zeros(0), np.zeros((len(fixed.dofs), 0))

    def lowest(number: int) -> tuple[FloatArray, FloatArray]:
        return fixed.lowest(min(number, fixed.count), progress)

    if mirror is None:
        omega2, V = lowest(count + _SPARE)
    else:
        omega2, V = symmetric_modes(mirror.on(fixed.dofs), fixed.M, lowest, count, fixed.count)
    products = polynomial_fields(fixed.fe)[fixed.dofs].T @ (fixed.M @ V)
    return omega2, V @ mode_signs(omega2, products)
