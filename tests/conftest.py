"""What all tests share: a cache folder of their own, apart from the user's."""

from __future__ import annotations

import functools
import os
import tempfile
from pathlib import Path
from typing import Any

import pytest

# Kernels are compiled once per set of sources and renderers probed once per machine: one folder for
# all test sessions of this user keeps them fast, away from the user's own cache.
os.environ.setdefault("FLEXMB_CACHE_DIR", str(Path(tempfile.gettempdir()) / "flexmb-test-cache"))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """The tests of a file share a process, and so do all files that share compiled kernels."""
    from xdist.scheduler.loadscope import LoadScopeScheduling

    class Shared(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return _shared(config.rootpath / nodeid.partition("::")[0])

    return Shared(config, log)


@functools.cache
def _shared(path: Path) -> str:
    """What a test file shares its compiled kernels with: the kit it is made with, or nothing."""
    text = path.read_text(encoding="utf-8")
    return next(
        (kit for kit in ("truthkit", "enginekit") if f"from {kit} import" in text), str(path)
    )


@pytest.fixture(scope="session")
def project() -> Path:
    """The folder that holds pyproject.toml, flexmb, meshes, cases and tests."""
    return Path(__file__).resolve().parents[1]
