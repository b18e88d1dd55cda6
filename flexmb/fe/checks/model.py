"""Checks of a model before it is reduced, and the table of its modes after.

In: a finite-element model, its interfaces, its modes. Out: sentences worth telling, an error for
what cannot be reduced, and one :class:`ModeInfo` for every candidate mode.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from flexmb.errors import MeshError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.interfaces.rigid import RigidInterface
from flexmb.fe.material import plausibility
from flexmb.fe.reduction.craig_bampton import CraigBampton
from flexmb.fe.reduction.orthonormal import ReducedModes
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.parts import ModeInfo

__all__ = ["mode_infos", "orphans", "require_one_part", "suspicions"]

_RIGID = tuple(f"{kind} {axis}" for kind in ("translation", "rotation") for axis in "xyz")
_EXTENT = (1e-4, 100.0)  # m: a part of 450 mm read as metres is beyond


def suspicions(fe: FEMatrices) -> list[str]:
    """Sentences about values that hint at a unit slip; empty if there are none."""
    found = plausibility(fe.material)
    extent = float(np.ptp(fe.mesh.points[fe.numbering.nodes], axis=0).max())
    if not _EXTENT[0] <= extent <= _EXTENT[1]:
        found.append(f"the mesh extends over {extent:g} m: is its unit system the right one?")
    return found


def orphans(fe: FEMatrices) -> int:
    """How many nodes of the mesh belong to no element of the body (they are left out)."""
    return len(fe.mesh.points) - len(fe.numbering.nodes)


def require_one_part(fe: FEMatrices, interfaces: tuple[RigidInterface, ...]) -> None:
    """Refuse a mesh whose parts are joined neither by nodes nor by an interface.

    Raises
    ------
    MeshError
        With the size and place of the smallest part.
    """
    groups = [block.nodes for block in fe.blocks]
    groups += [part.nodes[None] for part in interfaces]
    groups += [np.append(tie.nodes, tie.reference)[None] for tie in fe.ties]
    first = np.concatenate([np.repeat(nodes[:, 0], nodes.shape[1]) for nodes in groups])
    other = np.concatenate([nodes.ravel() for nodes in groups])
    size = len(fe.mesh.points)
    graph = coo_array((np.ones(len(other)), (first, other)), shape=(size, size))
    _, part_of = connected_components(graph, directed=False)
    parts, count = np.unique(part_of[fe.numbering.nodes], return_counts=True)
    if len(parts) > 1:
        smallest = np.flatnonzero(part_of == parts[np.argmin(count)])[0]
        place = ", ".join(f"{value:.4g}" for value in fe.mesh.points[smallest])
        raise MeshError(
            f"{fe.mesh.source}: the mesh falls into {len(parts)} parts that share no nodes and no "
            f"interface; the smallest has {count.min()} nodes, one of them node {smallest} at "
            f"({place}) m: merge coincident nodes, or make the parts conform"
        )


def mode_infos(
    fe: FEMatrices, reduced: CraigBampton, modes: ReducedModes, Mab: FloatArray
) -> tuple[ModeInfo, ...]:
    """The six rigid motions, dropped, then the modal coordinates with their energy shares.

    Parameters
    ----------
    fe, reduced, modes
        The model, the reduced basis and the modes made of it.
    Mab : (3, 3, m, m) float
        Mass components reduced onto the modes.
    """
    R = fe.rigid
    energy, mass = np.sum(R * (fe.K @ R), axis=0), np.sum(R * (fe.M @ R), axis=0)
    residual = np.sqrt(np.maximum(energy / mass, 0.0)) / (2 * np.pi)
    why = "rigid motion"
    rigid = [
        ModeInfo(-1, "rigid", float(f), False, why, name)
        for f, name in zip(residual, _RIGID, strict=True)
    ]
    return (*rigid, *_elastic_infos(reduced, modes, Mab))


def _elastic_infos(reduced: CraigBampton, modes: ReducedModes, Mab: FloatArray) -> list[ModeInfo]:
    c = reduced.constraints
    strain = modes.Z * (reduced.K @ modes.Z) / modes.omega2
    largest = np.argmax(strain, axis=0)
    kinetic = np.einsum("bbjj->jb", Mab)
    return [
        ModeInfo(
            j,
            "elastic",
            float(frequency),
            True,
            "",
            reduced.labels[largest[j]],
            float(strain[:c, j].sum()),
            tuple(kinetic[j]),
        )
        for j, frequency in enumerate(modes.frequencies)
    ]
