"""The one decorator of all compiled code, and the cache folder behind it.

Numba keys its disk cache on the file of the *called* function only: after an edit in one file, a
cached caller in another file goes on running the old code. So the cache folder carries a hash of
every source file of the engine: any edit opens a fresh folder, and a stale one is never read.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import time
from pathlib import Path

import numba
from platformdirs import user_cache_dir

_ENGINE = Path(__file__).parent
_UNUSED_DAYS = 30.0

# `fastmath=True` would let the compiler assume that no NaN exists and make isfinite(nan) true;
# these four flags keep NaN honest and still allow vectorised sums.
_FASTMATH = {"contract", "reassoc", "arcp", "nsz"}


def source_hash(folder: Path = _ENGINE) -> str:
    """Hash of all Python sources below `folder`, names and contents (16 hex digits)."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_root() -> Path:
    """Folder of all flexmb caches: `FLEXMB_CACHE_DIR`, or the user's cache folder."""
    given = os.environ.get("FLEXMB_CACHE_DIR")
    return Path(given) if given else Path(user_cache_dir("flexmb"))


def _usable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _forget_unused(root: Path, keep: Path) -> None:
    limit = time.time() - _UNUSED_DAYS * 86400.0
    for folder in root.iterdir():
        if folder != keep and folder.is_dir() and folder.stat().st_mtime < limit:
            shutil.rmtree(folder, ignore_errors=True)


def _open_cache() -> Path:
    folder = cache_root() / "kernels" / source_hash()
    if not _usable(folder):
        return Path(tempfile.mkdtemp(prefix="flexmb-kernels-"))
    os.utime(folder)
    _forget_unused(folder.parent, keep=folder)
    return folder


CACHE_DIR = _open_cache()
numba.config.CACHE_DIR = str(CACHE_DIR)

_OPTIONS = {"cache": True, "fastmath": _FASTMATH, "error_model": "numpy", "nogil": True, "_nrt": False}

entry = numba.njit(**_OPTIONS)
kernel = numba.njit(**_OPTIONS, no_cpython_wrapper=True, no_cfunc_wrapper=True)
