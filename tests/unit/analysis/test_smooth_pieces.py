"""Rates of rows that jump, and the series of Magnus from row to row."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from flexmb.analysis.effects.smooth_pieces import SmoothPieces
from flexmb.analysis.functions_of_time import rows_behind_jumps, rows_beside_brief_changes
from flexmb.engine.compile import compile_system
from flexmb.model import Model


def mathieu(t):
    return np.array([[0.0, 1.0], [-1.0 - 0.6 * np.cos(2.0 * t), 0.0]])


def matrix_over(pieces, with_series):
    A = np.array([mathieu(t) for t in pieces.t])
    mean = 0.5 * (A[1:] + A[:-1]) + with_series * pieces.series(A)
    whole = np.eye(2)
    for h, now in zip(np.diff(pieces.t), mean, strict=True):
        whole = expm(h * now) @ whole
    return whole


def test_the_series_is_of_fourth_order():
    exact = solve_ivp(
        lambda t, x: (mathieu(t) @ x.reshape(2, 2)).ravel(), (0.0, 6.0), np.eye(2).ravel(),
        rtol=1e-12, atol=1e-13,
    ).y[:, -1].reshape(2, 2)  # fmt: skip
    errors = {
        (n, series): np.abs(
            matrix_over(SmoothPieces(np.linspace(0.0, 6.0, n), np.zeros(0, int)), series) - exact
        ).max()
        for n in (61, 121) for series in (False, True)
    }  # fmt: skip
    assert errors[61, False] / errors[121, False] == pytest.approx(4.0, rel=0.1)
    assert errors[61, True] / errors[121, True] > 8.0
    assert errors[61, True] < 0.05 * errors[61, False]


def test_coefficients_that_change_at_once_have_no_series():
    t = np.linspace(0.0, 1.0, 11)
    A = np.zeros((11, 2, 2))
    A[:, 0, 1], A[:, 1, 0] = 1.0, np.where(t < 0.55, -1.0, -4e3)
    assert not SmoothPieces(t, np.zeros(0, int)).series(A)[4:6].any()
    np.testing.assert_allclose(SmoothPieces(t, np.array([6])).series(A), 0.0, atol=1e-9)


def test_what_jumps_has_the_rates_of_either_side():
    t = np.linspace(0.0, 2.0, 41)
    values = np.where(t < 0.99, t**2, 5.0 - t)[:, None]
    pieces = SmoothPieces(t, np.array([20]))
    rates = pieces.rate(values)
    np.testing.assert_allclose(rates[:20, 0], 2 * t[:20], atol=1e-9)
    np.testing.assert_allclose(rates[20:, 0], -1.0, atol=1e-9)
    jumps = pieces.jumps(values, rates)
    assert np.flatnonzero(jumps).tolist() == [20]
    assert jumps[20, 0] == pytest.approx(4.0 - 0.95**2 - 0.5 * 0.05 * (1.9 - 1.0))
    part = pieces.part(slice(10, 30))
    assert part.begins.tolist() == [10]
    np.testing.assert_allclose(part.rate(values[10:30])[:, 0], rates[10:30, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("motor", "rows"),
    [
        ({"type": "step", "t0": 0.0, "t1": 0.5, "y1": 1.0}, [1, 5]),
        ({"type": "step", "t0": 0.25, "t1": 0.5, "y1": 1.0}, [3, 5]),
        ({"type": "step5", "t0": 0.25, "t1": 0.5, "y1": 1.0}, []),
        ("0.3*sin(t)", []),
    ],
)
def test_rows_behind_jumps_of_the_acceleration_of_a_driver(motor, rows):
    model = Model("arm")
    model.add_body("arm", mass=1.0, inertia=[1.0] * 3)
    model.add_joint("hub", "revolute", between=["ground", "arm"], axis="z")
    model.add_driver("motor", joint="hub", angle=motor)
    model.set_dynamics(duration=1.0, outputs=10)
    assert rows_behind_jumps(compile_system(model), np.linspace(0.0, 1.0, 11)) == rows


def test_no_row_stands_within_a_brief_change_of_a_load():
    """Row 216 of 1295 was within 0.1 ms: 41 % of a reaction were told where 13 % vibrate."""
    model = Model("drop")
    model.add_body("load", mass=1.0, inertia=[0.1] * 3)
    drop = {"type": "table", "points": [[0, 5e3], [0.1, 5e3], [0.1001, 0], [1, 0]]}
    model.add_force("drop", "force", at="load", value=[0, drop, 0])
    model.add_sensor("place", "position", of="load")
    model.set_dynamics(duration=0.6, outputs=240)
    compiled = compile_system(model)
    intervals = [rows_beside_brief_changes(compiled, 0.6, n, 20_000) for n in (1290, 1295, 10_000)]
    assert intervals == [1290, 1296, 10_000]  # the last resolve it
    assert rows_beside_brief_changes(compiled, 0.6, 1295, 1295) == 1295
