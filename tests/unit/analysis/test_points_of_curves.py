"""Curves through many points that decide the number of steps are told, with a cure."""

from __future__ import annotations

import re
import tracemalloc
import warnings

import numpy as np
import pytest

import flexmb

TIMES = np.linspace(0.0, 10.0, 2001)


def notes(kind, scatter=0.0, points=None, accuracy=1e-3, **options):
    """Notes of a cart on a spring that a force pushes; the force is one through 2001 points."""
    force = np.sin(np.pi * TIMES) + scatter * np.random.default_rng(3).standard_normal(2001)
    points = points or np.column_stack([TIMES, force]).tolist()
    made = flexmb.Model("cart")
    made.add_body("cart", mass=1.0, inertia=[1, 1, 1])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_force("spring", "translational-spring-damper", joint="rail", stiffness=4.0, damping=1)
    value = {"type": kind, "points": points, **options}
    made.add_force("push", "force", at="cart", value=[value, 0, 0])
    made.add_sensor("x", "position", of="cart")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = flexmb.simulate(made, duration=10.0, accuracy=accuracy)
    told = [str(w.message) for w in caught if "forces.push" in str(w.message)]
    return result.statistics["steps"], told


@pytest.mark.parametrize("kind", ["akima", "table"])
def test_steps_that_end_at_points_of_a_smooth_curve_are_told_with_spline(kind):
    steps, [sentence] = notes(kind)
    count, whole = map(int, re.search(r"(\d+) of the (\d+) steps end at points", sentence).groups())
    assert (whole, 1900 < count < 2000) == (steps, True)
    assert 'type = "spline" has no such jumps' in sentence
    steps, told = notes("spline")
    assert told == []
    assert steps < 200


def test_scatter_of_points_that_a_spline_follows_is_told():
    steps, [sentence] = notes("spline", scatter=0.02)
    assert f"its 1999 points decide the number of steps, {steps}" in sentence
    percent = float(re.search(r"scatter by ([\d.]+) %", sentence)[1])
    assert steps < 2500  # at 1e-3 no step needs to end at a point
    expected = 0.02 * np.sqrt(1 + 1 / 1.6) / 2.1  # of a point and of the spline between others
    assert percent == pytest.approx(100 * expected, rel=0.3)


def test_points_that_scatter_less_than_the_accuracy_are_not_told():
    steps, told = notes("spline", scatter=1e-5)
    assert told == []
    assert steps < 1000


def test_the_accuracy_by_default_counts_too():
    steps, [sentence] = notes("spline", scatter=0.02, accuracy=None)
    assert f"its 1999 points decide the number of steps, {steps}" in sentence


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [0.01, 1], [0.03, -1], [0.04, 0]],
        [[0, 0], [0.01, 1], [0.02, 1], [0.021, 0], [0.04, 0]],
    ],
)
def test_corners_of_a_wave_that_is_meant_are_no_points_of_a_smooth_curve(corners):
    steps, told = notes("table", points=corners, beyond="repeat")
    assert steps > 1000
    assert told == []


@pytest.mark.seconds
def test_a_fine_curve_that_is_repeated_often_takes_no_memory_of_all_its_points():
    times = np.linspace(0.0, 1e-3, 2001)
    fast = np.column_stack([times, np.sin(2e3 * np.pi * times).round(12)]).tolist()
    tracemalloc.start()
    try:
        _, told = notes("spline", points=fast, beyond="repeat")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert told == []
    assert peak < 100e6  # 10 000 times 2000 points are 160 MB
