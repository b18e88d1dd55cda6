"""Empty caches of compiled units, of one test alone."""

from __future__ import annotations

import functools

import pytest

from flexmb.engine import compiled_units, unit_cache
from flexmb.engine.algebra import ldl
from flexmb.engine.bodies import motion
from flexmb.engine.compiled_units import prepare_units

SOLVE, MOVE = ldl.solve.name, motion.move.name


class WouldCompile(Exception):
    """Units are missing, and something needs them compiled."""


@pytest.fixture
def cold_cache(monkeypatch, tmp_path):
    """No unit is loaded or in the cache, and to compile one raises `WouldCompile`."""

    def refuse(names, progress):
        raise WouldCompile(*names)

    folder = tmp_path / "cache"
    folder.mkdir()
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    monkeypatch.setattr(unit_cache, "_shared_folders", lambda: (folder,))
    monkeypatch.setattr(unit_cache, "_full", [])
    monkeypatch.setattr(compiled_units, "_loader", functools.cache(compiled_units._Loader))
    monkeypatch.setattr(compiled_units, "_incomplete", set())
    monkeypatch.setattr(compiled_units, "compile_units", refuse)


@pytest.fixture(scope="session", name="solve_file")
def stored_unit():
    """Name and bytes of one stored unit, SOLVE, which calls no other, from the cache of all."""
    prepare_units([ldl.solve])
    name = unit_cache.unit_file(SOLVE)
    folder = next(f for f in unit_cache.cache_folders() if (f / name).is_file())
    return name, (folder / name).read_bytes()


@pytest.fixture(name="cache")
def empty_cache(tmp_path, monkeypatch):
    """An empty cache of this test alone."""
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(unit_cache, "_full", [])
    unit_cache._shared_folders.cache_clear()
    yield tmp_path / "cache"
    unit_cache._shared_folders.cache_clear()
