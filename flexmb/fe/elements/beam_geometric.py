"""Geometric stiffness of beams: what the stress in them does to their stiffness.

In: fields and section forces. Out: (ne, 12, 12) matrices on the local degrees of freedom. It is the
integral over the volume of sigma_ij u_k,i u_k,j with the stresses that N, Vy, Vz, T, My, Mz cause
and the kinematics of the section, the same as for solids: with N alone N (u'^2 + V'^2 + W'^2) + N
I_p/A phi'^2. Moments vary linearly along the element. Third moments of the section (Wagner's
constants) are left out; a torque acts half by each shear stress, as in Saint-Venant torsion.
Source: Yang, Kuo, Theory and Analysis of Nonlinear Framed Structures, section 5.5.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.elements.beam_fields import BeamFields
from flexmb.flexbody.arrays import FloatArray

__all__ = ["geometric_products"]


def geometric_products(
    fields: BeamFields, forces: FloatArray, axial: FloatArray | float = 0.0
) -> FloatArray:
    """(ne, 12, 12) geometric stiffness.

    Parameters
    ----------
    fields : BeamFields
        The elements.
    forces : (ne, 2, 6) float
        Section forces at both ends.
    axial : (ne, points) float
        What is added to N along the elements.
    """
    along = (1 - fields.t)[:, None] * forces[:, :1] + fields.t[:, None] * forces[:, 1:]
    N, Vy, Vz, T, My, Mz = np.moveaxis(along, 2, 0)
    N = N + axial
    A, Iy, Iz = (fields.values[name] for name in ("A", "Iy", "Iz"))
    squares = (
        (N, fields.u_x),
        (N, fields.V_x),
        (N, fields.W_x),
        (N * (Iy + Iz) / A, fields.phi_x),
        (N * Iz / A, fields.B_x),
        (N * Iy / A, fields.C_x),
    )
    K = sum(fields.product(weight, row, row) for weight, row in squares)
    pairs = (
        (2 * Mz, fields.u_x, fields.B_x),
        (-2 * My, fields.u_x, fields.C_x),
        (-2 * My, fields.V_x, fields.phi_x),
        (-2 * Mz, fields.W_x, fields.phi_x),
        (-2 * Vy, fields.u_x, fields.B),
        (2 * Vy, fields.W_x, fields.phi),
        (-2 * Vz, fields.u_x, fields.C),
        (-2 * Vz, fields.V_x, fields.phi),
        (T, fields.C, fields.B_x),
        (-T, fields.B, fields.C_x),
    )
    for weight, left, right in pairs:
        product = fields.product(0.5 * weight, left, right)
        K = K + product + product.transpose(0, 2, 1)
    return np.asarray(K)
