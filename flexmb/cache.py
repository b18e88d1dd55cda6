"""Where flexmb keeps what it can make again: compiled kernels, the verdict on the renderer.

In: the environment. Out: one folder, `FLEXMB_CACHE_DIR` where that is set, else the user's cache
folder of this operating system. Nothing in it is needed: deleting it costs time only.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

__all__ = ["cache_root", "writable"]


def cache_root() -> Path:
    """Folder of all flexmb caches; it may not exist yet."""
    given = os.environ.get("FLEXMB_CACHE_DIR")
    if given:
        return Path(given)
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("flexmb", appauthor=False))


def writable(folder: Path) -> bool:
    """Whether files can be made in `folder`, which is created if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
