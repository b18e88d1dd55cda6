"""The centroid of a group: of its surface, else of its lines, else of its nodes.

In: a mesh and a group. Out: a point. Curved facets are integrated with their own shape functions.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.meshes.facets import FACETS, facet_rule
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["facet_moments", "group_centroid"]


def group_centroid(mesh: Mesh, group: str, nodes: IntArray) -> FloatArray:
    """(3,) area centroid of the group's facets, else the length centroid of its lines, else the
    mean of ``nodes``."""
    rows = mesh.group_elements(group)
    for dim in (2, 1):
        moments = [
            facet_moments(kind, mesh.points[mesh.blocks[kind][row]])
            for kind, row in rows.items()
            if dimension(kind) == dim and kind in FACETS and len(row)
        ]
        if moments:
            size = sum(part[0] for part in moments)
            return np.asarray(sum(part[1] for part in moments)) / size
    return mesh.points[nodes].mean(axis=0)


def facet_moments(kind: str, x: FloatArray) -> tuple[float, FloatArray]:
    """Area (or length) and its first moment (3,) of facets with node coordinates (nf, k, 3)."""
    rule = facet_rule(kind, x)
    return float(rule.size.sum()), np.einsum("fq,kq,fkc->c", rule.size, rule.N, x)
