"""Models from bases of scikit-fem with assembled stiffness and mass.

A basis must be one of three
displacements with a Lagrange element (P1, P2, Q1, serendipity or Q2 on tetrahedra and hexahedra, or
any other whose functions are one at their own node). Its mass matrix is then one scalar matrix for
all three directions and, with the positions of the nodes, gives every inertia integral exactly.
Stress is recovered if the element is one of `fe.elements.element_blocks.FAMILIES` and a material is
given.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_array, issparse
from skfem import CellBasis, ElementVector

from flexmb.errors import MeshError, Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.mass import Inertia, join
from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.elements.element_blocks import FAMILIES, Block
from flexmb.fe.elements.solid_elements import Solid
from flexmb.fe.meshes.scikit_fem_mesh import mesh_with_groups
from flexmb.fe.sections.section_tables import SolidSection
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.materials import AnyMaterial
from flexmb.units import unit_system

# relative difference below which entries of matrices, or reference coordinates, are equal
_EQUAL = 1e-9
# largest stiffness against rigid motions of a free body, relative to the diagonal
_RIGID_STIFFNESS = 1e-6


def model_from_basis(
    basis: CellBasis, stiffness: Any, mass: Any, material: AnyMaterial | None = None
) -> FEMatrices:
    """A model of assembled matrices, in SI.

    Parameters
    ----------
    basis : skfem.CellBasis
        Of three displacements: ``CellBasis(mesh, ElementVector(element))``.
    stiffness, mass : (N, N) sparse
        Over its degrees of freedom, of the free body: no boundary conditions.
    material : Material or OrthotropicMaterial, optional
        For stress.

    Raises
    ------
    ReductionError
        Everything that is wrong with basis or matrices.
    """
    problems = _basis_problems(basis)
    if problems:
        raise ReductionError.from_problems(problems)
    K = _checked("stiffness", stiffness, basis.N, problems)
    M = _checked("mass", mass, basis.N, problems)
    if problems:
        raise ReductionError.from_problems(problems)
    x_dofs = np.unique(basis.element_dofs[0::3])
    node_of = np.full(basis.N, -1)
    node_of[x_dofs] = np.arange(len(x_dofs))
    table = np.full((len(x_dofs), 6), -1)
    for c in range(3):
        table[node_of[basis.element_dofs[0::3]], c] = basis.element_dofs[c::3]
    points = np.ascontiguousarray(basis.doflocs[:, x_dofs].T)
    kind, order = _kind(basis)
    blocks = {}
    if kind:
        blocks[kind] = node_of[basis.element_dofs[0::3][order]].T
    vertices = node_of[basis.nodal_dofs[0]] if len(basis.nodal_dofs) else np.zeros(0, dtype=int)
    mesh = mesh_with_groups(basis.mesh, points, blocks, vertices, "scikit-fem basis")
    elements = ()
    if kind:
        section = SolidSection().with_material(material)
        cells = mesh.blocks[kind]
        elements = (Block(kind, cells, np.arange(len(cells)), section, "all"),)
    numbering = Numbering(table, basis.N, basis.N)
    model = FEMatrices(
        mesh, material, elements, numbering, K, M, _inertia(M, table, points), join([])
    )
    _check_rigid_motion(model)
    return model


def has_stress(model: FEMatrices) -> bool:
    """Whether stress can be recovered: a material, and elements without incompatible modes."""
    kinds = {block.kind for block in model.blocks}
    return model.material is not None and bool(kinds) and "hexahedron" not in kinds


def _kind(basis: CellBasis) -> tuple[str, IntArray]:
    """The element family with the same nodes, and which function of the basis each node has."""
    places = basis.elem.elem.doflocs
    for kind, family in FAMILIES.items():
        if not isinstance(family, Solid) or len(family.reference.nodes) != len(places):
            continue
        apart = np.abs(family.reference.nodes[:, None] - places[None]).max(axis=2)
        if apart.min(axis=1).max() < _EQUAL:
            return kind, apart.argmin(axis=1)
    return "", np.zeros(0, dtype=np.int64)


def _basis_problems(basis: CellBasis) -> list[Problem]:
    element = basis.elem
    if not isinstance(element, ElementVector) or element.dim != 3 or basis.mesh.dim() != 3:
        what = "must have three displacements on a mesh of solids: "
        what += "CellBasis(mesh, ElementVector(element)); shells and beams are flexmb's own: "
        return [Problem("basis", what + "give the mesh with sections")]
    return []


def _checked(name: str, matrix: Any, n: int, problems: list[Problem]) -> csr_array:
    """The matrix made exactly symmetric; what is wrong with it is added to ``problems``."""
    if matrix is None:
        problems.append(Problem(name, "is missing: a basis comes with stiffness and mass"))
        return csr_array((n, n))
    if np.shape(matrix) != (n, n):
        what = f"must have shape ({n}, {n}), as the basis has {n} degrees of freedom, has "
        problems.append(Problem(name, f"{what}{np.shape(matrix)}"))
        return csr_array((n, n))
    sparse = csr_array(matrix if issparse(matrix) else np.asarray(matrix, dtype=float))
    size = float(np.abs(sparse.data).max(initial=0.0))
    if not np.isfinite(size) or size == 0.0:
        problems.append(Problem(name, "must have finite entries, not all zero"))
        return sparse
    gap = float(np.abs((sparse - sparse.T).data).max(initial=0.0)) / size
    if gap > _EQUAL:
        what = f"must be symmetric, differs from its transpose by {gap:.1e} of its largest entry"
        problems.append(Problem(name, what))
    if name == "mass" and not (sparse.diagonal() > 0).all():
        problems.append(Problem(name, "must have a positive diagonal"))
    return csr_array(0.5 * (sparse + sparse.T))


def _inertia(M: csr_array, table: IntArray, points: FloatArray) -> Inertia:
    """Rigid-body data and second-moment form from the scalar mass matrix that all directions
    share."""
    x, y, z = (table[:, c] for c in range(3))
    scalar = csr_array(M[x][:, x])
    size = float(np.abs(scalar.data).max())
    blocks = [M[y][:, y] - scalar, M[z][:, z] - scalar, M[x][:, y], M[y][:, z], M[z][:, x]]
    if max(float(np.abs(part.data).max(initial=0.0)) for part in map(csr_array, blocks)) > (
        _EQUAL * size
    ):
        what = "must be the same in x, y and z and couple no two of them: int rho u . v dx"
        raise ReductionError.from_problems([Problem("mass", what)])
    weight, moment = scalar @ np.ones(len(points)), scalar @ points
    p, P = np.zeros((3, table[:, :3].size)), np.zeros((3, 3, table[:, :3].size))
    for b in range(3):
        p[b, table[:, b]] = weight
        P[:, b, table[:, b]] = moment.T
    S0 = points.T @ moment
    return Inertia(float(weight.sum()), moment.sum(axis=0), 0.5 * (S0 + S0.T), p, P, scalar)


def _check_rigid_motion(model: FEMatrices) -> None:
    """Refuse a stiffness that resists rigid motions: that of a body with boundary conditions."""
    R = model.rigid
    force = np.abs(model.K @ R).max(axis=0)
    scale = model.K.diagonal().max() * np.abs(R).max(axis=0)
    worst = float((force / scale).max())
    if worst > _RIGID_STIFFNESS:
        what = f"resists rigid motion of the body by {worst:.1e} of its largest entry: give that of"
        what += " the free body, without boundary conditions; interfaces say where joints act"
        raise ReductionError.from_problems([Problem("stiffness", what)])


def refuse_matrices(**matrices: Any) -> None:
    """Refuse matrices that come without a basis: a `MeshError` that names them."""
    what = "goes with a basis of scikit-fem: reduce(basis, stiffness=K, mass=M)"
    raise MeshError.from_problems(
        [Problem(name, what) for name, matrix in matrices.items() if matrix is not None]
    )


def refuse_mesh_options(units: str, **others: Any) -> None:
    """Refuse options of a mesh that come with a basis.

    Raises
    ------
    ReductionError
        Which were given.
    """
    if unit_system(units).name != "SI":
        others["units"] = units
    problems = [
        Problem(name, "does not go with a basis of scikit-fem, whose matrices are complete, in SI")
        for name, value in others.items()
        if value
    ]
    if problems:
        raise ReductionError.from_problems(problems)
