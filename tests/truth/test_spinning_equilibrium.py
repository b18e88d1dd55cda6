"""Equilibria with a motion: a governor, a rod that grows, a tether; closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from femeshes import line
from restscenes import G
from scipy.optimize import brentq

import flexmb
from flexmb.fe import rectangle, reduce
from flexmb.model import Model

MASS, LENGTH = 2.0, 0.5


def governor(speed, lean=0.3, driven=True, aside=0.0):
    """Two bars that hang from a shaft about z, or from arms on it, and lean outwards."""
    made = Model("governor", gravity=[0, 0, -G])
    made.add_body("shaft", mass=1.0, inertia=[0.01] * 3)
    made.add_joint("bearing", "revolute", between=["ground", "shaft"], axis="z")
    if driven:
        made.add_driver("motor", joint="bearing", angle=f"{speed}*t")
    inertia = [MASS * LENGTH**2 / 12] * 2 + [1e-12]
    for k, sign in enumerate((1, -1)):
        made.add_marker(f"shaft.pin{k}", position=[sign * aside, 0, 0])
        made.add_body(f"arm{k}", mass=MASS, center=[0, 0, -LENGTH / 2], inertia=inertia,
                      position=[sign * aside, 0, 0],
                      orientation={"axis": "y", "angle": -sign * lean},
                      markers={"end": {"position": [0, 0, -LENGTH]}})  # fmt: skip
        made.add_joint(f"pin{k}", "revolute", between=[f"shaft.pin{k}", f"arm{k}"], axis="y")
        made.add_sensor(f"end{k}", "position", of=f"arm{k}.end")
    made.set_statics(spin=[0, 0, speed])
    return made


@pytest.mark.parametrize("speed", [6.0, 8.0, 40.0])
def test_a_governor_leans_as_far_as_its_speed_says(speed):
    # moments about the pin: m w^2 L^2/3 sin cos = m g L/2 sin
    height = -LENGTH * 3 * G / (2 * speed**2 * LENGTH)
    result = flexmb.statics(governor(speed))
    assert result["end0.z"][0] == pytest.approx(height, rel=1e-8)
    assert result["end1.z"][0] == pytest.approx(height, rel=1e-8)
    reach = math.sqrt(LENGTH**2 - height**2)
    assert abs(result["end0.x"][0]) == pytest.approx(reach, rel=1e-8)
    # the pin carries weight and centripetal force
    force = np.linalg.norm(result.reaction("pin0").force[0])
    assert force == pytest.approx(MASS * math.hypot(G, speed**2 * reach / 2), rel=1e-8)


def test_a_governor_with_its_pins_beside_the_shaft():
    """m w^2 (e L/2 cos + L^2/3 sin cos) = m g L/2 sin, and what the pins carry."""
    speed, e = 7.0, 0.2

    def moment(x):
        spin = speed**2 * (e / 2 * np.cos(x) + LENGTH / 3 * np.sin(x) * np.cos(x))
        return spin - G / 2 * np.sin(x)

    lean = brentq(moment, 0.1, 1.5)
    result = flexmb.statics(governor(speed, aside=e))
    for k, sign in enumerate((1, -1)):
        assert result[f"end{k}.z"][0] == pytest.approx(-LENGTH * np.cos(lean), rel=1e-8)
        assert sign * result[f"end{k}.x"][0] == pytest.approx(e + LENGTH * np.sin(lean), rel=1e-8)
    force = np.linalg.norm(result.reaction("pin0").force[0])
    pull = speed**2 * (e + LENGTH / 2 * np.sin(lean))
    assert force == pytest.approx(MASS * math.hypot(G, pull), rel=1e-8)
    assert result.statistics["newton_iterations"] < 20


@pytest.mark.slow
def test_hanging_bars_lose_their_stability_at_the_critical_speed():
    sweep = flexmb.sweep_statics(lambda w: governor(w, lean=0.0), "speed", [3.0, 5.0, 7.0])
    lost = [event for event in sweep.events if event.kind == "stability lost"]
    critical = math.sqrt(3 * G / (2 * LENGTH))
    assert any(event.low - 1e-3 <= critical <= event.high + 1e-3 for event in lost)
    assert sweep.stable.tolist() == [True, True, False]
    assert sweep.points[2].growth == pytest.approx(math.sqrt(49.0 - critical**2), rel=1e-5)


@pytest.mark.parametrize("driven", [True, False])
def test_a_run_that_begins_there_stays(driven):
    model = governor(8.0, driven=driven)
    model.set_dynamics(duration=1.0, outputs=10, start="static", accuracy=1e-7)
    run = flexmb.simulate(model)
    assert np.ptp(run["end0.z"]) < 1e-8
    assert np.hypot(run["end0.x"], run["end0.y"]) == pytest.approx(math.sqrt(
        LENGTH**2 - (3 * G / (2 * 64.0)) ** 2), rel=1e-8)  # fmt: skip
    angle = np.unwrap(np.arctan2(run["end0.y"], run["end0.x"]))
    np.testing.assert_allclose(np.diff(angle), 0.8, atol=1e-7)


@pytest.mark.seconds
def test_a_shaft_that_turns_freely_has_each_equilibrium_once():
    """All angles of the shaft are alike: m w^2 (e + l sin) cos = m g sin has four roots."""
    speed, e, length = 9.0, 0.05, 0.3
    made = Model("arm on a shaft", gravity=[0, 0, -G])
    made.add_body("shaft", mass=1.0, inertia=[0.01] * 3)
    made.add_joint("bearing", "revolute", between=["ground", "shaft"], axis="z")
    made.add_marker("shaft.pin", position=[e, 0, 0])
    made.add_body("arm", mass=MASS, center=[length, 0, 0], inertia=[1e-9] * 3, position=[e, 0, 0],
                  orientation={"axis": "y", "angle": 1.2})  # fmt: skip
    made.add_joint("pin", "revolute", between=["shaft.pin", "arm"], axis="y")
    made.add_sensor("center", "position", of="arm.center")
    made.set_statics(spin=[0, 0, speed])
    grid = np.linspace(-np.pi, np.pi, 1001)

    def moment(x):
        return speed**2 * (e + length * np.sin(x)) * np.cos(x) - G * np.sin(x)

    roots = [
        brentq(moment, a, b)
        for a, b in zip(grid[:-1], grid[1:], strict=True)
        if moment(a) * moment(b) < 0
    ]

    def potential(x, at):
        """Of a shaft without a motor, whose angular momentum stays."""
        inertia = [0.01 + MASS * (e + length * np.sin(angle)) ** 2 for angle in (x, at)]
        return -MASS * G * length * np.cos(x) + 0.5 * (speed * inertia[1]) ** 2 / inertia[0]

    h = 1e-3
    bends = [potential(x + h, x) - 2 * potential(x, x) + potential(x - h, x) for x in roots]
    found = flexmb.equilibria(made)
    heights = sorted(one.channels(["center.z"])[0] for one in found)
    np.testing.assert_allclose(heights, np.sort(-length * np.cos(roots)), atol=1e-9)
    assert len(roots) == 4
    assert all(one.neutral_motions == 1 for one in found)
    stable = {round(one.channels(["center.z"])[0], 6): one.linearize().stable for one in found}
    for x, bend in zip(roots, bends, strict=True):
        assert stable[round(-length * np.cos(x), 6)] == (bend > 0.0)


def test_a_rod_grows_by_its_centrifugal_force():
    speed, side = 100.0, 0.02
    rod = reduce(line(8, end=(LENGTH, 0, 0)), modes=6, interfaces={"root": "root", "tip": "tip"},
                 material={"E": 70e9, "nu": 0.3, "density": 2700.0},
                 sections={"all": rectangle(side, side)}, residual="inertia")  # fmt: skip
    model = Model("rod on a hub")
    model.add_body("hub", mass=1.0, inertia=[0.01] * 3)
    model.add_joint("bearing", "revolute", between=["ground", "hub"], axis="z")
    model.add_driver("motor", joint="bearing", angle=f"{speed}*t")
    model.add_body("rod", rod)
    model.add_joint("weld", "fixed", between=["hub", "rod.root"])
    model.add_sensor("grown", "distance", between=["hub", "rod.tip"])
    model.set_statics(spin=[0, 0, speed])
    [equilibrium] = flexmb.equilibria(model, starts=1)
    stretch = equilibrium.channels(["grown"])[0] - LENGTH
    assert stretch == pytest.approx(2700.0 * speed**2 * LENGTH**3 / (3 * 70e9), rel=2e-3)


@pytest.mark.seconds
@pytest.mark.parametrize("load", [0.0, 1.0])
def test_a_wheel_that_turns_freely_beside_a_truss_does_not_change_its_equilibria(load):
    """Springs of length 1.05 over a span of 2: both snapped states, and the one between them."""
    made = Model("truss beside a wheel")
    made.add_body("pin", mass=1.0, inertia=[1, 1, 1], position=[0, 0.3, 0])
    made.add_marker("ground.slot", position=[0, 0.3, 0])
    made.add_joint("slot", "prismatic", between=["ground.slot", "pin"], axis="y")
    for side, x in (("left", -1), ("right", 1)):
        made.add_marker(f"ground.{side}", position=[x, 0, 0])
        made.add_force(side, "spring-damper", between=[f"ground.{side}", "pin"], stiffness=100,
                       free_length=1.05)  # fmt: skip
    made.add_force("push", "force", at="pin", value=[0, load, 0])
    made.add_body("wheel", mass=1.0, inertia=[1, 1, 1])
    made.add_joint("axle", "revolute", between=["ground", "wheel"], axis="z")
    made.add_sensor("pin", "position", of="pin")
    y = np.linspace(-1, 1, 1000)

    def force(y):
        return 200 * (1.05 / np.hypot(1, y) - 1) * y + load

    roots = [brentq(force, a, b) for a, b in zip(y[:-1], y[1:], strict=True)
             if force(a) * force(b) < 0]  # fmt: skip
    found = flexmb.equilibria(made)
    heights = sorted(one.channels(["pin.y"])[0] for one in found)
    np.testing.assert_allclose(heights, roots, atol=1e-9)
    assert [one.neutral_motions for one in found] == [1, 1, 1]


@pytest.mark.parametrize("modes", [6, 20])
def test_a_tether_under_tension_begins_in_equilibrium(modes):
    """It hangs from a cart that begins to accelerate, at 470 times its Euler load, by Ritz' method
    between pins; without tension it would bend by 0.73 m."""
    length, thick, load, E, density = 10.0, 0.004, 20.0, 2.1e11, 7800.0
    acceleration, mass = 0.4, density * thick**2
    made = Model("tether", gravity=[G, 0, 0])
    made.add_body("cart", mass=50.0, inertia=[5.0] * 3)
    made.add_body(
        "tether", mesh={"type": "beam", "length": length, "divisions": 40}, modes=modes,
        material={"E": E, "nu": 0.3, "density": density}, geometric_stiffening="full",
        sections={"all": {"type": "rectangle", "y": thick, "z": thick}},
        interfaces={"root": "start", "tip": "end"},
    )  # fmt: skip
    made.add_marker("tether.middle", position=[length / 2, 0, 0])
    made.add_body("load", mass=load, inertia=[0.1] * 3, position=[length, 0, 0])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="z")
    made.add_joint("root", "spherical", between=["cart", "tether.root"])
    made.add_joint("tip", "spherical", between=["tether.tip", "load"])
    made.add_driver("shake", joint="rail", stroke=f"{acceleration / 2}*t**2")
    made.add_sensor("middle", "position", of="tether.middle")
    made.set_dynamics(duration=1e-3, outputs=2, start="quasi-static", verify=False)
    bent = flexmb.simulate(made, accuracy=1e-3)["middle.z"][0]
    k = np.arange(1, 40) * np.pi / length
    x = np.linspace(0.0, length, 4001)
    pull = G * (load + mass * (length - x))
    shapes, slopes = np.sin(np.outer(k, x)), k[:, None] * np.cos(np.outer(k, x))
    K = np.diag(E * thick**4 / 12 * k**4 * length / 2)
    K += np.trapezoid(pull * slopes[:, None] * slopes, x, axis=2)
    f = -acceleration * mass * np.trapezoid((1 - x / length) * shapes, x, axis=1)
    truth = np.linalg.solve(K, f) @ np.sin(k * length / 2)
    assert bent == pytest.approx(truth, rel=0.05)
