"""What samples say, against closed forms: indices of Ishigami, quantiles, derivatives, fits."""

from __future__ import annotations

import numpy as np
from ishigami import ishigami, ishigami_indices
from scipy import stats

from flexmb.model.scenes.sweep import Distribution
from flexmb.studies.sweeps.sampling import make_design
from flexmb.studies.sweeps.sweep_statistics import (
    correlation,
    derivatives_of,
    response_surface,
    sobol_indices,
    statistics_of,
)


def test_indices_of_ishigami_lie_in_their_intervals() -> None:
    knobs = {f"x{i}": Distribution("uniform", (-np.pi, np.pi)) for i in range(3)}
    rows = make_design(knobs, "saltelli", 2048, 1).values()
    x = np.array([list(row.values()) for row in rows])
    for shift in (0.0, 1e6):  # the estimators lose no digits to a large mean
        indices = sobol_indices(tuple(knobs), (ishigami(x) + shift).reshape(-1, 5))
        first, total = ishigami_indices()
        for one, exact, whole in zip(indices, first, total, strict=True):
            assert abs(one.first - exact) < 0.02
            assert abs(one.total - whole) < 0.02
            assert one.first_interval[0] - 0.01 <= exact <= one.first_interval[1] + 0.01
            assert one.total_interval[0] - 0.01 <= whole <= one.total_interval[1] + 0.01


def test_rows_of_failed_runs_are_left_out_and_a_constant_has_no_indices() -> None:
    knobs = {f"x{i}": Distribution("uniform", (-np.pi, np.pi)) for i in range(3)}
    x = np.array([list(row.values()) for row in make_design(knobs, "saltelli", 1024, 1).values()])
    values = ishigami(x)
    values[::40] = np.nan
    indices = sobol_indices(tuple(knobs), values.reshape(-1, 5))
    assert abs(indices[1].first - ishigami_indices()[0][1]) < 0.05
    assert sobol_indices(tuple(knobs), np.full((64, 5), 1e9)) == []


def test_intervals_hold_the_true_values_as_often_as_they_say() -> None:
    """Of 400 samples of an exponential distribution, of which all is known."""
    exact = stats.expon(scale=2.0)
    rng = np.random.default_rng(5)
    hits = np.zeros(3)
    for _ in range(400):
        one = statistics_of(rng.exponential(2.0, 200), (0.9,))
        for k, (low, high), true in (
            (0, one.mean_interval, exact.mean()),
            (1, one.deviation_interval, exact.std()),
            (2, one.quantiles[0].interval, exact.ppf(0.9)),
        ):
            hits[k] += low <= true <= high
    assert (hits >= 0.89 * 400).all()  # 95 % but for the skewness, 2.5 sigma
    assert (hits <= 0.985 * 400).all()


def test_too_few_runs_have_no_interval_of_a_tail() -> None:
    one = statistics_of(np.arange(20.0), (0.5, 0.95))
    assert np.isfinite(one.quantiles[0].interval).all()
    assert np.isnan(one.quantiles[1].interval).all()
    assert statistics_of(np.array([np.nan]), (0.5,)).runs == 0


def test_derivatives_are_of_fourth_order() -> None:
    centre, steps = np.array([0.4, 2.0]), np.array([0.1, 0.05])

    def f(x: np.ndarray) -> float:
        return float(np.exp(x[0]) * np.log(x[1]))

    offsets = [np.zeros(2)]
    offsets += [s * steps[i] * np.eye(2)[i] for i in range(2) for s in (-2, -1, 1, 2)]
    values = np.array([f(centre + one) for one in offsets])
    a, b = derivatives_of(("a", "b"), steps, np.array([1.0, 2.0]), values)
    exact = np.exp(0.4) * np.log(2.0), np.exp(0.4) / 2.0
    for one, true, step in zip((a, b), exact, steps, strict=True):
        assert abs(one.value - true) < step**4
        assert abs(one.value - true) < one.error < step**2
    assert np.isclose(a.share, exact[0] ** 2 / (exact[0] ** 2 + 4 * exact[1] ** 2), rtol=1e-3)


def test_a_response_surface_knows_what_it_does_not_explain() -> None:
    x = np.random.default_rng(1).random((200, 2))
    quadratic = 1 + 2 * x[:, 0] - 3 * x[:, 0] * x[:, 1] + 4 * x[:, 1] ** 2
    surface = response_surface(x, quadratic)
    assert surface is not None
    assert surface.explained > 1.0 - 1e-12
    at = np.array([[0.3, 0.9]])
    np.testing.assert_allclose(surface(at), 1 + 0.6 - 0.81 + 4 * 0.81, rtol=1e-10)
    noise = response_surface(x, np.random.default_rng(2).random(200))
    assert noise is not None
    assert noise.explained < 0.05
    assert response_surface(x[:6], quadratic[:6]) is None


def test_correlations_of_numbers_and_choices() -> None:
    y = np.array([1.0, 2.0, 3.0, 4.0])
    assert np.isclose(correlation([1, 2, 3, 4], y), 1.0)
    assert np.isclose(correlation(["a", "a", "b", "b"], y), np.sqrt(0.8))
    assert np.isnan(correlation([1, 2, 3, 4], np.ones(4)))


def test_the_deviation_of_a_sample_is_that_without_bias() -> None:
    one = statistics_of(np.array([4.0, 1.0, 3.0, 2.0]), [0.5])
    assert (one.mean, one.greatest, one.quantiles[0].value) == (2.5, 4.0, 2.5)
    assert np.isclose(one.deviation**2, 5 / 3)


def test_what_a_surface_explains_is_that_of_fits_without_the_point() -> None:
    generator = np.random.default_rng(4)
    x = np.linspace(-1.0, 1.0, 12)
    y = x**2 - 0.3 * x + 0.2 * generator.standard_normal(12)
    missed = [
        y[k] - np.polyval(np.polyfit(np.delete(x, k), np.delete(y, k), 2), x[k]) for k in range(12)
    ]
    surface = response_surface(x[:, None], y)
    assert surface is not None
    explained = 1.0 - np.sum(np.square(missed)) / np.sum((y - y.mean()) ** 2)
    assert np.isclose(surface.explained, explained, rtol=1e-9)
