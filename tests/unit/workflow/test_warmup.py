"""Compiling ahead: all units, once a machine, so that no scene compiles anything afterwards."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.engine import compiled_calls, unit_cache
from flexmb.engine.bodies import motion, wrench
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import all_units, integration_units
from flexmb.engine.compiled_units import missing_units
from flexmb.engine.jit import CompiledUnit
from flexmb.engine.method_selection import make_integrator
from flexmb.model import load_scene
from flexmb.model.scenes.dynamics import METHODS, DynamicsSpec
from flexmb.workflow import flexible_bodies, installation, listings

FEW = (motion.move, wrench.add_moment_arm, wrench.marker_jacobian)


@pytest.fixture
def few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[CompiledUnit, ...]:
    """An empty cache, and an engine of three units."""
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(unit_cache, "_full", [])
    monkeypatch.setattr(compiled_calls, "all_units", lambda: FEW)
    unit_cache._shared_folders.cache_clear()
    yield FEW
    unit_cache._shared_folders.cache_clear()


@pytest.mark.seconds
def test_all_units_are_compiled_once_with_progress(few: tuple[CompiledUnit, ...]) -> None:
    told: list[tuple[str, float, str]] = []
    done = installation.warmup(
        progress=lambda phase, share, text="": told.append((phase, share, text))
    )
    assert (done.units, done.compiled) == (len(few), len(few))
    assert not missing_units(few)
    assert done.cache == unit_cache.cache_folders()[0]
    assert done.size == sum(file.stat().st_size for file in done.cache.glob("*.unit"))
    shares = [share for _, share, _ in told]
    assert {phase for phase, _, _ in told} == {"compile"}
    assert shares[0] == 0.0 and shares[-1] == 1.0 and shares == sorted(shares)
    assert any(text.startswith("2 of 3 units") for _, _, text in told)
    told.clear()
    again = installation.warmup(progress=lambda *words: told.append(words))
    assert (again.units, again.compiled, again.size) == (len(few), 0, done.size)
    assert told == []


@pytest.mark.slow
def test_the_command_says_what_it_did(few: tuple[CompiledUnit, ...]) -> None:
    first, second = (CliRunner().invoke(app, ["warmup"]) for _ in range(2))
    assert first.exit_code == second.exit_code == 0, first.output
    assert "3 units, 3 of them compiled in " in first.stdout
    assert "3 units, 0 of them compiled in " in second.stdout


def test_the_scenes_of_the_templates_find_their_units(tmp_path: Path) -> None:
    done = installation.warmup()
    assert done.units == len(all_units()) and not missing_units(all_units())
    for template in listings.templates():
        model = load_scene(listings.new_scene(tmp_path / template, template))
        bodies, _, _ = flexible_bodies.flexible_bodies(model, tmp_path)
        system, method = compile_system(model, bodies).system, make_integrator(model.dynamics)
        assert not missing_units(integration_units(system, method)), template


@pytest.mark.parametrize("method", METHODS)
def test_every_method_is_among_them(method: str) -> None:
    spec = DynamicsSpec(duration=1.0, method=method)
    assert set(make_integrator(spec).step) <= set(all_units())
