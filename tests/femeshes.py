"""Small meshes made in memory, and the plain finite-element solutions that tests compare with."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from flexmb.fe import Mesh

FACES = ((0, 1, 2, 4, 5, 6), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (0, 2, 3, 6, 9, 7))
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))  # mid-side nodes of a tetra10


def block(divisions, size=(1.0, 1.0, 1.0), distort=0.0, affine=None):
    """Box from the origin of second-order tetrahedra, with the surface groups x0 and x1.

    ``distort`` moves inner corner nodes at random by that share of an element; ``affine`` (3, 3)
    maps the points.
    """
    grid = np.indices([n + 1 for n in divisions]).reshape(3, -1).T
    number = {tuple(point): k for k, point in enumerate(grid)}
    points = grid * (np.array(size) / divisions)
    inner = ((grid > 0) & (grid < divisions)).all(axis=1)
    noise = np.random.default_rng(0).uniform(-1, 1, points.shape)
    points = points + inner[:, None] * noise * distort * np.array(size) / divisions
    tets = []
    for cell in np.ndindex(*divisions):
        for order in permutations(range(3)):
            path = [np.array(cell)]
            for axis in order:
                path.append(path[-1] + np.eye(3, dtype=int)[axis])
            tet = [number[tuple(p)] for p in path]
            volume = np.linalg.det(points[tet[1:]] - points[tet[0]])
            tets.append(tet if volume > 0 else [tet[0], tet[2], tet[1], tet[3]])
    points, tets = _with_middles(points, np.array(tets))
    faces, sets = [], {}
    for name, x in (("x0", 0.0), ("x1", size[0])):
        found = [
            [tet[k] for k in (a, b, c, d, e, f)]
            for tet in tets
            for a, b, c, d, e, f in FACES
            if np.allclose(points[[tet[a], tet[b], tet[c]], 0], x, atol=1e-12)
        ]  # fmt: skip
        sets[name] = {"triangle6": np.arange(len(faces), len(faces) + len(found))}
        faces += found
    if affine is not None:
        points = points @ np.asarray(affine).T
    return Mesh(points, {"tetra10": tets, "triangle6": np.array(faces)}, {}, sets)


def _with_middles(points, tets):
    middles, points = {}, list(points)
    full = []
    for tet in tets:
        row = list(tet)
        for a, b in EDGES:
            key = frozenset((tet[a], tet[b]))
            if key not in middles:
                middles[key] = len(points)
                points.append((points[tet[a]] + points[tet[b]]) / 2)
            row.append(middles[key])
        full.append(row)
    return np.array(points), np.array(full)


def mirrored_block(divisions=(4, 1, 1), size=(1.0, 0.2, 0.1)):
    """A block and its mirror image below the xy plane, merged: a mesh symmetric about it."""
    half = block(divisions, size)
    points = np.vstack([half.points, half.points * [1, 1, -1]])
    _, first, same = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    n = len(half.points)
    blocks = {k: same.ravel()[np.vstack([c, c + n])] for k, c in half.blocks.items()}
    faces = len(half.blocks["triangle6"])
    sets = {
        name: {"triangle6": np.concatenate([rows["triangle6"], rows["triangle6"] + faces])}
        for name, rows in half.element_sets.items()
    }
    return Mesh(points[first], blocks, {}, sets)


def line(n, start=(0.0, 0.0, 0.0), end=(1.0, 0.0, 0.0)):
    """Straight beam of n elements with the node groups root, middle and tip."""
    t = np.linspace(0, 1, n + 1)[:, None]
    points = np.array(start) * (1 - t) + np.array(end) * t
    cells = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
    sets = {"root": [0], "middle": [n // 2], "tip": [n]}
    return Mesh(points, {"line": cells}, {name: np.array(rows) for name, rows in sets.items()})


def held_frequencies(fe, dofs, count):
    """Lowest circular frequencies with these degrees of freedom held, by plain shift-invert."""
    free = np.setdiff1d(np.arange(fe.numbering.n), dofs)
    K, M = fe.K[free][:, free], fe.M[free][:, free]
    if len(free) < 500:
        values = eigh(K.toarray(), M.toarray(), eigvals_only=True)[:count]
    else:
        values = eigsh(K.tocsc(), count, M.tocsc(), sigma=0, return_eigenvectors=False)
    return np.sqrt(np.sort(values))


def tied(fe, interfaces):
    """Columns that tie the model's degrees of freedom to its interfaces: u = G (q, u_free)."""
    slaves = np.concatenate([part.dofs for part in interfaces])
    free = np.setdiff1d(np.arange(fe.numbering.n), slaves)
    G = np.zeros((fe.numbering.n, 6 * len(interfaces) + len(free)))
    for k, part in enumerate(interfaces):
        G[part.dofs, 6 * k : 6 * k + 6] = part.T
    G[free, 6 * len(interfaces) + np.arange(len(free))] = 1.0
    return G


def slope(sizes, errors):
    """Observed order of convergence over a sequence of sizes."""
    return np.polyfit(np.log(sizes), np.log(np.abs(errors)), 1)[0]


_CORNERS = {  # corners of the cells that fill a cube whose corners are numbered x + 2 y + 4 z
    "tetra": ((0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7)),
    "hexahedron": ((0, 1, 3, 2, 4, 5, 7, 6),),
    "wedge": ((0, 1, 3, 4, 5, 7), (0, 3, 2, 4, 7, 6)),
}
_HEX_SIDES = (
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
)
_HEX_FACES = ((0, 3, 4, 7), (1, 2, 5, 6), (0, 1, 4, 5), (2, 3, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7))
_BETWEEN = {  # corners whose mean each node above the corners is, VTK order
    "tetra": (),
    "tetra10": EDGES,
    "hexahedron": (),
    "hexahedron20": _HEX_SIDES,
    "hexahedron27": (*_HEX_SIDES, *_HEX_FACES, tuple(range(8))),
    "wedge15": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
}
SOLIDS = tuple(_BETWEEN)


def solid_box(kind, divisions, size=(1.0, 1.0, 1.0), distort=0.0, shape=None):
    """Box from the origin of solids of one kind, with the node groups x0, x1, y0 ... z1.

    ``distort`` moves inner corner nodes at random by that share of an element, the sides of
    elements stay straight; ``shape`` maps all points (n, 3) after that.
    """
    counts, size = np.array(divisions), np.array(size, float)
    grid = np.indices(counts + 1).reshape(3, -1).T
    inner = ((grid > 0) & (grid < counts)).all(axis=1)
    noise = np.random.default_rng(0).uniform(-1, 1, grid.shape)
    corners = (grid + inner[:, None] * noise * distort) * size / counts
    steps = np.array([1, counts[2] + 1, (counts[1] + 1) * (counts[2] + 1)])[::-1]
    first = np.indices(counts).reshape(3, -1).T @ steps
    cube = np.array([[b & 1, b >> 1 & 1, b >> 2] for b in range(8)]) @ steps
    cells = np.array(_CORNERS[kind.rstrip("0123456789")])
    rows = (first[:, None, None] + cube[cells]).reshape(-1, cells.shape[1])
    middles = [corners[rows[:, list(some)]].mean(axis=1) for some in _BETWEEN[kind]]
    x = np.concatenate([corners[rows], *(m[:, None] for m in middles)], axis=1)
    _, kept, number = np.unique(
        x.reshape(-1, 3).round(9), axis=0, return_index=True, return_inverse=True
    )
    points = x.reshape(-1, 3)[kept]
    sets = {
        f"{name}{side}": np.flatnonzero(np.abs(points[:, axis] - side * size[axis]) < 1e-9)
        for axis, name in enumerate("xyz")
        for side in (0, 1)
    }
    points = points if shape is None else shape(points)
    return Mesh(points, {kind: number.reshape(len(rows), -1)}, sets)
