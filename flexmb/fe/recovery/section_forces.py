"""Section forces of beams: N, Vy, Vz, T, My, Mz along every element.

In: a model with beams, and motions of its degrees of freedom: modes, or one solution. Out: the
forces and moments by which the side of larger x acts on the other across the section, in the
element's principal axes: N, My, Mz at the centroid, T about the shear centre. They balance the
forces of the nodes; between the ends they are linear, which is exact where no load acts along the
element.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.elements.beam import FORCES, section_forces
from flexmb.fe.elements.beam_fields import BeamFields
from flexmb.fe.elements.select import Block
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["FORCES", "SectionForces", "section_force_modes"]

_CHUNK = 1000  # elements at once


@dataclass(frozen=True, eq=False)
class SectionForces:
    """Section forces of all beam elements per unit of each motion.

    Parameters
    ----------
    nodes : (ne, 2) int
        Mesh nodes of the elements.
    groups : tuple of str
        Group of each element.
    axes : (ne, 3, 3) float
        Principal axes x, y, z of each element as columns, body frame.
    ends : (ne, 2, 6, m) float
        N, Vy, Vz [N], T, My, Mz [N m] at both ends for each of m motions.
    """

    nodes: IntArray
    groups: tuple[str, ...]
    axes: FloatArray
    ends: FloatArray

    def at(self, motion: FloatArray, stations: Sequence[float] = (0.0, 0.5, 1.0)) -> FloatArray:
        """(ne, stations, 6) section forces.

        Parameters
        ----------
        motion : (m,) float
            Amount of each motion, such as modal coordinates.
        stations : sequence of float
            Fractions of the element's length, 0 at its first node.
        """
        forces, t = self.ends @ np.asarray(motion, dtype=float), np.asarray(stations)[:, None]
        return (1 - t) * forces[:, :1] + t * forces[:, 1:]


def section_force_modes(fe: FEMatrices, V: FloatArray) -> SectionForces:
    """Section forces per unit of each column of ``V``.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    V : (n, m) or (n,) float
        Motions of the independent degrees of freedom: modes, or one solution.
    """
    every = fe.expand(V.reshape(len(V), -1))
    nodes, groups, axes, ends = [np.zeros((0, 2), dtype=int)], [], [np.zeros((0, 3, 3))], []
    for block, part in _beams(fe):
        fields = BeamFields(fe.mesh.points[part], block.section)
        u = every[fe.numbering.of(part, 6)]
        nodes.append(part)
        groups += [block.group] * len(part)
        axes.append(fields.axes)
        ends.append(np.einsum("enci,eim->encm", section_forces(fields), u))
    none = np.zeros((0, 2, len(FORCES), every.shape[1]))
    found = np.concatenate([none, *ends])
    return SectionForces(np.concatenate(nodes), tuple(groups), np.concatenate(axes), found)


def _beams(fe: FEMatrices) -> Iterator[tuple[Block, IntArray]]:
    for block in fe.blocks:
        if block.family.dimension == 1:
            for start in range(0, len(block.nodes), _CHUNK):
                yield block, block.nodes[start : start + _CHUNK]
