"""Processes of this machine that do runs at the same time, each on one core."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def process_pool(count: int) -> ProcessPoolExecutor:
    """Processes that begin empty, on every operating system alike."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(count, mp_context=context, initializer=_prepare_process)


def _prepare_process() -> None:
    """Ctrl-C is handled by the parent, and one run uses one core."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)
    for name in _THREADS:  # for libraries that are loaded later
        os.environ.setdefault(name, "1")
