"""Equilibria against closed forms: springs, pendulums, trusses that snap through, hanging chains.

A kilometre away, in micrometres, in a plane, with redundant joints, from far guesses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from femeshes import line
from mechanisms import stewart
from restscenes import FAR, G, pendulum
from scipy.optimize import brentq

import flexmb
from flexmb.errors import AssemblyError, SceneError, SolverError
from flexmb.fe import rectangle, reduce
from flexmb.model import Model


@pytest.mark.parametrize("place", [(0, 0, 0), FAR])
@pytest.mark.parametrize("plane", [None, "xy"])
def test_pendulum_hangs_from_any_angle(place, plane):
    place = place if plane is None else (*place[:2], 0.0)
    for angle in (0.3, 1.6, 3.1):
        made = pendulum(0.0, place, plane=plane)
        turned = {"axis": [0, 0, 1], "angle": angle}
        made.bodies.clear()
        made.joints.clear()
        made.add_body("bar", mass=2.0, center=[0, -0.5, 0], inertia=[0.2, 0.2, 0.3],
                      position=list(place), orientation=turned)  # fmt: skip
        made.add_joint("pin", "revolute", between=["ground.pin", "bar"], axis="z")
        made.add_sensor("center", "position", of="bar.center")
        result = flexmb.statics(made)
        assert result["center.x"][0] - place[0] == pytest.approx(
            0.0, abs=1e-11 * (1 + abs(place[0]))
        )
        assert result["center.y"][0] - place[1] == pytest.approx(-0.5, rel=1e-12, abs=1e-9)
        force = result.reaction("pin", on="bar").force[0]
        assert np.linalg.norm(force) == pytest.approx(2.0 * G, rel=1e-10)


@pytest.mark.seconds
def test_an_equilibrium_is_shown_in_a_line():
    [found, *_] = flexmb.equilibria(pendulum(0.0))
    assert len(repr(found)) < 100
    assert "steps" in repr(found)


def test_upright_pendulum_is_unstable_and_said_so():
    made = Model("upright", gravity=[0, -G, 0])
    made.add_body("bar", mass=2.0, center=[0, 0.5, 0], inertia=[0.2, 0.2, 0.3])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    with pytest.warns(match="unstable"):
        flexmb.statics(made)


@pytest.mark.parametrize("units", ["SI", "um"])
def test_mass_on_a_spring(units):
    scale = {"SI": 1.0, "um": 1e6}[units]
    made = Model("spring", gravity=[0, 0, -G * scale]) if units == "SI" else _micro()
    if units == "SI":
        made.add_body("mass", mass=2.0, inertia=[1, 1, 1], position=[0, 0, -1])
        made.add_joint("guide", "prismatic", between=["ground", "mass"], axis="z")
        made.add_force("spring", "spring-damper", between=["ground", "mass"], stiffness=300.0,
                       damping=3.0, free_length=1.0)  # fmt: skip
        made.add_sensor("mass", "position", of="mass")
        wanted = -1.0 - 2.0 * G / 300.0
        assert flexmb.statics(made)["mass.z"][0] == pytest.approx(wanted, rel=1e-12)
    else:
        made.add_sensor("mass", "position", of="mass")
        found = flexmb.statics(made)["mass.z"][0]
        # 1e-9 kg on 1e-3 N/m: 9.81 micrometres
        assert found == pytest.approx(-20e-6 - 1e-9 * G / 1e-3, rel=1e-11)


def _micro():
    made = Model("spring", gravity=[0, 0, -G])
    made.add_body("mass", mass=1e-9, inertia=[1e-19] * 3, position=[0, 0, -20e-6])
    made.add_joint("guide", "prismatic", between=["ground", "mass"], axis="z")
    made.add_force("spring", "spring-damper", between=["ground", "mass"], stiffness=1e-3,
                   free_length=20e-6)  # fmt: skip
    return made


def truss(load, k=1000.0, half=1.0, height=0.4, start=None):
    """Two springs from the supports to a mass that slides up and down: von Mises' truss."""
    made = Model("truss")
    made.add_marker("ground.left", position=[-half, 0, 0])
    made.add_marker("ground.right", position=[half, 0, 0])
    made.add_body("top", mass=1.0, inertia=[1, 1, 1],
                  position=[0, height if start is None else start, 0])  # fmt: skip
    made.add_joint("guide", "prismatic", between=["ground", "top"], axis="y")
    free = np.hypot(half, height)
    for side in ("left", "right"):
        made.add_force(side, "spring-damper", between=[f"ground.{side}", "top"], stiffness=k,
                       damping=1.0, free_length=free)  # fmt: skip
    made.add_force(
        "load", "force", at="top", value=[0, load if isinstance(load, str) else -load, 0]
    )
    made.add_sensor("top", "position", of="top")
    return made


def truss_force(y, k=1000.0, half=1.0, height=0.4):
    """Downward load that holds the top at y."""
    length, free = np.hypot(half, y), np.hypot(half, height)
    return -2.0 * k * (length - free) * y / length


@pytest.mark.seconds
def test_all_equilibria_of_a_truss():
    """Under a load below the limit there are three, the middle one unstable."""
    load = 20.0
    grid = np.linspace(-0.8, 0.8, 4001)
    values = truss_force(grid) - load
    roots = [
        brentq(lambda y: truss_force(y) - load, grid[i], grid[i + 1], xtol=1e-15)
        for i in np.flatnonzero(np.sign(values[:-1]) != np.sign(values[1:]))
    ]
    assert len(roots) == 3
    found = flexmb.equilibria(truss(load))
    places = [one.q[1] for one in found]
    np.testing.assert_allclose(np.sort(places), np.sort(roots), atol=1e-10)
    stable = {round(one.q[1], 6): one.linearize().stable for one in found}
    assert [stable[round(y, 6)] for y in sorted(roots)] == [True, False, True]


def test_truss_snaps_through_along_a_quasi_static_load():
    """It follows its upper branch to the limit load and then jumps to the lower one."""
    heights = np.linspace(0.0, 0.4, 2001)
    limit = truss_force(heights).max()
    made = truss(f"-{1.5 * limit}*t")
    result = flexmb.statics(made, duration=1.0, outputs=60)
    y = result["top.y"]
    for t, one in zip(result.time, y, strict=True):
        assert truss_force(one) == pytest.approx(1.5 * limit * t, abs=1e-7 * limit)
    below = result.time < 0.99 / 1.5
    assert np.all(y[below] > 0.1)
    assert np.all(y[result.time > 1.01 / 1.5] < -0.4)


def test_hanging_chain_is_the_discrete_catenary():
    """Equal bars, hinged: the tangent of the slope grows linearly from bar to bar."""
    n, bar, span = 8, 0.25, 1.4
    made = Model("chain", gravity=[0, -G, 0])
    made.add_marker("ground.end", position=[span, 0, 0])
    rng = np.random.default_rng(1)
    angles = np.linspace(-1.2, 1.2, n)
    x = np.zeros(2)
    for i in range(n):
        made.add_body(f"b{i}", mass=0.5, center=[bar / 2, 0, 0], inertia=[1e-5, 3e-3, 3e-3],
                      position=[*x, 0.0], orientation={"axis": [0, 0, 1], "angle": angles[i]},
                      markers={"end": {"position": [bar, 0, 0]}})  # fmt: skip
        before = "ground" if i == 0 else f"b{i - 1}.end"
        made.add_joint(f"j{i}", "revolute", between=[before, f"b{i}"], axis="z")
        made.add_sensor(f"p{i}", "position", of=f"b{i}.end")
        x = x + bar * np.array([np.cos(angles[i]), np.sin(angles[i])])
    del rng
    made.add_joint("last", "revolute", between=[f"b{n - 1}.end", "ground.end"], axis="z")
    made.set_assembly()  # the bars hang only nearly where they are placed
    with pytest.warns():  # redundant joints, moved bodies
        result = flexmb.statics(made)
    points = np.array(
        [[0.0, 0.0]] + [[result[f"p{i}.x"][0], result[f"p{i}.y"][0]] for i in range(n)]
    )
    slopes = np.diff(points[:, 1]) / np.diff(points[:, 0])
    step = np.diff(slopes)
    np.testing.assert_allclose(step, step.mean(), rtol=1e-8)  # weight over horizontal pull
    pull = 0.5 * G / step.mean()
    assert abs(result.reaction("last", on="J").force[0]).max() > pull * 0.5
    np.testing.assert_allclose(points[-1], [span, 0.0], atol=1e-12)


def test_sag_of_a_cantilever_under_its_weight():
    """ρ g A L⁴/(8 E I) at the tip; the root's force is m g."""
    beam = reduce(
        line(20, end=(1, 0, 0)), modes=12, interfaces={"root": "root", "tip": "tip"},
        material={"E": 2e11, "nu": 0.3, "density": 8000.0},
        sections={"all": rectangle(0.01, 0.01)},
    )  # fmt: skip
    made = Model("cantilever", gravity=[0, -G, 0])
    made.add_body("beam", beam)
    made.add_joint("root", "fixed", between=["ground", "beam.root"])
    made.add_sensor("tip", "position", of="beam.tip")
    result = flexmb.statics(made)
    area, inertia = 1e-4, 0.01**4 / 12
    sag = 8000.0 * G * area / (8 * 2e11 * inertia)
    assert result["tip.y"][0] == pytest.approx(-sag, rel=2e-3)
    assert np.linalg.norm(result.reaction("root", on="beam").force[0]) == pytest.approx(
        8000.0 * area * G, rel=1e-9
    )


def test_equilibrium_is_the_end_of_a_damped_motion():
    made = Model("machine", gravity=[0, -G, 0], plane="xy")
    made.add_marker("ground.far", position=[1.5, 0.3, 0])
    made.add_body(
        "a",
        mass=2.0,
        center=[0.5, 0, 0],
        inertia=[0.2, 0.2, 0.2],
        markers={"end": {"position": [1, 0, 0]}},
    )
    made.add_body("b", mass=1.0, center=[0.3, 0, 0], inertia=[0.1, 0.1, 0.1], position=[1, 0, 0],
                  markers={"end": {"position": [0.6, 0, 0]}})  # fmt: skip
    made.add_joint("root", "revolute", between=["ground", "a"])
    made.add_joint("elbow", "revolute", between=["a.end", "b"])
    for name, pair in {"s": ["ground.far", "b.end"], "t": ["ground.far", "a.end"]}.items():
        made.add_force(name, "spring-damper", between=pair, stiffness=80.0, damping=12.0,
                       free_length=0.3)  # fmt: skip
    made.add_sensor("end", "position", of="b.end")
    rest = flexmb.statics(made)
    run = flexmb.simulate(made, duration=60.0, outputs=10, accuracy=1e-6)
    for axis in "xy":
        assert run[f"end.{axis}"][-1] == pytest.approx(rest[f"end.{axis}"][0], abs=2e-6)
    quiet = flexmb.simulate(made, duration=1.0, outputs=10, start="static")
    assert np.ptp(quiet["end.x"]) < 1e-9
    assert np.ptp(quiet["end.y"]) < 1e-9


def test_redundant_joints_share_with_the_least_forces():
    made = Model("beam on three", gravity=[0, -G, 0])
    made.add_body("bar", mass=3.0, inertia=[1, 1, 1])
    for i, x in enumerate((-1.0, 0.0, 1.0)):
        made.add_marker(f"ground.p{i}", position=[x, 0, 0])
        made.add_marker(f"bar.p{i}", position=[x, 0, 0])
        made.add_joint(f"j{i}", "fixed", between=[f"ground.p{i}", f"bar.p{i}"])
    with pytest.warns(match="redundant"):
        result = flexmb.statics(made)
    total = sum(result.reaction(f"j{i}", on="bar").force[0] for i in range(3))
    np.testing.assert_allclose(total, [0, 3.0 * G, 0], atol=1e-9)


def test_a_body_that_nothing_holds_is_named_with_its_way_and_force():
    made = Model("loose", gravity=[0, 0, -G])
    made.add_body("stone", mass=2.0, inertia=[1, 1, 1])
    with pytest.raises(
        SolverError, match=r"bodies\.stone moves on along -z under a force of 19\.6 N"
    ):
        flexmb.statics(made)
    made = Model("motor")
    made.add_body("rotor", mass=2.0, inertia=[1, 1, 1])
    made.add_joint("axle", "revolute", between=["ground", "rotor"], axis="z")
    made.add_force("drive", "torque", at="rotor", value=[0, 0, 5.0])
    with pytest.raises(SolverError, match=r"bodies\.rotor turns on about its z axis, moment 5 N m"):
        flexmb.statics(made)


def test_a_controller_is_at_rest_in_the_equilibrium():
    """An integrator that holds the height: its state carries the weight."""
    made = Model("hover", gravity=[0, 0, -G])
    made.add_body("mass", mass=2.0, inertia=[1, 1, 1])
    made.add_joint("guide", "prismatic", between=["ground", "mass"], axis="z")
    made.add_sensor("height", "position", of="mass")
    made.add_sensor("rate", "velocity", of="mass")
    made.add_state("sum", rate="0.1 - height.z", start=0.0)
    made.add_force(
        "lift", "force", at="mass", value=[0, 0, "50*sum - 20*rate.z + 40*(0.1 - height.z)"]
    )
    result = flexmb.statics(made)
    assert result["height.z"][0] == pytest.approx(0.1, rel=1e-10)
    assert result["sum"][0] == pytest.approx(2.0 * G / 50.0, rel=1e-10)


def test_free_lengths_hold_the_placed_pose():
    """Of two springs under a beam one may change: moments about the pin; or both: least forces."""
    made = Model("beam", gravity=[0, -G, 0])
    made.add_body("bar", mass=4.0, center=[0.5, 0, 0], inertia=[0.1, 0.4, 0.4])
    made.add_marker("bar.a", position=[0.4, 0, 0])
    made.add_marker("bar.b", position=[1, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    for name, x in (("a", 0.4), ("b", 1.0)):
        made.add_marker(f"ground.{name}", position=[x, -0.5, 0])
        made.add_force(name, "spring-damper", between=[f"ground.{name}", f"bar.{name}"],
                       stiffness=500.0, free_length=0.5)  # fmt: skip
    found = flexmb.free_lengths(made, ["b"])
    assert found["b"] == pytest.approx(0.5 + 4.0 * G * 0.5 / 1.0 / 500.0, rel=1e-10)
    both = flexmb.free_lengths(made, ["a", "b"])
    moment, arms = 4.0 * G * 0.5, np.array([0.4, 1.0])
    forces = arms * moment / (arms @ arms)
    np.testing.assert_allclose([both["a"], both["b"]], 0.5 + forces / 500.0, rtol=1e-10)
    with pytest.raises(SceneError, match=r"no spring-damper.*nearest: a"):
        flexmb.free_lengths(made, ["aa"])
    made.joints.clear()
    with pytest.raises(AssemblyError, match=r"no preload of b brings the pose into balance"):
        flexmb.free_lengths(made, ["b"])


def test_neutral_motions_do_not_keep_an_equilibrium_from_being_found():
    """A platform on free legs hangs on one spring: it may turn and swing about it."""
    made = stewart("UTS")
    made.add_force("rope", "spring-damper", between=["ground", "platform"], stiffness=2000.0,
                   free_length=1.0)  # fmt: skip
    with pytest.warns(match=r"neutral|unstable"):
        result = flexmb.statics(made)
    total = sum(body.mass for body in made.bodies.values())
    assert 0.0 < (1.0 - result.q[0, 2]) * 2000.0 < total * G


def test_modes_about_the_equilibrium_of_a_displaced_machine():
    """A pendulum placed level swings about its lowest position."""
    made = Model("level", gravity=[0, -G, 0])
    made.add_body("bar", mass=2.0, center=[0.5, 0, 0], inertia=[0.2, 0.2, 0.3],
                  angular_velocity=[0, 0, 2.0])  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made = flexmb.linearize(made, about="static")
    assert made.notes == ()
    assert abs(made.eigenvalues[0]) == pytest.approx(np.sqrt(2.0 * G * 0.5 / 0.8), rel=1e-9)


def test_a_run_from_the_equilibrium_has_the_states_of_its_controllers():
    """The integral of a PID controller carries a pendulum at its set point, from the start on."""
    made = Model("held", gravity=[0, -9.81, 0])
    made.add_body("bar", mass=2.0, center=[0, -0.5, 0], inertia=[0.2, 0.1, 0.2])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made.add_sensor("angle", "angle", joint="pin")
    gains = {"kp": 5, "ki": 3, "kd": 1, "filter": 0.01}
    made.add_controller("servo", type="pid", input="0.4 - angle", **gains)
    made.add_force("motor", "torque", at="bar", value=[0, 0, "servo"])
    made.add_sensor("torque", "expression", value="servo", unit="N m")
    result = flexmb.simulate(made, duration=0.5, start="static")
    np.testing.assert_allclose(result["angle"], 0.4, atol=1e-9)
    np.testing.assert_allclose(result["torque"], 9.81 * np.sin(0.4), rtol=1e-9)


@pytest.mark.seconds
def test_a_hub_that_is_free_to_turn_with_its_blade_has_one_family_of_equilibria(project):
    """Its rotation has no stiffness but round-off; it was a fault, or 26 equilibria."""
    (one,) = flexmb.equilibria(project / "cases" / "hub_beam" / "scene.toml")
    assert one.neutral_motions == 1
    assert one.linearize().eigenvalues[0] == 0.0


def test_a_ball_at_rest_stays_so_at_any_time():
    """Nothing is to be done, and the free rolling has no stiffness: no step is to be refused."""
    made = flexmb.load_scene(Path(__file__).parents[2] / "cases/bowling_ball/scene.toml")
    sweep = flexmb.sweep_statics(made, "time", [0.0, 1.0, 2.0])
    assert sweep.events == ()
    assert len(sweep.points) == 3
    sunk = (7.0 * 9.80665 / 1e9) ** (2 / 3)
    for point in sweep.points:
        assert point.q[2] == pytest.approx(0.108 - sunk, abs=1e-14)
