"""Sections, masses, springs and ties of a mesh body: units, writing, mistakes."""

from __future__ import annotations

import pytest

from flexmb.errors import SceneError
from flexmb.model import Model

MESH = {"interfaces": {"a": "A"}, "mesh": "rod.msh", "material": "steel"}
CONE = {
    "type": "tapered",
    "start": {"type": "I", "height": 300, "width": 150, "web": 8, "flange": "1.2 cm"},
    "end": {"type": "I", "height": 200, "width": 150, "web": 8, "flange": 12, "offset": [0, 50]},
    "releases": {"start": ["ry", "rz"]},
}
PROFILE = {
    "type": "general", "A": 200, "Iy": 1e4, "Iz": 2e4, "J": 3e4, "Iyz": -5e3,
    "points": {"top": [0, 30]}, "nonstructural": 1e-6, "material": {"E": 70e3, "nu": 0.3,
    "density": 2.7e-9},
}  # fmt: skip
SCENE = {
    "sections": {"mast": CONE, "rim": PROFILE},
    "masses": {"lamp": {"at": "tip", "mass": "2 kg", "inertia": [20, 10, 10], "offset": [0, 0, 1]}},
    "springs": {
        "strut": {"between": ["a", 7], "stiffness": 1e3},
        "bush": {"between": ["a", "b"], "stiffness": [1, 2, 3, 4, 5, 6], "axes": ["x", "z"]},
    },
    "ties": {"seat": {"type": "rbe3", "reference": 4, "nodes": "face"}},
    "mass_matrix": "hrz",
}


def body(**more):
    model = Model("m", units="mm-t-s")
    model.add_body("mast", **MESH, **more)
    return model, model.bodies["mast"]


def test_values_reach_si():
    spec = body(**SCENE)[1]
    cone, profile = spec.sections["mast"], spec.sections["rim"]
    assert cone["start"]["flange"] == pytest.approx(0.012)
    assert cone["end"]["offset"] == (0, 0.05)
    assert profile["Iyz"] == pytest.approx(-5e-9) and profile["points"]["top"] == (0, 0.03)
    assert profile["nonstructural"] == pytest.approx(1.0)  # t/mm
    lamp = spec.masses["lamp"]
    assert lamp.mass == 2.0 and lamp.offset == (0, 0, 1e-3)
    assert lamp.inertia[0][0] == pytest.approx(20e-3)  # t mm^2
    assert spec.springs["strut"].stiffness == pytest.approx(1e6)
    assert spec.springs["bush"].stiffness == pytest.approx([1e3, 2e3, 3e3, 4e-3, 5e-3, 6e-3])
    assert spec.springs["bush"].axes == ((1, 0, 0), (0, 0, 1))


def test_they_survive_being_written(tmp_path):
    (tmp_path / "rod.msh").touch()
    model, spec = body(**SCENE)
    written = model.to_scene_dict()
    again = Model.from_scene_dict(written, tmp_path)
    assert again.bodies["mast"] == spec
    assert written["bodies"]["mast"]["sections"]["mast"]["start"]["height"] == 300


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"masses": {"l": {"at": "tip", "mass": 0}}}, "masses.l.mass: must be positive"),
        ({"masses": {"l": {"at": True, "mass": 1}}}, "masses.l.at: a node number or a mesh group"),
        ({"masses": {"l": {"mass": 1}}}, "masses.l.at: is missing"),
        ({"springs": {"s": {"between": ["a", "b"], "stiffness": [1, 2]}}}, "one number or six"),
        ({"springs": {"s": {"between": ["a", "b"], "stiffness": -1}}}, "stiffness: must be posit"),
        ({"ties": {"t": {"type": "rbe4", "reference": 1, "nodes": "f"}}}, "ties.t.type"),
        ({"sections": {"g": {"type": "box", "y": 1, "z": 1}}}, "sections.g.web: is missing"),
        ({"sections": {"g": {**CONE, "start": {"type": "O"}}}}, 'start.type: unknown section "O"'),
        ({"mass_matrix": "lumped"}, "mass_matrix"),
    ],
)
def test_refused(more, sentence):
    with pytest.raises(SceneError, match=sentence):
        body(**more)
