"""From modal coordinates back to the mesh: the motion of its nodes, and the surface that is drawn.

A node without rotational degrees of freedom gets half the curl of the displacement field as its
rotation, averaged over the elements that meet there. The nodes of a rigid interface rotate with the
interface. The drawn surface consists of the skin of solids and shells and of the cross-sections of
beams extruded along them; the corners of these cross-sections follow the translation and rotation
of the nodes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import RigidInterface
from flexmb.fe.elements.beam_elements import BeamFields
from flexmb.fe.elements.element_blocks import Block, skin_lines, skin_triangles
from flexmb.fe.sections.beam_section import outline
from flexmb.fe.stress import smooth_parts
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.parts import NodeModes, Surface
from flexmb.progress import Progress, silent


class Extruded(NamedTuple):
    """The drawn surface of all beams: their cross-sections, extruded along the elements."""

    points: FloatArray  # (n, 3) [m]
    faces: IntArray  # (t, 3)
    modes: FloatArray  # (n, 3, m) displacement per unit modal coordinate [m]
    node_ids: IntArray  # (n,) mesh node that each point moves with


def extruded_beams(fe: FEMatrices, nodes: NodeModes) -> Extruded:
    """Extrude the cross-sections of all beams along their elements.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    nodes : NodeModes
        Motion of its nodes, rotations included.
    """
    groups: dict[str, list[Block]] = {}
    for block in fe.blocks:
        if block.family.dimension == 1:
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
    assert nodes.Phi_r is not None  # nodes of beams always have rotations
    arms = (points - nodes.position[rows])[:, :, None]
    modes = nodes.Phi_t[rows] + np.cross(nodes.Phi_r[rows], arms, axis=1)
    return Extruded(points, np.concatenate(faces), modes, node_ids)


def _extruded(
    fe: FEMatrices, blocks: list[Block], smooth: list[IntArray]
) -> tuple[FloatArray, IntArray, IntArray]:
    """Corners (r, p, 3) and nodes (r,) of the rings of a group of beams, and the triangles of its
    skin.

    A ring is the outline of the cross-section at a node. Elements that continue each other smoothly
    share the ring at their common node. Triangles join the rings along each element and close free
    ends.
    """
    fields = [BeamFields(fe.mesh.points[block.nodes], block.section) for block in blocks]
    pieces = [len(part) for part in outline(fields[0].end_sections(len(blocks[0].nodes))[0][0])]
    keys, corners = [], []
    for block, part, field in zip(blocks, smooth, fields, strict=True):
        keys.append(np.stack([block.nodes, np.repeat(part[:, None], 2, axis=1)], axis=2))
        corners.append(_corners(field, len(block.nodes)))
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


def _corners(fields: BeamFields, ne: int) -> FloatArray:
    """(ne, 2, p, 3) corners of the cross-sections at both ends of each element [m]."""
    flat = np.array(
        [[np.concatenate(outline(part)) for part in row] for row in fields.end_sections(ne)]
    )
    flat = np.broadcast_to(flat, (ne, *flat.shape[1:]))
    return fields.ends[:, :, None] + np.einsum("eac,enpc->enpa", fields.axes[:, :, 1:], flat)


def _sides(ends: IntArray, size: int, at: int, width: int) -> IntArray:
    """(t, 3) triangles of the side faces between the rings of ``size`` corners at both ends of
    elements.

    Corner c of ring r has the number r * ``width`` + ``at`` + c.
    """
    here = at + np.arange(size)
    there = at + (np.arange(size) + 1) % size
    a, b = ends[:, :1] * width, ends[:, 1:] * width
    one = np.stack([a + here, a + there, b + there], axis=2)
    two = np.stack([a + here, b + there, b + here], axis=2)
    return np.concatenate([one, two]).reshape(-1, 3)


def _caps(rings: IntArray, size: int, at: int, width: int, outwards: bool) -> IntArray:
    """(t, 3) triangles that close rings of convex polygons; ``outwards``: normal along the beam."""
    fan = np.stack([np.zeros(size - 2, dtype=np.int64), *np.add.outer((1, 2), np.arange(size - 2))])
    fan = fan.T if outwards else fan.T[:, ::-1]
    return (rings[:, None, None] * width + at + fan).reshape(-1, 3)


def node_modes(
    fe: FEMatrices,
    Phi: FloatArray,
    interfaces: tuple[RigidInterface, ...] = (),
    interface_rotations: FloatArray | None = None,
    progress: Progress = silent,
) -> NodeModes:
    """Displacement and rotation of all nodes per unit modal coordinate.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    Phi : (n, m) float
        Modes.
    interfaces : tuple of RigidInterface
        Their nodes take ``interface_rotations`` (i, 3, m).
    progress : Progress
        Called with the phase ``"recovery"``.
    """
    nodes, table = fe.numbering.nodes, fe.numbering.table
    everywhere = fe.expand(Phi)
    rotation = _mean_rotation(fe, everywhere, progress)
    rotating = fe.numbering.rotating
    rotation[rotating] = everywhere[table[rotating, 3:]]
    for k, interface in enumerate(interfaces):
        if interface_rotations is not None:
            rotation[interface.nodes] = interface_rotations[k]
    progress("recovery", 1.0)
    groups = {name: np.intersect1d(part, nodes) for name, part in fe.mesh.node_sets.items()}
    moved = everywhere[table[nodes, :3]]
    turns = rotation[nodes] if fe.blocks else None  # without elements no rotation is known
    return NodeModes(nodes, fe.mesh.points[nodes], moved, turns, groups)


def surface(fe: FEMatrices, nodes: NodeModes) -> Surface:
    """The skin of the body and the motion of its points per unit modal coordinate.

    Mesh nodes first, then the corners of the beams' sections.
    """
    triangles, lines = skin_triangles(fe.blocks, fe.mesh.points), skin_lines(fe.blocks)
    used = np.union1d(triangles, lines)
    rows = np.searchsorted(nodes.ids, used)
    beams = extruded_beams(fe, nodes)
    return Surface(
        np.concatenate([fe.mesh.points[used], beams.points]),
        np.concatenate([np.searchsorted(used, triangles), beams.faces + len(used)]),
        np.searchsorted(used, lines),
        np.concatenate([nodes.Phi_t[rows], beams.modes]),
        np.concatenate([used, beams.node_ids]),
    )


def _mean_rotation(fe: FEMatrices, u: FloatArray, progress: Progress) -> FloatArray:
    """(nodes, 3, m) half the curl of u at each node, averaged over its solids; zero without
    solids."""
    count, m = len(fe.mesh.points), u.shape[1]
    total, met = np.zeros((count, 3, m)), np.zeros(count)
    solids = [block for block in fe.blocks if not block.family.rotations]
    whole, done = sum(len(block.nodes) for block in solids), 0
    for block in solids:
        for nodes in block.chunks():
            curl = block.family.rotation(fe.mesh.points[nodes])
            ne, k, _, d = curl.shape
            local = np.matmul(curl.reshape(ne, 3 * k, d), u[fe.numbering.of(nodes, 3)])
            np.add.at(total, nodes, local.reshape(ne, k, 3, m))
            met += np.bincount(nodes.ravel(), minlength=count)
            done += len(nodes)
            progress("recovery", min(0.99, done / whole))
    return total / np.maximum(met, 1)[:, None, None]
