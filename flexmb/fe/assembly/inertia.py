"""The inertia of a finite-element model in second-moment form, before reduction.

In: scalar mass of solids, mass components of beams. Out: :class:`Inertia`, which holds the rigid
data and, over all degrees of freedom, p_b = int rho N_b, P_ab = int rho s_a N_b and M_ab = int rho
N_a^T N_b. Solids store one scalar mass matrix for all nine M_ab; elements with nodal rotations
store components.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from flexmb.fe.assembly.scatter import scatter
from flexmb.fe.elements.beam import BeamMass
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Inertia", "beam_inertia", "inertia_sum", "solid_inertia"]

Components = tuple[tuple[csr_array, ...], ...]


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass, its moments, and its products with the displacement interpolation.

    Parameters
    ----------
    mass, S1, S0
        Rigid data about the body-frame origin: kg, (3,) kg m, (3, 3) kg m^2.
    p : (3, n) float
        int rho N_b.
    P : (3, 3, n) float
        int rho s_a N_b.
    scalar : (k, k) sparse, optional
        int rho N_i N_j over the nodes whose displacement components are ``scalar_dofs`` (k, 3).
    components : 3 x 3 of (n, n) sparse, optional
        int rho N_a^T N_b of elements with nodal rotations.
    """

    mass: float
    S1: FloatArray
    S0: FloatArray
    p: FloatArray
    P: FloatArray
    scalar: csr_array | None = None
    scalar_dofs: IntArray | None = None
    components: Components | None = None

    def mass_matrix(self) -> csr_array:
        """(n, n) the mass matrix, the sum of M_bb."""
        n = self.p.shape[1]
        M = csr_array((n, n))
        if self.scalar is not None:
            entries = self.scalar.tocoo()
            for column in self.scalar_dofs.T:
                rows, columns = column[entries.row], column[entries.col]
                M = M + csr_array((entries.data, (rows, columns)), shape=(n, n))
        if self.components is not None:
            for b in range(3):
                M = M + self.components[b][b]
        return M

    def reduced_components(self, Phi: FloatArray) -> FloatArray:
        """(3, 3, m, m) Phi^T M_ab Phi for modes Phi (n, m)."""
        m = Phi.shape[1]
        Mab = np.zeros((3, 3, m, m))
        if self.scalar is not None:
            X = np.concatenate([Phi[column] for column in self.scalar_dofs.T], axis=1)
            product = X.T @ (self.scalar @ X)
            Mab += product.reshape(3, m, 3, m).transpose(0, 2, 1, 3)
        if self.components is not None:
            for a in range(3):
                for b in range(3):
                    Mab[a, b] += Phi.T @ (self.components[a][b] @ Phi)
        return 0.5 * (Mab + Mab.transpose(1, 0, 3, 2))


def solid_inertia(scalar: csr_array, dofs: IntArray, points: FloatArray, n: int) -> Inertia:
    """Inertia of isoparametric solids: s and the displacement share one interpolation.

    Parameters
    ----------
    scalar : (k, k) sparse
        int rho N_i N_j.
    dofs : (k, 3) int
        Degrees of freedom of the k nodes.
    points : (k, 3) float
        Their positions.
    n : int
        Number of degrees of freedom.
    """
    moment = scalar @ points  # int rho s_a N_i
    weight = scalar @ np.ones(len(points))
    p, P = np.zeros((3, n)), np.zeros((3, 3, n))
    for b in range(3):
        p[b, dofs[:, b]] = weight
        P[:, b, dofs[:, b]] = moment.T
    S0 = points.T @ moment
    return Inertia(weight.sum(), moment.sum(axis=0), 0.5 * (S0 + S0.T), p, P, scalar, dofs)


def beam_inertia(elements: BeamMass, dofs: IntArray, n: int) -> Inertia:
    """Inertia of beams from their mass components; ``dofs`` (ne, 12)."""
    components = tuple(
        tuple(scatter(elements.Mab[:, a, b], dofs, n) for b in range(3)) for a in range(3)
    )
    p, P = np.zeros((3, n)), np.zeros((3, 3, n))
    for a in range(3):
        np.add.at(p[a], dofs, elements.p[:, a])
        for b in range(3):
            np.add.at(P[a, b], dofs, elements.P[:, a, b])
    S1, S0 = elements.S1.sum(axis=0), elements.S0.sum(axis=0)
    return Inertia(elements.mass.sum(), S1, S0, p, P, components=components)


def inertia_sum(solid: Inertia | None, beam: Inertia | None) -> Inertia:
    """Inertia of a model with solids, beams or both."""
    if solid is None or beam is None:
        found = solid or beam
        assert found is not None
        return found
    return Inertia(
        solid.mass + beam.mass,
        solid.S1 + beam.S1,
        solid.S0 + beam.S0,
        solid.p + beam.p,
        solid.P + beam.P,
        solid.scalar,
        solid.scalar_dofs,
        beam.components,
    )
