"""Masses and springs at nodes, lumped mass: identities, closed forms, mistakes."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, held_frequencies, line, slope
from scipy.spatial.transform import Rotation

from flexmb.errors import MeshError, ReductionError
from flexmb.fe import Mesh, assemble, part, rectangle, reduce, resolve, shell
from flexmb.fe.assembly.springs import spring_geometric_stiffness
from flexmb.fe.reduction.methods import reduction_key

MATTER = resolve({"E": 1e9, "nu": 0.3, "density": 2000.0})
SECTION = {"all": rectangle(0.1, 0.2)}
STIFF = {"E": 1e15, "nu": 0.3, "density": 1e-6}
START, END = (0.1, -0.2, 0.3), (0.7, 0.5, 0.9)
INERTIA = [[3.0, 0.4, -0.2], [0.4, 2.5, 0.1], [-0.2, 0.1, 1.5]]
LOAD = {"at": "tip", "mass": 7.0, "inertia": INERTIA, "offset": [0.3, -0.5, 0.2]}


def test_a_point_mass_adds_its_rigid_inertia():
    """S0 grows by m c c^T + 1/2 tr(J) I - J, and R^T M R stays the rigid mass matrix."""
    plain = assemble(line(3, START, END), MATTER, SECTION)
    fe = assemble(line(3, START, END), MATTER, SECTION, masses={"load": LOAD})
    c, J = np.array(END) + LOAD["offset"], np.array(INERTIA)
    S0 = 7 * np.outer(c, c) + 0.5 * np.trace(J) * np.eye(3) - J
    assert fe.inertia.mass == pytest.approx(plain.inertia.mass + 7)
    np.testing.assert_allclose(fe.inertia.S1, plain.inertia.S1 + 7 * c, atol=1e-12)
    np.testing.assert_allclose(fe.inertia.S0, plain.inertia.S0 + S0, atol=1e-12)
    R, inertia = fe.rigid, fe.inertia
    S = inertia.S0 - np.outer(inertia.S1, inertia.S1) / inertia.mass
    wanted = np.zeros((6, 6))
    wanted[:3, :3], wanted[3:, 3:] = inertia.mass * np.eye(3), np.trace(S) * np.eye(3) - S
    np.testing.assert_allclose(R.T @ (fe.M @ R), wanted, atol=1e-12 * inertia.mass)


def test_components_of_a_point_mass_are_those_of_a_heavy_cloud():
    """Six particles on the principal axes have the same M_ab, P and p by sums alone."""
    J = np.array(INERTIA)
    second = 0.5 * np.trace(J) * np.eye(3) - J
    values, vectors = np.linalg.eigh(second)
    # each pair +-d on an axis with mass m/6: second moment 2 m/6 d^2
    arms = [
        s * np.sqrt(3 * w / 7.0) * v
        for w, v in zip(values, vectors.T, strict=True)
        for s in (1, -1)
    ]
    cloud = {
        f"p{k}": {"at": "tip", "mass": 7.0 / 6, "offset": list(arm + np.array(LOAD["offset"]))}
        for k, arm in enumerate(arms)
    }
    one, many = (
        assemble(line(2, START, END), MATTER, SECTION, masses=masses)
        for masses in ({"load": LOAD}, cloud)
    )
    eye = np.eye(one.numbering.n)
    np.testing.assert_allclose(one.reduced_mass(eye), many.reduced_mass(eye), atol=1e-11)
    np.testing.assert_allclose(one.inertia.P, many.inertia.P, atol=1e-11)
    np.testing.assert_allclose(one.inertia.p, many.inertia.p, atol=1e-11)
    np.testing.assert_allclose(one.M.toarray(), many.M.toarray(), atol=1e-11)


def test_mass_spread_over_a_surface():
    """The mass is exact, and its centre is the surface's where its mesh is even."""
    box = block((2, 2, 2), (1.0, 2.0, 3.0))
    plain = assemble(box, MATTER)
    fe = assemble(box, MATTER, masses={"skin": {"at": "x1", "mass": 60.0}})
    added = fe.inertia.S1 - plain.inertia.S1
    assert fe.inertia.mass - plain.inertia.mass == pytest.approx(60)
    np.testing.assert_allclose(added / 60, [1.0, 1.0, 1.5], atol=1e-12)
    np.testing.assert_allclose(fe.M.toarray().sum(), 3 * fe.inertia.mass)


def test_mass_spread_over_nodes_is_equal():
    mesh = line(4)
    ends = Mesh(mesh.points, mesh.blocks, {"ends": np.array([0, 4])})
    fe = assemble(ends, MATTER, SECTION, masses={"ends": {"at": "ends", "mass": 4.0}})
    np.testing.assert_allclose(fe.nodal.mass, [2.0, 2.0])


@pytest.mark.parametrize("mesh", [block((2, 1, 1), distort=0.2), line(4, START, END)])
def test_lumped_mass_is_exact_in_mass_and_diagonal(mesh):
    """Translations carry the whole mass; centre and inertia approach the body's."""
    section = SECTION if "line" in mesh.blocks else None
    fe = assemble(mesh, MATTER, section, mass_matrix="hrz")
    exact = assemble(mesh, MATTER, section)
    M = fe.M.toarray()
    assert fe.inertia.mass == pytest.approx(exact.inertia.mass, rel=1e-13)
    assert np.count_nonzero(M - np.diag(np.diag(M))) == 0 and np.diag(M).min() > 0
    R = fe.rigid[:, :3]
    np.testing.assert_allclose(R.T @ M @ R, fe.inertia.mass * np.eye(3), atol=1e-11 * M.max())
    Mab = fe.reduced_mass(np.eye(fe.numbering.n))
    np.testing.assert_allclose(sum(Mab[b, b] for b in range(3)), M, atol=1e-13 * M.max())
    full = fe.rigid
    S = fe.inertia.S0 - np.outer(fe.inertia.S1, fe.inertia.S1) / fe.inertia.mass
    wanted = np.trace(S) * np.eye(3) - S
    np.testing.assert_allclose((full.T @ M @ full)[3:, 3:], wanted, atol=1e-11 * M.max())


def test_lumped_inertia_approaches_the_exact_one():
    """The error of the moment of inertia of a thin beam falls with the square of its elements."""
    sizes, errors, thin = (4, 8, 16), [], {"all": rectangle(1e-3, 1e-3)}
    exact = MATTER.density * 1e-6 / 12
    for n in sizes:
        inertia = assemble(line(n), MATTER, thin, mass_matrix="hrz").inertia
        errors.append(inertia.S0[0, 0] - inertia.mass / 4 - exact)
    assert slope(sizes, errors) == pytest.approx(-2, abs=0.1)


def test_lumped_inertia_of_a_beam_by_hand():
    """The diagonal of the consistent matrix, scaled to the mass (Hinton, Rock & Zienkiewicz 1976):
    156/420 m across, 1/3 m along and 4/420 m L^2 of a thin beam, the mean of all three axes."""
    length = 3.0
    fe = assemble(
        line(1, (0, 0, 0), (length, 0, 0)), MATTER, {"all": rectangle(1e-4, 1e-4, shear=False)},
        mass_matrix="hrz",
    )  # fmt: skip
    m, table = fe.inertia.mass, fe.numbering.table
    diagonal = fe.M.diagonal()[table[0]]
    move, turn = (1 / 3 + 2 * 156 / 420) / 3, (0 + 2 * 4 / 420) / 3
    np.testing.assert_allclose(diagonal[:3], m / 2, rtol=1e-9)
    np.testing.assert_allclose(diagonal[3:], turn / (2 * move) * m * length**2, rtol=1e-6)


def test_mass_spread_over_uneven_quadrilaterals_has_the_centroid_of_their_area():
    """Sides 1 and 3 long: each gives its corners a quarter of its share."""
    x = [[0, 0, 0], [1, 0, 0], [4, 0, 0], [0, 1, 0], [1, 1, 0], [4, 1, 0]]
    quads = {"quad": np.array([[0, 1, 4, 3], [1, 2, 5, 4]])}
    mesh = Mesh(np.array(x, float), quads, {}, {"skin": {"quad": np.arange(2)}})
    fe = assemble(mesh, MATTER, {"skin": shell(0.01)}, masses={"a": {"at": "skin", "mass": 8.0}})
    np.testing.assert_allclose(fe.nodal.mass, [0.5, 2.0, 1.5] * 2, rtol=1e-12)


def test_lumped_frequencies_converge():
    section = {"all": rectangle(1e-3, 2e-3, shear=False)}
    scale = np.sqrt(MATTER.E * 1e-6 / 12 / MATTER.density)
    sizes, errors = (5, 10, 20), []
    for n in sizes:
        fe = assemble(line(n), MATTER, section, mass_matrix="hrz")
        errors.append(held_frequencies(fe, fe.numbering.table[0], 1)[0] / scale / 3.51601527 - 1)
    assert abs(errors[-1]) < 2e-3 and slope(sizes, errors) < -1.8


def frame(springs, angle=0.3):
    """Two separate bars with a spring between node 1 and node 2."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1.3, 0.4, 0.2], [2.3, 0.4, 0.5]], dtype=float)
    return assemble(
        Mesh(points, {"line": np.array([[0, 1], [2, 3]])}), MATTER, SECTION, springs=springs
    )


SIX = {
    "between": [1, 2],
    "stiffness": [1e4, 2e4, 3e4, 400.0, 500.0, 600.0],
    "axes": [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]],
}


@pytest.mark.parametrize("spring", [{"between": [1, 2], "stiffness": 1e4}, SIX])
def test_springs_leave_rigid_motions_free(spring):
    fe = frame({"joint": spring})
    assert np.abs(fe.K @ fe.rigid).max() < 1e-12 * np.abs(fe.K).max()
    values = np.linalg.eigvalsh(fe.K.toarray())
    held = 6 if len(np.atleast_1d(spring["stiffness"])) == 6 else 1
    assert (values < 1e-9 * values[-1]).sum() == 12 - held


def test_energy_of_springs():
    """Half k times the relative motion squared, along the line and in axes of its own."""
    loose, fe = frame({}), frame({"joint": {"between": [1, 2], "stiffness": 1e4}})
    u = np.random.default_rng(1).normal(size=fe.numbering.n)
    move = u[fe.numbering.table]
    n = np.array([0.3, 0.4, 0.2]) / np.linalg.norm([0.3, 0.4, 0.2])
    stretch = n @ (move[2, :3] - move[1, :3])
    assert u @ (fe.K - loose.K) @ u == pytest.approx(1e4 * stretch**2)
    fe = frame({"joint": SIX})
    half = np.array([0.15, 0.2, 0.1])
    relative = move[2, :3] - np.cross(move[2, 3:], half) - move[1, :3] - np.cross(move[1, 3:], half)
    turn = move[2, 3:] - move[1, 3:]
    x = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    z = np.array([1.0, -1.0, 1.0]) / np.sqrt(3)
    axes = np.stack([x, np.cross(z, x), z])
    energy = SIX["stiffness"] @ np.concatenate([axes @ relative, axes @ turn]) ** 2
    assert u @ (fe.K - loose.K) @ u == pytest.approx(energy)


def spring_energy(spring, points, state, move):
    """Exact energy of a spring of six stiffnesses at large motions: `state` a relative displacement
    and rotation of its ends, `move` (12,) displacements and rotations of both beside it."""
    stiffness, axes = np.array(spring.stiffness), spring.axes
    arms = points.mean(axis=0) - points
    turns = [Rotation.from_rotvec(sign * 0.5 * state[3:]) for sign in (-1, 1)]
    ends, frames = [], []
    for k, sign in enumerate((-1, 1)):
        frames.append(Rotation.from_rotvec(move[6 * k + 3 : 6 * k + 6]) * turns[k])
        ends.append(sign * 0.5 * state[:3] + move[6 * k : 6 * k + 3] + frames[k].apply(arms[k]))
    relative = (frames[0].inv() * frames[1]).as_rotvec()
    middle = frames[0] * Rotation.from_rotvec(0.5 * relative)
    d = middle.inv().apply(points[1] + ends[1] - points[0] - ends[0])
    x = np.concatenate([axes.T @ d, axes.T @ relative])
    return 0.5 * stiffness @ x**2


@pytest.mark.parametrize(
    ("arms", "state"), [(1.0, [0.3, -0.2, 0.5, 0, 0, 0]), (0.0, [0.3, -0.2, 0.5, 0.2, 0.4, -0.3])]
)
def test_a_loaded_spring_of_six_stiffnesses_has_the_tangent_of_its_exact_energy(arms, state):
    """The part that grows with the load, by differences of the energy at finite rotations."""
    points = np.array([[0.4, 0.1, 0.3], [1.0, 0.7, 0.1]]) * [[1.0], [arms]]
    points[1] += (1 - arms) * points[0]
    mesh = Mesh(np.vstack([points, points + [[1, 0, 0]]]), {"line": np.array([[0, 2], [1, 3]])})
    words = {**SIX, "between": [0, 1], "stiffness": [3.0, 2.0, 5.0, 0.7, 0.4, 0.9]}
    fe = assemble(mesh, MATTER, SECTION, springs={"s": words})
    u = np.zeros(fe.numbering.n)
    for node, sign in ((0, -0.5), (1, 0.5)):
        u[fe.numbering.table[node]] = sign * np.array(state)
    K, numbers = spring_geometric_stiffness(fe.springs[0], fe.numbering, mesh.points, u)
    assert (numbers[0] == fe.numbering.table[:2].ravel()).all()
    h, load = 2e-3, 1e-3
    steps = h * np.eye(12)

    def hessian(scale):
        def energy(move):
            return spring_energy(fe.springs[0], points, scale * np.array(state), move)

        return [
            [
                (energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b)) / (4 * h**2)
                for b in steps
            ]
            for a in steps
        ]

    exact = np.subtract(hessian(load), hessian(-load)) / (2 * load)
    np.testing.assert_allclose(K[0], exact, atol=1e-4 * np.abs(exact).max())


def test_a_mass_between_two_taut_springs_vibrates_like_a_string():
    """w^2 = (2 k + 2 T/L)/m across two springs of length L under the force T, k across from
    others without load."""
    m, L, T, k, stub = 3.0, 0.7, 900.0, 400.0, 0.01
    x = np.cumsum([0, stub, L, stub, L, stub])
    points = np.column_stack([x, 0 * x, 0 * x])
    mesh = Mesh(points, {"line": np.array([[0, 1], [2, 3], [4, 5]])})
    springs = {}
    for name, ends in (("left", [1, 2]), ("right", [3, 4])):
        springs[name] = {"between": ends, "stiffness": 1e5}
        springs[f"{name} across"] = {"between": ends, "stiffness": [0, k, k, 1e4, 1e4, 1e4]}
    fixed = {"type": "clamped"}
    frequencies = part(
        mesh, material=STIFF, sections=SECTION, springs=springs,
        masses={"m": {"at": 2, "mass": m, "offset": [stub / 2, 0, 0], "inertia": [1, 1, 1]}},
        supports={"a": {"nodes": [0, 1], **fixed},
                  "b": {"nodes": [4, 5], **fixed, "displacement": [2 * T / 1e5, 0, 0]}},
        frequencies=2, preload=True,
    ).frequencies  # fmt: skip
    assert 2 * np.pi * frequencies == pytest.approx(np.sqrt((2 * k + 2 * T / L) / m), rel=1e-3)


def test_a_mass_on_a_node_without_elements_that_follows_a_tie_hangs_on_a_rigid_arm():
    """The same as a mass with an offset on the reference node."""
    arm, more = [0.1, -0.2, 0.3], {"mass": 7.0, "inertia": INERTIA}
    bar = line(3, START, END)
    mesh = Mesh(
        np.vstack([bar.points, bar.points[3] + arm]), bar.blocks, {**bar.node_sets, "arm": [4]}
    )
    ties = {"t": {"type": "rbe2", "reference": 3, "nodes": "arm"}}
    tied = assemble(mesh, MATTER, SECTION, ties=ties, masses={"m": {"at": "arm", **more}})
    offset = assemble(bar, MATTER, SECTION, masses={"m": {"at": 3, "offset": arm, **more}})
    np.testing.assert_allclose(tied.K.toarray(), offset.K.toarray(), rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(tied.M.toarray(), offset.M.toarray(), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(tied.inertia.S0, offset.inertia.S0, rtol=1e-12)


def test_a_rigid_post_on_a_spring_buckles():
    """P a = k: the foot of the post turns about the middle of the spring, a below its top."""
    foot, height, turn = 0.2, 1.3, 70.0
    points = np.array([[0, 0, -0.1], [0, 0, 0], [0, 0, foot], [0, 0, foot + height]])
    mesh = Mesh(points, {"line": np.array([[0, 1], [2, 3]])})
    spring = {"between": [1, 2], "stiffness": [1e9, 1e9, 1e9, turn, 2 * turn, 1e9]}
    factors = part(
        mesh, material=STIFF, sections=SECTION, springs={"s": spring},
        supports={"a": {"nodes": [0, 1], "type": "clamped"}},
        loads={"p": {"type": "force", "node": 3, "force": [0, 0, -1.0]}}, buckling=2,
    ).load_factors  # fmt: skip
    assert factors == pytest.approx(np.array([1, 2]) * turn / (height + foot / 2), rel=1e-5)


def solid_and_beam():
    """A box with a beam on one corner: node 0 has no rotations."""
    box = block((1, 1, 1))
    corner = int(np.flatnonzero((box.points == 1).all(axis=1))[0])
    points = np.vstack([box.points, [2, 1, 1], [5, 5, 5]])
    lines = np.array([[corner, len(points) - 2]])
    return Mesh(points, dict(box.blocks) | {"line": lines}, {}, box.element_sets)


@pytest.mark.parametrize(
    ("masses", "sentence"),
    [
        ({"a": {"at": "x9", "mass": 1}}, 'masses.a.at: .* has no group "x9"; allowed: x0, x1'),
        ({"a": {"at": 99, "mass": 1}}, "masses.a.at: there is no node 99"),
        ({"a": {"at": 28, "mass": 1}}, "masses.a.at: node 28 belongs to no element"),
        ({"a": {"at": 0, "mass": -1}}, "masses.a.mass: must not be negative, given -1 kg"),
        ({"a": {"at": 0, "mass": float("nan")}}, "masses.a.mass: must be a number"),
        ({"a": {"at": 0}}, "masses.a.mass: is missing"),
        ({"a": {"at": 0, "mas": 1, "mass": 1}}, "masses.a.mas: unknown key; nearest: mass"),
        ({"a": {"at": 0, "mass": 1, "inertia": [1, 1, 1]}}, "node 0 has no rotations.*tie"),
        ({"a": {"at": "x0", "mass": 1, "offset": [1, 0, 0]}}, "spread over 9 nodes"),
        ({"a": {"at": 27, "mass": 1, "inertia": [1, 1, 3]}}, "no body has the principal moments"),
        ({"a": {"at": 27, "mass": 1, "inertia": [1, 2]}}, "masses.a.inertia: expects"),
    ],
)
def test_refused_masses(masses, sentence):
    with pytest.raises(MeshError, match=sentence):
        assemble(solid_and_beam(), MATTER, SECTION, masses=masses)


@pytest.mark.parametrize(
    ("spring", "sentence"),
    [
        ({"between": [0, "ground"], "stiffness": 1}, "a spring to the ground is a force of the"),
        ({"between": 0, "stiffness": 1}, "the body floats"),
        ({"between": [0, 0], "stiffness": 1}, "both ends are node 0"),
        ({"between": [0, 1], "stiffness": -1}, "springs.s.stiffness: must be positive"),
        ({"between": [0, 1], "stiffness": [1, 2]}, "expects one number .* or six"),
        ({"between": [0, 1], "stiffness": [1] * 6}, "node 0 has no rotations for the spring's"),
        ({"between": [0, 28], "stiffness": 1}, "node 28 belongs to no element"),
        ({"between": [0, "x0"], "stiffness": 1}, 'one node is expected, the group "x0" has 9'),
        ({"between": [0, 1], "stiffnes": 1}, "springs.s.stiffnes: unknown key"),
        ({"between": [0, 1], "stiffness": 1, "axes": [1, 0, 0]}, "axes: belong to a spring"),
    ],
)
def test_refused_springs(spring, sentence):
    with pytest.raises(MeshError, match=sentence):
        assemble(solid_and_beam(), MATTER, SECTION, springs={"s": spring})


def test_an_unknown_mass_matrix():
    with pytest.raises(ReductionError, match='unknown "lumped"; allowed: consistent, hrz'):
        assemble(line(1), MATTER, SECTION, mass_matrix="lumped")


def test_a_reduced_body_carries_its_masses_and_springs(tmp_path):
    """Mass of the body, and another fingerprint for other masses, springs or mass matrix."""
    given = {"units": "SI", "material": MATTER, "sections": SECTION, "modes": 3}
    mass = {"load": {"at": "tip", "mass": 7.0, "inertia": np.eye(3)}}
    spring = {"tie": {"between": ["root", "tip"], "stiffness": 1e6}}
    ends = {"a": "root", "b": "tip"}
    plain = reduce(line(4), interfaces=ends, **given)
    body = reduce(line(4), interfaces=ends, **given, masses=mass, springs=spring, mass_matrix="hrz")
    assert body.mass == pytest.approx(plain.mass + 7)
    assert "load" in body.provenance["masses"] and body.provenance["mass_matrix"] == "hrz"
    file = tmp_path / "mesh"
    file.write_text("any")
    options = [{}, {"masses": mass}, {"springs": spring}, {"mass_matrix": "hrz"}]
    assert len({reduction_key(file, **given, **extra) for extra in options}) == 4
