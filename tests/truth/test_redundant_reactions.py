"""Reactions of doors whose hinges share a load or hold it with a short lever, beside hand formulas.

A door of 20 kg turns about the z axis through the origin, under gravity with a component in the
plane of the motion. Its angle is that of a physical pendulum.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import beside_a_large_motion
from accuracyscenes.judging import METHODS
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from truthkit import run

import flexmb
from flexmb.model import Model

MASS, ARM, INERTIA, DURATION = 20.0, 0.5, (4.0, 2.4, 2.6), 2.0


def door(gravity, height, joints):
    """A door with its centre of mass at (ARM, 0, height) and joints at heights on the z axis."""
    made = Model("door", gravity=gravity)
    made.add_body("door", mass=MASS, inertia=list(INERTIA), position=[ARM, 0, height],
                  angular_velocity=[0, 0, 1.0], velocity=[0, ARM, 0])  # fmt: skip
    for k, (kind, z) in enumerate(joints):
        made.add_marker(f"ground.h{k}", position=[0, 0, z])
        made.add_marker(f"door.h{k}", position=[-ARM, 0, z - height])
        axis = {} if kind == "spherical" else {"axis": "z"}
        made.add_joint(f"h{k}", kind, between=[f"ground.h{k}", f"door.h{k}"], **axis)
    made.add_sensor("door", "position", of="door")
    return made


def motion(t, gravity):
    """Angle, rate and angular acceleration (n,) of the door, by SciPy."""
    about_hinge = INERTIA[2] + MASS * ARM**2

    def turning(angle):
        return MASS * ARM * (gravity[1] * np.cos(angle) - gravity[0] * np.sin(angle)) / about_hinge

    solved = solve_ivp(lambda _, y: [y[1], turning(y[0])], (0, t[-1]), [0, 1], method="DOP853",
                       rtol=1e-13, atol=1e-13, t_eval=t)  # fmt: skip
    return solved.y[0], solved.y[1], turning(solved.y[0])


def load(t, gravity):
    """Place of the centre of mass about the axis, and force of all joints on the door (n, 3)."""
    angle, rate, turning = motion(t, gravity)
    out = np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    aside = np.stack([-np.sin(angle), np.cos(angle), 0 * t], axis=1)
    pull = ARM * (turning[:, None] * aside - rate[:, None] ** 2 * out)
    return ARM * out, MASS * (pull - np.array(gravity))


def on_ground(found, k):
    """Force and moment of joint k on the ground (n, 6), in global axes."""
    at = 12 * found.layout.reactions.index(f"joints.h{k}") + 6
    return found.reactions[:, at : at + 6]


@pytest.mark.parametrize("method", ["explicit-rk", "order 5", "radau"])
def test_two_hinges_share_a_load_between_them_evenly(method):
    """By symmetry half of the force in each, no force along the axis and no moment: no noise."""
    gravity = [1.0, 0.4, 0.0]
    made = door(gravity, 0.1, [("revolute", -0.8), ("revolute", 1.0)])
    found = run(made, duration=DURATION, outputs=50, accuracy=1e-9, **METHODS[method])
    _, force = load(found.t, gravity)
    size = np.abs(force).max()
    for k in range(2):
        own = on_ground(found, k)
        np.testing.assert_allclose(own[:, :3], -0.5 * force, rtol=0, atol=1e-8 * size)
        np.testing.assert_allclose(own[:, 2:], 0.0, atol=2e-11 * size)
    assert found.statistics["measured_error_of_reactions"] < 1e-7


@pytest.mark.parametrize("lever", [0.1, 1e-3, 1e-4])
@pytest.mark.parametrize(("method", "most"), [("explicit-rk", 30), ("radau", 100)])
def test_a_short_lever_holds_a_door_as_exactly(lever, method, most):
    """A ball and a pin of a short distance: forces up to 1 MN, few steps, as accurate."""
    gravity, accuracy, height = [1.0, 0.4, -9.81], 1e-5, 0.1
    made = door(gravity, height, [("spherical", 0.0), ("in-line", lever)])
    found = run(made, duration=DURATION, outputs=50, accuracy=accuracy, **METHODS[method])
    place, force = load(found.t, gravity)
    error = np.abs(found.vector("door") - place - [0, 0, height]).max() / np.ptp(place[:, 1])
    assert error < 2 * accuracy and found.statistics["steps"] < most
    told = found.statistics["measured_error_of_positions"]
    if max(error, told) > 0.2 * accuracy:
        assert 1 / 3 < told / error < 3
    # moments about the origin: the pin at (0, 0, lever) holds Mx, My of force and inertia
    moment = np.cross(place + [0, 0, height], force)
    pin = np.stack([moment[:, 1], -moment[:, 0]], axis=1) / lever
    size = np.abs(pin).max()
    np.testing.assert_allclose(on_ground(found, 1)[:, :2], -pin, rtol=0, atol=20 * accuracy * size)


@pytest.mark.parametrize("method", ["generalized-alpha", "radau", "explicit-rk"])
def test_a_follower_of_micrometres_stays_on_its_cam_beside_a_large_motion(method):
    """Positions are put on the constraints as exactly as the size of their own part allows."""
    lift = 1e-6
    made = Model("cam", plane="xy", gravity=[0, -9.81, 0])
    made.add_curve("disk", circle=0.05, center=[lift, 0])
    made.add_body("cam", mass=1.0, inertia=[1e-3] * 3, angular_velocity=[0, 0, 5.0])
    made.add_body("follower", mass=0.5, inertia=[1e-3] * 3, position=[0, 0.05, 0],
                  velocity=[0, 5.0 * lift, 0])  # fmt: skip
    made.add_joint("pivot", "revolute", between=["ground", "cam"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "follower"], axis="y")
    made.add_joint("contact", "cam-flat", between=["cam", "follower"], curve="disk", axis="y")
    made.add_sensor("lift", "position", of="follower")
    made.add_sensor("spin", "angle", joint="pivot")
    found = run(beside_a_large_motion(made), duration=2.0, outputs=100, accuracy=1e-3,
                method=method)  # fmt: skip
    known = 0.05 + lift * np.sin(found["spin"])
    np.testing.assert_allclose(found["lift.y"], known, rtol=0, atol=1e-6 * lift)


# A coupler of 2 kg on three parallel cranks of 0.5 kg; a ball on it hits a wall at 0.1 m, with
# 1e6 N/m^1.5 and a restitution of 0.5.
LENGTH, COUPLER, CRANK, CRANK_INERTIA, FEET = 0.3, 2.0, 0.5, 0.01, (0.0, 0.4, 0.9)
WALL, STIFFNESS, RESTITUTION, G = 0.1, 1e6, 0.5, 9.81


def parallelogram(plane="xy"):
    """In its plane one constraint equation is redundant, in any pose but not beside it."""
    made = Model("parallelogram", gravity=[0, -G, 0], **({"plane": plane} if plane else {}))
    joint = LENGTH * np.array([np.sin(1.0), -np.cos(1.0), 0.0])
    made.add_body("coupler", mass=COUPLER, inertia=[0.2] * 3, position=list(joint))
    made.add_marker("ground.wall", position=[-WALL - 0.02, 0, 0])
    made.add_force("wall", "contact", between=["coupler", "ground.wall"], stiffness=STIFFNESS,
                   shapes=[{"type": "sphere", "radius": 0.02}, {"type": "plane", "axis": "x"}],
                   exponent=1.5, restitution=RESTITUTION)  # fmt: skip
    for k, x in enumerate(FEET):
        made.add_marker(f"ground.foot{k}", position=[x, 0, 0])
        made.add_marker(f"coupler.pin{k}", position=[x, 0, 0])
        made.add_body(
            f"crank{k}",
            mass=CRANK,
            inertia=[CRANK_INERTIA] * 3,
            center=[0, -LENGTH / 2, 0],
            position=[x, 0, 0],
            orientation={"axis": "z", "angle": 1.0},
        )
        made.add_marker(f"crank{k}.end", position=[0, -LENGTH, 0])
        made.add_sensor(f"foot{k}", "reaction", joint=f"foot{k}", axes="global")
        made.add_joint(f"foot{k}", "revolute", between=[f"ground.foot{k}", f"crank{k}"], axis="z")
        made.add_joint(
            f"pin{k}", "revolute", between=[f"crank{k}.end", f"coupler.pin{k}"], axis="z"
        )
    made.add_sensor("coupler", "position", of="coupler")
    return made


def swing_against_the_wall(t):
    """Angle and rate (n,) of the cranks from straight down; Hunt and Crossley's contact."""
    chi = brentq(lambda x: x * (1 + RESTITUTION) - np.log((1 + x) / (1 - x * RESTITUTION)),
                 0.01, (1 - 1e-9) / RESTITUTION)  # fmt: skip
    about = 3 * (CRANK_INERTIA + CRANK * LENGTH**2 / 4) + COUPLER * LENGTH**2
    weight = (1.5 * CRANK + COUPLER) * LENGTH * G
    y, now, speed, found = [1.0, 0.0], 0.0, 0.0, np.zeros((2, len(t)))
    while now < t[-1]:

        def slope(_, y, speed=speed):
            depth, rate = -WALL - LENGTH * np.sin(y[0]), -LENGTH * np.cos(y[0]) * y[1]
            push = STIFFNESS * max(depth, 0) ** 1.5 * (1 + chi * rate / speed) if speed else 0.0
            return [y[1], (push * LENGTH * np.cos(y[0]) - weight * np.sin(y[0])) / about]

        def depth(_, y):
            return -WALL - LENGTH * np.sin(y[0])

        depth.terminal, depth.direction = True, -1 if speed else 1
        part = solve_ivp(slope, (now, t[-1]), y, "DOP853", rtol=1e-13, atol=1e-15, events=depth,
                         dense_output=True)  # fmt: skip
        inside = (t >= now) & (t <= part.t[-1])
        if inside.any():
            found[:, inside] = part.sol(t[inside])
        now, y = part.t[-1], part.y[:, -1]
        speed = 0.0 if speed else -LENGTH * np.cos(y[0]) * y[1]
    return found


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore:.*redundant")
@pytest.mark.parametrize(
    ("accuracy", "plane"), [(1e-3, "xy"), (1e-4, "xy"), (1e-5, "xy"), (1e-4, ""), (1e-5, "")]
)
def test_an_impact_leaves_no_self_stress_in_three_parallel_cranks(accuracy, plane):
    """The short steps at the wall left round-off over h² in them: 16 accuracies of 1e-5.

    In space the run from the last impact, by which vibrations are measured, had it: 47 times the
    error of the reactions was told.
    """
    found = flexmb.simulate(parallelogram(plane), duration=3.0, outputs=100, accuracy=accuracy,
                            method="generalized-alpha")  # fmt: skip
    angle, rate = swing_against_the_wall(found.time)
    wanted = LENGTH * np.array([np.sin(angle), -np.cos(angle)])
    apart = max(abs(found[f"coupler.{a}"] - w).max() for a, w in zip("xy", wanted, strict=True))
    error = apart / np.ptp(wanted[0])
    told = found.statistics["measured_error_of_positions"]
    assert error < 2 * accuracy
    assert 1 / 3 < told / error < 3
    flies = -WALL - LENGTH * np.sin(angle) < 0.0
    about = 3 * (CRANK_INERTIA + CRANK * LENGTH**2 / 4) + COUPLER * LENGTH**2
    moved = LENGTH * (1.5 * CRANK + COUPLER)
    turning = -moved * G * np.sin(angle) / about
    pull = moved * (turning * np.cos(angle) - rate**2 * np.sin(angle))
    feet = sum(found[f"foot{k}.x"] for k in range(3))
    assert abs(feet - pull)[flies].max() < 20 * accuracy * np.ptp(pull)
    assert found.statistics["measured_error_of_reactions"] < 20 * accuracy


@pytest.mark.filterwarnings("ignore:.*redundant")
def test_fixed_steps_after_an_impact_leave_no_self_stress():
    """Each foot has its share as with explicit steps: 1.1e-4 of its range were missing."""
    fixed, free = (
        flexmb.simulate(parallelogram(""), duration=0.6, outputs=60, **knobs)
        for knobs in ({"method": "generalized-alpha", "step": 2e-5},
                      {"method": "explicit-rk", "accuracy": 1e-8})
    )  # fmt: skip
    angle, _ = swing_against_the_wall(fixed.time)
    np.testing.assert_allclose(fixed["coupler.x"], LENGTH * np.sin(angle), rtol=0, atol=1e-6)
    for k in range(3):
        for axis in "xy":
            gap = fixed[f"foot{k}.{axis}"] - free[f"foot{k}.{axis}"]
            assert abs(gap).max() < 2e-5 * np.ptp(free[f"foot{k}.{axis}"])
    assert fixed.statistics["steps"] == 30_000
