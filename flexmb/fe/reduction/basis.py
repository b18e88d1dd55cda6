"""A reduced basis: the columns, their matrices, and what each of them is.

In: what a reduction method found. Out: :class:`ReducedBasis`, the same for every method, of which
:func:`flexmb.fe.orthonormalise` makes modal coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.assembly.numbering import skew
from flexmb.fe.interfaces.make import ModelInterface
from flexmb.fe.reduction.planar import Mirror
from flexmb.flexbody.arrays import FloatArray

__all__ = ["DIRECTIONS", "SPATIAL", "STATIC", "ReducedBasis", "directions_of", "interface_labels"]

DIRECTIONS = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")
"""Names of the motions of an interface."""
SPATIAL = (0, 1, 2, 3, 4, 5)
STATIC = ("constraint", "attachment")
"""Kinds of columns that are static responses to interfaces."""


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """Columns that describe a body's deformation, rigid motions among them.

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
        ``"free"``, ``"attachment"``, ``"load"`` or ``"user"``.
    directions : tuple of int
        Motions the interfaces have, of Tx, Ty, Tz, Rx, Ry, Rz (0 to 5): three of them in a plane.
    loads : tuple of LoadPattern
        Loads the body shall know.
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

    def columns(self, *kinds: str) -> FloatArray:
        """(k,) bool, which columns are of these kinds."""
        return np.isin(self.kinds, kinds)


def directions_of(mirror: Mirror | None) -> tuple[int, ...]:
    """Motions an interface keeps: all, or those in the plane of a mirror."""
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
    chosen = list(directions)
    rows = [np.zeros((0, len(chosen)))]
    for interface in interfaces:
        about = np.eye(6)
        about[:3, 3:] = -skew(interface.position - fe.center)
        rows.append(about[np.ix_(chosen, chosen)])
    return np.concatenate(rows)
