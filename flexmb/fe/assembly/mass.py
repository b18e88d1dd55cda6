"""Mass of a finite-element model: its inertia in second-moment form, point masses, lumping.

:class:`Inertia` holds the rigid data and, over the degrees of freedom, p_b = int rho N_b and P_ab =
int rho s_a N_b. M_ab = int rho N_a^T N_b are needed reduced onto modes only: solids keep one scalar
mass matrix for all nine, elements with nodal rotations are integrated once more. A point mass is a
small rigid body at an arm from its node; moments of inertia J enter by second moments 1/2 tr(J) I -
J. Lumped mass scales the diagonal of each element's consistent mass to its mass, which is positive
for every family (row sums are not); rotational entries become an isotropic moment of inertia.
Source: Hinton, Rock, Zienkiewicz (1976), A note on mass lumping, Earthquake Engineering and
Structural Dynamics 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.numbering import Accumulator, Numbering
from flexmb.fe.elements.element_blocks import Block
from flexmb.fe.elements.element_family import ComponentMass, ScalarMass
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.mesh_options import MassOptions
from flexmb.flexbody.options import read_options

_COMPONENTS = 9  # matrices of an element at once


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass, its moments, and its products with the displacement interpolation.

    Parameters
    ----------
    mass, S1, S0
        Rigid data about the body-frame origin: kg, (3,) kg m, (3, 3) kg m^2.
    p : (3, n) float
        int rho N_b.
    P : (3, 3, n) float
        int rho s_a N_b.
    scalar : (nodes, nodes) sparse
        int rho N_i N_j of the solids over the nodes of the mesh.
    """

    mass: float
    S1: FloatArray
    S0: FloatArray
    p: FloatArray
    P: FloatArray
    scalar: csr_array


class MassSum:
    """The mass of all blocks, summed batch by batch."""

    def __init__(self, numbering: Numbering, points: FloatArray) -> None:
        n = numbering.n_all
        self._numbering, self._points = numbering, points
        self._scalar = Accumulator(len(points))
        self._M = Accumulator(n)
        self._mass, self._S1, self._S0 = 0.0, np.zeros(3), np.zeros((3, 3))
        self._p, self._P = np.zeros((3, n)), np.zeros((3, 3, n))

    def add(self, block: Block, nodes: IntArray) -> None:
        """Add some elements of a block."""
        mass = block.family.mass(self._points[nodes], block.section)
        if isinstance(mass, ScalarMass):
            self._scalar.add(mass.M, nodes)
        else:
            self.add_components(mass, self._numbering.of(nodes, 6))

    def add_components(self, mass: ComponentMass, dofs: IntArray) -> None:
        """Add mass whose degrees of freedom have these numbers (ne, d)."""
        self._M.add(np.einsum("ebbij->eij", mass.Mab), dofs)
        for a in range(3):
            np.add.at(self._p[a], dofs, mass.p[:, a])
            for b in range(3):
                np.add.at(self._P[a, b], dofs, mass.P[:, a, b])
        self._mass += float(mass.mass.sum())
        self._S1 += mass.S1.sum(axis=0)
        self._S0 += mass.S0.sum(axis=0)

    def total(self) -> tuple[Inertia, csr_array]:
        """The inertia, and the mass matrix over all degrees of freedom."""
        scalar, points = self._scalar.matrix(), self._points
        M = self._M.matrix()
        solid = np.flatnonzero(np.diff(scalar.indptr))
        entries = scalar.tocoo()
        moment, weight = scalar @ points, scalar @ np.ones(len(points))
        for b in range(3):
            number = self._numbering.table[:, b]
            data = (entries.data, (number[entries.row], number[entries.col]))
            M = M + csr_array(data, shape=M.shape)
            self._p[b, number[solid]] += weight[solid]
            self._P[:, b, number[solid]] += moment[solid].T
        S0 = self._S0 + points.T @ moment
        inertia = Inertia(
            self._mass + float(weight.sum()),
            self._S1 + moment.sum(axis=0),
            0.5 * (S0 + S0.T),
            self._p,
            self._P,
            scalar,
        )
        return inertia, M


def component_masses(
    blocks: tuple[Block, ...], numbering: Numbering, points: FloatArray
) -> Iterator[tuple[ComponentMass, IntArray]]:
    """Mass of the elements with nodal rotations, in batches with their numbers (ne, d)."""
    for block in blocks:
        if block.family.rotations:
            for nodes in block.chunks(_COMPONENTS):
                mass = block.family.mass(points[nodes], block.section)
                assert isinstance(mass, ComponentMass)
                yield mass, numbering.of(nodes, 6)


def reduced_components(
    inertia: Inertia,
    masses: Iterator[tuple[ComponentMass, IntArray]],
    numbering: Numbering,
    Phi: FloatArray,
) -> FloatArray:
    """(3, 3, m, m) Phi^T M_ab Phi for modes Phi (n_all, m)."""
    m = Phi.shape[1]
    Mab = np.zeros((3, 3, m, m))
    solid = np.flatnonzero(np.diff(inertia.scalar.indptr))
    if len(solid):
        scalar = inertia.scalar[solid][:, solid]
        X = Phi[numbering.table[solid, :3]].reshape(len(solid), 3 * m)
        product = X.T @ (scalar @ X)
        Mab += product.reshape(3, m, 3, m).transpose(0, 2, 1, 3)
    for mass, dofs in masses if m else ():
        local = Phi[dofs]
        flat = local.reshape(-1, m)
        for a in range(3):
            for b in range(3):
                Mab[a, b] += flat.T @ np.matmul(mass.Mab[:, a, b], local).reshape(-1, m)
    return 0.5 * (Mab + Mab.transpose(1, 0, 3, 2))


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

    def moments(self, points: FloatArray, field: FloatArray) -> FloatArray:
        """(k, 3, 3) sums of s f^T, s from the node, of a force per mass G s + g, field [G, g]."""
        at_nodes = points[self.nodes] @ field[:, :3].T + field[:, 3]
        first, second = self._about_nodes()
        return np.asarray(first[:, :, None] * at_nodes[:, None] + second @ field[:, :3].T)

    def _about_nodes(self) -> tuple[FloatArray, FloatArray]:
        """First and second moments."""
        first = self.mass[:, None] * self.arm
        second = self.second + first[:, :, None] * self.arm[:, None, :]
        return first, second

    def _components(self, points: FloatArray, width: int) -> ComponentMass:
        x, eye, m = points[self.nodes], np.eye(3), self.mass
        first, second = self._about_nodes()
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
    mesh: Mesh, numbering: Numbering, options_by_name: Mapping[str, Mapping[str, Any]]
) -> NodalInertia:
    """Point masses and masses spread over groups.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    numbering : Numbering
        Degrees of freedom of the body.
    options_by_name : mapping of str to mapping
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
    masses: list[NodalInertia] = []
    problems: list[Problem] = []
    for name, words in options_by_name.items():
        try:
            masses.append(_make_point_mass(mesh, numbering, f"masses.{name}", words))
        except MeshError as error:
            problems += error.problems
    if problems:
        raise MeshError.from_problems(problems)
    return join(masses)


def join(parts: list[NodalInertia]) -> NodalInertia:
    """All of them as one."""
    empty = NodalInertia(np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    columns = zip(*(vars(part).values() for part in (empty, *parts)), strict=True)
    return NodalInertia(*(np.concatenate(column) for column in columns))


def _make_point_mass(
    mesh: Mesh, numbering: Numbering, where: str, words: Mapping[str, Any]
) -> NodalInertia:
    options = read_options(MassOptions, words, where, MeshError)
    mass, arm = float(options.mass), np.array(options.offset or (0.0, 0.0, 0.0), dtype=float)
    second = _second_moment(options.inertia, f"{where}.inertia")
    nodes = _mass_nodes(mesh, numbering, options.at, f"{where}.at")
    if arm.any() or second.any():
        _check_rotations(numbering, nodes, where)
    share = _shares(mesh, options.at, nodes) * mass
    count = len(nodes)
    return NodalInertia(nodes, share, np.tile(arm, (count, 1)), np.tile(second, (count, 1, 1)))


def _check_rotations(numbering: Numbering, nodes: IntArray, where: str) -> None:
    if len(nodes) > 1:
        what = f"a mass spread over {len(nodes)} nodes has neither inertia nor offset of its own"
        raise MeshError(f"{where}: {what}: put it on the reference node of a tie")
    if numbering.table[nodes[0], 3] < 0:
        what = f"node {nodes[0]} has no rotations, so it carries neither inertia nor offset"
        raise MeshError(f"{where}: {what}: put it on the reference node of a tie (rbe2 or rbe3)")


def _mass_nodes(mesh: Mesh, numbering: Numbering, at: str | int, where: str) -> IntArray:
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
                corners = {"line": 2, "tria": 3, "quad": 4}[kind[:4]]
                x = mesh.points[cells[:, :corners]]
                size = np.linalg.norm(x[:, 1] - x[:, 0], axis=1) if dim == 1 else _areas(x)
                np.add.at(weight, cells, (size / cells.shape[1])[:, None])
        if weight.any():
            break
    share = weight[nodes] if weight.any() else np.ones(len(nodes))
    return share / share.sum()


def _areas(x: FloatArray) -> FloatArray:
    """(ne,) areas of flat polygons with corners (ne, k, 3)."""
    arms = x[:, 1:] - x[:, :1]
    return 0.5 * np.linalg.norm(np.cross(arms[:, :-1], arms[:, 1:]).sum(axis=1), axis=1)


def _second_moment(inertia: Any, where: str) -> FloatArray:
    """(3, 3) 1/2 tr(J) I - J."""
    if inertia is None:
        return np.zeros((3, 3))
    what = "[Jxx, Jyy, Jzz] or a 3 x 3 matrix [kg m^2]"
    rows = np.shape(inertia) == (3, 3)
    J = _numbers(inertia, (3, 3) if rows else (3,), where, what)
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


def _numbers(value: Any, shape: tuple[int, ...], where: str, what: str) -> FloatArray:
    try:
        values = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if values.shape != shape or not np.isfinite(values).all() or isinstance(value, bool):
        raise MeshError(f"{where}: expects {what}, given {value!r}")
    return values


class LumpedSum:
    """The mass of elements at ``count`` nodes, summed batch by batch."""

    def __init__(self, count: int) -> None:
        self._mass, self._J = np.zeros(count), np.zeros(count)

    def add(self, mass: ScalarMass | ComponentMass, nodes: IntArray) -> None:
        """Add elements with their nodes (ne, k)."""
        if isinstance(mass, ScalarMass):
            entries = np.einsum("eii->ei", mass.M)
            total, turning = mass.M.sum(axis=(1, 2)), None
        else:
            diagonal = np.einsum("ebbii->ei", mass.Mab).reshape(*nodes.shape, 6)
            entries, turning = diagonal[..., :3].mean(axis=2), diagonal[..., 3:].mean(axis=2)
            total = mass.mass
        scale = (total / entries.sum(axis=1))[:, None]
        np.add.at(self._mass, nodes, scale * entries)
        if turning is not None:
            np.add.at(self._J, nodes, scale * turning)

    def total(self) -> NodalInertia:
        """The sum, at the nodes that have any."""
        nodes = np.flatnonzero(self._mass)
        second = 0.5 * self._J[nodes, None, None] * np.eye(3)
        return NodalInertia(nodes, self._mass[nodes], np.zeros((len(nodes), 3)), second)
