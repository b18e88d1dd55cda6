"""From a mesh in SI units to its stiffness, mass, inertia and geometric stiffness.

:func:`assemble` returns :class:`FEMatrices` with sparse K and M over the body's own numbering.
Every family contributes batches of element matrices, so that solids, shells and beams of one mesh
add up in the same matrices; motions that follow others by a tie are condensed. The stiffness of a
model under stress is K + K_g. Source: Zienkiewicz, Taylor, The Finite Element Method, vol. 2.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from scipy.sparse import csr_array, eye_array, vstack

from flexmb.errors import FlexmbError, FlexmbWarning, Problem, ReductionError, nearest
from flexmb.fe.assembly.connections import Tie, dependence, followers, make_ties, tie_moments
from flexmb.fe.assembly.mass import (
    Inertia,
    LumpedSum,
    MassSum,
    NodalInertia,
    component_masses,
    join,
    nodal_masses,
    reduced_components,
)
from flexmb.fe.assembly.numbering import Accumulator, Numbering, number_nodes, rigid_vectors
from flexmb.fe.assembly.springs import (
    Spring,
    make_springs,
    spring_geometric_stiffness,
    spring_stiffness,
)
from flexmb.fe.elements.element_blocks import Block, select_elements
from flexmb.fe.linear_solver import require_memory
from flexmb.fe.meshes.mesh import Mesh
from flexmb.flexbody.arrays import FloatArray, IntArray, rotation_stiffness
from flexmb.flexbody.mesh_options import MASS_MATRICES
from flexmb.materials import AnyMaterial
from flexmb.progress import Progress, silent

T = TypeVar("T")

_TABLES = 64  # matrices of an element for many stresses: few elements at a time fit into caches
_BYTES = 18.0  # measured bytes of memory per entry of the element matrices, mass included


class ProblemCollector:
    """Runs steps one by one and collects their errors, so that all problems are raised at once."""

    def __init__(self) -> None:
        self.errors: list[FlexmbError] = []

    def __call__(self, function: Callable[..., T], *arguments: Any) -> T | None:
        """The value of the function; None if it raises an error, which is collected."""
        try:
            return function(*arguments)
        except FlexmbError as error:
            self.errors.append(error)
            return None

    @property
    def problems(self) -> list[Problem]:
        """The problems of all steps."""
        every = [problem for error in self.errors for problem in error.problems]
        return list(dict.fromkeys(every))

    def raise_errors(self) -> None:
        """Raise all problems, if there are any, with the class of the first error."""
        if self.errors:
            raise type(self.errors[0]).from_problems(self.problems) from self.errors[0]


@dataclass(frozen=True, eq=False)
class MeshModel:
    """A finite-element model before its matrices; see :class:`FEMatrices`."""

    mesh: Mesh
    material: AnyMaterial
    blocks: tuple[Block, ...]
    numbering: Numbering
    nodal: NodalInertia
    springs: tuple[Spring, ...]
    ties: tuple[Tie, ...]


@dataclass(frozen=True, eq=False)
class FEMatrices:
    """A finite-element model in SI units, body frame.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    material : Material or OrthotropicMaterial
        Material of everything that has no material of its own.
    blocks : tuple of Block
        The elements of the body.
    numbering : Numbering
        Degrees of freedom of the nodes.
    K, M : (n, n) sparse
        Stiffness and mass over the independent degrees of freedom.
    inertia : Inertia
        Rigid data and second-moment form of the mass, over all degrees of freedom.
    nodal : NodalInertia
        Mass at nodes: point masses, and the mass of all elements if it is lumped.
    lumped : bool
        Whether the elements' mass is lumped.
    springs : tuple of Spring
        Springs between nodes.
    ties : tuple of Tie
        Ties of nodes that follow others.
    follow : (n_all - n, n) sparse, optional
        Dependent motions (of nodes that follow) per unit of each independent degree of freedom;
        None without ties.
    tied_stiffness : (n_all - n, n_all) sparse, optional
        Forces on the dependent motions per unit of each motion, without those of ties; None
        without ties.
    """

    mesh: Mesh
    material: AnyMaterial
    blocks: tuple[Block, ...]
    numbering: Numbering
    K: csr_array
    M: csr_array
    inertia: Inertia
    nodal: NodalInertia
    lumped: bool = False
    springs: tuple[Spring, ...] = ()
    ties: tuple[Tie, ...] = ()
    follow: csr_array | None = None
    tied_stiffness: csr_array | None = None

    @property
    def center(self) -> FloatArray:
        """(3,) centre of mass [m]."""
        return self.inertia.S1 / self.inertia.mass

    @property
    def rigid(self) -> FloatArray:
        """(n, 6) rigid motions about the centre of mass."""
        return rigid_vectors(self.numbering, self.mesh.points, self.center)[: self.numbering.n]

    @property
    def dof_points(self) -> FloatArray:
        """(n, 3) position of the node of each independent degree of freedom [m]."""
        table, n = self.numbering.table, self.numbering.n
        nodes = np.zeros(n, dtype=np.int64)
        node, motion = np.nonzero((table >= 0) & (table < n))
        nodes[table[node, motion]] = node
        return self.mesh.points[nodes]

    def expand(self, V: FloatArray) -> FloatArray:
        """(n_all, ...) all motions, with the dependent ones, from the independent ones (n, ...)."""
        return V if self.follow is None else np.concatenate([V, self.follow @ V])

    def load_per_mass(self, field: FloatArray) -> FloatArray:
        """(n_all,) nodal loads of a force per mass G s + g at s, with ``field`` (3, 4) = [G, g]."""
        G, g = field[:, :3], field[:, 3]
        return np.asarray(np.einsum("ba,abn->n", G, self.inertia.P) + g @ self.inertia.p)

    def condensed(self, matrix: csr_array) -> csr_array:
        """(n, n) a matrix over all motions (n_all, n_all), condensed to the independent ones."""
        return _condensed(matrix, self.follow)

    def reduced_mass(self, Phi: FloatArray) -> FloatArray:
        """(3, 3, m, m) Phi^T M_ab Phi for modes Phi (n, m), M_ab = int rho N_a^T N_b."""
        numbering, points = self.numbering, self.mesh.points
        blocks = () if self.lumped else self.blocks
        masses = chain(
            component_masses(blocks, numbering, points), self.nodal.masses(numbering, points)
        )
        return reduced_components(self.inertia, masses, self.numbering, self.expand(Phi))


def assemble(
    mesh: Mesh,
    material: AnyMaterial,
    sections: Mapping[str, Any] | None = None,
    progress: Progress = silent,
    *,
    ties: Mapping[str, Mapping[str, Any]] | None = None,
    masses: Mapping[str, Mapping[str, Any]] | None = None,
    springs: Mapping[str, Mapping[str, Any]] | None = None,
    mass_matrix: str = "consistent",
) -> FEMatrices:
    """Build stiffness, mass and inertia.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    material : Material or OrthotropicMaterial
        Material of all sections that name none.
    sections : mapping of str to section, optional
        By mesh group, or under ``"all"``; lines and surfaces need one to belong to the body.
    progress : Progress
        Called with the phase ``"assemble"``.
    ties : mapping of str to mapping, optional
        ``{name: {type: "rbe2" or "rbe3", reference: node or group, nodes: group}}``.

    masses : mapping of str to mapping
        ``{name: {at: node or group, mass: kg, inertia, offset}}``, see
        :func:`flexmb.fe.assembly.mass.nodal_masses`.
    springs : mapping of str to mapping
        ``{name: {between: [node or group, node or group], stiffness, axes}}``, see
        :func:`flexmb.fe.assembly.springs.make_springs`.
    mass_matrix : str
        ``"consistent"``, or ``"hrz"`` for lumped mass.

    Raises
    ------
    MeshError
        No usable elements, unusable kinds, elements turned inside out; ties, masses or springs
        that cannot be.
    ReductionError
        An unknown mass matrix.
    """
    collector = ProblemCollector()
    model = make_model(
        mesh, material, sections or {}, collector, ties=ties, masses=masses, springs=springs
    )
    collector.raise_errors()
    assert model is not None
    return assemble_model(model, mass_matrix, progress)


def make_model(
    mesh: Mesh,
    material: AnyMaterial | None,
    sections: Mapping[str, Any] | None,
    collector: ProblemCollector,
    *,
    ties: Mapping[str, Mapping[str, Any]] | None = None,
    masses: Mapping[str, Mapping[str, Any]] | None = None,
    springs: Mapping[str, Mapping[str, Any]] | None = None,
) -> MeshModel | None:
    """The elements, degrees of freedom, point masses, springs and ties of a model.

    ``collector`` collects the problems; the other parameters are those of :func:`assemble`. None is
    returned if the elements of the body are not known.
    """
    tied = collector(make_ties, mesh, ties or {}) or ()
    joined = collector(make_springs, mesh, springs or {}) or ()
    blocks = None
    if sections is not None:
        blocks = collector(select_elements, mesh, sections, material)
    if blocks is None:
        return None
    numbering = _number_model(mesh, blocks, tied)
    nodal = collector(nodal_masses, mesh, numbering, masses or {})
    for spring in joined:
        collector(spring_stiffness, spring, numbering, mesh.points)
    return MeshModel(mesh, material, blocks, numbering, nodal, joined, tied)


def assemble_model(
    model: MeshModel, mass_matrix: str = "consistent", progress: Progress = silent
) -> FEMatrices:
    """Build stiffness, mass and inertia of a model; the parameters are those of :func:`assemble`.

    Raises
    ------
    ReductionError
        An unknown mass matrix.
    """
    if mass_matrix not in MASS_MATRICES:
        near = nearest(str(mass_matrix), MASS_MATRICES)
        problem = Problem("mass_matrix", f'unknown "{mass_matrix}"', MASS_MATRICES, near)
        raise ReductionError.from_problems([problem])
    blocks, numbering, points = model.blocks, model.numbering, model.mesh.points
    _require_memory(blocks, numbering)
    stiffness, mass = Accumulator(numbering.n_all), MassSum(numbering, points)
    lumped = mass_matrix == "hrz"
    lumps = _add_elements(blocks, (stiffness, mass), (numbering, points), lumped, progress)
    for spring in model.springs:
        stiffness.add(*spring_stiffness(spring, numbering, points))
    nodal = join([lumps, model.nodal])
    for part in nodal.masses(numbering, points):
        mass.add_components(*part)
    inertia, M = mass.total()
    follow = dependence(model.ties, numbering, model.mesh, blocks) if model.ties else None
    whole = stiffness.matrix()
    K, M = (_condensed(matrix, follow) for matrix in (whole, M))
    progress("assemble", 1.0)
    tied = whole[numbering.n :] if model.ties else None
    matrices = (K, M, inertia, nodal, lumped, model.springs, model.ties, follow, tied)
    return FEMatrices(model.mesh, model.material, blocks, numbering, *matrices)


def _add_elements(
    blocks: tuple[Block, ...],
    sums: tuple[Accumulator, MassSum],
    nodes_of: tuple[Numbering, FloatArray],
    lumped: bool,
    progress: Progress,
) -> NodalInertia:
    """Add stiffness and mass of all elements to the sums; return the lumped mass, if lumped."""
    (stiffness, mass), (numbering, points) = sums, nodes_of
    lumps = LumpedSum(len(points))
    total, done = sum(len(block.nodes) for block in blocks), 0
    for block in blocks:
        _warn(block)
        for nodes in block.chunks(9 if block.family.rotations else 1):
            dofs = numbering.of(nodes, 6 if block.family.rotations else 3)
            stiffness.add(block.family.stiffness(points[nodes], block.section), dofs)
            if lumped:
                lumps.add(block.family.mass(points[nodes], block.section), nodes)
            else:
                mass.add(block, nodes)
            done += len(nodes)
            progress("assemble", min(0.99, done / total))
    return lumps.total()


def _require_memory(blocks: tuple[Block, ...], numbering: Numbering) -> None:
    entries = sum(
        len(block.nodes) * (block.nodes.shape[1] * (6 if block.family.rotations else 3)) ** 2
        for block in blocks
    )
    require_memory(_BYTES * entries, f"the assembly of {numbering.n_all} degrees of freedom")


def _number_model(mesh: Mesh, blocks: tuple[Block, ...], ties: tuple[Tie, ...]) -> Numbering:
    """Degrees of freedom of the nodes of elements and of ties: the references, and nodes without
    elements that follow one rigidly."""
    of_elements = np.unique(np.concatenate([block.nodes.ravel() for block in blocks]))
    whole = [np.array([tie.reference]) for tie in ties]
    whole += [np.setdiff1d(tie.nodes, of_elements) for tie in ties if tie.kind == "rbe2"]
    moving = np.unique(np.concatenate([of_elements, *whole]))
    turning = [block.nodes.ravel() for block in blocks if block.family.rotations]
    rotating = np.unique(np.concatenate([np.zeros(0, dtype=int), *turning, *whole]))
    return number_nodes(len(mesh.points), moving, rotating, followers(ties, len(mesh.points)))


def _warn(block: Block) -> None:
    if block.family.warning:
        text = f'{len(block.nodes)} elements of kind "{block.kind}": {block.family.warning}'
        warnings.warn(text, FlexmbWarning, stacklevel=3)


def _condensed(matrix: csr_array, follow: csr_array | None) -> csr_array:
    if follow is None:
        return matrix
    G = vstack([eye_array(follow.shape[1]), follow]).tocsr()
    return csr_array(G.T @ matrix @ G)


def geometric_stiffness(
    fe: FEMatrices, u: FloatArray, field: FloatArray | None = None, direct: FloatArray | None = None
) -> csr_array:
    """(n, n) geometric stiffness.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    u : (n,) float
        Displacements of a linear static solution, all independent degrees of freedom [m, rad].
    field : (3, 4) float, optional
        [G, g] where a force per mass G s + g at s [m] acts all over the body: on ties, offsets and
        masses that turn; beams take from it how their axial force varies along an element.
    direct : (n_all,) float, optional
        Other loads, of constant direction, as they act on nodes that follow a tie.
    """
    everywhere, within = fe.expand(u), None if fe.lumped else field
    total = Accumulator(fe.numbering.n_all)
    for block, nodes, dofs in _chunks(fe):
        elements = (fe.mesh.points[nodes], block.section, everywhere[dofs])
        total.add(block.family.geometric_stiffness(*elements, within), dofs)
    _add_beside_elements(fe, total, everywhere, field, direct)
    return fe.condensed(total.matrix())


def geometric_forms(
    fe: FEMatrices, modes: FloatArray, U: FloatArray, fields: Sequence[FloatArray],
    progress: Callable[[float], None] = lambda _: None,
) -> FloatArray:  # fmt: skip
    """(k, m, m) geometric stiffness of modes (n, m) by displacements U (n, k) under ``fields``.

    As ``geometric_stiffness`` of each, without its matrix; ``progress`` takes the share done.
    """
    everywhere, Phi = fe.expand(U), fe.expand(modes)
    forms = np.zeros((len(fields), *2 * modes.shape[1:]))
    total, done = sum(len(block.nodes) for block in fe.blocks), 0
    for block, nodes, dofs in _chunks(fe, _TABLES):
        stiffness = block.family.stress_stiffness(fe.mesh.points[nodes], block.section)
        X = Phi[dofs]
        for k, (u, field) in enumerate(zip(everywhere.T, fields, strict=True)):
            K = stiffness(u[dofs], None if fe.lumped else field)
            forms[k] += X.reshape(-1, X.shape[2]).T @ (K @ X).reshape(-1, X.shape[2])
        done += len(nodes)
        progress(done / total)
    for k, (u, field) in enumerate(zip(everywhere.T, fields, strict=True)):
        rest = Accumulator(fe.numbering.n_all)
        _add_beside_elements(fe, rest, u, field, None)
        forms[k] += Phi.T @ (rest.matrix() @ Phi)
    return forms


def _chunks(fe: FEMatrices, matrices: int = 1) -> Iterator[tuple[Block, IntArray, IntArray]]:
    """Block, nodes and degrees of freedom of some elements at a time, with so many matrices."""
    for block in fe.blocks:
        for nodes in block.chunks(matrices):
            yield block, nodes, fe.numbering.of(nodes, 6 if block.family.rotations else 3)


def _add_beside_elements(
    fe: FEMatrices, total: Accumulator, everywhere: FloatArray, field: FloatArray | None,
    direct: FloatArray | None,
) -> None:  # fmt: skip
    """Add the geometric stiffness of springs, ties and masses to ``total`` (n_all, n_all)."""
    table = fe.numbering.table
    for spring in fe.springs:
        total.add(*spring_geometric_stiffness(spring, fe.numbering, fe.mesh.points, everywhere))
    if fe.follow is not None and fe.tied_stiffness is not None:
        n, forces = fe.numbering.n, np.zeros(fe.numbering.n_all)
        forces[n:] = fe.tied_stiffness @ everywhere
        if field is not None:
            forces[n:] -= fe.load_per_mass(field)[n:]
        if direct is not None:
            forces[n:] -= direct[n:]
        moments = tie_moments(fe.ties, fe.numbering, fe.mesh.points, fe.follow, forces)
        references = [tie.reference for tie in fe.ties]
        total.add(rotation_stiffness(moments), table[references, 3:])
    if field is not None and len(fe.nodal.nodes):
        moments = fe.nodal.moments(fe.mesh.points, field)
        total.add(-rotation_stiffness(moments), table[fe.nodal.nodes, 3:])
