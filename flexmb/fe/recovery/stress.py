"""Stress at the nodes of a body per unit modal coordinate.

In: the model and its modes. Out: :class:`StressModes`. Each element's stress at its nodes is linear
in its displacements; it is applied to the modes and averaged over the elements of one section that
meet at a node, never across sections or layers, nor across a fold of a shell (:mod:`smooth`).
Stress is largest at the skin of a solid, so that its inner nodes may be left out. Source: Hinton
and Campbell (1974), Local and global smoothing of discontinuous finite element functions, IJNME 8.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.elements.select import Block
from flexmb.fe.recovery.beams import section_force_modes
from flexmb.fe.recovery.smooth import smooth_parts
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.recovery import StressModes
from flexmb.progress import Progress, silent

__all__ = ["STRESS_OPTIONS", "stress_modes", "stress_option", "with_recovery"]

STRESS_OPTIONS = ("surface", "all", "none")
_CHUNK = 5e7  # bytes of one batch of stress matrices and their products


def stress_option(given: bool | str) -> str:
    """One of ``STRESS_OPTIONS``: ``True`` means ``"surface"``, ``False`` ``"none"``.

    Raises
    ------
    ReductionError
        Anything else.
    """
    if isinstance(given, bool):
        return "surface" if given else "none"
    if given in STRESS_OPTIONS:
        return given
    what, near = f'unknown "{given}"', nearest(str(given), STRESS_OPTIONS)
    raise ReductionError.from_problems([Problem("stress", what, STRESS_OPTIONS, near)])


def stress_modes(
    fe: FEMatrices, Phi: FloatArray, nodes: IntArray | None = None, progress: Progress = silent
) -> StressModes | None:
    """Stress per unit modal coordinate at all places of some nodes; None if no element tells any.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    Phi : (n, m) float
        Modes.
    nodes : (k,) int, optional
        Mesh nodes where stress is wanted, such as those of the skin; all by default.
    progress : Progress
        Told the phase ``"stress"``.
    """
    U = fe.expand(Phi)
    wanted = np.ones(len(fe.mesh.points), dtype=bool)
    if nodes is not None:
        wanted[:] = False
        wanted[nodes] = True
    parts, layers, found = [], [], []
    groups = _sections(fe.blocks)
    for number, blocks in enumerate(groups):
        progress("stress", number / len(groups))
        names = blocks[0].family.stress_layers(blocks[0].section)
        ids, values = _averaged(fe, blocks, len(names), U, wanted)
        parts += [name for name in (blocks[0].group,) if name not in parts]
        layers += [name for name in names if name not in layers]
        rows = np.tile([layers.index(name) for name in names], len(ids))
        part = np.full(len(rows), parts.index(blocks[0].group))
        found.append((np.repeat(ids, len(names)), part, rows, values.reshape(-1, 6, U.shape[1])))
    progress("stress", 1.0)
    if not found:
        return None
    ids, part, layer, modes = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(ids, kind="stable")
    columns = (column[order] for column in (ids, part, layer))
    return StressModes(*columns, tuple(parts), tuple(layers), modes[order])


def _sections(blocks: Sequence[Block]) -> list[list[Block]]:
    """Blocks whose elements may share their stress: of one group and the same layers."""
    groups: dict[tuple[object, ...], list[Block]] = {}
    for block in blocks:
        layers = block.family.stress_layers(block.section)
        if layers:
            groups.setdefault((block.group, block.family.dimension, layers), []).append(block)
    return list(groups.values())


def _averaged(
    fe: FEMatrices, blocks: list[Block], layers: int, U: FloatArray, wanted: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Nodes (p,) and the mean of the elements' stresses there (p, layers, 6, m), single precision.

    A node appears once for each part of the section that is smooth on its own.
    """
    smooth = smooth_parts(blocks, fe.mesh.points)
    keys = [
        np.stack([block.nodes, np.broadcast_to(number[:, None], block.nodes.shape)], axis=-1)
        for block, number in zip(blocks, smooth, strict=True)
    ]
    flat = np.concatenate([key.reshape(-1, 2) for key in keys])
    kept = wanted[flat[:, 0]]
    places, inverse = np.unique(flat[kept], axis=0, return_inverse=True)
    row_of = np.full(len(flat), -1)
    row_of[kept] = inverse.ravel()
    count = np.bincount(inverse.ravel(), minlength=len(places))
    total = np.zeros((len(places), layers * 6 * U.shape[1]), dtype=np.float32)
    start = 0
    for block in blocks:
        size = block.nodes.size
        rows = row_of[start : start + size].reshape(block.nodes.shape)
        start += size
        for part, values in _element_stress(fe, block, rows, layers, U):
            at = rows[part].ravel()
            used = np.flatnonzero(at >= 0)
            met, local = np.unique(at[used], return_inverse=True)
            share = csr_array((1 / count[at[used]], (local.ravel(), used)), (len(met), len(at)))
            total[met] += share @ values
    return places[:, 0], total.reshape(len(places), layers, 6, -1)


def _element_stress(
    fe: FEMatrices, block: Block, rows: IntArray, layers: int, U: FloatArray
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Batches of elements that have a wanted node, and (ne * k, layers * 6 * m) their stress."""
    chosen = np.flatnonzero((rows >= 0).any(axis=1))
    k, d, m = block.nodes.shape[1], block.width, U.shape[1]
    size = max(1, int(_CHUNK / (48 * k * layers * (d + m))))
    for start in range(0, len(chosen), size):
        part = chosen[start : start + size]
        nodes = block.nodes[part]
        S = block.family.stress(fe.mesh.points[nodes], block.section)
        u = U[fe.numbering.of(nodes, 6 if block.family.rotations else 3)]
        values = np.matmul(S.reshape(len(part), k * layers * 6, d), u)
        yield part, values.reshape(len(part) * k, layers * 6 * m)


def with_recovery(
    body: FlexBody,
    fe: FEMatrices,
    Phi: FloatArray,
    stress: bool | str = True,
    progress: Progress = silent,
) -> FlexBody:
    """The body with its stress and the section forces of its beams.

    Parameters
    ----------
    body : FlexBody
        With a surface: its nodes are those of ``"surface"``.
    fe, Phi
        The model and its modes (n, m).
    stress : bool or str
        ``"surface"`` (or True): at the nodes of the skin, where stress is largest; ``"all"``: also
        at the nodes inside solids; ``"none"`` (or False): neither stress nor section forces.
    progress : Progress
        Told the phase ``"stress"``.

    Raises
    ------
    ReductionError
        An unknown option.
    """
    where = stress_option(stress)
    if where == "none":
        return body
    skin = None if where == "all" or body.surface is None else np.unique(body.surface.node_ids)
    return replace(
        body,
        stress=stress_modes(fe, Phi, skin, progress),
        section_forces=section_force_modes(fe, Phi),
    )
