"""Displacement fields of flat shells with six motions a node, of all elements at once.

In: corners (ne, k, 3) [m] and a shell section. Out: :class:`Fields`: in element axes, the
displacement of the mid-surface, the rotation of its normal (beta_x, beta_y: a point at height z
moves by u + z beta) and the edge shear strains, as rows over the d = 6k motions of the nodes in
body axes. Nodes are tied rigidly to the mid-surface, over the offset and the warp.

Along an edge from i to j of length L, tangent s, with g = (w_j - w_i)/L + (beta_s,i + beta_s,j)/2
and phi = 12 D_ss/(S_ss L^2), the mid-side has beta_s = mean - 3/2 g/(1+phi), w = mean -
L/8 (beta_s,i - beta_s,j), and moves in the plane by mean + L/8 (theta_z,i - theta_z,j) (z x s);
the shear strain along the edge is phi/(1+phi) g. Sources: Katili (1993), Int. J. Numer. Meth. Eng.
36, 1859 and 1885 (DKMQ, DKMT; DKQ and DKT for phi = 0); Allman (1984), Computers & Structures 19, 1
and Cook (1986), Int. J. Numer. Meth. Eng. 23, 1347 (membrane).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.fe.elements.shell_axes import Flat, flatten
from flexmb.fe.elements.shell_reference import EDGES, Reference, reference
from flexmb.fe.sections.shell import ShellSection
from flexmb.flexbody.arrays import FloatArray

__all__ = ["Fields", "Points", "make_fields", "make_points"]

_LINEAR = {"triangle": 0.1**0.5, "quad": 1.0}
"""Triangles keep a tenth of the energy of the linear part: with all of it curved meshes lock."""


@dataclass(frozen=True, eq=False)
class Fields:
    """Fields of elements of one kind; n = 2k corner and mid-side nodes.

    Parameters
    ----------
    flat : Flat
        The elements in their mean planes.
    nodal : (ne, n, 5, d) float
        u_x, u_y, w, beta_x, beta_y of the mid-surface at the nodes.
    shear : (ne, k, d) float
        Line integrals of the transverse shear strain along the edges [m].
    drill : (ne, d) float
        Mean rotation of the nodes about the normal less that of the mid-surface at the centre.
    length, tangent : (ne, k), (ne, k, 2) float
        Of the edges.
    linear : float
        Share of the linear part of the membrane strain that is kept.
    """

    flat: Flat
    nodal: FloatArray
    shear: FloatArray
    drill: FloatArray
    length: FloatArray
    tangent: FloatArray
    linear: float


@dataclass(frozen=True, eq=False)
class Points:
    """Functions of the elements at nq points.

    Parameters
    ----------
    area : (ne, nq) float
        Weight of each point [m^2].
    values : (nq, n) float
        Quadratic functions.
    slopes : (ne, nq, 2, n) float
        Their derivatives in element axes.
    edge : (ne, nq, 2, k) float
        Edge functions in element axes.
    """

    area: FloatArray
    values: FloatArray
    slopes: FloatArray
    edge: FloatArray

    def gradients(self, fields: Fields) -> FloatArray:
        """(ne, nq, 2, 5, d) derivatives of the five fields along axes 1 and 2."""
        ne, nq, _, n = self.slopes.shape
        flat = fields.nodal.reshape(ne, n, -1)
        return np.matmul(self.slopes.reshape(ne, -1, n), flat).reshape(ne, nq, 2, 5, -1)

    def strains(self, fields: Fields) -> FloatArray:
        """(ne, nq, 6, d) membrane strains and curvatures xx, yy, xy."""
        H = self.gradients(fields)
        rows = (H[:, :, 0, 0], H[:, :, 1, 1], H[:, :, 1, 0] + H[:, :, 0, 1])
        bent = (H[:, :, 0, 3], H[:, :, 1, 4], H[:, :, 1, 3] + H[:, :, 0, 4])
        found = np.stack([*rows, *bent], axis=2)
        if fields.linear < 1:
            membrane = found[:, :, :3]
            mean = np.einsum("eq,eqid->eid", self.area, membrane)[:, None]
            mean /= self.area.sum(axis=1)[:, None, None, None]
            found[:, :, :3] = mean + fields.linear * (membrane - mean)
        return found

    def shear_strains(self, fields: Fields) -> FloatArray:
        """(ne, nq, 2, d) transverse shear strains xz, yz."""
        return np.matmul(self.edge, fields.shear[:, None])


def make_points(flat: Flat, at: Reference) -> Points:
    """Map functions of the reference element to the elements."""
    J = np.matmul(at.corner_slopes, flat.xy[:, None])  # (ne, nq, 2, 2): slope of coordinate c
    det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
    inverse = np.empty_like(J)
    inverse[..., 0, 0], inverse[..., 1, 1] = J[..., 1, 1] / det, J[..., 0, 0] / det
    inverse[..., 0, 1], inverse[..., 1, 0] = -J[..., 0, 1] / det, -J[..., 1, 0] / det
    slopes, edge = np.matmul(inverse, at.slopes), np.matmul(inverse, at.edge)
    return Points(det * at.weights, at.values, slopes, edge)


def make_fields(kind: str, x: FloatArray, section: ShellSection) -> Fields:
    """Fields of elements with corners ``x``.

    Raises
    ------
    MeshError
        The section's orientation is normal to an element, or an element is warped too much.
    """
    flat = flatten(x, section.orientation)
    start, end = (list(nodes) for nodes in zip(*EDGES[kind], strict=True))
    corner = _corner_fields(flat, section.offset)
    along = flat.xy[:, end] - flat.xy[:, start]
    length = np.linalg.norm(along, axis=2)
    tangent = along / length[..., None]
    phi = _shear_numbers(section, length, tangent)[..., None]
    L, sx, sy = length[..., None], tangent[..., :1], tangent[..., 1:]

    first, last = corner[:, start], corner[:, end]
    middle = 0.5 * (first + last)[:, :, :5]
    slope_i, slope_j = (sx * f[:, :, 3] + sy * f[:, :, 4] for f in (first, last))
    g = (last[:, :, 2] - first[:, :, 2]) / L + 0.5 * (slope_i + slope_j)
    turn = L / 8 * (first[:, :, 5] - last[:, :, 5])
    bow = -1.5 * g / (1 + phi)
    middle[:, :, 0] -= sy * turn
    middle[:, :, 1] += sx * turn
    middle[:, :, 2] -= L / 8 * (slope_i - slope_j)
    middle[:, :, 3] += sx * bow
    middle[:, :, 4] += sy * bow

    nodal = np.concatenate([corner[:, :, :5], middle], axis=1)
    slopes = make_points(flat, reference(kind, "center")).slopes[:, 0]
    spin = 0.5 * (
        np.einsum("en,end->ed", slopes[:, 0], nodal[:, :, 1])
        - np.einsum("en,end->ed", slopes[:, 1], nodal[:, :, 0])
    )
    drill = corner[:, :, 5].mean(axis=1) - spin
    return Fields(flat, nodal, phi / (1 + phi) * L * g, drill, length, tangent, _LINEAR[kind])


def _corner_fields(flat: Flat, offset: float) -> FloatArray:
    """(ne, k, 6, d) u_x, u_y, w, beta_x, beta_y, theta_z of the mid-surface at the corners."""
    ne, k = flat.height.shape
    local = flat.axes.transpose(0, 2, 1)
    out = np.zeros((ne, k, 6, k, 6))
    for i in range(k):
        arm = (offset - flat.height[:, i])[:, None]
        out[:, i, :3, i, :3] = local
        out[:, i, 3, i, 3:] = local[:, 1]  # beta_x = theta_y, beta_y = -theta_x
        out[:, i, 4, i, 3:] = -local[:, 0]
        out[:, i, 5, i, 3:] = local[:, 2]
        out[:, i, 0, i, 3:] = arm * local[:, 1]
        out[:, i, 1, i, 3:] = -arm * local[:, 0]
    return out.reshape(ne, k, 6, 6 * k)


def _shear_numbers(section: ShellSection, length: FloatArray, tangent: FloatArray) -> FloatArray:
    """(ne, k) phi = 12 D_ss/(S_ss L^2) of the edges."""
    if not section.shear:
        return np.zeros_like(length)
    c, s = tangent[..., 0], tangent[..., 1]
    bent = np.stack([c * c, s * s, 2 * c * s], axis=2)
    D = np.einsum("eki,ij,ekj->ek", bent, section.laminate.bending(), bent)
    S = np.einsum("eki,ij,ekj->ek", tangent, section.laminate.S, tangent)
    return 12 * D / (S * length**2)
