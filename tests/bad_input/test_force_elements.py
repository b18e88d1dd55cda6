"""Mistakes in bushings, beams, stops, laws and loads: each one sentence with its place and cure."""

from __future__ import annotations

import pytest
from goodscene import GOOD, message

from flexmb.errors import SceneError
from flexmb.model import Model

BUSH = '[forces.f]\ntype = "bushing"\nbetween = ["ground", "crank.tip"]\n'
BEAM = (
    '[forces.f]\ntype = "beam"\nbetween = ["crank.tip", "rod.center"]\n'
    "A = 1\nIy = 1\nIz = 1\nJ = 1\n"
)
STOP = '[forces.f]\ntype = "rotational-stop"\njoint = "bearing"\nstiffness = 1\n'
GAP = '[forces.f]\ntype = "stop"\nbetween = ["ground", "rod.center"]\nstiffness = 1\n'
LINE = '[forces.f]\ntype = "spring-damper"\nbetween = ["ground", "rod.center"]\n'
PUSH = '[forces.f]\ntype = "force"\nat = "crank.tip"\nvalue = [1, 0, 0]\n'
MISTAKES = {
    "nothing in a bushing": (BUSH, "forces.f: needs stiffness, rotational_stiffness"),
    "negative stiffness": (
        BUSH + "stiffness = [1, -2, 3]",
        "forces.f.stiffness: must be zero or positive, is -2 N/m",
    ),
    "unsymmetric": (
        BUSH + "stiffness = [[1, 2, 0], [0, 1, 0], [0, 0, 1]]",
        "forces.f.stiffness: must be symmetric: a force without a potential energy is not elastic",
    ),
    "indefinite": (
        BUSH + "damping = [[1, 2, 0], [2, 1, 0], [0, 0, 1]]",
        "forces.f.damping: must not be negative in any direction (it has a negative eigenvalue)",
    ),
    "wrong size": (
        BUSH + "matrix = [[1, 2], [2, 1]]",
        "forces.f.matrix: 6 x 6 numbers are expected, given [[1, 2], [2, 1]]",
    ),
    "twice": (
        BUSH + "stiffness = 1\nmatrix = [[1,0,0,0,0,0],[0,1,0,0,0,0],[0,0,1,0,0,0],"
        "[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]]",
        'forces.f.stiffness: is in "matrix" already; give one of them',
    ),
    "beam without material": (BEAM, "forces.f: give either material, or E and G"),
    "beam of half a material": (BEAM + "E = 1", "forces.f.G: is missing"),
    "beam without direction": (
        BEAM.replace("Iy = 1", "Iy = 2") + "E = 1\nG = 1",
        "forces.f.orientation: is missing: Iy and Iz differ",
    ),
    "beam along its direction": (
        BEAM.replace("crank.tip", "ground") + 'E = 1\nG = 1\norientation = "x"',
        "forces.f.orientation: is parallel to the beam",
    ),
    "beam of length zero": (
        BEAM.replace("rod.center", "rod") + "E = 1\nG = 1",
        "forces.f.between: its markers coincide in the placed pose: the direction of the beam is u",
    ),
    "spring of length zero": (
        LINE.replace('"ground", "rod.center"', '"crank.tip", "rod"') + "stiffness = 1",
        "forces.f.between: its markers coincide in the placed pose: the direction of the spring is",
    ),
    "stop without bounds": (STOP, 'forces.f: needs "lower", "upper" or both'),
    "stop upside down": (
        STOP + "lower = 2\nupper = 1",
        "forces.f.upper: must lie above lower: between them the stop is clear",
    ),
    "exponent": (
        STOP + "upper = 1\nexponent = 0.5",
        "forces.f.exponent: must be at least 1, is 0.5: a stop stiffest at first touch jumps",
    ),
    "damping without depth": (
        STOP + "upper = 1\ndamping = 1",
        "forces.f.depth: is missing: the penetration at which the whole damping acts",
    ),
    "negative distance": (
        GAP + "lower = -1",
        "forces.f.lower: must be positive: a distance is (give axis for a displacement)",
    ),
    "stop on a joint that lacks it": (
        STOP.replace("bearing", "guide") + "upper = 1",
        'forces.f.angle: the prismatic joint "guide" has no angle; it has: stroke',
    ),
    "spring that does nothing": (
        LINE,
        "forces.f: needs stiffness, damping or value, or spring_force or damper_force",
    ),
    "two springs in one": (
        LINE + 'stiffness = 1\nspring_force = "x"',
        'forces.f.spring_force: replaces "stiffness"; give one of them',
    ),
    "table that does not increase": (
        LINE + "spring_force = [[0, 0], [1, 1], [1, 2]]",
        "forces.f.spring_force[2]: points must increase",
    ),
    "one point": (
        LINE + "spring_force = [[0, 0]]",
        "forces.f.spring_force: at least two points are expected, given 1",
    ),
    "no pair": (
        LINE + "spring_force = [[0, 0], [1]]",
        "forces.f.spring_force[1]: a point [x, force] is expected, given [1]",
    ),
    "time in a law": (
        LINE + 'spring_force = "3*t"',
        "forces.f.spring_force: a constant is expected, not the time t",
    ),
    "wrong variable": (
        LINE + 'damper_force = "3*x"',
        'forces.f.damper_force: unknown name "x" at character 3',
    ),
    "law that is not finite": (
        LINE + 'spring_force = "log(x)"',
        'forces.f.spring_force: the value of "log(x)" is -inf at 0, not finite',
    ),
    "unknown interpolation": (
        LINE + 'spring_force = { points = [[0, 0], [1, 1]], interpolation = "akma" }',
        'forces.f.spring_force.interpolation: unknown choice "akma"; nearest: akima',
    ),
    "neither points nor file": (
        LINE + 'spring_force = { interpolation = "akima" }',
        'forces.f.spring_force: give one of "points" and "file"',
    ),
    "axes that are none": (
        PUSH + 'axes = "bodi"',
        'forces.f.axes: unknown axes "bodi"; nearest: body; allowed: global, body, crank',
    ),
    "axes of no marker": (
        PUSH + 'axes = "crank.tp"',
        'forces.f.axes: body "crank" has no marker "tp"; nearest: tip',
    ),
    "reaction on itself": (
        PUSH + 'reaction = "crank.center"',
        'forces.f.reaction: is on "crank" like the force itself: the two would cancel',
    ),
    "reaction nowhere": (
        PUSH + 'reaction = "rid"',
        'forces.f.reaction: unknown body "rid"; nearest: rod',
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_told(name, tmp_path):
    text, sentence = MISTAKES[name]
    assert message(tmp_path, text=GOOD + text + "\n").startswith(sentence)


def test_a_variable_that_is_a_parameter_too():
    made = Model("x", parameters={"x": 3})
    made.add_body("a", mass=1, inertia=[1, 1, 1], position=[1, 0, 0])
    with pytest.raises(SceneError, match="is the variable of this force characteristic and"):
        made.add_force("f", "spring-damper", between=["ground", "a"], spring_force="x**2")
