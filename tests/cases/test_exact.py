"""What `exact.py` of a case prints stands in the checks of its scenes, without flexmb's help."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import flexmb

PROGRAMS = sorted((Path(__file__).parents[2] / "cases").glob("*/exact.py"))


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.parent.name)
def test_the_checks_hold_what_the_independent_model_prints(program: Path, tmp_path: Path) -> None:
    """One row of each: scene, sensor, t = time, value. A hundredth of the tolerance is rounding."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    printed = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, check=True, env=environment
    ).stdout
    rows = [line.split() for line in printed.splitlines() if line.strip()]
    assert rows
    scenes = {row[0]: flexmb.load_scene(program.parent / row[0]) for row in rows}
    open_checks = {
        (scene, check.sensor, check.time)
        for scene, model in scenes.items()
        for check in model.checks
        if "exact.py" in check.source
    }
    for scene, sensor, _, _, time, value in rows:
        model = scenes[scene]
        scale = (model.dynamics or model.kinematics).duration
        fitting = [
            check
            for check in model.checks
            if check.sensor == sensor and abs(check.time - float(time)) < 1e-6 * scale
        ]
        assert fitting, f"{scene} has no check of {sensor} at t = {time}"
        for check in fitting:
            assert check.value == pytest.approx(
                float(value), abs=0.01 * check.tolerance, rel=1e-12
            ), check
            open_checks.discard((scene, check.sensor, check.time))
    assert not open_checks, "checks that name exact.py as their source, which it does not print"


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.parent.name)
def test_an_independent_model_is_independent(program: Path) -> None:
    imports = [
        getattr(node, "module", None) or node.names[0].name
        for node in ast.walk(ast.parse(program.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    roots = {name.split(".")[0] for name in imports}
    assert not roots - {"__future__", "numpy", "scipy", "pathlib", "math"}, roots
