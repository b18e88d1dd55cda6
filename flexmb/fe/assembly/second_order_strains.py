"""Strains of second order: the energy of displacements whose slopes are not small beside strains.

A displacement u has the Green-Lagrange strain E = ε(u) + (∇uᵀ ∇u)/2. Strains of second order are
means over the elements: elements whose strain is linear cannot follow them from point to point, and
would lock. Source: Bathe, Finite Element Procedures, §6.2.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.membrane_stiffness import shape_pairs

_MATRICES = 24  # (d, d) of an element, the memory that its strains of second order take


def has_second_order_strains(fe: FEMatrices) -> bool:
    """Whether a model consists of plates, shells and solids alone, without ties."""
    every = all(hasattr(block.family, "mean_strains") for block in fe.blocks)
    return bool(fe.blocks) and every and not fe.ties


def second_order_loads(
    fe: FEMatrices,
    shapes: FloatArray,
    interfaces: tuple[ModelInterface, ...],
    rotations: list[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Forces and energy of the second-order strains of pairs of shapes.

    Parameters
    ----------
    fe : FEMatrices
        A model with such strains.
    shapes : (n, k) float
        Displacements.
    interfaces : tuple of RigidInterface or WeightedInterface
        Of these, rigid ones move along arcs as they turn.
    rotations : list of (3, k) float
        Rotations of each interface by the shapes.

    Returns
    -------
    (n, p) float
        Loads whose work in a displacement is that of its stress at the strains of each pair.
    (p, p) float
        Energy of these strains, all nodes but those of rigid interfaces at rest.
    """
    first, second = shape_pairs(shapes.shape[1])
    both = np.where(first == second, 1.0, 2.0)
    everywhere = fe.expand(shapes)
    F, V = np.zeros((fe.numbering.n_all, len(first))), np.zeros((len(first),) * 2)
    for block in fe.blocks:
        width = 6 if block.family.rotations else 3
        for nodes in block.chunks(_MATRICES):
            dofs = fe.numbering.of(nodes, width)
            elements = (fe.mesh.points[nodes], block.section, everywhere[dofs])
            B, products, elasticity, measure = block.family.mean_strains(*elements)
            E = both * products[..., first, second]
            stress = measure[:, None, None] * (elasticity @ E)
            np.add.at(F, dofs, np.matmul(B.transpose(0, 2, 1), stress))
            V += E.reshape(-1, len(first)).T @ stress.reshape(-1, len(first))
    n = fe.numbering.n
    F = F if fe.follow is None else F[:n] + fe.follow.T @ F[n:]
    arcs = _arcs(fe, interfaces, rotations, shapes.shape[1])
    forces = np.asarray(fe.K @ arcs)
    return F + forces, V + arcs.T @ F + F.T @ arcs + arcs.T @ forces


def _arcs(
    fe: FEMatrices, interfaces: tuple[ModelInterface, ...], rotations: list[FloatArray], count: int
) -> FloatArray:
    """(n, p) displacements of second order of the nodes of rigid interfaces, by pairs of shapes.

    Rotations of an interface (3, k) per shape turn an arm s by (a x (b x s) + b x (a x s))/2, of
    which pairs of a shape with itself have half.
    """
    first, second = shape_pairs(count)
    moved = np.zeros((fe.numbering.n_all, len(first)))
    for interface, rotation in zip(interfaces, rotations, strict=True):
        if isinstance(interface, RigidInterface):
            arms = (fe.mesh.points[interface.nodes] - interface.position)[:, None]
            a, b = rotation.T[first], rotation.T[second]
            arcs = np.cross(a, np.cross(b, arms)) + np.cross(b, np.cross(a, arms))
            arcs[:, first == second] *= 0.5
            numbers, arcs = fe.numbering.table[interface.nodes, :3], arcs.transpose(0, 2, 1)
            moved[numbers[numbers >= 0]] = 0.5 * arcs[numbers >= 0]
    return moved[: fe.numbering.n]
