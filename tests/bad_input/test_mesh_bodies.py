"""Mistakes in the words of flexible bodies: where, what was given, what would be right."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from flexmb.cli.app import app
from flexmb.errors import SceneError
from flexmb.model import load_scene

GOOD = """
[bodies.rod]
mesh = { type = "plate", length = 0.4, width = 0.1, divisions = [4, 2] }
material = "steel"
sections.all = { type = "shell", thickness = 0.01 }
interfaces = { root = "x0", tip = { group = "x1", type = "rbe3" } }
modes = 4
masses.lump = { at = "x1y1", mass = 1 }
springs.stay = { between = ["x0y0", "x1y1"], stiffness = 1e3 }
ties = {}
loads.blow = { type = "pressure", group = "surface", pressure = 10 }
[joints.hold]
type = "fixed"
between = ["ground", "rod.root"]
"""
SHELL = 'sections.all = { type = "shell", thickness = 0.01 }'
MESH = 'mesh = { type = "plate", length = 0.4, width = 0.1, divisions = [4, 2] }'
TIP = 'tip = { group = "x1", type = "rbe3" }'


def write(tmp_path, *changes):
    text = GOOD
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return path


def test_the_good_scene_is_valid(tmp_path):
    done = CliRunner().invoke(app, ["check", str(write(tmp_path))])
    assert done.exit_code == 0, done.output
    for told in ("8 quad", "90", "10 to 12 = 6*2 interfaces + 4 modes - 6", "4.14 kg"):
        assert told in done.stdout


WORDS = [
    ((MESH, 'mesh = { type = "plat" }'), 'mesh.type: unknown shape of a mesh "plat"; near'),
    ((MESH, "mesh = 3"), "mesh: a mesh file, or a table {type = ...} of a simple shape is"),
    (("width = 0.1", "widht = 0.1"), 'mesh.widht: unknown key "widht"; nearest: width'),
    (("length = 0.4", "length = -0.4"), "mesh.length: must be positive, is -0.4 m"),
    (("[4, 2]", "[4, 0]"), "mesh.divisions: a whole number from 1 on is expected, is 0"),
    (("[4, 2]", "[]"), "mesh.divisions: whole numbers of elements are expected, given []"),
    (
        (MESH, 'mesh = { type = "beam" }'),
        'mesh: give either "length" or "points", given neither',
    ),
    (
        ('material = "steel"', 'material = "steel"\nunits = "mm-t-s"'),
        "units: are those of mesh files; the sizes of a shape are in the scene's units",
    ),
    (
        ('material = "steel"', "material = { E = [1, 2], nu = 0.3, density = 1 }"),
        "material.E[2]: is missing",
    ),
    (
        ('material = "steel"', "material = { E = [1e9, 1e9, 1e9], nu = [0.9, 0.9, 0.9], "
         "G = [1e9, 1e9, 1e9], density = 1 }"),
        "material.nu: are impossible with E",
    ),
    ((SHELL, 'sections.all = { type = "shel" }'), 'sections.all.type: unknown section "shel"; n'),
    ((SHELL, 'sections.all = { type = "shell" }'), "sections.all.thickness: is missing"),
    (("thickness = 0.01", "thickness = -1"), "sections.all.thickness: must be positive, is -1 m"),
    (
        (SHELL, 'sections.all = { type = "layered", layers = [{ thickness = 1 }, { angle = 1 }] }'),
        "sections.all.layers[1].thickness: is missing",
    ),
    (
        (SHELL, 'sections.all = { type = "general", A = -1, Iy = 1, Iz = 1, J = 1 }'),
        "sections.all.A: must be positive, is -1 m^2",
    ),
    (
        (SHELL, 'sections.all = { type = "circle", radius = 1, releases = { start = ["rw"] } }'),
        'sections.all.releases.start[0]: unknown choice "rw"',
    ),
    (
        (SHELL, 'sections.all = { type = "tapered", start = { type = "circle" } }'),
        "sections.all.start.radius: is missing",
    ),
    ((TIP, 'tip = { type = "rbe3" }'), "interfaces.tip: has no nodes; give one of group, node"),
    ((TIP, 'tip = { group = "x1", node = 3 }'), "interfaces.tip: has group and node"),
    ((TIP, "tip = { center = [0, 0, 0] }"), 'interfaces.tip: "center" and "radius" go together'),
    ((TIP, 'tip = { group = "x1", weights = "area" }'), 'interfaces.tip.weights: are for type = "'),
    ((TIP, 'tip = { group = "x1", type = "rbe" }'), 'interfaces.tip.type: unknown choice "rbe"'),
    ((TIP, "tip = 2.5"), "interfaces.tip: the name of a mesh group, or a table, is expected"),
    (("modes = 4", "modes = { frequency = -1 }"), "modes.frequency: must be positive, is -1 Hz"),
    (("modes = 4", "modes = { count = 1, frequency = 1 }"), "modes: give one of them, given count"),
    (("modes = 4", "modes = { effective_mass = 1.5 }"), "modes.effective_mass: must be a share"),
    (("modes = 4", 'modes = "own.npz"'), 'modes: an .npz file goes with reduction = "user"'),
    (("modes = 4", 'reduction = "user"'), "modes: must be the .npz file of your own modes"),
    (("modes = 4", 'modes = 4\nreduction = "guyan"'), "modes: a static reduction (guyan)"),
    (("modes = 4", 'reduction = "craig"'), 'reduction: unknown choice "craig"; nearest: craig-b'),
    (("modes = 4", 'mass_matrix = "lumped"'), 'mass_matrix: unknown choice "lumped"; allowed:'),
    (("mass = 1", "mass = 0"), "masses.lump.mass: must be positive where there is no inertia"),
    (("mass = 1", "mass = -1"), "masses.lump.mass: must be zero or positive, is -1 kg"),
    (("stiffness = 1e3", "stiffness = 0"), "springs.stay.stiffness: must be positive, is 0 N/m"),
    (("stiffness = 1e3", "stiffness = [1, 2]"), "springs.stay.stiffness: one stiffness, or six"),
    (
        ("stiffness = 1e3", 'stiffness = 1e3, axes = ["x", "y"]'),
        "springs.stay.axes: belong to a spring with six stiffnesses",
    ),
    (("ties = {}", 'ties.t = { type = "rbe4" }'), 'ties.t.type: unknown choice "rbe4"'),
    (("ties = {}", 'ties.t = { reference = true, nodes = "x0" }'), "ties.t.reference: the name"),
    (('type = "pressure"', 'type = "presure"'), 'loads.blow.type: unknown load type "presure"'),
    (("pressure = 10", "presure = 10"), 'loads.blow.presure: unknown key "presure"; nearest'),
    (
        ("loads.blow = {", 'loads.push = { type = "force", node = 0 }\nloads.blow = {'),
        'loads.push: give "force", "moment" or both',
    ),
]  # fmt: skip


@pytest.mark.parametrize(("change", "told"), WORDS, ids=[told for _, told in WORDS])
def test_a_wrong_word_is_told_when_the_scene_is_read(tmp_path, change, told):
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, change))
    assert f"bodies.rod.{told}" in str(caught.value)


MESHES = [
    ((MESH, 'mesh = { type = "tube", length = 1, radius = 1, inner = 2 }'),
     "mesh.inner: must be less than the outer radius"),
    ((MESH, 'mesh = { type = "beam", length = 1 }'),
     "sections.all: the group has no surface elements in beam"),
    ((SHELL, "sections = {}"),
     ": plate: has no volume elements, and no lines or surfaces with a section"),
    (('root = "x0"', 'root = "x3"'), 'interfaces.root: plate has no group "x3"'),
    ((TIP, "tip = { node = 999 }"), "interfaces.tip.node: 999 is no node"),
    ((TIP, 'tip = "x0y0"'), "interfaces.tip: shares 1 nodes (0) with the interface"),
    (("modes = 4", "modes = 1000"), "modes: 1000 requested, but the model has only"),
    (('at = "x1y1"', 'at = "x9"'), 'masses.lump.at: plate has no group "x9"'),
    (('"x1y1"], st', '"x0y0"], st'), "springs.stay.between: both ends are node 0"),
    (('group = "surface"', 'group = "top"'), 'loads.blow.group: plate has no group "top"'),
    (("ties = {}", 'ties.t = { reference = "x0", nodes = "x1" }'),
     'ties.t.reference: one node is expected, the group "x0" has 3'),
    (("sections.all", "sections.rim"), 'sections.rim: plate has no group "rim"'),
]  # fmt: skip


@pytest.mark.parametrize(("change", "told"), MESHES, ids=[told for _, told in MESHES])
def test_what_does_not_fit_the_mesh_is_told_before_any_reduction(tmp_path, change, told):
    done = CliRunner().invoke(app, ["check", str(write(tmp_path, change))])
    assert done.exit_code == 2, done.output
    shown = f"bodies.rod{told}" if told.startswith(":") else f"bodies.rod.{told}"
    assert shown in done.stderr


def test_a_small_body_far_from_its_joints_is_told_before_any_reduction(tmp_path):
    """4 cm off on a strip of 40 cm: what a run refuses, check refuses, of any size of the mesh."""
    path = write(tmp_path, ("[bodies.rod]", "[bodies.rod]\nposition = [0.04, 0, 0]"))
    path.write_text(path.read_text() + "[dynamics]\nduration = 0.1\n")
    done = CliRunner().invoke(app, ["check", str(path)])
    assert done.exit_code == 2, done.output
    assert "bodies.rod: would have to move by 0.04 m" in done.stderr
    scaled = [("mesh.length", "0.004"), ("mesh.width", "0.001"), ("position", "[4e-4,0,0]")]
    sets = [word for key, value in scaled for word in ("--set", f"bodies.rod.{key}={value}")]
    thin = [*sets, "--set", "bodies.rod.sections.all.thickness=1e-4"]
    done = CliRunner().invoke(app, ["check", str(path), *thin])
    assert "bodies.rod: would have to move by 0.0004 m" in done.stderr


def test_a_mistake_in_a_part_asks_for_no_interfaces(tmp_path):
    path = write(
        tmp_path, ('interfaces = { root = "x0", tip = { group = "x1", type = "rbe3" } }', "")
    )
    scene = path.read_text().partition("[joints.hold]")[0]
    path.write_text(scene + '[part.supports]\nroot = { group = "x0", typ = "clamped" }\n')
    done = CliRunner().invoke(app, ["part", str(path)])
    assert done.exit_code == 2, done.output
    assert "part.supports.root.typ: unknown key" in done.stderr
    assert "interfaces" not in done.stderr


def test_more_modes_than_can_be_computed_are_refused_before_they_are(tmp_path, monkeypatch):
    """Nearly all modes of a large model come from full matrices; half of them need memory."""
    path = write(tmp_path)
    fine = ["--set", "bodies.rod.mesh.divisions=[60, 20]"]  # 7686 degrees of freedom
    done = CliRunner().invoke(app, ["check", str(path), *fine, "--set", "bodies.rod.modes=7000"])
    assert done.exit_code == 2, done.output
    assert "bodies.rod.modes: 7000 of 7554 requested: so many are computed from" in done.stderr
    assert "ask for fewer than 3777" in done.stderr
    monkeypatch.setenv("FLEXMB_MEMORY", "300 MB")
    done = CliRunner().invoke(app, ["check", str(path), *fine, "--set", "bodies.rod.modes=3000"])
    assert "memory: the computation of 3000 modes needs about" in done.stderr
    assert "ask for fewer modes" in done.stderr


def test_mistakes_of_all_kinds_come_at_once(tmp_path):
    path = write(
        tmp_path,
        ('root = "x0"', 'root = "x3"'),
        ('at = "x1y1"', 'at = "x9"'),
        ('group = "surface"', 'group = "top"'),
    )
    done = CliRunner().invoke(app, ["check", str(path)])
    places = [line.removeprefix("error: ").split(": ")[0] for line in done.stderr.splitlines()]
    assert places == [
        "bodies.rod.masses.lump.at",
        "bodies.rod.interfaces.root",
        "bodies.rod.loads.blow.group",
    ]


@pytest.mark.parametrize(
    ("knob", "value", "told"),
    [
        ("mesh.divisions", "[6, 3]", "18 quad"),
        ("mesh.divisions", "3", "9 quad"),
        ("modes", "7", "13 to 15 = 6*2 interfaces + 7 modes"),
        ("sections.all.thickness", "0.02", "7.28 kg"),
        ("sections.all.thickness", "20 mm", "7.28 kg"),
        ("mesh.length", "0.8", "7.28 kg"),
        ("mesh.elements", "triangle", "16 triangle"),
        ("reduction", "guyan", "bodies.rod.modes: a static reduction (guyan) keeps none"),
    ],
)
def test_every_word_is_a_knob(tmp_path, knob, value, told):
    words = ["check", str(write(tmp_path)), "--set", f"bodies.rod.{knob}={value}"]
    done = CliRunner().invoke(app, words)
    assert told in done.stdout + done.stderr


def test_groups_of_a_part_that_the_mesh_lacks_are_told_by_check(tmp_path):
    path = write(tmp_path)
    part = """
[part]
frequencies = { count = 2 }
[part.supports]
left = { group = "x00", hold = ["uz"] }
root = { interface = "root", hold = ["ux", "uy", "uz"] }
[part.loads]
wind = { type = "pressure", group = "surfaces", pressure = 1 }
"""
    path.write_text(path.read_text() + part)
    done = CliRunner().invoke(app, ["check", str(path)])
    assert done.exit_code == 2, done.output
    for told in ("part.supports.left.group: the mesh has no group", "part.loads.wind.group", "x0"):
        assert told in done.output
    assert "part.supports.root" not in done.output


BODY_LOAD = """
[bodies.block]
mass = 1
inertia = [1, 1, 1]
[forces.gust]
type = "body-load"
body = "rod"
load = "blow"
value = "sin(t)"
"""


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('load = "blow"', 'load = "blwo"', 'load: bodies.rod has no load "blwo"; nearest: blow'),
        ('body = "rod"', 'body = "rodd"', 'gust.body: unknown body "rodd"; nearest: rod; allowed'),
        ('body = "rod"', 'body = "block"', 'load: bodies.block has no load "blow": give it in the'),
        ('"sin(t)"', '"log(t)"', 'value: the value of "log(t)" is -inf at t = 0, not finite'),
        ('value = "sin(t)"', "", "forces.gust.value: is missing"),
    ],
)  # fmt: skip
def test_mistakes_in_a_load_of_a_body(tmp_path, old, new, sentence):
    text = write(tmp_path).read_text() + BODY_LOAD.replace(old, new, 1)
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / "scene.toml")
    assert sentence in str(error.value)


def test_a_reaction_of_a_load_of_a_body_is_refused(tmp_path):
    sensor = '[sensors.r]\ntype = "reaction"\nforce = "gust"\n'
    (tmp_path / "scene.toml").write_text(write(tmp_path).read_text() + BODY_LOAD + sensor)
    with pytest.raises(SceneError, match=r"sensors.r.force: acts all over a body, at no marker"):
        load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("numbers", "sentence"),
    [
        ({"dynamic": [0, 1]}, ""),
        ({"quasi_static": [11]}, ""),
        ({"dynamic": [0, 99]}, "no mode 99: they are numbered from 0 to at most 29"),
    ],
)
def test_a_list_of_modes_before_the_reduction(tmp_path, numbers, sentence):
    """`flexmb check` refused each list: of a mesh that was not reduced yet it knew no mode."""
    (word, modes), scene = *numbers.items(), tmp_path / "scene.toml"
    scene.write_text(f"""
[bodies.arm]
mesh = {{ type = "beam", length = 1.0, divisions = 4 }}
material = "steel"
sections = {{ all = {{ type = "rectangle", y = 0.01, z = 0.02 }} }}
interfaces = {{ root = "start", tip = "end" }}
modes = 6
deformation = {{ {word} = {modes} }}

[joints]
root = {{ type = "fixed", between = ["ground", "arm.root"] }}

[dynamics]
duration = 0.01
""")
    found = CliRunner().invoke(app, ["check", str(scene)])
    assert found.exit_code == (2 if sentence else 0)
    assert sentence in " ".join(found.output.split())
