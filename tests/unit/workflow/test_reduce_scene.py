"""Flexible bodies of a scene on their own: files, reuse, known frequencies, mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexmb.errors import SceneError
from flexmb.flexbody import load
from flexmb.workflow.reduction import reduce_scene

SCENE = """
title = "two bars"
[bodies.bar]
mesh = { type = "box", size = [1.0, 0.1, 0.05], divisions = [4, 1, 1] }
material = { E = 200e9, nu = 0.0, density = 8000 }
interfaces = { root = "x0" }
modes = 4
[bodies.other]
mesh = { type = "box", size = [0.5, 0.1, 0.05], divisions = [4, 1, 1] }
material = "steel"
interfaces = { root = "x0" }
modes = 4
stress = "none"
[bodies.block]
mass = 1.0
inertia = [1, 1, 1]
[[check]]
body = "bar"
held = ["root"]
value = "3.516015/(2*pi)*5000*0.05/sqrt(12)"
tolerance = 0.4
source = "Euler-Bernoulli cantilever (Blevins, table 8-1); four elements are within 1 %"
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_all_bodies_or_one_are_reduced_and_checked(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    found = reduce_scene(scene, output=out)
    assert [reduced.body.name for reduced in found.bodies] == ["bar", "other"]
    assert sorted(path.name for path in out.iterdir()) == ["bar.flexbody.h5", "other.flexbody.h5"]
    (check,) = found.checks
    assert check.passed, check
    assert load(out / "bar.flexbody.h5").stress is not None
    assert load(out / "other.flexbody.h5").stress is None
    again = reduce_scene(scene, body="other", output=out)
    assert [reduced.body.name for reduced in again.bodies] == ["other"]
    assert again.checks == []
    assert "reduction reused" in again.notes[0]


def test_a_body_that_is_not_there(scene: Path, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match='no flexible body "othre"; nearest: other'):
        reduce_scene(scene, body="othre", output=tmp_path)
    with pytest.raises(SceneError, match='no flexible body "block"'):
        reduce_scene(scene, body="block", output=tmp_path)
    scene.write_text('title = "none"\n[bodies.block]\nmass = 1.0\ninertia = [1, 1, 1]\n')
    with pytest.raises(SceneError, match="the scene has no flexible body"):
        reduce_scene(scene, output=tmp_path)


def test_a_report_compares_with_the_full_model(scene: Path, tmp_path: Path) -> None:
    from flexmb.fe.reduction.quality_report import report_tables

    (one,) = reduce_scene(scene, body="bar", output=tmp_path, report=True, up_to=600.0).bodies
    found = one.report.frequencies
    assert 0 < found.full[-1] <= 600.0
    assert abs(found.error[0]) < 0.01
    titles = [table.title for table in report_tables(one.report)]
    assert any("Frequencies" in title for title in titles)
    again = reduce_scene(scene, body="bar", output=tmp_path, report=True)
    assert again.bodies[0].report is not None  # reduced anew, though the file is there
