"""Interfaces of a model: nodes that move with a reference point (RBE2) or carry it (RBE3).

Nodes are those of a group, a node, several, or all within a radius of a centre. The reference point
is the area centroid of a surface group (length centroid of a line group, mean of nodes, the centre
of a sphere) unless a position is given. Rigid: u = T q. Weighted: q = W u, the least-squares fit of
a rigid motion over the faces of the nodes (:func:`~flexmb.fe.assembly.connections.weighted_rows`),
or with weights of the nodes; loads at the point are distributed to the nodes by W^T. Only
displacements of the nodes count; a rotation that they do not determine (about a line of nodes) is
the mean of the nodes' own rotations.
Source: MSC Nastran, Linear Static Analysis User's Guide, RBE3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array

from flexmb.errors import MeshError, Problem, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.connections import (
    Samples,
    rigid_rows,
    spans_rotation,
    surface_samples,
    weighted_rows,
)
from flexmb.fe.meshes.mesh import Mesh, group_centroid
from flexmb.flexbody.arrays import FloatArray, IntArray, rotation_stiffness
from flexmb.flexbody.mesh_options import InterfaceOptions, NodeOptions
from flexmb.flexbody.options import is_number, read_options
from flexmb.units import say_length, say_place

_WEIGHTS = ("uniform", "area")
_SHOWN = 8  # number of nodes named in a message


@dataclass(frozen=True, eq=False)
class NodeSelection:
    """The nodes of an interface and how they are tied.

    Parameters
    ----------
    where, about : str
        For messages: the path of the interface in the scene, and the selection in words.
    nodes : (k,) int
        Ascending.
    position : (3,) float
        Reference point, body frame [m].
    type : str
        ``"rbe2"`` or ``"rbe3"``.
    weights : str or (k,) float or None
        As given; numbers are in the order of ``nodes``.
    group : str or None
        The mesh group, if one was named.
    """

    where: str
    about: str
    nodes: IntArray
    position: FloatArray
    type: str
    weights: str | FloatArray | None
    group: str | None


def select_interface(
    fe: FEMatrices, where: str, words: str | Mapping[str, Any] | NodeOptions
) -> NodeSelection:
    """Read the options of one interface.

    Raises
    ------
    MeshError
        Unknown, missing or contradicting words, no such group or node, no nodes of the body.
    """
    options = interface_options(where, words)
    about, requested = select_nodes(fe.mesh, where, options)
    nodes = np.intersect1d(requested, fe.numbering.nodes)
    if not len(nodes):
        raise MeshError.from_problems([Problem(where, _no_nodes(fe, about, options))])
    if options.position is not None:
        position = np.array(options.position, dtype=float)
    elif options.center is not None:
        position = np.array(options.center, dtype=float)
    elif options.group is not None:
        position = group_centroid(fe.mesh, options.group, nodes)
    else:
        position = fe.mesh.points[nodes].mean(axis=0)
    weights = _selected_weights(where, options.weights, requested, nodes)
    kind = getattr(options, "type", "rbe2") if isinstance(options, InterfaceOptions) else "rbe3"
    return NodeSelection(where, about, nodes, position, kind, weights, options.group)


def listed(nodes: Sequence[Any] | IntArray) -> str:
    """The first few numbers as text."""
    shown = ", ".join(str(node) for node in nodes[:_SHOWN])
    return f"{shown}, ..." if len(nodes) > _SHOWN else shown


def interface_options(where: str, words: str | Mapping[str, Any] | NodeOptions) -> NodeOptions:
    """The options of an interface; a text is the name of a group.

    Raises
    ------
    MeshError
        Unknown, missing or contradicting words, and values that cannot be; all at once.
    """
    if isinstance(words, NodeOptions):
        return words
    if isinstance(words, str):
        return InterfaceOptions(group=words)
    options = read_options(InterfaceOptions, words, where, MeshError)
    if isinstance(options.weights, str) and options.weights not in _WEIGHTS:
        what, near = f'unknown weights "{options.weights}"', nearest(options.weights, _WEIGHTS)
        raise MeshError.from_problems([Problem(f"{where}.weights", what, _WEIGHTS, near)])
    return options


def select_nodes(mesh: Mesh, where: str, options: NodeOptions) -> tuple[str, IntArray]:
    """What the options select, for messages, and the nodes of the mesh in the order of the options.

    Raises
    ------
    MeshError
        No such group or node.
    """
    if options.group is not None:
        return f'of the group "{options.group}"', mesh.group_nodes(options.group, where)
    if options.center is not None:
        gap = np.linalg.norm(mesh.points - np.array(options.center, dtype=float), axis=1)
        about = f"within {say_length(options.radius)} of {say_place(options.center, 6)}"
        return about, np.flatnonzero(gap <= options.radius)
    key, numbers = "nodes", options.nodes
    if numbers is None:
        key, numbers = "node", (options.node,)
    count = len(mesh.points)
    wrong = [n for n in numbers if n >= count]
    if wrong:
        what = f"{wrong[0]!r} is no node: numbers run from 0 to {count - 1}"
        if mesh.numbers is not None and wrong[0] in mesh.numbers:
            what += f"; number {wrong[0]} of the file is node {list(mesh.numbers).index(wrong[0])}"
        raise MeshError.from_problems([Problem(f"{where}.{key}", what)])
    if len(set(numbers)) < len(numbers):
        raise MeshError.from_problems([Problem(f"{where}.{key}", "names a node twice")])
    nodes = np.array(numbers, dtype=np.int64)
    return f"given ({listed(nodes)})", nodes


def _no_nodes(fe: FEMatrices, about: str, options: NodeOptions) -> str:
    if options.group is not None:
        return f'the group "{options.group}" has no nodes of the body\'s elements'
    what = f"there are no nodes of the body's elements among those {about}"
    if options.center is not None:
        nodes = fe.numbering.nodes
        gap = np.linalg.norm(fe.mesh.points[nodes] - np.array(options.center), axis=1)
        k = int(np.argmin(gap))
        what += f"; the nearest is node {nodes[k]}, {say_length(gap[k], 4)} away"
    return what


def _selected_weights(
    where: str, weights: Any, requested: IntArray, nodes: IntArray
) -> str | FloatArray | None:
    """Weights of the nodes in ascending order."""
    if weights is None or isinstance(weights, str):
        return weights
    count = len(requested)
    listed_ = hasattr(weights, "__len__") and not isinstance(weights, Mapping)
    if not listed_ or len(weights) != count or not all(is_number(w) and w > 0 for w in weights):
        given = f"{len(weights)}: {listed(weights)}" if listed_ else repr(weights)
        what = f"must be {count} positive numbers, one for each node, given {given}"
        raise MeshError.from_problems([Problem(f"{where}.weights", what)])
    order = np.argsort(requested)
    return np.array(weights, dtype=float)[order][np.isin(requested[order], nodes)]


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

    def motion(self, U: FloatArray) -> FloatArray:
        """(6, k) motion of the point in fields U (n, k) in which the nodes move rigidly."""
        return np.linalg.lstsq(self.T, U[self.dofs], rcond=None)[0]

    def loads(self) -> tuple[IntArray, FloatArray]:
        """Degrees of freedom (s,), and loads (s, 6) on them with unit force or moment each."""
        return self.dofs, np.linalg.pinv(self.T).T


@dataclass(frozen=True, eq=False)
class WeightedInterface:
    """A point that moves as the weighted mean of nodes.

    Parameters
    ----------
    name : str
        Name of the marker.
    position : (3,) float
        Reference point, body frame [m].
    nodes : (k,) int
        The nodes.
    dofs : (s,) int
        The degrees of freedom of the nodes that determine the motion of the point.
    W : (6, s) float
        Displacement and rotation of the point per unit of each.
    """

    name: str
    position: FloatArray
    nodes: IntArray
    dofs: IntArray
    W: FloatArray

    def motion(self, U: FloatArray) -> FloatArray:
        """(6, k) motion of the point in fields U (n, k)."""
        return self.W @ U[self.dofs]

    def loads(self) -> tuple[IntArray, FloatArray]:
        """Degrees of freedom (s,), and loads (s, 6) on them with unit force or moment each."""
        return self.dofs, self.W.T


InterfaceLike = str | Mapping[str, Any] | NodeOptions
ModelInterface = RigidInterface | WeightedInterface


def make_interfaces(
    fe: FEMatrices, options_by_name: Mapping[str, InterfaceLike]
) -> tuple[ModelInterface, ...]:
    """Tie nodes to reference points.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    options_by_name : mapping of str to str or mapping
        By name a mesh group, or a table: one of ``group``, ``node``, ``nodes`` or ``center`` [m]
        with ``radius`` [m]; ``type`` ``"rbe2"`` (default) or ``"rbe3"``; for the latter
        ``weights`` ``"area"`` (default where the nodes are those of faces), ``"uniform"`` or one
        number a node; ``position`` [m] of the reference point. Node numbers count from 0 in the
        mesh.

    Raises
    ------
    MeshError
        All unknown words and groups, interfaces on no nodes, nodes that cannot hold a rotation,
        nodes tied already, and interfaces that share nodes.
    """
    interfaces: list[ModelInterface] = []
    problems: list[Problem] = []
    for name, words in options_by_name.items():
        try:
            interfaces.append(make_interface(fe, name, words))
        except MeshError as error:
            problems += error.problems
    for k, one in enumerate(interfaces):
        for other in interfaces[:k]:
            shared = np.intersect1d(one.nodes, other.nodes)
            if len(shared):
                what = f"shares {len(shared)} nodes ({listed(shared)}) with the interface "
                problems.append(Problem(f"interfaces.{one.name}", f'{what}"{other.name}"'))
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(interfaces)


def make_interface(
    fe: FEMatrices, name: str, words: InterfaceLike, where: str | None = None
) -> ModelInterface:
    """One interface; ``where`` stands in messages, ``interfaces.<name>`` by default."""
    choice = select_interface(fe, f"interfaces.{name}" if where is None else where, words)
    check_tied_nodes(fe, choice)
    _check_rotation(fe, choice)
    arms = fe.mesh.points[choice.nodes] - choice.position
    if choice.type == "rbe2":
        dofs, T = rigid_rows(fe.numbering, choice.nodes, arms)
        return RigidInterface(name, choice.position, choice.nodes, dofs, T)
    dofs, W = weighted_rows(fe.numbering, choice.nodes, arms, weight_samples(fe, choice))
    return WeightedInterface(name, choice.position, choice.nodes, dofs, W)


def interface_stiffness(fe: FEMatrices, interface: ModelInterface, links: FloatArray) -> FloatArray:
    """(3, 3) stiffness of an interface's rotation due to its forces on the nodes, links (n,)."""
    arms = fe.mesh.points[interface.nodes] - interface.position
    forces = links[fe.numbering.of(interface.nodes, 3)].reshape(-1, 3)
    return rotation_stiffness(arms.T @ forces)


def weight_samples(fe: FEMatrices, choice: NodeSelection) -> Samples:
    """The weights of nodes as :func:`weighted_rows` takes them.

    Raises
    ------
    MeshError
        Weights by area of nodes that have none.
    """
    if not isinstance(choice.weights, str | None):
        return csr_array(diags_array(np.sqrt(choice.weights))), None
    if choice.weights != "uniform":
        samples = surface_samples(fe.mesh, fe.blocks, choice.group, choice.nodes)
        if samples is not None:
            return samples
    if choice.weights == "area":
        what = f'the nodes {choice.about} have no facets: weights "area" need a group of them, or '
        what += "all nodes of faces"
        raise MeshError.from_problems([Problem(choice.where, what)])
    return csr_array(eye_array(len(choice.nodes))), None


def check_tied_nodes(fe: FEMatrices, choice: NodeSelection) -> None:
    following = np.intersect1d(choice.nodes, fe.numbering.tied)
    if len(following):
        what = f"{len(following)} of its nodes ({listed(following)}) follow a tie of the body; use "
        what += "the tie's reference node"
        raise MeshError.from_problems([Problem(choice.where, what)])


def _check_rotation(fe: FEMatrices, choice: NodeSelection) -> None:
    turning = np.isin(choice.nodes, fe.numbering.rotating)
    if turning.any() or spans_rotation(fe.mesh.points[choice.nodes]):
        return
    if len(choice.nodes) == 1:
        what = f"node {choice.nodes[0]} belongs to solids, which have no rotations: one such node "
        what += "lies on a line or a point and cannot hold a rotation; choose a surface, or all "
        what += "nodes within a radius"
    else:
        what = f"the {len(choice.nodes)} nodes {choice.about} lie on a line or a point: "
        what += "they cannot hold a rotation; choose a surface"
    raise MeshError.from_problems([Problem(choice.where, what)])
