"""Lengths and places in messages about meshes and parts have the units of the scene."""

from __future__ import annotations

import pytest

from flexmb.errors import FlexmbError
from flexmb.workflow.check import check_scene
from flexmb.workflow.part_analysis import run_part

PLATE = """
units = "mm-t-s"
[bodies.plate]
mesh = { type = "plate", length = 1000, width = 500, divisions = [8, 4] }
material = "steel"
sections = { surface = { type = "shell", thickness = 10 } }
INTERFACES
[part.supports]
left = SUPPORT
[part.loads]
push = { type = "force", group = "x1", force = [0, 0, 1] }
"""


def sentence(tmp_path, function, support="", interfaces=""):
    path = tmp_path / "scene.toml"
    path.write_text(PLATE.replace("SUPPORT", support).replace("INTERFACES", interfaces))
    with pytest.raises(FlexmbError) as error:
        function(path)
    return str(error.value)


def part(path):
    return run_part(path, output=path.parent / "out", pictures=False)


def test_a_free_motion_is_about_a_place_in_millimetres(tmp_path):
    said = sentence(tmp_path, part, '{ group = "x0", hold = ["uz"] }')
    assert "rotation about z through (500, 0, 0) mm" in said


def test_the_nodes_about_a_place_are_told_as_it_was_written(tmp_path):
    about = "{ center = [2000, 0, 0], radius = 3 }"
    said = sentence(tmp_path, part, about.replace("}", ', hold = ["ux"] }'))
    assert "within 3 mm of (2000, 0, 0) mm; the nearest is node 42, 1000 mm away" in said
    said = sentence(
        tmp_path, check_scene, "{ group = 'x0', hold = ['ux'] }", f"interfaces.b = {about}"
    )
    assert "bodies.plate.interfaces.b: there are no nodes" in said
    assert "within 3 mm of (2000, 0, 0) mm" in said
