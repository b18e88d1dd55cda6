"""How many of the constraint equations are independent at the first state.

As many as velocity coordinates: the constraints alone fix the motion. Fewer than equations: some
repeat others, and reactions are not unique.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np
import scipy.linalg  # noqa: F401  its threads are found with those of NumPy
from threadpoolctl import ThreadpoolController

from flexmb.analysis.mobility.rows import dense_jacobian
from flexmb.engine.compile import Compiled
from flexmb.engine.state import Work

__all__ = ["LARGEST", "constraint_rank", "n_free", "one_blas_thread"]

LARGEST = 600
"""Coordinates up to which a dense decomposition is affordable; larger models are taken as free,
which only costs digits of the reported reactions."""

_RANK = 1e-8  # relative to the largest singular value; round-off leaves 1e-13


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Dense linear algebra by one thread meanwhile; also a decorator.

    With up to `LARGEST` coordinates two threads take no less time, and where other processes run
    they wait for each other: a chain of 100 bars takes 0.4 s with one thread, 1 to 4 s with two.
    """
    with _pools().limit(limits=1, user_api="blas"):
        yield


@cache
def _pools() -> ThreadpoolController:
    # NumPy and SciPy have loaded theirs; looking for them takes longer than a small decomposition
    return ThreadpoolController()


def n_free(compiled: Compiled) -> int:
    """Velocity coordinates that may move: all, or those in the plane."""
    return int(np.sum(compiled.system.kkt.column >= 0))


@one_blas_thread()
def constraint_rank(compiled: Compiled, work: Work) -> int | None:
    """Rank of Cq at the first state; None for a model too large for a dense decomposition."""
    nc, nv = compiled.layout.nc, n_free(compiled)
    if nv > LARGEST:
        return None
    if nc == 0:
        return 0
    Cq = dense_jacobian(compiled, work)[:, compiled.system.kkt.column >= 0]
    values = np.linalg.svd(Cq, compute_uv=False)
    return int(np.sum(values > _RANK * values[0]))
