"""How many threads BLAS uses, for as long as a calculation lasts.

In: a number of threads. Out: the numbers before, set again at the end. On matrices of a few hundred
rows threads of OpenBLAS wait for each other longer than they work (on a busy machine with two cores
a solution with twelve right sides took 24 times as long as with one thread), so that all of the
solver runs on one but the elimination of large fronts. NumPy and SciPy each bring a library of
their own; where neither exports the name of its setting (MKL, Accelerate), nothing is changed.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from numpy.linalg import _umath_linalg
from scipy.linalg import _fblas

__all__ = ["blas_threads", "set_threads"]

_PREFIXES = ("scipy_openblas", "openblas")
_SUFFIXES = ("", "64_", "_64")


class _Library:
    """The two functions of one BLAS library."""

    def __init__(self, get: Callable[[], int], put: Callable[[int], None]) -> None:
        self.get, self.put = get, put


@cache
def _libraries() -> tuple[_Library, ...]:
    libraries = []
    for module in (_fblas, _umath_linalg):
        try:
            library = ctypes.CDLL(module.__file__)
        except (OSError, AttributeError):
            continue
        for name in (
            f"{prefix}_%s_num_threads{suffix}" for prefix in _PREFIXES for suffix in _SUFFIXES
        ):
            if hasattr(library, name % "get") and hasattr(library, name % "set"):
                libraries.append(
                    _Library(getattr(library, name % "get"), getattr(library, name % "set"))
                )
                break
    return tuple(libraries)


def set_threads(counts: tuple[int, ...]) -> None:
    """Threads of each library, as :func:`blas_threads` gives them."""
    for library, count in zip(_libraries(), counts, strict=True):
        library.put(count)


@contextmanager
def blas_threads(count: int = 1) -> Iterator[tuple[int, ...]]:
    """Run with ``count`` threads; gives the numbers that were and will be."""
    before = tuple(library.get() for library in _libraries())
    set_threads((count,) * len(before))
    try:
        yield before
    finally:
        set_threads(before)
