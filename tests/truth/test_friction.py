"""Dry friction against closed forms: incline, oscillators, run-down, jamming, stick-slip."""

from __future__ import annotations

import math

import numpy as np
import pytest
from accuracyscenes.bristles import BRISTLES
from accuracyscenes.friction import FRICTION
from accuracyscenes.judging import judged
from accuracyscenes.scene import AWAY, beside_a_large_motion, moved, truth_of
from scipy.optimize import brentq
from truthkit import run

from flexmb.analysis.dynamics.dynamics import prepare_dynamics
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError
from flexmb.model import Model

G = 9.81


def slider(gravity, friction, position=(0, 0, 0), velocity=(0, 0, 0), mass=2.0):
    """A body on a guide along x with friction."""
    made = Model("slider", gravity=gravity)
    made.add_body("block", mass=mass, inertia=[0.01] * 3, position=position, velocity=velocity)
    made.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    made.add_force("rub", "joint-friction", joint="guide", **friction)
    made.add_sensor("place", "position", of="block")
    return made


def on_points(gravity, friction):
    """A block on four points on the plane z = 0, under its weight at rest."""
    made = Model("block", gravity=gravity)
    made.add_body("block", mass=2.0, inertia=[0.01] * 3, position=[0, 0, 0.05])
    points = [[x, y, -0.05] for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    made.add_force(
        "floor", "contact", between=["block", "ground"],
        shapes=[{"type": "points", "points": points}, {"type": "plane"}],
        stiffness=1e6, exponent=1, restitution=0.5, friction=friction,
    )  # fmt: skip
    made.add_sensor("place", "position", of="block")
    return made


BRISTLE = {"stiffness": 1e5, "damping": 800.0}


@pytest.mark.parametrize("made", [slider, on_points])
def test_block_that_stays_does_not_creep(made):
    """tan a < μ: after the load has come on nothing moves any more, over a long time."""
    a = 0.4
    pull = [G * math.sin(a), 0, -G * math.cos(a)]
    found = run(made(pull, {"dynamic": 0.8, **BRISTLE}), duration=20.0, outputs=40, accuracy=1e-5)
    late = found["place.x"][found.t > 1.0]
    points = 1 if made is slider else 4
    # the points take up the weight first, and slide until they have
    within = 1e-3 if made is slider else 0.1
    assert late[-1] == pytest.approx(2.0 * G * math.sin(a) / 1e5 / points, rel=within)
    assert np.ptp(late) < 1e-5 * late[-1]


@pytest.mark.parametrize("method", ["auto", "generalized-alpha", "explicit-rk", "radau"])
def test_points_that_begin_to_touch_come_to_rest_at_one_place(method):
    """Where that is depends on when each point takes up its load, and is known to 1e-3 of the way.

    (Runs by order 8 at 1e-8 to 1e-11 differ by 2e-4, those by generalized-alpha by 1e-3.)
    """
    a = 0.4
    pull = [G * math.sin(a), 0, -G * math.cos(a)]
    knobs = {"duration": 2.0, "outputs": 40}
    made = on_points(pull, {"dynamic": 0.8, **BRISTLE})
    truth = run(made, accuracy=1e-9, method="explicit-rk", verify=False, **knobs).sensors
    found = run(made, accuracy=1e-3, method=method, **knobs)
    assert np.abs(found.sensors - truth).max() < 3e-3 * np.ptp(truth, axis=0).max()


@pytest.mark.parametrize("made", [slider, on_points])
def test_block_that_slides(made):
    """g (sin a − μ cos a)."""
    a = 0.4
    pull = [G * math.sin(a), 0, -G * math.cos(a)]
    friction = {"static": 0.3, "dynamic": 0.2, **BRISTLE}
    found = run(made(pull, friction), duration=0.5, outputs=50, accuracy=1e-3)
    rate = np.polyfit(found.t[25:], found["place.x"][25:], 2)[0] * 2
    assert rate == pytest.approx(G * (math.sin(a) - 0.2 * math.cos(a)), rel=1e-6)


def test_smooth_friction_creeps_as_it_says():
    """μ v/√(v² + v₀²) = tan a, with Stribeck's curve flat there."""
    a, creep = 0.4, 1e-4
    friction = {"dynamic": 0.5, "model": "smooth", "creep_speed": creep}
    pull = [G * math.sin(a), 0, -G * math.cos(a)]
    made = slider(pull, friction)
    found = run(made, duration=0.5, outputs=10, accuracy=1e-3)
    share = math.tan(a) / 0.5
    assert found.v[-1, 0] == pytest.approx(creep * share / math.sqrt(1 - share**2), rel=1e-3)
    notes = prepare_dynamics(compile_system(made), made).notes
    assert any("forces.rub: smooth friction does not stick but creeps" in note for note in notes)


@pytest.mark.parametrize(
    "method",
    [
        pytest.param("radau", marks=pytest.mark.slow),
        pytest.param("generalized-alpha", marks=pytest.mark.seconds),
        "explicit-rk",
    ],
)
@pytest.mark.parametrize("name", FRICTION)
def test_stick_and_slip_are_as_accurate_as_told(name, method):
    """Beside scipy: what is asked for is reached, and no error near it is told three times less."""
    scene = FRICTION[name]
    found = judged(scene.make(1.0), scene.truth, duration=scene.duration, outputs=200,
                   accuracy=1e-4, method=method)  # fmt: skip
    times = 10 if (name, method) == ("block on bristles", "radau") else 3  # damps what it excites
    assert found.is_reached(1e-4 / 2) and found.achieved < max(times * found.told, 0.2 * 1e-4)


def test_oscillator_with_friction():
    """Each half cycle is 2 μ m g/k shorter, and it stops in the dead band |x| < μ m g/k."""
    k, m, mu, start = 400.0, 1.0, 0.3, 0.05
    made = slider([0, 0, -G], {"dynamic": mu, "stiffness": 4e5, "damping": 100.0},
                  position=[start, 0, 0], mass=m)  # fmt: skip
    made.add_marker("ground.wall", position=[-2, 0, 0])
    made.add_force(
        "spring", "spring-damper", between=["ground.wall", "block"], stiffness=k, free_length=2.0
    )
    found = run(made, duration=1.0, outputs=2000, accuracy=1e-4)
    x, band = found["place.x"], mu * m * G / k
    turns = [x[i] for i in range(1, len(x) - 1) if (x[i] - x[i - 1]) * (x[i + 1] - x[i]) < 0]
    wanted = [(-1) ** n * (start - 2 * n * band) for n in (1, 2, 3)]
    # the bristle takes up to μ m g/4e5 = 7e-6 m of way at each turn
    np.testing.assert_allclose(turns[:3], wanted, atol=5e-5)
    assert abs(x[-1]) < band
    assert np.ptp(x[found.t > 0.8]) < 1e-5


RUBBED = {"prismatic": {"length": 0.4}, "revolute": {"radius": 0.03, "length": 0.1}}


def without_load(kind, push=0.0):
    """A body whose joint bears nothing until a step of the force across the guide or axle."""
    made = Model("unloaded", gravity=[0, 0, 0])
    place = [0.7, 0.5, -1.1]
    made.add_marker("ground.there", position=place)
    made.add_body("block", mass=1, center=[0.1, 0.2, -0.3], inertia=[0.1, 0.2, 0.3], position=place)
    made.add_joint("joint", kind, between=["ground.there", "block"], axis=[1, 1, 1])
    made.add_force("rub", "joint-friction", joint="joint", dynamic=0.2, stiffness=1e4, damping=80,
                   **RUBBED[kind])  # fmt: skip
    made.add_force("push", "force", at="block", value=[f"{push}*step(t, 1, 0, 1.1, 1)", 0, 0])
    made.add_sensor("place", "position", of="block")
    return made


@pytest.mark.parametrize("method", ["radau", "generalized-alpha", "explicit-rk"])
@pytest.mark.parametrize("kind", RUBBED)
@pytest.mark.parametrize("beside", [False, True])
def test_a_joint_without_load_has_no_friction(kind, method, beside):
    """Its bearing load is round-off, and bristles of that length would slip and stick for ever."""
    made = without_load(kind)
    made = beside_a_large_motion(made) if beside else made
    found = judged(made, duration=2.0, outputs=20, accuracy=1e-5, method=method)
    assert not found.message
    assert found.steps < 100


@pytest.mark.parametrize(
    "method", ["radau", pytest.param("generalized-alpha", marks=pytest.mark.seconds), "explicit-rk"]
)
@pytest.mark.parametrize("place", ["plain", "moved", "beside"])
def test_friction_begins_with_the_load(place, method):
    """At rest until a force F sets in, then s'' = (F·a - μ N)/m along the axis a of the guide.

    With the centre of mass at c across it, both ends of a bearing of length L bear
    |F - (F·a) a ± 2 m s'' c/L|/2.
    """
    made = without_load("prismatic", push=30.0)
    made = {"plain": made, "moved": moved(made), "beside": beside_a_large_motion(made)}[place]
    knobs = {"duration": 2.0, "outputs": 200, "accuracy": 1e-5, "method": method}
    found = run(made, **knobs)
    rests, slides = found.t < 1.0, found.t > 1.2
    assert np.ptp(found["place.x"][rests]) < 1e-11
    axis, force, center = np.ones(3) / math.sqrt(3), np.array([30.0, 0, 0]), [0.1, 0.2, -0.3]
    across = force - (force @ axis) * axis

    def excess(a):
        ends = (0.5 * across + sign * a * np.array(center) / 0.4 for sign in (-1, 1))
        return force @ axis - 0.2 * sum(map(np.linalg.norm, ends)) - a

    wanted = brentq(excess, 0.0, 30.0)
    way = found["place.x"][slides] / axis[0]
    assert 2 * np.polyfit(found.t[slides], way, 2)[0] == pytest.approx(wanted, rel=1e-5)


def test_rotor_that_runs_down():
    """Torque μ r W in the pin: it stops after J ω/(μ r W) and J ω²/(2 μ r W)."""
    weight, J, spin, mu, r = 2 * G, 0.05, 10.0, 0.2, 0.02
    made = Model("rotor", gravity=[0, -G, 0])
    made.add_body("rotor", mass=2.0, inertia=[0.1, 0.1, J], angular_velocity=[0, 0, spin])
    made.add_joint("pin", "revolute", between=["ground", "rotor"], axis="z")
    made.add_force("rub", "joint-friction", joint="pin", dynamic=mu, radius=r, stiffness=1e6,
                   damping=2000)  # fmt: skip
    made.add_sensor("angle", "angle", joint="pin")
    stop = J * spin / (mu * r * weight)
    found = run(made, duration=1.5 * stop, outputs=150, accuracy=1e-4)
    running = found.t < 0.95 * stop
    slowing = spin - mu * r * weight / J * found.t[running]
    np.testing.assert_allclose(found.v[running, 5], slowing, atol=1e-3 * spin)
    assert found["angle"][-1] == pytest.approx(spin * stop / 2, rel=1e-3)
    assert np.abs(found.v[found.t > 1.2 * stop, 5]).max() < 1e-3


def brake(mu, force=50.0):
    """A guide of length 0.4 m pushed along it at 0.5 m from its axis."""
    made = slider(None, {"dynamic": mu, "length": 0.4, **BRISTLE})
    made.add_marker("block.edge", position=[0, 0.5, 0])
    made.add_force("push", "force", at="block.edge", value=[force, 0, 0])
    return made


def test_a_drawer_jams():
    """Pushed at the arm b a guide of length L jams from μ = L/(2 b) on, however hard the push."""
    found = run(brake(0.2), duration=0.2, outputs=20, accuracy=1e-3)
    rate = np.polyfit(found.t[10:], found["place.x"][10:], 2)[0] * 2
    assert rate == pytest.approx(25.0 * (1 - 0.2 * 2 * 0.5 / 0.4), rel=1e-5)
    for push in (50.0, 500.0):
        found = run(brake(0.45, push), duration=0.2, outputs=20, accuracy=1e-3)
        assert found["place.x"][-1] < 3 * push / 1e5


def beside(mu, **friction):
    """A body of weight W at b = 0.6 m beside its guide of length 0.4 m, moving along it.

    Friction f turns it, which makes more friction: N² = W² + (2 b f/L)² and f = μ N, so
    N = W/√(1 − (2 μ b/L)²), and from 2 μ b/L = 1 on there is no solution.
    """
    made = Model("lock", gravity=[0, -G, 0])
    made.add_body("arm", mass=1.0, inertia=[0.01] * 3, center=[0.6, 0, 0], velocity=[0, 0, 1.0])
    made.add_joint("guide", "prismatic", between=["ground", "arm"], axis="z")
    made.add_force("rub", "joint-friction", joint="guide", dynamic=mu, length=0.4, **friction)
    made.add_sensor("place", "position", of="arm")
    return made


@pytest.mark.parametrize("mu", [0.1, 0.25])
def test_friction_that_feeds_itself(mu):
    """2 μ b/L = 0.3 and 0.75: the normal force of each iterate depends on friction itself."""
    found = run(beside(mu, **BRISTLE), duration=0.1, outputs=50, accuracy=1e-3)
    slowing = mu * G / math.sqrt(1 - (2 * mu * 0.6 / 0.4) ** 2)
    rate = np.polyfit(found.t[10:], found["place.z"][10:], 2)[0] * 2
    assert rate == pytest.approx(-slowing, rel=1e-5)


def test_a_guide_that_locks_itself_stops_on_its_bristle():
    found = run(beside(0.5, **BRISTLE), duration=0.05, outputs=50, accuracy=1e-3)
    assert 0.0 < found["place.z"].max() < 1.0 * math.sqrt(1.0 / 1e5)


def test_smooth_friction_that_locks_itself_is_told():
    with pytest.raises(AssemblyError, match="locks itself"):
        run(beside(0.5, model="smooth", creep_speed=1e-3), duration=0.1, outputs=5, accuracy=1e-3)


def test_stick_slip_on_a_belt():
    """Coulomb's two coefficients, spring k, mass m, belt speed V: period and turning points.

    While it slips x − x_d = D cos ωt + V/ω sin ωt, D = (μ_s − μ_d) m g/k, until it is as fast as
    the belt again, at −D; while it sticks it rides 2 D: T = (π + 2 arctan(V/(ω D)))/ω + 2 D/V.
    """
    k, m, static, dynamic, V = 100.0, 1.0, 0.4, 0.2, 0.1
    made = Model("belt", gravity=[0, 0, -G])
    for name in ("belt", "block"):
        made.add_body(name, mass=m, inertia=[0.01] * 3)
    made.add_joint("drum", "prismatic", between=["ground", "belt"], axis="x")
    made.add_driver("run", joint="drum", stroke=f"{V}*t")
    made.add_joint("guide", "prismatic", between=["belt", "block"], axis="x")
    made.add_marker("ground.wall", position=[-2, 0, 0])
    made.add_force(
        "spring", "spring-damper", between=["ground.wall", "block"], stiffness=k, free_length=2.0
    )
    made.add_force(
        "rub", "joint-friction", joint="guide", static=static, dynamic=dynamic,
        stribeck_speed=1e-3, stiffness=1e5, damping=200,
    )  # fmt: skip
    made.add_sensor("place", "position", of="block")
    found = run(made, duration=2.6, outputs=2600, accuracy=1e-3)
    x, omega = found["place.x"], math.sqrt(k / m)
    D, middle = (static - dynamic) * m * G / k, dynamic * m * G / k
    reach = math.hypot(D, V / omega)
    peaks = [
        found.t[i] for i in range(1, len(x) - 1) if x[i - 1] < x[i] >= x[i + 1] and x[i] > middle
    ]
    period = (math.pi + 2 * math.atan(V / (omega * D))) / omega + 2 * D / V
    # until Stribeck's curve falls, about √(2 m v_s/(k V)) = 14 ms pass, in which the belt carries
    # the block on by up to 1.4 mm; below the speed k V/1e5 of the bristle it would fall too soon
    assert np.diff(peaks)[-1] == pytest.approx(period, rel=1e-2)
    late = x[found.t > 0.5]
    assert late.max() == pytest.approx(middle + reach, abs=0.02 * reach)
    assert late.min() == pytest.approx(middle - reach, abs=0.02 * reach)


ELSEWHERE = {
    "as it is": (1.0, (0.0, 0.0, 0.0)),
    "1 um": (1e-6, (0.0, 0.0, 0.0)),
    "1 km": (1.0, AWAY),
}


@pytest.mark.parametrize("asked", [1e-3, 1e-6])
@pytest.mark.parametrize("method", ["radau", "explicit-rk"])
@pytest.mark.parametrize("where", ELSEWHERE)
@pytest.mark.parametrize("name", BRISTLES)
def test_bristles_of_contacts_do_not_hide_their_error(name, where, method, asked):
    """Balls roll, and paths are curved, by the order of the method.

    Errors below a hundredth of the request may be told less well: a few steps leave them.
    """
    scene, (size, away) = BRISTLES[name], ELSEWHERE[where]
    made = moved(scene.make(size)) if away is AWAY else scene.make(size)
    found = judged(made, lambda t: truth_of(scene, t, size, away), duration=scene.duration,
                   outputs=100, accuracy=asked, method=method)  # fmt: skip
    assert found.is_reached(asked / 2)
    assert found.achieved < max(3 * found.told, 0.01 * asked)


GUIDES = tuple(name for name in FRICTION if name.startswith("guide"))


@pytest.mark.parametrize("method", [pytest.param("radau", marks=pytest.mark.slow), "explicit-rk"])
@pytest.mark.parametrize("where", ELSEWHERE)
@pytest.mark.parametrize("name", GUIDES)
def test_a_guide_under_changing_load_follows_the_law_of_its_bristle(name, where, method):
    """Errors of 4e-7 were told a thirtieth, whatever was asked for: lengths depended on steps."""
    scene, (size, away) = FRICTION[name], ELSEWHERE[where]
    made = moved(scene.make(size)) if away is AWAY else scene.make(size)
    found = judged(made, lambda t: truth_of(scene, t, size, away), duration=scene.duration,
                   outputs=100, accuracy=1e-7, method=method)  # fmt: skip
    assert found.is_reached(1e-7 / 2)
    assert found.achieved < max(5 * found.told, 2e-8 if away is not AWAY else 1e-7)  # round-off


@pytest.mark.parametrize("name", GUIDES)
def test_a_guide_a_kilometre_away_takes_no_more_steps(name):
    """Stiff forces of round-off in places were taken for the limit of stability: up to 60 635."""
    scene = FRICTION[name]
    knobs = {"duration": scene.duration, "outputs": 100, "method": "explicit-rk", "verify": False,
             "accuracy": 1e-6}  # fmt: skip
    here, there = (judged(m, **knobs) for m in (scene.make(1.0), moved(scene.make(1.0))))
    assert there.steps < 1.2 * here.steps


@pytest.mark.parametrize("name", BRISTLES)
def test_bristles_of_contacts_beside_a_large_motion(name):
    scene = BRISTLES[name]
    found = judged(beside_a_large_motion(scene.make(1.0)), scene.truth, duration=scene.duration,
                   outputs=100, accuracy=1e-6)  # fmt: skip
    assert found.achieved < min(max(3 * found.told, 1e-8), 1e-6)


def test_an_egg_does_not_chatter_between_laws_of_friction():
    """It slides across the direction of its bristle: both methods find the same few events."""
    made = Model("egg", gravity=[0, 0, -G])
    made.add_body("egg", mass=1.0, inertia=[0.004, 0.006, 0.003], center=[0.01, 0.005, -0.01],
                  position=[0, 0, 0.12], velocity=[1, 0.3, 0],
                  angular_velocity=[5, -3, 2])  # fmt: skip
    made.add_force(
        "floor", "contact", between=["egg", "ground"], stiffness=1e6, restitution=0.3,
        shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}],
        friction={"static": 0.35, "dynamic": 0.3, "stribeck_speed": 0.1, "stiffness": 1e5,
                  "damping": 50},
    )  # fmt: skip
    made.add_sensor("place", "position", of="egg")
    knobs = {"duration": 0.4, "outputs": 40, "accuracy": 1e-6}
    found, other = (run(made, method=method, **knobs) for method in ("explicit-rk", "radau"))
    assert found.statistics["events"] < 20 and other.statistics["events"] < 20
    np.testing.assert_allclose(found["place.x"], other["place.x"], atol=1e-6)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-7])
def test_contacts_a_kilometre_away_do_not_resolve_round_off(accuracy):
    """Steps were as short as the last digit of a place turns the block: up to 2.4 million."""
    scene = FRICTION["block on points"]
    found = judged(moved(scene.make(1.0)), lambda t: truth_of(scene, t, 1.0, AWAY),
                   duration=scene.duration, outputs=100, accuracy=accuracy)  # fmt: skip
    assert found.is_reached(accuracy) and found.steps < 30_000
