"""Read-only arrays of a known shape, and operations on small matrices that both halves use.

:class:`Checker` converts an array-like and the shape it must have (``None`` leaves a length free)
to a read-only float64 or int64 array. Mistakes are collected, so that all are raised at once.
:func:`is_nonzero` makes every decision on a rank, :func:`skew` gives the matrix of a cross product,
:func:`rotation_stiffness` the geometric stiffness of forces on rigid arms.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import MeshError, Problem, ReductionError

Array = NDArray[np.float64]
FloatArray = Array  # the name of this type in the finite-element half
IntArray = NDArray[np.int64]

RANK_TOLERANCE = 1e-12
"""Eigenvalues below this fraction of the largest are round-off."""


def is_nonzero(values: FloatArray, tolerance: float = RANK_TOLERANCE) -> NDArray[np.bool_]:
    """(k,) bool: eigenvalues of a semidefinite matrix, or singular values, that are not
    round-off."""
    return np.asarray(values > tolerance * values.max(initial=0.0))


def skew(s: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices with skew(s) @ u = s x u."""
    out = np.zeros((*s.shape, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., c, b] = s[..., a]
        out[..., b, c] = -s[..., a]
    return out


def rotation_stiffness(moments: FloatArray) -> FloatArray:
    """(..., 3, 3) second derivative of the work of forces f at the ends s of rigidly rotating arms.

    A rotation theta moves the end of an arm by theta x s + theta x (theta x s)/2. ``moments`` are
    the sums of s f^T.
    """
    trace = np.trace(moments, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(0.5 * (moments + np.swapaxes(moments, -1, -2)) - trace * np.eye(3))


class Checker:
    """Collects the problems of one object under its name, then raises them together."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.problems: list[Problem] = []

    def add(self, field: str, what: str) -> None:
        """Note that ``field`` is wrong, and how."""
        self.problems.append(Problem(f"{self.where}.{field}", what))

    def floats(
        self, field: str, value: Any, shape: Sequence[int | None], dtype: type = np.float64
    ) -> NDArray[Any]:
        """A read-only, finite array of the given shape; notes a problem otherwise."""
        try:
            array: NDArray[Any] = np.array(value, dtype=dtype)
        except (TypeError, ValueError):
            self.add(field, f"must be an array of numbers of shape {_text(shape)}")
            return np.zeros([length or 0 for length in shape], dtype=dtype)
        if not np.isfinite(array).all():
            self.add(field, "has entries that are not finite numbers")
        return self._shaped(field, array, shape)

    def integers(self, field: str, value: Any, shape: Sequence[int | None]) -> IntArray:
        """A read-only int64 array of the given shape; notes a problem otherwise."""
        array = np.array(value)
        if array.size and array.dtype.kind not in "iu":
            self.add(field, "must hold whole numbers")
        return self._shaped(field, array.astype(np.int64), shape)

    def raise_problems(self) -> None:
        """Raise all problems found so far, if any.

        Raises
        ------
        ReductionError
            With one line for each problem.
        """
        if self.problems:
            raise ReductionError.from_problems(self.problems)

    def _shaped(self, field: str, array: NDArray[Any], shape: Sequence[int | None]) -> NDArray[Any]:
        fits = array.ndim == len(shape) and all(
            want is None or want == have for want, have in zip(shape, array.shape, strict=True)
        )
        if not fits:
            self.add(field, f"must have shape {_text(shape)}, has {_text(array.shape)}")
            array = np.zeros([length or 0 for length in shape], dtype=array.dtype)
        array.flags.writeable = False
        return array


def _text(shape: Sequence[int | None]) -> str:
    return "(" + ", ".join("any" if length is None else str(length) for length in shape) + ")"


def unit_vector(words: object, where: str) -> FloatArray:
    """(3,) the unit vector of "x", "-y" or three numbers.

    Raises
    ------
    MeshError
        It is neither, or zero.
    """
    if isinstance(words, str) and words.lstrip("+-") in ("x", "y", "z"):
        sign = -1.0 if words.startswith("-") else 1.0
        return np.asarray(sign * np.eye(3)["xyz".index(words[-1])])
    try:
        vector = np.asarray(words, dtype=float).reshape(3)
    except (TypeError, ValueError):
        vector = np.zeros(3)
    size = np.linalg.norm(vector)
    if not (np.isfinite(size) and size > 0):
        what = f"x, y, z, -x, -y, -z or three numbers are expected, given {words!r}"
        raise MeshError.from_problems([Problem(where, what)])
    return np.asarray(vector / size)
