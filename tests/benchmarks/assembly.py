"""Our assembly against that of scikit-fem; run by hand: `python -m tests.benchmarks.assembly`.

One row for each solid at about 100 000 degrees of freedom: CPU seconds for the stiffness matrix by
our batches, by a `BilinearForm` of scikit-fem with the same integration points, and their ratio;
the same for the mass matrix. scikit-fem assembles mass as one scalar form for all three directions,
as we do. The last rows are the sum of element matrices alone, by our accumulator and by `COOData`.
"""

from __future__ import annotations

import time

import numpy as np
import skfem
from scipy.sparse import coo_array
from skfem import BilinearForm, CellBasis, ElementVector
from skfem.helpers import ddot, eye, sym_grad, trace

from flexmb.fe import resolve
from flexmb.fe.assembly.numbering import Accumulator
from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.fe.meshes.mesh_shapes import mesh_from
from flexmb.fe.meshes.scikit_fem_mesh import mesh_from_skfem
from flexmb.fe.sections.section_tables import SolidSection

_STEEL = resolve("steel")
_KINDS = {  # scikit-fem's mesh and element, divisions, orders of the rules for stiffness and mass
    "tetra": (skfem.MeshTet1, skfem.ElementTetP1, (32, 31, 31), (1, 2)),
    "tetra10": (skfem.MeshTet1, skfem.ElementTetP2, (16, 15, 15), (2, 5)),
    "hexahedron20": (skfem.MeshHex1, skfem.ElementHexS2, (20, 20, 20), (5, 5)),
    "hexahedron27": (skfem.MeshHex1, skfem.ElementHex2, (16, 15, 15), (5, 5)),
}


@BilinearForm
def elasticity(u, v, w):
    """Isotropic stiffness."""
    mu = _STEEL.G
    lam = 2 * mu * _STEEL.nu / (1 - 2 * _STEEL.nu)
    strain = sym_grad(u)
    return ddot(2 * mu * strain + lam * eye(trace(strain), 3), sym_grad(v))


@BilinearForm
def scalar_mass(u, v, w):
    """Mass of one direction."""
    return _STEEL.density * u * v


def cpu(function, repeats=2):
    """Least CPU time of some calls [s]."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def ours(kind, mesh, n):
    """Functions that assemble our stiffness and our scalar mass."""
    family, cells, section = FAMILIES[kind], mesh.blocks[kind], SolidSection(_STEEL)
    d = 3 * cells.shape[1]
    size = max(1, int(3e7 / (8 * d * d)))
    batches = [cells[k : k + size] for k in range(0, len(cells), size)]
    dofs = [(3 * part[:, :, None] + np.arange(3)).reshape(len(part), -1) for part in batches]

    def stiffness():
        total = Accumulator(n)
        for part, numbers in zip(batches, dofs, strict=True):
            total.add(family.stiffness(mesh.points[part], section), numbers)
        return total.matrix()

    def mass():
        total = Accumulator(n // 3)
        for part in batches:
            total.add(family.mass(mesh.points[part], section).M, part)
        return total.matrix()

    return stiffness, mass


def summation():
    """Accumulator against COOData on the element matrices of second-order hexahedra."""
    mesh = mesh_from({"type": "box", "size": [1, 1, 1], "divisions": [20, 20, 20]})
    cells = mesh.blocks["hexahedron20"]
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), -1)
    K = FAMILIES["hexahedron20"].stiffness(mesh.points[cells], SolidSection(_STEEL))
    n, d = 3 * len(mesh.points), dofs.shape[1]

    def accumulate():
        total = Accumulator(n)
        total.add(K, dofs)
        return total.matrix()

    def coo():
        rows, columns = np.repeat(dofs, d, axis=1).ravel(), np.tile(dofs, (1, d)).ravel()
        return coo_array((K.ravel(), (rows, columns)), shape=(n, n)).tocsr()

    return cpu(accumulate), cpu(coo)


def main():
    """Print the table."""
    print(f"{'element':>14} {'DOF':>8} {'K ours':>8} {'K skfem':>8} {'ratio':>6}", end="")
    print(f" {'M ours':>8} {'M skfem':>8} {'ratio':>6}")
    for kind, (grid, element, divisions, orders) in _KINDS.items():
        axes = [np.linspace(0, 1, n + 1) for n in divisions]
        basis = CellBasis(grid.init_tensor(*axes), ElementVector(element()), intorder=orders[0])
        scalar = CellBasis(basis.mesh, element(), intorder=orders[1])
        mesh = (
            mesh_from(
                {"type": "box", "size": [1, 1, 1], "divisions": list(divisions), "elements": kind}
            )
            if kind != "tetra"
            else mesh_from_skfem(basis.mesh)
        )
        K, M = ours(kind, mesh, 3 * len(mesh.points))
        pairs = ((K, elasticity, basis), (M, scalar_mass, scalar))
        row = [(cpu(f), cpu(lambda form=form, b=b: form.assemble(b), 1)) for f, form, b in pairs]
        print(f"{kind:>14} {basis.N:8d}", end="")
        for own, theirs in row:
            print(f" {own:8.2f} {theirs:8.2f} {theirs / own:6.1f}", end="")
        print()
    own, theirs = summation()
    print(f"{'sum of K alone':>14} {'':8} {own:8.2f} {theirs:8.2f} {theirs / own:6.1f}  (COO)")


if __name__ == "__main__":
    main()
