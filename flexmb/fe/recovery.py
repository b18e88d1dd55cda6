"""What a body stores for the recovery of stress: at nodes, in beams and in shells.

In: a model and its modes. Out: stress at nodes, section forces of beams, and membrane forces,
moments and transverse forces of shells at nodes. Those of shells are in the axes of each node: the
mean normal of its elements, and the direction of material axis 1.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.elements.element_blocks import Block
from flexmb.fe.elements.shell_fields import MIN_IN_PLANE, flatten, plane_axis, shell_functions
from flexmb.fe.stress import (
    Places,
    averaged,
    section_force_modes,
    stress_modes,
    stress_option,
    stress_sections,
)
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.stress_modes import OmittedStress, SectionForceModes, ShellForceModes
from flexmb.progress import Progress, silent


def with_recovery(
    body: FlexBody,
    fe: FEMatrices,
    Phi: FloatArray,
    stress: bool | str = True,
    progress: Progress = silent,
    omitted: FloatArray | None = None,
) -> FlexBody:
    """The body with its stress, the section forces of its beams and the resultants of its shells.

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
        Called with the phase ``"stress"``.
    omitted : (n, 12) float, optional
        What the modes lack of the static responses to the body's own inertia loads.

    Raises
    ------
    ReductionError
        An unknown option.
    """
    where = stress_option(stress)
    if where == "none":
        return body
    m = Phi.shape[1]
    U = Phi if omitted is None else np.concatenate([Phi, omitted], axis=1)
    skin = None if where == "all" or body.surface is None else np.unique(body.surface.node_ids)
    beams, stresses = section_force_modes(fe, U), stress_modes(fe, U, skin, progress)
    shells = shell_force_modes(fe, U, skin)
    lines = len(beams.nodes) > 0
    forces = SectionForceModes(beams.nodes, beams.axes, beams.ends[..., :m]) if lines else None
    rest = None
    if omitted is not None:
        rest = OmittedStress(
            None if stresses is None else stresses.modes[..., m:],
            beams.ends[..., m:] if lines else None,
            None if shells is None else shells.modes[..., m:],
        )
    return replace(
        body,
        stress=None if stresses is None else replace(stresses, modes=stresses.modes[..., :m]),
        shell_forces=None if shells is None else replace(shells, modes=shells.modes[..., :m]),
        section_forces=forces,
        omitted_stress=rest,
    )


def shell_force_modes(
    fe: FEMatrices, Phi: FloatArray, nodes: IntArray | None = None
) -> ShellForceModes | None:
    """Section resultants of shells at their nodes per unit modal coordinate; None without shells.

    The resultants of the elements that meet at a node are transformed to common axes and averaged,
    as their stress is. Transverse forces follow by equilibrium from the derivatives of the averaged
    moments, because those of the elements' own shear strains do not converge. At free edges the
    derivatives are one-sided.
    """
    U = fe.expand(Phi)
    wanted = np.ones(len(fe.mesh.points), dtype=bool)
    if nodes is not None:
        wanted[:] = False
        wanted[nodes] = True
    parts: list[str] = []
    columns = []
    for blocks in stress_sections([block for block in fe.blocks if block.family.dimension == 2]):
        places = Places(fe, blocks, wanted)
        axes = _nodal_axes(fe, places)

        def turned(block: Block, x: FloatArray, rows: IntArray, axes: FloatArray = axes) -> Any:
            values, own = block.family.resultants(x, block.section)
            return _turned(values, own, axes[rows])

        ids, values = averaged(fe, places, 6, U, turned)
        values = np.concatenate([values, _transverse_forces(fe, places, axes, values)], axis=1)
        parts += [name for name in (blocks[0].group,) if name not in parts]
        part = np.full(len(ids), parts.index(blocks[0].group))
        columns.append((ids, part, axes, values))
    if not columns:
        return None
    ids, part, axes, values = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.argsort(ids, kind="stable")
    return ShellForceModes(ids[order], part[order], tuple(parts), axes[order], values[order])


def _nodal_axes(fe: FEMatrices, places: Places) -> FloatArray:
    """(p, 3, 3) axes at each place as columns: axis 1 as elements with this normal have it, the
    mean normal last."""
    total, first = np.zeros((len(places.nodes), 3)), np.zeros((len(places.nodes), 3))
    for block, rows in zip(places.blocks, places.rows, strict=True):
        flat = flatten(fe.mesh.points[block.nodes], block.section.orientation)
        own = np.repeat(flat.axes, rows.shape[1], axis=0)[rows.ravel() >= 0]
        np.add.at(total, rows[rows >= 0], own[:, :, 2])
        first[rows[rows >= 0]] = own[:, :, 0]
    normal = total / np.linalg.norm(total, axis=1, keepdims=True)
    axis, share = plane_axis(normal, places.blocks[0].section.orientation)
    axis = np.where(share < MIN_IN_PLANE, np.cross(normal, np.cross(first, normal)), axis)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return np.stack([axis, np.cross(normal, axis), normal], axis=2)


def _turned(values: FloatArray, own: FloatArray, axes: FloatArray) -> FloatArray:
    """(ne, k, 6, d) resultants in axes (ne, k, 3, 3), from those in the element axes own (ne, 3,
    3)."""
    T = _tensor_rotation(_angle(own, axes))
    return np.concatenate([np.matmul(T, values[:, :, :3]), np.matmul(T, values[:, :, 3:])], axis=2)


def _tensor_rotation(angle: FloatArray) -> FloatArray:
    """(..., 3, 3) transformation of plane tensor components xx, yy, xy to axes rotated by an
    angle."""
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _angle(own: FloatArray, axes: FloatArray) -> FloatArray:
    """(ne, k) angle about the normal from the element axes own (ne, 3, 3) to axes (ne, k, 3, 3)
    [rad]."""
    T = np.einsum("eai,ekaj->ekij", own[:, :, :2], axes[..., :2])
    return np.asarray(np.arctan2(T[..., 1, 0] - T[..., 0, 1], T[..., 0, 0] + T[..., 1, 1]))


def _transverse_forces(
    fe: FEMatrices, places: Places, axes: FloatArray, values: FloatArray
) -> FloatArray:
    """(p, 2, m) Qx = Mx,x + Mxy,y and Qy = Mxy,x + My,y from the moments in values (p, 6, m)."""
    total = np.zeros((len(places.nodes), 2, values.shape[2]))
    met = np.zeros(len(places.nodes))
    for block, rows in zip(places.blocks, places.rows, strict=True):
        inside = np.flatnonzero((rows >= 0).all(axis=1))
        slopes = shell_functions(block.kind, "center").corner_slopes[0]
        for part in np.array_split(inside, 1 + len(inside) * values.shape[2] // 100_000):
            flat = flatten(fe.mesh.points[block.nodes[part]], block.section.orientation)
            at = rows[part]
            angle = _angle(flat.axes, axes[at])
            moments = np.matmul(_tensor_rotation(-angle), values[at][:, :, 3:])
            grads = np.linalg.inv(np.matmul(slopes, flat.xy)) @ slopes
            M = moments[:, :, [[0, 2], [2, 1]]]
            Q = np.einsum("ejk,ekijm->eim", grads, M)
            c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
            Qx, Qy = Q[:, None, 0], Q[:, None, 1]
            np.add.at(total, at, np.stack([c * Qx + s * Qy, c * Qy - s * Qx], axis=2))
            np.add.at(met, at, 1.0)
    return total / np.maximum(met, 1.0)[:, None, None]
