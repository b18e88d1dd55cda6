"""The beam family: rigid arms, twisted axes, taper, releases, stress, inertia components."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import held_frequencies, line
from scipy.linalg import eigh

from flexmb.errors import MaterialError
from flexmb.fe import (
    Mesh,
    angle_section,
    assemble,
    circle,
    general,
    i_section,
    rectangle,
    resolve,
    tapered,
)
from flexmb.fe.assembly.assemble import geometric_stiffness
from flexmb.fe.elements.beam_elements import LINE, BeamFields, geometric_products
from flexmb.materials import OrthotropicMaterial

MATTER = resolve({"E": 1e9, "nu": 0.3, "density": 2000.0})
START, END = np.array([0.1, -0.2, 0.3]), np.array([0.7, 0.5, 0.9])
UP = (0.1, 0.3, 1.0)
L = float(np.linalg.norm(END - START))
X = (END - START) / L
Y = np.array(UP) - X * (X @ UP)
Y /= np.linalg.norm(Y)
AXES = np.stack([X, Y, np.cross(X, Y)], axis=1)
SECTIONS = {
    "rectangle": rectangle(0.05, 0.08, orientation=UP),
    "offset": rectangle(0.05, 0.08, orientation=UP, offset=(0.02, -0.07)),
    "L": angle_section(0.1, 0.15, 0.01, orientation=UP, offset=(0.03, 0.01)),
    "I": i_section(0.2, 0.1, 0.006, 0.01, bottom_width=0.06, orientation=UP),
    "taper": tapered(circle(0.05, offset=(0.01, 0.02)), circle(0.02), orientation=UP),
    "loaded": rectangle(0.05, 0.08, orientation=UP, offset=(0.0, 0.1), nonstructural=3.0),
    "hinged": rectangle(0.05, 0.08, orientation=UP, releases={"start": ["ry"], "end": ["rz"]}),
}


def body(name, n=4):
    return assemble(line(n, START, END), MATTER, {"all": SECTIONS[name]})


@pytest.mark.parametrize("name", SECTIONS)
def test_rigid_motions_carry_the_rigid_inertia(name):
    """R^T M R is the 6 x 6 rigid mass matrix, and K R vanishes; six zero eigenvalues."""
    fe = body(name)
    R, inertia = fe.rigid, fe.inertia
    S = inertia.S0 - np.outer(inertia.S1, inertia.S1) / inertia.mass
    wanted = np.zeros((6, 6))
    wanted[:3, :3] = inertia.mass * np.eye(3)
    wanted[3:, 3:] = np.trace(S) * np.eye(3) - S
    np.testing.assert_allclose(R.T @ (fe.M @ R), wanted, atol=1e-12 * inertia.mass)
    assert np.abs(fe.K @ R).max() < 1e-12 * np.abs(fe.K).max()
    K = fe.K.toarray()
    np.testing.assert_array_equal(K, K.T)
    free = 2 if name == "hinged" else 0  # the end nodes turn on their own there
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[: 6 + free]).max() < 1e-10 * values[-1] < values[6 + free]


@pytest.mark.parametrize("force", range(6), ids=["N", "Vy", "Vz", "T", "My", "Mz"])
def test_geometric_stiffness_is_the_work_of_the_stress_over_the_section(force):
    """u^T K_geo u = sum of sigma_ab u_c,a u_c,b over the volume, x moving by -y B - z C and the
    section turning by phi; of all stress that makes up a torque or a shear force one field will do.
    """
    b, h, rng = 0.05, 0.08, np.random.default_rng(force)
    section = rectangle(b, h).with_material(MATTER)
    fields = BeamFields(np.array([[START, END]]), section)
    ends, u = np.zeros((1, 2, 6)), rng.standard_normal(12)
    ends[..., force] = 1.0
    s, w = np.polynomial.legendre.leggauss(3)
    y, z = (0.5 * b * s)[:, None], (0.5 * h * s)[None]
    area = np.outer(w, w) * b * h / 4
    A, Iy, Iz = b * h, b * h**3 / 12, h * b**3 / 12
    xx = [1 / A, 0, 0, 0, z / Iy, -y / Iz][force] + 0 * y * z
    xy = [0, 1 / A, 0, -0.5 * z / Iy, 0, 0][force] + 0 * y * z
    xz = [0, 0, 1 / A, 0.5 * y / Iz, 0, 0][force] + 0 * y * z
    rows = {k: getattr(fields, k)[0] @ u for k in
            ("u_x", "B", "C", "B_x", "C_x", "phi", "phi_x", "V_x", "W_x")}  # fmt: skip
    work = 0.0
    for q, dx in enumerate(fields.dx[0]):
        at = {name: values[q] for name, values in rows.items()}
        along = (at["u_x"] - y * at["B_x"] - z * at["C_x"], at["V_x"] - z * at["phi_x"],
                 at["W_x"] + y * at["phi_x"])  # fmt: skip
        over_y, over_z = (-at["B"], 0.0, at["phi"]), (-at["C"], -at["phi"], 0.0)
        for a, c, d in zip(along, over_y, over_z, strict=True):
            work += dx * np.sum(area * (xx * a * a + 2 * xy * a * c + 2 * xz * a * d))
    assert u @ geometric_products(fields, ends)[0] @ u == pytest.approx(work, rel=1e-11)


@pytest.mark.parametrize("name", ["rectangle", "offset", "L", "I", "loaded"])
def test_inertia_of_prisms_is_exact(name):
    """S0 = m c c^T + R diag(m L^2/12, rho L section moments) R^T at the centroid's line."""
    fe, section = body(name), SECTIONS[name]
    mass = (2000 * section.A + section.nonstructural) * L
    c = (START + END) / 2 + AXES[:, 1:] @ section.offset
    turn = np.array([[np.cos(section.angle), -np.sin(section.angle)],
                     [np.sin(section.angle), np.cos(section.angle)]])  # fmt: skip
    own = np.zeros((3, 3))
    own[0, 0] = mass * L**2 / 12
    own[1:, 1:] = 2000 * L * turn @ np.diag([section.Iz, section.Iy]) @ turn.T
    S0 = mass * np.outer(c, c) + AXES @ own @ AXES.T
    assert fe.inertia.mass == pytest.approx(mass, rel=1e-13)
    np.testing.assert_allclose(fe.center, c, atol=1e-13)
    np.testing.assert_allclose(fe.inertia.S0, S0, atol=1e-12 * mass)


def test_inertia_of_a_cone_is_exact():
    """Frustum: V = pi h (a^2 + a b + b^2)/3, axial moment 3/10 m (a^5 - b^5)/(a^3 - b^3)."""
    a, b = 0.05, 0.02
    fe = assemble(line(3), MATTER, {"all": tapered(circle(a), circle(b))})
    mass = 2000 * np.pi * (a * a + a * b + b * b) / 3
    S = fe.inertia.S0
    assert fe.inertia.mass == pytest.approx(mass, rel=1e-12)
    assert S[1, 1] + S[2, 2] == pytest.approx(0.3 * mass * (a**5 - b**5) / (a**3 - b**3), rel=1e-12)


@pytest.mark.parametrize("matrix", ["K", "M"])
def test_an_offset_beam_is_a_beam_on_rigid_links(matrix):
    section, n = SECTIONS["rectangle"], 3
    place = AXES[:, 1:] @ (0.02, -0.07)
    chain = line(n, START, END)
    moved = chain.points + place
    points = np.vstack([chain.points, moved])
    sets = {f"n{k}": np.array([n + 1 + k]) for k in range(n + 1)}
    mesh = Mesh(points, {"line": chain.blocks["line"] + n + 1}, sets)
    ties = {f"t{k}": {"type": "rbe2", "reference": k, "nodes": f"n{k}"} for k in range(n + 1)}
    linked = assemble(mesh, MATTER, {"all": section}, ties=ties)
    direct = body("offset", n)
    first, second = (getattr(fe, matrix).toarray() for fe in (linked, direct))
    np.testing.assert_allclose(first, second, atol=1e-12 * np.abs(second).max())
    eye = np.eye(len(second))
    np.testing.assert_allclose(linked.reduced_mass(eye), direct.reduced_mass(eye), atol=1e-12)


def test_bending_of_an_angle_turns_with_its_principal_axes():
    """A force along z bends an L sideways too: u = F L^3/(3 E) of the inverse moment matrix."""
    section = angle_section(0.1, 0.15, 0.01, shear=False)
    fe = assemble(line(1), MATTER, {"all": section})
    tip = fe.numbering.table[1]
    u = np.linalg.inv(fe.K.toarray()[np.ix_(tip, tip)])
    c, s = np.cos(section.angle), np.sin(section.angle)
    turn = np.array([[c, -s], [s, c]])
    inverse = turn @ np.diag([1 / section.Iz, 1 / section.Iy]) @ turn.T
    center = turn @ section.shear_center
    # the force at the centroid also twists about the shear centre
    arm = np.array([-center[1], center[0]])
    twist = np.outer(arm, arm) / (MATTER.G * section.J)
    np.testing.assert_allclose(u[1:3, 1:3], inverse / 3e9 + twist, rtol=1e-9)


def test_components_add_up_to_the_mass_and_agree_with_rigid_turns():
    """sum M_bb = M; with a rigid rotation about c, N theta = theta x s gives P from M_ab."""
    fe = body("L")
    n = fe.numbering.n
    Mab = fe.reduced_mass(np.eye(n))
    np.testing.assert_allclose(sum(Mab[b, b] for b in range(3)), fe.M.toarray(), atol=1e-12)
    shift = np.zeros((n, 3))
    for a in range(3):
        shift[:, a] = fe.rigid[:, a]
    for a in range(3):
        for b in range(3):
            np.testing.assert_allclose(shift[:, a] @ Mab[a, b], fe.inertia.p[b], atol=1e-12)
    turned = fe.rigid[:, 3:] + np.zeros((n, 3))  # rotation about the centre
    eps = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        eps[i, j, k], eps[i, k, j] = 1, -1
    P = fe.inertia.P - fe.center[:, None, None] * fe.inertia.p
    for a in range(3):
        for c in range(3):
            wanted = np.einsum("d,dbi->bi", eps[a, c], P)
            found = np.stack([turned[:, c] @ Mab[a, b] for b in range(3)])
            np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_geometric_stiffness_of_a_turned_bar():
    """A bar under tension N that turns rigidly: its end forces turn with it, N/L across."""
    fe = body("rectangle", 1)
    table, N = fe.numbering.table, 1e3
    u = np.zeros(fe.numbering.n)
    u[table[1, :3]] = N * L / (MATTER.E * SECTIONS["rectangle"].A) * X
    K_g = geometric_stiffness(fe, u).toarray()
    R, w = fe.rigid, np.array([0.3, -0.2, 0.5])
    forces = (K_g @ R[:, 3:] @ w)[table]
    wanted = np.cross(w, N * X)
    np.testing.assert_allclose(forces[1, :3], wanted, atol=1e-9 * N)
    np.testing.assert_allclose(forces[0, :3], -wanted, atol=1e-9 * N)
    np.testing.assert_allclose(K_g @ R[:, :3], 0, atol=1e-9 * N)


def test_small_facts_of_the_family():
    x = np.array([[START, END], [START, START]])
    assert LINE.measure(x, None) == pytest.approx([L, 0])
    assert list(LINE.defects(x)) == [1]
    turn = LINE.rotation(x)
    assert turn.shape == (2, 2, 3, 12) and (turn.sum(axis=(2, 3)) == 3).all()
    assert LINE.stress_layers(SECTIONS["taper"]) == ("+y", "-y", "+z", "-z")


FIBRE = OrthotropicMaterial("fibre", (1e11, 1e10, 1e10), (0.3, 0.3, 0.3), (5e9, 3e9, 5e9), 1600.0)


def test_orthotropic_beams_are_refused():
    with pytest.raises(MaterialError, match='beams need an isotropic material, "fibre" is not'):
        assemble(line(1), FIBRE, {"all": circle(0.1)})
    assert assemble(line(1), FIBRE, {"all": circle(0.1, material=MATTER)}).inertia.mass > 0


def test_twist_about_the_shear_centre_couples_with_bending():
    """A channel-like section: the lowest coupled root of a hinged-hinged beam in closed form.

    (w_b^2 - w^2)(w_t^2 - w^2 ) m^2 (r^2 + c^2) = w^4 m^2 c^2 for forks at both ends, c the distance
    of the centres (Timoshenko, Vibration Problems in Engineering, 5.21, without warping).
    """
    values = {"A": 1e-4, "Iy": 1e-9, "Iz": 1e-6, "J": 1e-9}
    c, n = 0.02, 16
    section = general(**values, shear_center=(c, 0.0))
    fe = assemble(line(n), MATTER, {"all": section})
    table, polar = fe.numbering.table, (values["Iy"] + values["Iz"]) / values["A"]
    held = [*table[0, [0, 1, 2, 3, 5]], *table[-1, [1, 2, 3, 5]], *table[:, 1], *table[:, 5]]
    found = held_frequencies(fe, np.unique(held), 2)
    E, G, m = MATTER.E, MATTER.G, MATTER.density * values["A"]
    bend = E * values["Iy"] * np.pi**4
    twist = G * values["J"] * np.pi**2
    rotary = MATTER.density * values["Iy"] * np.pi**2
    K = np.diag([bend, twist])
    M = np.array([[m + rotary, -c * m], [-c * m, m * (polar + c * c)]])
    exact = np.sqrt(eigh(K, M, eigvals_only=True))
    assert found[0] == pytest.approx(exact[0], rel=2e-3)


def test_a_section_without_stress_points_has_no_layers():
    section = general(1e-4, 1e-9, 1e-9, 1e-9).with_material(MATTER)
    assert LINE.stress_layers(section) == ()
    assert LINE.stress(np.array([[START, END]]), section).shape == (1, 2, 0, 6, 12)
