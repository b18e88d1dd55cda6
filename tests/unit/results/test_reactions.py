"""Reactions by name, side and axes; the signs by hand on what is in equilibrium."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mechanisms import crank_slider
from resultfiles import FakeLayout, block
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import FlexmbWarning, ResultFileError
from flexmb.model.markers import rotation_matrix
from flexmb.results import Result
from flexmb.results.channels import Columns, marker_pairs
from flexmb.results.result import NOT_UNIQUE
from flexmb.results.writer import ResultWriter

SCENE = {
    "title": "two names",
    "joints": {
        "pin": {"type": "revolute", "between": ["crank.tip", "rod.big_end"]},
        "motor": {"type": "revolute", "between": ["ground", "crank"]},
    },
    "drivers": {"motor": {"joint": "motor", "angle": "t"}},
}


@pytest.fixture
def result(tmp_path: Path) -> Result:
    layout = dataclasses.replace(
        FakeLayout(), reactions=("joints.pin", "joints.motor", "drivers.motor")
    )
    rows = block(0, 3, layout)
    rows.reactions[:] = np.arange(36.0) + 100 * np.arange(3.0)[:, None]
    with ResultWriter(tmp_path / "r.h5", layout, 3, scene=SCENE) as out:
        out.append(rows)
    return Result(out.path)


def test_each_side_has_its_own_numbers(result: Result) -> None:
    on_rod = result.reaction("pin", on="rod")
    assert (on_rod.on, on_rod.by) == ("rod.big_end", "crank.tip")
    np.testing.assert_array_equal(on_rod.force[1], [100, 101, 102])
    np.testing.assert_array_equal(on_rod.moment[1], [103, 104, 105])
    on_crank = result.reaction("joints.pin", on="crank.tip")
    assert (on_crank.on, on_crank.by) == ("crank.tip", "rod.big_end")
    np.testing.assert_array_equal(on_crank.force[0], [6, 7, 8])
    np.testing.assert_array_equal(result.reaction("pin").force, on_rod.force)
    np.testing.assert_array_equal(result.reaction("pin", on="I").moment, on_crank.moment)
    np.testing.assert_array_equal(result.reaction("drivers.motor", "ground").force[0], [30, 31, 32])


def test_channels_are_the_same_numbers(result: Result) -> None:
    assert result.reactions == ("pin", "joints.motor", "drivers.motor")
    assert len(result.channels("reactions")) == 36
    for joint, body in (("pin", "rod"), ("pin", "crank"), ("drivers.motor", "ground")):
        acting = result.reaction(joint, on=body)
        for c, axis in enumerate("xyz"):
            name = f"{joint}.{body}.force.{axis}"
            np.testing.assert_array_equal(result[name], acting.force[:, c])
            np.testing.assert_array_equal(
                result[name.replace("force", "moment")], acting.moment[:, c]
            )
    assert result.unit("pin.rod.force.x") == "N"
    assert result.unit("pin.rod.moment.x") == "N m"


def test_unknown_joints_and_bodies_are_named(result: Result) -> None:
    with pytest.raises(ResultFileError, match='no reaction of "pim".*nearest: pin'):
        result.reaction("pim")
    with pytest.raises(ResultFileError, match='joints.pin does not act on "rot"; nearest: rod'):
        result.reaction("pin", on="rot")
    with pytest.raises(ResultFileError, match="nearest: pin.rod.force.x"):
        result["pin.rod.forse.x"]


def test_couplers_act_on_their_joints(tmp_path: Path) -> None:
    """One reaction for each joint, on its markers."""
    scene = SCENE | {
        "couplers": {"mesh": {"type": "gear", "joints": ["pin", "motor"], "ratio": 2}},
        "forces": {"coil": {"joint": "pin", "about": "second_axis"}},
    }
    names = ("couplers.mesh.pin", "couplers.sum.motor.second_angle", "forces.coil")
    layout = dataclasses.replace(FakeLayout(), reactions=names)
    rows = block(0, 3, layout)
    rows.reactions[:] = np.arange(36.0)
    with ResultWriter(tmp_path / "r.h5", layout, 3, scene=scene) as out:
        out.append(rows)
    found = Result(out.path)
    assert found.reactions == ("mesh.pin", "sum.motor.second_angle", "coil")
    for name, on, by in (
        ("mesh.pin", "rod.big_end", "crank.tip"),
        ("sum.motor.second_angle", "crank", "ground"),
        ("coil", "rod.big_end", "crank.tip"),
    ):
        acting = found.reaction(name, on="J")
        assert (acting.on, acting.by) == (on, by)
    np.testing.assert_array_equal(found["mesh.pin.rod.moment.z"], [5, 5, 5])


def test_reactions_that_redundant_equations_share_are_marked(tmp_path: Path, result) -> None:
    assert result.reactions_not_unique == () and result.reaction("pin").unique
    layout = dataclasses.replace(
        FakeLayout(), reactions=("joints.pin", "joints.motor", "drivers.motor")
    )
    with ResultWriter(tmp_path / "shared.h5", layout, 3, scene=SCENE) as out:
        out.append(block(0, 3, layout))
        out.finish({NOT_UNIQUE: "joints.pin, drivers.motor"}, "finished")
    shared = Result(out.path)
    assert shared.reactions_not_unique == ("pin", "drivers.motor")
    assert [shared.reaction(name).unique for name in shared.reactions] == [False, True, False]
    shown = CliRunner().invoke(app, ["info", str(out.path)]).stdout
    assert "reactions not unique at: pin, drivers.motor" in shown


def test_a_run_marks_the_reactions_of_a_plane_mechanism_in_space() -> None:
    """In-plane forces are unique: those of the mechanism without redundancy, R-S-C-T."""
    model = crank_slider("RRRT", driven=True)
    with pytest.warns(
        FlexmbWarning, match="3 of 21 constraint equations are redundant.* bearing, pin, wrist"
    ):
        shared = flexmb.simulate(model, duration=0.2, step=1e-3, outputs=10)
    assert shared.reactions_not_unique == ("bearing", "pin", "wrist", "guide")
    assert shared.reaction("motor").unique and not shared.reaction("pin").unique
    cured = crank_slider("RSCT", driven=True)
    alone = flexmb.simulate(cured, duration=0.2, step=1e-3, outputs=10)
    assert alone.reactions_not_unique == ()
    for name in ("bearing", "pin", "wrist"):
        forces = (found.reaction(name).force[:, :2] for found in (shared, alone))
        np.testing.assert_allclose(*forces, rtol=0, atol=1e-6)


def weighted_bar(**joint: object) -> flexmb.Model:
    """A bar of 2 kg and 3 m along x from its bearing, which a motor turns."""
    model = flexmb.Model("bar", gravity=[0, -10, 0])
    model.add_body("bar", mass=2.0, center=[1.5, 0, 0], inertia=[0.1, 1.5, 1.5])
    model.add_joint("bearing", "revolute", between=["ground", "bar"], axis="z")
    model.add_driver("motor", joint="bearing", **joint)
    model.add_sensor("bar", "position", of="bar.center")
    model.set_dynamics(duration=0.5, step=1e-3, outputs=5)
    return model


def test_a_held_bar_by_hand() -> None:
    """The bearing carries the weight, 20 N upwards; the motor the moment, 20 N · 1.5 m."""
    result = flexmb.simulate(weighted_bar(angle=0.0))
    bearing, motor = result.reaction("bearing", on="bar"), result.reaction("motor", on="bar")
    np.testing.assert_allclose(bearing.force, [[0, 20, 0]] * 6, atol=1e-9)
    np.testing.assert_allclose(bearing.moment, 0.0, atol=1e-9)
    np.testing.assert_allclose(motor.force, 0.0, atol=1e-9)
    np.testing.assert_allclose(motor.moment, [[0, 0, 30]] * 6, atol=1e-9)
    on_ground = result.reaction("bearing", on="ground")
    np.testing.assert_allclose(on_ground.force, -bearing.force, atol=1e-9)


def test_a_turning_bar_by_hand_in_the_axes_of_each_side() -> None:
    """Weight, and m r w² towards the bearing: 2 kg · 1.5 m · (4/s)² = 48 N, along the bar."""
    result = flexmb.simulate(weighted_bar(angle="4*t"))
    on_bar, on_ground = (result.reaction("bearing", on=body) for body in ("bar", "ground"))
    turn = 4 * result.time
    weight = 20 * np.column_stack([np.sin(turn), np.cos(turn), 0 * turn])  # in the bar's axes
    np.testing.assert_allclose(on_bar.force, weight + [-48, 0, 0], atol=1e-6)
    A = np.array([rotation_matrix(p) for p in result.q[:, 3:7]])
    in_world = np.einsum("nij,nj->ni", A, on_bar.force)
    np.testing.assert_allclose(on_ground.force, -in_world, atol=1e-9)
    torque = result["motor.bar.moment.z"]
    np.testing.assert_allclose(torque, 30 * np.cos(turn), atol=1e-6)
    np.testing.assert_allclose(result["motor.ground.moment.z"], -torque, atol=1e-9)
    power = np.trapezoid(4 * 30 * np.cos(np.linspace(0, 2, 10001)), dx=0.5 / 10000)
    np.testing.assert_allclose(result.energy["driver_work"][-1], power, rtol=1e-5)
    assert np.abs(result.balance).max() < 1e-4


def test_reactions_tables_and_durations_are_in_the_scenes_units(tmp_path: Path) -> None:
    """The held bar in mm, kg and ms: 20 N are 0.02 kN, 30 N m are 30 kN mm, 0.5 s are 500."""
    model = flexmb.Model("bar", units="mm-kg-ms", gravity=[0, -0.01, 0])
    model.add_body("bar", mass=2, center=[1500, 0, 0], inertia=[1e5, 1.5e6, 1.5e6])
    model.add_joint("bearing", "revolute", between=["ground", "bar"], axis="z")
    model.add_driver("motor", joint="bearing", angle=0.0)
    model.add_sensor("bar", "position", of="bar.center")
    model.set_dynamics(duration=500, step=1, outputs=5)
    result = flexmb.simulate(model, output=tmp_path)
    force, moment = result.reaction("bearing", on="bar")[:2]
    np.testing.assert_allclose(force, [[0, 0.02, 0]] * 6, atol=1e-12)
    np.testing.assert_allclose(result["motor.bar.moment.z"], 30, atol=1e-9)
    assert result.unit("motor.bar.moment.z") == "kN mm"
    assert result.unit("bar.r.x") == "mm"
    header = result.to_csv(tmp_path / "x.csv", ["bearing.bar.force.y"]).read_text().splitlines()[0]
    assert header == "time [ms],bearing.bar.force.y [kN]"
    done = flexmb.resume(result, duration=600)
    np.testing.assert_allclose(done.time, np.arange(0, 601, 100))
    assert "0 to 600 ms" in done._repr_html_()
    with pytest.raises(flexmb.FlexmbError, match="output intervals of 100 ms, is 650 ms"):
        flexmb.resume(result, duration=650)


def test_drivers_of_markers_are_between_the_markers_that_they_name() -> None:
    layout = FakeLayout(reactions=("drivers.path", "drivers.turn", "drivers.ram"))
    drivers = {
        "path": {"marker": "arm.tip", "x": "t"},
        "turn": {"marker": "arm.tip", "relative_to": "base.eye", "angle": "t"},
        "ram": {"between": ["base.foot", "arm.eye"], "distance": "1 + t"},
    }
    found = marker_pairs(Columns.of(layout), {"drivers": drivers})
    assert [(pair.I, pair.J) for pair in found] == [
        ("ground.origin", "arm.tip"),
        ("base.eye", "arm.tip"),
        ("base.foot", "arm.eye"),
    ]
