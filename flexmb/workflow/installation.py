"""This installation: versions, cores, renderer, cache and compiled units.

In: nothing. Out: what works on this machine and what to install; one line for tables of times; on
request all units of the engine compiled ahead, once per machine and version.
"""

from __future__ import annotations

import platform
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from flexmb.errors import FlexmbError
from flexmb.folders import cache_root, is_writable
from flexmb.progress import Progress, silent

PACKAGES = {
    "numpy": "arrays",
    "scipy": "sparse matrices and eigenvalues",
    "scikit-fem": "finite elements",
    "meshio": "mesh files",
    "numba": "compiled time loop",
    "h5py": "body and result files",
    "pydantic": "scenes",
    "pyvista": "pictures",
    "vtk": "pictures",
    "matplotlib": "plots",
    "llvmlite": "compiled time loop",
    "threadpoolctl": "threads of dense algebra",
    "filelock": "one writer of a file",
    "typer": "command line",
    "rich": "command line",
    "platformdirs": "cache folder",
    "psutil": "memory and cores",
}
OPTIONAL = {"gmsh": "makes the example meshes again"}


class Installation(NamedTuple):
    """State of this installation: versions of packages, what works on this machine."""

    version: str  # of flexmb
    python: str  # version and path
    system: str  # with cores and memory
    packages: tuple[tuple[str, str | None, str], ...]  # name, version (None: missing), purpose
    optional: tuple[tuple[str, str | None, str], ...]
    parts: tuple[tuple[str, str, str], ...]  # pictures, cache and so on: state, details

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the packages that are missing."""
        return tuple(name for name, installed, _ in self.packages if installed is None)


class Warmup(NamedTuple):
    """Result of :func:`warmup`."""

    cache: Path  # folder of the compiled units
    units: int
    compiled: int  # how many of them were missing
    seconds: float
    size: int  # bytes on disk


def machine() -> str:
    """One line such as ``flexmb 0.1.0, Python 3.11.7, numba 0.61.0; Linux x86_64, 2 cores``."""
    import psutil

    programs = [f"flexmb {_flexmb_version()}", f"Python {platform.python_version()}"]
    versions = ((name, _package_version(name)) for name in ("numba", "numpy"))
    programs += [f"{name} {installed}" for name, installed in versions if installed]
    where = f"{platform.system()} {platform.machine()}, {psutil.cpu_count()} cores"
    return f"{', '.join(programs)}; {where}"


def examine_installation(progress: Progress = silent) -> Installation:
    """Try what flexmb needs: packages, rendering, the cache folder, compiling.

    Parameters
    ----------
    progress : Progress
        Called for the phases `trying to render` and `trying to compile`.
    """
    import psutil

    progress("trying to render", 0.0)
    pictures = _rendering()
    progress("trying to render", 1.0)
    progress("trying to compile", 0.0)
    compiler = _compiler()
    progress("trying to compile", 1.0)
    memory = psutil.virtual_memory()
    return Installation(
        version=_flexmb_version(),
        python=f"{platform.python_version()} ({sys.executable})",
        system=f"{platform.platform()}, {psutil.cpu_count()} cores, "
        f"{memory.total / 1e9:.1f} GB of memory, {memory.available / 1e9:.1f} GB of it free",
        packages=_versions(PACKAGES),
        optional=_versions(OPTIONAL),
        parts=(
            ("pictures", *pictures),
            ("plots", "ok", "matplotlib"),
            ("cache", *_cache()),
            ("compiled units", *compiler),
        ),
    )


def warmup(progress: Progress = silent) -> Warmup:
    """Compile all units that are missing in the cache, on all cores.

    Parameters
    ----------
    progress : Progress
        Called for the phase `compile`.

    Raises
    ------
    CompilationError
        A unit does not compile on this machine.
    """
    from flexmb.engine.compiled_calls import all_units
    from flexmb.engine.compiled_units import missing_units
    from flexmb.engine.compiler_pool import compile_units
    from flexmb.engine.unit_cache import cache_folders, unit_file

    started = time.perf_counter()
    names = [unit.name for unit in all_units()]
    missing = missing_units(all_units())
    if missing:
        compile_units(missing, progress)
        progress("compile", 1.0)
    folder = cache_folders()[0]
    files = [folder / unit_file(name) for name in names]
    size = sum(file.stat().st_size for file in files if file.is_file())
    return Warmup(folder, len(names), len(missing), time.perf_counter() - started, size)


def _flexmb_version() -> str:
    from flexmb import __version__

    return __version__


def _package_version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _versions(packages: dict[str, str]) -> tuple[tuple[str, str | None, str], ...]:
    return tuple((name, _package_version(name), purpose) for name, purpose in packages.items())


def _rendering() -> tuple[str, str]:
    from flexmb.view import vtk_renderer

    verdict = vtk_renderer.probe(fresh=True)
    if verdict.works:
        return "ok", verdict.how
    return "simple", f"{verdict.how}. Simple pictures by matplotlib instead; {verdict.advice}"


def _cache() -> tuple[str, str]:
    folder = cache_root()
    if not is_writable(folder):
        return "slow", f"{folder} cannot be written: every run compiles again; set FLEXMB_CACHE_DIR"
    size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    return "ok", f"{folder} ({size / 1e6:.1f} MB)"


def _compiler() -> tuple[str, str]:
    from flexmb.engine.compiled_calls import all_units
    from flexmb.engine.compiled_units import interpreted, missing_units
    from flexmb.engine.compiler_pool import compile_units
    from flexmb.engine.unit_cache import cache_folders

    if interpreted():
        return "off", "NUMBA_DISABLE_JIT is set: runs are about a hundred times slower"
    units = all_units()
    missing = missing_units(units)
    if missing:
        try:
            compile_units(missing[:1])
        except FlexmbError as error:
            return "BROKEN", str(error)
    ready = len(units) - max(len(missing) - 1, 0)
    return "ok", f"{ready} of {len(units)} units compiled, in {cache_folders()[0]}"
