"""Ties inside a body: nodes that follow a reference node (RBE2), or a node that follows (RBE3).

In: a mesh and, by name, the reference node and the nodes of each tie. Out: :class:`Tie` objects,
which degrees of freedom they make dependent, and the matrix D of u_dependent = D u_independent. So
a beam ends on the face of a solid, and a mass hangs on a hole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from flexmb.errors import MeshError, Problem, nearest
from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.assembly.rigid_links import mean_motion, rigid_rows, spread
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.tables import word_problems
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["KINDS", "Tie", "dependence", "followers", "make_ties"]

KINDS = ("rbe2", "rbe3")
_KEYS = ("type", "reference", "nodes")


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
    """

    name: str
    kind: str
    reference: int
    nodes: IntArray


def make_ties(mesh: Mesh, given: Mapping[str, Mapping[str, Any]]) -> tuple[Tie, ...]:
    """Find the nodes of ties ``{name: {type, reference, nodes}}``.

    ``reference`` is a node number or a group of one node, ``nodes`` a group.

    Raises
    ------
    MeshError
        Unknown words or groups, a reference that is not one node, RBE3 nodes on a line, and nodes
        that follow twice; all at once.
    """
    found: list[Tie] = []
    problems: list[Problem] = []
    for name, words in given.items():
        try:
            found.append(_make(mesh, name, dict(words)))
        except MeshError as error:
            problems += error.problems
    seen: dict[int, str] = {}
    for tie in found:
        following = tie.nodes if tie.kind == "rbe2" else np.array([tie.reference])
        for node in following:
            if int(node) in seen:
                what = f'node {node} follows the tie "{seen[int(node)]}" already'
                problems.append(Problem(f"ties.{tie.name}", what))
                break
            seen[int(node)] = tie.name
    for tie in found:
        leading = [tie.reference] if tie.kind == "rbe2" else list(tie.nodes)
        caught = [int(node) for node in leading if int(node) in seen]
        if caught:
            what = f'node {caught[0]} itself follows the tie "{seen[caught[0]]}"'
            problems.append(Problem(f"ties.{tie.name}", f"{what}; join the two ties"))
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(found)


def followers(ties: tuple[Tie, ...], count: int) -> NDArray[np.bool_]:
    """(count, 6) which motions of the nodes follow others, if they exist."""
    tied = np.zeros((count, 6), dtype=bool)
    for tie in ties:
        tied[tie.nodes if tie.kind == "rbe2" else tie.reference] = True
    return tied


def dependence(ties: tuple[Tie, ...], numbering: Numbering, points: FloatArray) -> csr_array:
    """(n_all - n, n) motions that follow, per unit of each independent degree of freedom."""
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
            W = mean_motion(arms, np.ones(len(arms)))
            leading = numbering.table[tie.nodes, :3].ravel()
            rows.append(np.repeat(reference, len(leading)))
            columns.append(np.tile(leading, 6))
            values.append(W.ravel())
    entries = np.concatenate(values)
    places = (np.concatenate(rows) - numbering.n, np.concatenate(columns))
    shape = (numbering.n_all - numbering.n, numbering.n)
    return csr_array(coo_array((entries, places), shape=shape))


def _make(mesh: Mesh, name: str, words: dict[str, Any]) -> Tie:
    where = f"ties.{name}"
    problems = word_problems(words, where, _KEYS, _KEYS)
    kind = str(words.get("type", KINDS[0]))
    if kind not in KINDS:
        problems.append(Problem(f"{where}.type", f'unknown "{kind}"', KINDS, nearest(kind, KINDS)))
    if problems:
        raise MeshError.from_problems(problems)
    reference = one_node(mesh, words["reference"], f"{where}.reference")
    nodes = np.setdiff1d(mesh.group_nodes(words["nodes"], f"{where}.nodes"), [reference])
    if not len(nodes):
        raise MeshError.from_problems([Problem(f"{where}.nodes", "the group has no other nodes")])
    if kind == "rbe3" and not spread(mesh.points[nodes]):
        what = f"the {len(nodes)} nodes lie on a line or a point: they cannot hold a rotation"
        raise MeshError.from_problems([Problem(f"{where}.nodes", what)])
    return Tie(name, kind, reference, nodes)


def one_node(mesh: Mesh, given: str | int, where: str) -> int:
    """The node that is meant: by number, or by a group of one node.

    Raises
    ------
    MeshError
        No such node or group, or a group of several nodes.
    """
    if isinstance(given, int) and not isinstance(given, bool):
        if 0 <= given < len(mesh.points):
            return given
        what = f"there is no node {given}; the mesh has nodes 0 to {len(mesh.points) - 1}"
        raise MeshError.from_problems([Problem(where, what)])
    nodes = mesh.group_nodes(str(given), where)
    if len(nodes) != 1:
        what = f'one node is expected, the group "{given}" has {len(nodes)}'
        raise MeshError.from_problems([Problem(where, what)])
    return int(nodes[0])
