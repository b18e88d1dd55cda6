"""What all tests share: a cache folder of their own, one thread of linear algebra a process."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import pytest

# Units are compiled once per set of sources and renderers probed once per machine: one folder for
# all test sessions of this user keeps them fast, away from the user's own cache.
os.environ.setdefault("FLEXMB_CACHE_DIR", str(Path(tempfile.gettempdir()) / "flexmb-test-cache"))

# The tests run in as many processes as there are cores; more threads of each would wait for each
# other. Before NumPy is loaded.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")


# Byte code is kept, whatever the environment says: without it each of the many programs that the
# tests start compiles the package anew, and each session all tests.
sys.dont_write_bytecode = False


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes seconds is slow; what is slow by its parameters takes longer than that."""
    for item in items:
        if item.get_closest_marker("slow"):
            item.own_markers[:] = [mark for mark in item.own_markers if mark.name != "seconds"]
        elif item.get_closest_marker("seconds"):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def project() -> Path:
    """The folder that holds pyproject.toml, flexmb, meshes, cases and tests."""
    return Path(__file__).resolve().parents[1]
