"""Steps of equations of vibrations beside the exponential of the whole matrix and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from flexmb.analysis.effects import modal_equations
from flexmb.analysis.effects.modal_equations import ExponentialSteps

T = np.array([0.0, 0.02, 0.03, 0.05])
OMEGA = np.array([0.3, 4.0, 50.0, 900.0, 7000.0])  # up to 140 rad in a step


def coefficients(damping, spin=0.0, seed=1):
    """A (3, 10, 10) of ẋ = A x, x = (η, η̇/ω), for coupled vibrations; those from the third on have
    the plain rate of their positions."""
    random, d = np.random.default_rng(seed), len(OMEGA)
    A = np.zeros((3, 2 * d, 2 * d))
    for part in A:
        near = 0.03 * random.normal(size=(d, d))
        K = np.outer(OMEGA, OMEGA) * (np.eye(d) + near + near.T)
        skew = spin * random.normal(size=(d, d))
        D = np.diag(2.0 * damping * OMEGA) + skew - skew.T
        part[:d, d:] = np.diag(OMEGA)
        part[:2, :2] = 0.01 * random.normal(size=(2, 2))
        part[d:, :d], part[d:, d:] = -K / OMEGA[:, None], -D * OMEGA / OMEGA[:, None]
    return A


def whole(A, loads, h, x):
    """The same step by the exponential of a matrix with the loads."""
    n = len(A)
    step = np.zeros((n + 2, n + 2))
    step[:n, :n] = h * A
    step[n // 2 : n, n:] = h * loads.T
    step[n + 1, n] = 1.0
    return expm(step) @ x


def steps_of(A, loads):
    return ExponentialSteps(T, A, loads, OMEGA, np.arange(len(OMEGA)) > 1)


def counted(monkeypatch):
    """The steps that the exponential of the whole matrix makes."""
    made, before = [], ExponentialSteps._whole

    def count(self, k, x):
        made.append(k)
        return before(self, k, x)

    monkeypatch.setattr(ExponentialSteps, "_whole", count)
    return made


@pytest.mark.parametrize(
    ("damping", "spin", "push", "series"),
    [
        (0.0, 0.0, 1.0, True),
        (0.001, 0.0, 1e6, True),
        (0.0, 30.0, 1e-9, True),
        (1.5, 0.0, 1.0, False),  # overdamped: terms of a series would be far larger than the sum
    ],
)
def test_a_step_is_that_of_the_exponential_of_the_matrix(damping, spin, push, series, monkeypatch):
    A, random = coefficients(damping, spin), np.random.default_rng(2)
    loads = push * random.normal(size=(3, 2, len(OMEGA)))
    x = np.concatenate([random.normal(size=2 * len(OMEGA)), [1.0, 0.0]])
    steps, made = steps_of(A, loads), counted(monkeypatch)
    size = np.append(np.tile(np.maximum(OMEGA * 0.02, 1.0), 2), [1.0, 1.0])
    for k, h in enumerate(np.diff(T)):
        exact = whole(A[k], loads[k], h, x)
        error = np.abs((steps.take(k, x) - exact) * size).max()
        assert error < 1e-9 * np.abs(exact * size).max()
    assert (made == []) is series


def test_frequencies_above_those_given_widen_the_series():
    """A stiffer row than the mean: the radius of its frequencies is found by the terms' growth."""
    A = coefficients(0.0)
    A[:, len(OMEGA) :, : len(OMEGA)] *= 2.0  # 1.41 times the frequencies
    loads, x = np.zeros((3, 2, len(OMEGA))), np.append(np.ones(2 * len(OMEGA)), [1.0, 0.0])
    exact = whole(A[0], loads[0], 0.02, x)
    steps = steps_of(A, loads)
    assert steps.take(0, x) == pytest.approx(exact, rel=0.0, abs=1e-9 * np.abs(exact).max())
    assert steps._wide > 0


def test_a_vibration_under_a_load_that_grows_is_that_of_the_closed_form():
    """q̈ + ω² q = a + b t from rest: q = (a + b t − a cos ωt − b/ω sin ωt)/ω²."""
    w, h, a, b = 2000.0, 0.05, 3.0, 40.0
    A = np.array([[[0.0, w], [-w, 0.0]]])
    loads = np.array([[[a], [b * h]]]) / w
    steps = ExponentialSteps(np.array([0.0, h]), A, loads, np.array([w]), np.array([True]))
    q, rate = steps.take(0, np.array([0.0, 0.0, 1.0, 0.0]))[:2]
    c, s = np.cos(w * h), np.sin(w * h)
    assert q == pytest.approx((a + b * h - a * c - b / w * s) / w**2, rel=1e-11)
    assert rate == pytest.approx((b + a * w * s - b * c) / w**3, rel=1e-10)


def test_a_phase_beyond_the_series_takes_the_whole_matrix(monkeypatch):
    made = counted(monkeypatch)
    omega = np.array([2.0 * modal_equations._MOST_RADIANS])
    A = np.array([[[0.0, omega[0]], [-omega[0], 0.0]]])
    steps = ExponentialSteps(
        np.array([0.0, 1.0]), A, np.zeros((1, 2, 1)), omega, np.array([True])
    )  # fmt: skip
    q = steps.take(0, np.array([1.0, 0.0, 1.0, 0.0]))[0]
    assert made == [0] and q == pytest.approx(np.cos(omega[0]), abs=1e-9)
