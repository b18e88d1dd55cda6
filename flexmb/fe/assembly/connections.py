"""Connections inside a body: ties of nodes (RBE2, RBE3) and springs between nodes.

RBE2: nodes follow a reference node rigidly, u = T q. RBE3: the reference follows the mean motion of
the nodes, q = W u, the least-squares fit of a rigid motion over their faces: W = (G^T A G)^-1 G^T
A, A = int N^T N dA, G how nodes follow a rigid motion. A force at the reference is then a traction
that varies linearly over the faces, whatever their order; nodes without faces count alike. So a
beam ends on the face of a solid, and a mass hangs on a hole. A spring has one stiffness along the
line between its nodes, or six on the motion of the second node relative to the first at the point
midway between them, three along and three about its axes; rigid arms join that point to the nodes.
Source: MSC Nastran Quick Reference Guide, entries RBE2 and RBE3 (nodal weights); Abaqus, coupling
constraints (distributing, weights of the surface), with the face integrals of consistent loads in
place of nodal areas.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.sparse import coo_array, csr_array, eye_array

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.elements.element_blocks import Block, outer_faces
from flexmb.fe.meshes.mesh import Mesh, facet_samples, group_facets
from flexmb.flexbody.arrays import FloatArray, IntArray, is_nonzero, skew
from flexmb.flexbody.mesh_options import NodeSpringOptions, TieOptions
from flexmb.flexbody.options import read_options

_FACE_KINDS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}  # by nodes
COLLINEAR = 1e-6  # smallest over largest extent of nodes that still define a rotation


def spans_rotation(points: FloatArray) -> bool:
    """Whether displacements of the points (k, 3) define a rotation: they are on no line."""
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) >= 3 and bool(is_nonzero(extent, COLLINEAR)[1])


def rigid_rows(
    numbering: Numbering, nodes: IntArray, arms: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Numbers (s,) of the nodes' degrees of freedom, and their motion (s, 6) per unit motion of
    the point that the arms (k, 3) start from."""
    T = np.zeros((len(nodes), 6, 6))
    T[:] = np.eye(6)
    T[:, :3, 3:] = -skew(arms)
    numbers = numbering.table[nodes]
    exists = numbers >= 0
    return numbers[exists], T[exists]


def surface_samples(
    mesh: Mesh, blocks: Iterable[Block], group: str | None, nodes: IntArray
) -> csr_array | None:
    """Area of nodes as :func:`facet_samples`: of the group's facets, else of faces of the elements
    that have no other nodes; None if these do not meet all nodes."""
    facets = [] if group is None else group_facets(mesh, group, nodes)
    if not facets:
        near = [block for block in blocks if np.isin(block.nodes, nodes).any()]
        faces = outer_faces(near, mesh.points)
        faces += [block.nodes for block in near if block.family.dimension == 2]
        facets = [
            (_FACE_KINDS[face.shape[1]], face[np.isin(face, nodes).all(axis=1)]) for face in faces
        ]
    met = np.unique(np.concatenate([nodes[:0], *(cells.ravel() for _, cells in facets)]))
    return facet_samples(mesh.points, facets, nodes) if len(met) == len(nodes) else None


def weighted_rows(
    numbering: Numbering, nodes: IntArray, arms: FloatArray, samples: csr_array
) -> tuple[IntArray, FloatArray]:
    """The rigid motion of a point nearest to the motion of nodes, by least squares.

    Degrees of freedom (s,) that count, and W (6, s).

    Parameters
    ----------
    numbering : Numbering
        Of the model.
    nodes : (k,) int
        The nodes; they must be able to hold all six motions.
    arms : (k, 3) float
        Their positions from the reference point [m].
    samples : (p, k) sparse
        Values that are fitted, each with the root of its weight, per unit motion of each node.
    """
    exists = numbering.table[nodes] >= 0
    if spans_rotation(arms):
        exists &= np.arange(6) < 3
    G = np.zeros((len(nodes), 6, 6))
    G[:] = np.eye(6)
    G[:, :3, 3:] = -skew(arms)
    G[~exists] = 0.0
    roots, places = samples @ np.ones(len(nodes)), samples @ arms
    spread = places - np.outer(roots, roots @ places / (roots @ roots))
    gyration = np.linalg.norm(spread) / np.linalg.norm(roots)
    scale = np.repeat([1.0, gyration if gyration > 0 else 1.0], 3)[:, None]
    fields = (samples @ G.reshape(-1, 36)).reshape(-1, 6, 6) * scale
    Q, R = np.linalg.qr(fields.reshape(-1, 6))
    shares = (samples.T @ (Q.reshape(-1, 6, 6) * scale).reshape(-1, 36)).reshape(-1, 6, 6)
    return numbering.table[nodes][exists], solve_triangular(R, shares[exists].T)


@dataclass(frozen=True, eq=False)
class Tie:
    """One tie.

    Parameters
    ----------
    name : str
        For messages.
    kind : str
        ``"rbe2"``: the nodes follow the reference rigidly; ``"rbe3"``: the reference moves with
        the mean of the nodes and holds none of them.
    reference : int
        The reference node; it has six motions.
    nodes : (k,) int
        The others.
    group : str
        Their group.
    """

    name: str
    kind: str
    reference: int
    nodes: IntArray
    group: str


def make_ties(mesh: Mesh, words_by_name: Mapping[str, Mapping[str, Any]]) -> tuple[Tie, ...]:
    """Find the nodes of ties ``{name: {type, reference, nodes}}``.

    ``reference`` is a node number or a group of one node, ``nodes`` a group.

    Raises
    ------
    MeshError
        Unknown words or groups, a reference that is not one node, RBE3 nodes on a line, and nodes
        that follow twice; all at once.
    """
    ties: list[Tie] = []
    problems: list[Problem] = []
    for name, words in words_by_name.items():
        try:
            ties.append(_make_tie(mesh, name, dict(words)))
        except MeshError as error:
            problems += error.problems
    seen: dict[int, str] = {}
    for tie in ties:
        following = tie.nodes if tie.kind == "rbe2" else np.array([tie.reference])
        for node in following:
            if int(node) in seen:
                what = f'node {node} follows the tie "{seen[int(node)]}" already'
                problems.append(Problem(f"ties.{tie.name}", what))
                break
            seen[int(node)] = tie.name
    for tie in ties:
        leading = [tie.reference] if tie.kind == "rbe2" else list(tie.nodes)
        caught = [int(node) for node in leading if int(node) in seen]
        if caught:
            what = f'node {caught[0]} itself follows the tie "{seen[caught[0]]}"'
            problems.append(Problem(f"ties.{tie.name}", f"{what}; join the two ties"))
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(ties)


def followers(ties: tuple[Tie, ...], count: int) -> NDArray[np.bool_]:
    """(count, 6) which motions of the nodes follow others, if they exist."""
    tied = np.zeros((count, 6), dtype=bool)
    for tie in ties:
        tied[tie.nodes if tie.kind == "rbe2" else tie.reference] = True
    return tied


def dependence(
    ties: tuple[Tie, ...], numbering: Numbering, mesh: Mesh, blocks: tuple[Block, ...]
) -> csr_array:
    """(n_all - n, n) motions that follow, per unit of each independent degree of freedom."""
    points = mesh.points
    rows, columns, values = [], [], []
    for tie in ties:
        arms = points[tie.nodes] - points[tie.reference]
        reference = numbering.table[tie.reference]
        if tie.kind == "rbe2":
            numbers, T = rigid_rows(numbering, tie.nodes, arms)
            rows.append(np.repeat(numbers, 6))
            columns.append(np.tile(reference, len(numbers)))
            values.append(T.ravel())
        else:
            samples = surface_samples(mesh, blocks, tie.group, tie.nodes)
            samples = csr_array(eye_array(len(arms))) if samples is None else samples
            leading, W = weighted_rows(numbering, tie.nodes, arms, samples)
            rows.append(np.repeat(reference, len(leading)))
            columns.append(np.tile(leading, 6))
            values.append(W.ravel())
    entries = np.concatenate(values)
    places = (np.concatenate(rows) - numbering.n, np.concatenate(columns))
    shape = (numbering.n_all - numbering.n, numbering.n)
    return csr_array(coo_array((entries, places), shape=shape))


def tie_moments(
    ties: tuple[Tie, ...],
    numbering: Numbering,
    points: FloatArray,
    follow: csr_array,
    forces: FloatArray,
) -> FloatArray:
    """(ties, 3, 3) sums of s f^T over the nodes, f what the tie exerts, s from the reference.

    ``follow`` are the motions that follow, per independent one; ``forces`` (n_all,) those of the
    ties on the motions that follow.
    """
    moments = np.zeros((len(ties), 3, 3))
    for k, tie in enumerate(ties):
        numbers, exerted = numbering.table[tie.nodes, :3], forces
        if tie.kind == "rbe3":
            reference = numbering.table[tie.reference]
            exerted = -(follow[reference - numbering.n].T @ forces[reference])
        f = np.where(numbers >= 0, exerted[numbers], 0.0)
        moments[k] = (points[tie.nodes] - points[tie.reference]).T @ f
    return moments


def _make_tie(mesh: Mesh, name: str, words: dict[str, Any]) -> Tie:
    where = f"ties.{name}"
    options = read_options(TieOptions, words, where, MeshError)
    kind = options.type
    reference = one_node(mesh, options.reference, f"{where}.reference")
    nodes = np.setdiff1d(mesh.group_nodes(options.nodes, f"{where}.nodes"), [reference])
    if not len(nodes):
        raise MeshError.from_problems([Problem(f"{where}.nodes", "the group has no other nodes")])
    if kind == "rbe3" and not spans_rotation(mesh.points[nodes]):
        what = f"the {len(nodes)} nodes lie on a line or a point: they cannot hold a rotation"
        raise MeshError.from_problems([Problem(f"{where}.nodes", what)])
    return Tie(name, kind, reference, nodes, options.nodes)


def one_node(mesh: Mesh, node: str | int, where: str) -> int:
    """The node that is meant: by number, or by a group of one node.

    Raises
    ------
    MeshError
        No such node or group, or a group of several nodes.
    """
    if isinstance(node, int) and not isinstance(node, bool):
        if 0 <= node < len(mesh.points):
            return node
        what = f"there is no node {node}; the mesh has nodes 0 to {len(mesh.points) - 1}"
        raise MeshError.from_problems([Problem(where, what)])
    nodes = mesh.group_nodes(str(node), where)
    if len(nodes) != 1:
        what = f'one node is expected, the group "{node}" has {len(nodes)}'
        raise MeshError.from_problems([Problem(where, what)])
    return int(nodes[0])


_MIN_DISTANCE = 1e-9  # of the mesh's extent: nearer nodes have no line between them


@dataclass(frozen=True, eq=False)
class Spring:
    """One spring.

    Parameters
    ----------
    name : str
        For messages.
    nodes : (2,) int
        The nodes.
    stiffness : (1,) or (6,) float
        Along the line [N/m]; or along [N/m] and about [N m/rad] the axes.
    axes : (3, 3) float
        As columns, body frame.
    """

    name: str
    nodes: IntArray
    stiffness: FloatArray
    axes: FloatArray


def make_springs(mesh: Mesh, words_by_name: Mapping[str, Mapping[str, Any]]) -> tuple[Spring, ...]:
    """Find the nodes of springs ``{name: {between, stiffness, axes}}``.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    words_by_name : mapping of str to mapping
        ``between`` two node numbers or groups of one node; ``stiffness`` one number [N/m] or six
        [N/m, N m/rad]; ``axes`` the directions of the first and second axis, the body's by
        default.

    Raises
    ------
    MeshError
        Unknown words or groups, springs to ground, impossible values; all at once.
    """
    springs: list[Spring] = []
    problems: list[Problem] = []
    for name, words in words_by_name.items():
        try:
            springs.append(_make_spring(mesh, name, dict(words)))
        except MeshError as error:
            problems += error.problems
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(springs)


def spring_stiffness(
    spring: Spring, numbering: Numbering, points: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Stiffness (1, d, d) of a spring and the numbers (1, d) of its degrees of freedom.

    Raises
    ------
    MeshError
        A node outside the body, or one whose missing rotations the spring would need.
    """
    where, numbers = f"springs.{spring.name}", numbering.table[spring.nodes]
    outside = spring.nodes[numbers[:, 0] < 0]
    if len(outside):
        what = f"node {outside[0]} belongs to no element of the body and to no tie"
        raise MeshError(f"{where}.between: {what}")
    a, b = points[spring.nodes]
    if len(spring.stiffness) == 1:
        n = (b - a) / np.linalg.norm(b - a)
        row = np.concatenate([-n, n])
        return spring.stiffness * np.outer(row, row)[None], numbers[:, :3].reshape(1, -1)
    _check_rotations(spring, numbering, points)
    middle, B = 0.5 * (a + b), np.zeros((6, 2, 6))
    for side, (sign, node) in enumerate(((-1.0, a), (1.0, b))):
        B[:3, side, :3] = sign * spring.axes.T
        B[:3, side, 3:] = -sign * spring.axes.T @ skew(middle - node)
        B[3:, side, 3:] = sign * spring.axes.T
    there = numbers >= 0
    rows = B[:, there]
    K = rows.T @ (spring.stiffness[:, None] * rows)
    return 0.5 * (K + K.T)[None], numbers[there][None]


def _check_rotations(spring: Spring, numbering: Numbering, points: FloatArray) -> None:
    without = spring.nodes[numbering.table[spring.nodes, 3] < 0]
    apart = np.linalg.norm(np.diff(points[spring.nodes], axis=0)) > _MIN_DISTANCE * np.ptp(points)
    if len(without) and (apart or spring.stiffness[3:].any()):
        why = "turning stiffnesses" if spring.stiffness[3:].any() else "arms to the other node"
        what = f"node {without[0]} has no rotations for the spring's {why}"
        raise MeshError(f"springs.{spring.name}: {what}: use the reference node of a tie")


def _make_spring(mesh: Mesh, name: str, words: dict[str, Any]) -> Spring:
    where = f"springs.{name}"
    options = read_options(NodeSpringOptions, words, where, MeshError)
    nodes = _spring_nodes(mesh, options.between, f"{where}.between")
    stiffness = _spring_constants(options.stiffness, f"{where}.stiffness")
    if len(stiffness) == 1:
        a, b = mesh.points[nodes]
        if np.linalg.norm(b - a) <= _MIN_DISTANCE * np.ptp(mesh.points):
            what = f"nodes {nodes[0]} and {nodes[1]} coincide, so there is no line between them"
            raise MeshError(f"{where}.between: {what}: give six stiffnesses")
    return Spring(name, nodes, stiffness, _spring_axes(options.axes, f"{where}.axes"))


def _spring_nodes(mesh: Mesh, between: Any, where: str) -> IntArray:
    ends = list(between) if isinstance(between, list | tuple) else [between]
    if len(ends) == 1 or "ground" in ends:
        what = "a spring joins two nodes of the body, given"
        why = "the body floats: a spring to the ground is a force of the scene"
        raise MeshError(f"{where}: {what} {between!r}; {why}")
    if len(ends) != 2:
        raise MeshError(f"{where}: two nodes are expected, given {between!r}")
    nodes = np.array([one_node(mesh, end, f"{where}[{k}]") for k, end in enumerate(ends)])
    if nodes[0] == nodes[1]:
        raise MeshError(f"{where}: both ends are node {nodes[0]}")
    return nodes


def _spring_constants(value: Any, where: str) -> FloatArray:
    try:
        values = np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape not in ((1,), (6,)) or not np.isfinite(values).all():
        what = "one number [N/m], or six along [N/m] and about [N m/rad] the axes"
        raise MeshError(f"{where}: expects {what}, given {value!r}")
    if (values < 0).any() or not values.any():
        raise MeshError(f"{where}: must be positive, given {value!r}")
    return values


def _spring_axes(axes: Any, where: str) -> FloatArray:
    if axes is None:
        return np.eye(3)
    try:
        first, second = np.asarray(axes, dtype=float).reshape(2, 3)
    except (TypeError, ValueError) as error:
        raise MeshError(f"{where}: expects two directions, given {axes!r}") from error
    third = np.cross(first, second)
    size = np.linalg.norm(first) * np.linalg.norm(second)
    if not np.linalg.norm(third) > 1e-6 * size:
        raise MeshError(f"{where}: the two directions must not be parallel, given {axes!r}")
    third = third / np.linalg.norm(third)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=1)
