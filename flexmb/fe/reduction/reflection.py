"""The reflection of displacement fields at a plane, as a matrix over the degrees of freedom.

In: a finite-element model and a coordinate axis, the normal of a plane through the centre of mass.
Out: S with (S u) the field that a mirror at the plane makes of u: displacement at the mirror image
of each node by the elements' own interpolation, with the component along the normal turned round
and rotations treated as axial vectors. Exact for symmetric meshes; for others as good as the
interpolation.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.numbering import Numbering
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.mirror import fit_weights

__all__ = ["antisymmetric", "reflection"]

_SAME = 1e-6  # of the extent: nodes closer than that are each other's mirror image
_CANDIDATES = 32  # elements by centroid among which the one around a point is looked for
_CHUNK = 2000
_NEIGHBOURS = 24  # of a fit with ten coefficients
_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))  # of the middle nodes of a tetrahedron


def reflection(fe: FEMatrices, normal: int) -> csr_array:
    """(n, n) reflection at the plane through the centre of mass across axis ``normal`` (0 to 2)."""
    nodes = fe.numbering.nodes
    points = fe.mesh.points[nodes]
    images = points.copy()
    images[:, normal] = 2 * fe.center[normal] - images[:, normal]
    distance, twin = cKDTree(points).query(images)
    exact = distance <= _SAME * np.ptp(points, axis=0).max()
    rows, columns, weights = [nodes[exact]], [nodes[twin[exact]]], [np.ones(exact.sum())]
    for start in range(0, (~exact).sum(), _CHUNK):
        part = np.flatnonzero(~exact)[start : start + _CHUNK]
        found, shares = _interpolation(fe, images[part])
        rows.append(np.repeat(nodes[part], found.shape[1]))
        columns.append(found.ravel())
        weights.append(shares.ravel())
    S = _over_dofs(
        fe.numbering, normal, np.concatenate(rows), np.concatenate(columns), np.concatenate(weights)
    )
    n = fe.numbering.n
    return S if fe.follow is None else csr_array(S[:n, :n] + S[:n, n:] @ fe.follow)


def antisymmetric(M: csr_array, S: csr_array, V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Kinetic energy of the part of fields that changes its sign on reflection, and of all.

    Parameters
    ----------
    M, S : (n, n) sparse
        Mass and reflection.
    V : (n, m) float
        The fields.

    Returns
    -------
    odd, whole : (m, m) float
        Quadratic forms over the fields; whole is the sum for both parts, V^T M V where the mesh is
        symmetric.
    """
    image = S @ V
    odd, even = 0.5 * (V - image), 0.5 * (V + image)
    lost = odd.T @ (M @ odd)
    return lost, lost + even.T @ (M @ even)


def _over_dofs(
    numbering: Numbering, normal: int, rows: IntArray, columns: IntArray, weights: FloatArray
) -> csr_array:
    """From weights between nodes to those between degrees of freedom, with their signs."""
    entries = []
    for c in range(6):
        sign = -1.0 if (c == normal or (c >= 3 and c - 3 != normal)) else 1.0
        i, j = numbering.table[rows, c], numbering.table[columns, c]
        there = (i >= 0) & (j >= 0)
        entries.append((i[there], j[there], sign * weights[there]))
    i, j, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    return csr_array(coo_array((values, (i, j)), shape=(numbering.n_all,) * 2))


def _interpolation(fe: FEMatrices, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Nodes (r, k) and their weights in the field at places (r, 3).

    By the element around the place where that is a tetrahedron or a beam, else by a quadratic fit
    through the nearest nodes.
    """
    nodes = np.full((len(at), _NEIGHBOURS), fe.numbering.nodes[0])
    weights = np.zeros((len(at), _NEIGHBOURS))
    best = np.full(len(at), np.inf)
    others = False
    for block in fe.blocks:
        shapes = _SHAPES.get(block.kind)
        if shapes is None:
            others = True
            continue
        chosen, N, distance = shapes(fe.mesh.points, block.nodes, at)
        closer, width = distance < best, block.nodes.shape[1]
        nodes[closer], weights[closer] = fe.numbering.nodes[0], 0.0
        nodes[closer, :width], weights[closer, :width] = block.nodes[chosen[closer]], N[closer]
        best = np.minimum(best, distance)
    if others:
        extent = np.ptp(fe.mesh.points, axis=0).max()
        outside = np.flatnonzero(best > _SAME * extent)
        nodes[outside], weights[outside] = _fitted(fe, at[outside])
    return nodes, weights


def _fitted(fe: FEMatrices, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """The nearest nodes (r, k) of places (r, 3), and their weights in a quadratic fit."""
    carrying = fe.numbering.nodes
    points = fe.mesh.points[carrying]
    count = min(_NEIGHBOURS, len(points))
    near = cKDTree(points).query(at, count)[1].reshape(len(at), count)
    nodes = np.full((len(at), _NEIGHBOURS), carrying[0])
    weights = np.zeros((len(at), _NEIGHBOURS))
    nodes[:, :count], weights[:, :count] = carrying[near], fit_weights(points[near], at)
    return nodes, weights


def _in_tets(
    points: FloatArray, tets: IntArray, at: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The tetrahedron around each place, its ten shape functions there, and how far it is."""
    corners = points[tets[:, :4]]
    count = min(_CANDIDATES, len(tets))
    near = cKDTree(corners.mean(axis=1)).query(at, count)[1].reshape(len(at), count)
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    arms = at[:, None] - corners[near, 0]
    local = np.linalg.solve(edges[near], arms[..., None])[..., 0]
    L = np.concatenate([1 - local.sum(axis=2, keepdims=True), local], axis=2)
    chosen = L.min(axis=2).argmax(axis=1)
    row = np.arange(len(at))
    L = np.clip(L[row, chosen], 0.0, None)  # a curved side lies beside the straight one
    L /= L.sum(axis=1, keepdims=True)
    element = near[row, chosen]
    place = np.einsum("rk,rkc->rc", L, corners[element])
    N = [L[:, k] * (2 * L[:, k] - 1) for k in range(4)] + [4 * L[:, a] * L[:, b] for a, b in _EDGES]
    return element, np.stack(N, axis=1), np.linalg.norm(place - at, axis=1)


def _on_lines(
    points: FloatArray, lines: IntArray, at: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The line element nearest to each place, its two linear shares there, and how far it is."""
    ends = points[lines]
    count = min(_CANDIDATES, len(lines))
    near = cKDTree(ends.mean(axis=1)).query(at, count)[1].reshape(len(at), count)
    start, along = ends[near, 0], ends[near, 1] - ends[near, 0]
    share = np.sum((at[:, None] - start) * along, axis=2) / np.sum(along**2, axis=2)
    share = np.clip(share, 0.0, 1.0)
    gap = np.linalg.norm(at[:, None] - start - share[..., None] * along, axis=2)
    row, chosen = np.arange(len(at)), gap.argmin(axis=1)
    x = share[row, chosen]
    return near[row, chosen], np.stack([1 - x, x], axis=1), gap[row, chosen]


_SHAPES = {"tetra10": _in_tets, "line": _on_lines}
