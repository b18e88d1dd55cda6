"""Compiling ahead: for every method and for the tables that usual scenes have."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest

from flexmb import workflow
from flexmb.analysis.dynamics import analysis as dynamics
from flexmb.engine.compile import compile_system
from flexmb.engine.jit import CACHE_DIR
from flexmb.errors import FlexmbError
from flexmb.model import load_scene
from flexmb.model.tasks.dynamics import DynamicsSpec
from flexmb.workflow.warmup import FEATURES

METHODS = get_args(DynamicsSpec.model_fields["method"].annotation)


def _kind(part: Any) -> Any:
    """What of a system decides which code is compiled: the types of its tables, not their sizes."""
    if isinstance(part, tuple):
        return (type(part).__name__, *(_kind(item) for item in part))
    return (part.dtype.str, part.ndim) if isinstance(part, np.ndarray) else type(part).__name__


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What would have been compiled: method and kind of each system."""
    seen: list[Any] = []

    def prepare(compiled, model, *, progress) -> None:
        progress("compile", 1.0)
        seen.append((model.dynamics.method, _kind(compiled.system)))

    monkeypatch.setattr(dynamics, "prepare", prepare)
    return seen


def test_every_method_and_feature_is_compiled_once_with_progress(prepared) -> None:
    told: list[tuple[str, float]] = []
    done = workflow.warmup(
        progress=lambda phase, fraction, detail="": told.append((phase, fraction))
    )
    assert len(prepared) == len(set(prepared)) == len(done.rows) == len(FEATURES) * len(METHODS)
    assert {method for method, _ in prepared} == set(METHODS)
    assert done.cache == CACHE_DIR
    ended = [phase for phase, fraction in told if fraction == 1.0]
    assert ended == [f"{features}, {method}" for features, method, _ in done.rows]


def test_the_scenes_of_the_templates_find_their_kernels(prepared, tmp_path) -> None:
    workflow.warmup()
    kinds = {kind for _, kind in prepared}
    for template in workflow.templates():
        model = load_scene(workflow.new_scene(tmp_path / template, template))
        bodies, _, _ = workflow.flexible_bodies(model, tmp_path)
        assert _kind(compile_system(model, bodies).system) in kinds, template


def test_one_method_alone_and_none_that_is_unknown(prepared) -> None:
    workflow.warmup(METHODS[:1])
    assert {method for method, _ in prepared} == {METHODS[0]}
    with pytest.raises(FlexmbError, match="unknown method"):
        workflow.warmup(["rk4"])
