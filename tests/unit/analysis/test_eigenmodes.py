"""Modes of matrices against the frequencies that they are made of."""

from __future__ import annotations

import numpy as np

from flexmb.analysis.linear.state_eigenmodes import eigenmodes


def test_a_rigid_motion_among_modes_whose_square_is_round_off_of_either_sign():
    """Where it was positive, the inverse problem of low frequencies was tried, and often failed."""
    rates = np.array([0, 1, 2, 3, 4, 5.0])
    for seed in range(40):
        Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(6, 6)))[0]
        K = Q @ np.diag(rates**2) @ Q.T
        made = eigenmodes(np.eye(6), np.zeros((6, 6)), 0.5 * (K + K.T), np.zeros(6, bool))
        np.testing.assert_allclose(np.abs(made.values), rates, atol=1e-13)
        assert made.values[0] == 0.0


def test_a_frequency_far_below_the_round_off_of_the_others_is_none():
    K = np.diag([1e-28, 4.0, 9e6])
    made = eigenmodes(np.eye(3), np.zeros((3, 3)), K, np.zeros(3, bool))
    np.testing.assert_allclose(made.values.imag, [0, 2, 3000], rtol=1e-12)
    assert made.values[0] == 0.0


def test_a_soft_mode_beside_stiff_ones_keeps_its_digits():
    K = np.diag([1e-6, 4.0, 9e12])
    made = eigenmodes(np.eye(3), np.zeros((3, 3)), K, np.zeros(3, bool))
    np.testing.assert_allclose(made.values.imag, [1e-3, 2, 3e6], rtol=1e-12)
