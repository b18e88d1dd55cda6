"""Solid elements: patches, rigid motion, mass, stress and rotation, on distorted meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from femeshes import SOLIDS, solid_box
from scipy.spatial.transform import Rotation

from flexmb.errors import FlexmbWarning, MeshError, ReductionError
from flexmb.fe import Mesh, SolidSection, assemble, geometric_stiffness, resolve
from flexmb.fe.elements.element_blocks import FAMILIES
from flexmb.materials import OrthotropicMaterial

STEEL = resolve("steel")
PLY = OrthotropicMaterial(
    "carbon ply", (140e9, 10e9, 9e9), (0.3, 0.4, 0.25), (5e9, 3.5e9, 4.5e9), 1600.0
)
SKEW = SolidSection(axis1=(1.0, 2.0, -0.5), axis2=(0.2, 0.3, 1.0))
AFFINE = np.array([[1.0, 0.3, 0.1], [0.0, 1.2, -0.2], [0.4, 0.0, 0.9]])
SECOND_ORDER = ("tetra10", "hexahedron20", "hexahedron27", "wedge15")
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
quiet = pytest.mark.filterwarnings("ignore:.*first-order tetrahedra")


def assembled(mesh, material=STEEL, section=None):
    return assemble(mesh, material, None if section is None else {"all": section})


def solve_inside(fe, u):
    """Displacements when the nodes of the six sides are moved and nothing loads the inside."""
    sides = np.unique(np.concatenate([fe.mesh.node_sets[f"{a}{s}"] for a in "xyz" for s in (0, 1)]))
    held = fe.numbering.table[sides, :3].ravel()
    free = np.setdiff1d(np.arange(fe.numbering.n), held)
    assert len(free)
    full = u.ravel().copy()
    K = fe.K.toarray()
    full[free] = np.linalg.solve(K[np.ix_(free, free)], -K[np.ix_(free, held)] @ full[held])
    return full.reshape(-1, 3)


def patch(kind, distort=0.3):
    divisions = (2, 2, 2) if kind.endswith(("20", "27", "15")) else (3, 3, 2)
    return solid_box(kind, divisions, distort=distort, shape=lambda x: x @ AFFINE.T)


def linear_field(points):
    slope = np.random.default_rng(1).normal(size=(3, 3))  # du_c/dx_a, [a, c]
    return points @ slope + [1, 2, 3], slope


@quiet
@pytest.mark.parametrize("kind", SOLIDS)
@pytest.mark.parametrize(("material", "section"), [(STEEL, None), (PLY, SKEW)])
def test_patch_of_constant_strain(kind, material, section):
    """Displacements, stress at all nodes and half the curl of a linear field, exactly."""
    fe = assembled(patch(kind), material, section)
    u, slope = linear_field(fe.mesh.points)
    np.testing.assert_allclose(solve_inside(fe, u), u, atol=1e-13)
    (block,) = fe.blocks
    x, local = fe.mesh.points[block.nodes], u[block.nodes].reshape(len(block.nodes), -1)
    strain = [slope[a, a] if a == b else slope[a, b] + slope[b, a] for a, b in PAIRS]
    wanted = block.section.stiffness() @ strain
    tight = 5e-13 * np.abs(wanted).max()  # displacements of 5 over elements of 0.3, at nodes
    stress = np.einsum("ekld,ed->ekl", block.family.stress(x, block.section)[:, :, 0], local)
    np.testing.assert_allclose(stress, np.broadcast_to(wanted, stress.shape), atol=tight)
    turn = np.einsum("ekad,ed->eka", block.family.rotation(x), local)
    curl = [slope[(a + 1) % 3, (a + 2) % 3] - slope[(a + 2) % 3, (a + 1) % 3] for a in range(3)]
    np.testing.assert_allclose(turn, np.broadcast_to(0.5 * np.array(curl), turn.shape), atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "distort"),
    [
        ("tetra10", 0.3),
        ("hexahedron27", 0.3),
        ("hexahedron20", 0.0),
        ("wedge15", 0.0),
        ("hexahedron", 0.0),
    ],
)
def test_patch_of_pure_bending(kind, distort):
    """Its displacement is quadratic: exact where the elements have all quadratic fields.

    Those are the straight tetrahedron and the hexahedron of 27 nodes of any straight shape; the
    others lose some unless they are parallelepipeds (Arnold, Boffi, Falk, Approximation by
    quadrilateral finite elements, Math. Comp. 71, 2002).
    """
    shape = None if distort else lambda x: x @ AFFINE.T
    fe = assembled(solid_box(kind, (3, 2, 2), (2, 1, 1), distort, shape))
    x, y, z = (fe.mesh.points - [0, 0.5, 0.5]).T
    nu = STEEL.nu
    u = np.stack([-x * y, 0.5 * (x**2 + nu * (y**2 - z**2)), nu * y * z], axis=1)
    np.testing.assert_allclose(solve_inside(fe, u), u, atol=1e-11)


@quiet
@pytest.mark.parametrize("kind", SOLIDS)
def test_six_motions_without_strain_and_positive_mass(kind):
    fe = assembled(solid_box(kind, (2, 1, 1), distort=0.0, shape=bent))
    K, M = fe.K.toarray(), fe.M.toarray()
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:6]).max() < 1e-12 * values[-1] < 1e-7 * values[6]
    assert np.abs(K @ fe.rigid).max() < 1e-13 * np.abs(K).max()
    assert np.linalg.eigvalsh(M)[0] > 0


def bent(points):
    """A box as part of a tube, so that its elements are curved."""
    r, angle = 1 + points[:, 2], 0.5 * points[:, 0]
    return np.stack([r * np.sin(angle), points[:, 1] + 0.1 * points[:, 0], r * np.cos(angle)], 1)


@quiet
@pytest.mark.parametrize("kind", SOLIDS)
def test_mass_and_inertia_of_a_skewed_box_are_exact(kind):
    """Unit box under x -> F x: mass rho det F, S0 = mass F (I/12 + 1/4) F^T."""
    fe = assembled(patch(kind))
    mass = STEEL.density * np.linalg.det(AFFINE)
    second = AFFINE @ (np.eye(3) / 12 + np.full((3, 3), 0.25)) @ AFFINE.T
    np.testing.assert_allclose(fe.inertia.mass, mass, rtol=1e-13)
    np.testing.assert_allclose(fe.inertia.S1, mass * AFFINE @ np.full(3, 0.5), rtol=1e-12)
    np.testing.assert_allclose(fe.inertia.S0, mass * second, rtol=1e-12, atol=1e-12 * mass)
    (block,) = fe.blocks
    volume = block.family.measure(fe.mesh.points[block.nodes], block.section).sum()
    assert volume == pytest.approx(np.linalg.det(AFFINE), rel=1e-13)


@quiet
@pytest.mark.parametrize("kind", SOLIDS)
def test_energies_of_linear_fields(kind):
    """u^T K u = V strain C strain; v^T K_g v = V sigma_ab dv/dx_a . dv/dx_b, sigma that of u."""
    fe = assembled(patch(kind), PLY, SKEW)
    section, volume = fe.blocks[0].section, np.linalg.det(AFFINE)
    u, slope = linear_field(fe.mesh.points)
    strain = np.array([slope[a, a] if a == b else slope[a, b] + slope[b, a] for a, b in PAIRS])
    energy = volume * strain @ section.stiffness() @ strain
    assert u.ravel() @ (fe.K @ u.ravel()) == pytest.approx(energy, rel=1e-12)
    components, sigma = section.stiffness() @ strain, np.zeros((3, 3))
    for value, (a, b) in zip(components, PAIRS, strict=True):
        sigma[a, b] = sigma[b, a] = value
    other = np.random.default_rng(2).normal(size=(3, 3))
    v = (fe.mesh.points @ other).ravel()
    K = geometric_stiffness(fe, u.ravel())
    assert v @ (K @ v) == pytest.approx(volume * np.sum(sigma * (other @ other.T)), rel=1e-11)
    assert np.abs(K @ fe.rigid[:, :3]).max() < 1e-12 * np.abs(K).max()


@pytest.mark.parametrize("kind", SOLIDS)
@pytest.mark.parametrize("section", [SolidSection(STEEL), replace(SKEW, material=PLY)])
def test_element_matrices_are_symmetric_to_the_last_bit(kind, section):
    mesh, family = solid_box(kind, (3, 2, 2), distort=0.3, shape=bent), FAMILIES[kind]
    x = mesh.points[mesh.blocks[kind]]
    u = np.random.default_rng(0).normal(size=(len(x), 3 * x.shape[1]))
    for matrix in (
        family.stiffness(x, section),
        family.mass(x, section).M,
        family.geometric_stiffness(x, section, u),
    ):
        assert np.array_equal(matrix, matrix.transpose(0, 2, 1))


def test_turned_material_is_the_material_seen_from_turned_axes():
    """A ply turned by 30 degrees about z: E_x of an off-axis ply (Jones, Mechanics of Composite
    Materials, 2nd ed., eq. 2.97), and no change along z."""
    angle = np.pi / 6
    c, s = np.cos(angle), np.sin(angle)
    S = np.linalg.inv(SolidSection(PLY, (c, s, 0.0), (-s, c, 0.0)).stiffness())
    E, nu, G = PLY.E, PLY.nu, PLY.G
    along = c**4 / E[0] + (1 / G[0] - 2 * nu[0] / E[0]) * s**2 * c**2 + s**4 / E[1]
    assert S[0, 0] == pytest.approx(along, rel=1e-12)
    assert S[2, 2] == pytest.approx(1 / E[2], rel=1e-12)
    quarter = SolidSection(PLY, (0, 1, 0), (0, 0, 1)).stiffness()  # 1 along y, 2 along z, 3 along x
    np.testing.assert_allclose(np.diag(quarter), np.diag(PLY.stiffness())[[2, 0, 1, 5, 3, 4]])


@quiet
@pytest.mark.parametrize("kind", SOLIDS)
def test_a_body_and_its_material_turned_together_keep_their_stiffness(kind):
    """K of the turned element is T K T^T; turned without its material it is another one."""
    x = FAMILIES[kind].reference.nodes[None] @ AFFINE.T
    R = Rotation.from_rotvec([0.3, -1.1, 0.6]).as_matrix()
    T = np.kron(np.eye(x.shape[1]), R)
    section = replace(SKEW, material=PLY)
    turned = SolidSection(PLY, tuple(R @ SKEW.axis1), tuple(R @ SKEW.axis2))
    K = T @ FAMILIES[kind].stiffness(x, section)[0] @ T.T
    together = FAMILIES[kind].stiffness(x @ R.T, turned)[0]
    np.testing.assert_allclose(together, K, atol=1e-13 * K.max())
    alone = FAMILIES[kind].stiffness(x @ R.T, section)[0]
    assert np.abs(alone - K).max() > 0.1 * K.max()


@quiet
@pytest.mark.parametrize("kind", SOLIDS)
def test_either_handedness_gives_the_same_matrices(kind):
    family = FAMILIES[kind]
    x = family.reference.nodes[None] @ AFFINE.T
    turned = x * [1, 1, -1]
    section = SolidSection(STEEL)
    signs = np.tile([1.0, 1.0, -1.0], x.shape[1])
    K = family.stiffness(x, section)
    mirrored = family.stiffness(turned, section) * signs[:, None] * signs
    np.testing.assert_allclose(mirrored, K, atol=1e-12 * K.max())
    np.testing.assert_allclose(family.mass(turned, section).M, family.mass(x, section).M)
    assert not len(family.defects(np.concatenate([x, turned])))


@pytest.mark.parametrize("kind", SOLIDS)
def test_flat_and_folded_elements_are_found(kind):
    """A corner pushed through the element folds it; a tetrahedron of straight sides cannot fold."""
    family = FAMILIES[kind]
    good = family.reference.nodes
    flat, folded = good * [1, 1, 0], good.copy()
    folded[0] += 1.2
    bad = [1] if kind == "tetra" else [1, 3]
    np.testing.assert_array_equal(family.defects(np.stack([good, flat, good, folded])), bad)


@pytest.mark.parametrize("kind", SECOND_ORDER)
def test_a_mid_side_node_at_a_quarter_folds_the_element(kind):
    """det J vanishes at the corner of a quarter-point element, so its slopes there are infinite."""
    family = FAMILIES[kind]
    a, b = family.edges[0]
    middle = family.reference.corners
    x = np.repeat(family.reference.nodes[None], 2, axis=0)
    for row, share in enumerate((0.27, 0.249)):
        x[row, middle] = (1 - share) * x[row, a] + share * x[row, b]
    np.testing.assert_array_equal(family.defects(x), [1])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"axis1": (0, 0, 0)}, "section.axis1: must be three numbers, not all zero"),
        ({"axis1": (1, 2)}, "section.axis1: must be three numbers"),
        ({"axis2": ("x", "y", "z")}, "section.axis2: must be three numbers"),
        ({"axis1": (0, 2, 0)}, "section.axis2: is parallel to axis1"),
        ({"axis1": (1, 1, 0), "axis2": (-1, -1, 0)}, "section.axis2: is parallel to axis1"),
    ],
)
def test_refused_directions(words, sentence):
    with pytest.raises(ReductionError, match=sentence):
        SolidSection(STEEL, **words)


def test_first_order_tetrahedra_and_incompressible_materials_are_warned_of():
    with pytest.warns(FlexmbWarning, match="6 elements of kind .tetra.: .* far too stiff"):
        assembled(solid_box("tetra", (1, 1, 1)))
    rubber = resolve({"E": 5e6, "nu": 0.499, "density": 1100, "name": "rubber"})
    with pytest.warns(FlexmbWarning, match='material "rubber": its bulk modulus is 500 times'):
        assembled(solid_box("hexahedron20", (1, 1, 1)), rubber)


@pytest.mark.parametrize("kind", ["wedge", "pyramid", "pyramid13", "wedge18", "tetra20"])
def test_other_solids_are_refused_by_name_with_advice(kind):
    nodes = int(kind.lstrip("wedgpyramit") or {"wedge": 6, "pyramid": 5}[kind])
    mesh = Mesh(np.eye(3), {kind: np.zeros((1, nodes), dtype=int)})
    with pytest.raises(MeshError, match=f'"{kind}", which cannot be used; .*(mesh|elements)'):
        assembled(mesh)
