"""State, scratch, coefficients of methods, and how positions move."""

from __future__ import annotations

import math

import numpy as np
import pytest
from enginekit import MOVE, Bench, slope
from generators import Mechanism

from flexmb.engine.allocation import new_state, new_work, sizes
from flexmb.engine.integrators.explicit_rk import (
    dormand_prince_5,
    dormand_prince_8,
    explicit_method,
    interpolate,
    step,
)
from flexmb.engine.integrators.generalized_alpha import generalized_alpha
from flexmb.engine.integrators.radau import radau_5


@pytest.fixture(scope="module")
def bench():
    return Bench(Mechanism(1, "loop", "mixed").model)


def leaves(part):
    if isinstance(part, tuple):
        return [leaf for item in part for leaf in leaves(item)]
    return [part]


def test_sizes_agree_with_the_layout(bench):
    assert sizes(bench.sys) == (bench.layout.nq, bench.layout.nv, bench.layout.nc)


def test_a_new_state_is_at_rest_with_unit_orientations(bench):
    state = new_state(bench.sys)
    e0 = bench.sys.parts.bodies["iq"] + 3
    assert (state.q[e0] == 1.0).all() and np.abs(state.q).sum() == len(e0)
    assert not state.v.any() and not state.lam.any() and state.t[0] == 0.0


def test_scratch_says_when_it_is_read_too_early(bench):
    work = new_work(bench.sys, method=explicit_method(dormand_prince_5(), step, interpolate))
    for array in leaves((work.now, work.con, work.dense)):
        numbers = array.view(np.float64) if array.dtype.names else array
        assert array is work.dense.pair or np.isnan(numbers).all()  # which are two integers
    assert work.trial.stages.shape == (7, bench.layout.nq + bench.layout.nv + 3)


def test_every_stage_is_evaluated_from_scratch(bench):
    """Nothing of the scratch's NaN reaches a result, and no result depends on the one before."""
    bench.randomise(5)
    first = bench.at().residual, bench.gamma, bench.matrix(0.1, 0.01)
    bench.use(bench.sys)
    bench.randomise(6)
    bench.at()
    bench.matrix(0.1, 0.01)
    bench.randomise(5)
    again = bench.at().residual, bench.gamma, bench.matrix(0.1, 0.01)
    for found, wanted in zip(again, first, strict=True):
        np.testing.assert_array_equal(found, wanted)
        assert np.isfinite(found).all()


def test_positions_move_on_the_group(bench):
    bench.randomise(7)
    d = np.random.default_rng(8).standard_normal(bench.layout.nv)
    for size in (1.0, 1e-3, 1e-9, 0.0):
        bench.work.trial.dq[:] = size * d
        bench.run(MOVE)
        np.testing.assert_allclose(
            bench.work.trial.q, bench.moved(bench.q, size * d), rtol=0, atol=2e-15
        )
    q, v = bench.q.copy(), bench.v.copy()
    rate = bench.out[: bench.layout.nq].copy()
    np.testing.assert_allclose(rate, slope(lambda s: bench.moved(q, s * v)), atol=1e-11)


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8, 0.99])
def test_generalized_alpha_has_order_two_and_its_spectral_radius(radius):
    (alpha,) = generalized_alpha(radius).coefficients
    assert alpha.gamma == pytest.approx(0.5 + alpha.alpha_f - alpha.alpha_m)
    # the amplification of an oscillator of infinite frequency (Chung & Hulbert 1993, eq. 20)
    b, g, f, m = alpha.beta, alpha.gamma, alpha.alpha_f, alpha.alpha_m
    # rows: displacement (1-f) u1 + f u0 = 0, velocity, displacement update, unknown (u1, v1, a1)
    left = np.array([[1 - f, 0, 0], [0, 1, -g], [1, 0, -b]])
    right = np.array([[-f, 0, 0], [0, 1, 1 - g], [1, 1, 0.5 - b]])
    largest = np.abs(np.linalg.eigvals(np.linalg.solve(left, right))).max()
    # double and triple eigenvalues: the root of round-off
    assert largest == pytest.approx(radius, abs=1e-4)
    assert m == pytest.approx((2 * radius - 1) / (radius + 1))


@pytest.mark.parametrize(("pair", "order"), [(dormand_prince_5, 5), (dormand_prince_8, 8)])
def test_explicit_methods_meet_the_order_conditions(pair, order):
    """Quadrature, the long chains of A, and the weights of the dense output at both ends."""
    method = explicit_method(pair(), step, interpolate)
    (tableau,) = method.coefficients
    n, c = tableau.stages, tableau.c
    A, b = tableau.A[: n + 1, : n + 1], tableau.A[n, : n + 1]
    assert method.stages == len(c) and method.order == order and generalized_alpha(0.8).stages == 0
    np.testing.assert_allclose(tableau.A.sum(axis=1), c, atol=1e-14)
    chain = np.ones(n + 1)
    for k in range(order):
        assert b @ c[: n + 1] ** k == pytest.approx(1 / (k + 1), abs=1e-13)
        assert b @ chain == pytest.approx(1 / math.factorial(k + 1), abs=1e-13)
        chain = A @ chain
    for estimate in tableau.errors:  # the formula beside has less order
        assert abs(estimate.sum()) < 1e-13 and np.abs(estimate).max() > 1e-3
    np.testing.assert_allclose(tableau.dense.sum(axis=1)[: n + 1], b, atol=1e-12)
    shares = np.linspace(0.1, 0.9, 5)
    for k in range(len(tableau.dense[0]) - (order == 5)):
        weights = [tableau.dense @ s ** np.arange(1, len(tableau.dense[0]) + 1) for s in shares]
        np.testing.assert_allclose(weights @ c**k, shares ** (k + 1) / (k + 1), atol=1e-12)


def test_radau_is_collocation_at_its_points():
    """Stages integrate quadratics exactly, the end powers up to four; A⁻¹ by its eigenvectors."""
    (radau,) = radau_5().coefficients
    c = radau.c
    np.testing.assert_allclose(c, [(4 - 6**0.5) / 10, (4 + 6**0.5) / 10, 1.0], rtol=1e-15)
    for k in range(5):
        found = radau.A @ c**k
        if k < 3:
            np.testing.assert_allclose(found, c ** (k + 1) / (k + 1), atol=1e-15)
        assert found[2] == pytest.approx(1 / (k + 1), abs=1e-15)
    # the formula beside: γ₀ h f(t₀) and increments of the stages, exact for cubics (Hairer, Wanner,
    # Solving Ordinary Differential Equations II, IV.8)
    wanted = [-1 / radau.gamma, 0.0, 0.0]
    np.testing.assert_allclose([radau.error @ c**k for k in (1, 2, 3)], wanted, atol=1e-14)
    mu = complex(radau.mu_real, radau.mu_imag)
    first = np.outer(radau.back[0], radau.to[0])
    second = np.outer(radau.back[1] - 1j * radau.back[2], radau.to[1] + 1j * radau.to[2])
    np.testing.assert_allclose(first + second.real, np.eye(3), atol=1e-13)
    np.testing.assert_allclose(radau.gamma * first + (mu * second).real, radau.inverse, atol=1e-12)
    # the next term of the dense output, of u = t⁴/24 whose cubic is off by t² (1 − t)²/24: from
    # stages that are exact, and from those that integrate exact velocities t³/6
    cubic = (c**4 - c**2 * (1 - c) ** 2) / 24
    for stages in (c**4 / 24, radau.A @ c**3 / 6):
        assert radau.bend @ (stages - cubic)[:2] == pytest.approx(1 / 24, rel=1e-12)
