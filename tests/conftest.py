"""What all tests share: a cache folder of their own, apart from the user's."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

# Kernels are compiled once per set of sources and renderers probed once per machine: one folder for
# all test sessions of this user keeps them fast, away from the user's own cache.
os.environ.setdefault("FLEXMB_CACHE_DIR", str(Path(tempfile.gettempdir()) / "flexmb-test-cache"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The tests of a file share a process, and all files that share compiled kernels do."""
    for item in items:
        homes = {getattr(value, "__module__", "") for value in vars(item.module).values()}
        shared = [kit for kit in ("truthkit", "enginekit") if kit in homes]
        item.add_marker(pytest.mark.xdist_group(shared[0] if shared else str(item.path)))


@pytest.fixture(scope="session")
def project() -> Path:
    """The folder that holds pyproject.toml, flexmb, meshes, cases and tests."""
    return Path(__file__).resolve().parents[1]
