"""The same machine in other units moves the same, and its results are in its own units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from femeshes import block

import flexmb
from flexmb import fe
from flexmb.model.lookup import global_position, place_marker
from flexmb.model.markers import rotation_matrix

SCENE = Path(__file__).parents[2] / "cases" / "rigid_slider_crank" / "scene.toml"
# The same scene in mm, kg and ms; angles stay in rad, so a check of the angle needs no change.
CHANGES = (
    ('title = "Rigid slider-crank"', 'title = "Rigid slider-crank"\nunits = "mm-kg-ms"'),
    ("r = 0.15 ", "r = 150 "),
    ("l = 0.45 ", 'l = "45 cm" '),
    ('speed = "2*pi*25"', 'speed = "1500 rpm"'),
    ('"r + 0.05", 0.05, 0.03', '"r + 50", "5 cm", 30'),
    ('"l + 0.05", 0.03, 0.02', '"l + 50", 30, 20'),
    ("[0.06, 0.08, 0.06]", "[60, 80, 60]"),
    ("tolerance = 1e-9", "tolerance = 1e-6"),
    ("tolerance = 1e-5 ", 'tolerance = "1e-5 m/s^2" '),
)
SCALES = {"slider": 1e3, "slider_velocity": 1.0, "slider_acceleration": 1e-3, "crank_angle": 1.0}


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    folder = tmp_path_factory.mktemp("units")
    text = SCENE.read_text()
    for old, new in CHANGES:
        assert old in text
        text = text.replace(old, new)
    scene = folder / "mm.toml"
    scene.write_text(text)
    knobs = {"overrides": {"dynamics.outputs": "40"}, "pictures": False}
    return [flexmb.run_scene(path, output=folder / path.stem, **knobs) for path in (SCENE, scene)]


def test_channels_times_and_energies_are_in_the_units_of_the_scene(reports):
    si, mm = (flexmb.load_result(report.result) for report in reports)
    np.testing.assert_allclose(mm.time, 1e3 * si.time, rtol=1e-12)
    for channel in si.layout.channels:
        scale = SCALES[channel.partition(".")[0]]
        largest = np.abs(si[channel]).max()
        np.testing.assert_allclose(
            mm[channel], scale * si[channel], atol=1e-9 * scale * max(largest, 1e-3)
        )
    np.testing.assert_allclose(mm.energy["kinetic"], si.energy["kinetic"], rtol=1e-9)  # J: kN mm
    np.testing.assert_allclose(mm.q, si.q, atol=1e-12)  # SI
    at = si.time[20]
    np.testing.assert_allclose(mm.pose("rod", 1e3 * at).r, si.pose("rod", at).r, atol=1e-12)
    units = [mm.unit(f"{name}.x") for name in ("slider", "slider_velocity", "slider_acceleration")]
    assert units == ["mm", "mm/ms", "mm/ms²"]
    assert mm.unit("crank_angle") == "rad" and mm.units.label("J") == "J"


def test_known_answers_are_compared_in_the_units_of_the_scene(reports):
    for si, mm in zip(*(report.checks for report in reports), strict=True):
        assert si.passed and mm.passed
        scale = SCALES[si.sensor.partition(".")[0]]
        assert mm.expected == pytest.approx(scale * si.expected, rel=1e-12)
        assert mm.time == pytest.approx(1e3 * si.time, rel=1e-12)


def test_a_simulation_goes_on_from_the_dynamics_of_a_scene_in_its_units(tmp_path):
    model = flexmb.Model("m", units="mm-kg-ms")
    model.add_body("b", mass=1, inertia=[1, 1, 1], velocity=[2, 0, 0])
    model.add_body("crank", mass=1, inertia=[1, 1, 1])
    model.add_joint("pin", "revolute", between=["ground", "crank"], axis="z")
    model.add_driver("motor", joint="pin", angle="0.1*t")
    model.add_sensor("x", "position", of="b")
    model.add_sensor("turn", "angle", joint="pin")
    model.set_dynamics(duration=4, step=0.5, outputs=4)
    result = flexmb.simulate(model, output=tmp_path, outputs=2)
    np.testing.assert_allclose(result.time, [0, 2, 4], rtol=1e-14)  # the file's duration is kept
    np.testing.assert_allclose(result["x.x"], [0, 4, 8], atol=1e-12)
    np.testing.assert_allclose(result["turn"], [0, 0.2, 0.4], atol=1e-12)
    assert repr(result).endswith("3 rows, 0..4 ms>")


def test_position_and_orientation_place_the_frame_of_the_mesh():
    """Not the centre of mass: every point s of the mesh goes to r + A s, whatever its frame."""
    mesh = block((2, 1, 1), size=(100.0, 30.0, 20.0))  # mm
    moved = fe.Mesh(mesh.points + [200.0, -50.0, 70.0], mesh.blocks, {}, mesh.element_sets)
    body = fe.reduce(
        moved, units="mm-t-s", material="steel", interfaces={"a": "x0", "b": "x1"}, modes=2
    )
    model = flexmb.Model("m")
    model.add_body(
        "bar", body, position=[1, 2, 3],
        orientation={"euler": "zxz", "angles": [0.3, 1, -2]},
    )  # fmt: skip
    A = rotation_matrix(model.bodies["bar"].orientation)
    ends = {"a": [0.2, -0.035, 0.08], "b": [0.3, -0.035, 0.08]}  # centres of the end faces, m
    for name, s in ends.items():
        found = global_position(model, place_marker(model, f"bar.{name}"))
        np.testing.assert_allclose(found, [1, 2, 3] + A @ s, atol=1e-14)
    np.testing.assert_allclose(body.center, [0.25, -0.035, 0.08], atol=1e-14)
    origin = global_position(model, place_marker(model, "bar"))
    np.testing.assert_allclose(origin, [1, 2, 3], atol=1e-15)
