"""Wrong units, gravity and initial motions: one line each, in the scene's own units."""

from __future__ import annotations

import pytest
from goodscene import GOOD, message

MM = 'units = "mm-kg-ms"\n' + GOOD

ONE_LINE = [
    pytest.param(
        ("mass = 1", 'mass = "1 N"'),
        'bodies.crank.mass: a mass [kg] is expected, given "1 N"',
        id="a force for a mass",
    ),
    pytest.param(
        ("mass = 1", 'mass = "1 kgg"'),
        'bodies.crank.mass: unknown unit "kgg"; nearest: kg; allowed: m, km, ',
        id="misspelt unit",
    ),
    pytest.param(
        ("mass = 1", 'mass = "20 %"'),
        'bodies.crank.mass: shares are plain numbers, 2 % is 0.02; given "20 %"',
        id="percent",
    ),
    pytest.param(
        ("r = 0.2", 'r = "20 percent"'),
        'parameters.r: shares are plain numbers, 2 % is 0.02; given "20 percent"',
        id="percent of a parameter",
    ),
    pytest.param(
        ("r = 0.2", 'r = "200 degrees"'),
        'parameters.r: unknown unit "degrees"; nearest: deg; allowed: m, km, ',
        id="a unit in words",
    ),
    pytest.param(
        ("mass = 1", 'orientation = { axis = "z", angle = 90 }\nmass = 1'),
        "bodies.crank.orientation.angle: an angle [rad] is expected, given 90, more than a turn; "
        'degrees are written "90 deg"',
        id="an orientation in degrees",
    ),
    pytest.param(
        ("r = 0.2", 'r = "200 mmm"'),
        'parameters.r: unknown unit "mmm"; nearest: mm; allowed: m, km, ',
        id="misspelt unit of a parameter",
    ),
    pytest.param(
        ('position = ["r", 0, 0]\n[joints', 'position = ["r", "1 s", 0]\n[joints'),
        'bodies.rod.position[1]: a length [m] is expected, given "1 s"',
        id="a time for a length",
    ),
    pytest.param(
        ("inertia = [1, 1, 1]", 'inertia = [1, 1, "1 kg m"]'),
        'bodies.crank.inertia: a moment of inertia [kg m^2] is expected, given "1 kg m"',
        id="a first moment for an inertia",
    ),
    pytest.param(
        ('angle = "speed*t"', 'angle = "speed*t mm"'),
        'drivers.motor.angle: an angle [rad] is expected, given "speed*t mm"',
        id="a driver in mm",
    ),
    pytest.param(
        (
            'angle = "speed*t"',
            'angle = { type = "harmonic", amplitude = "1 deg", frequency = "50 rad/s" }',
        ),
        'drivers.motor.angle.frequency: a frequency [Hz] is expected, given "50 rad/s"',
        id="an angular velocity for a frequency",
    ),
    pytest.param(
        (
            'angle = "speed*t"',
            'angle = { type = "polynomial", coefficients = [0, "1 rpm", "1 N"] }',
        ),
        'drivers.motor.angle.coefficients[2]: another quantity [rad/s^2] is expected, given "1 N"',
        id="a force for an angular acceleration",
    ),
    pytest.param(
        ("step = 1e-3", 'step = "1 rad"'),
        'dynamics.step: a time [s] is expected, given "1 rad"',
        id="an angle for a time",
    ),
    pytest.param(
        ("step = 1e-3", 'step = 1e-3\noutputs = "3 m"'),
        'dynamics.outputs: a plain number is expected, given "3 m"',
        id="a length for a count",
    ),
    pytest.param(
        (
            "[dynamics]",
            '[[check]]\nsensor = "tip.x"\ntime = 0\nvalue = 0\ntolerance = "1 deg"\n'
            'source = "x"\n[dynamics]',
        ),
        'check[0].tolerance: a length [m] is expected, given "1 deg"',
        id="a check in degrees",
    ),
    pytest.param(
        ("[parameters]", 'gravity = "down"\n[parameters]'),
        'gravity: unknown gravity "down"; allowed: none, [gx, gy, gz], earth -z, earth -y',
        id="gravity in words",
    ),
    pytest.param(
        ("[parameters]", "gravity = [0, -9.81]\n[parameters]"),
        "gravity[2]: is missing",
        id="gravity in the plane",
    ),
    pytest.param(
        ("[parameters]", 'gravity = [0, "-9.81 m/s", 0]\n[parameters]'),
        'gravity[1]: an acceleration [m/s^2] is expected, given "-9.81 m/s"',
        id="a velocity for gravity",
    ),
    pytest.param(
        ("[bodies.rod]", 'initial.tip.angular_velocity = ["5 m/s", 0, 0]\n[bodies.rod]'),
        "bodies.crank.initial.tip.angular_velocity[0]: an angular velocity [rad/s] is expected, "
        'given "5 m/s"',
        id="a velocity for an angular velocity",
    ),
    pytest.param(
        ("[bodies.rod]", 'orientation = { euler = "xyz", axis = "z" }\n[bodies.rod]'),
        "bodies.crank.orientation: an orientation is given in one way, {axis, angle}, "
        '{x_along, y_towards} or {euler, angles}; given "euler", "axis"',
        id="orientation told twice",
    ),
]


@pytest.mark.parametrize(("change", "wanted"), ONE_LINE)
def test_one_mistake_gives_one_line(tmp_path, change, wanted):
    text = message(tmp_path, change)
    assert text == wanted or (wanted.endswith(", ") and text.startswith(wanted))
    assert "\n" not in text


def test_an_unknown_unit_system_is_one_mistake(tmp_path):
    text = message(tmp_path, ("[parameters]", 'units = "mm-s"\n[parameters]'))
    assert text == (
        'units: unknown unit system "mm-s"; nearest: mm-t-s, mm-kg-s, mm-g-ms; '
        "allowed: SI, mm-t-s, mm-kg-s, mm-kg-ms, mm-g-ms, um-kg-s, cm-g-s, in-lbf-s, ft-slug-s"
    )
    assert "unknown unit system" in message(tmp_path, ("[parameters]", "units = 3\n[parameters]"))


def test_a_parameter_that_is_called_like_the_unit(tmp_path):
    """Whether "2 m" is two metres or a slip of "2*m" is not for us to guess."""
    text = message(
        tmp_path, ("r = 0.2", "r = 0.2\nm = 3"), ('"r", 0, 0]\n[joints', '"2 m", 0, 0]\n[joints')
    )
    assert text == (
        'bodies.rod.position[0]: "m" in "2 m" is a unit and a parameter: rename the parameter, '
        'or write "*m" if it was meant'
    )


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (("mass = 1", "mass = -1"), "bodies.crank.mass: must be positive, is -1 kg"),
        (("step = 1e-3", "step = -2"), "dynamics.step: must be positive, is -2 ms"),
        (("step = 1e-3", 'step = "-2 s"'),
         'dynamics.step: must be positive, is -2000 ms (given "-2 s")'),
        (("mass = 1", 'mass = "1 s"'), 'bodies.crank.mass: a mass [kg] is expected, given "1 s"'),
        (("[dynamics]", "[view]\ntime = 2\n[dynamics]"),
         "view.time: 2 ms lies after the end of the run, 1 ms"),
        (("inertia = [1, 1, 1]", "inertia = [1, 1, -1]"),
         "bodies.crank.inertia: the inertia is impossible: its principal moments -1, 1, 1 kg mm^2 "
         "must all be positive"),
        (('angle = "speed*t"', 'angle = { type = "step", t0 = 2, t1 = 1, y1 = 3 }'),
         "drivers.motor.angle.t1: must lie after t0 = 2 ms, is 1 ms"),
        (("[dynamics]", '[forces.s]\ntype = "spring-damper"\nbetween = ["ground", "crank.tip"]\n'
          'stiffness = 1\nfree_length = "short"\n[dynamics]'),
         'forces.s.free_length: a length [mm] is expected, given "short"; '
         "allowed: placed, a number or an expression"),
        (("[dynamics]", '[forces.s]\ntype = "spring-damper"\nbetween = ["ground", "crank.tip"]\n'
          "stiffness = -1\n[dynamics]"),
         "forces.s.stiffness: must be zero or positive, is -1 kN/mm"),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_the_units_of_the_scene(tmp_path, change, wanted):
    assert message(tmp_path, change, text=MM) == wanted


def test_units_are_not_changed_from_outside(tmp_path):
    text = message(tmp_path, text=MM, overrides={"units": "SI"})
    assert text.startswith('override units: unknown parameter "units"')
