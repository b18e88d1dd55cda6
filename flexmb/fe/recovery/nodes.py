"""From modal coordinates back to the mesh: displacement and rotation of its nodes.

In: the model and its modes. Out: :class:`NodeModes` for markers at any node and :class:`Surface`
for pictures. Where a node has no rotation of its own, it is half the curl of the displacement,
averaged over the elements that meet there; nodes of an interface turn with it.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.interfaces.rigid import RigidInterface
from flexmb.fe.meshes.skin import skin_lines, skin_triangles
from flexmb.fe.recovery.beams import extruded_beams
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.parts import NodeModes, Surface
from flexmb.progress import Progress, silent

__all__ = ["node_modes", "surface"]


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
        Told the phase ``"recovery"``.
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
    return NodeModes(nodes, fe.mesh.points[nodes], moved, rotation[nodes], groups)


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
    """(nodes, 3, m) half the curl at each node, mean over its solids; zero without any."""
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
