"""Rates of small motions whose components turn by half a radian from row to row."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmb.analysis.effects.smooth_pieces import SlowAxes, SmoothPieces
from flexmb.flexbody.arrays import skew

T, SPIN = np.linspace(0.0, 1.0, 101), 50.0  # times [s], and angular velocity about x [rad/s]


def axes(motions):
    """Of motions (n, 3, d) of one vector in the axes of the body that spins."""
    turns = Rotation.from_rotvec(SPIN * T[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    Omega = np.tile(skew(np.array([SPIN, 0.0, 0.0])), (len(T), 1, 1))
    frames = SimpleNamespace(vectors=lambda: [np.arange(3)])
    equations = SimpleNamespace(Omega=Omega, turns=turns, frames=frames)
    return SlowAxes.of(SmoothPieces(T, np.zeros(0, np.int64)), equations, motions), turns, Omega


def test_what_tilts_slowly_beside_the_axes_that_turn():
    tilt = np.stack([np.sin(T), np.cos(T), T], axis=1)
    rates = np.stack([np.cos(T), -np.sin(T), np.ones_like(T)], axis=1)
    _, turns, Omega = axes(np.zeros((len(T), 3, 1)))
    back = turns.transpose(0, 2, 1)
    motions = back @ tilt[:, :, None]
    true = back @ rates[:, :, None] - Omega @ motions
    of = axes(motions)[0]
    assert len(of.turns) == 1
    assert of.rate(motions) == pytest.approx(true, abs=1e-5)
    assert of.rate(motions[:, :, 0]) == pytest.approx(true[:, :, 0], abs=1e-5)
    assert np.abs(of.pieces.rate(motions) - true).max() > 0.1
    bends = back @ -np.stack([np.sin(T), np.cos(T), 0 * T], axis=1)[:, :, None]
    second = bends - 2.0 * Omega @ true - Omega @ Omega @ motions
    assert of.rate(of.rate(motions)) == pytest.approx(second, abs=0.02)
    slow = of.slow_rates(motions[:, :, 0], 0.05)
    assert slow[0] == pytest.approx(true[:, :, 0], abs=0.01)
    assert slow[1] == pytest.approx(second[:, :, 0], abs=1.0)
    assert np.abs(of.pieces.slow_rates(motions[:, :, 0], 0.05)[1] - slow[1]).max() > 1000.0


def test_what_turns_with_the_body():
    motions = np.stack([0 * T, np.cos(T), np.sin(T)], axis=1)[:, :, None]
    of = axes(motions)[0]
    assert of.turns == []
    assert of.rate(motions)[:, 2, 0] == pytest.approx(np.cos(T), abs=1e-5)
