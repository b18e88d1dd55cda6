"""Meshes of scikit-fem, as objects and in files that it wrote.

A mesh keeps its named boundaries and subdomains as groups. In files, which scikit-fem writes with
meshio, they are data of the elements: a subdomain is one for its elements, a boundary the numbers
of an element's facets in binary digits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from skfem import Mesh as SkfemMesh
from skfem import MeshWedge1

from flexmb.fe.elements.solid_elements import SOLIDS
from flexmb.fe.meshes.mesh import Mesh
from flexmb.flexbody.arrays import FloatArray, IntArray

_FACETS = {2: "line", 3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_PREFIX = "skfem:"


def has_skfem_groups(raw: Any) -> bool:
    """Whether a mesh of meshio has groups of scikit-fem."""
    return any(name.startswith(_PREFIX) for name in raw.cell_data)


def mesh_of_skfem_file(raw: Any, source: str) -> Mesh:
    """The mesh in a file that scikit-fem wrote, from a mesh of meshio."""
    from skfem.io.meshio import from_meshio

    is_wedge = [cells.type for cells in raw.cells] == ["wedge"]
    mesh = mesh_from_skfem(_wedges(raw) if is_wedge else from_meshio(raw))
    return replace(mesh, source=source)


def _wedges(raw: Any) -> SkfemMesh:
    """A mesh of wedges, which scikit-fem writes and does not read."""
    mesh = MeshWedge1(raw.points.T, raw.cells[0].data.T)
    bit = 1 << np.arange(len(mesh.t2f))[:, None]
    groups: dict[str, dict[str, IntArray]] = {"s": {}, "b": {}}
    for key, data in raw.cell_data.items():
        if key.startswith(_PREFIX):
            _, kind, name = key.split(":", 2)
            digits = np.asarray(data[0], dtype=np.int64)
            facets = np.unique(mesh.t2f[bit & digits > 0])
            groups[kind][name] = facets if kind == "b" else np.flatnonzero(digits)
    return mesh.with_boundaries(groups["b"]).with_subdomains(groups["s"])


def mesh_from_skfem(mesh: SkfemMesh) -> Mesh:
    """The mesh with its boundaries and subdomains as groups; 2-D meshes lie in the xy plane.

    Raises
    ------
    MeshError
        A mesh without elements that flexmb has a name for.
    """
    # importing meshio takes 0.2 s, so only where it is needed
    from skfem.io.meshio import to_meshio

    written = to_meshio(mesh)
    points = np.zeros((len(written.points), 3))
    points[:, : written.points.shape[1]] = written.points
    blocks = {cells.type: np.asarray(cells.data, dtype=np.int64) for cells in written.cells}
    return mesh_with_groups(mesh, points, blocks, np.arange(mesh.p.shape[1]))


def mesh_with_groups(
    mesh: SkfemMesh,
    points: FloatArray,
    blocks: dict[str, IntArray],
    vertices: IntArray,
    source: str = "scikit-fem mesh",
) -> Mesh:
    """The mesh with subdomains and boundaries; ``vertices`` are the nodes at its vertices."""
    kind = next(iter(blocks), "")
    groups: dict[str, dict[str, IntArray]] = {}
    for name, elements in (mesh.subdomains or {}).items():
        if kind:
            groups[str(name)] = {kind: np.asarray(elements, dtype=np.int64)}
    nodes: dict[str, IntArray] = {}
    for name, facets in (mesh.boundaries or {}).items():
        corners = vertices[mesh.facets[:, np.asarray(facets, dtype=np.int64)]].T
        faces = _faces(kind, blocks, corners)
        if faces is None:
            nodes[str(name)] = np.unique(corners)
            continue
        facet = _FACETS[faces.shape[1]]
        first = len(blocks.get(facet, ()))
        blocks[facet] = np.concatenate([blocks[facet], faces]) if first else faces
        groups[str(name)] = {facet: first + np.arange(len(faces))}
    return Mesh(points, blocks, nodes, groups, source)


def _faces(kind: str, blocks: Mapping[str, IntArray], corners: IntArray) -> IntArray | None:
    """(nf, k) nodes of the facets with these corners: corners in cyclic order, then mid-side
    nodes."""
    if corners.shape[1] == 2:
        return corners
    family = SOLIDS.get(kind)
    if corners.shape[1] < 3 or family is None:
        return None
    count = corners.shape[1]
    same = [face for face in family.faces if len(face) in (count, 2 * count, 2 * count + 1)]
    every = np.concatenate([blocks[kind][:, face] for face in same])
    keys = np.concatenate([np.sort(every[:, :count], axis=1), np.sort(corners, axis=1)])
    _, number = np.unique(keys, axis=0, return_inverse=True)
    number = number.ravel()
    row = np.full(number.max() + 1, -1)
    row[number[: len(every)]] = np.arange(len(every))
    return every[row[number[len(every) :]]]
