"""Interfaces: groups of nodes tied rigidly to a reference point with six degrees of freedom (RBE2).

In: a finite-element model and the group of each interface. Out: one :class:`RigidInterface` each,
with u_slave = T q, q the displacement and rotation of the reference point. The point is the area
centroid of a surface group (length centroid of a line group, mean of a group of nodes).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.rigid_links import rigid_rows, spread
from flexmb.fe.meshes.centroid import group_centroid
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["RigidInterface", "make_interfaces"]


@dataclass(frozen=True, eq=False)
class RigidInterface:
    """Nodes that move as one rigid body with a reference point.

    Parameters
    ----------
    name : str
        Name of the marker.
    position : (3,) float
        Reference point, body frame [m].
    nodes : (k,) int
        The nodes.
    dofs : (s,) int
        Their degrees of freedom.
    T : (s, 6) float
        Motion of these per displacement and rotation of the reference point.
    """

    name: str
    position: FloatArray
    nodes: IntArray
    dofs: IntArray
    T: FloatArray


def make_interfaces(fe: FEMatrices, groups: Mapping[str, str]) -> tuple[RigidInterface, ...]:
    """Tie each group of nodes to a reference point.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    groups : mapping of str to str
        Mesh group by interface name.

    Raises
    ------
    MeshError
        All unknown or empty groups, groups whose nodes lie on a line, and pairs that share nodes.
    """
    found: list[RigidInterface] = []
    problems: list[Problem] = []
    for name, group in groups.items():
        try:
            found.append(_make(fe, name, group))
        except MeshError as error:
            problems += error.problems
    for k, one in enumerate(found):
        for other in found[:k]:
            shared = np.intersect1d(one.nodes, other.nodes)
            if len(shared):
                what = f'shares {len(shared)} nodes with the interface "{other.name}"'
                problems.append(Problem(f"interfaces.{one.name}", what))
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(found)


def _make(fe: FEMatrices, name: str, group: str) -> RigidInterface:
    where = f"interfaces.{name}"
    nodes = np.intersect1d(fe.mesh.group_nodes(group, where), fe.numbering.nodes)
    if not len(nodes):
        what = f'the group "{group}" has no nodes of the body\'s elements'
        raise MeshError.from_problems([Problem(where, what)])
    following = np.intersect1d(nodes, fe.numbering.tied)
    if len(following):
        what = f"{len(following)} of its nodes follow a tie of the body, one of them node "
        what += f"{following[0]}; use the tie's reference node"
        raise MeshError.from_problems([Problem(where, what)])
    position = group_centroid(fe.mesh, group, nodes)
    if not np.isin(nodes, fe.numbering.rotating).any():
        _require_spread(fe.mesh.points[nodes], where, group)
    dofs, T = rigid_rows(fe.numbering, nodes, fe.mesh.points[nodes] - position)
    return RigidInterface(name, position, nodes, dofs, T)


def _require_spread(points: FloatArray, where: str, group: str) -> None:
    if not spread(points):
        what = f'the {len(points)} nodes of the group "{group}" lie on a line or a point: '
        what += "they cannot hold a rotation; choose a surface"
        raise MeshError.from_problems([Problem(where, what)])
