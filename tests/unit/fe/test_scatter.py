"""Summing element matrices: against a full matrix, left-out numbers, symmetry to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.fe.assembly import numbering
from flexmb.fe.assembly.numbering import Accumulator

RNG = np.random.default_rng(0)


def scatter(elements, numbers, n):
    """Sum element matrices (ne, d, d) at their global numbers (ne, d)."""
    total = numbering.Accumulator(n)
    total.add(elements, numbers)
    return total.matrix()


def full_sum(batches, n):
    total = np.zeros((n, n))
    for elements, numbers in batches:
        for A, at in zip(elements, numbers, strict=True):
            there = at >= 0
            total[np.ix_(at[there], at[there])] += A[np.ix_(there, there)]
    return total


def batch(count, d, numbers):
    return RNG.normal(size=(count, d, d)), numbers


def threes(count, nodes, k):
    """Numbers of k different nodes with three degrees of freedom each, some nodes left out."""
    chosen = np.array([RNG.choice(nodes, k, replace=False) for _ in range(count)])
    numbers = 3 * chosen[..., None] + np.arange(3)
    numbers[RNG.random((count, k)) < 0.2] = -1
    return numbers.reshape(count, 3 * k)


def singles(count, n, d):
    numbers = np.array([RNG.choice(n, d, replace=False) for _ in range(count)])
    numbers[RNG.random((count, d)) < 0.2] = -1
    return numbers


@pytest.mark.parametrize("batches_of", [3, 10**6], ids=["many small sums", "one sum"])
@pytest.mark.parametrize("n", [30, 31], ids=["n in threes", "n not in threes"])
def test_sum_is_that_of_a_full_matrix(monkeypatch, batches_of, n):
    monkeypatch.setattr(numbering, "_BATCH", batches_of * 81)
    batches = [
        batch(20, 9, threes(20, 10, 3)),
        batch(13, 4, singles(13, n, 4)),
        batch(7, 6, threes(7, 10, 2)),
        batch(5, 3, singles(5, n, 3)),  # three at a time, but not of one node
        batch(1, 3, np.full((1, 3), -1)),
    ]
    total = Accumulator(n)
    for elements, numbers in batches:
        total.add(elements, numbers)
    found = total.matrix()
    np.testing.assert_allclose(found.toarray(), full_sum(batches, n), atol=1e-13)
    assert found.has_canonical_format
    assert (total.matrix() != found).nnz == 0  # asking does not change the sum


def test_nothing_added_is_zero():
    total = Accumulator(5)
    total.add(np.zeros((0, 4, 4)), np.zeros((0, 4), dtype=int))
    assert total.matrix().shape == (5, 5)
    assert total.matrix().nnz == 0


def test_sum_of_symmetric_matrices_is_symmetric_to_the_last_bit():
    A = RNG.normal(size=(400, 9, 9)) * 10.0 ** RNG.uniform(-8, 8, (400, 1, 1))
    for numbers in (threes(400, 8, 3), singles(400, 24, 9)):
        total = Accumulator(24)
        total.add(A + A.transpose(0, 2, 1), numbers)
        found = total.matrix().toarray()
        assert (found == found.T).all()
        assert np.abs(found).max() > 0
