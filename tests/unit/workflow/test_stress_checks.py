"""A known answer of a scene may be the largest stress of a flexible body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexmb
from flexmb.errors import SceneError

# A bar that hangs: its stress at the top is its weight over its area, and twice that as it swings.
BAR = """
units = "mm-t-s"
gravity = [10000, 0, 0]
[parameters]
L = 1000
[bodies.bar]
mesh = { type = "beam", length = "L", divisions = 20 }
material = { E = "200 GPa", nu = 0, density = "8000 kg/m^3" }
sections = { all = { type = "rectangle", y = 10, z = 10 } }
interfaces = { top = "start" }
modes = { frequency = 2e4 }
[bodies.stone]
mass = 1
inertia = [1, 1, 1]
[joints.top]
type = "fixed"
between = ["ground", "bar.top"]
[joints.rest]
type = "fixed"
between = ["ground", "stone"]
[sensors.stone]
type = "position"
of = "stone"
[dynamics]
duration = 1e-3
start = "quasi-static"
[results]
keep = ["sensors"]
[[check]]
sensor = "NAME.von_mises"
time = 5e-4
value = "8000e-12*10000*L"
tolerance = "8000e-12*10000*L*0.06"
source = "weight over area"
"""


def run(tmp_path: Path, text: str) -> flexmb.RunReport:
    scene = tmp_path / "scene.toml"
    scene.write_text(text, encoding="utf-8")
    return flexmb.run_scene(scene, output=tmp_path / "out", pictures=False)


@pytest.mark.seconds
def test_a_stress_is_compared_and_what_it_needs_is_stored(tmp_path: Path) -> None:
    report = run(tmp_path, BAR.replace("NAME", "bar"))
    assert [check.passed for check in report.checks] == [True]
    result = flexmb.load_result(report.result)
    assert result.unit("bar.von_mises") == "MPa"
    values = result["bar.von_mises"]  # modal coordinates are stored for it
    assert report.checks[0].value == pytest.approx(float(np.interp(5e-4, result.time, values)))


@pytest.mark.parametrize("name", ["stone", "bur"])
def test_only_flexible_bodies_have_stress(tmp_path: Path, name: str) -> None:
    with pytest.raises(SceneError, match=rf'unknown channel "{name}.von_mises".*bar.von_mises'):
        run(tmp_path, BAR.replace("NAME", name))


def test_a_body_without_stress_in_its_file_has_none(tmp_path: Path) -> None:
    text = BAR.replace("NAME", "bar").replace("modes = {", 'stress = "none"\nmodes = {')
    with pytest.raises(SceneError, match='unknown channel "bar.von_mises"'):
        run(tmp_path, text)
