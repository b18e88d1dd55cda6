"""Strains of second order: the energy of displacements whose slopes are not small beside strains.

A displacement u has the Green-Lagrange strain E = ε(u) + (∇uᵀ ∇u)/2. Strains of second order are
means over the elements: elements whose strain is linear cannot follow them from point to point, and
would lock. Of solids, which have to be a flat plate, those in its plane count, without stress
across it: elements far longer than thick cannot follow how the thickness changes as the plate
turns. Source: Bathe, Finite Element Procedures, §6.2.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.membrane_stiffness import shape_pairs

# Ratio of second moments of the nodes across and along, up to which solid elements are a plate.
_PLATE = 0.02
_PLANE, _ACROSS = [0, 1, 5], [2, 3, 4]  # strains xx yy xy, and zz yz zx
_MATRICES = 24  # (d, d) of an element, the memory that its strains of second order take


def has_second_order_strains(fe: FEMatrices) -> bool:
    """Whether a model consists of shells, and solids that are a flat plate, without ties."""
    every = [hasattr(block.family, "mean_strains") for block in fe.blocks]
    if fe.ties or not all(every) or not every:
        return False
    thin, wide, _ = _principal_axes(fe)[0]
    return thin < _PLATE * wide or all(block.family.dimension == 2 for block in fe.blocks)


def _principal_axes(fe: FEMatrices) -> tuple[FloatArray, FloatArray]:
    """Second moments (3,) of the nodes, ascending, and their axes (3, 3) as columns."""
    points = fe.mesh.points[fe.numbering.nodes]
    moments, axes = np.linalg.eigh(np.cov(points.T))
    return moments, axes


def _in_plane(
    B: FloatArray, E: FloatArray, D: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Strains of first (ne, 3, d) and second order (ne, 3, p) along the last two `axes`, and their
    elasticity (3, 3) without stress along the first."""
    R, T = axes[:, [1, 2, 0]].T, np.zeros((6, 6))
    for k, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))):
        strain = np.zeros((3, 3))
        strain[a, b] = strain[b, a] = 1.0 if a == b else 0.5
        x = R @ strain @ R.T
        T[:, k] = x[0, 0], x[1, 1], x[2, 2], 2 * x[1, 2], 2 * x[2, 0], 2 * x[0, 1]
    back = np.linalg.inv(T)
    D = back.T @ D @ back
    coupled = D[np.ix_(_PLANE, _ACROSS)]
    D = D[np.ix_(_PLANE, _PLANE)] - coupled @ np.linalg.solve(
        D[np.ix_(_ACROSS, _ACROSS)], coupled.T
    )  # fmt: skip
    return T[_PLANE] @ B, T[_PLANE] @ E, D


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
    everywhere, axes = fe.expand(shapes), _principal_axes(fe)[1]
    F, V = np.zeros((fe.numbering.n_all, len(first))), np.zeros((len(first),) * 2)
    for block in fe.blocks:
        width = 6 if block.family.rotations else 3
        for nodes in block.chunks(_MATRICES):
            dofs = fe.numbering.of(nodes, width)
            elements = (fe.mesh.points[nodes], block.section, everywhere[dofs])
            B, products, elasticity, measure = block.family.mean_strains(*elements)
            E = both * products[..., first, second]
            if block.family.dimension == 3:
                B, E, elasticity = _in_plane(B, E, elasticity, axes)
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
