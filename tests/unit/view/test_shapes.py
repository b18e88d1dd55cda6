"""Drawn shapes are closed, outward and of the right size."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.view.shapes import (
    Triangles,
    arrow,
    box,
    cylinder,
    extrusion,
    frame_of,
    joined,
    rack,
    ring,
    sphere,
    toothed_wheel,
    torus,
    tube,
)


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
        (extrusion([[0, 0], [2, 0], [2, 1], [0, 1]], 0.5), 1.0, 1e-12),
        (extrusion([[0, 1], [2, 1], [2, 0], [0, 0]], 0.5), 1.0, 1e-12),
        (extrusion([[0, 0], [2, 0], [2, 2], [1, 2], [1, 1], [0, 1]], 2.0), 6.0, 1e-12),  # an L
        (ring(0.5, 0.4, 1.0), 0.09 * np.pi, 0.003),
        (frame_of(1.0, 0.6, 2.0), 2 * (1 - 0.36), 1e-12),
        (torus(1.0, 0.2), 2 * np.pi**2 * 0.01, 0.08),
        (tube((0, 0, 0), (0, 0, 3.0), 1.0, 0.0), np.pi, 0.003),  # a cone
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


def test_the_teeth_of_a_wheel_lie_about_its_pitch_circle_and_fit_those_of_a_rack() -> None:
    radius, teeth = 2.0, 24
    module = 2 * radius / teeth
    r = np.linalg.norm(toothed_wheel(radius, teeth, 0.3).points[:, :2], axis=1)
    assert [r.max(), r.min()] == pytest.approx([radius + module, radius - 1.2 * module])
    inner = np.linalg.norm(toothed_wheel(radius, teeth, 0.3, internal=True).points[:, :2], axis=1)
    assert inner.min() == pytest.approx(radius - module)
    bar = rack(9, module, 0.3, 4 * module).points
    assert np.ptp(bar[:, 0]) == pytest.approx(9 * np.pi * module)  # a circular pitch each
    assert bar[:, 1].max() == pytest.approx(module)


def test_an_arrow_has_its_length_along_z() -> None:
    points = arrow(3.0, 0.05).points
    assert [points[:, 2].min(), points[:, 2].max()] == pytest.approx([0.0, 3.0])
