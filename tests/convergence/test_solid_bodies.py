"""Bodies of solid elements against exact solutions: curved tubes, a thick plate, NAFEMS LE10."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import held_frequencies, slope, solid_box
from scipy.optimize import brentq
from solidkit import held, nodal_stress, pressure, solve
from truthkit import reference

from flexmb.fe import assemble, reduce, resolve
from flexmb.flexbody.natural_modes import natural_frequencies as natural_frequencies

STEEL = resolve("steel")
SECOND_ORDER = ("tetra10", "hexahedron20", "hexahedron27", "wedge15")
pytestmark = pytest.mark.filterwarnings("ignore:.*first-order tetrahedra", "ignore:.*bulk modulus")


def tube(points, inner=1.0, outer=2.0, height=0.4):
    """A unit cube as a quarter of a tube."""
    r, angle = inner + (outer - inner) * points[:, 0], np.pi / 2 * points[:, 1]
    return np.stack([r * np.cos(angle), r * np.sin(angle), height * points[:, 2]], axis=1)


@pytest.mark.parametrize(
    ("kind", "order", "coarse"),
    [("tetra", 2, 0.3), ("hexahedron", 2, 0.02), *((kind, 4, 0.005) for kind in SECOND_ORDER)],
)
def test_torsion_of_a_clamped_tube(kind, order, coarse):
    """A quarter of a tube of length 4 that can only turn: u = r sin(pi z/8), exact for any tube.

    The coarsest mesh has two elements round the quarter and three along.
    """
    sizes, errors = (1, 2, 3), []
    for n in sizes:
        mesh = solid_box(kind, (n, 2 * n, 3 * n), shape=lambda x: tube(x, height=4.0))
        fe = assemble(mesh, STEEL)
        fixed = held(fe, ("z0", "xyz"), ("y0", "xz"), ("y1", "yz"))
        exact = np.pi / 8 * np.sqrt(STEEL.G / STEEL.density)
        errors.append(held_frequencies(fe, fixed, 1)[0] / exact - 1)
    assert slope(sizes, errors) < -order + 0.5  # the coarsest is not yet asymptotic
    assert abs(errors[0]) < coarse


def tube_energy(kind, n, nu):
    """Error of the strain energy of a long tube whose inner radius 1 is widened, outer radius 2.

    Lame: u = (1 + nu)/(3 E) ((1 - 2 nu) r + 4/r) for unit pressure, whose work is the energy.
    """
    matter = resolve({"E": 1e9, "nu": nu, "density": 1000})
    fe = assemble(solid_box(kind, (n, 2 * n, 1), shape=tube), matter)
    r = np.hypot(*fe.mesh.points[:, :2].T)
    radial = (1 + nu) / 3e9 * ((1 - 2 * nu) * r + 4 / r)
    exact = fe.mesh.points * [1, 1, 0] * (radial / r)[:, None]
    wide = np.zeros(fe.numbering.n)
    wide[fe.numbering.table[:, :3]] = exact
    level = ("z0", "z"), ("z1", "z")
    inside = fe.mesh.node_sets["x0"]
    fixed = np.union1d(held(fe, *level, ("y0", "y"), ("y1", "x")), held(fe, ("x0", "xy")))
    fixed = np.union1d(fixed, fe.numbering.table[:, 2])
    u = solve(fe, np.zeros(len(wide)), fixed, wide[fixed])
    return u @ (fe.K @ u) / (radial[inside[0]] * np.pi / 2 * 0.4) - 1


@pytest.mark.parametrize("kind", SECOND_ORDER)
def test_curved_elements_of_a_tube_under_pressure(kind):
    """Energy at order 4, as its error is the square of that of the strains."""
    errors = [tube_energy(kind, n, 0.3) for n in (2, 4)]
    assert slope((2, 4), errors) < -3.5
    assert abs(errors[1]) < 1e-4


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [("hexahedron", 0, 0.03), ("tetra10", 0, 0.01), ("wedge15", 0, 0.01), ("tetra", 1, 100)],
)
def test_nearly_incompressible_tube(kind, low, high):
    """nu = 0.499 on a coarse mesh: elements that lock are off by more than their own size."""
    assert low < tube_energy(kind, 2, 0.499) < high


def test_thick_simply_supported_plate_against_exact_elasticity():
    """10 x 10 x 1 m, sides held along themselves and across: sines in the plane, and through the
    thickness the antisymmetric Rayleigh-Lamb waves; in the plane, shear waves sin(pi y/a).

    NAFEMS test FV21 is this plate by thick-plate theory.
    """
    matter = resolve({"E": 200e9, "nu": 0.3, "density": 8000})
    fe = assemble(solid_box("hexahedron20", (8, 8, 2), (10, 10, 1)), matter)
    sides = [
        (name, axes) for name, axes in (("x0", "yz"), ("x1", "yz"), ("y0", "xz"), ("y1", "xz"))
    ]
    found = held_frequencies(fe, held(fe, *sides), 6) / (2 * np.pi)
    bending = [lamb(matter, 1.0, np.pi / 10 * np.hypot(m, n)) for m, n in ((1, 1), (2, 1), (2, 2))]
    shear = np.sqrt(matter.G / matter.density) / 20
    wanted = np.array([bending[0], bending[1], bending[1], shear, shear, bending[2]])
    assert bending[0] == pytest.approx(45.9712, abs=1e-4)
    errors = found / wanted - 1
    assert (errors > 0).all()  # Rayleigh's principle
    assert errors.max() < 3e-3


def lamb(matter, thickness, k):
    """Lowest antisymmetric Rayleigh-Lamb frequency [Hz] of a plate at wave number k [1/m].

    Achenbach, Wave Propagation in Elastic Solids, eq. 6.68, with p and q imaginary at low speed.
    """
    h, cs = thickness / 2, np.sqrt(matter.G / matter.density)
    cl = cs * np.sqrt((2 - 2 * matter.nu) / (1 - 2 * matter.nu))

    def mismatch(omega):
        p, q = np.sqrt(k**2 - (omega / cl) ** 2), np.sqrt(k**2 - (omega / cs) ** 2)
        return (k**2 + q**2) ** 2 * np.tanh(p * h) - 4 * k**2 * p * q * np.tanh(q * h)

    return brentq(mismatch, 1e-3 * k * cs, 0.95 * k * cs, xtol=1e-9) / (2 * np.pi)


def ellipses(points):
    """A unit cube as a quarter of the plate of NAFEMS test LE10."""
    r, angle = points[:, 0], np.pi / 2 * points[:, 1]
    x, y = (2 + 1.25 * r) * np.cos(angle), (1 + 1.75 * r) * np.sin(angle)
    return np.stack([x, y, 0.6 * points[:, 2]], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "tolerance"),
    [
        ("hexahedron20", 0.01),
        ("hexahedron27", 0.01),
        ("wedge15", 0.03),
        ("tetra10", 0.04),
        ("hexahedron", 0.04),
    ],
)
def test_le10_thick_elliptic_plate(kind, tolerance):
    """Stress at a corner of the hole's edge, where it is extrapolated from one side only."""
    matter = resolve({"E": 210e9, "nu": 0.3, "density": 7800})
    fe = assemble(solid_box(kind, (8, 12, 4), shape=ellipses), matter)
    points, rim = fe.mesh.points, fe.mesh.node_sets["x1"]
    middle = rim[np.abs(points[rim, 2] - 0.3) < 1e-9]
    fixed = held(fe, ("y0", "y"), ("y1", "x"), ("x1", "xy"))
    fixed = np.union1d(fixed, fe.numbering.table[middle, 2])
    f = pressure(fe, fe.mesh.node_sets["z1"], 1e6)
    stress = nodal_stress(fe, solve(fe, f, fixed))
    corner = np.linalg.norm(points - [2, 0, 0.6], axis=1).argmin()
    wanted = reference("solids", "le10_thick_plate")["value"]
    assert stress[corner, 1] == pytest.approx(wanted, rel=tolerance)


@pytest.mark.parametrize("thickness", [0.005, 0.001])
def test_slender_solids_are_bars(thickness):
    """Rounding grows with the square of the slenderness, and leaves the frequencies right.

    Clamped bar of Euler and Bernoulli (Blevins, table 8-1); 100 elements are within 2e-6, shear and
    rotary inertia lower the first by 2e-5 at 1/200.
    """
    body = reduce(
        {"type": "box", "size": [1, thickness, thickness], "divisions": [100, 1, 1]},
        material={"E": 210e9, "nu": 0.0, "density": 7850},
        interfaces={"root": "x0", "tip": "x1"},
        modes=6,
        stress=False,
    )
    speed = np.sqrt(210e9 / 7850) * thickness / np.sqrt(12)
    found = natural_frequencies(body, ["root"])[:2]
    assert found == pytest.approx(3.5160152685 * speed / (2 * np.pi), rel=5e-5)
