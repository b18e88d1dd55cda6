"""Craig-Bampton reduction: unit motions of the interfaces and modes with the interfaces held.

In: a finite-element model, its interfaces, the number of fixed-interface modes. Out: a basis (n,
k) and its reduced matrices, k = 6 interfaces + modes. One factorisation of K_ii, the stiffness
with all interfaces held, gives the constraint modes Psi = -K_ii^-1 K_ib and serves the
eigensolver. Source: Craig, Bampton (1968), AIAA Journal 6(7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csr_array

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.interfaces.rigid import RigidInterface
from flexmb.fe.reduction.canonical import canonical_rotation, polynomial_fields
from flexmb.fe.reduction.eigen import dense_modes, lowest_modes
from flexmb.fe.reduction.planar import Mirror, symmetric_modes
from flexmb.fe.solver.linear_solver import Factor, factor
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.progress import Progress, silent

__all__ = ["CraigBampton", "craig_bampton"]

_DENSE = 300  # below this many interior degrees of freedom full matrices are faster
_SPARE = 2  # modes computed beyond those asked, so that no pair of equal frequency is cut blindly
_DIRECTIONS = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")
SPATIAL = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True, eq=False)
class CraigBampton:
    """A basis of constraint modes, then fixed-interface modes, and its matrices.

    Parameters
    ----------
    basis : (n, k) float
        Columns over all degrees of freedom of the model.
    K, M : (k, k) float
        Reduced stiffness and mass.
    interfaces : tuple of RigidInterface
        The first columns are their constraint modes, one for each of ``directions``, whose
        coordinates are the interfaces' displacements and rotations.
    labels : tuple of str
        Name of each column.
    directions : tuple of int
        Motions the interfaces have, of Tx, Ty, Tz, Rx, Ry, Rz (0 to 5): three of them in a plane.
    """

    basis: FloatArray
    K: FloatArray
    M: FloatArray
    interfaces: tuple[RigidInterface, ...]
    labels: tuple[str, ...]
    directions: tuple[int, ...] = SPATIAL

    @property
    def constraints(self) -> int:
        """How many columns are constraint modes."""
        return len(self.directions) * len(self.interfaces)


class _Interior(NamedTuple):
    """What is left when all interfaces are held."""

    dofs: IntArray
    K: csr_array
    M: csr_array


def craig_bampton(
    fe: FEMatrices,
    interfaces: tuple[RigidInterface, ...],
    modes: int = 20,
    progress: Progress = silent,
    mirror: Mirror | None = None,
) -> CraigBampton:
    """Reduce a model with at least one interface.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple of RigidInterface
        What is held; at least one.
    modes : int
        Number of fixed-interface modes.
    progress : Progress
        Told the phases ``"order"``, ``"factor"`` and ``"modes"``.
    mirror : Mirror, optional
        Keep what is symmetric about its plane alone.

    Raises
    ------
    ReductionError
        More modes than the model has, or a part that nothing holds.
    """
    directions = SPATIAL if mirror is None else mirror.directions
    b, T = _interface_motion(interfaces, directions)
    i = np.setdiff1d(np.arange(fe.numbering.n), b)
    if modes > len(i):
        what = f"the model has only {len(i)} fixed-interface modes"
        raise ReductionError(f"modes: {modes} asked, but {what}")
    interior = _Interior(i, fe.K[i][:, i], fe.M[i][:, i])
    held = factor(interior.K, fe.dof_points[i], progress) if len(i) else None
    basis = np.zeros((fe.numbering.n, T.shape[1] + modes))
    basis[b, : T.shape[1]] = T
    coupling = fe.K[b][:, i].T @ T
    if held is not None:
        basis[i, : T.shape[1]] = -held.solve(coupling)
        omega2, V = _fixed_modes(fe, interior, held, modes, mirror, progress)
        basis[i, T.shape[1] :] = V
    else:
        omega2 = np.zeros(0)
    K_cc = T.T @ (fe.K[b][:, b] @ T) + coupling.T @ basis[i, : T.shape[1]]
    M = basis.T @ (fe.M @ basis)
    progress("modes", 1.0)
    K = block_diag(0.5 * (K_cc + K_cc.T), np.diag(omega2))
    labels = _labels(interfaces, directions, modes)
    return CraigBampton(basis, K, 0.5 * (M + M.T), interfaces, labels, directions)


def _interface_motion(
    interfaces: tuple[RigidInterface, ...], directions: tuple[int, ...]
) -> tuple[IntArray, FloatArray]:
    """Held degrees of freedom, and how they follow these motions of every interface."""
    if not interfaces:
        raise ReductionError("interfaces: a Craig-Bampton reduction needs at least one")
    held = np.concatenate([interface.dofs for interface in interfaces])
    return held, block_diag(*[interface.T[:, directions] for interface in interfaces])


def _fixed_modes(
    fe: FEMatrices,
    interior: _Interior,
    held: Factor,
    modes: int,
    mirror: Mirror | None,
    progress: Progress,
) -> tuple[FloatArray, FloatArray]:
    i, K, M = interior

    def lowest(count: int) -> tuple[FloatArray, FloatArray]:
        if len(i) <= _DENSE or 2 * count >= len(i):
            return dense_modes(K, M, count)
        return lowest_modes(M, held.solve, count, progress)

    if mirror is None:
        omega2, V = lowest(min(modes + _SPARE, len(i)) if modes else 0)
    else:
        omega2, V = symmetric_modes(mirror.on(i), M, lowest, modes, len(i))
    V = V @ canonical_rotation(omega2, polynomial_fields(fe)[i].T @ (M @ V))
    return omega2[:modes], V[:, :modes]


def _labels(
    interfaces: tuple[RigidInterface, ...], directions: tuple[int, ...], modes: int
) -> tuple[str, ...]:
    constraint = [f"{part.name}.{_DIRECTIONS[k]}" for part in interfaces for k in directions]
    return (*constraint, *(f"fixed-interface {k + 1}" for k in range(modes)))
