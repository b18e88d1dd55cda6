"""Inertia concentrated at nodes: point masses with moments of inertia, masses spread over groups.

In: a mesh and ``{name: {at, mass, inertia, offset}}``. Out: :class:`NodalInertia`, which gives its
exact mass components: a small rigid body at an arm from its node moves with the node's
displacement and rotation. Moments of inertia J about its own centre enter by second moments
1/2 tr(J) I - J.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.elements.family import ComponentMass
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.fe.tables import word_problems
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["NodalInertia", "join", "nodal_masses"]

_KEYS = ("at", "mass", "inertia", "offset")
_ROUNDING = 1e-6  # relative; numbers typed with seven digits pass
_CHUNK = 10000  # nodes at once: 26 MB for one batch of their components
_LEVI_CIVITA = np.zeros((3, 3, 3))
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_a, _b, _c], _LEVI_CIVITA[_a, _c, _b] = 1.0, -1.0


@dataclass(frozen=True, eq=False)
class NodalInertia:
    """Small rigid bodies at nodes, body axes.

    Parameters
    ----------
    nodes : (k,) int
        Mesh nodes; one may occur more than once.
    mass : (k,) float
        kg.
    arm : (k, 3) float
        From the node to the centre of mass [m].
    second : (k, 3, 3) float
        int rho d d^T about the centre of mass [kg m^2].
    """

    nodes: IntArray
    mass: FloatArray
    arm: FloatArray
    second: FloatArray

    def masses(
        self, numbering: Numbering, points: FloatArray
    ) -> Iterator[tuple[ComponentMass, IntArray]]:
        """Exact mass components with their degrees of freedom: (k, 6) where nodes turn, (k, 3)
        where they do not."""
        turns = numbering.table[self.nodes, 3] >= 0
        for all_rows, width in ((np.flatnonzero(turns), 6), (np.flatnonzero(~turns), 3)):
            for start in range(0, len(all_rows), _CHUNK):
                rows = all_rows[start : start + _CHUNK]
                part = NodalInertia(*(values[rows] for values in vars(self).values()))
                yield part._components(points, width), numbering.of(part.nodes[:, None], width)

    def _components(self, points: FloatArray, width: int) -> ComponentMass:
        x, eye, m = points[self.nodes], np.eye(3), self.mass
        first = m[:, None] * self.arm
        second = self.second + first[:, :, None] * self.arm[:, None, :]
        k = len(m)
        # N_a = (e_a, E_a) with (E_a)_c = eps_acd rho_d, rho from the node: rotation c moves along a
        E = np.einsum("acd,kd->kac", _LEVI_CIVITA, first)
        Mab = np.zeros((k, 3, 3, 6, 6))
        Mab[..., :3, :3] = np.einsum("k,ai,bj->kabij", m, eye, eye)
        Mab[..., :3, 3:] = np.einsum("ai,kbc->kabic", eye, E)
        Mab[..., 3:, :3] = np.einsum("kac,bj->kabcj", E, eye)
        Mab[..., 3:, 3:] = np.einsum("acd,bef,kdf->kabce", _LEVI_CIVITA, _LEVI_CIVITA, second)
        p = np.concatenate([np.einsum("k,bi->kbi", m, eye), E], axis=2)
        P = np.zeros((k, 3, 3, 6))
        P[..., :3] = np.einsum("ka,bi->kabi", first, eye)
        P[..., 3:] = np.einsum("bcd,kad->kabc", _LEVI_CIVITA, second)
        P += np.einsum("ka,kbi->kabi", x, p)
        S1 = m[:, None] * x + first
        cross = np.einsum("ka,kb->kab", x, first)
        S0 = second + cross + cross.transpose(0, 2, 1)
        S0 += m[:, None, None] * x[:, :, None] * x[:, None, :]
        return ComponentMass(Mab[..., :width, :width], P[..., :width], p[..., :width], m, S1, S0)


def nodal_masses(
    mesh: Mesh, numbering: Numbering, given: Mapping[str, Mapping[str, Any]]
) -> NodalInertia:
    """Point masses and masses spread over groups.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    numbering : Numbering
        Degrees of freedom of the body.
    given : mapping of str to mapping
        ``{name: {at: group or node, mass: kg, inertia: [Jxx, Jyy, Jzz] or 3 x 3 about its own
        centre [kg m^2], offset: [x, y, z] from the node to that centre [m]}}``. The mass of a
        group of several nodes is spread over them: in proportion to the area (length) of the
        group's surfaces (lines) at each node, equally without any; it has no inertia of its own.

    Raises
    ------
    MeshError
        Unknown words, groups or nodes, nodes outside the body, impossible values, and arms or
        inertia at nodes without rotations; all at once.
    """
    found: list[NodalInertia] = []
    problems: list[Problem] = []
    for name, words in given.items():
        try:
            found.append(_one(mesh, numbering, f"masses.{name}", dict(words)))
        except MeshError as error:
            problems += error.problems
    if problems:
        raise MeshError.from_problems(problems)
    return join(found)


def join(parts: list[NodalInertia]) -> NodalInertia:
    """All of them as one."""
    empty = NodalInertia(np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    columns = zip(*(vars(part).values() for part in (empty, *parts)), strict=True)
    return NodalInertia(*(np.concatenate(column) for column in columns))


def _one(mesh: Mesh, numbering: Numbering, where: str, words: dict[str, Any]) -> NodalInertia:
    problems = word_problems(words, where, _KEYS, _KEYS[:2])
    if problems:
        raise MeshError.from_problems(problems)
    mass = _numbers(words["mass"], (), f"{where}.mass", "a number [kg]")
    if mass < 0 or (mass == 0 and "inertia" not in words):
        raise MeshError(f"{where}.mass: must be positive, given {float(mass):g} kg")
    arm = _numbers(words.get("offset", (0, 0, 0)), (3,), f"{where}.offset", "three numbers [m]")
    second = _second_moment(words.get("inertia"), f"{where}.inertia")
    nodes = _nodes(mesh, numbering, words["at"], f"{where}.at")
    if arm.any() or second.any():
        _require_rotations(numbering, nodes, where)
    share = _shares(mesh, words["at"], nodes) * float(mass)
    count = len(nodes)
    return NodalInertia(nodes, share, np.tile(arm, (count, 1)), np.tile(second, (count, 1, 1)))


def _require_rotations(numbering: Numbering, nodes: IntArray, where: str) -> None:
    if len(nodes) > 1:
        what = f"a mass spread over {len(nodes)} nodes has neither inertia nor offset of its own"
        raise MeshError(f"{where}: {what}: put it on the reference node of a tie")
    if numbering.table[nodes[0], 3] < 0:
        what = f"node {nodes[0]} has no rotations, so it carries neither inertia nor offset"
        raise MeshError(f"{where}: {what}: put it on the reference node of a tie (rbe2 or rbe3)")


def _nodes(mesh: Mesh, numbering: Numbering, at: str | int, where: str) -> IntArray:
    if isinstance(at, int) and not isinstance(at, bool):
        if not 0 <= at < len(mesh.points):
            what = f"there is no node {at}; the mesh has nodes 0 to {len(mesh.points) - 1}"
            raise MeshError(f"{where}: {what}")
        nodes = np.array([at])
    else:
        nodes = mesh.group_nodes(str(at), where)
    outside = nodes[numbering.table[nodes, 0] < 0]
    if len(outside):
        what = f"node {outside[0]} belongs to no element of the body and to no tie"
        raise MeshError(f"{where}: {what}")
    return nodes


def _shares(mesh: Mesh, at: str | int, nodes: IntArray) -> FloatArray:
    """(k,) shares of the nodes in a mass spread over them, sum 1."""
    weight = np.zeros(len(mesh.points))
    groups = mesh.element_sets.get(str(at), {})
    for dim in (2, 1):
        for kind, rows in groups.items():
            if dimension(kind) == dim and len(rows):
                cells = mesh.blocks[kind][rows]
                x = mesh.points[cells[:, : _corners(kind)]]
                size = np.linalg.norm(x[:, 1] - x[:, 0], axis=1) if dim == 1 else _areas(x)
                np.add.at(weight, cells, (size / cells.shape[1])[:, None])
        if weight.any():
            break
    found = weight[nodes] if weight.any() else np.ones(len(nodes))
    return found / found.sum()


def _corners(kind: str) -> int:
    return {"line": 2, "tria": 3, "quad": 4}[kind[:4]]


def _areas(x: FloatArray) -> FloatArray:
    """(ne,) areas of flat polygons with corners (ne, k, 3)."""
    arms = x[:, 1:] - x[:, :1]
    return 0.5 * np.linalg.norm(np.cross(arms[:, :-1], arms[:, 1:]).sum(axis=1), axis=1)


def _second_moment(given: Any, where: str) -> FloatArray:
    """(3, 3) 1/2 tr(J) I - J."""
    if given is None:
        return np.zeros((3, 3))
    what = "[Jxx, Jyy, Jzz] or a 3 x 3 matrix [kg m^2]"
    rows = np.shape(given) == (3, 3)
    J = _numbers(given, (3, 3) if rows else (3,), where, what)
    J = J if rows else np.diag(J)
    size = np.abs(J).max()
    if np.abs(J - J.T).max() > _ROUNDING * size:
        raise MeshError(f"{where}: the matrix must be symmetric")
    J = 0.5 * (J + J.T)
    second = 0.5 * np.trace(J) * np.eye(3) - J
    if np.linalg.eigvalsh(second)[0] < -_ROUNDING * size:
        moments = ", ".join(f"{value:.4g}" for value in np.linalg.eigvalsh(J))
        what = f"no body has the principal moments {moments} kg m^2: each is at most the sum of"
        raise MeshError(f"{where}: {what} the other two, and none is negative")
    return second


def _numbers(given: Any, shape: tuple[int, ...], where: str, what: str) -> FloatArray:
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if values.shape != shape or not np.isfinite(values).all() or isinstance(given, bool):
        raise MeshError(f"{where}: expects {what}, given {given!r}")
    return values
