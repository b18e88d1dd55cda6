"""Inverse dynamics returns the forces of a forward run; what it cannot do is refused."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from femeshes import line
from mechanisms import stewart
from restscenes import FAR, G
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import AssemblyError, ResultFileError, SceneError
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

TORQUES = {"shoulder": "3*sin(4*t)", "elbow": "1 + 2*cos(3*t)"}


def arm(torques=True, place=(0, 0, 0), plane=None, flexible=None):
    """Two links in a plane or in space, moved by torques."""
    made = Model("arm", gravity=[0, -G, 0], plane=plane)
    made.add_marker("ground.base", position=list(place))
    x, y, z = place
    made.add_body("upper", mass=2.0, center=[0.4, 0, 0], inertia=[0.1, 0.2, 0.2],
                  position=[x, y, z], markers={"end": {"position": [0.8, 0, 0]}})  # fmt: skip
    if flexible is None:
        made.add_body("lower", mass=1.0, center=[0.3, 0.02, 0], inertia=[0.05, 0.1, 0.1],
                      position=[x + 0.8, y, z])  # fmt: skip
    else:
        made.add_body("lower", flexible, position=[x + 0.8, y, z])
    end = "lower" if flexible is None else "lower.root"
    made.add_joint("shoulder", "revolute", between=["ground.base", "upper"], axis="z")
    made.add_joint("elbow", "revolute", between=["upper.end", end], axis="z")
    if torques:
        made.add_force("shoulder", "torque", at="upper", value=[0, 0, TORQUES["shoulder"]])
        made.add_force("elbow", "torque", at=end, reaction="upper.end",
                       value=[0, 0, TORQUES["elbow"]])  # fmt: skip
    return made


def torque(result, name):
    """Of a drive about its axis, on marker J."""
    return result.reaction(f"drive_{name}", on="J").moment[:, 2]


@pytest.mark.parametrize("place", [(0, 0, 0), FAR])
@pytest.mark.parametrize("plane", [None, "xy"])
def test_inverse_of_forward_is_the_torque(place, plane):
    place = place if plane is None else (*place[:2], 0.0)
    run = flexmb.simulate(arm(place=place, plane=plane), duration=1.0, outputs=50, accuracy=1e-7)
    with warnings.catch_warnings():  # no false alarm
        warnings.simplefilter("error")
        back = flexmb.inverse_dynamics(arm(False, place, plane), run, drives=["shoulder", "elbow"])
    t = run.time
    tolerance = 1e-7 * (1e2 if place[0] else 1.0)
    np.testing.assert_allclose(torque(back, "shoulder"), 3 * np.sin(4 * t), atol=tolerance)
    np.testing.assert_allclose(torque(back, "elbow"), 1 + 2 * np.cos(3 * t), atol=tolerance)
    for joint in ("shoulder", "elbow"):
        one, other = (r.reaction(joint, on="J").force for r in (run, back))
        np.testing.assert_allclose(one, other, atol=tolerance)
    with_torques = flexmb.inverse_dynamics(
        arm(True, place, plane), run, drives=["shoulder", "elbow"]
    )
    np.testing.assert_allclose(torque(with_torques, "elbow"), 0.0, atol=tolerance)


def test_inverse_of_a_flexible_arm():
    beam = reduce(
        line(8, end=(0.6, 0, 0)), modes=4, interfaces={"root": "root"}, material="steel",
        sections={"all": rectangle(0.01, 0.01)},
    )  # fmt: skip
    run = flexmb.simulate(arm(flexible=beam), duration=0.3, outputs=30, accuracy=1e-5)
    back = flexmb.inverse_dynamics(arm(False, flexible=beam), run, drives=["shoulder", "elbow"])
    np.testing.assert_allclose(torque(back, "shoulder"), 3 * np.sin(4 * run.time), atol=1e-6)
    np.testing.assert_allclose(torque(back, "elbow"), 1 + 2 * np.cos(3 * run.time), atol=1e-6)


def test_forces_of_legs_agree_with_the_kinematic_analysis():
    made = stewart("UTS")
    for k in range(6):
        made.add_driver(f"leg{k}", joint=f"slide{k}", stroke=f"0.05*sin(2*t + {k})")
    with_reactions = flexmb.kinematics(made, duration=1.0, outputs=20)
    again = flexmb.inverse_dynamics(made, with_reactions)
    for k in range(6):
        one, other = (r.reaction(f"leg{k}", on="J").force for r in (with_reactions, again))
        np.testing.assert_allclose(one, other, atol=1e-8 * np.abs(one).max())


def test_what_nothing_drives_is_named():
    run = flexmb.simulate(arm(), duration=0.1, outputs=5, accuracy=1e-4)
    with pytest.raises(AssemblyError, match=r"leave 1 motion free.*inverse dynamics.*elbow"):
        flexmb.inverse_dynamics(arm(False), run, drives=["shoulder"])
    with pytest.raises(SceneError, match=r"no such joint.*shoulder"):
        flexmb.inverse_dynamics(arm(False), run, drives=["sholder"])
    other = Model("other")
    other.add_body("thing", mass=1.0, inertia=[1, 1, 1])
    with pytest.raises(ResultFileError, match=r"other bodies"):
        flexmb.inverse_dynamics(other, run)


def test_a_motion_that_does_not_meet_the_joints_is_reported():
    run = flexmb.simulate(arm(), duration=0.1, outputs=5, accuracy=1e-6)
    with pytest.warns(match=r"does not meet the joints.* 0\.3 m"):
        flexmb.inverse_dynamics(arm(False, (0.3, 0, 0)), run, drives=["shoulder", "elbow"])


def stretched(tip):
    """Two links of 1 m whose elbow turns from -1 rad through the stretched pose."""
    made = Model("stretched arm", plane="xy", gravity=[0, -G, 0])
    for k, name in enumerate(("upper", "lower")):
        made.add_body(name, mass=1.0, inertia=[0.1] * 3, center=[0.5, 0, 0], position=[k, 0, 0],
                      orientation={"axis": "z", "angle": -float(k)},
                      markers={"end": {"position": [1, 0, 0]}})  # fmt: skip
    made.add_joint("shoulder", "revolute", between=["ground", "upper"])
    made.add_joint("elbow", "revolute", between=["upper.end", "lower"])
    if tip:
        made.add_driver("tip", marker="lower.end", x="0", y="0")
    else:
        made.add_driver("shoulder", joint="shoulder", angle="0.1*t")
        made.add_driver("elbow", joint="elbow", angle="-1 + t")
    return made


@pytest.mark.parametrize(("outputs", "word"), [(40, "passes"), (67, "comes near")])
def test_a_singular_pose_on_the_way_is_told_with_its_time_and_joints(outputs, word):
    run = flexmb.kinematics(stretched(False), duration=2.0, outputs=outputs)
    with pytest.warns(
        match=rf"{word} a singular pose at t = (1|0\.98\d+|1\.01\d+) s held by .*tip"
    ):
        flexmb.inverse_dynamics(stretched(True), run)


ARM = """
gravity = [0, -9.80665, 0]
[bodies.bar]
mass = 2.0
center = [0.5, 0, 0]
inertia = [0.1, 0.2, 0.2]
[joints.pin]
type = "revolute"
between = ["ground", "bar"]
axis = "z"
[drivers.motor]
joint = "pin"
angle = "0.5*t**2"
[sensors.bar]
type = "angle"
joint = "pin"
[dynamics]
duration = 1.0
outputs = 10
"""


def inverse(*words):
    return CliRunner().invoke(app, ["inverse", *words, "--no-picture"])


def test_the_command_gives_the_forces_of_drivers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene, free = tmp_path / "arm.toml", tmp_path / "free.toml"
    scene.write_text(ARM, encoding="utf-8")
    free.write_text(ARM.partition("[drivers")[0] + "[sensors" + ARM.partition("[sensors")[2],
                    encoding="utf-8")  # fmt: skip
    done = inverse("arm.toml", "-o", "first")
    assert done.exit_code == 0, done.output
    run = flexmb.load_result("first")
    torque_of_motor = 0.2 + 2.0 * 0.5**2 + 2.0 * 9.80665 * 0.5 * np.cos(0.5 * run.time**2)
    np.testing.assert_allclose(run.reaction("motor").moment[:, 2], torque_of_motor, rtol=1e-12)
    table = next(line for line in done.output.splitlines() if line.strip().startswith("motor"))
    largest = torque_of_motor[np.abs(torque_of_motor).argmax()]
    assert table.split()[1:3] == ["angle", f"{largest:.6g}"]
    again = inverse("free.toml", "--along", "first", "--drive", "pin", "-o", "second")
    assert again.exit_code == 0, again.output
    assert "drive_pin" in again.output and "energy balance error" not in again.output
    second = flexmb.load_result("second").reaction("drive_pin").moment[:, 2]
    np.testing.assert_allclose(second, torque_of_motor, rtol=1e-12)


def test_a_run_of_the_scene_stays_beside_its_inverse_dynamics(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(ARM, encoding="utf-8")
    flexmb.run_scene("arm.toml", pictures=False)
    before = (tmp_path / "out/arm/result.h5").read_bytes()
    assert inverse("arm.toml").exit_code == 0
    assert inverse("arm.toml", "--along", "out/arm").exit_code == 0
    assert (tmp_path / "out/arm/inverse/result.h5").is_file()
    (tmp_path / "out/arm/bar.flexbody.h5").write_bytes(b"as reduced there")
    (tmp_path / "out/arm/inverse/result.h5").unlink()
    assert inverse("arm.toml").exit_code == 0
    assert (tmp_path / "out/arm/inverse/bar.flexbody.h5").read_bytes() == b"as reduced there"
    done = inverse("arm.toml", "--along", "out/arm", "-o", "out/arm")
    assert done.exit_code == 2
    assert "is the folder of the run whose motion is taken, which would be lost" in done.stderr
    assert (tmp_path / "out/arm/result.h5").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["free.toml"], "leave 1 motion free at t = 0, and a kinematic analysis needs all"),
        (["free.toml", "--along", "none"], "none"),
        (["free.toml", "--drive", "pin"], "needs a motion"),
        (["free.toml", "--drive", "pni", "--along", "run"], "nearest: pin"),
        (
            ["free.toml", "--along", "run"],
            "inverse dynamics needs all of them driven: add a driver",
        ),
    ],
)
def test_mistakes_of_the_command(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    text = ARM.partition("[drivers")[0] + "[sensors" + ARM.partition("[sensors")[2]
    (tmp_path / "free.toml").write_text(text, encoding="utf-8")
    if "run" in words:
        flexmb.run_scene("free.toml", output="run", pictures=False)
    done = inverse(*words)
    assert done.exit_code == 2, done.output
    assert message in done.stderr


def test_bodies_of_a_locked_mechanism_are_not_said_to_bend_by_nothing(tmp_path):
    scene = "cases/misaligned_four_bar/scene.toml"
    run = inverse(scene, "-o", str(tmp_path / "out"))
    assert "the mechanism is locked" in " ".join(run.output.split())
    assert "would bend it by" not in " ".join(run.output.split())
