"""From a mesh in SI units to its stiffness, mass and inertia.

In: a mesh, a material and the sections of beams. Out: :class:`FEMatrices` with sparse K and M over
the body's own numbering. Each element kind contributes batches of element matrices, so that solids
and beams of one mesh add up in the same matrices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from flexmb.errors import MeshError
from flexmb.fe.assembly.inertia import Inertia, beam_inertia, inertia_sum, solid_inertia
from flexmb.fe.assembly.numbering import Numbering, number_nodes, rigid_vectors
from flexmb.fe.assembly.scatter import scatter
from flexmb.fe.elements import beam, tet10
from flexmb.fe.elements.select import Elements, orientations, select_elements
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.sections.beam import Section
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.materials import Material
from flexmb.progress import Progress, silent

__all__ = ["FEMatrices", "assemble"]

_CHUNK = 4000  # tetrahedra at once: 30 MB for one batch of their matrices


@dataclass(frozen=True, eq=False)
class FEMatrices:
    """A finite-element model in SI units, body frame.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    material : Material
        Of all elements.
    elements : Elements
        The elements of the body.
    numbering : Numbering
        Degrees of freedom of the nodes.
    K, M : (n, n) sparse
        Stiffness and consistent mass.
    inertia : Inertia
        Rigid data and second-moment form of the mass.
    """

    mesh: Mesh
    material: Material
    elements: Elements
    numbering: Numbering
    K: csr_array
    M: csr_array
    inertia: Inertia

    @property
    def center(self) -> FloatArray:
        """(3,) centre of mass [m]."""
        return self.inertia.S1 / self.inertia.mass

    @property
    def rigid(self) -> FloatArray:
        """(n, 6) rigid motions about the centre of mass."""
        return rigid_vectors(self.numbering, self.mesh.points, self.center)


def assemble(
    mesh: Mesh,
    material: Material,
    sections: Mapping[str, Section] | None = None,
    progress: Progress = silent,
) -> FEMatrices:
    """Build stiffness, mass and inertia.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    material : Material
        Of all elements.
    sections : mapping of str to Section, optional
        Section of the line elements by group, or under ``"all"``.
    progress : Progress
        Told the phase ``"assemble"``.

    Raises
    ------
    MeshError
        No usable elements, unusable kinds, or elements turned inside out.
    """
    elements = select_elements(mesh, sections)
    moving = np.union1d(elements.tets, elements.lines)
    numbering = number_nodes(len(mesh.points), moving, np.unique(elements.lines))
    K = csr_array((numbering.n, numbering.n))
    solid = slender = None
    if len(elements.tets):
        K_solid, solid = _assemble_tets(mesh, elements.tets, numbering, material, progress)
        K = K + K_solid
    if len(elements.lines):
        K_beam, slender = _assemble_beams(mesh, elements, numbering, material)
        K = K + K_beam
    inertia = inertia_sum(solid, slender)
    progress("assemble", 1.0)
    M = inertia.mass_matrix()
    return FEMatrices(mesh, material, elements, numbering, K, M, inertia)


def _assemble_tets(
    mesh: Mesh, tets: IntArray, numbering: Numbering, material: Material, progress: Progress
) -> tuple[csr_array, Inertia]:
    nodes, local = np.unique(tets, return_inverse=True)
    local = local.reshape(tets.shape)
    dofs = numbering.table[nodes, :3]
    element_dofs = dofs[local].reshape(len(tets), 30)
    lam = material.E * material.nu / ((1 + material.nu) * (1 - 2 * material.nu))
    mu = material.E / (2 * (1 + material.nu))
    K, scalar = csr_array((numbering.n, numbering.n)), csr_array((len(nodes), len(nodes)))
    for start in range(0, len(tets), _CHUNK):
        part = slice(start, start + _CHUNK)
        x = mesh.points[tets[part]]
        _check_shape(mesh, x, tets[part])
        K = K + scatter(tet10.stiffness(x, (lam, mu)), element_dofs[part], numbering.n)
        scalar = scalar + scatter(tet10.mass(x, material.density), local[part], len(nodes))
        progress("assemble", min(1.0, (start + _CHUNK) / len(tets)))
    return K, solid_inertia(scalar, dofs, mesh.points[nodes], numbering.n)


def _check_shape(mesh: Mesh, x: FloatArray, tets: IntArray) -> None:
    bad = tet10.inverted(x)
    if len(bad):
        corners = ", ".join(str(node) for node in tets[bad[0], :4])
        what = f"{len(bad)} tetrahedra are flat or turned inside out, the first with corner nodes"
        raise MeshError(f"{mesh.source}: {what} {corners}; improve the mesh (gmsh: HighOrder)")


def _assemble_beams(
    mesh: Mesh, elements: Elements, numbering: Numbering, material: Material
) -> tuple[csr_array, Inertia]:
    ends = mesh.points[elements.lines]
    values = {
        name: np.array([getattr(section, name) for section in elements.sections])
        for name in ("A", "Iy", "Iz", "J", "ky", "kz")
    }
    axes = beam.local_axes(ends, orientations(elements))
    beams = beam.Beams(ends, axes, **values, material=material)
    dofs = numbering.table[elements.lines].reshape(-1, 12)
    K = scatter(beam.stiffness(beams), dofs, numbering.n)
    return K, beam_inertia(beam.mass(beams), dofs, numbering.n)
