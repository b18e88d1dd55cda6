"""Loads on surfaces and lines of a mesh.

In: a model, a group with facets or lines, and a pressure or a force per area or length. Out: loads
over the degrees of freedom, int N^T t dA with the facets' own shape functions; what acts on nodes
that follow a tie goes to those they follow. Which way is out of a solid is told by the element a
facet bounds, not by the order of its nodes in the file.
"""

from __future__ import annotations

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.meshes.facets import FACETS, facet_rule
from flexmb.fe.meshes.mesh import dimension
from flexmb.fe.meshes.skin import outer_faces
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["condensed_load", "line_load", "pressure_load", "traction_load"]

_CORNERS = {3: 3, 4: 4, 6: 3, 8: 4, 9: 4}  # of facets with so many nodes


def pressure_load(fe: FEMatrices, where: str, group: str, pressure: float) -> FloatArray:
    """(n,) loads of a pressure [Pa]: into the solid a facet bounds, along the normal of a shell.

    Raises
    ------
    MeshError
        The group has no facets, or some that neither bound a solid of the body nor are shells.
    """
    f = np.zeros(fe.numbering.n_all)
    outside = {face.shape[1]: face for face in outer_faces(fe.blocks, fe.mesh.points)}
    missing = 0
    for kind, cells in _cells(fe, where, group, 2):
        shells = [b.nodes for b in fe.blocks if b.family.dimension == 2 and b.kind == kind]
        is_shell = _find(cells, np.concatenate(shells))[0] if shells else np.zeros(len(cells), bool)
        rest = cells[~is_shell]
        there, row = _find(rest, outside.get(cells.shape[1], rest[:0]))
        missing += int((~there).sum())
        _add(fe, f, kind, cells[is_shell], pressure)
        if there.any():
            _add(fe, f, kind, outside[cells.shape[1]][row[there]], -pressure)
    if missing:
        what = f'{missing} facets of the group "{group}" neither bound a solid of the body nor are '
        what += "shells: there is nothing to push on"
        raise MeshError.from_problems([Problem(where, what)])
    return condensed_load(fe, f)


def traction_load(fe: FEMatrices, where: str, group: str, traction: FloatArray) -> FloatArray:
    """(n,) loads of a constant force per area (3,) [Pa] on the facets of a group."""
    return _uniform(fe, where, group, 2, traction)


def line_load(fe: FEMatrices, where: str, group: str, force: FloatArray) -> FloatArray:
    """(n,) loads of a constant force per length (3,) [N/m] on the lines of a group."""
    return _uniform(fe, where, group, 1, force)


def condensed_load(fe: FEMatrices, f: FloatArray) -> FloatArray:
    """(n,) loads on the independent degrees of freedom from those on all, (n_all,)."""
    n = fe.numbering.n
    return f if fe.follow is None else f[:n] + fe.follow.T @ f[n:]


def _uniform(fe: FEMatrices, where: str, group: str, dim: int, load: FloatArray) -> FloatArray:
    f = np.zeros(fe.numbering.n_all)
    for kind, cells in _cells(fe, where, group, dim):
        if not np.isin(cells, fe.numbering.nodes).all():
            what = f'the group "{group}" has nodes that belong to no element of the body'
            raise MeshError.from_problems([Problem(where, what)])
        rule = facet_rule(kind, fe.mesh.points[cells])
        shares = np.einsum("fq,kq->fk", rule.size, rule.N)
        np.add.at(f, fe.numbering.table[cells, :3], shares[:, :, None] * load)
    return condensed_load(fe, f)


def _add(fe: FEMatrices, f: FloatArray, kind: str, cells: IntArray, pressure: float) -> None:
    """Add the loads of a pressure along the normal that the order of the nodes gives."""
    rule = facet_rule(kind, fe.mesh.points[cells])
    loads = np.einsum("fq,kq,fqc->fkc", pressure * rule.size, rule.N, rule.normal)
    np.add.at(f, fe.numbering.table[cells, :3], loads)


def _cells(fe: FEMatrices, where: str, group: str, dim: int) -> list[tuple[str, IntArray]]:
    rows = fe.mesh.group_elements(group, where)
    found = [
        (kind, fe.mesh.blocks[kind][row])
        for kind, row in rows.items()
        if dimension(kind) == dim and kind in FACETS and len(row)
    ]
    if not found:
        what = "surface elements" if dim == 2 else "line elements"
        problem = Problem(where, f'the group "{group}" has no {what} to carry the load')
        raise MeshError.from_problems([problem])
    return found


def _find(cells: IntArray, among: IntArray) -> tuple[np.ndarray, IntArray]:
    """Which facets occur in another list, whatever the order of their corners, and in which row."""
    corners = _CORNERS[cells.shape[1]]
    one, other = (np.sort(part[:, :corners], axis=1) for part in (cells, among))
    _, number = np.unique(np.concatenate([one, other]), axis=0, return_inverse=True)
    number = np.ravel(number)
    row = np.full(len(one) + len(other), -1)
    row[number[len(one) :]] = np.arange(len(other))
    found = row[number[: len(one)]]
    return found >= 0, found
