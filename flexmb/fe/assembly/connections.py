"""Connections inside a body: ties of nodes (RBE2, RBE3).

RBE2: the nodes follow a reference node rigidly, u = T q. RBE3: the reference follows the mean
motion of the nodes, q = W u, the least-squares fit of a rigid motion over their faces: W = (G^T A
G)^-1 G^T A, with A = int N^T N dA and u = G q for a rigid motion. A force at the reference is then
a traction that varies linearly over the faces, independent of their order of interpolation; nodes
without faces have equal weights. This connects a beam to the face of a solid, or a mass to a hole.
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
from flexmb.fe.elements.shell_fields import edge_bows, free_edges
from flexmb.fe.meshes.mesh import Facets, Mesh, facet_rule, facet_samples, group_facets
from flexmb.flexbody.arrays import FloatArray, IntArray, is_nonzero, skew
from flexmb.flexbody.mesh_options import TieOptions
from flexmb.flexbody.options import read_options

Samples = tuple[csr_array, csr_array | None]
_FACE_KINDS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}  # by nodes
COLLINEAR = 1e-6  # smallest over largest extent of nodes, above which they define a rotation


def spans_rotation(points: FloatArray) -> bool:
    """Whether displacements of the points (k, 3) define a rotation: the points are not on a
    line."""
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
) -> Samples | None:
    """Area of nodes as :func:`facet_samples` and :func:`edge_samples`: of the group's facets, else
    of faces of the elements that have no other nodes, else the length of free edges of shells;
    None if these do not meet all nodes."""
    choices = [] if group is None else [group_facets(mesh, group, nodes)]
    if not any(choices):
        near = [block for block in blocks if np.isin(block.nodes, nodes).any()]
        shells = [block.nodes for block in near if block.family.dimension == 2]
        cells = [*outer_faces(near, mesh.points), *shells]
        choices.append([(_FACE_KINDS[face.shape[1]], face) for face in cells])
        choices.append([("line", free_edges(shells))])
    for choice in choices:
        facets = [(kind, cells[np.isin(cells, nodes).all(axis=1)]) for kind, cells in choice]
        met = np.unique(np.concatenate([nodes[:0], *(cells.ravel() for _, cells in facets)]))
        if len(met) == len(nodes):
            shells = [block.nodes for block in blocks if block.family.dimension == 2]
            bows = edge_samples(mesh.points, shells, facets, nodes)
            return facet_samples(mesh.points, facets, nodes), bows
    return None


def edge_samples(
    points: FloatArray, shells: list[IntArray], facets: Facets, nodes: IntArray
) -> csr_array | None:
    """(3p, 3k) displacements by rotations of ``nodes`` beside :func:`facet_samples`, of lines."""
    if [kind for kind, _ in facets] != ["line"]:
        return None
    cells = facets[0][1]
    rule, B = facet_rule("line", points[cells]), edge_bows(points, shells, cells)
    share = 0.5 * np.sqrt(rule.size) * np.prod(rule.N, axis=0)  # (f, q)
    f, q = share.shape
    values = np.einsum("fq,fab,n->fqnab", share, B, [1.0, -1.0])
    rows = 3 * np.arange(f * q).reshape(f, q, 1, 1, 1) + np.arange(3)[:, None]
    columns = 3 * np.searchsorted(nodes, cells)[:, None, :, None, None] + np.arange(3)
    places = [np.broadcast_to(part, values.shape).ravel() for part in (rows, columns)]
    return csr_array(coo_array((values.ravel(), places), shape=(3 * f * q, 3 * len(nodes))))


def weighted_rows(
    numbering: Numbering, nodes: IntArray, arms: FloatArray, weights: Samples
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
    weights : (p, k) sparse, and (3p, 3k) sparse or None
        Values that are fitted, each with the root of its weight, per unit motion of each node; what
        rotations of the nodes add to the displacements.
    """
    samples, bows = weights
    exists = numbering.table[nodes] >= 0
    if not exists[:, 3:].all():
        bows = None
    G = np.zeros((len(nodes), 6, 6))
    G[:] = np.eye(6)
    G[:, :3, 3:] = -skew(arms)
    if spans_rotation(arms):
        exists[:, 3:] &= bows is not None
        G[:, 3:] = 0.0
    elif np.ptp(arms, axis=0).any():  # on a line: rotations about it alone
        line = np.linalg.svd(arms - arms.mean(axis=0), full_matrices=False)[2][0]
        G[:, 3:, 3:] = np.outer(line, line)
    G[~exists] = 0.0
    fields = (samples @ G.reshape(-1, 36)).reshape(-1, 6, 6)
    Q, R = np.linalg.qr(fields.reshape(-1, 6))
    shares = (samples.T @ Q.reshape(-1, 36)).reshape(-1, 6, 6)
    if bows is not None:
        shares[:, 3:] += (bows.T @ Q.reshape(-1, 6, 6)[:, :3].reshape(-1, 6)).reshape(-1, 3, 6)
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
        the mean of the nodes and does not constrain them.
    reference : int
        The reference node; it has six motions.
    nodes : (k,) int
        The other nodes.
    group : str
        Their mesh group.
    """

    name: str
    kind: str
    reference: int
    nodes: IntArray
    group: str


def make_ties(mesh: Mesh, options_by_name: Mapping[str, Mapping[str, Any]]) -> tuple[Tie, ...]:
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
    for name, words in options_by_name.items():
        try:
            ties.append(_make_tie(mesh, name, words))
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
    """(count, 6) bool: motions of the nodes that depend on others, if the nodes have them."""
    tied = np.zeros((count, 6), dtype=bool)
    for tie in ties:
        tied[tie.nodes if tie.kind == "rbe2" else tie.reference] = True
    return tied


def dependence(
    ties: tuple[Tie, ...], numbering: Numbering, mesh: Mesh, blocks: tuple[Block, ...]
) -> csr_array:
    """(n_all - n, n) dependent motions per unit of each independent degree of freedom."""
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
            samples = samples or (csr_array(eye_array(len(arms))), None)
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
    """(ties, 3, 3) sums of s f^T over the nodes of each tie; f is its force, s from the reference.

    ``follow`` are the dependent motions per independent one; ``forces`` (n_all,) are the forces of
    the ties on the dependent motions.
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


def _make_tie(mesh: Mesh, name: str, words: Mapping[str, Any]) -> Tie:
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
    """The node given by its number, or by a group of one node.

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
