"""How much memory there is, so that work that cannot fit is refused before it starts.

The free memory is what psutil reports as available, or what the control groups of the process leave
(Linux; psutil does not know them), whichever is less. The environment variable FLEXMB_MEMORY
("6 GB") lowers the limit.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import psutil

from flexmb.errors import Problem, ReductionError

_VARIABLE = "FLEXMB_MEMORY"
_UNITS = {"": 1.0, "KB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}


def require_memory(needed: float, what: str) -> None:
    """Refuse work that takes more memory than there is.

    Parameters
    ----------
    needed : float
        Bytes.
    what : str
        Name of the work, as subject of the sentence.

    Raises
    ------
    ReductionError
        Both figures, and what to do.
    """
    free, limit = available_memory(), _own_limit()
    least = free if limit is None else min(free, limit)
    if needed <= least:
        return
    source = f"{_VARIABLE} allows" if least == limit else "this machine has free"
    raise ReductionError(
        f"memory: {what} needs about {_text(needed)}, {source} {_text(least)}; take a coarser mesh "
        "(half the nodes of a solid need about 40 % of it), shells or beams where the body is "
        "thin, or a machine with more memory"
    )


def available_memory() -> float:
    """Bytes this process may still take: of the machine, and of its control groups."""
    limits = [float(psutil.virtual_memory().available)]
    if sys.platform == "linux":
        limits += _cgroups(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))
    return min(limits)


def _own_limit() -> float | None:
    text = os.environ.get(_VARIABLE, "").strip()
    if not text:
        return None
    match = re.fullmatch(r"([0-9.]+(?:e[0-9]+)?) *([KMGT]B|)", text, re.IGNORECASE)
    try:
        assert match is not None
        return float(match[1]) * _UNITS[match[2].upper()]
    except (AssertionError, ValueError):
        what = f'must be a size such as "6 GB", given "{text}"'
        raise ReductionError.from_problems([Problem(_VARIABLE, what)]) from None


def _cgroups(path: Path, root: Path) -> list[float]:
    """What each control group above this process leaves, version 2 and version 1.

    ``path`` lists the groups of the process, ``root`` is where they are mounted.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    limits: list[float] = []
    for line in lines:
        _, controllers, group = line.split(":", 2)
        if not controllers:
            limits += _left(root, group, "memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            names = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
            limits += _left(root / "memory", group, *names)
    return limits


def _left(root: Path, path: str, limit: str, usage: str, cache: str) -> list[float]:
    """Limit less usage of a group and of all above it; file cache counts as free."""
    here = root / path.strip("/")
    limits: list[float] = []
    for folder in (here, *here.parents):
        if not folder.is_relative_to(root):
            break
        try:
            # without a limit it says "max", which is no number
            most = float((folder / limit).read_text(encoding="utf-8"))
            used = float((folder / usage).read_text(encoding="utf-8"))
            rows = (folder / "memory.stat").read_text(encoding="utf-8").splitlines()
            cached = next((float(row.split()[1]) for row in rows if row.startswith(cache)), 0.0)
        except (OSError, ValueError):
            continue
        limits.append(most - used + cached)
    return limits


def _text(size: float) -> str:
    for unit in ("TB", "GB"):
        if size >= 0.1 * _UNITS[unit]:
            return f"{size / _UNITS[unit]:.2g} {unit}"
    return f"{size / 1e6:.2g} MB"
