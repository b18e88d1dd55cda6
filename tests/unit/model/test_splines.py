"""Curves through points against those of SciPy, and what they do beyond their ends."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator, CubicSpline

from flexmb.errors import SceneError
from flexmb.model.functions.function import read_function
from flexmb.model.functions.piecewise import akima_curve, cubic_spline, linear_curve

RNG = np.random.default_rng(4)
X = np.cumsum(RNG.uniform(0.2, 1.5, 12))
Y = RNG.standard_normal(12)
CLOSED = np.append(Y[:-1], Y[0])
INSIDE = np.linspace(X[0], X[-1], 301)[:-1]
LAST_DIGITS = 1e-11  # second derivatives of some ten over intervals of 0.2


def values(curve, at):
    return np.array([curve.jet(x) for x in at])


@pytest.mark.parametrize(
    ("curve", "wanted"),
    [
        (cubic_spline(X, Y, "natural", "extrapolate"), CubicSpline(X, Y, bc_type="natural")),
        (cubic_spline(X, Y, "clamped", "extrapolate"), CubicSpline(X, Y, bc_type="clamped")),
        (cubic_spline(X, CLOSED, "periodic", "repeat"), CubicSpline(X, CLOSED, bc_type="periodic")),
        (cubic_spline(X[:3], CLOSED[[0, 1, 0]], "periodic", "repeat"),
         CubicSpline(X[:3], CLOSED[[0, 1, 0]], bc_type="periodic")),
        (cubic_spline(X[:2], Y[:2], "natural", "extrapolate"), CubicSpline(X[:2], Y[:2])),
        (akima_curve(X, Y, "hold"), Akima1DInterpolator(X, Y)),
        (akima_curve(X, np.round(Y), "hold"), Akima1DInterpolator(X, np.round(Y))),
        (akima_curve(X, 3 * X - 1, "hold"), Akima1DInterpolator(X, 3 * X - 1)),
    ],
    ids=["natural", "clamped", "periodic", "periodic, 3", "2 points", "akima", "akima, equal",
         "akima, line"],
)  # fmt: skip
def test_curves_are_those_of_scipy(curve, wanted):
    at = INSIDE[INSIDE < curve.knots[-1]]
    found = values(curve, at)
    for order in range(3):
        np.testing.assert_allclose(found[:, order], wanted(at, nu=order), atol=LAST_DIGITS)


def test_tables_are_straight_lines():
    found = values(linear_curve(X, Y, "hold"), INSIDE)
    np.testing.assert_allclose(found[:, 0], np.interp(INSIDE, X, Y), atol=1e-14)
    piece = np.searchsorted(X, INSIDE, side="right") - 1
    np.testing.assert_allclose(found[:, 1], (np.diff(Y) / np.diff(X))[piece], atol=1e-13)
    assert not found[:, 2].any()


OUTSIDE = np.array([X[0] - 7.3, X[0] - 0.01, X[-1], X[-1] + 0.01, X[-1] + 9.1])


def test_beyond_the_ends_values_are_held():
    found = values(cubic_spline(X, Y, "natural", "hold"), OUTSIDE)
    np.testing.assert_allclose(found[:, 0], [Y[0], Y[0], Y[-1], Y[-1], Y[-1]], atol=1e-12)
    assert not found[:, 1:].any()


def test_beyond_the_ends_polynomials_go_on():
    found = values(cubic_spline(X, Y, "clamped", "extrapolate"), OUTSIDE)
    wanted = CubicSpline(X, Y, bc_type="clamped")
    for order in range(3):
        values_there = wanted(OUTSIDE, nu=order)
        np.testing.assert_allclose(found[:, order], values_there, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("make", [linear_curve, akima_curve])
def test_beyond_the_ends_all_repeats(make):
    once, again = make(X, Y, "extrapolate"), make(X, Y, "repeat")
    period = X[-1] - X[0]
    for turns in (-3, 1, 1000):
        found = values(again, INSIDE + turns * period)
        # the argument loses what its size takes from its last digits
        np.testing.assert_allclose(found, values(once, INSIDE), atol=1e-9)


def test_beyond_the_ends_there_is_an_error_but_for_round_off():
    curve = akima_curve(X, Y, "error")
    for x in (X[0] - 1e-3, X[-1] + 1e-3):
        assert np.isnan(curve.jet(x)).all()
    for x in (X[0] * (1 - 1e-15), X[0], X[-1], X[-1] * (1 + 1e-15)):
        np.testing.assert_allclose(
            curve.jet(x), akima_curve(X, Y, "extrapolate").jet(x), atol=1e-12
        )


def test_evaluation_changes_nothing():
    curve = cubic_spline(X, Y, "natural", "repeat")
    data = curve.data.copy()
    first = values(curve, INSIDE)
    values(curve, INSIDE[::-1] + 100.0)
    np.testing.assert_array_equal(values(curve, INSIDE), first)
    np.testing.assert_array_equal(curve.data, data)


@pytest.mark.parametrize(
    ("fields", "place", "sentence"),
    [
        ({"points": [[0, 1], [0, 2]]}, "points[1]", "times must increase"),
        ({"points": [[0, 1], [1, 2, 3]]}, "points[1]", "a point [t, y]"),
        ({"points": [[0, "a"], [1, 2]]}, "points[0][1]", 'unknown name "a"'),
        ({"points": [[0, 1]]}, "points", "two points or more are needed, given 1"),
        ({}, "", 'give either "points" or "file"'),
        ({"points": [[0, 1], [1, 2]], "columns": [1, 2]}, "columns", "belongs to a file"),
        ({"points": [[0, 1], [1, 2], [2, 3]], "ends": "periodic"}, "ends", "0.001 m and 0.003 m"),
        ({"points": [[0, 1], [1, 2]], "beyond": "holds"}, "beyond", "unknown choice"),
    ],
)
def test_mistakes_of_points_are_told(fields, place, sentence):
    from flexmb.model.reading import ReadContext
    from flexmb.units import unit_system

    names = ReadContext({}, unit_system("mm-t-s"))
    with pytest.raises(SceneError) as caught:
        read_function({"type": "spline", **fields}, names, "m")
    (problem,) = caught.value.problems
    assert problem.where == place
    told = sentence.replace("0.001 m", "1 mm").replace("0.003 m", "3 mm")
    assert told in problem.what
