"""Which modes are kept: by number, frequency, effective interface mass; static, free and user's."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, line, mirrored_block, tied
from scipy.linalg import eigh

from flexmb.errors import FlexmbWarning, ReductionError
from flexmb.fe import (
    Mesh,
    assemble,
    craig_bampton,
    free_interface,
    guyan,
    make_interfaces,
    orthonormalise,
    rectangle,
    reduce_model,
    resolve,
    user_modes,
)
from flexmb.fe.reduction.eigenmodes import make_symmetry_plane
from flexmb.fe.reduction.free_body import free_modes

STEEL = resolve("steel")


@pytest.fixture(scope="module")
def bar():
    fe = assemble(line(12), STEEL, {"all": rectangle(0.03, 0.05)})
    return fe, make_interfaces(fe, {"root": "root", "tip": "tip"})


@pytest.fixture(scope="module")
def box():
    fe = assemble(block((3, 1, 1), (1, 0.2, 0.15)), STEEL)
    return fe, make_interfaces(fe, {"a": "x0", "b": {"group": "x1", "type": "rbe3"}})


def held(fe, interfaces):
    """Frequencies of a clamped-clamped bar, by full matrices."""
    free = np.setdiff1d(np.arange(fe.numbering.n), np.concatenate([i.dofs for i in interfaces]))
    return eigh(fe.K[free][:, free].toarray(), fe.M[free][:, free].toarray())


def test_all_modes_below_a_frequency(bar):
    fe, interfaces = bar
    frequencies = np.sqrt(held(fe, interfaces)[0]) / (2 * np.pi)
    for count in (1, 7, 25):
        between = np.sqrt(frequencies[count - 1] * frequencies[count])
        found = craig_bampton(fe, interfaces, {"frequency": float(between)})
        assert found.kinds.count("fixed-interface") == count
        got = np.sqrt(np.diag(found.K)[12:]) / (2 * np.pi)
        np.testing.assert_allclose(got, frequencies[:count], rtol=1e-8)


def test_free_modes_below_a_frequency(box):
    fe, interfaces = box
    wanted = np.sqrt(eigh(fe.K.toarray(), fe.M.toarray())[0][6:30]) / (2 * np.pi)
    limit = float(0.5 * (wanted[9] + wanted[10]))
    assert free_modes(fe, (), {"frequency": limit}).kinds.count("free") == 10
    # the rbe2 stiffens one end: no more modes below the limit than without it
    assert 8 <= free_interface(fe, interfaces, {"frequency": limit}).kinds.count("free") <= 10


@pytest.mark.parametrize("share", [0.5, 0.8, 0.95])
def test_the_fewest_modes_that_hold_a_share_of_the_interface_mass(bar, share):
    """Independent of the code: P_k^2 over the diagonal of X^T M_ii^-1 X, from full matrices."""
    fe, interfaces = bar
    found = craig_bampton(fe, interfaces, {"effective_mass": share})
    b = np.concatenate([part.dofs for part in interfaces])
    i = np.setdiff1d(np.arange(fe.numbering.n), b)
    K, M = fe.K.toarray(), fe.M.toarray()
    psi = np.zeros((len(K), 12))
    psi[b] = np.eye(12)
    psi[i] = -np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, b)])
    X = (M @ psi)[i]
    total = np.sum(X * np.linalg.solve(M[np.ix_(i, i)], X), axis=0)
    _, V = held(fe, interfaces)
    shares = ((V.T @ X) ** 2 / total).mean(axis=1)
    assert shares.sum() == pytest.approx(1, rel=1e-10)
    numbers = [int(label.split()[1]) - 1 for label in found.labels if label.startswith("fixed")]
    assert shares[numbers].sum() >= share
    assert shares[numbers].sum() - shares[numbers].min() < share
    best = np.sort(shares)[::-1].cumsum()
    assert len(numbers) <= np.searchsorted(best, share) + 3  # later modes were never looked at


@pytest.mark.parametrize(
    ("modes", "sentence"),
    [
        (-1, "must be a whole number >= 0, given -1"),
        (2.5, "must be a whole number >= 0, given 2.5"),
        (True, "must be a whole number"),
        ({"frequencies": 10}, "modes.frequencies: unknown key; nearest: frequency"),
        ({}, "modes: give one of them, given none; allowed: count, freq"),
        ({"count": 3, "frequency": 10.0}, "give one of them, given count and frequency"),
        ({"frequency": 0}, "modes.frequency: must be positive, given 0 Hz"),
        ({"frequency": float("nan")}, "modes.frequency: must be a number"),
        ({"effective_mass": 1.0}, "must be a share below 1, is 1"),
        ({"count": -2}, "modes.count: must be a whole number"),
        (67, "67 requested, but the model has only 66 fixed-interface modes"),
    ],
)
def test_modes_that_cannot_be(bar, modes, sentence):
    with pytest.raises(ReductionError, match=sentence):
        craig_bampton(*bar, modes)


def test_methods_refuse_what_they_cannot(bar, box):
    fe, interfaces = bar
    with pytest.raises(ReductionError, match='"guyan".* has none'):
        guyan(fe, interfaces, 3)
    with pytest.raises(ReductionError, match="goes with fixed-interface modes"):
        free_interface(fe, interfaces, {"effective_mass": 0.5})
    with pytest.raises(ReductionError, match="the body has no interfaces; give a count"):
        free_modes(fe, (), {"effective_mass": 0.5})
    with pytest.raises(ReductionError, match="only 72 elastic modes"):
        free_interface(fe, interfaces, 73)
    with pytest.raises(ReductionError, match='unknown "craig"; nearest: craig-bampton; allowed'):
        reduce_model(fe, interfaces, "craig")
    with pytest.raises(ReductionError, match="needs interfaces: without them the body is rigid"):
        reduce_model(fe, (), "guyan")
    with pytest.raises(ReductionError, match="takes modes = an array, or the path"):
        reduce_model(fe, interfaces, "user", 20)
    assert reduce_model(fe, interfaces, "guyan").basis.shape[1] == 12
    assert reduce_model(fe, (), "free-interface", 3).kinds.count("free") == 3


@pytest.mark.parametrize("method", [craig_bampton, free_interface, guyan])
def test_every_method_keeps_to_a_plane(method):
    """The in-plane half of a symmetric model: its frequencies are among those of the whole."""
    fe = assemble(mirrored_block(), STEEL)
    interfaces = make_interfaces(fe, {"a": "x0", "b": {"group": "x1", "type": "rbe3"}})
    mirror = make_symmetry_plane(fe, "xy")
    modes = 0 if method is guyan else 8
    planar = orthonormalise(fe, method(fe, interfaces, modes, mirror=mirror))
    assert mirror.shares(fe, planar.Phi).max() < 1e-12
    whole = orthonormalise(fe, method(fe, interfaces, 3 * modes))
    even = mirror.shares(fe, whole.Phi) < 0.5
    count = 3 if method is guyan else 4
    np.testing.assert_allclose(planar.omega2[:count], whole.omega2[even][:count], rtol=2e-2)


def test_closed_form_stiffness_of_a_beam_by_static_reduction():
    """Guyan reduction of a beam onto its ends is exact: 12 EI/L^3, 6 EI/L^2, 4 EI/L, EA/L, GJ/L:
    Przemieniecki, Theory of Matrix Structural Analysis, section 5.6, without shear."""
    section, L = rectangle(0.03, 0.05, shear=False), 1.0
    fe = assemble(line(12), STEEL, {"all": section})
    K = guyan(fe, make_interfaces(fe, {"root": "root", "tip": "tip"})).K
    E, G = STEEL.E, STEEL.E / (2 * (1 + STEEL.nu))
    k = E * section.Iz
    wanted = {
        (0, 0): E * section.A / L,
        (3, 3): G * section.J / L,
        (1, 1): 12 * k / L**3,
        (1, 5): 6 * k / L**2,
        (5, 5): 4 * k / L,
        (5, 11): 2 * k / L,
    }
    for entry, value in wanted.items():
        assert K[entry] == pytest.approx(value, rel=1e-8), entry


def test_static_flexibility_of_a_free_beam_by_residual_attachment():
    """A free beam accelerated by a force at its end, deflection there about mean axes: 1/105 of
    F L^3/EI. From v'''' EI = -m (a + b x) with a, b of rigid motion, v less its rigid part; the
    moment is F L (s^3 - 2 s^2 + s) up to sign, and the energy int M^2/(2 EI) dx = F^2 L^3/(210 EI).
    """
    section = rectangle(0.02, 0.03, shear=False)
    fe = assemble(line(20), STEEL, {"all": section})
    interfaces = make_interfaces(fe, {"root": "root"})
    elastic = orthonormalise(fe, (found := free_interface(fe, interfaces, 0)))
    motion = found.motion[0, 1] @ elastic.Z
    got = np.sum(motion**2 / elastic.omega2)
    assert got == pytest.approx(1 / (105 * STEEL.E * section.Iz), rel=1e-3)


def by_nodes(fe, V, width):
    modes = np.zeros((len(fe.mesh.points), width, V.shape[1]))
    for c in range(width):
        there = fe.numbering.table[:, c] >= 0
        modes[there, c] = V[fe.numbering.table[there, c]]
    return modes


def test_user_modes_that_are_free_modes_give_their_frequencies(box, bar, tmp_path):
    fe, _ = box
    omega2, V = eigh(fe.K.toarray(), fe.M.toarray())
    V = V[:, 6:12] * 3.7
    soft = make_interfaces(fe, {"b": {"group": "x1", "type": "rbe3"}})
    np.savez(tmp_path / "modes.npz", modes=by_nodes(fe, V, 3))
    for given in (V, by_nodes(fe, V, 3), tmp_path / "modes.npz", str(tmp_path / "modes.npz")):
        found = reduce_model(fe, soft, "user", given)
        np.testing.assert_allclose(orthonormalise(fe, found).omega2, omega2[6:12], rtol=1e-8)
    np.testing.assert_allclose(found.motion[0, :, 6:], soft[0].motion(found.basis)[:, 6:])
    fe, interfaces = bar
    omega2, V = eigh(fe.K.toarray(), fe.M.toarray())
    found = user_modes(fe, interfaces, by_nodes(fe, V[:, 6:10], 6))
    np.testing.assert_allclose(orthonormalise(fe, found).omega2, omega2[6:10], rtol=1e-8)


def test_rigid_content_of_user_modes_is_taken_out_and_told(bar):
    fe, interfaces = bar
    omega2, V = eigh(fe.K.toarray(), fe.M.toarray())
    mixed = V[:, 6:9] + 0.5 * V[:, [0, 3, 5]]
    with pytest.warns(FlexmbWarning, match="3 of the given modes have rigid content, mode . 0.2"):
        found = user_modes(fe, interfaces, mixed)
    np.testing.assert_allclose(orthonormalise(fe, found).omega2, omega2[6:9], rtol=1e-7)


def test_user_modes_that_cannot_be(bar, box, tmp_path):
    fe, interfaces = bar
    V = eigh(fe.K.toarray(), fe.M.toarray())[1][:, 6:9]
    (tmp_path / "text.npz").write_text("modes")
    np.savez(tmp_path / "two.npz", a=V, b=V)
    np.save(tmp_path / "plain.npy", V)
    bad = V.copy()
    bad[5, 1] = np.nan
    cases = [
        (V[:-1], r"have the shape \(77, 3\); allowed: \(78, k\), \(13, 3, k\), \(13, 6, k\)"),
        (by_nodes(fe, V, 3), r"has no rotations, but beams or shells do: give \(13, 6, k\)"),
        (bad, "mode 2 has entries that are not finite"),
        (V[:, :0], "there are none"),
        (np.column_stack([V, fe.rigid[:, 4]]), "mode 4 is a rigid motion .* nothing else"),
        (np.column_stack([V, V[:, 0] - 2 * V[:, 2]]), "modes 1, 3, 4 depend on each other"),
        (tmp_path / "none.npz", "cannot be read: No such file"),
        (tmp_path / "text.npz", "is no .npz file"),
        (tmp_path / "plain.npy", "is no .npz file"),
        (tmp_path / "two.npz", 'has no array "modes"; allowed: a, b'),
        (np.array([["a"]]), "not of real numbers"),
    ]
    for given, sentence in cases:
        with pytest.raises(ReductionError, match=sentence):
            user_modes(fe, interfaces, given)
    fe, interfaces = box
    V = eigh(fe.K.toarray(), fe.M.toarray())[1][:, 6:12]
    with pytest.raises(ReductionError, match="interfaces.a: its nodes do not move rigidly .*rbe3"):
        user_modes(fe, interfaces, V)


def test_a_part_that_nothing_holds_is_named():
    """Two blocks that share one edge only: a hinge. The loose one is told by its place."""
    one = block((1, 1, 1))
    shift = np.array([1.0, 1.0, 0.0])
    points = np.vstack([one.points, one.points + shift])
    _, first, same = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    cells = np.vstack([one.blocks["tetra10"], one.blocks["tetra10"] + len(one.points)])
    sets = {"x0": {"triangle6": one.element_sets["x0"]["triangle6"]}}
    faces = same.ravel()[one.blocks["triangle6"]]
    mesh = Mesh(points[first], {"tetra10": same.ravel()[cells], "triangle6": faces}, {}, sets)
    fe = assemble(mesh, STEEL)
    with pytest.raises(ReductionError) as told:
        craig_bampton(fe, make_interfaces(fe, {"wall": "x0"}), 2)
    sentence = str(told.value)
    assert "with all interfaces held, a part of the mesh still moves freely: 24 of 51" in sentence
    assert "between (1, 1, 0) m and (2, 2, 1) m" in sentence
    with pytest.raises(
        ReductionError, match="the free body has a hinge: besides its motions as a whole"
    ):
        orthonormalise(fe, free_modes(fe, (), 4))


def test_tied_model_of_rigid_interfaces_is_a_bound(bar):
    """Free-interface modes of a tied model are those of the tied matrices."""
    fe, interfaces = bar
    G = tied(fe, interfaces)
    wanted = eigh(G.T @ (fe.K @ G), G.T @ (fe.M @ G), eigvals_only=True)[6:10]
    found = orthonormalise(fe, free_interface(fe, interfaces, 4)).omega2[:4]
    np.testing.assert_allclose(found, wanted, rtol=1e-8)


def test_a_beam_on_a_node_of_solids_is_told_with_its_cure():
    """The node has no rotations: the beam would turn freely there. A tie to the face holds it."""
    solid = block((1, 1, 1))
    end = len(solid.points)
    corner = int(np.flatnonzero((solid.points == [1, 1, 1]).all(axis=1))[0])
    points = np.vstack([solid.points, [[2.0, 1.0, 1.0]]])
    blocks = {**solid.blocks, "line": np.array([[corner, end]])}
    sets = {**solid.element_sets, "pin": {"line": np.array([0])}}
    mesh = Mesh(points, blocks, {}, sets)
    sections = {"pin": rectangle(0.1, 0.1)}
    fe = assemble(mesh, STEEL, sections)
    cure = rf"turn freely at the nodes that they share with solids, .* \({corner}\): tie these to"
    with pytest.raises(ReductionError, match=cure):
        craig_bampton(fe, make_interfaces(fe, {"wall": "x0"}), 2)
    weld = {"weld": {"reference": corner, "nodes": "x1"}}
    fe = assemble(mesh, STEEL, sections, ties=weld)
    craig_bampton(fe, make_interfaces(fe, {"wall": "x0"}), 2)
