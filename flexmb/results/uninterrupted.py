"""Writing that Ctrl-C does not tear: the interruption waits until a block of code is done.

HDF5 calls back into Python for every write; an exception from there would leave the file behind
half written, or take the process down.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["uninterrupted"]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold an interruption back until the end of the ``with`` block, then let it happen.

    Only the main thread is ever interrupted, so in others there is nothing to do.
    """
    main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT) if main else None
    if before is None:  # another thread, or a handler that Python cannot put back
        yield
        return
    waiting = []
    signal.signal(signal.SIGINT, lambda *_: waiting.append(True))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if waiting:
            signal.raise_signal(signal.SIGINT)
