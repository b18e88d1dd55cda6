"""The linear solver: solutions of all shapes of model, and matrices that cannot be factorised."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.reduction import hex20_block
from femeshes import block
from scipy.sparse import block_diag, csr_array, diags_array, eye_array, kron

from flexmb.errors import ReductionError
from flexmb.fe import Mesh, assemble, craig_bampton, linear_solver, make_interfaces, resolve
from flexmb.fe.dissection import dissect, matrix_graph
from flexmb.fe.linear_solver import PARDISO_INSTALLED, Pardiso, SingularMatrix, factor
from flexmb.fe.multifrontal import Multifrontal, blas_threads, fronts


@pytest.fixture(autouse=True)
def without_pardiso(monkeypatch):
    """The solver of flexmb is tested also where PARDISO is installed."""
    monkeypatch.setattr(linear_solver, "PARDISO_INSTALLED", False)


def chain(n, held=True):
    """Springs of unit stiffness in a row, both ends held or both free."""
    K = diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    K = csr_array(K)
    if not held:
        K[0, 0] = K[n - 1, n - 1] = 1.0
    return K


def grid(shape, held=True):
    """Springs between neighbours of a regular grid: matrix and points (n, 3)."""
    K = csr_array((1, 1))
    for n in shape:
        K = kron(K, eye_array(n)) + kron(eye_array(K.shape[0]), chain(n, held))
    points = np.zeros((K.shape[0], 3))
    points[:, : len(shape)] = np.indices(shape).reshape(len(shape), -1).T
    return csr_array(K), points


def standing_wave(shape):
    """An eigenvector of the held grid and its eigenvalue, sum of 4 sin^2(k pi / (2 n + 2))."""
    wave, value = np.ones(1), 0.0
    for k, n in enumerate(shape, start=2):
        wave = np.kron(wave, np.sin(np.pi * k * np.arange(1, n + 1) / (n + 1)))
        value += 4 * np.sin(np.pi * k / (2 * n + 2)) ** 2
    return wave, value


def held_block(divisions=(2, 1, 1)):
    fe = assemble(block(divisions), resolve("steel"))
    held = fe.numbering.table[fe.mesh.group_nodes("x0"), :3].ravel()
    free = np.setdiff1d(np.arange(fe.numbering.n), held)
    return fe.K[free][:, free], fe.dof_points[free]


def multifrontal(K, points, leaf):
    graph = matrix_graph(K, points)
    plan = fronts(graph, dissect(graph, leaf))
    return Multifrontal(K, plan), plan


def test_solves_for_one_and_many_right_sides():
    K, points = held_block()
    b = np.random.default_rng(0).normal(size=(len(points), 3))
    x = factor(K).solve(b)
    np.testing.assert_allclose(K @ x, b, atol=1e-9)
    np.testing.assert_allclose(factor(K).solve(b[:, 0]), x[:, 0], rtol=1e-9)


@pytest.mark.parametrize("leaf", [6, 60, 10**6])
@pytest.mark.parametrize("placed", [True, False], ids=["points", "no points"])
def test_small_fronts_solve_like_a_full_matrix(leaf, placed):
    K, points = held_block((3, 2, 1))
    found, plan = multifrontal(K, points if placed else None, leaf)
    assert (len(plan.borders) == 1) == (leaf == 10**6)
    b = np.random.default_rng(0).normal(size=(len(points), 2))
    exact = np.linalg.solve(K.toarray(), b)
    np.testing.assert_allclose(found.solve(b), exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("shape", [(6000,), (80, 80), (18, 18, 18), (600, 4, 4)], ids=str)
@pytest.mark.parametrize("placed", [True, False], ids=["points", "no points"])
def test_lines_surfaces_and_bodies_of_springs_have_their_standing_waves(shape, placed):
    K, points = grid(shape)
    found = factor(K, points if placed else None)
    assert isinstance(found, Multifrontal)
    wave, value = standing_wave(shape)
    x = found.solve(wave)
    # condition number of the longest chain is 1e7; errors of rounding grow by that at most
    np.testing.assert_allclose(x, wave / value, atol=1e-9 / value)
    b = np.random.default_rng(0).normal(size=len(wave))
    assert np.linalg.norm(K @ found.solve(b) - b) < 1e-10 * np.linalg.norm(b)


def test_fill_and_operations_stay_within_what_nested_dissection_is_known_for():
    """George, Liu (1981), Computer Solution of Large Sparse Positive Definite Systems, ch. 8.1: on
    an n x n grid with nine-point connections 31/4 n^2 log2 n entries and 829/84 n^3
    multiplications, to leading order."""
    n = 63
    K, points = grid((n, n))
    nine = csr_array(kron(abs(chain(n)), abs(chain(n))))
    graph = matrix_graph(nine, points)
    plan = fronts(graph, dissect(graph, 8))
    assert plan.nnz < 7.75 * n**2 * np.log2(n)
    assert plan.flops.sum() < 2 * 829 / 84 * n**3
    assert plan.memory > 8 * plan.nnz


def test_fill_without_points_is_not_far_from_that_with_points():
    K, points = grid((16, 16, 16))
    graphs = matrix_graph(K, points), matrix_graph(K)
    placed, unplaced = (fronts(graph, dissect(graph, 60)).nnz for graph in graphs)
    assert unplaced < 1.5 * placed


def test_stiffnesses_of_very_different_size():
    """Rows scaled by 1e-6 to 1e6 (units, soft beside stiff parts): the solution scales as well."""
    K, points = grid((18, 18, 18))
    scale = 10.0 ** np.random.default_rng(0).uniform(-6, 6, len(points))
    D = diags_array(scale)
    wave, value = standing_wave((18, 18, 18))
    x = factor(csr_array(D @ K @ D), points).solve(scale * wave)
    np.testing.assert_allclose(scale * x, wave / value, atol=1e-11 / value)


def test_a_vertex_tied_to_all_others_and_a_full_group():
    K, points = grid((18, 18, 18))
    n = len(points)
    hub = csr_array((np.full(n - 1, -0.01), (np.zeros(n - 1, dtype=int), np.arange(1, n))), (n, n))
    K = csr_array(K + hub + hub.T + diags_array(np.r_[n * 0.01, np.full(n - 1, 0.01)]))
    group = np.arange(0, n, 40)
    G = csr_array((np.ones(len(group)), (group, np.zeros(len(group), dtype=int))), (n, 1))
    K = csr_array(K + G @ G.T)
    found = factor(K, points)
    assert found.nnz < 5e6  # 17e6 as a full triangle
    b = np.random.default_rng(0).normal(size=n)
    assert np.linalg.norm(K @ found.solve(b) - b) < 1e-10 * np.linalg.norm(b)


def test_parts_without_connection():
    one, points = grid((14, 14, 14))
    K = csr_array(block_diag([one, 1e12 * one]))
    wave, value = standing_wave((14, 14, 14))
    for places in (np.vstack([points, points]), np.vstack([points, points + 40]), None):
        x = factor(K, places).solve(np.concatenate([wave, 1e12 * wave]))
        np.testing.assert_allclose(x, np.tile(wave / value, 2), atol=1e-11 / value)


def test_solutions_are_the_same_to_the_last_bit():
    K, points = grid((18, 18, 18))
    b = np.random.default_rng(0).normal(size=(len(points), 2))
    assert (factor(K, points).solve(b) == factor(K, points).solve(b)).all()


def test_the_number_of_threads_is_given_back():
    with blas_threads(1) as before:
        K, points = grid((18, 18, 18))
        factor(K, points)
        with blas_threads(1) as inside:
            assert inside == (1,) * len(before)
    with blas_threads(1) as after:
        assert after == before


def test_singular_matrices_are_refused():
    fe = assemble(block((2, 1, 1)), resolve("steel"))
    with pytest.raises(SingularMatrix, match="singular"):
        factor(fe.K)
    with pytest.raises(SingularMatrix, match="without stiffness") as caught:
        factor(csr_array(np.diag([1.0, 0.0])))
    assert list(caught.value.dofs) == [1]


@pytest.mark.parametrize("n", [4, 12], ids=["small", "large"])
@pytest.mark.parametrize("stiffness", [1e-6, 1e9])
def test_the_free_part_is_named(n, stiffness):
    held, points = grid((2 * n, n, n))
    free, others = grid((n, n, n), held=False)
    K = csr_array(block_diag([held, stiffness * free]))
    places = np.vstack([points, others + [50, 0, 0]])
    with pytest.raises(SingularMatrix, match=rf"{n**3} nodes lie between \(50, 0, 0\)") as caught:
        factor(K, places)
    np.testing.assert_array_equal(caught.value.dofs, len(points) + np.arange(n**3))
    with pytest.raises(SingularMatrix, match=f"{n**3} of {3 * n**3} unknowns"):
        factor(K)


def test_a_body_that_turns_about_a_hinge_is_named():
    fe = assemble(block((2, 1, 1)), resolve("steel"))
    hinge = (fe.mesh.points[:, 0] < 1e-9) & (fe.mesh.points[:, 2] < 1e-9)
    free = np.setdiff1d(np.arange(fe.numbering.n), fe.numbering.table[hinge, :3])
    with pytest.raises(SingularMatrix, match="moves freely") as caught:
        factor(fe.K[free][:, free], fe.dof_points[free])
    turning = np.unique(fe.dof_points[free][caught.value.dofs], axis=0)
    assert len(turning) == len(fe.mesh.points) - hinge.sum()


@pytest.mark.parametrize("n", [5, 18], ids=["small", "large"])
def test_negative_stiffness_is_refused(n):
    K, points = grid((n, n, n))
    K[7, 7] -= 5.999  # a spring of negative stiffness at one node
    with pytest.raises(ReductionError, match=r"not positive definite.*at \("):
        factor(K, points)


def test_what_does_not_fit_into_memory_is_refused_before_it_starts(monkeypatch):
    K, points = grid((18, 18, 18))
    monkeypatch.setenv("FLEXMB_MEMORY", "2 MB")
    told = []
    with pytest.raises(ReductionError, match=r"needs about .* FLEXMB_MEMORY allows 2 MB") as caught:
        factor(K, points, lambda phase, fraction, detail="": told.append(phase))
    assert "5832 unknowns" in str(caught.value)
    assert set(told) == {"order"}


def test_progress_goes_through_ordering_and_factorisation():
    K, points = grid((18, 18, 18))
    told = {}
    factor(K, points, lambda phase, f, detail="": told.setdefault(phase, []).append(f))
    assert list(told) == ["order", "factor"]
    for fractions in told.values():
        assert fractions == sorted(fractions)
        assert fractions[-1] == 1.0


def test_modes_by_the_solver_of_large_models_are_the_same_to_the_last_bit(monkeypatch):
    monkeypatch.setattr(linear_solver, "_MAX_SUPERLU", 100)
    fe = assemble(block((4, 2, 2), (2.0, 1.0, 1.0)), resolve("steel"))
    interfaces = make_interfaces(fe, {"left": "x0", "right": "x1"})
    first, second = (craig_bampton(fe, interfaces, 6) for _ in range(2))
    assert (first.basis == second.basis).all()
    rigid = np.zeros((12, 3))
    rigid[[0, 6], 0] = rigid[[1, 7], 1] = rigid[[2, 8], 2] = 1.0
    moved = first.basis[:, :12] @ rigid
    np.testing.assert_allclose(moved, fe.rigid[:, :3], atol=1e-11)
    assert np.abs(first.K[:12, :12] @ rigid).max() < 1e-11 * np.abs(first.K).max()


@pytest.mark.skipif(not PARDISO_INSTALLED, reason="pypardiso is not installed")
def test_pardiso_is_used_if_it_is_installed(monkeypatch):
    monkeypatch.setattr(linear_solver, "PARDISO_INSTALLED", True)
    K, points = grid((18, 18, 18))
    found = factor(K, points)
    assert isinstance(found, Pardiso)
    wave, value = standing_wave((18, 18, 18))
    np.testing.assert_allclose(found.solve(wave), wave / value, atol=1e-11 / value)
    b = np.random.default_rng(0).normal(size=(len(points), 3))
    assert np.linalg.norm(K @ found.solve(b) - b) < 1e-10 * np.linalg.norm(b)
    free, others = grid((5, 5, 5), held=False)
    with pytest.raises(SingularMatrix, match="125 nodes"):
        factor(csr_array(block_diag([K, free])), np.vstack([points, others + 50]))
    monkeypatch.setenv("FLEXMB_MEMORY", "2 MB")
    with pytest.raises(ReductionError, match="FLEXMB_MEMORY allows 2 MB"):
        factor(K, points)


def test_a_part_that_hangs_on_an_edge_is_named_by_the_reduction():
    """Two blocks that share the three nodes of an edge; an interface holds one of them."""
    one = block((2, 1, 1), (2.0, 1.0, 1.0))
    points = np.vstack([one.points, one.points + [2, 0, 1]])
    _, first, same = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    cells = one.blocks["tetra10"]
    tets = same.ravel()[np.vstack([cells, cells + len(one.points)])]
    held = {"held": np.flatnonzero(points[first, 0] == 0)}
    fe = assemble(Mesh(points[first], {"tetra10": tets}, held), resolve("steel"))
    interfaces = make_interfaces(fe, {"left": "held"})
    place = r"of .* nodes .* between \(2, 0, 1\) m and \(4, 1, 2\) m"
    with pytest.raises(ReductionError, match=f"{len(one.points) - 3} {place}"):
        craig_bampton(fe, interfaces, 5)


@pytest.mark.slow
def test_a_large_bar_has_the_frequency_of_its_axial_wave():
    """Held at both ends and without lateral contraction a bar vibrates along its axis at exactly
    c / (2 L), c^2 = E / rho; quadratic elements of length h miss it by about (k h)^4 / 1440."""
    n, E, density = 10, 2.1e11, 7850.0
    mesh = hex20_block(n)
    fe = assemble(mesh, resolve({"E": E, "nu": 0.0, "density": density}))
    interfaces = make_interfaces(fe, {"left": "x0", "right": "x1"})
    found = craig_bampton(fe, interfaces, 20)
    exact = np.sqrt(E / density) / 8.0
    frequencies = np.sqrt(np.diag(found.K)[12:]) / (2 * np.pi)
    kh = np.pi / 4.0 / n
    assert np.abs(frequencies / exact - 1).min() < 2 * kh**4 / 1440
    held = np.concatenate([part.dofs for part in interfaces])
    free = np.setdiff1d(np.arange(fe.numbering.n), held)
    inertia = (fe.M @ found.basis[:, 12:])[free] * np.diag(found.K)[12:]
    wrong = (fe.K @ found.basis)[free]
    wrong[:, 12:] -= inertia
    assert np.linalg.norm(wrong[:, 12:]) < 1e-10 * np.linalg.norm(inertia)
    forces = abs(fe.K) @ np.abs(found.basis[:, :12])
    assert np.linalg.norm(wrong[:, :12]) < 1e-10 * np.linalg.norm(forces)
