"""Mistakes in a scene: each gives one line that says where, what, and what would be right."""

from __future__ import annotations

import pytest
from goodscene import GOOD, message

from flexmb.errors import SceneError
from flexmb.model import Model, load_scene
from flexmb.model.joints.joint import JOINT_TYPES


def test_the_good_scene_is_good(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(GOOD)
    assert not load_scene(path).problems()


PUSH = '[forces.push]\ntype = "force"\nat = "crank"\n'
ONE_LINE = [
    pytest.param(
        ('type = "revolute"', 'type = "revolut"'),
        'joints.bearing.type: unknown joint type "revolut"; nearest: revolute; '
        f"allowed: {', '.join(sorted(JOINT_TYPES)[:3])}, ",
        id="unknown joint type",
    ),
    pytest.param(
        ('"crank.tip", "rod"', '"crnk.tip", "rod"'),
        'joints.pin.between[0]: unknown body "crnk"; nearest: crank; allowed: crank, rod, ground',
        id="misspelt body",
    ),
    pytest.param(
        ('"crank.tip", "rod"', '"crank.tp", "rod"'),
        'joints.pin.between[0]: body "crank" has no marker "tp"; nearest: tip; '
        "allowed: origin, center, tip",
        id="misspelt marker",
    ),
    pytest.param(
        ("mass = 1", "mass = -1"), "bodies.crank.mass: must be positive, is -1 kg", id="mass"
    ),
    pytest.param(
        ("mass = 1", 'mass = "r - 1"'),
        'bodies.crank.mass: must be positive, is -0.8 kg (given "r - 1")',
        id="negative mass by an expression",
    ),
    pytest.param(
        ("[dynamics]", "[view]\nsize = [99999, 100]\n[dynamics]"),
        "view.size[0]: at most 8192, is 99999",
        id="a picture that no memory holds",
    ),
    pytest.param(
        ("mass = 1", "mass = 1e200"),
        "bodies.crank.mass: is too large, 1e+200 in SI; allowed: up to 1e+60",
        id="a mass whose powers overflow",
    ),
    pytest.param(
        ("[dynamics]", f"{PUSH}value = [0, 1e300, 0]\n[dynamics]"),
        "forces.push.value[1]: is too large, 1e+300 in SI; allowed: up to 1e+60",
        id="a force whose powers overflow",
    ),
    pytest.param(
        ("[dynamics]", f"{PUSH}value = [0, 0, '1e90*t']\n[dynamics]"),
        "forces.push.value[2]: is too large, 1e+90 in SI; allowed: up to 1e+60",
        id="a force whose powers will overflow",
    ),
    pytest.param(
        ('type = "revolute"', 'type = "orientation"'),
        "joints.bearing.axis: an orientation joint has no axis; leave it out",
        id="an axis of a joint that has none",
    ),
    pytest.param(
        ("mass = 1", "mass = 1e-200"),
        "bodies.crank.mass: is too small, 1e-200 in SI; allowed: from 1e-60 on",
        id="a mass that cannot be divided by",
    ),
    pytest.param(
        ("inertia = [1, 1, 1]", "inertia = [1, 1, 3]"),
        "bodies.crank.inertia: the inertia is impossible: of its principal moments 1, 1, 3 kg m^2 "
        "the largest, 3, exceeds the sum of the other two, 2; no distribution of mass has it",
        id="triangle inequality",
    ),
    pytest.param(
        ("inertia = [1, 1, 1]", "inertia = [1, 1, -1]"),
        "bodies.crank.inertia: the inertia is impossible: its principal moments -1, 1, 1 kg m^2 "
        "must all be positive",
        id="negative inertia",
    ),
    pytest.param(
        ("inertia = [1, 1, 1]", "inertia = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]"),
        "bodies.crank.inertia: the inertia is not symmetric: Ixy = 0.1 kg m^2 but Iyx = 0 kg m^2",
        id="unsymmetric inertia",
    ),
    pytest.param(
        ("inertia = [1, 1, 1]\n", ""),
        "bodies.crank.inertia: is missing (or give a shape to compute it from)",
        id="missing inertia",
    ),
    pytest.param(
        ("angle =", "stroke ="),
        'drivers.motor.stroke: the revolute joint "bearing" has no stroke; it has: angle',
        id="driver on a coordinate the joint lacks",
    ),
    pytest.param(
        ('joint = "bearing"', 'joint = "baring"'),
        'drivers.motor.joint: unknown joint "baring"; nearest: bearing; '
        "allowed: bearing, pin, guide",
        id="misspelt joint",
    ),
    pytest.param(
        ('joint = "bearing"\nangle = "speed*t"', 'joint = "bearing"'),
        'drivers.motor: give exactly one of "angle", "second_angle" and "stroke", given none',
        id="driver without a function",
    ),
    pytest.param(
        ("between", "betwen"),
        'joints.bearing.betwen: unknown key "betwen"; nearest: between; '
        "allowed: type, between, axis, second_axis, length, ",
        id="misspelt key, and not also a missing one",
    ),
    pytest.param(
        ('between = ["ground", "crank"]\n', ""),
        "joints.bearing.between: is missing",
        id="missing key",
    ),
    pytest.param(
        ('between = ["ground", "crank"]', 'between = ["crank.tip", "crank"]'),
        'joints.bearing.between: a joint connects two bodies, both markers are on "crank"',
        id="a body with itself",
    ),
    pytest.param(
        ('angle = "speed*t"', 'angle = { type = "harmonik", amplitude = 1 }'),
        'drivers.motor.angle.type: unknown function "harmonik"; nearest: harmonic; '
        "allowed: constant, polynomial, harmonic, fourier, ",
        id="unknown form of a function",
    ),
    pytest.param(
        ('angle = "speed*t"', 'angle = "log(t)"'),
        'drivers.motor.angle: the value of "log(t)" is -inf at t = 0, not finite',
        id="function outside its domain",
    ),
    pytest.param(
        ('angle = "speed*t"', 'angle = "t**0.5"'),
        'drivers.motor.angle: the first derivative of "t**0.5" is inf at t = 0, not finite',
        id="driver with infinite velocity",
    ),
    pytest.param(
        ("duration = 1", "duration = 0"),
        "dynamics.duration: must be positive, is 0 s",
        id="zero duration",
    ),
    pytest.param(
        ("step = 1e-3", "step = 2"),
        "dynamics.step: must not exceed the duration 1 s, is 2 s",
        id="step longer than the run",
    ),
    pytest.param(
        ("step = 1e-3", "accuracy = 1e-17"),
        "dynamics.accuracy: must be at least 1e-12, is 1e-17; smaller errors are round-off",
        id="accuracy below round-off",
    ),
    pytest.param(
        ("step = 1e-3", "step = -1e-3"),
        "dynamics.step: must be positive, is -0.001 s",
        id="negative step",
    ),
    pytest.param(
        ("step = 1e-3", 'step = 1e-3\nmethod = "rk"'),
        'dynamics.method: unknown choice "rk"; '
        "allowed: auto, generalized-alpha, explicit-rk, radau, hht, newmark, trapezoidal, "
        "baumgarte, coordinate-partitioning",
        id="unknown method",
    ),
    pytest.param(
        ("step = 1e-3", "step = 1e-3\noutputs = 1.5"),
        "dynamics.outputs: a whole number from 1 on is expected, is 1.5",
        id="half an output",
    ),
    pytest.param(
        ('type = "box"', 'type = "bx"'),
        'bodies.rod.shape.type: unknown shape "bx"; nearest: box; allowed: box, cylinder, sphere, '
        "extrusion, mesh",
        id="unknown shape",
    ),
    pytest.param(
        ('material = "steel"', 'material = "steel"\nmass = 3'),
        'bodies.rod: the mass is given twice, by "mass" and "material"',
        id="mass told twice",
    ),
    pytest.param(
        ('position = ["r", 0, 0]\n[joints', 'position = ["r", 0]\n[joints'),
        "bodies.rod.position[2]: is missing",
        id="two components",
    ),
    pytest.param(
        ('axis = "z"', 'axis = "w"'),
        'joints.bearing.axis: an axis is a direction, given "w"; '
        "allowed: x, y, z, -x, -y, -z, [x, y, z]",
        id="unknown axis",
    ),
    pytest.param(
        ('type = "position"', 'type = "positon"'),
        'sensors.tip.type: unknown sensor type "positon"; nearest: position; '
        "allowed: position, velocity, acceleration, ",
        id="unknown sensor type",
    ),
    pytest.param(
        ('type = "position"', 'type = "stress"'),
        'sensors.tip.type: unknown sensor type "stress": stress needs no sensor, results have it '
        "(body.von_mises, body.stress.NODE.xx; `flexmb stress` shows the largest, a known answer "
        "names body.von_mises); nearest: stroke; allowed: position, velocity, ",
        id="a sensor of stress",
    ),
    pytest.param(
        ("[dynamics]", "[dynamcs]"),
        'dynamcs: unknown key "dynamcs"; nearest: dynamics; allowed: title, units, plane, gravity, '
        "parameters, effects, budget, ground, bodies, ",
        id="unknown section",
    ),
    pytest.param(
        ("[dynamics]", '[effects]\nchoice = "auto"\nbudget = 5\n[dynamics]'),
        "effects.budget: must lie between 0 and 1, is 5",
        id="a budget in percent",
    ),
    pytest.param(
        ("[dynamics]", '[view]\nhistory = ["tip.w"]\n[dynamics]'),
        'view.history[0]: unknown channel "tip.w"; nearest: tip.x, tip.y, tip.z; '
        "allowed: tip.x, tip.y, tip.z",
        id="unknown channel",
    ),
    pytest.param(
        (
            "[dynamics]",
            "[[check]]\nlinear_mode = 1\nparameters = { speeed = 2 }\nvalue = 1\n"
            'tolerance = 1\nsource = "none"\n[dynamics]',
        ),
        "check[0].parameters.speeed: unknown parameter; nearest: speed; allowed: r, speed",
        id="unknown parameter of a linearised mode",
    ),
    pytest.param(
        ("[dynamics]", "[view]\ntime = 2\n[dynamics]"),
        "view.time: 2 s lies after the end of the run, 1 s",
        id="picture after the end",
    ),
    pytest.param(
        ("[dynamics]", '[forces.f]\ntype = "force"\nat = "ground"\nvalue = [1, 0, 0]\n[dynamics]'),
        "forces.f.at: a force on ground has no effect",
        id="force on ground",
    ),
    pytest.param(
        (
            "[dynamics]",
            '[forces.s]\ntype = "spring-damper"\nbetween = ["ground", "crank"]\n'
            "stiffness = 1\n[dynamics]",
        ),
        "forces.s.between: its markers coincide in the placed pose: the direction of the "
        "spring is undefined (zero length)",
        id="spring of length zero",
    ),
    pytest.param(
        ("[dynamics]", '[drivers.m2]\njoint = "bearing"\nangle = 1\n[dynamics]'),
        'drivers.m2: the angle of joint "bearing" is driven by "motor" already',
        id="conflicting drivers",
    ),
    pytest.param(
        ("[bodies.rod]", '[bodies."big rod"]\nmass = 1\ninertia = [1, 1, 1]\n[bodies.rod]'),
        'bodies.big rod: "big rod" is no name: letters, digits, _ and - only, and a letter first',
        id="name with a space",
    ),
    pytest.param(
        ("[bodies.rod]", "[bodies.ground]\nmass = 1\ninertia = [1, 1, 1]\n[bodies.rod]"),
        'bodies.ground: the name "ground" is taken: give its markers by [ground]',
        id="a body called ground",
    ),
    pytest.param(
        ("markers.tip", "markers.center = {}\nmarkers.tip"),
        'bodies.crank.markers.center: the name "center" is taken by a marker that such a body has '
        "anyway",
        id="marker called center",
    ),
    pytest.param(
        ("[bodies.crank]", "[bodies.crank]\nvelocity = 3"),
        "bodies.crank.velocity: a list is expected, given 3",
        id="number for a vector",
    ),
    pytest.param(
        ("[bodies.rod]", "[bodies.crank.initial]\ntpi.velocity = [1, 0, 0]\n[bodies.rod]"),
        'bodies.crank.initial.tpi: body "crank" has no marker "tpi"; nearest: tip; '
        "allowed: origin, center, tip",
        id="velocity of a misspelt marker",
    ),
    pytest.param(
        ("[bodies.rod]", "initial.velocity = [1, 0, 0]\n[bodies.rod]"),
        "bodies.crank.initial.velocity: markers are named here; "
        'the body\'s own is "velocity" alone',
        id="velocity of the body among those of markers",
    ),
    pytest.param(
        ("[bodies.rod]", '[bodies.crank.initial]\ntip.axes = "body"\n[bodies.rod]'),
        'bodies.crank.initial.tip: give "velocity", "angular_velocity" or both',
        id="initial motion that says nothing",
    ),
    pytest.param(
        ("[bodies.rod]", "[bodies.crank.initial]\ntip.velocty = [1, 0, 0]\n[bodies.rod]"),
        'bodies.crank.initial.tip.velocty: unknown key "velocty"; nearest: velocity; '
        "allowed: velocity, angular_velocity, axes",
        id="misspelt velocity",
    ),
    pytest.param(
        ("[bodies.rod]", "velocity = [1, 0, 0]\ninitial.origin.velocity = [1, 0, 0]\n[bodies.rod]"),
        'bodies.crank.initial.origin: is the body\'s "velocity" already; say it in one place',
        id="velocity of the origin told twice",
    ),
    pytest.param(
        ("[bodies.crank]", '[bodies.crank]\ncolor = "rde"'),
        'bodies.crank.color: unknown color "rde"; nearest: red; allowed: #rrggbb, ',
        id="unknown color",
    ),
]


@pytest.mark.parametrize(("change", "wanted"), ONE_LINE)
def test_one_mistake_gives_one_line(tmp_path, change, wanted):
    text = message(tmp_path, change)
    assert text == wanted or (wanted.endswith(", ") and text.startswith(wanted))


def test_all_mistakes_of_a_scene_at_once(tmp_path):
    text = message(
        tmp_path,
        ('type = "revolute"\nbetween = ["ground", "crank"]',
         'type = "revolut"\nbetween = ["ground", "crnk"]'),
        ("mass = 1", "mass = -1"),
        ("inertia = [1, 1, 1]", "inertia = [1, 1, 3]"),
        ("speed*t", "sped*t"),
        ("duration = 1", "duration = 0"),
        ('of = "crank.tip"', 'of = "rod.tip"'),
        ('"crank.tip", "rod"', '"crank.tp", "rood"'),
    )  # fmt: skip
    places = [line.split(": ")[0] for line in text.splitlines() if not line.startswith(" ")]
    assert sorted(places) == [
        "bodies.crank.inertia",
        "bodies.crank.mass",
        "drivers.motor.angle",
        "dynamics.duration",
        "joints.bearing.between[1]",
        "joints.bearing.type",
        "joints.pin.between[1]",
        "sensors.tip.of",
    ]


def test_what_depends_on_a_wrong_entry_is_not_reported_again(tmp_path):
    text = message(tmp_path, ("mass = 1", "mass = 0"))
    assert text == "bodies.crank.mass: must be positive, is 0 kg"


def test_a_parameter_with_a_bad_name_has_its_number_elsewhere(tmp_path):
    """An eccentricity "e" of 1, or of 2.718, would make the root below no number."""
    path = tmp_path / "scene.toml"
    text = GOOD.replace("[bodies.crank]", "[bodies.crank]\ncenter = ['sqrt(0.35**2 - e**2)', 0, 0]")
    path.write_text(text.replace("[parameters]", "[parameters]\ne = 0.04"))
    with pytest.raises(SceneError) as error:
        load_scene(path)
    assert [problem.where for problem in error.value.problems] == ["parameters.e"]


def test_missing_mesh_file(tmp_path):
    (tmp_path / "rod.msh").write_text("")
    body = '[bodies.flex]\nmesh = "rd.msh"\nmaterial = "steel"\ninterfaces = { a = "A" }\n'
    text = message(tmp_path, ("[joints.bearing]", body + "[joints.bearing]"))
    assert text.startswith('bodies.flex.mesh: no file "rd.msh"') and "nearest: rod.msh" in text


def test_flexible_body_fields(tmp_path):
    (tmp_path / "rod.msh").write_text("")
    body = (
        '[bodies.flex]\nmesh = "rod.msh"\nmaterial = { E = -1, nu = 0.3, densty = 1 }\n'
        'units = "mm-s"\ninterfaces = {}\nmodes = -2\nmass = 1\n'
    )
    text = message(tmp_path, ("[joints.bearing]", body + "[joints.bearing]"))
    assert 'bodies.flex: is either rigid, or from a mesh, or a reduced body; given "mesh"' in text
    text = message(
        tmp_path, ("[joints.bearing]", body.replace("mass = 1\n", "") + "[joints.bearing]")
    )
    for wanted in (
        "bodies.flex.material.E: must be positive, is -1 Pa",
        'bodies.flex.material.densty: unknown key "densty"; nearest: density',
        'bodies.flex.units: unknown unit system "mm-s"; nearest: mm-',
        "bodies.flex.interfaces: a table {name = mesh group, ...} of at least one",
        "bodies.flex.modes: a whole number from 0 on is expected, is -2",
    ):
        assert wanted in text


def test_a_model_without_bodies():
    with pytest.raises(SceneError, match=r"the model has no body: give at least one \[bodies.NAME"):
        Model("empty").validate()


def test_python_calls_are_checked_alike():
    model = Model("m", parameters={"r": 1})
    with pytest.raises(SceneError, match="bodies.b.mass: must be positive, is -1 kg"):
        model.add_body("b", mass="-r", inertia=[1, 1, 1])
    with pytest.raises(SceneError, match='joints.j.type: unknown joint type "revolut"; nearest'):
        model.add_joint("j", "revolut", between=["ground", "b"])
    with pytest.raises(SceneError, match="joints.j.axis: a spherical joint has no axis"):
        model.add_joint("j", "spherical", between=["ground", "b"], axis="z")
    with pytest.raises(SceneError, match="parameters.a: depends on itself: a -> a"):
        Model("m", parameters={"a": "a + 1"})


FLEXIBLE = """
[bodies.bar]
mesh = "bar.msh"
material = "steel"
interfaces = { left = "x0", right = "x1" }
"""


@pytest.mark.parametrize(
    ("check", "sentence"),
    [
        ('body = "bat"', 'check[0].body: there is no flexible body "bat"; nearest: bar'),
        ('body = "crank"', 'check[0].body: there is no flexible body "crank"'),
        ('body = "bar"\nheld = ["lft"]', 'bar has no interface "lft"; nearest: left'),
        ('body = "bar"\nmode = 0', "check[0].mode: "),
    ],
)
def test_a_known_frequency_names_what_is_wrong(check, sentence, tmp_path):
    known = f'[[check]]\n{check}\nvalue = 440\ntolerance = 1\nsource = "a tuning fork"\n'
    assert sentence in message(tmp_path, text=GOOD + FLEXIBLE + known)
