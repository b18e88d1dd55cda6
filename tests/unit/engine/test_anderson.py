"""Anderson's acceleration beside the solution of linear equations."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.engine.algebra.anderson import accelerate, new_iterates


@pytest.mark.parametrize("gains", [(0.5,), (-2.2, -2.2, -0.5), (-10.0, 3.0, 0.9, -0.6, 0.1)])
def test_a_linear_iteration_ends_after_as_many_steps_as_it_has_gains(gains):
    """x ← G x + b, whose plain iteration grows with each gain beyond one."""
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.normal(size=(len(gains),) * 2))[0]
    G, b = axes @ np.diag(gains) @ axes.T, rng.normal(size=len(gains))
    true, iterates = np.linalg.solve(np.eye(len(b)) - G, b), new_iterates(len(b))
    x = np.zeros(len(b))
    for _ in range(len(set(gains)) + 1):
        iterates.now[:], iterates.step[:] = x, G @ x + b - x
        accelerate(iterates, True)
        x = x + iterates.step
    np.testing.assert_allclose(x, true, rtol=1e-7, atol=1e-7 * np.abs(true).max())


def test_it_goes_on_where_only_the_last_iterates_count():
    """Twenty gains between −3 and 0.9 and a depth of eight."""
    gains, iterates = np.linspace(-3.0, 0.9, 20), new_iterates(20)
    x, b = np.zeros(20), np.ones(20)
    for n in range(200):
        iterates.now[:], iterates.step[:] = x, gains * x + b - x
        if np.abs(iterates.step).max() < 1e-9:
            break
        accelerate(iterates, n > 0)
        x = x + iterates.step
    np.testing.assert_allclose(x, b / (1.0 - gains), rtol=1e-8)


def test_without_growth_the_step_is_the_plain_one():
    iterates = new_iterates(2)
    for n in range(3):
        iterates.now[:], iterates.step[:] = [n, 0.0], [1.0, 0.5**n]
        accelerate(iterates, False)
        np.testing.assert_array_equal(iterates.step, [1.0, 0.5**n])
