"""Stiffness, geometric stiffness and stress of flat shells.

In: corners (ne, k, 3) [m], a shell section with its materials. Out: batches over the 6k motions of
the nodes, body axes. Membrane and bending share the quadratic interpolation of
:mod:`flexmb.fe.elements.shell_fields` and may be coupled; transverse shear is interpolated from the
edges; nodal rotations about the normal are held to the rotation of the mid-surface by a penalty.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.elements.shell_fields import make_fields, make_points
from flexmb.fe.elements.shell_reference import extrapolation, reference
from flexmb.fe.sections.shell import ShellSection
from flexmb.flexbody.arrays import FloatArray

__all__ = ["geometric_stiffness", "stiffness", "stress"]

DRILLING = 0.3
"""Stiffness against drilling, as a share of the in-plane shear stiffness: 1e-6 to 1 do alike."""


def stiffness(kind: str, x: FloatArray, section: ShellSection) -> FloatArray:
    """(ne, d, d) stiffness."""
    fields = make_fields(kind, x, section)
    points = make_points(fields.flat, reference(kind, "stiffness"))
    K = _product(points.strains(fields), section.laminate.ABD, points.area)
    if section.shear:
        K += _product(points.shear_strains(fields), section.laminate.S, points.area)
    hold = DRILLING * section.laminate.ABD[2, 2] * points.area.sum(axis=1)
    K += (hold[:, None] * fields.drill)[:, :, None] * fields.drill[:, None, :]
    return 0.5 * (K + K.transpose(0, 2, 1))


def geometric_stiffness(
    kind: str, x: FloatArray, section: ShellSection, u: FloatArray
) -> FloatArray:
    """(ne, d, d) int N_ab u_c,a u_c,b over the three displacements c of the mid-surface.

    N are the membrane forces that the displacements ``u`` (ne, d) cause. Bending moments do not
    contribute: their second-order work depends on how rotations are composed.
    """
    fields = make_fields(kind, x, section)
    points = make_points(fields.flat, reference(kind, "mass"))
    ne, nq = points.area.shape
    strains = np.einsum("eqid,ed->eqi", points.strains(fields), u)
    N = (strains @ section.laminate.ABD[:3].T) * points.area[..., None]
    H = points.gradients(fields)[:, :, :, :3]
    forces = N[..., [[0, 2], [2, 1]]]
    NH = np.matmul(forces, H.reshape(ne, nq, 2, -1)).reshape(ne, nq * 6, -1)
    K = np.matmul(H.reshape(ne, nq * 6, -1).transpose(0, 2, 1), NH)
    return 0.5 * (K + K.transpose(0, 2, 1))


def stress(kind: str, x: FloatArray, section: ShellSection) -> FloatArray:
    """(ne, k, 2, 6, d) stress at the corners of the bottom and of the top face, body axes.

    Strains are taken at the points of the quadrature of order 2, where they are best, and carried
    on to the corners. Transverse shear stress vanishes on the faces.
    """
    fields = make_fields(kind, x, section)
    strains = make_points(fields.flat, reference(kind, "sampling")).strains(fields)
    ne, nq, _, d = strains.shape
    at_corners = np.matmul(extrapolation(kind), strains.reshape(ne, nq, -1)).reshape(ne, -1, 6, d)
    laminate = section.laminate
    faces = np.stack(
        [np.hstack([C, z * C]) for C, z in zip(laminate.outer, laminate.z, strict=True)]
    )
    to_body = np.matmul(_stress_axes(fields.flat.axes)[:, None], faces)  # (ne, 2, 6, 6)
    found = np.matmul(to_body.reshape(ne, 1, 12, 6), at_corners)
    return found.reshape(ne, -1, 2, 6, d)


def _product(rows: FloatArray, elasticity: FloatArray, weight: FloatArray) -> FloatArray:
    """(ne, d, d) sum over the points of weight rows^T elasticity rows."""
    ne, _, _, d = rows.shape
    forces = np.matmul(elasticity, rows) * weight[..., None, None]
    return np.matmul(rows.reshape(ne, -1, d).transpose(0, 2, 1), forces.reshape(ne, -1, d))


def _stress_axes(axes: FloatArray) -> FloatArray:
    """(ne, 6, 3) stress in body axes per stress 11, 22, 12 in element axes."""
    a, b = [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]
    e1, e2 = axes[:, :, 0], axes[:, :, 1]
    mixed = e1[:, a] * e2[:, b] + e2[:, a] * e1[:, b]
    return np.stack([e1[:, a] * e1[:, b], e2[:, a] * e2[:, b], mixed], axis=2)
