"""Object files of units: written whole or not at all, checked when they are read.

A file holds a line of JSON (checksum, names of the units that it calls), then the machine code.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

__all__ = ["read_object", "write_object"]

_FORMAT = "flexmb unit 1"


def write_object(path: Path, code: bytes, called: Sequence[str]) -> None:
    """Write the machine code of a unit and the names of the units that it calls.

    Raises
    ------
    OSError
        The folder is gone, read-only or full.
    """
    head = {"format": _FORMAT, "sha256": hashlib.sha256(code).hexdigest(), "calls": list(called)}
    handle, name = tempfile.mkstemp(prefix=path.stem, suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(json.dumps(head).encode() + b"\n" + code)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise


def read_object(path: Path) -> tuple[bytes, tuple[str, ...]] | None:
    """Machine code and names of the units that it calls; None if there is no such file or it is damaged."""
    try:
        line, _, code = path.read_bytes().partition(b"\n")
        head = json.loads(line)
        whole = head["format"] == _FORMAT and head["sha256"] == hashlib.sha256(code).hexdigest()
        return (code, tuple(map(str, head["calls"]))) if whole else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
