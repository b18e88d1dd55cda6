"""One number for the user: the error of position sensors over their peak-to-peak.

Scenes of many kinds, by every method and accuracy: what was asked for is reached, and what the run
says of its own error is near the true one. Judged by closed forms and textbook equations where
there are any, else by a run of order eight as accurate as round-off lets it be.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
from femeshes import line
from scipy.integrate import solve_ivp
from scipy.optimize import newton
from scipy.special import ellipj, ellipk
from truthkit import run

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

OUTPUTS = 100
STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}


def rod(height):
    return reduce(
        line(8, end=(0.45, 0, 0)), material=STEEL, interfaces={"root": "root", "tip": "tip"},
        modes=4, sections={"all": rectangle(height, height)},
    )  # fmt: skip


def links(n):
    """n links of 1 m hinged in a row, let go from the horizontal."""
    made = Model("links", gravity=[0, -9.81, 0])
    for k in range(n):
        made.add_body(f"b{k}", mass=1, center=[0.5, 0, 0], inertia=[0.01, 0.1, 0.1],
                      position=[k, 0, 0])  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "revolute", between=ends, axis="z")
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


def oscillator():
    made = Model("oscillator")
    made.add_body("m", mass=1, inertia=[1, 1, 1], position=[1, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("spring", "spring-damper", between=["ground", "m"], stiffness=100, damping=0.2,
                   free_length=0.9)  # fmt: skip
    made.add_sensor("m", "position", of="m")
    return made


def top():
    made = Model("top", gravity=[0, 0, -9.81])
    made.add_body(
        "top", mass=15, center=[0, 0, 1], inertia=[0.23, 0.23, 0.45],
        angular_velocity=[0, -8, 20], orientation={"axis": "x", "angle": "60 deg"},
    )  # fmt: skip
    made.add_marker("top.tip", position=[0, 0, 1])
    made.add_joint("point", "spherical", between=["ground", "top"])
    made.add_sensor("tip", "position", of="top.tip")
    return made


def tumbling():
    made = Model("tumbling")
    made.add_body("b", mass=1, inertia=[1, 2, 2.8], angular_velocity=[0.1, 3, 0.1])
    made.add_marker("b.p", position=[0.5, 0.5, 0.5])
    made.add_sensor("p", "position", of="b.p")
    return made


def thrown():
    """A spatial chain of three bodies, the last one spun."""
    made = Model("thrown", gravity=[0, -9.81, 0])
    for k in range(3):
        spin = {"angular_velocity": [1.0, 2.0, 3.0]} if k == 2 else {}
        made.add_body(f"b{k}", mass=1.0 + k, center=[0.5, 0.1, 0], inertia=[0.02, 0.1, 0.09],
                      position=[k, 0, 0.1 * k], **spin)  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0.1])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "spherical", between=ends)
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


def flexible_pendulum():
    made = Model("flexible pendulum", gravity=[0, -9.81, 3.0])
    made.add_body("rod", rod(0.002))
    made.add_joint("hinge", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip")
    return made


def flexible_crank():
    made = Model("flexible crank")
    made.add_body("crank", mass=1.0, inertia=[0.01] * 3)
    made.add_marker("crank.pin", position=[0.15, 0, 0])
    made.add_body("rod", rod(0.012), position=[0.15, 0, 0])
    made.add_body("slider", mass=0.5, inertia=[0.01] * 3, position=[0.6, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle="150*t")
    made.add_sensor("slider", "position", of="slider")
    return made


ECCENTRICITY = 0.6


def kepler():
    """An orbit about the origin with a = 1 m and G M = 1 m³/s²."""
    made, e = Model("kepler"), ECCENTRICITY
    made.add_body("m", mass=1, inertia=[1, 1, 1], position=[1 - e, 0, 0],
                  velocity=[0, np.sqrt((1 + e) / (1 - e)), 0])  # fmt: skip
    made.add_sensor("m", "position", of="m")
    made.add_sensor("r", "distance", between=["ground", "m"])
    made.add_force("pull", "force", at="m", value=["-m.x/r**3", "-m.y/r**3", 0])
    return made


def forced():
    made = links(1)
    made.add_force("twist", "torque", at="b0", value=[0, 0, "6*sin(3*t)"])
    return made


def nutating():
    """A fast top let go with its axis at rest."""
    made = Model("nutating", gravity=[0, 0, -9.81])
    made.add_body(
        "top", mass=1, center=[0, 0, 0.1], inertia=[5e-3, 5e-3, 2e-3],
        angular_velocity=[0, 0, 80], orientation={"axis": "x", "angle": "60 deg"},
    )  # fmt: skip
    made.add_marker("top.tip", position=[0, 0, 0.1])
    made.add_joint("point", "spherical", between=["ground", "top"])
    made.add_sensor("tip", "position", of="top.tip")
    return made


def rotor():
    """A rotor of 1 m turned from rest, and beside it a mass that swings by 0.2 mm."""
    made = Model("rotor")
    made.add_body("rotor", mass=5, inertia=[1, 1, 2])
    made.add_marker("rotor.rim", position=[1, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "rotor"], axis="z")
    made.add_force("torque", "torque", at="rotor", value=[0, 0, 4])
    made.add_body("small", mass=1, inertia=[1, 1, 1], position=[1e-4, 0, 1])
    made.add_marker("ground.high", position=[0, 0, 1])
    made.add_joint("guide", "prismatic", between=["ground.high", "small"], axis="x")
    made.add_force("spring", "translational-spring-damper", joint="guide", stiffness=400)
    made.add_sensor("rim", "position", of="rotor.rim")
    made.add_sensor("small", "position", of="small")
    return made


AWAY = [1000.0, -500.0, 800.0]


def moved(model):
    """The same scene about another point: bodies, and the ground's end of every joint."""
    scene = model.to_scene_dict()
    for body in scene["bodies"].values():
        body["position"] = list(np.add(body.get("position", [0, 0, 0]), AWAY))
    scene["ground"] = {"markers": {"away": {"position": AWAY}}}
    for joint in scene.get("joints", {}).values():
        joint["between"] = ["ground.away" if e == "ground" else e for e in joint["between"]]
    return Model.from_scene_dict(scene)


_POWERS = {"mass": 3, "inertia": 5, "center": 1, "position": 1, "gravity": 1}


def scaled(model, s):
    """The same motion s times as large: masses go with volumes, forces with s⁴."""

    def grown(table):
        for key, value in table.items():
            if isinstance(value, dict):
                grown(value)
            elif key in _POWERS and not isinstance(value, str):
                table[key] = (s ** _POWERS[key] * np.array(value)).tolist()

    scene = model.to_scene_dict()
    grown(scene)
    return Model.from_scene_dict(scene)


def oscillator_truth(t):
    found = solve_ivp(
        lambda _, y: [y[1], -100 * (y[0] - 0.9) - 0.2 * y[1]], (0, t[-1]), [1.0, 0.0],
        t_eval=t, rtol=1e-12, atol=1e-14, method="DOP853",
    )  # fmt: skip
    return {"m.x": found.y[0]}


def pendulum_truth(t):
    """sin(angle/2) = k sn: one link hung at its end, from the horizontal; J = 0.1 + 0.25."""
    w, k = np.sqrt(9.81 * 0.5 / 0.35), np.sin(np.pi / 4)
    sn = ellipj(ellipk(k * k) + w * t, k * k)[0]
    angle = 2 * np.arcsin(k * sn)  # from the lowest point
    return {"end0.x": np.sin(angle), "end0.y": -np.cos(angle)}


def forced_truth(t):
    found = solve_ivp(
        lambda t, y: [y[1], (6 * np.sin(3 * t) - 9.81 * 0.5 * np.cos(y[0])) / 0.35], (0, t[-1]),
        [0.0, 0.0], t_eval=t, rtol=1e-13, atol=1e-14, method="DOP853",
    )  # fmt: skip
    return {"end0.x": np.cos(found.y[0]), "end0.y": np.sin(found.y[0])}


def kepler_truth(t):
    """Kepler's equation for the eccentric anomaly."""
    e = ECCENTRICITY
    E = newton(lambda E: E - e * np.sin(E) - t, t, lambda E: 1 - e * np.cos(E), tol=1e-14)
    return {
        "m.x": np.cos(E) - e, "m.y": np.sqrt(1 - e * e) * np.sin(E), "r": 1 - e * np.cos(E),
    }  # fmt: skip


def rotor_truth(t):
    return {
        "rim.x": np.cos(t**2), "rim.y": np.sin(t**2), "small.x": 1e-4 * np.cos(20 * t),
    }  # fmt: skip


# Each scene, how long it is run, and the closed form of what moves.
SCENES = {
    "pendulum": (lambda: links(1), 3.0, pendulum_truth),
    "long pendulum": (lambda: links(1), 100.0, pendulum_truth),
    "double pendulum": (lambda: links(2), 2.0, None),
    "oscillator": (oscillator, 5.0, oscillator_truth),
    "top": (top, 1.5, None),
    "nutating top": (nutating, 2.0, None),
    "tumbling body": (tumbling, 5.0, None),
    "spatial chain": (thrown, 1.0, None),
    "orbit": (kepler, 20.0, kepler_truth),
    "driven pendulum": (forced, 10.0, forced_truth),
    "rotor": (rotor, 3.0, rotor_truth),
}
METHODS = {
    "auto": {"method": "auto"},
    "generalized-alpha": {"method": "generalized-alpha"},
    "order 5": {"method": "explicit-rk", "order": 5},
    "order 8": {"method": "explicit-rk", "order": 8},
    "radau": {"method": "radau"},
}
ACCURACIES = {
    "auto": (1e-3, 1e-4, 1e-6, 1e-8),
    "generalized-alpha": (1e-3, 1e-4),
    "order 5": (1e-3, 1e-4, 1e-6, 1e-8),
    "order 8": (1e-3, 1e-4, 1e-6, 1e-8),
    "radau": (1e-3, 1e-4, 1e-6),
}
TIGHT = {"accuracy": 1e-12, "method": "explicit-rk", "verify": False}


@functools.cache
def truth(name):
    """Sensors (n, channels) of a scene."""
    make, duration, closed = SCENES[name]
    tight = run(make(), duration=duration, outputs=OUTPUTS, **TIGHT)
    if closed is not None:
        for channel, values in closed(tight.t).items():
            tight[channel][:] = values
    return tight.sensors


def worst(found, judge):
    """Largest error of a sensor over its peak-to-peak, that of its components that moves most."""
    names = [channel.rpartition(".")[0] or channel for channel in found.layout.channels]
    owner = np.array([names.index(name) for name in names])
    apart, moves = np.abs(found.sensors - judge).max(axis=0), np.ptp(judge, axis=0)
    sensors = np.unique(owner)
    apart, moves = (np.array([each[owner == k].max() for k in sensors]) for each in (apart, moves))
    moving = moves > 1e-9 * moves.max()
    return (apart[moving] / moves[moving]).max()


def assert_reached(found, judge, accuracy):
    """At most twice what was asked for, and the run says so within a factor of three."""
    error, said = worst(found, judge), found.statistics["measured_error_of_positions"]
    assert error < 2 * accuracy, f"{error / accuracy:.3g} times what was asked for; says {said:.2g}"
    if error > 1e-12:
        assert 1 / 3 < said / error < 3, f"says {said:.2g}, is {error:.2g}, asked {accuracy:g}"


CASES = [
    pytest.param(name, method, accuracy, id=f"{name}, {method}, {accuracy:g}")
    for name in SCENES for method in METHODS for accuracy in ACCURACIES[method]
]  # fmt: skip


@pytest.mark.parametrize(("name", "method", "accuracy"), CASES)
def test_the_accuracy_asked_for_is_reached(name, method, accuracy):
    make, duration, _ = SCENES[name]
    knobs = {"duration": duration, "outputs": OUTPUTS, "accuracy": accuracy, **METHODS[method]}
    assert_reached(run(make(), **knobs), truth(name), accuracy)


MOVED = ("pendulum", "double pendulum", "top", "tumbling body", "spatial chain")


@pytest.mark.parametrize("name", MOVED)
@pytest.mark.parametrize("method", ["auto", "order 5", "radau"])
def test_a_scene_a_kilometre_away_is_as_accurate(name, method):
    make, duration, _ = SCENES[name]
    for accuracy in (1e-4, 1e-6):
        knobs = {"duration": duration, "outputs": OUTPUTS, "accuracy": accuracy}
        found = run(moved(make()), **knobs, **METHODS[method])
        assert_reached(found, truth(name) + np.resize(AWAY, found.sensors.shape[1]), accuracy)


@pytest.mark.parametrize("size", [1e-6, 1e3])
@pytest.mark.parametrize("name", MOVED)
@pytest.mark.parametrize("method", ["auto", "order 5", "radau"])
def test_a_scene_of_another_size_is_as_accurate(name, method, size):
    """With about the same steps: no length is known beforehand."""
    make, duration, _ = SCENES[name]
    for accuracy in (1e-4, 1e-6):
        knobs = {"duration": duration, "outputs": OUTPUTS, "accuracy": accuracy, **METHODS[method]}
        found = run(scaled(make(), size), **knobs)
        assert_reached(found, size * truth(name), accuracy)
        steps = run(make(), **knobs).statistics["steps"]
        assert found.statistics["steps"] == pytest.approx(steps, rel=0.1)


FLEXIBLE = {
    "pendulum": (flexible_pendulum, 0.6, {**TIGHT, "accuracy": 1e-9}),
    "slider-crank": (flexible_crank, 0.05, {"accuracy": 1e-9, "method": "radau", "verify": False}),
}


@functools.cache
def flexible_truth(name):
    """The crank: what generalized-alpha goes to as h² down to 6e-7, with 50 000 steps."""
    make, duration, knobs = FLEXIBLE[name]
    return run(make(), duration=duration, outputs=OUTPUTS, **knobs).sensors


@pytest.mark.parametrize("name", FLEXIBLE)
@pytest.mark.parametrize("method", ["auto", "generalized-alpha"])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-4])
def test_flexible_bodies_reach_the_accuracy_asked_for(name, method, accuracy):
    """Stiff modes still ring: the scout may miss what the run follows, so that it says more."""
    make, duration, _ = FLEXIBLE[name]
    knobs = {"duration": duration, "outputs": OUTPUTS, "accuracy": accuracy, **METHODS[method]}
    assert_reached(run(make(), **knobs), flexible_truth(name), accuracy)


@pytest.mark.parametrize("method", ["generalized-alpha", "order 5", "order 8", "radau"])
def test_error_and_steps_follow_the_accuracy(method):
    """A hundred times the accuracy: a hundredth of the error, and 100^(1/p) as many steps.

    Not where the longest step that is ever tried is accurate enough.
    """
    asked = (1e-3, 1e-5) if method == "generalized-alpha" else (1e-7, 1e-9)
    knobs = {"duration": 2.0, "outputs": OUTPUTS, **METHODS[method]}
    coarse, fine = (run(links(2), accuracy=accuracy, **knobs) for accuracy in asked)
    judge = truth("double pendulum")
    assert 30 < worst(coarse, judge) / worst(fine, judge) < 300
    order = {"generalized-alpha": 2, "order 8": 8}.get(method, 5)
    growth = fine.statistics["steps"] / coarse.statistics["steps"]
    assert growth == pytest.approx(100 ** (1 / order), rel=0.35)
    asked_again = coarse.statistics["ten_times_more_accuracy_costs"] ** 2
    assert asked_again == pytest.approx(100 ** (1 / order), rel=1e-12)


def test_outputs_between_steps_are_consistent():
    """Far more outputs than steps: each on the constraints, in position and velocity."""
    found = run(links(2), duration=1.0, outputs=2000, accuracy=1e-2)
    assert found.statistics["steps"] < 150
    assert len(found.t) == 2001 and found.t[-1] == 1.0
    assert found.drift[:, 0].max() < 1e-12
    end = found.sensors[:, 3:5]
    elbow = found.sensors[:, :2]
    np.testing.assert_allclose(np.linalg.norm(end - elbow, axis=1), 1.0, rtol=0, atol=1e-12)
    # q̇ = N v, seen by differences over 0.5 ms: their error is h²/6 of the third derivative
    middle = found.v[1:-1, 6:9]
    slope = (found.q[2:, 7:10] - found.q[:-2, 7:10]) / (found.t[2:] - found.t[:-2])[:, None]
    assert np.abs(slope - middle).max() < 1e-3 * np.abs(middle).max()


def test_a_pulse_on_a_scene_at_rest_is_not_stepped_over():
    """Nothing moves until a pulse of 2 % of the run: the momentum it gives, by hand."""
    made = Model("hit")
    made.add_body("m", mass=2, inertia=[1, 1, 1])
    pulse = "30*(step(t, 0.6, 0, 0.601, 1) - step(t, 0.62, 0, 0.621, 1))"
    made.add_force("hit", "force", at="m", value=[pulse, 0, 0])
    made.add_sensor("m", "velocity", of="m")
    found = run(made, duration=1.0, outputs=4, accuracy=1e-3)
    assert found["m.x"][-1] == pytest.approx(30 * 0.02 / 2, rel=1e-2)


def pushed(force):
    """A body of 2 kg with 1 m/s, and a force along x."""
    made = Model("pushed")
    made.add_body("m", mass=2, inertia=[1, 1, 1], velocity=[1, 0, 0])
    made.add_sensor("m", "position", of="m")
    made.add_force("push", "force", at="m", value=[force, 0, 0])
    return made


JUMP_METHODS = pytest.mark.parametrize("method", ["auto", "generalized-alpha", "order 5", "radau"])


@JUMP_METHODS
def test_a_jump_at_a_known_time_is_met_by_steps(method):
    """A step ends where the jump begins, and a short one takes it: the motion as by hand."""
    made = pushed("6*step(t, 0.5, 0, 0.5000001, 1)")
    found = run(made, duration=1.0, outputs=10, accuracy=1e-5, **METHODS[method])
    assert found.statistics["smallest_step_s"] < 1e-7 < 1e-2 < found.statistics["largest_step_s"]
    assert found["m.x"][-1] == pytest.approx(1 + 0.5 * 3.0 * 0.5**2, rel=1e-5)


@JUMP_METHODS
def test_a_jump_at_a_place_is_met_with_small_steps(method):
    """Nobody knows when it comes: rejections there, and the error is no larger than asked for."""
    made = pushed("6*step(m.x, 0.5, 0, 0.5000001, 1)")
    knobs = {"duration": 1.0, "outputs": 10, "accuracy": 1e-5, **METHODS[method]}
    alone = run(made, verify=False, **knobs)
    assert alone.statistics["rejected_steps"] > 0
    found = run(made, **knobs)
    t = np.maximum(found.t - 0.5, 0.0)
    truth = np.stack([found.t + 0.5 * 3.0 * t**2, 0 * t, 0 * t], axis=1)
    assert worst(alone, truth) < 2e-5
    assert worst(found, truth) < 2e-5
    assert found.statistics["measured_error_of_positions"] > worst(found, truth) / 3
