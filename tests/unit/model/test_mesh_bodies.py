"""Words of flexible bodies: read into SI, handed on as plain data, written back the same."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from flexmb.fe import survey
from flexmb.fe.reduction.methods import reduction_key
from flexmb.model import Model, load_scene, scene_schema

SCENE = """
title = "every word of a flexible body"
units = "mm-t-s"
[parameters]
t1 = 2
[bodies.shell]
mesh = { type = "plate", length = 200, width = "10*t1", divisions = [8, 2], skew = "10 deg" }
modes = { frequency = 500 }
reduction = "free-interface"
mass_matrix = "hrz"
damping = 0.01
[bodies.shell.material]
E = [135e3, 10e3, 10e3]
nu = [0.3, 0.4, 0.3]
G = [5e3, 3.4e3, 5e3]
density = 1.6e-9
[bodies.shell.interfaces]
root = "x0"
tip = { group = "x1", type = "rbe3", weights = "uniform", position = [200, 0, 5] }
spot = { center = [100, 0, 0], radius = 12 }
[bodies.shell.sections.all]
type = "layered"
offset = 0.5
orientation = "x"
nonstructural = 1e-9
layers = [
  { thickness = "t1/4", angle = "45 deg" },
  { thickness = 0.25, material = "aluminium" },
]
[bodies.shell.masses]
lump = { at = "x1y1", mass = 1e-5, inertia = [1, 1, 2], offset = [0, 0, 3] }
[bodies.shell.springs]
soft = { between = ["x0y0", 4], stiffness = 7 }
stiff = { between = [0, 4], stiffness = [1, 2, 3, 40, 50, 60], axes = ["y", "z"] }
[bodies.shell.loads]
blow = { type = "pressure", group = "surface", pressure = 0.1 }
drag = { type = "traction", group = "surface", traction = [1, 0, 0], residual = false }
edge = { type = "line", group = "y0", force = [0, 1, 0] }
push = { type = "force", nodes = [0, 4], force = [0, 0, 9], moment = [1, 0, 0] }
weight = { type = "gravity", acceleration = [0, 0, -9810] }
[bodies.frame]
mesh = { type = "beam", points = [[0, 0, 0], [100, 0, 0], [100, 50, 0]], divisions = [4, 2] }
material = "steel"
interfaces = { a = "start", b = "end" }
reduction = "guyan"
[bodies.frame.sections]
leg1 = { type = "I", height = 20, width = 10, web = 1, flange = 2, offset = [1, 0] }
[bodies.frame.sections.leg2]
type = "tapered"
start = { type = "box", y = 10, z = 20, web = 1 }
end = { type = "box", y = 5, z = 10, web = 1, flange = 2 }
releases = { end = ["ry", "rz"] }
[bodies.block]
mesh = { type = "box", size = [100, 20, 10], divisions = 2, elements = "wedge15" }
material = "steel"
interfaces = { a = { nodes = [0, 1, 2, 3, 4, 5] } }
modes = { count = 3 }
stress = "none"
[bodies.block.sections]
all = { type = "solid", material = "titanium", axis1 = "y", axis2 = [0, 0, 1] }
[bodies.block.ties]
[bodies.round]
mesh = { type = "disk", radius = 50, thickness = 5, divisions = [2, 16, 1] }
material = "steel"
interfaces = { rim = "outer" }
modes = { effective_mass = 0.9 }
[bodies.pipe]
mesh = { type = "tube", length = 100, radius = 20, inner = 18, divisions = [1, 8, 4] }
material = "steel"
interfaces = { a = { node = 0 } }
[bodies.pipe.ties]
hub = { reference = 0, nodes = "inner" }
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SCENE)
    return load_scene(path)


def test_everything_is_handed_on_in_si(scene):
    words = scene.bodies["shell"].words()
    assert scene.bodies["shell"].mesh.model_dump(exclude_none=True) == {
        "type": "plate",
        "length": 0.2,
        "width": 0.02,
        "divisions": (8, 2),
        "elements": "quad",
        "skew": pytest.approx(math.radians(10)),
    }
    assert words["units"] == "SI"
    assert words["material"].E == pytest.approx((135e9, 10e9, 10e9))
    assert words["material"].density == pytest.approx(1600)
    section = words["sections"]["all"]
    assert section["offset"] == 5e-4 and section["orientation"] == (1, 0, 0)
    assert section["nonstructural"] == pytest.approx(1.0)  # 1e-9 t/mm^2
    assert section["layers"][0] == {"thickness": 5e-4, "angle": pytest.approx(math.pi / 4)}
    assert section["layers"][1]["material"] == "aluminium"
    assert words["interfaces"]["root"] == "x0"
    assert words["interfaces"]["spot"]["radius"] == 0.012
    assert words["interfaces"]["tip"]["position"] == (0.2, 0, 0.005)
    assert words["masses"]["lump"]["mass"] == pytest.approx(0.01)
    assert words["masses"]["lump"]["inertia"][2][2] == pytest.approx(2e-3)  # t mm^2
    assert words["springs"]["soft"] == {"between": ("x0y0", 4), "stiffness": 7e3}
    assert words["springs"]["stiff"]["stiffness"] == pytest.approx(
        (1e3, 2e3, 3e3, 0.04, 0.05, 0.06)
    )
    assert words["loads"]["blow"]["pressure"] == pytest.approx(1e5)
    assert words["loads"]["edge"]["force"] == pytest.approx((0, 1e3, 0))
    assert words["loads"]["push"]["moment"] == pytest.approx((1e-3, 0, 0))
    assert words["loads"]["weight"] == {
        "type": "gravity",
        "acceleration": (0, 0, -9.81),
        "residual": False,
    }
    assert words["modes"] == {"frequency": 500}
    assert (words["reduction"], words["mass_matrix"]) == ("free-interface", "hrz")
    assert "modes" not in scene.bodies["frame"].words()
    assert scene.bodies["block"].words()["stress"] == "none"


def test_what_is_written_reads_back_the_same(scene):
    again = Model.from_scene_dict(scene.to_scene_dict())
    assert again.bodies == scene.bodies
    written = json.loads(json.dumps(scene.to_scene_dict()))["bodies"]
    assert written["shell"]["mesh"]["length"] == 200
    assert "units" not in written["shell"]
    assert written["shell"]["springs"]["stiff"]["stiffness"] == [1, 2, 3, 40, 50, 60]
    assert written["shell"]["material"]["E"] == [135e3, 10e3, 10e3]
    assert written["frame"]["sections"]["leg2"]["end"]["flange"] == 2


def test_the_schema_takes_every_word(scene):
    jsonschema = pytest.importorskip("jsonschema")
    import tomllib

    check = jsonschema.Draft4Validator(scene_schema())
    good = tomllib.loads(SCENE)
    assert [error.message for error in check.iter_errors(good)] == []
    for path, value in (
        (("shell", "mesh", "lenght"), 1),
        (("shell", "sections", "all", "thickness"), 1),
        (("shell", "loads", "blow", "presure"), 1),
        (("shell", "masses", "lump", "mas"), 1),
        (("shell", "interfaces", "tip", "type"), "rbe4"),
        (("block", "mesh", "elements"), "hex"),
        (("block", "reduction"), "craig"),
        (("frame", "sections", "leg2", "start", "Y"), 1),
    ):
        bad = tomllib.loads(SCENE)
        table = bad["bodies"]
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = value
        assert list(check.iter_errors(bad)), path


def test_finite_elements_take_every_word(scene):
    """All bodies of the scene can be reduced: no word is lost or refused between the halves."""
    for name, spec in scene.bodies.items():
        found = survey(spec.mesh.model_dump(exclude_none=True), **spec.words())
        assert [str(problem) for problem in found.problems] == [], name
        assert found.mass > 0


def test_the_key_follows_every_word():
    """Whatever changes the body changes its key; what is left at its default does not."""
    base = {
        "mesh": {"type": "box", "size": [1.0, 0.1, 0.1]},
        "material": "steel",
        "interfaces": {"a": "x0"},
    }
    spring = {"s": {"between": [0, 1], "stiffness": 1.0}}
    load = {"p": {"type": "pressure", "group": "z1", "pressure": 1.0}}
    others = [
        {"mesh": base["mesh"] | {"divisions": 3}},
        {"mesh": base["mesh"] | {"size": [1.0, 0.1, 0.2]}},
        {"material": "aluminium"},
        {"interfaces": {"a": "x1"}},
        {"interfaces": {"a": {"group": "x0", "type": "rbe3"}}},
        {"sections": {"all": {"type": "solid", "material": "titanium"}}},
        {"ties": {"t": {"type": "rbe2", "reference": 0, "nodes": "x1"}}},
        {"masses": {"m": {"at": 0, "mass": 1.0}}},
        {"springs": spring},
        {"springs": {"s": spring["s"] | {"stiffness": 2.0}}},
        {"loads": load},
        {"modes": 21},
        {"modes": {"frequency": 100.0}},
        {"reduction": "free-interface"},
        {"mass_matrix": "hrz"},
        {"stress": "all"},
        {"damping": 0.1},
        {"name": "rod"},
        {"plane": "xy"},
    ]
    keys = [reduction_key(**(base | other)) for other in ({}, *others)]
    assert len(set(keys)) == len(keys)
    defaults = {"modes": 20, "reduction": "craig-bampton", "mass_matrix": "consistent"}
    plain = {"ties": {}, "masses": None, "stress": True, "sections": None}
    assert reduction_key(**base, **defaults, **plain) == keys[0]


def test_a_file_of_own_modes_is_told_by_its_path(tmp_path):
    body = {"mesh": "rod.msh", "material": "steel", "interfaces": {"a": "A"}}
    model = Model("m", folder=tmp_path)
    model.add_body("rod", **body, reduction="user", modes="own.npz")
    assert model.bodies["rod"].modes == "own.npz"
    (tmp_path / "sub").mkdir()
    written = model.to_scene_dict(tmp_path / "sub")["bodies"]["rod"]
    assert (written["mesh"], written["modes"]) == ("../rod.msh", "../own.npz")
    assert Path(written["modes"]).suffix == ".npz"


def test_loads_of_a_body_that_do_not_act_are_told(tmp_path):
    """All but a force of a body on which something acts beside its interfaces; none in a part."""
    plate = """[bodies.plate]
mesh = { type = "plate", length = 1, width = 0.2, divisions = [4, 2] }
material = "steel"
sections = { all = { type = "shell", thickness = 0.01 } }
interfaces = { root = "x0" }
markers.p = { node = 7 }
[bodies.plate.loads]
wind = { type = "pressure", group = "surface", pressure = 500 }
push = { type = "force", node = 7, force = [0, 0, 1] }
"""
    run = "[dynamics]\nduration = 1\nstep = 1e-3\n"
    force = '[forces.f]\ntype = "force"\nat = "plate.p"\nvalue = [0, 0, 1]\n'
    told = []
    acts = '[forces.a]\ntype = "body-load"\nbody = "plate"\nload = "wind"\nvalue = "sin(t)"\n'
    for text in (plate, plate + run, plate + force + run, plate + acts + run):
        path = tmp_path / "scene.toml"
        path.write_text(text)
        sentences = load_scene(path).warnings()
        assert all("does not act in a run" in sentence for sentence in sentences)
        told.append([sentence.split(":")[0].split(".")[-1] for sentence in sentences])
    assert told == [[], ["wind", "push"], ["wind"], ["push"]]
