"""How well a reduced body gives way to loads, against the full model.

In: the full model with its interfaces tied, the reduced basis and the modes made of it. Out:
:class:`StaticCheck`: the error of the compliance at the interfaces under loads without resultant,
which Craig-Bampton and free-interface bases have exactly, and the share of the compliance that is
missing under other loads, which act on the free body less the inertia of its acceleration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from flexmb.errors import Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.basis import DIRECTIONS, ReducedBasis, rigid_motion_of_interfaces
from flexmb.fe.reduction.held import Held
from flexmb.fe.reduction.orthonormal import ReducedModes
from flexmb.fe.reduction.relief import Relief
from flexmb.flexbody.arrays import FloatArray

__all__ = ["StaticCheck", "interface_error", "missing_compliance", "unit_loads"]

_NO_LOAD = 1e-9  # of a load: less is what rounding leaves after relief


@dataclass(frozen=True, eq=False)
class StaticCheck:
    """Compliance of the reduced body against that of the full model.

    Parameters
    ----------
    interfaces : float or None
        Largest error of an entry of the compliance matrix at the interfaces for loads without
        resultant, over the geometric mean of its diagonal entries; None without two interfaces.
    labels : tuple of str
        The other loads.
    missing : (k,) float
        Share of each one's own compliance that the modes lack, 0 to 1; NaN where the load
        does not deform the free body.
    """

    interfaces: float | None
    labels: tuple[str, ...]
    missing: FloatArray


def interface_error(held: Held, basis: ReducedBasis, elastic: ReducedModes) -> float | None:
    """The error at the interfaces; None where no load on them is without resultant."""
    R = rigid_motion_of_interfaces(held.fe, held.interfaces, held.directions)
    size = np.linalg.norm(R, axis=0)
    Q = null_space((R / np.where(size > 0, size, 1.0)).T)
    if not Q.shape[1]:
        return None
    F = held.loads() @ Q
    full = F.T @ held.free(F)
    motion = (basis.motion @ elastic.Z)[:, held.directions].reshape(len(R), -1)
    part = Q.T @ motion
    reduced = (part / elastic.omega2) @ part.T
    scale = 1.0 / np.sqrt(np.diag(full))
    return float(np.abs(scale[:, None] * (reduced - full) * scale).max())


def missing_compliance(
    elastic: ReducedModes,
    relief: Relief,
    respond: Callable[[FloatArray], FloatArray],
    loads: Sequence[LoadPattern],
) -> FloatArray:
    """(k,) the share of the compliance that the modes lack under each load.

    Parameters
    ----------
    elastic : ReducedModes
        The modes.
    relief : Relief
        Inertia relief of the model.
    respond : callable
        Deformation (n, k) of the full free body under relieved loads (n, k).
    loads : sequence of LoadPattern
        The loads.
    """
    if not loads:
        return np.zeros(0)
    F = np.stack([load.f for load in loads], axis=1)
    relieved = relief.loads(F)
    there = np.linalg.norm(relieved, axis=0) > _NO_LOAD * np.linalg.norm(F, axis=0)
    missing = np.full(len(loads), np.nan)
    full = np.sum(relieved[:, there] * respond(relieved[:, there]), axis=0)
    reduced = np.sum((elastic.Phi.T @ F[:, there]) ** 2 / elastic.omega2[:, None], axis=0)
    missing[there] = 1.0 - reduced / full
    return missing


def unit_loads(
    fe: FEMatrices, nodes: Sequence[int], directions: tuple[int, ...]
) -> tuple[LoadPattern, ...]:
    """Unit forces, and unit moments where a node rotates, on nodes of the mesh.

    Raises
    ------
    ReductionError
        A node that is not of the body, or that follows a tie.
    """
    found = []
    for node in nodes:
        if not 0 <= node < len(fe.mesh.points) or fe.numbering.table[node, 0] < 0:
            what = f"node {node} is no node of the body"
            raise ReductionError.from_problems([Problem("nodes", what)])
        for c in directions:
            dof = fe.numbering.table[node, c]
            if dof < 0:
                continue
            if dof >= fe.numbering.n:
                what = f"node {node} follows a tie of the body; take the reference node"
                raise ReductionError.from_problems([Problem("nodes", what)])
            f = np.zeros(fe.numbering.n)
            f[dof] = 1.0
            found.append(LoadPattern(f"node {node} {DIRECTIONS[c]}", f, np.zeros(3), np.zeros(3)))
    return tuple(found)
