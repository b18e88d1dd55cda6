"""The inertia of a finite-element model in second-moment form, before reduction.

In: blocks of elements and the numbering. Out: :class:`Inertia`, which holds the rigid data and,
over the degrees of freedom, p_b = int rho N_b and P_ab = int rho s_a N_b, and the mass matrix. The
products M_ab = int rho N_a^T N_b are only ever needed reduced onto modes: solids keep one scalar
mass matrix for all nine, elements with nodal rotations are gone through once more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.assembly.scatter import Accumulator
from flexmb.fe.elements.family import ComponentMass, ScalarMass
from flexmb.fe.elements.select import Block
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Inertia", "MassSum", "component_masses", "reduced_components"]

_COMPONENTS = 9  # matrices of an element at once


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
    scalar : (nodes, nodes) sparse
        int rho N_i N_j of the solids over the nodes of the mesh.
    """

    mass: float
    S1: FloatArray
    S0: FloatArray
    p: FloatArray
    P: FloatArray
    scalar: csr_array


class MassSum:
    """The mass of all blocks, summed batch by batch."""

    def __init__(self, numbering: Numbering, points: FloatArray) -> None:
        n = numbering.n_all
        self._numbering, self._points = numbering, points
        self._scalar = Accumulator(len(points))
        self._M = Accumulator(n)
        self._mass, self._S1, self._S0 = 0.0, np.zeros(3), np.zeros((3, 3))
        self._p, self._P = np.zeros((3, n)), np.zeros((3, 3, n))

    def add(self, block: Block, nodes: IntArray) -> None:
        """Add some elements of a block."""
        mass = block.family.mass(self._points[nodes], block.section)
        if isinstance(mass, ScalarMass):
            self._scalar.add(mass.M, nodes)
        else:
            self.add_components(mass, self._numbering.of(nodes, 6))

    def add_components(self, mass: ComponentMass, dofs: IntArray) -> None:
        """Add mass whose degrees of freedom have these numbers (ne, d)."""
        self._M.add(np.einsum("ebbij->eij", mass.Mab), dofs)
        for a in range(3):
            np.add.at(self._p[a], dofs, mass.p[:, a])
            for b in range(3):
                np.add.at(self._P[a, b], dofs, mass.P[:, a, b])
        self._mass += float(mass.mass.sum())
        self._S1 += mass.S1.sum(axis=0)
        self._S0 += mass.S0.sum(axis=0)

    def total(self) -> tuple[Inertia, csr_array]:
        """The inertia, and the mass matrix over all degrees of freedom."""
        scalar, points = self._scalar.matrix(), self._points
        M = self._M.matrix()
        solid = np.flatnonzero(np.diff(scalar.indptr))
        entries = scalar.tocoo()
        moment, weight = scalar @ points, scalar @ np.ones(len(points))
        for b in range(3):
            number = self._numbering.table[:, b]
            data = (entries.data, (number[entries.row], number[entries.col]))
            M = M + csr_array(data, shape=M.shape)
            self._p[b, number[solid]] += weight[solid]
            self._P[:, b, number[solid]] += moment[solid].T
        S0 = self._S0 + points.T @ moment
        found = Inertia(
            self._mass + float(weight.sum()),
            self._S1 + moment.sum(axis=0),
            0.5 * (S0 + S0.T),
            self._p,
            self._P,
            scalar,
        )
        return found, M


def component_masses(
    blocks: tuple[Block, ...], numbering: Numbering, points: FloatArray
) -> Iterator[tuple[ComponentMass, IntArray]]:
    """Mass of the elements with nodal rotations, in batches with their numbers (ne, d)."""
    for block in blocks:
        if block.family.rotations:
            for nodes in block.chunks(_COMPONENTS):
                mass = block.family.mass(points[nodes], block.section)
                assert isinstance(mass, ComponentMass)
                yield mass, numbering.of(nodes, 6)


def reduced_components(
    inertia: Inertia,
    masses: Iterator[tuple[ComponentMass, IntArray]],
    numbering: Numbering,
    Phi: FloatArray,
) -> FloatArray:
    """(3, 3, m, m) Phi^T M_ab Phi for modes Phi (n_all, m)."""
    m = Phi.shape[1]
    Mab = np.zeros((3, 3, m, m))
    solid = np.flatnonzero(np.diff(inertia.scalar.indptr))
    if len(solid):
        scalar = inertia.scalar[solid][:, solid]
        X = Phi[numbering.table[solid, :3]].reshape(len(solid), 3 * m)
        product = X.T @ (scalar @ X)
        Mab += product.reshape(3, m, 3, m).transpose(0, 2, 1, 3)
    for mass, dofs in masses:
        local = Phi[dofs]
        flat = local.reshape(-1, m)
        for a in range(3):
            for b in range(3):
                Mab[a, b] += flat.T @ np.matmul(mass.Mab[:, a, b], local).reshape(-1, m)
    return 0.5 * (Mab + Mab.transpose(1, 0, 3, 2))
