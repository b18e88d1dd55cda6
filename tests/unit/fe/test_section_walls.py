"""Areas, torsion and shear of sections against plane finite elements over the section itself.

Area and second moments by quadrature; the torsion constant by Prandtl's stress function, whose
gradient also gives the shear stress of a torque; the shear coefficient at Poisson's ratio 0 by the
warping of a beam under a shear force: -div grad chi = z/Iy, V^2/(k A) = int |grad chi|^2.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad2,
    FacetBasis,
    LinearForm,
    MeshQuad,
    condense,
    solve,
)
from skfem.helpers import dot, grad

from flexmb.fe import angle_section, box_section, circle, i_section, rectangle, resolve, tube
from flexmb.fe.sections.beam_section import principal, rotated

BOX = (0.1, 0.2, 0.004, 0.006)
I_EQUAL = (0.3, 0.15, 0.008, 0.012)
I_UNEQUAL = (0.3, 0.2, 0.008, 0.012, 0.1, 0.016)
ANGLE = (0.1, 0.15, 0.008, 0.012)


def grid(edges_y, edges_z, solid, through=2):
    """Quadrilaterals between the edges where ``solid(y, z)``; ``through`` each interval or more."""
    axes = []
    for edges in (edges_y, edges_z):
        cuts = sorted(set(edges))
        parts = []
        for a, b in zip(cuts[:-1], cuts[1:], strict=True):
            t = np.linspace(0, 1, through + int(20 * (b - a) / (cuts[-1] - cuts[0])))
            parts.append(a + (b - a) * 0.5 * (1 - np.cos(np.pi * t)))
        axes.append(np.unique(np.concatenate(parts).round(12)))
    mesh = MeshQuad.init_tensor(*axes)
    y, z = mesh.p[:, mesh.t].mean(axis=1)
    return mesh.restrict(np.flatnonzero(solid(y, z)))


def rectangle_mesh(y, z):
    return grid((0, y), (0, z), lambda a, b: a > -1, through=6)


def box_mesh(y, z, web, flange):
    def solid(a, b):
        return (a < web) | (a > y - web) | (b < flange) | (b > z - flange)

    return grid((0, web, y - web, y), (0, flange, z - flange, z), solid, through=4)


def i_mesh(height, width, web, flange, bottom=None, thick=None):
    bottom, thick = bottom or width, thick or flange

    def solid(y, z):
        top = (z > height - flange) & (abs(y) < width / 2)
        below = (z < thick) & (abs(y) < bottom / 2)
        return top | below | (abs(y) < web / 2)

    sides = [s * b / 2 for b in (width, bottom, web) for s in (-1, 1)]
    return grid(sides, (0, thick, height - flange, height), solid, through=5)


def angle_mesh(y, z, web, flange):
    return grid((0, web, y), (0, flange, z), lambda a, b: (a < web) | (b < flange), through=5)


def tube_mesh(radius, inner):
    """A quarter, y and z positive."""
    mesh = MeshQuad.init_tensor(np.linspace(inner, radius, 9), np.linspace(0, np.pi / 2, 33))
    r, angle = mesh.p
    return MeshQuad(np.array([r * np.cos(angle), r * np.sin(angle)]), mesh.t)


CASES = [
    (rectangle(0.05, 0.08), rectangle_mesh(0.05, 0.08), "rectangle"),
    (rectangle(0.1, 0.01), rectangle_mesh(0.1, 0.01), "strip"),
    (box_section(*BOX), box_mesh(*BOX), "box"),
    (i_section(*I_EQUAL), i_mesh(*I_EQUAL), "I"),
    (i_section(*I_UNEQUAL), i_mesh(*I_UNEQUAL), "I unequal"),
    (angle_section(*ANGLE), angle_mesh(*ANGLE), "L"),
    (angle_section(0.1, 0.1, 0.01), angle_mesh(0.1, 0.1, 0.01, 0.01), "L equal"),
]
NAMES = [case[2] for case in CASES]


@BilinearForm
def laplace(u, v, _):
    return dot(grad(u), grad(v))


def integral(basis, values):
    return float(np.sum(basis.dx * values))


def moments(mesh):
    """Area, centroid and second moments by quadrature."""
    basis = Basis(mesh, ElementQuad2(), intorder=4)
    y, z = basis.global_coordinates()
    A = integral(basis, 1 + 0 * y)
    cy, cz = integral(basis, y) / A, integral(basis, z) / A
    y, z = y - cy, z - cz
    return A, (cy, cz), [integral(basis, part) for part in (z * z, y * y, y * z)]


@pytest.mark.parametrize(("section", "mesh", "name"), CASES, ids=NAMES)
def test_area_and_principal_second_moments(section, mesh, name):
    """Polygons are meshed exactly: only rounding is left."""
    A, _, (Iy, Iz, Iyz) = moments(mesh)
    assert section.A == pytest.approx(A, rel=1e-10)
    values, vectors = np.linalg.eigh([[Iz, Iyz], [Iyz, Iy]])
    assert sorted([section.Iy, section.Iz]) == pytest.approx(list(values), rel=1e-9)
    axis = np.array([np.cos(section.angle), np.sin(section.angle)])  # principal y
    small = vectors[:, 0] if section.Iz < section.Iy else vectors[:, 1]
    assert abs(axis @ small) == pytest.approx(1, abs=1e-9)


def prandtl(mesh, hole=None):
    """Stress function psi for unit twist and G, and J = 2 int psi; zero outside, one free value
    around a hole."""
    basis = Basis(mesh, ElementQuad2())
    f = LinearForm(lambda v, w: 2 * v).assemble(basis)
    edge = basis.get_dofs(mesh.boundary_facets()).all()
    follow, area = np.arange(len(f)), 0.0
    if hole is not None:
        low, high = np.array(hole).T[:, :, None]
        inner = np.flatnonzero(
            np.all((basis.doflocs > low - 1e-9) & (basis.doflocs < high + 1e-9), 0)
        )
        inner = np.intersect1d(inner, edge)
        follow[inner], area = inner[0], float(np.prod(high - low))
        edge = np.append(np.setdiff1d(edge, inner), inner[1:])
    C = csr_array((np.ones(len(f)), (np.arange(len(f)), follow)))
    load = C.T @ f
    load[follow[follow != np.arange(len(f))][:1]] += 2 * area
    psi = C @ solve(*condense((C.T @ laplace.assemble(basis) @ C).tocsr(), load, D=edge))
    J = 2 * integral(basis, basis.interpolate(psi))
    return basis, psi, J + 2 * area * psi[follow[follow != np.arange(len(f))][:1]].sum()


@pytest.mark.parametrize(("section", "mesh", "name"), CASES, ids=NAMES)
def test_torsion_constant(section, mesh, name):
    """Roark's formulas and Bredt's are close, not exact: 2 %; the rectangle's series is exact."""
    y, z, web, flange = BOX
    hole = ((web, y - web), (flange, z - flange)) if name == "box" else None
    J = prandtl(mesh, hole)[2]
    assert section.J == pytest.approx(J, rel=1e-4 if name in ("rectangle", "strip") else 0.02)


def slope_inward(basis, psi, place, inward, step):
    """Derivative of the stress function along a direction that leads inside, second order."""
    points = np.array(place)[:, None] + np.outer(inward, step * np.arange(3))
    return basis.probes(points + 1e-12 * np.array(inward)[:, None]) @ psi @ (-3, 4, -1) / (2 * step)


@pytest.mark.parametrize(
    ("name", "point", "step", "within"),
    [
        ("rectangle", "+y", 1e-4, 2e-3),
        ("rectangle", "-z", 1e-4, 2e-3),
        ("strip", "+z", 1e-4, 2e-3),
        ("strip", "+y", 1e-4, 2e-2),  # the steep end of a strip of ten
        ("I", "web +y", 1e-4, 0.03),
        ("I", "top", 1e-4, 0.35),  # where web and flange meet: T t/J is the flange's alone
        ("L", "leg y", 1e-4, 0.05),
        ("L", "leg z", 1e-4, 0.05),
    ],
)
def test_stress_of_a_torque(name, point, step, within):
    section, mesh, _ = CASES[NAMES.index(name)]
    basis, psi, J = prandtl(mesh)
    _, center, _ = moments(mesh)
    found = next(p for p in section.points if p.name == point)
    turn = -section.angle
    there, along = rotated((found.y, found.z), turn), rotated((found.xy[0], found.xz[0]), turn)
    place = np.add(center, there)
    normal = np.array([along[1], -along[0]]) / np.hypot(*along)  # outward, stress runs round it
    value = slope_inward(basis, psi, place, -normal, step) / J
    assert np.hypot(*along) == pytest.approx(value, rel=within)


def shear_forces(mesh, quarter=False):
    """Coefficients ky, kz along the principal axes at Poisson's ratio 0, and the shear centre.

    The force without twist passes through the shear centre.
    """
    basis = Basis(mesh, ElementQuad2(), intorder=5)
    _, center, second = moments(mesh)
    x = basis.global_coordinates()
    if quarter:
        center, second = (0.0, 0.0), [integral(basis, x[1] ** 2), integral(basis, x[0] ** 2), 0.0]
    y, z = x[0] - center[0], x[1] - center[1]
    angle = principal(*second)[2]
    K, A, k, place = laplace.assemble(basis), integral(basis, 1 + 0 * y), [], []
    for axis in ((np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))):
        arm = axis[0] * y + axis[1] * z
        f = LinearForm(lambda v, w: w.arm * v).assemble(basis, arm=arm)
        held = np.flatnonzero(np.abs(axis @ basis.doflocs) < 1e-9) if quarter else np.array([0])
        chi, force = solve(*condense(K, f, D=held)), integral(basis, arm**2)
        k.append(force**2 / (A * (chi @ K @ chi)))
        stress = basis.interpolate(chi).grad
        place.append(integral(basis, y * stress[1] - z * stress[0]) / force)
    return k, (place[1], -place[0])


@pytest.mark.parametrize(("section", "mesh", "name"), CASES, ids=NAMES)
def test_shear_coefficients_and_shear_centre(section, mesh, name):
    """Middle lines of walls of a tenth of their length: 5 %; the rectangle's is exact."""
    k, center = shear_forces(mesh)
    within = 1e-3 if name in ("rectangle", "strip") else 0.05
    assert (section.ky, section.kz) == pytest.approx(k, rel=within)
    assert section.shear_center == pytest.approx(center, abs=0.01 * np.ptp(mesh.p))


@pytest.mark.parametrize("inner", [0.02, 0.05, 0.09])
def test_shear_coefficient_of_a_tube(inner):
    found = shear_forces(tube_mesh(0.1, inner), quarter=True)[0]
    assert tube(0.1, inner).ky == pytest.approx(found[0], rel=1e-3)


def test_shear_coefficients_follow_poissons_ratio():
    """Cowper (1966): table of closed forms; thin square box 20 (1+nu)/(48+39 nu)."""
    matter = resolve({"E": 1e9, "nu": 0.25, "density": 1.0})

    def k(section):
        return section.with_material(matter).kz

    assert k(rectangle(1, 2)) == pytest.approx(12.5 / 14.75)
    assert k(circle(1)) == pytest.approx(7.5 / 8.5)
    assert k(tube(1, 1 - 1e-9)) == pytest.approx(2.5 / 4.75)
    assert k(box_section(1, 1, 1e-9)) == pytest.approx(25 / 57.75)
    assert k(rectangle(1, 2, kz=0.7)) == 0.7
    assert k(rectangle(1, 2, shear=False)) == np.inf


def cowper(mesh, nu, axis):
    """Cowper's coefficient by its definition, for a force along y (axis 0) or z (1).

    2 (1+nu) I/(nu/2 (I' - I) - A/I int x (chi + x y^2)), x along the force, chi harmonic with the
    normal slope -n_x (nu x^2/2 + (1 - nu/2) y^2) - n_y (2 + nu) x y.
    """
    center = moments(mesh)[1]
    along, across = axis, 1 - axis

    def slope(v, w):
        x, y = w.x[along] - center[along], w.x[across] - center[across]
        bend = nu * x**2 / 2 + (1 - nu / 2) * y**2
        return -v * (w.n[along] * bend + w.n[across] * (2 + nu) * x * y)

    basis = Basis(mesh, ElementQuad2(), intorder=6)
    f = LinearForm(slope).assemble(FacetBasis(mesh, ElementQuad2(), intorder=6))
    chi = basis.interpolate(solve(*condense(laplace.assemble(basis), f, D=np.array([0]))))
    place = basis.global_coordinates()
    x, y = place[along] - center[along], place[across] - center[across]
    A, bend, other = (integral(basis, part) for part in (1 + 0 * x, x * x, y * y))
    warp = A / bend * integral(basis, x * (chi + x * y * y))
    return 2 * (1 + nu) * bend / (nu / 2 * (other - bend) - warp)


@pytest.mark.parametrize(("name", "axis"), [("rectangle", 0), ("box", 0), ("box", 1), ("I", 1)])
@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_cowpers_coefficients_by_their_definition(name, axis, nu):
    """Closed forms of thin walls, here a tenth to a fortieth of their length: 4 %."""
    section, mesh, _ = CASES[NAMES.index(name)]
    matter = resolve({"E": 1e9, "nu": nu, "density": 1.0})
    bound = section.with_material(matter)
    found = (bound.ky, bound.kz)[axis]
    assert found == pytest.approx(cowper(mesh, nu, axis), rel=1e-4 if name == "rectangle" else 0.04)
