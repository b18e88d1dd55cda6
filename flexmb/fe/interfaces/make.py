"""Interfaces of a model, from what the user says of each.

In: a finite-element model and, by name, a group or a table of words. Out: one interface each, rigid
(RBE2) or weighted (RBE3). The reference point is the area centroid of a surface group (length
centroid of a line group, mean of nodes, the centre of a sphere) unless a position is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.rigid_links import rigid_rows, spread
from flexmb.fe.interfaces.rigid import RigidInterface
from flexmb.fe.interfaces.selectors import Choice, choose, listed
from flexmb.fe.interfaces.tributary import tributary
from flexmb.fe.interfaces.weighted import WeightedInterface, weighted_rows
from flexmb.flexbody.arrays import FloatArray

__all__ = ["InterfaceLike", "ModelInterface", "make_interface", "make_interfaces"]

InterfaceLike = str | Mapping[str, Any]
ModelInterface = RigidInterface | WeightedInterface


def make_interfaces(
    fe: FEMatrices, given: Mapping[str, InterfaceLike]
) -> tuple[ModelInterface, ...]:
    """Tie nodes to reference points.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    given : mapping of str to str or mapping
        By name a mesh group, or a table: one of ``group``, ``node``, ``nodes`` or ``center`` [m]
        with ``radius`` [m]; ``type`` ``"rbe2"`` (default) or ``"rbe3"``; for the latter
        ``weights`` ``"area"`` (default where the group has facets), ``"uniform"`` or one number a
        node; ``position`` [m] of the reference point. Node numbers count from 0 in the mesh.

    Raises
    ------
    MeshError
        All unknown words and groups, interfaces on no nodes, nodes that cannot hold a rotation,
        nodes tied already, and interfaces that share nodes.
    """
    found: list[ModelInterface] = []
    problems: list[Problem] = []
    for name, words in given.items():
        try:
            found.append(make_interface(fe, name, words))
        except MeshError as error:
            problems += error.problems
    for k, one in enumerate(found):
        for other in found[:k]:
            shared = np.intersect1d(one.nodes, other.nodes)
            if len(shared):
                what = f"shares {len(shared)} nodes ({listed(shared)}) with the interface "
                problems.append(Problem(f"interfaces.{one.name}", f'{what}"{other.name}"'))
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(found)


def make_interface(
    fe: FEMatrices, name: str, words: InterfaceLike, where: str | None = None
) -> ModelInterface:
    """One interface; ``where`` stands in messages, ``interfaces.<name>`` by default."""
    choice = choose(fe, f"interfaces.{name}" if where is None else where, words)
    _require_free(fe, choice)
    _require_spread(fe, choice)
    arms = fe.mesh.points[choice.nodes] - choice.position
    if choice.type == "rbe2":
        dofs, T = rigid_rows(fe.numbering, choice.nodes, arms)
        return RigidInterface(name, choice.position, choice.nodes, dofs, T)
    dofs, W = weighted_rows(fe.numbering, choice.nodes, arms, _weights(fe, choice))
    return WeightedInterface(name, choice.position, choice.nodes, dofs, W)


def _weights(fe: FEMatrices, choice: Choice) -> FloatArray:
    if not isinstance(choice.weights, str | None):
        return choice.weights
    if choice.weights != "uniform" and choice.group is not None:
        area = tributary(fe.mesh, choice.group, choice.nodes)
        if area is not None:
            return area
    if choice.weights == "area":
        what = f'the nodes {choice.about} have no facets: weights "area" need a group of them'
        raise MeshError.from_problems([Problem(choice.where, what)])
    return np.ones(len(choice.nodes))


def _require_free(fe: FEMatrices, choice: Choice) -> None:
    following = np.intersect1d(choice.nodes, fe.numbering.tied)
    if len(following):
        what = f"{len(following)} of its nodes ({listed(following)}) follow a tie of the body; use "
        what += "the tie's reference node"
        raise MeshError.from_problems([Problem(choice.where, what)])


def _require_spread(fe: FEMatrices, choice: Choice) -> None:
    turning = np.isin(choice.nodes, fe.numbering.rotating)
    if turning.any() or spread(fe.mesh.points[choice.nodes]):
        return
    if len(choice.nodes) == 1:
        what = f"node {choice.nodes[0]} belongs to solids, which have no rotations: one such node "
        what += "lies on a line or a point and cannot hold a rotation; choose a surface, or all "
        what += "nodes within a radius"
    else:
        what = f"the {len(choice.nodes)} nodes {choice.about} lie on a line or a point: "
        what += "they cannot hold a rotation; choose a surface"
    raise MeshError.from_problems([Problem(choice.where, what)])
