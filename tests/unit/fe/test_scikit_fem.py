"""Models that come from scikit-fem, and our matrices against those that its forms assemble."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from femeshes import line
from scipy.sparse.linalg import spsolve
from skfem import BilinearForm, CellBasis, ElementVector
from skfem.helpers import ddot, dot, eye, sym_grad, trace

import flexmb
from flexmb.errors import FlexmbError
from flexmb.fe import Mesh, assemble, read_mesh, rectangle, resolve, shell
from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.fe.elements.element_family import wedge15
from flexmb.fe.meshes.scikit_fem_mesh import mesh_from_skfem
from flexmb.fe.scikit_fem import model_from_basis

STEEL = resolve("steel")
ENDS = {"left": "x0", "right": {"group": "x1", "type": "rbe3"}}


@BilinearForm
def elasticity(u, v, w):
    E, nu = STEEL.E, STEEL.nu
    mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    strain = sym_grad(u)
    return ddot(2 * mu * strain + lam * eye(trace(strain), 3), sym_grad(v))


@BilinearForm
def inertia(u, v, w):
    return STEEL.density * dot(u, v)


def bar(kind=skfem.MeshTet1, cells=(4, 2, 2)):
    """A bar 1 x 0.2 x 0.1 m with its ends as boundaries."""
    axes = [np.linspace(0, size, n + 1) for size, n in zip((1, 0.2, 0.1), cells, strict=True)]
    mesh = kind.init_tensor(*axes)
    return mesh.with_boundaries({"x0": lambda x: x[0] == 0, "x1": lambda x: x[0] == 1})


def distorted(mesh, amount=0.02):
    """Inner and outer vertices moved at random; straight edges."""
    move = np.random.default_rng(0).uniform(-amount, amount, mesh.p.shape)
    return type(mesh)(mesh.p + move, mesh.t)


class Bubbles(skfem.ElementHex1):
    """Three bubbles 1 - r^2 inside a hexahedron: the incompatible modes of QM6."""

    nodal_dofs, interior_dofs, maxdeg = 0, 3, 2
    dofnames = ["b", "b", "b"]
    doflocs = np.full((3, 3), 0.5)

    def lbasis(self, X, i):
        slope = np.zeros_like(X)
        slope[i] = 4 - 8 * X[i]
        return 4 * X[i] * (1 - X[i]), slope


class Wedge15(skfem.ElementWedge1):
    """Our wedge of 15 nodes as functions inside each element, to compare element by element."""

    nodal_dofs, interior_dofs, maxdeg = 0, 15, 4
    doflocs = wedge15().nodes

    def lbasis(self, X, i):
        N, dN = wedge15().shapes(X.reshape(3, -1).T)
        return N[:, i].reshape(X.shape[1:]), dN[:, :, i].T.reshape(X.shape)


@pytest.mark.parametrize(
    ("kind", "mesh", "element", "orders"),
    [
        ("tetra", skfem.MeshTet1, skfem.ElementTetP1, (1, 2)),
        ("tetra10", skfem.MeshTet1, skfem.ElementTetP2, (2, 5)),
        ("hexahedron20", skfem.MeshHex1, skfem.ElementHexS2, (5, 5)),
        ("hexahedron27", skfem.MeshHex1, skfem.ElementHex2, (5, 5)),
    ],
)
@pytest.mark.parametrize("crooked", [False, True])
def test_solids_are_those_of_scikit_fem(kind, mesh, element, orders, crooked):
    """K and M of the same mesh, integrated by the same rules, to 1e-12 of the largest entry."""
    grid = distorted(bar(mesh)) if crooked else bar(mesh)
    K, M = (
        form.assemble(CellBasis(grid, ElementVector(element()), intorder=order))
        for form, order in zip((elasticity, inertia), orders, strict=True)
    )
    basis = CellBasis(grid, ElementVector(element()))
    theirs = model_from_basis(basis, K, M)
    ours = assemble(Mesh(theirs.mesh.points, {kind: theirs.mesh.blocks[kind]}), STEEL)
    order = theirs.numbering.table[:, :3].ravel()
    for a, b in ((ours.K, theirs.K), (ours.M, theirs.M)):
        assert abs(a - b[order][:, order]).max() <= 1e-12 * abs(b).max()
    np.testing.assert_allclose(ours.inertia.S0, theirs.inertia.S0, rtol=1e-12, atol=1e-12)


def test_the_hexahedron_with_incompatible_modes_is_scikit_fem_with_bubbles():
    """On boxes, where the Jacobian is constant; the bubbles are condensed out of all at once."""
    grid = bar(skfem.MeshHex1)
    nodal = CellBasis(grid, ElementVector(skfem.ElementHex1()), intorder=3)
    inner = CellBasis(grid, ElementVector(Bubbles()), intorder=3)
    K, C, B = (elasticity.assemble(*b) for b in ((nodal,), (nodal, inner), (inner,)))
    condensed = K - C.T @ spsolve(B.tocsc(), C.tocsc())
    M = inertia.assemble(CellBasis(grid, ElementVector(skfem.ElementHex1()), intorder=5))
    theirs = model_from_basis(nodal, condensed, M)
    ours = assemble(Mesh(theirs.mesh.points, dict(theirs.mesh.blocks)), STEEL)
    order = theirs.numbering.table[:, :3].ravel()
    for a, b in ((ours.K, theirs.K), (ours.M, theirs.M)):
        assert abs(a - b[order][:, order]).max() <= 1e-12 * abs(b).max()


def test_the_wedge_is_that_of_a_form_of_scikit_fem():
    """Element by element; scikit-fem has the mapping of the wedge, the functions are ours."""
    grid = distorted(skfem.MeshWedge1(), 0.1)
    family = FAMILIES["wedge15"]
    corners = grid.p[:, grid.t].transpose(2, 1, 0)
    rst = wedge15().nodes
    flat = np.stack([1 - rst[:, 0] - rst[:, 1], rst[:, 0], rst[:, 1]], axis=1)
    N = np.concatenate([flat * (1 - rst[:, 2:]), flat * rst[:, 2:]], axis=1)
    x = np.einsum("ki,eic->ekc", N, corners)
    for form, matrices, rule in (
        (elasticity, family.stiffness(x, _solid()), family.rule),
        (inertia, None, family.mass_rule),
    ):
        basis = CellBasis(grid, ElementVector(Wedge15()), quadrature=(rule.X.T, rule.w))
        theirs = form.assemble(basis).toarray()
        for e in range(x.shape[0]):
            dofs = basis.element_dofs[:, e]
            wanted = theirs[np.ix_(dofs, dofs)]
            if matrices is None:
                scalar = family.mass(x, _solid()).M[e]
                ours = np.kron(scalar, np.eye(3))
            else:
                ours = matrices[e]
            assert np.abs(ours - wanted).max() <= 1e-12 * np.abs(wanted).max()


def _solid():
    from flexmb.fe import SolidSection

    return SolidSection(STEEL)


def test_beams_are_the_hermite_line_of_scikit_fem():
    """Bending in the xz plane of Euler-Bernoulli beams, with the section's rotary inertia."""
    section = rectangle(0.02, 0.03, shear=False)
    fe = assemble(line(5), STEEL, {"all": section})
    x = np.unique(fe.mesh.points[:, 0])
    basis = CellBasis(skfem.MeshLine(x), skfem.ElementLineHermite(), intorder=6)
    E, rho = STEEL.E, STEEL.density

    @BilinearForm
    def bending(u, v, w):
        return E * section.Iy * ddot(u.hess, v.hess)

    @BilinearForm
    def rotary(u, v, w):
        return rho * (section.A * u * v + section.Iy * dot(u.grad, v.grad))

    # w and theta_y = -w' of each node
    at = fe.numbering.table[np.argsort(fe.mesh.points[:, 0])][:, [2, 4]].ravel()
    sign = np.tile([1.0, -1.0], len(x))
    order = basis.nodal_dofs[:, np.argsort(basis.mesh.p[0])].T.ravel()
    for ours, form in ((fe.K, bending), (fe.M, rotary)):
        wanted = form.assemble(basis)[order][:, order].toarray() * np.outer(sign, sign)
        found = ours[at][:, at].toarray()
        assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("element", [skfem.ElementTriMorley, skfem.ElementTriArgyris])
@pytest.mark.parametrize("kappa", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -0.2, 0.7)])
def test_kirchhoff_plates_have_the_energy_of_scikit_fem(element, kappa):
    """The matrices differ (DKT is another element), but both represent constant curvature exactly:
    the energy of w = kx x^2/2 + ky y^2/2 + kxy x y agrees to 1e-12."""
    grid = skfem.MeshTri.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 0.7, 3))
    grid = skfem.MeshTri(grid.p + 0.03 * np.sin(7 * grid.p[::-1]), grid.t)
    t, (kx, ky, kxy) = 0.01, kappa
    D = STEEL.E * t**3 / (12 * (1 - STEEL.nu**2))

    @BilinearForm
    def plate(u, v, w):
        H, G = u.hess, v.hess
        lap = H[0][0] + H[1][1]
        nu = STEEL.nu
        return D * (nu * lap * (G[0][0] + G[1][1]) + (1 - nu) * ddot(np.array(H), np.array(G)))

    basis = CellBasis(grid, element(), intorder=8)

    @skfem.LinearForm
    def load(v, w):
        x, y = w.x
        field = 0.5 * kx * x**2 + 0.5 * ky * y**2 + kxy * x * y
        return field * v

    @BilinearForm
    def product(u, v, w):
        return u * v

    w = spsolve(product.assemble(basis).tocsc(), load.assemble(basis))
    wanted = w @ plate.assemble(basis) @ w
    points = np.column_stack([grid.p.T, np.zeros(grid.p.shape[1])])
    fe = assemble(Mesh(points, {"triangle": grid.t.T}), STEEL, {"all": shell(t, shear=False)})
    x, y = grid.p
    u = np.zeros(fe.numbering.n)
    table = fe.numbering.table
    u[table[:, 2]] = 0.5 * kx * x**2 + 0.5 * ky * y**2 + kxy * x * y
    u[table[:, 3]] = ky * y + kxy * x  # theta_x = dw/dy
    u[table[:, 4]] = -(kx * x + kxy * y)
    exact = D * (kx**2 + ky**2 + 2 * STEEL.nu * kx * ky + 2 * (1 - STEEL.nu) * kxy**2)
    exact *= skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis)
    assert u @ (fe.K @ u) == pytest.approx(exact, rel=1e-12)
    assert wanted == pytest.approx(exact, rel=1e-9 if element is skfem.ElementTriArgyris else 1e-11)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (skfem.MeshTet1, "tetra"),
        (skfem.MeshTet2, "tetra10"),
        (skfem.MeshHex1, "hexahedron"),
        (skfem.MeshHex2, "hexahedron27"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*first-order tetrahedra")
def test_a_mesh_of_scikit_fem_is_a_mesh(kind, name):
    linear = bar(skfem.MeshTet1 if "Tet" in kind.__name__ else skfem.MeshHex1)
    grid = linear if kind is type(linear) else kind.from_mesh(linear)
    grid = grid.with_boundaries({"x0": lambda x: x[0] == 0, "x1": lambda x: x[0] == 1})
    mesh = mesh_from_skfem(grid)
    assert list(mesh.blocks)[0] == name
    np.testing.assert_allclose(mesh.points[mesh.group_nodes("x1"), 0], 1.0)
    body = flexmb.reduce(grid, material="steel", interfaces=ENDS, modes=4)
    assert body.mass == pytest.approx(STEEL.density * 0.02, rel=1e-12)
    np.testing.assert_allclose(body.interface("right").position, [1, 0.1, 0.05], atol=1e-12)
    assert body.stress is not None


def test_subdomains_take_sections_and_plane_meshes_lie_in_xy():
    grid = skfem.MeshQuad.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 0.2, 3))
    grid = grid.with_subdomains({"skin": lambda x: x[0] < 2}).with_boundaries(
        {"x0": lambda x: x[0] == 0}
    )
    sections = {"skin": {"type": "shell", "thickness": 0.01}}
    body = flexmb.reduce(
        grid, material="steel", sections=sections, interfaces={"root": "x0"}, modes=3
    )
    assert body.mass == pytest.approx(STEEL.density * 0.2 * 0.01)


def own(element=skfem.ElementTetP2, mesh=skfem.MeshTet1):
    basis = CellBasis(bar(mesh), ElementVector(element()), intorder=5)
    return basis, elasticity.assemble(basis), inertia.assemble(basis)


@pytest.mark.parametrize(
    ("element", "mesh"), [(skfem.ElementTetP2, skfem.MeshTet1), (skfem.ElementHex2, skfem.MeshHex1)]
)
def test_a_model_of_scikit_fem_is_reduced_as_ours(element, mesh):
    """Frequencies, inertia integrals, motion of nodes and stress of the same mesh."""
    basis, K, M = own(element, mesh)
    body = flexmb.reduce(
        basis, stiffness=K, mass=M, material="steel", interfaces=ENDS, modes=6, name="bar"
    )
    twin = model_from_basis(basis, K, M)
    ours = flexmb.reduce(twin.mesh, material="steel", interfaces=ENDS, modes=6, name="bar")
    np.testing.assert_allclose(body.frequencies, ours.frequencies, rtol=1e-8)
    np.testing.assert_allclose(body.S0, ours.S0, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(np.abs(body.p), np.abs(ours.p), atol=1e-6)
    np.testing.assert_allclose(
        np.abs(body.interface("right").Phi_t), np.abs(ours.interface("right").Phi_t), atol=1e-5
    )
    moved, wanted = (np.abs(part.nodes.Phi_t) for part in (body, ours))
    np.testing.assert_allclose(moved, wanted, atol=1e-4 * wanted.max())
    assert body.stress.modes.shape == ours.stress.modes.shape
    largest = np.abs(ours.stress.modes).max()
    np.testing.assert_allclose(
        np.abs(body.stress.modes), np.abs(ours.stress.modes), atol=1e-3 * largest
    )


def test_a_model_without_material_has_no_stress_and_any_lagrange_element_does():
    basis, K, M = own()
    words = {"stiffness": K, "mass": M, "interfaces": {"left": "x0"}, "modes": 4}
    body = flexmb.reduce(basis, **words)
    assert body.stress is None and body.surface is not None
    with pytest.raises(FlexmbError, match="geometric_stiffening: .* give the material"):
        flexmb.reduce(basis, **words, geometric_stiffening="full")
    basis, K, M = own(skfem.ElementHex1, skfem.MeshHex1)
    made = flexmb.reduce(basis, stiffness=K, mass=M, material="steel", modes=4)
    assert made.stress is None and made.mass == pytest.approx(body.mass)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"stiffness": None}, "stiffness: is missing: a basis comes with"),
        ({"mass": np.eye(3)}, r"mass: must have shape \(\d+, \d+\), .* has \(3, 3\)"),
        ({"stiffness": "upper"}, "stiffness: must be symmetric, differs from its transpose by"),
        ({"stiffness": "clamped"}, "stiffness: resists rigid motion of the body"),
        ({"mass": "skewed"}, "mass: must be the same in x, y and z"),
        ({"interfaces": {"a": "x7"}}, 'interfaces.a: .* has no group "x7"; allowed: x0, x1'),
        ({"units": "mm-t-s"}, "units: does not go with a basis"),
        ({"sections": {"all": {"type": "solid"}}}, "sections: does not go with a basis"),
    ],
)
def test_a_model_that_cannot_be(change, sentence):
    basis, K, M = own(skfem.ElementTetP1)
    words = {"stiffness": K, "mass": M, "interfaces": ENDS, "modes": 2} | change
    if change.get("stiffness") == "upper":
        words["stiffness"] = np.triu(K.toarray())
    if change.get("stiffness") == "clamped":
        words["stiffness"] = K + 1e-3 * abs(K).max() * skfem.utils.sp.eye(basis.N)
    if isinstance(change.get("mass"), str):
        scale = np.ones(basis.N)
        scale[basis.element_dofs[1::3]] = 2.0
        words["mass"] = M.multiply(np.outer(scale, scale)).tocsr()
    with pytest.raises(FlexmbError, match=sentence):
        flexmb.reduce(basis, **words)


def test_a_basis_must_have_three_displacements_and_matrices_a_basis():
    basis = CellBasis(bar(), skfem.ElementTetP1())
    with pytest.raises(FlexmbError, match="basis: must have three displacements"):
        flexmb.reduce(basis, stiffness=np.eye(basis.N), mass=np.eye(basis.N))
    with pytest.raises(FlexmbError, match=r"stiffness: goes with a basis of scikit-fem"):
        flexmb.reduce(bar(), material="steel", stiffness=np.eye(3))
    with pytest.raises(FlexmbError, match="material: is missing"):
        flexmb.reduce(bar())


AXES = [np.linspace(0, size, n) for size, n in ((3, 4), (1, 2), (1, 3))]
MESHES = {
    "tetra": skfem.MeshTet.init_tensor(*AXES),
    "tetra10": skfem.MeshTet2.from_mesh(skfem.MeshTet.init_tensor(*AXES)),
    "hexahedron": skfem.MeshHex.init_tensor(*AXES),
    "quad": skfem.MeshQuad.init_tensor(*AXES[::2]),
}


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh", ".xdmf", ".med"])
@pytest.mark.parametrize("kind", MESHES)
def test_a_file_that_scikit_fem_wrote_has_its_groups(tmp_path, kind, suffix):
    """The facets of a boundary are all with their corners on it, a subdomain has its elements."""
    far = MESHES[kind].p[0].max()
    grid = MESHES[kind].with_boundaries({"foot": lambda x: x[0] == 0, "tip": lambda x: x[0] == far})
    grid = grid.with_subdomains({"left": lambda x: x[0] < 0.5 * far})
    grid.save(tmp_path / f"a{suffix}")
    mesh = read_mesh(tmp_path / f"a{suffix}")
    for name, x in (("foot", 0.0), ("tip", far)):
        there = np.flatnonzero(mesh.points[:, 0] == x)
        np.testing.assert_array_equal(mesh.group_nodes(name), there)
        ((facet, rows),) = mesh.group_elements(name).items()
        np.testing.assert_array_equal(np.unique(mesh.blocks[facet][rows]), there)
    ((_, rows),) = mesh.group_elements("left").items()
    middles = mesh.points[mesh.blocks[kind][rows]].mean(axis=1)
    assert middles[:, 0].max() < 0.5 * far
    assert len(rows) == len(grid.subdomains["left"]) > 0


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh", ".xdmf", ".med"])
def test_wedges_that_scikit_fem_wrote_have_their_groups(tmp_path, suffix):
    """scikit-fem itself does not read them."""
    grid = skfem.MeshWedge1().with_boundaries({"foot": lambda x: x[2] == 0})
    grid = grid.with_subdomains({"half": np.array([1])})
    grid.save(tmp_path / f"a{suffix}")
    mesh = read_mesh(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(mesh.group_nodes("foot"), np.flatnonzero(mesh.points[:, 2] == 0))
    np.testing.assert_array_equal(mesh.group_elements("half")["wedge"], [1])
