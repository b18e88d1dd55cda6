"""Where times were taken: system, cores, versions."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version

__all__ = ["machine"]


def machine() -> str:
    """One line such as ``flexmb 0.1.0, Python 3.11.7, numba 0.61.0; Linux x86_64, 2 cores``."""
    import flexmb

    programs = [f"flexmb {flexmb.__version__}", f"Python {platform.python_version()}"]
    for package in ("numba", "numpy"):
        try:
            programs.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    where = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    return f"{', '.join(programs)}; {where}"
