"""Orientations: all ways to say one agree; triads are rotations."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.errors import SceneError
from flexmb.model.orientation import (
    quaternion_from_matrix,
    read_orientation,
    rotation_matrix,
    triad,
)


def test_three_ways_to_say_a_quarter_turn_about_z():
    wanted = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    for given in ({"axis": "z", "angle": "90 deg"}, [1, 0, 0, 1], wanted, np.array(wanted)):
        A = rotation_matrix(read_orientation(given, {}))
        np.testing.assert_allclose(A, wanted, atol=1e-15)


def test_matrix_and_quaternion_are_inverse_also_at_half_turns():
    rng = np.random.default_rng(1)
    samples = [*rng.normal(size=(50, 4)), *np.eye(4)]
    for given in samples:
        p = np.array(read_orientation(list(given), {}))
        A = rotation_matrix(p)
        np.testing.assert_allclose(A.T @ A, np.eye(3), atol=1e-14)
        found = np.array(quaternion_from_matrix(A))
        assert min(np.abs(found - p).max(), np.abs(found + p).max()) < 1e-14


def test_a_triad_has_the_axis_as_z():
    rng = np.random.default_rng(2)
    axes = [
        *rng.normal(size=(50, 3)),
        [0, 0, 1],
        [0, 0, -1],
        [1e-9, 0, -1],
        [1e-5, 1e-5, -1],
        [1, 0, 0],
    ]
    for given in axes:
        axis = np.asarray(given, dtype=float) / np.linalg.norm(given)
        R = triad(axis)
        np.testing.assert_allclose(R[:, 2], axis, atol=1e-15)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) > 0
        if axis[2] > 0:  # the shortest turn leaves the common normal where it is
            normal = np.array([-axis[1], axis[0], 0])
            np.testing.assert_allclose(R @ normal, normal, atol=1e-15)
    np.testing.assert_array_equal(triad([0, 0, 1]), np.eye(3))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([0, 0, 0, 0], "must not be zero"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 2]], "not orthogonal unit vectors"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], "reflection"),
        ({"axis": [0, 0, 0], "angle": 1}, "length zero"),
        ({"axis": "z"}, "angle: is missing"),
        ({"axis": "z", "angel": 1}, "nearest: angle"),
        ("z", "quaternion"),
        ([1, 2], "quaternion"),
    ],
)
def test_what_is_no_orientation_is_refused(given, words):
    with pytest.raises(SceneError, match=words):
        read_orientation(given, {})
