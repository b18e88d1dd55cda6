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


@pytest.mark.parametrize(
    ("mesh", "section", "said"),
    [
        ('{ type = "disk", radius = 100, inner = 120, divisions = [4, 8] }',
         'surface = { type = "shell", thickness = 2 }',
         "bodies.b.mesh.inner: must be less than the radius 100 mm, given 120 mm"),
        ('{ type = "beam", length = 1000, divisions = 8 }',
         'all = { type = "I", height = 10, width = 5, web = 6, flange = 6 }',
         "the flanges must leave room for the web within 10 mm"),
        ('{ type = "beam", length = 1000, divisions = 8 }',
         'all = { type = "box", y = 10, z = 10, web = 5, flange = 1 }',
         "must be less than half of 10 mm, given 5 mm"),
    ],
)  # fmt: skip
def test_sizes_that_cannot_be_are_told_as_they_were_written(tmp_path, mesh, section, said):
    scene = f'units = "mm-t-s"\n[bodies.b]\nmesh = {mesh}\nmaterial = "steel"\n'
    path = tmp_path / "scene.toml"
    end = "outer" if "disk" in mesh else "start"
    path.write_text(f"{scene}sections = {{ {section} }}\ninterfaces = {{ a = '{end}' }}\n")
    with pytest.raises(FlexmbError) as error:
        check_scene(path)
    assert said in str(error.value)


def test_a_thickness_in_the_wrong_unit_is_told_as_it_was_written(tmp_path):
    path = tmp_path / "scene.toml"
    text = PLATE.replace("INTERFACES", "").replace("thickness = 10", "thickness = 2000")
    path.write_text(text.replace("SUPPORT", '{ group = "x0", type = "clamped" }'))
    (said,) = [one for one in check_scene(path).notes if "thick and extend" in one]
    assert "are 2000 mm thick and extend over 1000 mm" in said
