"""Stress at the nodes of a body per unit modal coordinate; section forces of beams and shells.

Each element's stress at its nodes is linear in its displacements. It is evaluated for the modes and
averaged over the elements of one section that meet at a node, never across sections or layers.
Shells are averaged across an edge only where the angle between them is small and their normals
agree, since across a fold the top of one does not continue the top of the other. Beams are averaged
at nodes of exactly two that continue in nearly the same direction. Stress is largest at the skin of
a solid, so its inner nodes may be left out.
Source: Hinton and Campbell (1974), Local and global smoothing of discontinuous finite element
functions, IJNME 8.

Section forces N, Vy, Vz, T, My, Mz are those that the part at larger x exerts on the part at
smaller x, in the element's principal axes: N, My, Mz at the centroid, T about the shear centre.
They balance the nodal forces. Between the ends they are interpolated linearly, which is exact if no
load acts along the element.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.elements.beam_elements import FORCES, BeamFields, section_forces
from flexmb.fe.elements.element_blocks import Block
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.mesh_options import STRESS_OPTIONS
from flexmb.flexbody.stress_modes import StressModes
from flexmb.progress import Progress, silent

# Elements are averaged if the angle between them is smaller. A larger one counts as a fold, also on
# a coarsely meshed curved shell.
_MIN_COSINE = np.cos(np.radians(35.0))


def smooth_parts(blocks: Sequence[Block], points: FloatArray) -> list[IntArray]:
    """(ne,) per block: number of the smooth part that each element belongs to.

    All blocks are of one dimension.
    """
    counts = [len(block.nodes) for block in blocks]
    dimension = blocks[0].family.dimension
    if dimension == 3:
        return [np.zeros(count, dtype=np.int64) for count in counts]
    places = [points[block.nodes] for block in blocks]
    if dimension == 2:
        directions, pairs = np.concatenate([_normals(x) for x in places]), _shared_edges(blocks)
    else:
        directions = np.concatenate([x[:, 1] - x[:, 0] for x in places])
        pairs = _shared_ends(blocks)
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-300)
    first, second = pairs
    level = np.einsum("ka,ka->k", directions[first], directions[second]) > _MIN_COSINE
    graph = coo_array(
        (np.ones(level.sum()), (first[level], second[level])), shape=(sum(counts), sum(counts))
    )
    numbers = connected_components(graph, directed=False)[1].astype(np.int64)
    return np.split(numbers, np.cumsum(counts)[:-1])


def _normals(x: FloatArray) -> FloatArray:
    corners = 3 if x.shape[1] in (3, 6) else 4
    if corners == 4:
        return np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])


def _shared_edges(blocks: Sequence[Block]) -> tuple[IntArray, IntArray]:
    """Pairs of elements (index of one, index of the other) with a common edge."""
    edges, owners, start = [], [], 0
    for block in blocks:
        for edge in block.family.edges:
            edges.append(np.sort(block.nodes[:, edge], axis=1))
            owners.append(start + np.arange(len(block.nodes)))
        start += len(block.nodes)
    return _neighbours(np.concatenate(edges), np.concatenate(owners))


def _shared_ends(blocks: Sequence[Block]) -> tuple[IntArray, IntArray]:
    """Pairs of beam elements that meet at a node where there is no third element."""
    ends = np.concatenate([block.nodes[:, :2] for block in blocks])
    nodes, owners = ends.reshape(-1), np.repeat(np.arange(len(ends)), 2)
    met = np.bincount(nodes)
    two = met[nodes] == 2
    return _neighbours(nodes[two][:, None], owners[two])


def _neighbours(keys: IntArray, owners: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of owners of equal keys, consecutive in the sorted list."""
    order = np.lexsort(keys.T)
    same = (np.diff(keys[order], axis=0) == 0).all(axis=1)
    return owners[order][:-1][same], owners[order][1:][same]


_CHUNK = 5e7  # bytes of one batch of element stress matrices and of their products with the modes


def stress_option(option: bool | str) -> str:
    """One of ``STRESS_OPTIONS``: ``True`` means ``"surface"``, ``False`` ``"none"``.

    Raises
    ------
    ReductionError
        Anything else.
    """
    if isinstance(option, bool):
        return "surface" if option else "none"
    if option in STRESS_OPTIONS:
        return option
    what, near = f'unknown "{option}"', nearest(str(option), STRESS_OPTIONS)
    raise ReductionError.from_problems([Problem("stress", what, STRESS_OPTIONS, near)])


def stress_modes(
    fe: FEMatrices, Phi: FloatArray, nodes: IntArray | None = None, progress: Progress = silent
) -> StressModes | None:
    """Stress per unit modal coordinate at nodes; None if no element has stress.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    Phi : (n, m) float
        Modes.
    nodes : (k,) int, optional
        Mesh nodes where stress is wanted, such as those of the skin; all by default.
    progress : Progress
        Called with the phase ``"stress"``.
    """
    U = fe.expand(Phi)
    wanted = np.ones(len(fe.mesh.points), dtype=bool)
    if nodes is not None:
        wanted[:] = False
        wanted[nodes] = True
    parts, layers, columns = [], [], []
    groups = stress_sections(fe.blocks)
    for number, blocks in enumerate(groups):
        progress("stress", number / len(groups))
        names = blocks[0].family.stress_layers(blocks[0].section)
        ids, values = averaged(fe, Places(fe, blocks, wanted), 6 * len(names), U, _stress_rows)
        parts += [name for name in (blocks[0].group,) if name not in parts]
        layers += [name for name in names if name not in layers]
        rows = np.tile([layers.index(name) for name in names], len(ids))
        part = np.full(len(rows), parts.index(blocks[0].group))
        stress = values.reshape(len(rows), 6, U.shape[1])
        columns.append((np.repeat(ids, len(names)), part, rows, stress))
    progress("stress", 1.0)
    if not columns:
        return None
    ids, part, layer, modes = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.argsort(ids, kind="stable")
    columns = (column[order] for column in (ids, part, layer))
    return StressModes(*columns, tuple(parts), tuple(layers), modes[order])


def stress_sections(blocks: Sequence[Block]) -> list[list[Block]]:
    """Lists of blocks whose stress may be averaged: of one group and with the same layers."""
    groups: dict[tuple[object, ...], list[Block]] = {}
    for block in blocks:
        layers = block.family.stress_layers(block.section)
        if layers:
            groups.setdefault((block.group, block.family.dimension, layers), []).append(block)
    return list(groups.values())


class Places:
    """Places where the elements of one section are averaged: a node, once for each smooth part
    there."""

    def __init__(self, fe: FEMatrices, blocks: list[Block], wanted: FloatArray) -> None:
        self.blocks = blocks
        smooth = smooth_parts(blocks, fe.mesh.points)
        keys = [
            np.stack([block.nodes, np.broadcast_to(number[:, None], block.nodes.shape)], axis=-1)
            for block, number in zip(blocks, smooth, strict=True)
        ]
        flat = np.concatenate([key.reshape(-1, 2) for key in keys])
        selected = wanted[flat[:, 0]]
        places, inverse = np.unique(flat[selected], axis=0, return_inverse=True)
        self.nodes = places[:, 0]
        self.count = np.bincount(inverse.ravel(), minlength=len(places))
        row_of = np.full(len(flat), -1)
        row_of[selected] = inverse.ravel()
        ends = np.cumsum([block.nodes.size for block in blocks])[:-1]
        parts = zip(np.split(row_of, ends), blocks, strict=True)
        self.rows = [part.reshape(block.nodes.shape) for part, block in parts]
        """(ne, k) place of each node of each element, -1 where it is not wanted."""


Matrices = Callable[[Block, FloatArray, IntArray], FloatArray]
"""(ne, k, r, d) values at the nodes of elements of a block with node coordinates x (ne, k, 3), at
places (ne, k), per unit of each degree of freedom."""


def _stress_rows(block: Block, x: FloatArray, places: IntArray) -> FloatArray:
    S = block.family.stress(x, block.section)
    return S.reshape(*S.shape[:2], -1, S.shape[-1])


def averaged(
    fe: FEMatrices, places: Places, width: int, U: FloatArray, matrices: Matrices
) -> tuple[IntArray, FloatArray]:
    """Nodes (p,) and the mean of the elements' values there (p, width, m), in single precision."""
    total = np.zeros((len(places.nodes), width * U.shape[1]), dtype=np.float32)
    for block, rows in zip(places.blocks, places.rows, strict=True):
        for part, values in element_values(fe, block, rows, width, U, matrices):
            at = rows[part].ravel()
            used = np.flatnonzero(at >= 0)
            met, local = np.unique(at[used], return_inverse=True)
            shape = (len(met), len(at))
            share = csr_array((1 / places.count[at[used]], (local.ravel(), used)), shape)
            total[met] += share @ values
    return places.nodes, total.reshape(len(places.nodes), width, -1)


def element_values(
    fe: FEMatrices, block: Block, rows: IntArray, width: int, U: FloatArray, matrices: Matrices
) -> Iterator[tuple[IntArray, FloatArray]]:
    """For batches of elements with a wanted node: place numbers and values (ne * k, width * m)."""
    elements = np.flatnonzero((rows >= 0).any(axis=1))
    k, d, m = block.nodes.shape[1], block.width, U.shape[1]
    size = max(1, int(_CHUNK / (8 * k * width * (d + m))))
    for start in range(0, len(elements), size):
        part = elements[start : start + size]
        nodes = block.nodes[part]
        S = matrices(block, fe.mesh.points[nodes], rows[part])
        u = U[fe.numbering.of(nodes, 6 if block.family.rotations else 3)]
        values = np.matmul(S.reshape(len(part), k * width, d), u)
        yield part, values.reshape(len(part) * k, width * m)


_BEAM_BATCH = 1000  # beam elements per batch


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
    for block, part in _beam_batches(fe):
        fields = BeamFields(fe.mesh.points[part], block.section)
        u = every[fe.numbering.of(part, 6)]
        nodes.append(part)
        groups += [block.group] * len(part)
        axes.append(fields.axes)
        ends.append(np.einsum("enci,eim->encm", section_forces(fields), u))
    none = np.zeros((0, 2, len(FORCES), every.shape[1]))
    forces = np.concatenate([none, *ends])
    return SectionForces(np.concatenate(nodes), tuple(groups), np.concatenate(axes), forces)


def _beam_batches(fe: FEMatrices) -> Iterator[tuple[Block, IntArray]]:
    for block in fe.blocks:
        if block.family.dimension == 1:
            for start in range(0, len(block.nodes), _BEAM_BATCH):
                yield block, block.nodes[start : start + _BEAM_BATCH]
