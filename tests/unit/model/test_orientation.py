"""Orientations: all ways to say one agree; triads are rotations."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.errors import SceneError
from flexmb.model.markers import (
    EULER_SEQUENCES,
    quaternion_from_euler,
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


def turn(letter, angle):
    """Rotation matrix about a coordinate axis, written out."""
    c, s = np.cos(angle), np.sin(angle)
    i = "xyz".index(letter)
    j, k = (i + 1) % 3, (i + 2) % 3
    R = np.eye(3)
    R[j, j], R[j, k], R[k, j], R[k, k] = c, -s, s, c
    return R


def test_all_ways_to_say_one_orientation():
    """x up along the global z, y along the diagonal of the global x and y: worked out by hand."""
    h = np.sqrt(0.5)
    wanted = [[0, h, -h], [0, h, h], [1, 0, 0]]  # x -> z, y -> (1, 1, 0), z -> (-1, 1, 0)
    for given in (
        wanted,
        {"x_along": "z", "y_towards": [1, 1, 0]},
        {"x_along": "z", "y_towards": [3, 3, 7]},
        {"y_along": [2, 2, 0], "z_towards": [-1, 1, 0]},
        {"z_along": [-1, 1, 0], "x_towards": "z"},
        {"euler": "zyz", "angles": ["135 deg", "90 deg", "180 deg"]},
    ):
        A = rotation_matrix(read_orientation(given, {}))
        np.testing.assert_allclose(A, wanted, atol=1e-15)


@pytest.mark.parametrize("sequence", EULER_SEQUENCES)
def test_euler_sequences_turn_about_body_fixed_axes(sequence):
    """Each turn is about an axis as the turns before left it: the product from the left."""
    angles = [0.4, -1.1, 2.7]
    A = np.eye(3)
    for letter, angle in zip(sequence, angles, strict=True):
        axis = A[:, "xyz".index(letter)]  # where this body axis points by now
        p = read_orientation({"axis": axis.tolist(), "angle": angle}, {})
        A = rotation_matrix(p) @ A
    found = rotation_matrix(read_orientation({"euler": sequence, "angles": angles}, {}))
    np.testing.assert_allclose(found, A, atol=1e-14)
    product = turn(sequence[0], 0.4) @ turn(sequence[1], -1.1) @ turn(sequence[2], 2.7)
    np.testing.assert_allclose(found, product, atol=1e-14)
    assert quaternion_from_euler(sequence, angles)[0] >= 0


@pytest.mark.parametrize("along", "xyz")
@pytest.mark.parametrize("towards", "xyz")
def test_two_directions(along, towards):
    if along == towards:
        return
    rng = np.random.default_rng(3)
    first, second = rng.standard_normal((2, 3))
    given = {f"{along}_along": first.tolist(), f"{towards}_towards": second.tolist()}
    A = rotation_matrix(read_orientation(given, {}))
    i, j = "xyz".index(along), "xyz".index(towards)
    np.testing.assert_allclose(A[:, i], first / np.linalg.norm(first), atol=1e-15)
    np.testing.assert_allclose(A[:, 3 - i - j] @ second, 0, atol=1e-15)  # second in their plane
    assert A[:, j] @ second > 0
    assert np.linalg.det(A) == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_quaternions_and_axes_of_any_length_are_scaled(scale):
    p = read_orientation([scale, 0, 0, scale], {})
    np.testing.assert_allclose(p, [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], rtol=1e-15)
    turned = read_orientation({"axis": [0, 0, scale], "angle": "90 deg"}, {})
    np.testing.assert_allclose(turned, p, rtol=1e-15)


def test_reading_again_what_was_read_changes_no_bit():
    rng = np.random.default_rng(7)
    for _ in range(200):
        p = read_orientation(rng.standard_normal(4).tolist(), {})
        assert read_orientation(list(p), {}) == p


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
        ({"axis": "z", "angle": "1 mm"}, r"angle: an angle \[rad\] is expected, given .1 mm."),
        ({"axis": "z", "angle": 1, "euler": "xyz"}, "given in one way, .* given .axis., .angle."),
        ({"x_along": "z", "axis": "y"}, "given in one way"),
        ({"euler": "xyx", "angles": [1, 2]}, "three angles are expected"),
        ({"euler": "xyy", "angles": [1, 2, 3]}, 'sequence of axes "xyy"; nearest: xyx.*; allowed'),
        ({"euler": "XYZ", "angles": [1, 2, 3]}, 'sequence of axes "XYZ"; nearest: xyz'),
        ({"euler": "xyz"}, "angles: is missing"),
        ({"x_along": "z"}, "one axis .along. a direction and another one .towards. one"),
        ({"x_along": "z", "x_towards": "y"}, "given .x_along., .x_towards."),
        ({"x_along": "z", "y_along": "y"}, "given .x_along., .y_along."),
        ({"x_along": "z", "y_towards": [0, 0, -2]}, "x_along and y_towards are parallel"),
        ({"x_along": "z", "y_towards": "w"}, 'y_towards: an axis is a direction, given "w"'),
        ({}, "given an empty one"),
        ({"angel": 1}, 'unknown key "angel"; nearest: angle'),
        (["30 deg", 0, 0, 1], "a plain number is expected"),
        ("z", "quaternion"),
        ([1, 2], "quaternion"),
    ],
)
def test_what_is_no_orientation_is_refused(given, words):
    with pytest.raises(SceneError, match=words):
        read_orientation(given, {})
