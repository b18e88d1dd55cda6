"""What works on this machine, and what to install for the rest."""

from __future__ import annotations

import os
import platform
import sys
import time
from pathlib import Path

import typer

from flexmb.cache import cache_root, writable
from flexmb.cli import show
from flexmb.cli.bars import Bars
from flexmb.cli.guard import MISTAKE
from flexmb.cli.versions import PACKAGES, flexmb_version, package_version

__all__ = ["examine"]

_OPTIONAL = {"gmsh": "makes the example meshes anew"}


def examine() -> None:
    """Show versions, rendering, cache folder and compiler; exit code 2 if something is missing."""
    show.heading(f"flexmb {flexmb_version()}")
    show.line(f"Python {platform.python_version()} ({sys.executable})")
    show.line(f"{platform.platform()}, {os.cpu_count()} cores")
    missing = _packages()
    with Bars() as progress:
        progress("trying to render", 0.0)
        rendering = _rendering()
        progress("trying to render", 1.0)
        progress("trying to compile", 0.0)
        compiler = _compiler()
        progress("trying to compile", 1.0)
    rows = [("pictures", *rendering), ("plots", "ok", "matplotlib"), ("cache", *_cache())]
    show.table(("part", "state", ""), [*rows, ("compiled kernels", *compiler)])
    if missing:
        show.line(f"missing: python -m pip install {' '.join(missing)}")
        raise typer.Exit(MISTAKE)


def _packages() -> list[str]:
    """Show the versions; the names of the packages that are missing."""
    rows, missing = [], []
    for name, purpose in PACKAGES.items():
        version = package_version(name)
        if version is None:
            missing.append(name)
        rows.append((name, version or "MISSING", purpose))
    for name, purpose in _OPTIONAL.items():
        rows.append((name, package_version(name) or "not installed (optional)", purpose))
    show.table(("package", "version", "for"), rows)
    return missing


def _rendering() -> tuple[str, str]:
    from flexmb.view import backend

    verdict = backend.probe(fresh=True)
    if verdict.works:
        return "ok", verdict.how
    return "simple", f"{verdict.how}. Simple pictures by matplotlib instead; {verdict.advice}"


def _cache() -> tuple[str, str]:
    folder = cache_root()
    if writable(folder):
        return "ok", f"{folder} ({_megabytes(folder):.1f} MB)"
    return "slow", f"{folder} cannot be written: every run compiles anew; set FLEXMB_CACHE_DIR"


def _megabytes(folder: Path) -> float:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6


def _compiler() -> tuple[str, str]:
    from flexmb.engine import jit

    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return "off", "NUMBA_DISABLE_JIT is set: runs are about a hundred times slower"
    started = time.perf_counter()
    compiled = jit.numba.njit(_twice)  # type: ignore[attr-defined]  # not cached: to compile now
    works = compiled(21) == 42
    seconds = time.perf_counter() - started
    if not works:
        return "BROKEN", "a trial kernel gives a wrong result; reinstall numba"
    return "ok", f"trial in {seconds:.1f} s; kernels kept in {jit.CACHE_DIR}; one core for each run"


def _twice(x: int) -> int:
    return 2 * x
