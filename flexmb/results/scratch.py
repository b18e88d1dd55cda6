"""Folders for results that nobody asked to keep: gone with the last result that is in them.

In: nothing. Out: a folder, removed when no `Result` of it is left in memory, at the latest when
Python ends. `Result.save` keeps what is worth keeping.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from pathlib import Path

__all__ = ["Scratch", "scratch_of"]

_living: weakref.WeakValueDictionary[Path, Scratch] = weakref.WeakValueDictionary()
_until_the_end: list[Scratch] = []


class Scratch:
    """A new temporary folder that lives as long as this object."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="flexmb-")).resolve()
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)
        _living[self.path] = self

    def keep_until_the_end(self) -> None:
        """Let it live until Python ends, for one who was told where it is."""
        _until_the_end.append(self)


def scratch_of(folder: Path) -> Scratch | None:
    """The temporary folder at that place, to hold on to; None for other folders."""
    return _living.get(folder.resolve())
