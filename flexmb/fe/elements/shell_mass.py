"""Mass of flat shells by components of the displacement, rotary inertia included.

In: corners (ne, k, 3) [m], a shell section with its materials. Out: :class:`ComponentMass`. A point
at height z over the mid-surface moves by u + z beta, u and beta quadratic: all integrals over area
and thickness are exact. Nodal rotations about the normal in excess of the rotation of the
mid-surface swirl the mid-sides around the element: without that they would have no mass where
all are equal. Rigid motions have none of it.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.elements.family import ComponentMass
from flexmb.fe.elements.shell_fields import Fields, make_fields, make_points
from flexmb.fe.elements.shell_reference import EDGES, reference
from flexmb.fe.sections.shell import ShellSection
from flexmb.flexbody.arrays import FloatArray

__all__ = ["mass"]


def mass(kind: str, x: FloatArray, section: ShellSection) -> ComponentMass:
    """Consistent mass."""
    fields = make_fields(kind, x, section)
    points = make_points(fields.flat, reference(kind, "mass"))
    ne, n = len(x), points.values.shape[1]
    products = (points.values[:, :, None] * points.values[:, None]).reshape(-1, n * n)
    area = (points.area @ products).reshape(ne, n, n)
    area = 0.5 * (area + area.transpose(0, 2, 1))
    m0, m1, m2 = section.laminate.mass
    W = np.concatenate(  # over u at the nodes, then beta
        [np.concatenate([m0 * area, m1 * area], axis=2), np.concatenate([m1 * area, m2 * area], 2)],
        axis=1,
    )
    N = _motion(fields)  # (ne, 2n, 3, d)
    s = _position(kind, fields, section.offset)  # (ne, 2n, 4)
    d = N.shape[3]
    flat = N.reshape(ne, 2 * n, 3 * d)
    weighted = np.matmul(W, flat)
    M = np.matmul(flat.transpose(0, 2, 1), weighted)
    M = 0.5 * (M + M.transpose(0, 2, 1))
    moments = np.matmul(s.transpose(0, 2, 1), weighted).reshape(ne, 4, 3, d)
    rigid = np.matmul(s.transpose(0, 2, 1), np.matmul(W, s))
    return ComponentMass(
        M.reshape(ne, 3, d, 3, d).transpose(0, 1, 3, 2, 4),
        moments[:, :3],
        moments[:, 3],
        rigid[:, 3, 3],
        rigid[:, :3, 3],
        0.5 * (rigid[:, :3, :3] + rigid[:, :3, :3].transpose(0, 2, 1)),
    )


def _motion(fields: Fields) -> FloatArray:
    """(ne, 2n, 3, d) displacement of the nodes, then rotation of the normal, along body axes."""
    ne, n, _, d = fields.nodal.shape
    k = n // 2
    local = np.zeros((ne, 2 * n, 3, d))
    local[:, :n] = fields.nodal[:, :, :3]
    swirl = (fields.length / 8)[..., None] * fields.drill[:, None]
    local[:, k:n, 0] += fields.tangent[..., :1] * swirl
    local[:, k:n, 1] += fields.tangent[..., 1:] * swirl
    local[:, n:, :2] = fields.nodal[:, :, 3:]
    return np.matmul(fields.flat.axes[:, None], local)


def _position(kind: str, fields: Fields, offset: float) -> FloatArray:
    """(ne, 2n, 4) place of the nodes and direction of the normal, each with 1 and 0 behind."""
    flat = fields.flat
    ne, k = flat.height.shape
    corners = np.concatenate([flat.xy, np.full((ne, k, 1), offset)], axis=2)
    places = flat.center[:, None] + np.matmul(corners, flat.axes.transpose(0, 2, 1))
    edges = np.array(EDGES[kind])
    out = np.zeros((ne, 4 * k, 4))
    out[:, :k, :3] = places
    out[:, k : 2 * k, :3] = places[:, edges].mean(axis=2)
    out[:, : 2 * k, 3] = 1.0
    out[:, 2 * k :, :3] = flat.axes[:, None, :, 2]
    return out
