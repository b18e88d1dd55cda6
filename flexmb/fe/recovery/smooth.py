"""Which elements share one stress at the nodes where they meet.

In: the elements of one section. Out: a number for each element; elements with the same number are
averaged at their common nodes. Solids all share. Shells share along an edge where they are nearly
level and turned the same way, since across a fold top meets something else than top. Beams share
where two of them, and no third, go on in nearly the same direction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from flexmb.fe.elements.select import Block
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["smooth_parts"]

_LEVEL = np.cos(np.radians(35.0))  # a larger angle is a fold, also where a curved shell is coarse


def smooth_parts(blocks: Sequence[Block], points: FloatArray) -> list[IntArray]:
    """(ne,) the number of each element's part, for each block; blocks are of one dimension."""
    counts = [len(block.nodes) for block in blocks]
    dimension = blocks[0].family.dimension
    if dimension == 3:
        return [np.zeros(count, dtype=np.int64) for count in counts]
    direction = _normals if dimension == 2 else _tangents
    directions = np.concatenate([direction(points[block.nodes]) for block in blocks])
    meet = _shared_edges if dimension == 2 else _shared_ends
    first, second = meet(blocks)
    level = np.einsum("ka,ka->k", directions[first], directions[second]) > _LEVEL
    graph = coo_array(
        (np.ones(level.sum()), (first[level], second[level])), shape=(sum(counts), sum(counts))
    )
    numbers = connected_components(graph, directed=False)[1].astype(np.int64)
    return np.split(numbers, np.cumsum(counts)[:-1])


def _normals(x: FloatArray) -> FloatArray:
    corners = 3 if x.shape[1] in (3, 6) else 4
    last = x[:, corners - 1]
    normal = np.cross(x[:, 2] - x[:, 0], last - x[:, 1]) if corners == 4 else None
    if normal is None:
        normal = np.cross(x[:, 1] - x[:, 0], last - x[:, 0])
    return _unit(normal)


def _tangents(x: FloatArray) -> FloatArray:
    return _unit(x[:, 1] - x[:, 0])


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _shared_edges(blocks: Sequence[Block]) -> tuple[IntArray, IntArray]:
    """Pairs of elements with a common edge."""
    edges, owners, start = [], [], 0
    for block in blocks:
        for edge in block.family.edges:
            edges.append(np.sort(block.nodes[:, edge], axis=1))
            owners.append(start + np.arange(len(block.nodes)))
        start += len(block.nodes)
    return _neighbours(np.concatenate(edges), np.concatenate(owners))


def _shared_ends(blocks: Sequence[Block]) -> tuple[IntArray, IntArray]:
    """Pairs of beam elements that meet at a node where there is no third."""
    ends = np.concatenate([block.nodes[:, :2] for block in blocks])
    nodes, owners = ends.reshape(-1), np.repeat(np.arange(len(ends)), 2)
    met = np.bincount(nodes)
    two = met[nodes] == 2
    return _neighbours(nodes[two][:, None], owners[two])


def _neighbours(keys: IntArray, owners: IntArray) -> tuple[IntArray, IntArray]:
    """Owners of equal keys, next to each other in a list of all."""
    order = np.lexsort(keys.T)
    same = (np.diff(keys[order], axis=0) == 0).all(axis=1)
    return owners[order][:-1][same], owners[order][1:][same]
