"""Gears, racks, screws and linear couplers against closed forms of one freedom or two.

Accelerations and multipliers of one state need no run. Willis: seen from the arm, a planetary train
is one of fixed axes, (ω_sun − ω_arm) / (ω_ring − ω_arm) = −z_ring / z_sun.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench
from scipy.linalg import null_space
from truthkit import order, reference, run

import flexmb
from flexmb.model import Model

LAST_DIGITS = 1e-12


def body(model, name, mass, J, at=(0.0, 0.0, 0.0), axis="z"):
    """A body with moment of inertia J about the axis through its centre."""
    inertia = [J if axis == a else 0.7 * J for a in "xyz"]
    model.add_body(name, mass=mass, inertia=inertia, position=list(at))


def acceleration(bench, name, k):
    """One of the velocity coordinates of a body: 0–2 along, 3–5 about its axes."""
    row = next(row for row in bench.layout.bodies if row.name == name)
    return bench.vd[row.iv + k]


def multiplier(bench, name):
    """What a coupler does to a joint coordinate: minus the multiplier of its row."""
    return -bench.lam[bench.layout.rows.index(f"{name}: coordinate")]


def solved(model):
    bench = Bench(model)
    bench.accelerations(rounds=3)
    return bench


@pytest.mark.parametrize("plane", ["xy", None])
def test_a_train_of_three_wheels_on_fixed_axes(plane):
    """α1 = T / Σ J_k (R1/R_k)²; the force between two wheels carries what lies behind."""
    model = Model("train", plane=plane)
    R, J, T = [0.2, 0.1, 0.3], [0.5, 0.04, 1.1], 7.0
    x = [0.0, R[0] + R[1], R[0] + 2 * R[1] + R[2]]
    for k in range(3):
        body(model, f"w{k}", 1.0 + k, J[k], (x[k], 0, 0))
        model.add_marker(f"ground.p{k}", position=[x[k], 0, 0])
        model.add_joint(f"p{k}", "revolute", between=[f"ground.p{k}", f"w{k}"], axis="z")
    model.add_coupler("first", "gear", joints=["p0", "p1"], radii=R[:2])
    model.add_coupler("second", "gear", joints=["p1", "p2"], radii=R[1:])
    model.add_force("motor", "torque", at="w0", value=[0, 0, T])
    model.add_sensor("tooth", "reaction", coupler="second.p2", quantity="moment")
    bench = solved(model)
    a = T / sum(j * (R[0] / r) ** 2 for j, r in zip(J, R, strict=True))
    found = [acceleration(bench, f"w{k}", 5) for k in range(3)]
    np.testing.assert_allclose(found, [a, -a * R[0] / R[1], a * R[0] / R[2]], rtol=LAST_DIGITS)
    tooth = J[2] * a * R[0] / R[2] / R[2]
    np.testing.assert_allclose(multiplier(bench, "couplers.second.p2"), tooth * R[2], rtol=1e-10)
    np.testing.assert_allclose(multiplier(bench, "couplers.second.p1"), tooth * R[1], rtol=1e-10)
    np.testing.assert_allclose(bench.at().channels, [0, 0, tooth * R[2]], rtol=1e-10, atol=1e-12)
    tooth = (T - J[0] * a) / R[0]
    np.testing.assert_allclose(multiplier(bench, "couplers.first.p0"), -tooth * R[0], rtol=1e-10)


def planetary(planets, plane="xy", ring=False):
    """Sun (20), planets (10), ring (40 teeth): on ground, or a wheel of its own."""
    model = Model("planetary", plane=plane)
    body(model, "arm", 0.8, 0.02)
    body(model, "sun", 0.5, 0.011)
    model.add_joint("arm_pin", "revolute", between=["ground", "arm"], axis="z")
    model.add_joint("sun_pin", "revolute", between=["arm", "sun"], axis="z")
    outer = "arm_pin"
    if ring:
        body(model, "ring", 2.0, 0.09)
        model.add_joint("ring_pin", "revolute", between=["arm", "ring"], axis="z")
        outer = "ring_pin"
    for k in range(planets):
        turn = 2 * np.pi * k / planets
        at = [0.03 * np.cos(turn), 0.03 * np.sin(turn), 0.0]
        body(model, f"planet{k}", 0.2, 0.0013, at)
        model.add_marker(f"arm.p{k}", position=at)
        model.add_joint(f"pin{k}", "revolute", between=[f"arm.p{k}", f"planet{k}"], axis="z")
        inside = {"teeth": [40, 10], "internal": True}
        model.add_coupler(f"sun{k}", "gear", joints=["sun_pin", f"pin{k}"], teeth=[20, 10])
        model.add_coupler(f"ring{k}", "gear", joints=[outer, f"pin{k}"], **inside)
    model.add_force("motor", "torque", at="sun", value=[0, 0, 2.0])
    return model


@pytest.mark.filterwarnings("ignore:couplers.ring")  # three planets repeat one another
@pytest.mark.parametrize("planets", [1, 3])
@pytest.mark.parametrize("plane", ["xy", None])
def test_a_planetary_train_obeys_willis(planets, plane):
    """ω_sun = (1 + 40/20) ω_arm; a planet turns by −2 (ω_sun − ω_arm) on the arm."""
    bench = solved(planetary(planets, plane))
    sun, arm, planet = (acceleration(bench, name, 5) for name in ("sun", "arm", "planet0"))
    J = 0.011 + (0.02 + planets * 0.2 * 0.03**2) / 9 + planets * 0.0013
    np.testing.assert_allclose(sun, 2.0 / J, rtol=LAST_DIGITS)
    np.testing.assert_allclose(arm, sun / 3, rtol=LAST_DIGITS)
    np.testing.assert_allclose(planet - arm, -2 * (sun - arm), rtol=LAST_DIGITS)


def test_the_arm_and_the_ring_share_the_torque_of_a_train_with_two_freedoms():
    """Torques of sun, ring and arm are as 1 : 2 : −3 while the wheels themselves weigh little."""
    bench = solved(planetary(1, ring=True))
    sun, arm, ring, planet = (
        acceleration(bench, name, 5) for name in ("sun", "arm", "ring", "planet0")
    )
    np.testing.assert_allclose((sun - arm) / (ring - arm), -2.0, rtol=LAST_DIGITS)
    # Lagrange: T = ½ Σ J ω², ω_ring = (3 ω_arm − ω_sun)/2, ω_planet = 3 ω_arm − 2 ω_sun.
    M = np.diag([0.011, 0.02 + 0.2 * 0.03**2])
    for J, row in ((0.09, np.array([-0.5, 1.5])), (0.0013, np.array([-2.0, 3.0]))):
        M += J * np.outer(row, row)
    np.testing.assert_allclose([sun, arm], np.linalg.solve(M, [2.0, 0.0]), rtol=1e-10)
    np.testing.assert_allclose(planet, 3 * arm - 2 * sun, rtol=1e-10)


def published(table):
    """A train of the textbook: all wheels hang on an arm, those of one axis at its centre.

    A wheel of a compound is the same body, its gears hang by the same joint.
    """
    model, teeth = Model(table["title"], plane="xy"), table["teeth"]
    compound = table.get("compound", {})
    body(model, "arm", 1.0, 1.0)
    model.add_joint("arm_pin", "revolute", between=["ground", "arm"], axis="z")
    planets = {planet for _, planet, _ in table["gears"]}
    for name in teeth:
        if name not in compound:
            at = [0.3, 0, 0] if name in planets else [0, 0, 0]
            body(model, name, 1.0, 1.0, at)
            model.add_marker(f"arm.{name}", position=at)
            model.add_joint(name, "revolute", between=[f"arm.{name}", name], axis="z")
    for one, two, internal in table["gears"]:
        model.add_coupler(
            f"{one}_{two}", "gear", joints=[compound.get(one, one), two],
            teeth=[teeth[one], teeth[two]], internal=internal,
        )  # fmt: skip
    return model


@pytest.mark.parametrize("name", ["annulus_and_sun", "two_annuli_and_a_compound_wheel"])
def test_epicyclic_trains_of_a_textbook(name):
    """Speeds of all wheels from those of two of them, by the null space of Cq."""
    table = reference("gear_trains", name)
    bench = Bench(published(table))
    bench.at(v=0.0)
    columns = bench.sys.kkt.column >= 0
    allowed = null_space(bench.Cq[:, columns], rcond=1e-10)
    assert allowed.shape[1] == 2
    full = np.zeros((bench.layout.nv, 2))
    full[columns] = allowed
    spin = {row.name: full[row.iv + 5] for row in bench.layout.bodies}
    for case in table["cases"]:
        given, found = case["given"], case["found"]
        share = np.linalg.solve([spin[k] for k in given], list(given.values()))
        for wheel, speed in found.items():
            assert abs(spin[wheel] @ share - speed) < table["digits"]


def test_a_motor_on_the_second_angle_turns_the_body_about_its_own_axis():
    """Told on J in axes that are turned by half a turn about y, and on I the opposite."""
    model = Model("hook")
    model.add_body("b", mass=1.0, inertia=[0.2, 0.3, 0.4])
    axes = {"axis": [0, 1, 0], "second_axis": [0, 0, 1]}
    model.add_joint("hook", "universal", between=["ground", "b"], **axes)
    model.add_driver("cross", joint="hook", angle=0)
    model.add_driver("motor", joint="hook", second_angle="1.5*t**2")
    for on in "IJ":
        for told in ("joint", "global"):
            fields = {"driver": "motor", "quantity": "moment", "on": on, "axes": told}
            model.add_sensor(f"{told}_{on}", "reaction", **fields)
    found = solved(model).at().channels.reshape(4, 3)  # I and J, each in its own and global axes
    np.testing.assert_allclose(found[[1, 3], 2], [-3.0 * 0.4, 3.0 * 0.4], rtol=1e-12)
    np.testing.assert_allclose(found[2, 2], -3.0 * 0.4, rtol=1e-12)


def differential():
    """Bevel differential: side wheels about ±x, a planet about y on a case that turns about x."""
    model = Model("differential")
    body(model, "case", 1.0, 0.05, axis="x")
    model.add_joint("bearing", "revolute", between=["ground", "case"], axis="x")
    for name, x, J in (("left", -0.1, 0.02), ("right", 0.1, 0.03)):
        body(model, name, 0.4, J, (x, 0, 0), "x")
        model.add_marker(f"case.{name}", position=[x, 0, 0])
        model.add_joint(name, "revolute", between=[f"case.{name}", name], axis="x")
    model.add_body("planet", mass=0.1, inertia=[5e-4, 9e-4, 5e-4], position=[0, 0.07, 0])
    model.add_marker("case.planet", position=[0, 0.07, 0])
    model.add_joint("pin", "revolute", between=["case.planet", "planet"], axis="y")
    for name in ("left", "right"):
        model.add_coupler(name, "gear", joints=[name, "pin"], teeth=[16, 10])
    return model


def test_a_bevel_differential_halves_the_torque_and_not_the_speed():
    model = differential()
    model.add_force("engine", "torque", at="case", value=[3.0, 0, 0])
    bench = solved(model)
    case, left, right, planet = (
        acceleration(bench, *key) for key in (("case", 3), ("left", 3), ("right", 3), ("planet", 4))
    )
    np.testing.assert_allclose(case, (left + right) / 2, rtol=LAST_DIGITS)
    np.testing.assert_allclose(abs(planet), 1.6 * abs(left - right) / 2, rtol=LAST_DIGITS)
    mean, half = np.array([0.5, 0.5]), np.array([0.8, -0.8])
    carried = 0.05 + 5e-4 + 0.1 * 0.07**2
    M = np.diag([0.02, 0.03]) + carried * np.outer(mean, mean) + 9e-4 * np.outer(half, half)
    np.testing.assert_allclose([left, right], np.linalg.solve(M, 3.0 * mean), rtol=1e-10)


def racked():
    """Pinion on ground; a rack on a spring."""
    model = Model("rack", plane="xy")
    body(model, "pinion", 2.0, 0.03)
    body(model, "rack", 1.5, 1.0, (0.05, -0.1, 0))
    model.add_marker("ground.track", position=[0, -0.1, 0])
    model.add_joint("pin", "revolute", between=["ground", "pinion"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground.track", "rack"], axis="x")
    model.add_coupler("mesh", "rack-and-pinion", joints=["pin", "guide"], radius=0.1)
    model.add_force("spring", "translational-spring-damper", joint="guide", stiffness=300)
    model.add_sensor("rack", "position", of="rack")
    model.add_sensor("angle", "angle", joint="pin")
    return model


FREQUENCY = np.sqrt(300 / (1.5 + 0.03 / 0.1**2))  # sqrt(k / (m + J/R²))


def test_a_rack_on_a_spring_feels_the_inertia_of_its_pinion():
    bench = Bench(racked())
    bench.q[-2:] = 0.05, 0.0  # the spring's coordinate stands at the stroke
    bench.accelerations(rounds=3)
    np.testing.assert_allclose(acceleration(bench, "rack", 0), -0.05 * FREQUENCY**2, rtol=1e-10)
    spin = acceleration(bench, "pinion", 5)
    np.testing.assert_allclose(spin, -0.05 * FREQUENCY**2 / 0.1, rtol=1e-10)
    tooth = 0.03 * spin / 0.1
    np.testing.assert_allclose(multiplier(bench, "couplers.mesh.guide"), -tooth, rtol=1e-10)
    np.testing.assert_allclose(multiplier(bench, "couplers.mesh.pin"), tooth * 0.1, rtol=1e-10)


def screw():
    model = Model("screw", gravity=[0, 0, -9.81])
    body(model, "nut", 2.0, 0.004)
    model.add_joint("thread", "screw", between=["ground", "nut"], axis="z", pitch=0.05)
    model.add_sensor("nut", "position", of="nut")
    model.add_sensor("turns", "angle", joint="thread")
    return model


FALL = 9.81 / (1 + 0.004 * (2 * np.pi / 0.05) ** 2 / 2.0)  # g / (1 + J (2π/b)²/m)


def test_a_nut_falls_on_its_thread():
    bench = solved(screw())
    np.testing.assert_allclose(acceleration(bench, "nut", 2), -FALL, rtol=LAST_DIGITS)
    np.testing.assert_allclose(acceleration(bench, "nut", 5), -FALL * 2 * np.pi / 0.05, rtol=1e-11)


def test_a_linear_coupler_of_three_is_a_differential():
    """x1 + 2 x2 − x3 = c, on three sliders: multipliers as 1 : 2 : −1, accelerations from them."""
    model = Model("whiffletree", gravity=[-9.0, 0, 0], plane="xy")
    masses, factors = np.array([1.0, 2.0, 4.0]), np.array([1.0, 2.0, -1.0])
    for k, m in enumerate(masses):
        body(model, f"b{k}", m, 1.0, (0, k, 0))
        model.add_marker(f"ground.g{k}", position=[0, k, 0])
        model.add_joint(f"s{k}", "prismatic", between=[f"ground.g{k}", f"b{k}"], axis="x")
    terms = [{"joint": f"s{k}", "coordinate": "stroke", "factor": f} for k, f in enumerate(factors)]
    model.add_coupler("bar", "linear", terms=terms)
    bench = solved(model)
    share = -9.0 * factors.sum() / (factors @ (factors / masses))
    found = [multiplier(bench, f"couplers.bar.s{k}") for k in range(3)]
    np.testing.assert_allclose(found, -share * factors, rtol=1e-10)
    found = [acceleration(bench, f"b{k}", 0) for k in range(3)]
    np.testing.assert_allclose(found, -9.0 - share * factors / masses, rtol=1e-10)


def test_a_rack_on_a_spring_swings_with_its_frequency():
    model = racked()
    steps = [2e-2, 1e-2, 5e-3]
    runs = [run(model, duration=2.0, step=h, outputs=20, newton_tolerance=1e-11) for h in steps]
    wanted = 0.05 * np.cos(FREQUENCY * runs[0].t)
    errors = [np.abs(one["rack.x"] - wanted).max() for one in runs]
    assert 1.9 < order(steps, errors) < 2.1 and errors[-1] < 2e-4
    np.testing.assert_allclose(runs[-1]["angle"], (runs[-1]["rack.x"] - 0.05) / 0.1, atol=1e-9)
    assert runs[-1].mismatch() < 1e-5


def test_a_nut_falls_through_many_turns():
    """Ten metres of thread: no turn is lost."""
    found = run(screw(), duration=2.0, step=1e-3, outputs=20, newton_tolerance=1e-11)
    wanted = -0.5 * FALL * found.t**2
    np.testing.assert_allclose(found["nut.z"], wanted, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found["turns"], wanted * 2 * np.pi / 0.05, rtol=0, atol=1e-4)
    assert abs(wanted[-1]) > 0.2 > 3 * 0.05


@pytest.mark.filterwarnings("ignore:couplers.ring")
def test_a_planetary_train_runs_up():
    """Constant torque: angles grow with t², over three turns; three planets share the load.

    The planets go round with hω up to 0.08, which leaves errors of some 1e-3 (hω)².
    """
    model = planetary(3)
    for name in ("arm_pin", "sun_pin"):
        model.add_sensor(name, "angle", joint=name)
    found = run(model, duration=1.0, step=2e-3, outputs=10, newton_tolerance=1e-11)
    J = 0.011 + (0.02 + 3 * 0.2 * 0.03**2) / 9 + 3 * 0.0013
    wanted = 0.5 * (2.0 / J) / 3 * found.t**2
    np.testing.assert_allclose(found["arm_pin"], wanted, rtol=0, atol=1e-5 * wanted[-1])
    np.testing.assert_allclose(found["sun_pin"], 2 * found["arm_pin"], rtol=0, atol=1e-9)
    assert wanted[-1] > 2 * np.pi


def test_kinematics_counts_the_turns_of_gears():
    """A driven sun, 20 rad ahead of its arm in the end: ω_sun = 3 ω_arm, at every point."""
    model = planetary(1)
    model.forces.clear()
    model.add_driver("motor", joint="sun_pin", angle="10*t")
    model.add_sensor("arm", "angle", joint="arm_pin")
    model.add_sensor("planet", "angle", joint="pin0")
    model.set_kinematics(duration=2.0, outputs=200)
    found = flexmb.kinematics(model)
    np.testing.assert_allclose(found["arm"], 5 * found.time, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found["planet"], -20 * found.time, rtol=0, atol=1e-11)
