"""Drawn shapes are closed, outward and of the right size."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.view.content import Triangles
from flexmb.view.shapes import box, cylinder, joined, plate, sphere, tube


def _volume(shape: Triangles) -> float:
    a, b, c = (shape.points[shape.faces[:, i]] for i in range(3))
    return float(np.einsum("ti,ti->", np.cross(a, b), c) / 6)


# A circle of 48 corners encloses 0.3 % less than the round one, a ball 0.7 % less.
@pytest.mark.parametrize(
    ("shape", "volume", "short"),
    [
        (box((1, 2, 3)), 6.0, 1e-12),
        (cylinder(0.5, 2.0, (1, 0, 0)), np.pi / 2, 0.003),
        (tube((1, 1, 1), (1, 1, 3), 0.5), np.pi / 2, 0.003),
        (sphere(0.5, (3, 2, 1)), np.pi / 6, 0.008),
        (plate([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], 0.5), 1.0, 1e-12),
        (plate([[0, 1, 0], [2, 1, 0], [2, 0, 0], [0, 0, 0]], 0.5), 1.0, 1e-12),
    ],
)
def test_volumes_are_positive_and_right(shape: Triangles, volume: float, short: float) -> None:
    assert (1 - short) * volume <= _volume(shape) <= volume * (1 + 1e-12)


def test_moving_turns_first_and_then_shifts() -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = box((2, 4, 6)).moved((10, 0, 0), quarter)
    np.testing.assert_allclose(moved.points.max(axis=0), [12, 1, 3])


def test_joined_shapes_keep_their_volumes() -> None:
    assert _volume(joined([box((1, 1, 1)), box((2, 1, 1)).moved((5, 0, 0), np.eye(3))])) == 3.0
