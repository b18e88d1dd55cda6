"""From modal coordinates back to the mesh: displacement and rotation of its nodes.

In: the model and its modes. Out: :class:`NodeModes` for markers at any node and :class:`Surface`
for pictures. Where a node has no rotation of its own, it is half the curl of the displacement,
averaged over the elements that meet there; nodes of an interface turn with it.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.elements import tet10
from flexmb.fe.interfaces.rigid import RigidInterface
from flexmb.fe.meshes.skin import skin_triangles
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.parts import NodeModes, Surface
from flexmb.progress import Progress, silent

__all__ = ["node_modes", "surface"]

_CHUNK = 1000  # tetrahedra at once


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
    Phi_t = Phi[table[nodes, :3]]
    everywhere = np.zeros((len(table), 3, Phi.shape[1]))
    everywhere[nodes] = Phi_t
    rotation = _mean_rotation(fe, everywhere, progress)
    rotating = fe.numbering.rotating
    rotation[rotating] = Phi[table[rotating, 3:]]
    for k, interface in enumerate(interfaces):
        if interface_rotations is not None:
            rotation[interface.nodes] = interface_rotations[k]
    progress("recovery", 1.0)
    return NodeModes(nodes, fe.mesh.points[nodes], Phi_t, rotation[nodes])


def surface(fe: FEMatrices, nodes: NodeModes) -> Surface:
    """The skin of the body and the motion of its points per unit modal coordinate."""
    triangles = skin_triangles(fe.elements.tets, fe.mesh.points)
    used = np.union1d(triangles, fe.elements.lines)
    rows = np.searchsorted(nodes.ids, used)
    return Surface(
        fe.mesh.points[used],
        np.searchsorted(used, triangles),
        np.searchsorted(used, fe.elements.lines),
        nodes.Phi_t[rows],
        used,
    )


def _mean_rotation(fe: FEMatrices, u: FloatArray, progress: Progress) -> FloatArray:
    """(nodes, 3, m) half the curl at each node, mean over its tetrahedra; zero without any."""
    tets = fe.elements.tets
    total = np.zeros_like(u)
    count = np.bincount(tets.ravel(), minlength=len(u))
    for start in range(0, len(tets), _CHUNK):
        part = tets[start : start + _CHUNK]
        np.add.at(total, part, _rotation(fe.mesh.points[part], u, part))
        progress("recovery", min(1.0, (start + _CHUNK) / len(tets)))
    return total / np.maximum(count, 1)[:, None, None]


def _rotation(x: FloatArray, u: FloatArray, tets: IntArray) -> FloatArray:
    """(ne, 10, 3, m) half the curl at the nodes of each tetrahedron."""
    ne, m = len(tets), u.shape[2]
    slope = tet10.node_gradients(x).transpose(0, 3, 2, 1).reshape(ne, 30, 10)
    gradient = np.matmul(slope, u[tets].reshape(ne, 10, 3 * m)).reshape(ne, 10, 3, 3, m)
    curl = [gradient[:, :, a, b] - gradient[:, :, b, a] for a, b in ((1, 2), (2, 0), (0, 1))]
    return 0.5 * np.stack(curl, axis=2)
