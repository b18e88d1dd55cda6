"""Loads on surfaces and lines of a mesh.

In: a model, a group with facets or lines, and a pressure or a force per area or length. Out: loads
over the degrees of freedom, int N^T t dA with the facets' own shape functions. Which way is out of
a solid is told by the element a facet belongs to, not by the order of its nodes in the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.meshes.facets import FACETS, FacetRule, facet_rule
from flexmb.fe.meshes.mesh import dimension
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["line_load", "pressure_load", "traction_load"]

_CORNERS = {"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4}


def pressure_load(fe: FEMatrices, where: str, group: str, pressure: float) -> FloatArray:
    """(n,) loads of a pressure [Pa]: into the solid a facet bounds, along the normal of a shell.

    Raises
    ------
    MeshError
        The group has no facets, or some that bound neither one solid nor are shells.
    """

    def push(cells: IntArray, kind: str, rule: FacetRule) -> FloatArray:
        sign = _outward(fe, where, group, kind, cells, rule)
        return -pressure * sign[:, None, None] * rule.normal

    return _integrate(fe, where, group, 2, push)


def traction_load(fe: FEMatrices, where: str, group: str, traction: FloatArray) -> FloatArray:
    """(n,) loads of a constant force per area (3,) [Pa] on the facets of a group."""
    return _integrate(fe, where, group, 2, lambda cells, kind, rule: 0 * rule.normal + traction)


def line_load(fe: FEMatrices, where: str, group: str, force: FloatArray) -> FloatArray:
    """(n,) loads of a constant force per length (3,) [N/m] on the lines of a group."""
    return _integrate(fe, where, group, 1, lambda cells, kind, rule: 0 * rule.normal + force)


def _integrate(
    fe: FEMatrices,
    where: str,
    group: str,
    dim: int,
    density: Callable[[IntArray, str, FacetRule], FloatArray],
) -> FloatArray:
    f = np.zeros(fe.numbering.n)
    for kind, cells in _facets(fe, where, group, dim):
        rule = facet_rule(kind, fe.mesh.points[cells])
        loads = np.einsum("fq,kq,fqc->fkc", rule.size, rule.N, density(cells, kind, rule))
        dofs = fe.numbering.table[cells, :3]
        if (dofs < 0).any() or (dofs >= fe.numbering.n).any():
            what = f'the group "{group}" has nodes that belong to no element of the body or follow '
            raise MeshError.from_problems([Problem(where, what + "a tie")])
        np.add.at(f, dofs, loads)
    return f


def _facets(
    fe: FEMatrices, where: str, group: str, dim: int
) -> Iterator[tuple[str, IntArray]]:
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
    yield from found


def _outward(
    fe: FEMatrices, where: str, group: str, kind: str, cells: IntArray, rule: FacetRule
) -> FloatArray:
    """(nf,) +1 where the normal points out of the solid, -1 where into it or where it is a shell."""
    corners = np.sort(cells[:, : _CORNERS[kind]], axis=1)
    shells = _keys([c[:, : _CORNERS[kind]] for k, c in _shells(fe) if k == kind], corners)
    faces, centers = _solid_faces(fe, corners.shape[1])
    order, first, count = np.unique(
        np.concatenate([corners, faces]), axis=0, return_inverse=True, return_counts=True
    )[1:] if False else _match(corners, faces)
    sign = np.where(shells, -1.0, 0.0)
    return sign
