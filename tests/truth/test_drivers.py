"""Drivers against closed forms: inverse kinematics, a cylinder, speeds and accelerations."""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import beside_a_large_motion
from accuracyscenes.judging import judged
from flexiblescenes import rod
from generators import cloud, interface
from scipy.integrate import solve_ivp
from truthkit import Memory, run

import flexmb
from flexmb.analysis.dynamics.dynamics import prepare_dynamics, run_dynamics
from flexmb.engine.compile import compile_system
from flexmb.errors import FlexmbWarning
from flexmb.model import Model

L1, L2 = 1.0, 0.8


def multiplier(result, row):
    """Multiplier of a row by its name."""
    return result.lam[:, result.layout.rows.index(row)]


def arm(elbow, plane):
    """Two links whose tip is led along an ellipse; the elbow bends to the left or to the right."""
    tip = np.array([1.3, 0.5])
    c2 = (tip @ tip - L1**2 - L2**2) / (2 * L1 * L2)
    bend = elbow * np.arccos(c2)
    first = np.arctan2(tip[1], tip[0]) - np.arctan2(L2 * np.sin(bend), L1 + L2 * np.cos(bend))
    model = Model("arm", plane=plane, gravity=[0, -9.81, 0])
    x = L1 * np.cos(first), L1 * np.sin(first)
    for name, angle, place, length in (
        ("upper", first, (0, 0), L1), ("lower", first + bend, x, L2)
    ):  # fmt: skip
        model.add_body(
            name, mass=2, center=[length / 2, 0, 0], inertia=[0.1, 0.2, 0.2],
            position=[*place, 0], orientation={"axis": "z", "angle": angle},
            markers={"tip": {"position": [length, 0, 0]}},
        )  # fmt: skip
    model.add_joint("shoulder", "revolute", between=["ground", "upper.origin"])
    model.add_joint("elbow", "revolute", between=["upper.tip", "lower"])
    model.add_sensor("shoulder", "angle", joint="shoulder")
    model.add_sensor("elbow", "angle", joint="elbow")
    path = ["1.3 + 0.2*sin(3*t)", "0.3 + 0.2*cos(3*t)"]
    if plane:
        model.add_driver("tip", marker="lower.tip", position=path)
    else:
        model.add_driver("tip", marker="lower.tip", x=path[0], y=path[1])
    return run(model, duration=1.0, step=0.05, outputs=10)


def crane():
    """A boom lifted by a cylinder."""
    model = Model("crane", plane="xy", gravity=[0, -9.81, 0])
    model.add_body(
        "boom", mass=100, center=[1, 0, 0], inertia=[20, 30, 40],
        markers={"eye": {"position": [1.5, 0, 0]}},
    )  # fmt: skip
    model.add_marker("ground.foot", position=[0, -1, 0])
    model.add_joint("pivot", "revolute", between=["ground", "boom"], axis="z")
    length = "sqrt(3.25) + step5(t, 0, 0, 1, 0.4)"
    model.add_driver("cylinder", between=["ground.foot", "boom.eye"], distance=length)
    model.add_sensor("boom", "angle", joint="pivot")
    return run(model, duration=1.2, step=0.03, outputs=20)


WHEELS = {
    "speed": {"angle": "40 + 5*sin(7*t)", "prescribes": "velocity", "start": 0.3},
    "spin-up": {"angle": {"type": "step5", "t1": 0.5, "y1": 60}, "prescribes": "velocity"},
    "acceleration": {
        "angle": "20*cos(4*t) + abs(t - 0.3)", "prescribes": "acceleration", "start": 0.3,
        "start_velocity": -2.0,
    },
}  # fmt: skip


def wheel(name, flexible=False):
    """A wheel on an axle with a motor."""
    model = Model("wheel")
    if flexible:
        rng = np.random.default_rng(5)
        made = cloud(rng, 3)
        model.set_assembly()  # the hub is somewhere in the body
        model.add_body("wheel", made.flexbody("wheel", [interface(rng, "hub", 3)]))
        at = "wheel.hub"
    else:
        model.add_body("wheel", mass=3, center=[0.1, 0, 0], inertia=[0.4, 0.5, 0.7])
        at = "wheel.origin"
    model.add_joint("axle", "revolute", between=["ground", at], axis="z")
    model.add_driver("motor", joint="axle", **WHEELS[name])
    model.add_sensor("angle", "angle", joint="axle")
    if flexible:
        return run(model, duration=0.1, step=0.0025, outputs=10)
    return run(model, duration=1.0, step=0.02, outputs=10)


CLOSED = 1e-9  # of the constraints that outputs are put back on, through the lever of the arm


@pytest.mark.parametrize("plane", ["xy", None])
@pytest.mark.parametrize("elbow", [1, -1])
def test_a_led_tip_solves_the_inverse_kinematics(elbow, plane):
    """Both branches of the two-link arm (law of cosines); the one of the placed pose is kept."""
    a, b = L1, L2
    found = arm(elbow, plane)
    t = found.t
    x, y = 1.3 + 0.2 * np.sin(3 * t), 0.3 + 0.2 * np.cos(3 * t)
    bend = elbow * np.arccos((x**2 + y**2 - a**2 - b**2) / (2 * a * b))
    first = np.arctan2(y, x) - np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
    np.testing.assert_allclose(found["elbow"], bend, atol=CLOSED)
    np.testing.assert_allclose(found["shoulder"], first, atol=CLOSED)


def boom(t):
    """Angle of the boom and its two derivatives from the length of the cylinder.

    With lever a and foot b below the pivot, d² = a² + b² + 2ab sin θ.
    """
    a, b = 1.5, 1.0
    s = np.clip(t, 0.0, 1.0)
    d = np.sqrt(3.25) + 0.4 * s**3 * (10 - 15 * s + 6 * s**2)
    d1, d2 = 0.4 * 30 * s**2 * (1 - s) ** 2, 0.4 * 60 * s * (1 - s) * (1 - 2 * s)
    sine = (d**2 - a**2 - b**2) / (2 * a * b)
    angle = np.arcsin(sine)
    w = d * d1 / (a * b * np.cos(angle))
    acceleration = ((d1**2 + d * d2) / (a * b) + np.sin(angle) * w**2) / np.cos(angle)
    return angle, w, acceleration, d


def test_a_distance_is_the_stroke_of_a_cylinder_and_its_multiplier_the_force():
    found = crane()
    t = found.t
    angle, _, acceleration, d = boom(t)
    np.testing.assert_allclose(found["boom"], angle, atol=CLOSED)
    # moment about the pivot: force times its lever a b cos θ / d
    moment = (40.0 + 100.0) * acceleration + 100.0 * 9.81 * np.cos(angle)
    force = moment * d / (1.5 * np.cos(angle))
    wanted = -multiplier(found, "drivers.cylinder: driven distance")
    np.testing.assert_allclose(wanted, force, rtol=1e-8)


@pytest.mark.parametrize(
    ("name", "angle", "acceleration"),
    [
        (
            "speed",
            lambda t: 0.3 + 40 * t + 5 / 7 * (1 - np.cos(7 * t)),
            lambda t: 35 * np.cos(7 * t),
        ),
        (
            "acceleration",
            lambda t: (
                0.3 - 2 * t + 1.25 * (1 - np.cos(4 * t)) + 0.15 * t**2 - t**3 / 6
                + np.maximum(t - 0.3, 0) ** 3 / 3
            ),
            lambda t: 20 * np.cos(4 * t) + np.abs(t - 0.3),
        ),
    ],
)  # fmt: skip
def test_rates_are_integrated_and_the_multiplier_is_the_torque(name, angle, acceleration):
    found = wheel(name)
    t = found.t
    np.testing.assert_allclose(found["angle"], angle(t), atol=1e-9)
    torque = 0.7 + 3 * 0.1**2  # about the axle, per rad/s²
    found_torque = -multiplier(found, "drivers.motor: driven")
    np.testing.assert_allclose(found_torque, torque * acceleration(t), rtol=1e-8, atol=1e-7)


def test_a_wheel_spun_up_has_turned_by_the_area_of_its_speed():
    found = wheel("spin-up")
    t = found.t
    late = t >= 0.5
    wanted = 60.0 * (t[late] - 0.25)
    assert wanted[-1] > 14 * np.pi
    np.testing.assert_allclose(found["angle"][late], wanted, atol=1e-9)


def test_a_flexible_body_is_driven_at_its_interface():
    found = wheel("speed", flexible=True)
    t = found.t
    wanted = 0.3 + 40 * t + 5 / 7 * (1 - np.cos(7 * t))
    np.testing.assert_allclose(found["angle"] - wanted, 0.0, atol=1e-8)


def test_a_plate_led_in_space_needs_its_weight_and_inertia():
    model = Model("platform", gravity="earth -z")
    model.add_body("plate", mass=20, inertia=[1, 1, 2], position=[0, 0, 1.0])
    goal = {"x": "0.1*sin(t)", "y": "0.1*t", "z": "1 + 0.2*t**2"}
    model.add_driver("place", marker="plate.origin", **goal)
    model.add_joint("level", "orientation", between=["ground", "plate"])
    found = run(model, duration=1.0, step=0.05, outputs=10)
    t = found.t
    for axis, force in (
        ("x", -20 * 0.1 * np.sin(t)),
        ("y", 0 * t),
        ("z", 20 * (9.80665 + 0.4) + 0 * t),
    ):
        given = -multiplier(found, f"drivers.place: driven {axis}")
        np.testing.assert_allclose(given, force, atol=1e-7)


@pytest.mark.parametrize("name", ["arm 1 xy", "arm -1 None", "crane", "speed", "spin-up"])
def test_the_drivers_do_the_work(name):
    """Their power is summed by the trapezoidal rule over steps of 0.02 to 0.05 s: (w h)²/12."""
    if name.startswith("arm"):
        found = arm(1, "xy") if name == "arm 1 xy" else arm(-1, None)
    else:
        found = crane() if name == "crane" else wheel(name)
    assert found.mismatch() / np.abs(found.energy).max() < 1e-2


@pytest.mark.parametrize("method", ["auto", "explicit-rk", "radau"])
def test_a_velocity_that_jumps_moves_what_hangs_on_it_by_its_impulse(method):
    """A rod hangs on a slider that suddenly moves: about its end, I w = m v L/2 of the rod.

    From rest at t = 0.3 the pin moves with v; the angular momentum of the rod about the pin stays
    zero in the impact, so that w = -3 v/(2 L), in the axes of the pin.
    """
    length, speed = 0.8, 0.05
    model = Model("slider with a rod", gravity=[0, 0, 0])
    model.add_body("slider", mass=1.0, inertia=[1, 1, 1])
    model.add_body("rod", mass=2.0, center=[0, -length / 2, 0],
                   inertia=[2 * length**2 / 12, 1e-3, 2 * length**2 / 12])  # fmt: skip
    model.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    model.add_joint("pin", "revolute", between=["slider", "rod"], axis="z")
    model.add_driver("d", joint="guide", stroke=f"max({speed}*(t - 0.3), 0)")
    model.add_sensor("turn", "angular_velocity", of="rod")
    model.set_dynamics(duration=0.31, outputs=[0.0, 0.29, 0.301, 0.31], method=method)
    with pytest.warns(FlexmbWarning, match="an impact"):
        run = flexmb.simulate(model)
    assert run["turn.z"][:2] == pytest.approx(0.0, abs=1e-9)
    assert abs(run["turn.z"][2]) == pytest.approx(1.5 * speed / length, rel=1e-5)


@pytest.mark.parametrize("method", ["explicit-rk", "radau", "generalized-alpha"])
def test_a_run_resumed_at_a_jump_knows_of_it(method, tmp_path):
    """A force of 2 N on 1 kg turns round at 1 s, the end of the first run."""
    made = Model("turned round")
    made.add_body("m", mass=1, inertia=[1, 1, 1])
    made.add_force("push", "force", at="m", value=["-2*sign(t - 1)", 0, 0])
    made.add_sensor("m", "position", of="m")
    knobs = {"outputs": 10, "method": method, "accuracy": 1e-4}
    short = flexmb.simulate(made, output=tmp_path / "short", duration=1.0, **knobs)
    found = flexmb.resume(short, duration=2.0)
    t = np.linspace(0, 2, 21)
    np.testing.assert_allclose(found.time, t, atol=1e-15)
    np.testing.assert_allclose(found["m.x"], t**2 - 2 * np.maximum(t - 1, 0) ** 2, atol=1e-12)


def blow(duration):
    """A pendulum at rest on a cart that a driver leads with 1 m/s from 0.6 of the run on."""
    model = Model("blow", gravity=[0, -9.81, 0])
    model.add_body("cart", mass=1.0, inertia=[0.01] * 3)
    model.add_body("bob", mass=0.5, inertia=[0.01] * 3, position=[0, -0.3, 0])
    model.add_marker("bob.pin", position=[0, 0.3, 0])
    model.add_joint("guide", "prismatic", between=["ground", "cart"], axis="x")
    model.add_joint("pin", "revolute", between=["cart", "bob.pin"], axis="z")
    begin, end = 0.6 * duration, 2.0 * duration
    points = [[0, 0], [begin, 0], [end, end - begin]]
    model.add_driver("motor", joint="guide", stroke={"type": "table", "points": points})
    model.add_sensor("swing", "angle", joint="pin")
    return model


@pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")
@pytest.mark.parametrize("beside", [False, True], ids=["alone", "beside a flywheel"])
@pytest.mark.parametrize("method", ["generalized-alpha", "radau", "explicit-rk"])
@pytest.mark.parametrize("duration", [1.0, 10.0])
def test_a_speed_that_jumps_after_a_rest_is_a_blow(duration, method, beside):
    """J ω = m l V about the pin, and then energy is kept on a cart that moves evenly.

    Steps at rest are long; M + b ∂F/∂q of the last one took up to a half of the blow away.
    """
    model = blow(duration)
    if beside:
        beside_a_large_motion(model)
    model.set_dynamics(duration=duration, outputs=60, method=method, accuracy=1e-3)
    memory, made = Memory(), compile_system(model)
    ended = run_dynamics(prepare_dynamics(made, model), memory)
    t, q, v = memory.tables()[:3]
    bob = made.layout.bodies[1]
    turn, rate = 2 * np.arctan2(q[:, bob.iq + 6], q[:, bob.iq + 3]), v[:, bob.iv + 5]
    J, ml, after = 0.01 + 0.5 * 0.3**2, 0.5 * 0.3, t > 0.61 * duration
    energy = 0.5 * J * rate**2 + ml * 9.81 * (1 - np.cos(turn))
    assert abs(rate[t < 0.59 * duration]).max() < 1e-9
    np.testing.assert_allclose(energy[after], 0.5 * ml**2 / J, rtol=4e-3)
    assert ended.statistics["measured_error_of_positions"] < 1e-3
    assert ended.statistics["passes"] <= 2


def struck_arm():
    """A flexible arm in its equilibrium whose hub turns with 5 rad/s from 0.15 s to 0.35 s."""
    model = Model("struck arm", gravity=[0, -9.81, 3.0])
    model.add_body("arm", rod(0.006, damping=0.01))
    model.add_joint("hub", "revolute", between=["ground", "arm.root"], axis="z")
    points = [[0, 0], [0.15, 0], [0.35, 1.0], [1.0, 1.0]]
    model.add_driver("motor", joint="hub", angle={"type": "table", "points": points})
    model.add_sensor("tip", "position", of="arm.tip")
    return model


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")
@pytest.mark.parametrize("method", ["generalized-alpha", "radau"])
def test_a_blow_bends_an_arm(method):
    """Of what it bends by M + b ∂F/∂q of a long step took all: 0.6 % and 3 % off, in 6400 steps."""
    knobs = {"duration": 0.5, "outputs": 60, "start": "quasi-static"}
    true = run(struck_arm(), method="explicit-rk", accuracy=1e-6, verify=False, **knobs)
    found = run(struck_arm(), method=method, accuracy=1e-3, **knobs)
    off = np.abs(found.vector("tip") - true.vector("tip")).max()
    assert off < 1e-3 * np.ptp(true.vector("tip"), axis=0).max()
    assert found.statistics["steps"] < 5000


LIFT, RATE, MASS, G = 0.02, 40.0, 2.0, 9.81


def table(t):
    """A table that a driver shakes; its energy."""
    made = Model("table", gravity=[0, 0, -G])
    made.add_body("table", mass=MASS, inertia=[0.01] * 3)
    made.add_marker("table.far", position=[1, 0, 0])
    made.add_joint("rail", "prismatic", between=["ground", "table"], axis="z")
    made.add_driver("motor", joint="rail", stroke=f"{LIFT}*sin({RATE}*t)")
    made.add_sensor("table", "position", of="table.far")
    z, v = LIFT * np.sin(RATE * t), LIFT * RATE * np.cos(RATE * t)
    return made, MASS * (0.5 * v**2 + G * z)


def crank(t):
    """A slider-crank that a motor turns evenly; its energy."""
    made, a, b, w = Model("crank", gravity=[0, 0, -G]), 0.1, 0.3, 30.0
    made.add_body("crank", mass=1, inertia=[1e-3] * 3)
    made.add_body("rod", mass=1, inertia=[5e-3] * 3, position=[a, 0, 0], center=[b / 2, 0, 0])
    made.add_body("slider", mass=2, inertia=[1e-3] * 3, position=[a + b, 0, 0])
    made.add_marker("crank.pin", position=[a, 0, 0])
    made.add_marker("rod.end", position=[b, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="y")
    made.add_joint("pin", "revolute", between=["crank.pin", "rod"], axis="y")
    made.add_joint("end", "cylindrical", between=["rod.end", "slider"], axis="y")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle=f"-{w}*t")
    made.add_sensor("slider", "position", of="slider")
    turn = w * t
    rod = -np.arcsin(a / b * np.sin(turn))
    rate = -a / b * w * np.cos(turn) / np.cos(rod)
    vx = -a * w * np.sin(turn) - b * np.sin(rod) * rate
    x, z = -a * w * np.sin(turn) - 0.5 * b * np.sin(rod) * rate, 0.5 * a * w * np.cos(turn)
    return made, vx**2 + 0.5 * (x**2 + z**2 + 5e-3 * rate**2) + 0.5 * a * G * np.sin(turn)


@pytest.mark.parametrize("beside", ["", "flight", "spring"])
@pytest.mark.parametrize("driven", [table, crank])
@pytest.mark.parametrize(
    ("method", "accuracy"), [("radau", 1e-3), ("radau", 1e-5), ("generalized-alpha", 1e-3)]
)
def test_work_of_a_driver_whose_motion_has_no_error(driven, beside, method, accuracy):
    """Steps of a third of its period and more were taken: works were up to 40 times too large."""
    if beside == "spring" and method == "generalized-alpha":
        pytest.skip("its steps are limited only without stiffness")
    t = np.linspace(0.0, 2.0, 101)
    made, energy = driven(t)
    if beside:
        made.add_body("b", mass=0.1, inertia=[1e-4] * 3, velocity=[0, 0, 9])
        made.add_sensor("b", "position", of="b")
    if beside == "spring":
        made.add_joint("line", "prismatic", between=["ground", "b"], axis="z")
        made.add_force("spring", "translational-spring-damper", joint="line", stiffness=0.4)
    result = flexmb.simulate(made, duration=2.0, outputs=100, accuracy=accuracy, method=method)
    error = np.abs(result.energy["driver_work"] - energy + energy[0]).max() / np.ptp(energy)
    assert error < (10 if method == "generalized-alpha" else 1) * accuracy
    assert not any("energy" in str(note) for note in result.notes), result.notes


ROPE, WAY, BEGIN, END = 5.0, 10.0, 3.0, 5.0


def load_crane():
    """A trolley that rests, is driven by `step5`, and rests; its load swings."""
    made = Model("crane", plane="xy", gravity=[0, -G, 0])
    made.add_body("trolley", mass=100, inertia=[1] * 3)
    made.add_body("load", mass=50, inertia=[1] * 3, position=[0, -ROPE, 0])
    made.add_marker("load.top", position=[0, ROPE, 0])
    made.add_joint("rail", "prismatic", between=["ground", "trolley"], axis="x")
    made.add_joint("rope", "revolute", between=["trolley", "load.top"], axis="z")
    made.add_driver("motor", joint="rail", stroke=f"{WAY}*step5(t, {BEGIN}, 0, {END}, 1)")
    made.add_sensor("swing", "angle", joint="rope")
    return made


def swing_of_load(t):
    def slope(t, y):
        s = (t - BEGIN) / (END - BEGIN)
        push = 60 * s * (1 - s) * (1 - 2 * s) * WAY / (END - BEGIN) ** 2 if 0 < s < 1 else 0.0
        pull = G * np.sin(y[0]) + push * np.cos(y[0])
        return [y[1], -50 * ROPE * pull / (1 + 50 * ROPE**2)]

    y, angle = [0.0, 0.0], np.zeros(len(t))
    for begin, end in ((BEGIN, END), (END, t[-1])):
        piece = solve_ivp(slope, (begin, end), y, "DOP853", rtol=1e-12, atol=1e-14,
                          dense_output=True)  # fmt: skip
        y, now = piece.y[:, -1], t >= begin
        angle[now] = piece.sol(t[now])[0]
    return {"swing": angle}


@pytest.mark.parametrize(
    ("method", "accuracy"),
    [("generalized-alpha", 2e-3), ("generalized-alpha", 3e-4), ("radau", 1e-5), ("radau", 1e-6)],
)  # fmt: skip
def test_a_run_ends_steps_where_a_driver_begins_and_states_its_error(method, accuracy):
    """A step from rest across the kink hardly shows its error, nor does one of half its size."""
    found = judged(load_crane(), swing_of_load, duration=10.0, outputs=100, accuracy=accuracy,
                   method=method)  # fmt: skip
    assert found.is_reached(accuracy), found
    assert 1 / 3 < found.share < 3, found
    assert found.steps < 1500, found
