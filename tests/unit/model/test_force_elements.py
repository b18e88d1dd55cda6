"""Bushings, beams, stops, laws and mutual loads as a scene says them: units, files, mistakes."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from goodscene import GOOD, message

from flexmb.engine.compile import compile_system
from flexmb.engine.kind_registry import KINDS
from flexmb.model import Model, load_scene
from flexmb.model.scenes.scene import scene_schema
from flexmb.model.scenes.sections import FORCE_TYPES

FORCES = """
[forces.bush]
type = "bushing"
between = ["ground", "crank.tip"]
stiffness = ["1e3*r", 2e3, 3e3]
rotational_stiffness = [[5, 1, 0], [1, 6, 0], [0, 0, 7]]
damping = 4
preload = [1, 0, 0]
[forces.block]
type = "bushing"
between = ["ground", "crank.tip"]
matrix = [[9, 0, 0, 0, 0, 1], [0, 9, 0, 0, 0, 0], [0, 0, 9, 0, 0, 0],
          [0, 0, 0, 4, 0, 0], [0, 0, 0, 0, 4, 0], [1, 0, 0, 0, 0, 4]]
free = "together"
[forces.beam]
type = "beam"
between = ["ground", "rod.center"]
material = "steel"
A = 1e-4
Iy = 1e-9
Iz = 2e-9
J = 3e-9
ky = 0.8
orientation = "y"
damping = 1e-3
[forces.gap]
type = "stop"
between = ["ground", "rod.center"]
lower = 0.1
upper = 2
stiffness = 100
exponent = 1.5
damping = 3
depth = 1e-3
[forces.slide]
type = "stop"
between = ["ground", "rod.center"]
axis = "x"
upper = 2
stiffness = 100
[forces.turn]
type = "rotational-stop"
joint = "bearing"
lower = "-30 deg"
upper = "400 deg"
stiffness = 100
[forces.stroke]
type = "translational-stop"
joint = "guide"
upper = 1
stiffness = 100
[forces.hard]
type = "spring-damper"
between = ["ground", "rod.center"]
spring_force = "100*x + 1000*r*x**3"
damper_force = [[-1, -5], [0, 0], [1, 9]]
value = "3*t"
[forces.tabled]
type = "spring-damper"
between = ["ground", "rod.center"]
spring_force = { points = [[-1, "-50*r"], [0, 0], [1, 90]], interpolation = "akima" }
[forces.coil]
type = "rotational-spring-damper"
joint = "bearing"
spring_force = "x/deg"
[forces.push]
type = "force"
at = "crank.tip"
value = ["t", 0, 0]
axes = "rod.center"
reaction = "rod"
"""
FORCE_KINDS = [kind.name for kind in KINDS if not kind.core]


def scene(tmp_path, text=GOOD + FORCES):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return load_scene(path)


def test_a_written_scene_says_the_same(tmp_path):
    """Every type of force survives, and compiles to the same tables to the last bit."""
    first = scene(tmp_path)
    kinds = {spec.type for spec in first.forces.values()}
    assert kinds >= {"bushing", "beam", "stop", "rotational-stop", "translational-stop"}
    again = Model.from_scene_dict(first.to_scene_dict(), tmp_path)
    assert again.forces.keys() == first.forces.keys()
    made, other = (compile_system(model) for model in (first, again))
    assert made.layout.fingerprint == other.layout.fingerprint
    assert names_of(made, "six_component_forces") == ["forces.bush", "forces.block", "forces.beam"]
    pairs = made.system.kinds["loads"].rows["other"] >= 0
    assert np.array(names_of(made, "loads"))[pairs].tolist() == ["forces.push"]


def names_of(made, kind):
    """Scene paths of the rows of a kind, in their order."""
    rows = sorted((e.row, e.n, name) for name, e in made.elements.items() if e.kind == kind)
    assert [row for row, _, _ in rows] == list(range(len(made.system.kinds[kind].rows)))
    assert all(n == 1 for _, n, _ in rows)
    return [name for _, _, name in rows]


def test_the_schema_takes_it():
    jsonschema = pytest.importorskip("jsonschema")
    known = jsonschema.Draft4Validator(scene_schema())
    assert [error.message for error in known.iter_errors(tomllib.loads(GOOD + FORCES))] == []
    wrong = tomllib.loads(GOOD + FORCES)
    wrong["forces"]["bush"]["matrix"] = [[1, 2], [3, 4]]
    assert list(known.iter_errors(wrong))


MM = """
units = "mm-t-s"
[bodies.a]
mass = 1e-3
inertia = [1, 1, 1]
position = [100, 0, 0]
[joints.guide]
type = "prismatic"
between = ["ground", "a"]
axis = "x"
[joints.hinge]
type = "in-plane"
between = ["ground", "a"]
axis = "y"
[forces.bush]
type = "bushing"
between = ["ground", "a"]
stiffness = 7
rotational_stiffness = [1, 2, 3]

[forces.gap]
type = "stop"
between = ["ground", "a"]
upper = 120
stiffness = 5
exponent = 1.5
[forces.stroke]
type = "translational-stop"
joint = "guide"
upper = 20
stiffness = 5
exponent = 2
[forces.law]
type = "spring-damper"
between = ["ground", "a"]
spring_force = "2*x + 3*x**2"
[forces.table]
type = "spring-damper"
between = ["ground", "a"]
spring_force = [[0, 0], [10, 40]]
damper_force = "0.5*v"
"""


def test_units_of_stiffness_stops_and_laws(tmp_path):
    """mm, N, N/mm, N mm, N/mm^1.5: in SI, by hand."""
    system = compile_system(scene(tmp_path, MM)).system
    bushings = system.kinds["six_component_forces"]
    K = bushings.rows["K"][0]
    np.testing.assert_allclose(np.diag(K), [7e3, 7e3, 7e3, 1e-3, 2e-3, 3e-3])
    gap, stroke, law, table = system.kinds["force_characteristics"].rows
    assert gap["upper"] == pytest.approx(0.12) and stroke["upper"] == pytest.approx(0.02)
    assert gap["k"] == pytest.approx(5.0 / 1e-3**1.5)
    assert stroke["k"] == pytest.approx(5.0 / 1e-3**2)
    assert (law["spring"], law["stored"]) == (0, -1)  # the energy of a table has a program too
    assert (table["spring"], table["stored"], table["damper"]) == (1, 2, 3)
    made = scene(tmp_path, MM)
    spring, damper = made.forces["law"].spring_force, made.forces["table"].damper_force
    assert spring.expression.value(0.01)[0] == pytest.approx(2 * 10 + 3 * 10**2)
    assert damper.expression.value(0.3)[0] == pytest.approx(0.5 * 300)
    tabled = made.forces["table"].spring_force
    assert tabled.expression.value(0.005)[0] == pytest.approx(20.0)  # N at 5 mm
    assert tabled.stored.value(0.01)[0] == pytest.approx(0.5 * 0.01 * 40.0)


def test_a_law_from_a_file(tmp_path):
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "spring.csv").write_text("x [m], F [N]\n# measured\n-1,-3\n0, 0\n\n2,9\n")
    text = GOOD + (
        '[forces.f]\ntype = "spring-damper"\nbetween = ["ground", "rod.center"]\n'
        'spring_force = { file = "laws/spring.csv", interpolation = "linear" }\n'
    )
    made = scene(tmp_path, text)
    law = made.forces["f"].spring_force
    found = [law.expression.value(x)[0] for x in (-2.0, -1.0, 0.5, 2.0, 4.0)]
    np.testing.assert_allclose(found, [-6, -3, 2.25, 9, 18])
    written = made.to_scene_dict()["forces"]["f"]["spring_force"]
    assert written == {"points": [[-1, -3], [0, 0], [2, 9]], "interpolation": "linear"}
    for lines, sentence in (
        ("0,1\n0,2\n", "line 2: points must increase, 0 does not lie after the one before"),
        ("0,1\n1,two\n", 'line 2: "two" is no finite number'),
        ("0,1\n", "laws/spring.csv: at least two points are expected, given 1"),
    ):
        (tmp_path / "laws" / "spring.csv").write_text(lines)
        assert sentence in message(tmp_path, text=text)
    (tmp_path / "laws" / "spring.csv").unlink()
    assert "forces.f.spring_force: there is no file" in message(tmp_path, text=text)


def test_scenes_without_them_pay_nothing(tmp_path):
    def rows(text):
        """How many rows of each kind of force there are; absent kinds are not there at all."""
        kinds = compile_system(scene(tmp_path, GOOD + text)).system.kinds
        return {name: len(kinds[name].rows) for name in FORCE_KINDS if name in kinds}

    assert rows("") == {}
    linear = '[forces.f]\ntype = "spring-damper"\nbetween = ["ground", "rod.center"]\n'
    assert rows(linear + "stiffness = 3\n") == {"springs": 1}
    stop = '[forces.f]\ntype = "rotational-stop"\njoint = "bearing"\nupper = 1\n'
    assert rows(stop + "stiffness = 3\n") == {"force_characteristics": 1}


def test_in_a_plane_stops_and_axes_lie_in_it():
    made = Model("plane", plane="xy")
    made.add_body("a", mass=1, inertia=[1, 1, 1], position=[1, 0, 0])
    made.add_marker("a.tilted", orientation={"axis": "x", "angle": "90 deg"})
    made.add_force("s", "stop", between=["ground", "a"], axis="z", upper=2, stiffness=1)
    made.add_force("f", "force", at="a", value=[0, 1, 0], axes="a.tilted")
    told = [str(problem) for problem in made.problems()]
    assert told[0].startswith("forces.s.axis: must lie in the plane xy")
    assert told[1].startswith("forces.f.value[1]: has a component normal to the plane xy")


def test_every_type_is_listed():
    from flexmb.workflow.listings import listing

    told = " ".join(about for about, _ in listing("forces").tables)
    assert all(name in told for name in FORCE_TYPES)
