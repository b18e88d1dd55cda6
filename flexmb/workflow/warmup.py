"""Compiling ahead what runs would compile at their start: all units, once a machine and version."""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

from flexmb.progress import Progress, silent

__all__ = ["Warmed", "warmup"]


class Warmed(NamedTuple):
    """What a warm-up did.

    Attributes
    ----------
    cache : Path
        Folder of the compiled units.
    units, compiled : int
        How many there are, and how many of them were missing.
    seconds : float
        How long it took.
    size : int
        Bytes on disk.
    """

    cache: Path
    units: int
    compiled: int
    seconds: float
    size: int


def warmup(progress: Progress = silent) -> Warmed:
    """Compile all units that are missing in the cache, on all cores.

    Parameters
    ----------
    progress : Progress
        Told the phase `compile`.

    Raises
    ------
    CompilationError
        A unit does not compile on this machine.
    """
    from flexmb.engine.compilation import compile_units
    from flexmb.engine.entries import all_units
    from flexmb.engine.unit_cache import cache_folders, unit_file
    from flexmb.engine.units import missing_units

    started = time.perf_counter()
    names = [unit.name for unit in all_units()]
    missing = missing_units(all_units())
    if missing:
        compile_units(missing, progress)
        progress("compile", 1.0)
    folder = cache_folders()[0]
    files = [folder / unit_file(name) for name in names]
    size = sum(file.stat().st_size for file in files if file.is_file())
    return Warmed(folder, len(names), len(missing), time.perf_counter() - started, size)
