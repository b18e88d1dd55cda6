"""A reduced basis: its columns and matrices, the modal coordinates made of it, their inertia.

:class:`ReducedBasis` is the same for every reduction method. :func:`orthonormalise` makes modal
coordinates with diagonal mass and stiffness from it. The rigid motions are known exactly; they are
projected out mass-orthogonally (a mean-axis frame) and never identified by small frequencies.
:func:`integrals` reduces the inertia: p = int rho N_b Phi, P = int rho s_a N_b Phi, Mab = Phi^T int
rho N_a^T N_b Phi.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, eigh, qr, solve_triangular

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.eigenmodes import SymmetryPlane, mode_signs, polynomial_fields
from flexmb.flexbody.arrays import FloatArray, IntArray, is_nonzero, skew
from flexmb.flexbody.parts import ModeInfo
from flexmb.units import say_place

DIRECTIONS = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")
"""Names of the motions of an interface."""
SPATIAL = (0, 1, 2, 3, 4, 5)
STATIC = ("constraint", "attachment")
"""Kinds of columns that are static responses to interfaces."""
FixedResponse = Callable[[FloatArray], FloatArray]
"""Static response (n, l) of the full model to loads (n, l), its interfaces fixed."""


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """Columns that describe the motion of a body: its deformation, and its rigid motions.

    Parameters
    ----------
    basis : (n, k) float
        Columns over all degrees of freedom of the model.
    K, M : (k, k) float
        Reduced stiffness and mass.
    rigid : (k, r) float
        The rigid motions about the centre of mass in these coordinates: six, three in a plane.
    motion : (i, 6, k) float
        Displacement and rotation of each interface per unit of each coordinate.
    interfaces : tuple of RigidInterface or WeightedInterface
        The interfaces.
    labels, kinds : tuple of str
        Name of each column, and what it is: ``"rigid"``, ``"constraint"``, ``"fixed-interface"``,
        ``"free"``, ``"attachment"``, ``"load"``, ``"inertia"``, ``"load and inertia"`` or
        ``"user"``.
    directions : tuple of int
        Motions the interfaces have, of Tx, Ty, Tz, Rx, Ry, Rz (0 to 5): three of them in a plane.
    loads : tuple of LoadPattern
        Loads of the body, whose static response is exact or of which the missing share is known.
    inertia : (n, 12) float, optional
        Static responses of the full model to the body's own inertia loads.
    without : (k,) and (n, k) float, optional
        Squared frequencies and fields of all columns but constraint modes, as they are without the
        residual vectors of inertia loads, if the basis has such vectors.
    omitted : (n, o) float, optional
        The lowest of the modes that the basis omits.
    fixed_response : FixedResponse, optional
        With the interfaces fixed in all these directions.
    accelerations : (n, k) float, optional
        Static responses of the full model to unit accelerations of these coordinates.
    with_inertia : callable, optional
        Makes the basis with residual vectors of inertia loads, of one without, at little cost.
    """

    basis: FloatArray
    K: FloatArray
    M: FloatArray
    rigid: FloatArray
    motion: FloatArray
    interfaces: tuple[ModelInterface, ...]
    labels: tuple[str, ...]
    kinds: tuple[str, ...]
    directions: tuple[int, ...] = SPATIAL
    loads: tuple[LoadPattern, ...] = ()
    inertia: FloatArray | None = None
    without: tuple[FloatArray, FloatArray] | None = None
    omitted: FloatArray | None = None
    fixed_response: FixedResponse | None = None
    accelerations: FloatArray | None = None
    with_inertia: Callable[[], ReducedBasis] | None = None

    def columns(self, *kinds: str) -> FloatArray:
        """(k,) bool, which columns are of these kinds."""
        return np.isin(self.kinds, kinds)


def directions_of(mirror: SymmetryPlane | None) -> tuple[int, ...]:
    """Motions of an interface that are coordinates: all six, or those in the plane of a mirror."""
    return SPATIAL if mirror is None else mirror.directions


def interface_labels(
    interfaces: tuple[ModelInterface, ...], directions: tuple[int, ...]
) -> tuple[str, ...]:
    """Names of all motions of all interfaces, such as ``"tip.Tx"``."""
    return tuple(f"{part.name}.{DIRECTIONS[k]}" for part in interfaces for k in directions)


def rigid_motion_of_interfaces(
    fe: FEMatrices, interfaces: tuple[ModelInterface, ...], directions: tuple[int, ...]
) -> FloatArray:
    """(c, r) motions of all interfaces in the rigid motions about the centre of mass."""
    columns = list(directions)
    rows = [np.zeros((0, len(columns)))]
    for interface in interfaces:
        about = np.eye(6)
        about[:3, 3:] = -skew(interface.position - fe.center)
        rows.append(about[np.ix_(columns, columns)])
    return np.concatenate(rows)


def rigid_basis(
    fe: FEMatrices, interfaces: tuple[ModelInterface, ...], loads: tuple[LoadPattern, ...] = ()
) -> ReducedBasis:
    """The rigid motions alone."""
    R, names = fe.rigid, tuple(f"rigid {motion}" for motion in DIRECTIONS)
    motion = rigid_motion_of_interfaces(fe, interfaces, SPATIAL).reshape(-1, 6, 6)
    matrices = (np.zeros((6, 6)), R.T @ (fe.M @ R), np.eye(6))
    return ReducedBasis(R, *matrices, motion, interfaces, names, ("rigid",) * 6, loads=loads)


@dataclass(frozen=True, eq=False)
class ReducedModes:
    """Elastic modes with unit modal mass.

    Parameters
    ----------
    omega2 : (m,) float
        Squared circular frequencies of the free body, ascending [1/s^2].
    Z : (k, m) float
        Modes in the coordinates of the reduced basis.
    Phi : (n, m) float
        Modes over all degrees of freedom of the model.
    """

    omega2: FloatArray
    Z: FloatArray
    Phi: FloatArray

    @property
    def frequencies(self) -> FloatArray:
        """(m,) Hz."""
        return np.sqrt(self.omega2) / (2 * np.pi)


def orthonormalise(fe: FEMatrices, reduced: ReducedBasis) -> ReducedModes:
    """Elastic modes of the reduced free body, unique in sign and direction.

    Raises
    ------
    ReductionError
        The reduced body is a mechanism, or a part of it is not connected.
    """
    omega2, Z = elastic_modes(reduced.K, reduced.M, reduced.rigid)
    if len(omega2) and not is_nonzero(omega2)[0]:
        where = moving_nodes(fe, reduced.basis @ Z[:, :1])
        raise ReductionError(
            f"the body has a motion without stiffness besides the six rigid ones: {where}"
        )
    products = (polynomial_fields(fe).T @ (fe.M @ reduced.basis)) @ Z
    Z = Z @ mode_signs(omega2, products)
    return ReducedModes(omega2, Z, reduced.basis @ Z)


def elastic_modes(K: FloatArray, M: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, ascending, and mass-normalised modes that are mass-orthogonal to R.

    Parameters
    ----------
    K, M : (k, k) float
        Reduced matrices; K R = 0.
    R : (k, 6) float
        Rigid motions, fewer in a plane.

    Raises
    ------
    ReductionError
        A motion without mass.
    """
    massless = ~(np.diag(M) > 0)
    scale = 1.0 / np.sqrt(np.where(massless, 1.0, np.diag(M)))
    try:
        L = cholesky(scale[:, None] * M * scale, lower=True)
    except np.linalg.LinAlgError as error:
        raise ReductionError(
            "a motion of the reduced body has no mass, so its modes have no frequency: nodes that "
            "hang on springs or ties alone need a mass, or must be no interface"
        ) from error
    rigid = L.T @ (R / scale[:, None])
    rest = qr(rigid)[0][:, R.shape[1] :]
    half = solve_triangular(L, rest, lower=True, trans="T") * scale[:, None]
    A = half.T @ K @ half
    omega2, W = eigh(0.5 * (A + A.T))
    return omega2, half @ W


_MOVING_SHARE = 0.05  # nodes that move by less than this fraction of the largest motion are at rest
_SHOWN = 5
FREE_HINGE = (
    "the free body has a hinge: besides its motions as a whole a part of the mesh moves without "
    "stiffness; parts are joined by too few nodes, or a beam or shell by nodes of solids, which "
    "have no rotations and are to be tied to nodes around them; with an interface or a support at "
    "one of them the other is named"
)


def free_part(fe: FEMatrices, dofs: IntArray) -> str:
    """The sentence about degrees of freedom that move freely with all interfaces fixed."""
    u = np.zeros((fe.numbering.n, 1))
    u[dofs] = 1.0
    where = moving_nodes(fe, u)
    return f"with all interfaces held, a part of the mesh still moves freely: {where}"


def moving_nodes(fe: FEMatrices, u: FloatArray) -> str:
    """The nodes that move in a field u (n, 1), as text: how many, the first few, and where."""
    nodes = fe.numbering.nodes
    padded = np.append(fe.expand(u[:, 0]), 0.0)  # -1 in the table refers to the zero at the end
    extent = float(np.ptp(fe.mesh.points[nodes], axis=0).max())
    size = np.abs(padded[fe.numbering.table[nodes]]) * ([1.0] * 3 + [extent] * 3)
    amount = size.max(axis=1)
    moving = nodes[amount > _MOVING_SHARE * amount.max()]
    shown = ", ".join(str(node) for node in moving[:_SHOWN])
    more = ", ..." if len(moving) > _SHOWN else ""
    places = fe.mesh.points[moving]
    low, high = say_place(places.min(axis=0)), say_place(places.max(axis=0))
    many = f"{len(moving)} of {len(nodes)} nodes" if len(moving) > 1 else "one node"
    return f"{many} ({shown}{more}) between {low} and {high}; {_hinge(fe, moving)}"


def _hinge(fe: FEMatrices, moving: IntArray) -> str:
    """Why a part of the mesh can move: shells and beams turn where they share nodes with solids."""
    solid, other = (
        [block.nodes.ravel() for block in fe.blocks if block.family.rotations == rotating]
        for rotating in (False, True)
    )
    common = np.intersect1d(*(np.concatenate([[-1], *part]) for part in (solid, other)))[1:]
    common = np.intersect1d(np.setdiff1d(common, fe.numbering.tied), moving)
    if not len(common):
        return "they are joined to the rest by too few nodes, or by a hinge"
    shown = ", ".join(str(node) for node in common[:_SHOWN]) + ", ..." * (len(common) > _SHOWN)
    return (
        "shells and beams turn freely at the nodes that they share with solids, which have no "
        f"rotations ({shown}): tie these to nodes around them, or let the shells overlap a row of "
        "solids"
    )


@dataclass(frozen=True, eq=False)
class Integrals:
    """Inertia integrals of a flexible body, named as in :class:`flexmb.flexbody.FlexBody`."""

    mass: float
    S1: FloatArray
    S0: FloatArray
    p: FloatArray
    P: FloatArray
    Mab: FloatArray


def integrals(fe: FEMatrices, Phi: FloatArray) -> Integrals:
    """Reduce the inertia of a model onto modes ``Phi`` (n, m)."""
    inertia, everywhere = fe.inertia, fe.expand(Phi)
    return Integrals(
        float(inertia.mass),
        inertia.S1,
        inertia.S0,
        inertia.p @ everywhere,
        inertia.P @ everywhere,
        fe.reduced_mass(Phi),
    )


_RIGID_MOTIONS = tuple(f"{kind} {axis}" for kind in ("translation", "rotation") for axis in "xyz")


def mode_infos(
    fe: FEMatrices, reduced: ReducedBasis, modes: ReducedModes, Mab: FloatArray
) -> tuple[ModeInfo, ...]:
    """Mode infos: the six rigid motions, which are not retained, then the modal coordinates.

    Parameters
    ----------
    fe, reduced, modes
        The model, the reduced basis and the modes made of it.
    Mab : (3, 3, m, m) float
        Mass components reduced onto the modes.
    """
    R = fe.rigid
    energy, mass = np.sum(R * (fe.K @ R), axis=0), np.sum(R * (fe.M @ R), axis=0)
    residual = np.sqrt(np.maximum(energy / mass, 0.0)) / (2 * np.pi)
    why = "rigid motion"
    rigid = [
        ModeInfo(-1, "rigid", float(f), False, why, name)
        for f, name in zip(residual, _RIGID_MOTIONS, strict=True)
    ]
    return (*rigid, *_elastic_infos(reduced, modes, Mab))


def _elastic_infos(reduced: ReducedBasis, modes: ReducedModes, Mab: FloatArray) -> list[ModeInfo]:
    static = reduced.columns(*STATIC)
    strain = modes.Z * (reduced.K @ modes.Z) / modes.omega2
    largest = np.argmax(strain, axis=0)
    kinetic = np.einsum("bbjj->jb", Mab)
    return [
        ModeInfo(
            j,
            "elastic",
            float(frequency),
            True,
            "",
            reduced.labels[largest[j]],
            float(strain[static, j].sum()),
            tuple(kinetic[j]),
        )
        for j, frequency in enumerate(modes.frequencies)
    ]
