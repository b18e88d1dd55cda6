"""Beams in results: section forces at their ends, and their drawn bodies.

In: the model, its modes, the motion of its nodes. Out: :class:`SectionForceModes`, and the sections
extruded along the beams, whose corners turn with the nodes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.elements.beam import section_forces
from flexmb.fe.elements.beam_fields import BeamFields
from flexmb.fe.elements.select import Block
from flexmb.fe.recovery.smooth import smooth_parts
from flexmb.fe.sections.outline import outline
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.parts import NodeModes
from flexmb.flexbody.recovery import SectionForceModes

__all__ = ["Extruded", "extruded_beams", "section_force_modes"]


class Extruded(NamedTuple):
    """The drawn surface of all beams."""

    points: FloatArray  # (n, 3) [m]
    faces: IntArray  # (t, 3)
    modes: FloatArray  # (n, 3, m) displacement per unit modal coordinate [m]
    node_ids: IntArray  # (n,) mesh node of each point


def section_force_modes(fe: FEMatrices, Phi: FloatArray) -> SectionForceModes | None:
    """Section forces of all beams per unit modal coordinate; None without beams.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    Phi : (n, m) float
        Modes.
    """
    U, found = fe.expand(Phi), []
    for block in _beams(fe):
        fields = BeamFields(fe.mesh.points[block.nodes], block.section)
        forces = section_forces(fields).reshape(-1, 12, 12) @ U[fe.numbering.of(block.nodes, 6)]
        found.append((block.nodes, fields.axes, forces.reshape(-1, 2, 6, U.shape[1])))
    if not found:
        return None
    return SectionForceModes(*(np.concatenate(part) for part in zip(*found, strict=True)))


def extruded_beams(fe: FEMatrices, nodes: NodeModes) -> Extruded:
    """The sections of all beams extruded along them.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    nodes : NodeModes
        Motion of its nodes, rotations included.
    """
    groups: dict[str, list[Block]] = {}
    for block in _beams(fe):
        groups.setdefault(block.group, []).append(block)
    corners, faces, owners, count = [np.zeros((0, 3))], [np.zeros((0, 3), int)], [], 0
    for blocks in groups.values():
        smooth = smooth_parts(blocks, fe.mesh.points)
        rings, ends, tri = _extruded(fe, blocks, smooth)
        corners.append(rings.reshape(-1, 3))
        faces.append(tri + count)
        owners.append(np.repeat(ends, rings.shape[1]))
        count += rings.shape[0] * rings.shape[1]
    node_ids = np.concatenate([np.zeros(0, dtype=np.int64), *owners])
    points = np.concatenate(corners)
    rows = np.searchsorted(nodes.ids, node_ids)
    assert nodes.Phi_r is not None  # beams turn
    arms = (points - nodes.position[rows])[:, :, None]
    modes = nodes.Phi_t[rows] + np.cross(nodes.Phi_r[rows], arms, axis=1)
    return Extruded(points, np.concatenate(faces), modes, node_ids)


def _beams(fe: FEMatrices) -> list[Block]:
    return [block for block in fe.blocks if block.family.dimension == 1]


def _extruded(
    fe: FEMatrices, blocks: list[Block], smooth: list[IntArray]
) -> tuple[FloatArray, IntArray, IntArray]:
    """Rings of corners (r, p, 3) and their nodes (r,), and triangles between and across them.

    Elements that go on into each other share the ring at their node.
    """
    pieces = [len(part) for part in outline(_end_sections(blocks[0], fe)[0][0])]
    keys, corners = [], []
    for block, part in zip(blocks, smooth, strict=True):
        keys.append(np.stack([block.nodes, np.repeat(part[:, None], 2, axis=1)], axis=2))
        corners.append(_corners(fe, block))
    places, ring = np.unique(np.concatenate(keys).reshape(-1, 2), axis=0, return_inverse=True)
    count = np.bincount(ring.ravel(), minlength=len(places))
    rings = np.zeros((len(places), sum(pieces), 3))
    np.add.at(rings, ring.ravel(), np.concatenate(corners).reshape(-1, sum(pieces), 3))
    rings /= count[:, None, None]
    ends = ring.reshape(-1, 2)
    faces, at = [], 0
    for size in pieces:
        faces.append(_sides(ends, size, at, sum(pieces)))
        for side in (0, 1):
            single = ends[count[ends[:, side]] == 1, side]
            faces.append(_caps(single, size, at, sum(pieces), outwards=side == 1))
        at += size
    return rings, places[:, 0], np.concatenate(faces)


def _corners(fe: FEMatrices, block: Block) -> FloatArray:
    """(ne, 2, p, 3) corners of the sections at both ends of each element."""
    fields = BeamFields(fe.mesh.points[block.nodes], block.section)
    ne = len(block.nodes)
    flat = np.array(
        [[np.concatenate(outline(part)) for part in row] for row in fields.end_sections(ne)]
    )
    flat = np.broadcast_to(flat, (ne, *flat.shape[1:]))
    return fields.ends[:, :, None] + np.einsum("eac,enpc->enpa", fields.axes[:, :, 1:], flat)


def _end_sections(block: Block, fe: FEMatrices) -> list[list[object]]:
    fields = BeamFields(fe.mesh.points[block.nodes], block.section)
    return fields.end_sections(len(block.nodes))


def _sides(ends: IntArray, size: int, at: int, width: int) -> IntArray:
    """Triangles between the polygons of ``size`` corners at both ends of each element."""
    here = at + np.arange(size)
    there = at + (np.arange(size) + 1) % size
    a, b = ends[:, :1] * width, ends[:, 1:] * width
    one = np.stack([a + here, a + there, b + there], axis=2)
    two = np.stack([a + here, b + there, b + here], axis=2)
    return np.concatenate([one, two]).reshape(-1, 3)


def _caps(rings: IntArray, size: int, at: int, width: int, outwards: bool) -> IntArray:
    """Triangles across convex polygons, normal along the beam (``outwards``) or against it."""
    fan = np.stack([np.zeros(size - 2, dtype=np.int64), *np.add.outer((1, 2), np.arange(size - 2))])
    fan = fan.T if outwards else fan.T[:, ::-1]
    return (rings[:, None, None] * width + at + fan).reshape(-1, 3)
