"""`check_scene`: meshes count as rigid until a run has reduced them, then with their modes."""

from __future__ import annotations

from pathlib import Path

import pytest

import flexmb
from flexmb.folders import output_folder
from flexmb.model import load_scene
from flexmb.workflow.flexible_bodies import flexible_bodies

PORTAL = """
[bodies.beam]
mesh = { type = "beam", length = 2.0, divisions = 4 }
material = "steel"
sections = { all = { type = "circle", radius = 0.02 } }
interfaces = { a = "start", b = "end" }
modes = 2
[joints.left]
type = "fixed"
between = ["ground", "beam.a"]
[joints.right]
type = "fixed"
between = ["ground.far", "beam.b"]
[ground]
markers.far = { position = [2, 0, 0] }
[dynamics]
duration = 1
"""


def test_modes_of_an_earlier_run_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A beam clamped at both ends: as rigid, six equations too many; its modes take them up."""
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / "portal.toml"
    scene.write_text(PORTAL)
    report = flexmb.check_scene(scene)
    assert report.mobility is not None
    assert (report.mobility.coordinates, report.mobility.redundant) == (6, 6)
    assert any("counted as rigid until reduced: beam" in note for note in report.notes)
    folder = output_folder(scene)
    folder.mkdir(parents=True)
    flexible_bodies(load_scene(scene), folder)
    report = flexmb.check_scene(scene)
    assert report.mobility is not None
    assert (report.mobility.coordinates, report.mobility.modes) == (14, 8)
    assert (report.mobility.redundant, report.mobility.as_rigid) == (0, 6)
    assert any("modes of the flexible bodies take up 6" in note for note in report.notes)
    assert not any("counted as rigid" in note for note in report.notes)


def test_what_only_rigid_bodies_could_not_do_is_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A beam that is clamped 1 mm off its length can be strained to fit."""
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / "portal.toml"
    scene.write_text(PORTAL.replace("[2, 0, 0]", "[2.001, 0, 0]"))
    report = flexmb.check_scene(scene)
    assert report.mobility is None
    assert any("if the flexible bodies are rigid: joints." in note for note in report.notes)
