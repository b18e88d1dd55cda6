"""How well a reduced body vibrates and deforms, against the full model.

Dynamics: :class:`FrequencyCheck` from a solution of the full model, :class:`EffectiveMass` of the
fixed-interface modes, :class:`EnergyShares` of the modal coordinates. Statics:
:class:`StaticCheck`, the error of the compliance at the interfaces under loads without resultant,
which Craig-Bampton and free-interface bases represent exactly, and the share of the compliance that
is missing under other loads, which act on the free body less the inertia of its acceleration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from flexmb.errors import Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel, interface_shares
from flexmb.fe.reduction.inertia_relief import InertiaRelief
from flexmb.fe.reduction.reduced_basis import (
    DIRECTIONS,
    ReducedBasis,
    ReducedModes,
    rigid_motion_of_interfaces,
)
from flexmb.flexbody.arrays import FloatArray, IntArray

_INITIAL_MODES = 20  # modes of the full model computed first if a frequency decides their number

Lowest = Callable[[int], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class FrequencyCheck:
    """Free elastic modes of the full model and of the reduced body.

    Parameters
    ----------
    full : (a,) float
        Frequencies of the full model, ascending [Hz].
    reduced : (b,) float
        All frequencies of the reduced body [Hz].
    mac : (a, b) float
        Modal assurance criterion in the measure of the mass, (phi^T M psi)^2 for modes of unit
        modal mass: the share of the kinetic energy that two modes have in common.
    """

    full: FloatArray
    reduced: FloatArray
    mac: FloatArray

    @property
    def partner(self) -> IntArray:
        """(a,) index of the reduced mode that matches each full mode; -1 where none is left.

        The matching is one to one and has the largest sum of the modal assurance criterion, so that
        modes of equal frequencies do not share a partner.
        """
        from scipy.optimize import linear_sum_assignment  # imported here because it is slow to load

        partner = np.full(len(self.full), -1)
        rows, columns = linear_sum_assignment(self.mac, maximize=True)
        partner[rows] = columns
        return partner

    @property
    def likeness(self) -> FloatArray:
        """(a,) the criterion of each mode with its partner, zero without one."""
        row, partner = np.arange(len(self.full)), self.partner
        padded = np.concatenate([self.mac, np.zeros((len(self.full), 1))], axis=1)
        return padded[row, partner]

    @property
    def error(self) -> FloatArray:
        """(a,) frequency of the partner over that of the full model, less one; NaN without one."""
        return np.append(self.reduced, np.nan)[self.partner] / self.full - 1.0


@dataclass(frozen=True, eq=False)
class EffectiveMass:
    """Effective masses of the retained fixed-interface modes.

    Parameters
    ----------
    labels : tuple of str
        The modes.
    frequency : (k,) float
        With the interfaces held [Hz].
    share : (k, r) float
        Effective mass, or moment of inertia about the centre of mass, in rigid motions of all
        interfaces together, over that of the body.
    interface : (k,) float
        Share in the effective interface mass; all modes of the model together have one.
    """

    labels: tuple[str, ...]
    frequency: FloatArray
    share: FloatArray
    interface: FloatArray


@dataclass(frozen=True, eq=False)
class EnergyShares:
    """Shares of the kinds of basis columns, and of directions, in the energies of the coordinates.

    Parameters
    ----------
    kinds : tuple of str
        Kinds of columns of the basis.
    strain : (m, kinds) float
        Share of each kind in the strain energy, which is also its share in the kinetic energy
        (K z = omega^2 M z row by row); the shares sum to one. A share may be negative where
        columns of different kinds counteract each other.
    direction : (m, 3) float
        Share of the motion along x, y, z in the kinetic energy.
    """

    kinds: tuple[str, ...]
    strain: FloatArray
    direction: FloatArray


def compare_modes(
    fe: FEMatrices, elastic: ReducedModes, lowest: Lowest, limit: int, up_to: float | None
) -> FrequencyCheck:
    """Compare with the full model's elastic modes up to a frequency [Hz].

    Parameters
    ----------
    fe, elastic
        The model and the reduced body's modes.
    lowest : callable
        Computes at least the given number of the full model's lowest modes.
    limit : int
        Number of modes of the full model.
    up_to : float or None
        If None, half as many modes as the reduced body has are compared, at most twenty.
    """
    count = (
        min(_INITIAL_MODES, limit)
        if up_to is not None
        else min(_INITIAL_MODES, (len(elastic.omega2) + 1) // 2, limit)
    )
    while True:
        omega2, V = lowest(count)
        frequency = np.sqrt(omega2) / (2 * np.pi)
        keep = count if up_to is None else int(np.searchsorted(frequency, up_to, side="right"))
        if up_to is None or keep < len(frequency) or count >= limit:
            break
        count = min(2 * count, limit)
    mac = (V[:, :keep].T @ (fe.M @ elastic.Phi)) ** 2
    return FrequencyCheck(frequency[:keep], elastic.frequencies, mac)


def effective_masses(basis: ReducedBasis, fixed: FixedInterfaceModel) -> EffectiveMass:
    """Effective masses of the fixed-interface modes in a basis that has some."""
    rows = np.flatnonzero(basis.columns("fixed-interface"))
    static = basis.columns("constraint")
    P = basis.M[np.ix_(rows, static)]
    whole = np.diag(basis.rigid.T @ basis.M @ basis.rigid)
    return EffectiveMass(
        tuple(basis.labels[k] for k in rows),
        np.sqrt(np.diag(basis.K)[rows]) / (2 * np.pi),
        (P @ basis.rigid[static]) ** 2 / whole,
        interface_shares(fixed, basis.basis[fixed.dofs][:, rows]),
    )


def energy_shares(basis: ReducedBasis, elastic: ReducedModes, Mab: FloatArray) -> EnergyShares:
    """Energy shares of all modal coordinates; ``Mab`` (3, 3, m, m) is the modes' mass."""
    kinds = tuple(kind for kind in dict.fromkeys(basis.kinds) if kind != "rigid")
    Z = elastic.Z
    strain = Z * (basis.K @ Z) / elastic.omega2
    return EnergyShares(
        kinds,
        np.stack([strain[basis.columns(kind)].sum(axis=0) for kind in kinds], axis=1),
        np.einsum("bbjj->jb", Mab),
    )


_NO_LOAD = 1e-9  # relative size of a load below which it is round-off after inertia relief


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
        Share of the compliance under each of these loads that the modes lack, 0 to 1; NaN if the
        load does not deform the free body.
    """

    interfaces: float | None
    labels: tuple[str, ...]
    missing: FloatArray


def interface_error(
    fixed: FixedInterfaceModel, basis: ReducedBasis, elastic: ReducedModes
) -> float | None:
    """The error at the interfaces; None if every load on them has a resultant."""
    R = rigid_motion_of_interfaces(fixed.fe, fixed.interfaces, fixed.directions)
    size = np.linalg.norm(R, axis=0)
    Q = null_space((R / np.where(size > 0, size, 1.0)).T)
    if not Q.shape[1]:
        return None
    F = fixed.loads() @ Q
    full = F.T @ fixed.free(F)
    motion = (basis.motion @ elastic.Z)[:, fixed.directions].reshape(len(R), -1)
    part = Q.T @ motion
    reduced = (part / elastic.omega2) @ part.T
    scale = 1.0 / np.sqrt(np.diag(full))
    return float(np.abs(scale[:, None] * (reduced - full) * scale).max())


def missing_compliance(
    elastic: ReducedModes,
    relief: InertiaRelief,
    respond: Callable[[FloatArray], FloatArray],
    loads: Sequence[LoadPattern],
) -> FloatArray:
    """(k,) the share of the compliance that the modes lack under each load.

    Parameters
    ----------
    elastic : ReducedModes
        The modes.
    relief : InertiaRelief
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
    loads = []
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
            loads.append(LoadPattern(f"node {node} {DIRECTIONS[c]}", f, np.zeros(3), np.zeros(3)))
    return tuple(loads)
