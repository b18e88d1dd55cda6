"""What works on this machine, and what to install for the rest."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path

import typer

from flexmb.cache import cache_root, writable
from flexmb.cli import show
from flexmb.cli.bars import Bars
from flexmb.cli.guard import MISTAKE
from flexmb.cli.versions import PACKAGES, flexmb_version, package_version
from flexmb.errors import FlexmbError

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
    show.table(("part", "state", ""), [*rows, ("compiled units", *compiler)])
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
    return "slow", f"{folder} cannot be written: every run compiles again; set FLEXMB_CACHE_DIR"


def _megabytes(folder: Path) -> float:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6


def _compiler() -> tuple[str, str]:
    from flexmb.engine.compilation import compile_units
    from flexmb.engine.entries import all_units
    from flexmb.engine.unit_cache import cache_folders
    from flexmb.engine.units import interpreted, missing_units

    if interpreted():
        return "off", "NUMBA_DISABLE_JIT is set: runs are about a hundred times slower"
    units = all_units()
    missing = missing_units(units)
    if missing:
        try:
            compile_units(missing[:1])
        except FlexmbError as error:
            return "BROKEN", str(error)
    there = len(units) - max(len(missing) - 1, 0)
    return "ok", f"{there} of {len(units)} units compiled, in {cache_folders()[0]}"
