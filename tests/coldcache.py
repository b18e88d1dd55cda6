"""An empty cache of compiled units, with which a test tells what comes before compiling."""

from __future__ import annotations

import functools

import pytest

from flexmb.engine import unit_cache, units


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
    monkeypatch.setattr(units, "_loader", functools.cache(units._Loader))
    monkeypatch.setattr(units, "_incomplete", set())
    monkeypatch.setattr(units, "compile_units", refuse)
