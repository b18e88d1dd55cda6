"""Orientations as a scene writes them, and the rotation arithmetic around them.

In: a quaternion [w, x, y, z], an axis with an angle, or a 3x3 matrix (columns: the body's axes in
global components). Out: a unit quaternion p, scalar first, w >= 0, with A(p) taking body components
to global ones. Source: Shabana, Dynamics of Multibody Systems, ch. 2 (Euler parameters).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationInfo

from flexmb.errors import Problem, SceneError
from flexmb.model.quantities import read_axis, read_number
from flexmb.model.reading import Names, Reader, fail, given, names_of, unknown_key

__all__ = [
    "Orientation",
    "quaternion_from_axis",
    "quaternion_from_matrix",
    "read_orientation",
    "rotation_matrix",
    "triad",
]

Array = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
_ORTHOGONAL = 1e-6  # a matrix typed with seven digits passes, a wrong one does not
_LAST_DIGITS = 4e-16  # what scaling to unit length leaves


def rotation_matrix(p: Any) -> Array:
    """Direction-cosine matrix A (3, 3), body to global, of a unit quaternion p = [w, x, y, z]."""
    w, x, y, z = (float(c) for c in p)
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def quaternion_from_axis(axis: Any, angle: float) -> Quaternion:
    """Unit quaternion of a rotation about a unit axis by an angle [rad]."""
    s = math.sin(angle / 2)
    x, y, z = (float(c) for c in axis)
    return _unit([math.cos(angle / 2), s * x, s * y, s * z])


def quaternion_from_matrix(A: Any) -> Quaternion:
    """Unit quaternion of a rotation matrix (Shepperd, J. Guidance and Control 1 (1978) 223)."""
    A = np.asarray(A, dtype=float)
    K = np.array(
        [
            [A[0, 0] + A[1, 1] + A[2, 2], A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]],
            [0, A[0, 0] - A[1, 1] - A[2, 2], A[0, 1] + A[1, 0], A[0, 2] + A[2, 0]],
            [0, 0, A[1, 1] - A[0, 0] - A[2, 2], A[1, 2] + A[2, 1]],
            [0, 0, 0, A[2, 2] - A[0, 0] - A[1, 1]],
        ]
    )
    K = K + np.triu(K, 1).T
    largest = int(np.argmax(np.diag(K)))
    column = K[:, largest].copy()
    column[largest] += 1.0  # 4 p_i p_k = K_ik + delta_ik
    return _unit(column)


def triad(axis: Any) -> Array:
    """Rotation matrix (3, 3) whose z axis is the unit vector: the shortest turn that takes z there.

    For directions below the xy plane the shortest turn after a half turn about x, which is exact
    near -z, where the shortest turn is not unique.
    """
    x, y, z = (float(c) for c in axis)
    below = z < 0
    if below:
        y, z = -y, -z
    c = 1 / (1 + z)
    R = np.array([[1 - c * x * x, -c * x * y, x], [-c * x * y, 1 - c * y * y, y], [-x, -y, z]])
    return np.diag([1.0, -1.0, -1.0]) @ R if below else R


def _unit(p: Any) -> Quaternion:
    w, x, y, z = (float(c) for c in p)
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if abs(length - 1.0) <= _LAST_DIGITS:  # unit already: written and read again it stays the same
        length = 1.0
    length = -length if w < 0 else length
    return (w / length + 0.0, x / length + 0.0, y / length + 0.0, z / length + 0.0)


def read_orientation(value: Any, names: Names) -> Quaternion:
    """A unit quaternion from any of the ways to say an orientation.

    Raises
    ------
    SceneError
        None of them, or numbers that are no orientation.
    """
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        return _from_axis_angle(value, names)
    if isinstance(value, list | tuple) and len(value) == 4:
        p = [read_number(item, names) for item in value]
        if not any(p):
            raise SceneError("a quaternion must not be zero")
        return _unit(p)
    if isinstance(value, list | tuple) and len(value) == 3:
        return _from_rows(value, names)
    raise SceneError(
        "an orientation is a quaternion [w, x, y, z], a table {axis, angle} or a 3x3 matrix, "
        f"given {given(value)}"
    )


def _from_axis_angle(table: Mapping[str, Any], names: Names) -> Quaternion:
    keys = ("axis", "angle")
    problems = [unknown_key(key, keys) for key in table if key not in keys]
    problems += [Problem(key, "is missing") for key in keys if key not in table]
    found: dict[str, Any] = {}
    for key, read in (("axis", read_axis), ("angle", read_number)):
        try:
            found[key] = read(table[key], names) if key in table else None
        except SceneError as error:
            problems += [Problem(key, p.what, p.allowed, p.nearest) for p in error.problems]
    if problems:
        raise SceneError.from_problems(problems)
    return quaternion_from_axis(found["axis"], found["angle"])


def _from_rows(rows: Any, names: Names) -> Quaternion:
    if not all(isinstance(row, list | tuple) and len(row) == 3 for row in rows):
        raise SceneError(f"a 3x3 matrix has three rows of three numbers, given {given(rows)}")
    A = np.array([[read_number(item, names) for item in row] for row in rows])
    with np.errstate(all="ignore"):
        error = float(np.abs(A.T @ A - np.eye(3)).max())
    if not error <= _ORTHOGONAL:
        raise SceneError(
            "the matrix is no rotation: its columns are not orthogonal unit vectors, "
            f"by {error:.2g}"
        )
    if np.linalg.det(A) < 0:
        raise SceneError("the matrix is no rotation but a reflection: its determinant is -1")
    return quaternion_from_matrix(A)


def _orientation(value: Any, info: ValidationInfo) -> Quaternion:
    try:
        return read_orientation(value, names_of(info))
    except SceneError as error:
        raise fail(*error.problems) from None


Orientation = Annotated[Quaternion, Reader(_orientation)]
