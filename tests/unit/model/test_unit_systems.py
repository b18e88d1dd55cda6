"""One machine told in any unit system compiles to the same tables and survives being written."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.linalg import expm

import flexmb
from flexmb.engine.compile import compile_system
from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.functions.function import read_function
from flexmb.model.reading import ReadContext
from flexmb.model.scenes.conversion import gravity_in_words
from flexmb.units import SI, UNIT_SYSTEMS, parse_unit, unit_system

SAME = 1e-13  # of the largest entry of a table: numbers are scaled by factors of fifteen digits


def told(system):
    """A scene with every kind of number, its values those of SI whatever the system."""

    def u(value, unit):
        return value / system.scale(unit)

    return {
        "title": "everything",
        "units": system.name,
        "gravity": [0, u(-9.81, "m/s^2"), 0],
        "parameters": {"r": u(0.2, "m"), "w": u(3.0, "rad/s"), "T": u(0.5, "s"), "F": u(7.0, "N")},
        "bodies": {
            "a": {
                "mass": u(2.0, "kg"),
                "inertia": [u(k, "kg m^2") for k in (0.1, 0.2, 0.25)],
                "center": ["r/2", 0, 0],
                "position": ["r", u(0.1, "m"), 0],
                "velocity": [u(1.0, "m/s"), 0, "r*w"],
                "angular_velocity": ["w", 0, 0],
                "markers": {"tip": {"position": ["2*r", 0, 0]}},
            },
            "b": {
                "shape": {"type": "box", "size": [u(k, "m") for k in (0.3, 0.2, 0.1)]},
                "density": u(7850.0, "kg/m^3"),
                "initial": {"center": {"velocity": [0, "2*r*w", 0], "axes": "body"}},
            },
        },
        "joints": {
            "pin": {"type": "cylindrical", "between": ["ground", "a"], "axis": "x"},
        },
        "drivers": {
            "turn": {"joint": "pin", "angle": "w*t + 0.1*sin(w*t)"},
            "slide": {"joint": "pin", "stroke": "r*step(t, 0, 0, T, 1)"},
        },
        "forces": {
            "f": {
                "type": "force",
                "at": "b",
                "value": [
                    "F*cos(w*t)",
                    {"type": "harmonic", "amplitude": "F", "frequency": u(2.0, "Hz")},
                    {"type": "polynomial",
                     "coefficients": [u(1.0, "N"), u(2.0, "N/s"), u(3.0, "N/s^2")]},
                ],
            },
            "t": {
                "type": "torque",
                "at": "b",
                "value": [
                    u(4.0, "N m"),
                    {"type": "step", "t1": "T", "y1": "F*r"},
                    {"type": "constant", "value": u(5.0, "N m")},
                ],
            },
            "s": {
                "type": "spring-damper",
                "between": ["ground", "a.tip"],
                "stiffness": u(300.0, "N/m"),
                "damping": u(20.0, "N s/m"),
                "free_length": "r",
            },
        },
        "sensors": {
            "x": {"type": "position", "of": "b"},
            "v": {"type": "velocity", "of": "b"},
            "turn": {"type": "angle", "joint": "pin"},
        },
        "check": [
            {"sensor": "v.x", "time": "T/2", "value": "r*w", "tolerance": u(0.1, "m/s"),
             "source": "none"},
            {"sensor": "turn", "time": 0, "value": "90 deg", "tolerance": 0.1, "source": "none"},
        ],
        "dynamics": {"duration": "2*T", "step": "T/1000"},
        "view": {"time": "T"},
    }  # fmt: skip


@pytest.fixture(scope="module")
def wanted():
    return Model.from_scene_dict(told(SI))


OTHERS = [name for name in UNIT_SYSTEMS if name != "SI"]


def leaves(table):
    """All arrays of nested tuples, dicts and structured arrays, by their place."""
    if isinstance(table, dict):
        yield from leaves(tuple(table[name] for name in sorted(table)))
    elif isinstance(table, tuple):
        names = getattr(table, "_fields", range(len(table)))
        for name, part in zip(names, table, strict=True):
            yield from ((f"{name}.{at}", leaf) for at, leaf in leaves(part))
    elif isinstance(table, np.ndarray) and table.dtype.names:
        yield from ((name, table[name]) for name in table.dtype.names)
    elif table is not None:
        yield "", np.asarray(table)


@pytest.mark.parametrize("name", OTHERS)
def test_all_systems_compile_to_the_same_tables(name, wanted):
    model = Model.from_scene_dict(told(unit_system(name)))
    mine = dict(leaves(compile_system(model).system._replace(functions=None)))
    for place, table in leaves(compile_system(wanted).system._replace(functions=None)):
        scale = np.abs(table[np.isfinite(table)]).max(initial=1e-300)  # scratch is NaN
        np.testing.assert_allclose(mine[place], table, atol=SAME * scale, err_msg=place)


@pytest.mark.parametrize("name", OTHERS)
def test_functions_of_time_are_the_same(name, wanted):
    """Value and both derivatives in SI, over SI time."""
    model = Model.from_scene_dict(told(unit_system(name)))
    functions = [
        [spec.function for spec in m.drivers.values()]
        + [f for key in "ft" for f in m.forces[key].value]
        for m in (model, wanted)
    ]
    for mine, other in zip(*functions, strict=True):
        for t in (0.0, 0.3, 0.7):
            assert mine.value(t) == pytest.approx(other.value(t), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", OTHERS)
def test_times_and_checks_are_the_same(name, wanted):
    model = Model.from_scene_dict(told(unit_system(name)))
    assert model.dynamics.duration == pytest.approx(1.0, rel=SAME)
    assert model.dynamics.step == pytest.approx(5e-4, rel=SAME)
    assert model.view.time == pytest.approx(0.5, rel=SAME)
    speed, angle = model.checks
    assert (speed.time, speed.value, speed.tolerance) == pytest.approx((0.25, 0.6, 0.1), rel=SAME)
    assert angle.value == pytest.approx(math.pi / 2, rel=SAME)
    assert angle.tolerance == 0.1


@pytest.mark.parametrize("name", UNIT_SYSTEMS)
def test_what_is_written_is_read_again_to_the_last_bit(name):
    """A run is continued from the scene in its result: it must be the same run."""
    model = Model.from_scene_dict(told(unit_system(name)))
    written = json.loads(json.dumps(model.to_scene_dict()))
    again = Model.from_scene_dict(written)
    assert again.to_scene_dict() == model.to_scene_dict()
    prints = [compile_system(m).layout.fingerprint for m in (model, again)]
    assert prints[0] == prints[1]
    assert again.dynamics == model.dynamics and again.checks == model.checks


def test_a_written_scene_keeps_its_units_and_round_numbers():
    model = Model("m", units="mm-t-s")
    model.add_body(
        "b", mass=0.003, inertia=[1.5, 1.5, 2.2], position=[25.4, 0, 0],
        markers={"m": {"position": [12.7, 0.1, 0]}},
    )  # fmt: skip
    model.set_gravity("earth -z")
    scene = model.to_scene_dict()
    assert scene["units"] == "mm-t-s"
    assert scene["gravity"] == [0, 0, -9806.65]
    assert scene["bodies"]["b"]["mass"] == 0.003
    assert scene["bodies"]["b"]["position"] == [25.4, 0, 0]
    assert scene["bodies"]["b"]["inertia"][2][2] == 2.2
    assert scene["bodies"]["b"]["markers"]["m"]["position"] == [12.7, 0.1, 0]
    assert model.bodies["b"].position[0] == 0.0254


def test_python_and_file_read_alike():
    model = Model("m", units="mm-kg-ms", parameters={"r": "3 cm", "w": "1500 rpm"})
    assert model.parameters == pytest.approx({"r": 30.0, "w": math.pi * 0.05}, rel=1e-15)
    model.add_body("b", shape={"type": "sphere", "radius": "r"}, material="steel")
    assert model.bodies["b"].shape.radius == pytest.approx(0.03, rel=1e-15)
    model.set_dynamics(duration=5, step="1 us")
    assert model.dynamics.duration == 5e-3
    assert model.dynamics.step == pytest.approx(1e-6, rel=1e-15)
    model.add_sensor("x", "position", of="b")
    model.add_check(sensor="x.x", time=1, value=2, tolerance="1 um", source="none")
    check = model.checks[0]
    assert (check.time, check.value) == (1e-3, 2e-3)
    assert check.tolerance == pytest.approx(1e-6, rel=1e-15)


MESH = {"interfaces": {"a": "A"}, "mesh": "rod.msh"}
SOFT = {"E": 70e3, "nu": 0.3, "density": "2.7 g/cm^3"}
TUBE = {"all": {"type": "tube", "radius": 20, "inner": "15 mm"}}


def test_meshes_have_their_own_units_and_materials_and_sections_the_scenes():
    model = Model("m", units="mm-t-s")
    model.add_body("own", **MESH, units="in-lbf-s", material=SOFT)
    model.add_body("scene", **MESH, material="steel", sections=TUBE)
    own, scene = model.bodies["own"], model.bodies["scene"]
    assert (own.units, scene.units) == ("in-lbf-s", "mm-t-s")
    assert own.material.E == 70e9
    assert own.material.density == pytest.approx(2700, rel=1e-15)
    assert scene.sections["all"].inner == 0.015
    written = model.to_scene_dict()["bodies"]
    assert written["own"]["material"]["E"] == 70e3
    assert written["scene"]["sections"]["all"]["radius"] == 20
    assert written["scene"]["material"] == "steel"


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("30 deg", "rad", math.pi / 6),
        ("1/12 rev", "rad", math.pi / 6),
        ("2*r mm", "m", 6e-3),
        ("(r + 1) in", "m", 0.1016),
        ("-r ft/s^2", "m/s^2", -0.9144),
        ("1e3 N m/deg", "N m/rad", 1e3 * 180 / math.pi),
        ("210 GPa", "Pa", 210e9),
        ("2 t", "kg", 2000.0),
        ("  5   kg  m^2 ", "kg m^2", 5.0),
    ],
)
def test_texts_with_units(text, unit, value):
    for system in UNIT_SYSTEMS.values():
        function = read_function(text.replace("t", "tonne") if text == "2 t" else text,
                                 ReadContext({"r": 3.0}, system), unit)  # fmt: skip
        assert function.constant == pytest.approx(value, rel=1e-14)


def test_time_is_not_a_tonne_in_functions():
    assert read_function("360*t deg", {}, "rad").value(2.0)[0] == pytest.approx(4 * math.pi)
    with pytest.raises(SceneError, match="an operator is missing"):
        read_function("2 t", {}, "kg")


def test_time_runs_in_the_units_of_the_scene():
    terms = ReadContext({}, unit_system("mm-kg-ms"))
    value, rate, second = read_function("t**2", terms, "m").value(0.004)  # 4 ms: 16 mm
    assert (value, rate, second) == pytest.approx((0.016, 8.0, 2000.0))


@pytest.mark.parametrize("down", ["x", "-y", "+z"])
def test_standard_gravity(down):
    """In any units: 9.80665 m/s^2 (3rd CGPM, 1901)."""
    sign = -1.0 if down.startswith("-") else 1.0
    wanted = [sign * 9.80665 * (letter == down[-1]) for letter in "xyz"]
    for name in UNIT_SYSTEMS:
        assert Model("m", units=name, gravity=f"earth {down}").gravity == pytest.approx(wanted)


def test_gravity_is_said():
    assert gravity_in_words(None, SI) == gravity_in_words("none", SI) == "gravity: none"
    words = gravity_in_words([0, 0, -9810.0], unit_system("mm-t-s"))
    assert words == "gravity: (0, 0, -9810) mm/s²"


@pytest.mark.parametrize("system", UNIT_SYSTEMS.values(), ids=lambda system: system.name)
@pytest.mark.parametrize("unit", ["A", "V", "ohm", "H", "N m/A", "V s"])
def test_the_label_of_an_electrical_quantity_is_a_unit_of_its_system(system, unit):
    """Current is in A in all systems; a volt of a system is its power per A."""
    label = parse_unit(system.label(unit))
    assert label.factor == pytest.approx(system.scale(unit), rel=1e-12)
    assert label.dimension == parse_unit(unit).dimension


@pytest.mark.parametrize("units", ["SI", "mm-t-s", "mm-kg-ms", "in-lbf-s"])
def test_a_motor_with_a_current_runs_alike_in_any_system(units):
    """L di/dt = U - R i - k ω and J dω/dt = k i, beside the matrix exponential."""
    scene = {
        "title": "motor",
        "units": units,
        "parameters": {"k": "0.05 N m/A", "R": "2 ohm", "L": "4 mH", "U": "12 V"},
        "bodies": {"rotor": {"mass": "1 kg", "inertia": ["1e-3 kg m^2"] * 3}},
        "joints": {"axle": {"type": "revolute", "between": ["ground", "rotor"], "axis": "z"}},
        "sensors": {"speed": {"type": "angular_velocity", "of": "rotor"}},
        "states": {"i": {"rate": "(U - R*i - k*speed.z)/L", "start": "1 A", "unit": "A"}},
        "forces": {"torque": {"type": "torque", "at": "rotor", "value": [0, 0, "k*i"]}},
        "dynamics": {"duration": "0.2 s", "outputs": 50, "accuracy": 1e-9},
    }
    k, R, L, U, J = 0.05, 2.0, 4e-3, 12.0, 1e-3
    A = np.array([[-R / L, -k / L], [k / J, 0.0]])
    steady = np.linalg.solve(A, [-U / L, 0.0])
    current, speed = steady + expm(0.2 * A) @ ([1.0, 0.0] - steady)
    result = flexmb.simulate(Model.from_scene_dict(scene))
    assert result.unit("i") == "A"
    assert result["i"][-1] == pytest.approx(current, rel=1e-7)
    assert result["speed.z"][-1] == pytest.approx(speed * unit_system(units).time, rel=1e-7)
