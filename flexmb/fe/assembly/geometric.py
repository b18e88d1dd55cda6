"""Geometric stiffness of a model: how its stress stiffens or softens it.

In: a model and the displacements that cause the stress. Out: the sparse matrix K_g; the stiffness
under that stress is K + K_g. Source: Zienkiewicz, Taylor, The Finite Element Method, vol. 2.
"""

from __future__ import annotations

from scipy.sparse import csr_array

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.scatter import Accumulator
from flexmb.flexbody.arrays import FloatArray

__all__ = ["geometric_stiffness"]


def geometric_stiffness(
    fe: FEMatrices, u: FloatArray, field: FloatArray | None = None
) -> csr_array:
    """(n, n) geometric stiffness.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    u : (n,) float
        Displacements of a linear static solution, all independent degrees of freedom [m, rad].
    field : (3, 4) float, optional
        [G, g] where a force per mass G s + g at s [m] acts all over the body: beams take from it
        how their axial force varies along an element.
    """
    everywhere = fe.expand(u)
    total = Accumulator(fe.numbering.n_all)
    for block in fe.blocks:
        family, width = block.family, 6 if block.family.rotations else 3
        for nodes in block.chunks():
            dofs = fe.numbering.of(nodes, width)
            given = (fe.mesh.points[nodes], block.section, everywhere[dofs])
            if family.dimension == 1 and field is not None:
                total.add(family.geometric_stiffness(*given, field), dofs)
            else:
                total.add(family.geometric_stiffness(*given), dofs)
    return fe.condensed(total.matrix())
