"""Turns of joints: a run begins with those at the end of another one, a sensor with a spring's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import flexmb
from flexmb.errors import ResultFileError
from flexmb.model import Model

K, J = 0.3, 0.02


def wheel(place=(0, 0, 0), axis="z", spin=14.0, free=0.0, joint="pin", **fields):
    """A wheel with a coil spring, and a sensor of its angle."""
    along = np.eye(3)["xyz".index(axis)]
    made = Model("wheel", **fields)
    made.add_marker("ground.pin", position=list(place))
    made.add_body("wheel", mass=1.0, inertia=[J] * 3, position=list(place),
                  angular_velocity=list(spin * along))  # fmt: skip
    made.add_joint(joint, "revolute", between=["ground.pin", "wheel"], axis=axis)
    made.add_force("coil", "rotational-spring-damper", joint=joint, stiffness=K, free=free)
    made.add_sensor("turn", "angle", joint=joint)
    made.add_sensor("torque", "reaction", force="coil", quantity="moment")
    return made


@pytest.mark.parametrize(("axis", "place"), [("z", (0, 0, 0)), ("x", (1e3, 200.0, -300.0))])
def test_a_wound_spring_stays_wound(axis, place):
    """phi = v/w sin(w t): 3.6 rad and less than a turn, then 13 rad and two turns."""
    w = math.sqrt(K / J)
    for spin, end in ((14.0, 0.3), (50.0, 0.35)):
        first = flexmb.simulate(wheel(place, axis, spin), duration=end, outputs=2, accuracy=1e-8)
        then = flexmb.simulate(wheel(place, axis, spin), duration=0.2, outputs=4, accuracy=1e-8,
                               start_from=first)  # fmt: skip
        wanted = spin / w * np.sin(w * (end + then.time))
        np.testing.assert_allclose(then["turn"], wanted, rtol=1e-6)
        np.testing.assert_allclose(then["torque.z"], -K * wanted, rtol=1e-6)
        assert not any("change its start" in note for note in then.notes)


def gears(spin=9.0):
    made = Model("gears")
    for name, x in (("a", 0.0), ("b", 0.35)):
        made.add_marker(f"ground.{name}", position=[x, 0, 0])
        made.add_body(name, mass=1.0, inertia=[J] * 3, position=[x, 0, 0],
                      **({"angular_velocity": [0, 0, spin]} if name == "a" else {}))  # fmt: skip
        made.add_joint(name, "revolute", between=[f"ground.{name}", name], axis="z")
        made.add_sensor(name, "angle", joint=name)
    made.add_coupler("mesh", "gear", joints=["a", "b"], teeth=[20, 15])
    return made


def screw(spin=20.0):
    made = Model("screw")
    made.add_body("nut", mass=1.0, inertia=[J] * 3, angular_velocity=[spin, 0, 0])
    made.add_joint("thread", "screw", between=["ground", "nut"], axis="x", pitch=0.01)
    made.add_sensor("turn", "angle", joint="thread")
    made.add_sensor("way", "stroke", joint="thread")
    return made


@pytest.mark.parametrize("made", [gears, screw])
def test_wheels_and_nuts_begin_where_they_were(made):
    first = flexmb.simulate(made(), duration=1.0, outputs=2, accuracy=1e-6)
    then = flexmb.simulate(made(), duration=1.0, outputs=2, accuracy=1e-6, start_from=first)
    assert not any("change its start" in note for note in then.notes)
    for body in made().bodies:
        old, new = first.pose(body, 1.0), then.pose(body, 0.0)
        np.testing.assert_allclose(new.A, old.A, atol=1e-9)
        np.testing.assert_allclose(new.r, old.r, atol=1e-12)
    if made is screw:
        assert then["turn"][[0, -1]] == pytest.approx([20.0, 40.0])
        np.testing.assert_allclose(then["way"], 0.01 * then["turn"] / (2 * np.pi), rtol=1e-9)
    else:
        assert then["a"][[0, -1]] == pytest.approx([9.0, 18.0])


def test_turns_of_another_joint_are_left():
    first = flexmb.simulate(wheel(spin=50.0), duration=0.35, outputs=2, accuracy=1e-6)
    then = flexmb.simulate(wheel(joint="axle"), duration=0.1, outputs=2, start_from=first)
    assert abs(then["turn"][0]) <= np.pi


@pytest.mark.seconds
def test_the_sensor_of_an_equilibrium_has_the_turns_of_its_spring():
    """m g l sin x + k (x - 6) = 0 at 6.257, all but a turn; the spring has k (6 - 6.257)."""
    made = Model("pendulum", gravity=[0, -9.81, 0])
    made.add_body("bar", mass=2.0, center=[0, -0.5, 0], inertia=[0.2, 0.2, 0.3])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made.add_force("coil", "rotational-spring-damper", joint="pin", stiffness=1.0, free=6.0)
    made.add_sensor("turn", "angle", joint="pin")
    made.add_sensor("torque", "reaction", force="coil", quantity="moment")
    root = brentq(lambda x: 9.81 * math.sin(x) + x - 6.0, 6.0, 6.5, xtol=1e-14)
    found = [one.channels(["turn", "torque.z"]) for one in flexmb.equilibria(made)]
    [wound] = [one for one in found if 6.0 < one[0] < 6.5]
    np.testing.assert_allclose(wound, [root, 6.0 - root], rtol=1e-9)


@pytest.mark.seconds
def test_a_pendulum_hangs_on_a_coil_spring_that_is_wound_several_times():
    """m g l sin x + k x = 0 has 13 roots; half of them beyond a turn."""
    made = Model("pendulum", gravity=[0, -9.81, 0])
    made.add_body("bob", mass=1.0, center=[0, -1, 0], inertia=[0.01, 0.01, 0.01])
    made.add_joint("pin", "revolute", between=["ground", "bob"], axis="z")
    made.add_force("coil", "rotational-spring-damper", joint="pin", stiffness=0.05 * 9.81)
    made.add_sensor("turn", "angle", joint="pin")
    grid = np.linspace(-25.0, 25.01, 2000)
    values = np.sin(grid) + 0.05 * grid
    roots = [
        brentq(lambda x: math.sin(x) + 0.05 * x, grid[k], grid[k + 1], xtol=1e-14)
        for k in np.flatnonzero(values[:-1] * values[1:] < 0.0)
    ]
    found = sorted(one.channels(["turn"])[0] for one in flexmb.equilibria(made, starts=120))
    np.testing.assert_allclose(found, roots, atol=1e-7)
    assert len(roots) == 13


@pytest.mark.seconds
def test_turns_of_a_wheel_without_a_spring_are_one_equilibrium():
    """A stop counts the turns of the wheel, but does not act; a spring holds the other body."""
    made = Model("wheel", gravity=[0, -9.81, 0])
    made.add_body("wheel", mass=1.0, center=[0, -0.1, 0], inertia=[0.01, 0.01, 0.02])
    made.add_joint("axle", "revolute", between=["ground", "wheel"], axis="z")
    made.add_force("stop", "rotational-stop", joint="axle", upper=100.0, stiffness=1.0)
    found = flexmb.equilibria(made)
    assert len(found) == 2  # hanging, and upright


def test_second_angles_and_strokes_have_counters_of_their_own():
    made = Model("two")
    made.add_body("b", mass=1.0, inertia=[J] * 3, angular_velocity=[0, 30, 0])
    made.add_joint("cross", "universal", between=["ground", "b"], axis="z", second_axis="y")
    made.add_force("coil", "rotational-spring-damper", joint="cross", stiffness=K,
                   about="second_axis")  # fmt: skip
    made.add_sensor("first", "angle", joint="cross")
    made.add_sensor("second", "second_angle", joint="cross")
    first = flexmb.simulate(made, duration=0.4, outputs=4, accuracy=1e-7)
    then = flexmb.simulate(made, duration=0.1, outputs=2, accuracy=1e-7, start_from=first)
    assert abs(first["second"][-1]) > np.pi
    assert then["second"][0] == pytest.approx(first["second"][-1])
    assert then["first"][0] == pytest.approx(0.0, abs=1e-9)


def lifted(on="motor", angle="10*t"):
    """A train of two gears, a rack on the last wheel; a screw and a coil spring that turn with
    them: the driver turns one of the wheels."""
    made = Model("train")
    for name, x in (("motor", 0.0), ("idler", 0.3), ("last", 0.8)):
        made.add_marker(f"ground.{name}", position=[x, 0, 0])
        made.add_body(name, mass=1.0, inertia=[J] * 3, position=[x, 0, 0])
        made.add_joint(name, "revolute", between=[f"ground.{name}", name], axis="z")
    made.add_marker("ground.rack", position=[0.8, 0.3, 0])
    made.add_body("rack", mass=1.0, inertia=[J] * 3, position=[0.8, 0.3, 0])
    made.add_joint("rack", "prismatic", between=["ground.rack", "rack"], axis="x")
    made.add_coupler("first", "gear", joints=["motor", "idler"], teeth=[10, 20])
    made.add_coupler("second", "gear", joints=["idler", "last"], teeth=[20, 30])
    made.add_coupler("lift", "rack-and-pinion", joints=["last", "rack"], radius=0.3)
    made.add_force("coil", "rotational-spring-damper", joint="idler", stiffness=2.0)
    made.add_driver("lead", joint=on, angle=angle)
    made.add_sensor("way", "stroke", joint="rack")
    made.add_sensor("torque", "reaction", driver="lead", quantity="moment")
    made.add_sensor("idler", "angle", joint="idler")
    return made


def states_at(made, time):
    """Sensors by each analysis at a time: statics in one or few steps, kinematics, dynamics."""
    yield flexmb.statics(made, time=time)
    yield flexmb.statics(made, duration=time, outputs=1)
    yield flexmb.statics(made, duration=time, outputs=3)
    yield flexmb.kinematics(made, duration=time, outputs=1)


@pytest.mark.parametrize("offset", [0.0, 20.0])
@pytest.mark.parametrize("on", ["motor", "idler", "last"])
def test_an_equilibrium_at_a_time_has_the_turns_of_the_drivers(on, offset):
    """The rack of a train that is driven to 30 rad was led by a part of a turn."""
    ratio = {"motor": 1.0, "idler": -0.5, "last": 1.0 / 3.0}  # turns for one of the motor
    angle = 30.0 + offset
    motor = angle / ratio[on]
    for found in states_at(lifted(on, f"{offset} + 10*t"), 3.0):
        assert abs(found["way"][-1]) == pytest.approx(0.3 * abs(motor) / 3.0, rel=1e-9)
        assert found["idler"][-1] == pytest.approx(-0.5 * motor, rel=1e-9)
        wound = 2.0 * 0.5 * motor * 0.5 / ratio[on]  # by virtual work
        assert found["torque.z"][-1] == pytest.approx(wound, rel=1e-9)


@pytest.mark.parametrize("pitch", [0.01, -0.004])
def test_a_screw_jack_stands_where_its_driver_led_it(pitch):
    made = Model("jack")
    made.add_body("nut", mass=1.0, inertia=[J] * 3)
    made.add_joint("thread", "screw", between=["ground", "nut"], axis="x", pitch=pitch)
    made.add_driver("lead", joint="thread", angle="10*t")
    made.add_sensor("way", "stroke", joint="thread")
    made.add_sensor("turn", "angle", joint="thread")
    for found in states_at(made, 3.0):
        assert found["way"][-1] == pytest.approx(30.0 * pitch / (2.0 * np.pi), rel=1e-9)
        assert found["turn"][-1] == pytest.approx(30.0)
    swept = flexmb.sweep_statics(made, "time", [3.0, 0.0, -1.0])
    ways = [point.channels[0] for point in swept.points]
    np.testing.assert_allclose(ways, np.array([30, 0, -10]) * pitch / (2 * np.pi), atol=1e-12)


@pytest.mark.parametrize("outputs", [2, 50])
def test_inverse_dynamics_reads_the_turns_of_a_run_with_few_rows(outputs):
    """Angles were counted from row to row: 21.6 rad were -3.5 where the rows were far apart."""
    run, needed = wheel(spin=20.0), wheel(spin=20.0)
    run.add_force("push", "torque", at="wheel", value=[0, 0, "0.1*sin(3*t)"])
    made = flexmb.simulate(run, duration=0.4, outputs=outputs, accuracy=1e-8)
    found = flexmb.inverse_dynamics(needed, made, drives=["pin"])
    np.testing.assert_allclose(found["turn"], made["turn"], rtol=1e-12)
    wanted = 0.1 * np.sin(3.0 * found.time)
    np.testing.assert_allclose(found.reaction("drive_pin").moment[:, 2], wanted, atol=1e-9)


def test_a_coordinate_that_the_run_lacks_is_told_with_its_cure():
    made = Model("bare")
    made.add_body("wheel", mass=1.0, inertia=[J] * 3)
    made.add_marker("ground.pin", position=[0, 0, 0])
    made.add_joint("pin", "revolute", between=["ground.pin", "wheel"], axis="z")
    run = flexmb.simulate(made, duration=0.1, outputs=2)
    with pytest.raises(ResultFileError, match=r"has no forces.coil .* a spring with value = 0"):
        flexmb.inverse_dynamics(wheel(), run, drives=["pin"])
    idle = wheel()
    del idle.forces["coil"]
    idle.add_force("coil", "rotational-spring-damper", joint="pin", value=0)
    run = flexmb.simulate(idle, duration=0.1, outputs=2)
    assert len(flexmb.inverse_dynamics(wheel(), run, drives=["pin"]).time) == 3


@pytest.mark.parametrize("keep", [False, True])
def test_turns_of_a_sensor_that_nothing_keeps_are_told_with_their_cure(keep):
    made = Model("bare")
    made.add_body("wheel", mass=1.0, inertia=[J] * 3, angular_velocity=[0, 0, 20])
    made.add_joint("pin", "revolute", between=["ground", "wheel"], axis="z")
    made.add_sensor("turn", "angle", joint="pin")
    if keep:
        made.add_force("idle", "rotational-spring-damper", joint="pin", value=0)
    first = flexmb.simulate(made, duration=1.0, outputs=2)
    then = flexmb.simulate(made, duration=1.0, outputs=2, start_from=first)
    said = "sensors.turn: begins within half a turn, where the other run ended at 20 rad"
    assert any(said in note for note in then.notes) != keep
    assert then["turn"][0] == pytest.approx(20.0 if keep else 20.0 - 6 * np.pi)
