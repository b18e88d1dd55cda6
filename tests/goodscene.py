"""A scene without mistakes, and what is said when a piece of it is replaced."""

from __future__ import annotations

import pytest

from flexmb.errors import SceneError
from flexmb.model import load_scene

GOOD = """
[parameters]
r = 0.2
speed = 10
[bodies.crank]
mass = 1
inertia = [1, 1, 1]
markers.tip = { position = ["r", 0, 0] }
[bodies.rod]
shape = { type = "box", size = [1, 0.1, 0.1] }
material = "steel"
position = ["r", 0, 0]
[joints.bearing]
type = "revolute"
between = ["ground", "crank"]
axis = "z"
[joints.pin]
type = "revolute"
between = ["crank.tip", "rod"]
axis = "z"
[joints.guide]
type = "prismatic"
between = ["ground", "rod.center"]
axis = "x"
[drivers.motor]
joint = "bearing"
angle = "speed*t"
[sensors.tip]
type = "position"
of = "crank.tip"
[dynamics]
duration = 1
step = 1e-3
"""


def message(tmp_path, *changes, text=GOOD, overrides=None):
    """The error's text after replacing pieces of the good scene."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path, overrides)
    return str(caught.value)
