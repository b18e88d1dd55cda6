"""One number for the user: the error of position sensors over their peak-to-peak.

Scenes of known motion, by all methods: what was asked for is reached, what is told near the truth.
"""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest
from accuracyscenes import AWAY, CYCLES, SCENES, beside_a_large_motion, moved, truth_of
from accuracyscenes.judging import METHODS, judged, largest_error
from accuracyscenes.mounts import BLADE, blade, blade_motion
from flexiblescenes import (
    flexible_crank,
    flexible_pendulum,
    four_bar_with_a_beam,
    suddenly_loaded_beam,
)
from scipy.special import ellipj, ellipk
from truthkit import reference, run

from flexmb.model import Model

OUTPUTS = 100
ACCURACIES = {
    "auto": (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
    "order 5": (1e-3, 1e-4, 1e-6, 1e-8),
    "radau": (1e-3, 1e-4, 1e-6, 1e-8),
    "generalized-alpha": (1e-3, 1e-4),
}
TIGHT = {"accuracy": 1e-12, "method": "explicit-rk", "verify": False}


@functools.cache
def truth(name, duration, outputs, size=1.0, away=(0.0, 0.0, 0.0)):
    """Channels (outputs + 1,) of a scene, by name."""
    return truth_of(SCENES[name], np.linspace(0.0, duration, outputs + 1), size, away)


def assert_reached(name, method, accuracy, model=None, duration=None, **changes):
    """At most twice what was asked for; told is a third of the error to three times as much.

    The latter where the error or what is told of it is a fifth of what was asked for, or more.
    """
    scene = SCENES[name]
    model = scene.make(1.0) if model is None else model
    duration, outputs = duration or scene.duration, scene.outputs
    knobs = {"duration": duration, "outputs": outputs, "accuracy": accuracy, **METHODS[method]}
    found = judged(model, lambda t: truth(name, duration, outputs, **changes), **knobs)
    assert not found.message
    said = f"{found.achieved / accuracy:.3g} times what was asked for, told {found.told:.3g}"
    assert found.is_reached(accuracy), said
    if found.is_near(accuracy):
        assert 1 / 3 <= found.share <= 3, said
    return found


FAST = (
    "pendulum", "double pendulum", "orbit, e = 0.6", "oscillator", "rotor", "gears", "cam",
    "cart-pole", "bead on a cycloid", "free top", "Hooke's joint", "Euler's body", "quadratic drag",
    "backlash", "servo that saturates", "damped buffer", "trammel", "pendulum of a point",
    "limited rate", "dead zone", "delay", "heart", "roller", "rack", "screw", "windows",
)  # fmt: skip


@pytest.mark.parametrize("accuracy", [1e-4, 1e-6])
@pytest.mark.parametrize("name", FAST)
def test_the_accuracy_asked_for_is_reached(name, accuracy):
    assert_reached(name, "auto", accuracy)


@pytest.mark.parametrize("name", ["pendulum", "oscillator", "stiff damper", "staircase"])
@pytest.mark.parametrize("method", ["order 5", "radau", "generalized-alpha"])
def test_other_methods_reach_it_too(name, method):
    if SCENES[name].stiff and method == "order 5":
        pytest.skip("stiff: very many steps")
    assert_reached(name, method, 1e-4)


# By how a scene stands: what does not keep it yet, missed by more than twice or told wrong by more
# than three times. Some do on one processor and not on another, whose last digits differ.
MISSED = reference("missed_accuracy")


def marked(case, how, slow=True):
    """A case as a slow test, and expected to fail if it is known to."""
    marks = [pytest.mark.slow] if slow else []
    if list(case) in MISSED[how]:
        marks.append(pytest.mark.xfail(strict=False, reason="does not keep it yet"))
    return pytest.param(*case, id=", ".join(f"{part}" for part in (how, *case)), marks=marks)


def cases():
    return [
        marked((name, method, accuracy), "plain")
        for name, scene in SCENES.items()
        for method, accuracies in ACCURACIES.items()
        if not (scene.stiff and method == "order 5")
        for accuracy in accuracies
    ]


@pytest.mark.parametrize(("name", "method", "accuracy"), cases())
def test_all_scenes_by_all_methods(name, method, accuracy):
    assert_reached(name, method, accuracy)


THIN = ("pendulum", "oscillator", "orbit, e = 0.6", "free top")


def changed(how):
    """Scenes by the methods of one step; a thin selection, and all others as slow tests."""
    return [
        marked((name, method), how, slow=name not in THIN or method != "auto")
        for name, scene in SCENES.items()
        for method in ("auto", "order 5", "radau")
        if scene.sized and not (scene.stiff and method == "order 5")
    ]


@pytest.mark.parametrize(("name", "method"), changed("moved"))
def test_a_scene_a_kilometre_away_is_as_accurate(name, method):
    if "1 µm" in name:
        pytest.skip("its sensors have too few digits there: the test below")
    for accuracy in (1e-4, 1e-6, 1e-8):
        if [name, method, accuracy] in MISSED["plain"]:
            continue
        model = moved(SCENES[name].make(1.0))
        found = assert_reached(name, method, accuracy, model, away=AWAY)
        plain = assert_reached(name, method, accuracy)
        assert found.steps == pytest.approx(plain.steps, rel=0.5)


@pytest.mark.seconds
@pytest.mark.parametrize("name", ["skew body on a cross", "gimbals"])
def test_radau_is_as_accurate_a_kilometre_away(name):
    assert_reached(name, "radau", 1e-8, moved(SCENES[name].make(1.0)), away=AWAY)


@pytest.mark.seconds
@pytest.mark.parametrize(
    "name",
    [
        "slider-crank",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("driven pendulum", "gimbals", "inverted pendulum", "Stephenson's linkage")
        ),
    ],
)
def test_generalized_alpha_is_as_accurate_a_kilometre_away(name):
    """Round-off of the place is none of the forces that act there: about the same steps."""
    model = moved(SCENES[name].make(1.0))
    found = assert_reached(name, "generalized-alpha", 1e-4, model, away=AWAY)
    plain = assert_reached(name, "generalized-alpha", 1e-4)
    assert found.steps == pytest.approx(plain.steps, rel=0.5)


@pytest.mark.seconds
def test_steps_of_a_driven_motion_follow_its_velocity():
    """What counts as rest near round-off is no velocity: steps are as 1/5 power of the accuracy."""
    scene = SCENES["driven slider-crank"]
    knobs = {"duration": scene.duration, "outputs": 20, "method": "radau", "verify": False}
    coarse, fine = (run(scene.make(1.0), accuracy=asked, **knobs) for asked in (1e-8, 1e-12))
    ratio = fine.statistics["steps"] / coarse.statistics["steps"]
    assert ratio == pytest.approx(1e4**0.2, rel=0.15)


def assert_reached_at(size, name, method):
    """With about the same steps, as events let them: no length is known beforehand."""
    for accuracy in (1e-4, 1e-6):
        found = assert_reached(name, method, accuracy, SCENES[name].make(size), size=size)
        plain = assert_reached(name, method, accuracy)
        assert found.steps == pytest.approx(plain.steps, rel=0.5)


@pytest.mark.parametrize(("name", "method"), changed("1 µm"))
def test_a_scene_of_micrometres_is_as_accurate(name, method):
    assert_reached_at(1e-6, name, method)


@pytest.mark.parametrize(("name", "method"), changed("1 km"))
def test_a_scene_of_kilometres_is_as_accurate(name, method):
    assert_reached_at(1e3, name, method)


@pytest.mark.parametrize("method", ["auto", "radau", "generalized-alpha"])
@pytest.mark.parametrize("name", ["top", "mass between stops", "spatial slider-crank"])
def test_units_that_are_powers_of_two_change_no_bit(name, method):
    """Such lengths round alike: all that differs by other units is round-off, and no scale."""
    scene = SCENES[name]
    knobs = {"duration": scene.duration / 3, "outputs": 20, "accuracy": 1e-3, **METHODS[method]}
    plain = run(scene.make(1.0), **knobs)
    for size in (2.0**-20, 2.0**10):
        found = run(scene.make(size), **knobs)
        np.testing.assert_array_equal(found.sensors, size * plain.sensors)
        told = (one.statistics["measured_error_of_positions"] for one in (found, plain))
        assert next(told) == next(told)


@pytest.mark.parametrize(("name", "method"), changed("beside"))
def test_a_small_sensor_beside_a_large_motion_is_as_accurate(name, method):
    """A flywheel of 1 km turns far off."""
    model = beside_a_large_motion(SCENES[name].make(1.0))
    assert_reached(name, method, 1e-5, model)


@pytest.mark.parametrize(
    ("name", "accuracy"),
    [marked((name, accuracy), "cycles") for name in CYCLES for accuracy in (1e-3, 1e-4)],
)
def test_a_thousand_cycles_are_as_accurate(name, accuracy):
    assert_reached(name, "auto", accuracy, duration=CYCLES[name])


FLEXIBLE = {
    "pendulum": (flexible_pendulum, 0.6, {**TIGHT, "accuracy": 1e-9}),
    "slider-crank": (flexible_crank, 0.05, {"accuracy": 1e-9, "method": "radau", "verify": False}),
}


@functools.cache
def flexible_truth(name):
    """The crank: what generalized-alpha goes to as h² down to 6e-7, with 50 000 steps."""
    make, duration, knobs = FLEXIBLE[name]
    return run(make(), duration=duration, outputs=OUTPUTS, **knobs).sensors


def flexible_error(name, channels, sensors):
    judge = dict(zip(channels, flexible_truth(name).T, strict=True))
    return largest_error(dict(zip(channels, sensors.T, strict=True)), judge)[0]


@pytest.mark.seconds
@pytest.mark.parametrize("name", FLEXIBLE)
@pytest.mark.parametrize("method", ["auto", "generalized-alpha"])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-4])
def test_flexible_bodies_reach_the_accuracy_asked_for(name, method, accuracy):
    """Stiff modes still ring: the scout may miss what the run follows, so that it says more."""
    make, duration, _ = FLEXIBLE[name]
    knobs = {"duration": duration, "outputs": OUTPUTS, "accuracy": accuracy, **METHODS[method]}
    found = run(make(), **knobs)
    error = flexible_error(name, found.layout.channels, found.sensors)
    told = found.statistics["measured_error_of_positions"]
    assert error < 2 * accuracy
    if max(error, told) > 0.2 * accuracy:
        assert 1 / 3 < told / error < 5


def test_a_slow_ring_beside_a_fast_wheel_is_as_accurate():
    assert_reached("gimbals", "generalized-alpha", 1e-3, duration=0.3)


@pytest.mark.seconds
@pytest.mark.parametrize(
    "method", ["auto", pytest.param("generalized-alpha", marks=pytest.mark.slow)]
)
def test_velocities_of_a_body_are_those_of_its_modes_too(method):
    """A blade whose frame is driven: all that may be wrong is how its points bend."""
    shares = []  # steps of a blade that rings depend on the last digits, and the share with them
    for accuracy in (0.7e-3, 1e-3, 1.4e-3):
        found = run(blade(), duration=3.0, outputs=OUTPUTS, accuracy=accuracy, method=method)
        tip = BLADE.interface("tip").Phi_t @ (found.v[:, 6:].T - blade_motion(found.t)[2:])
        points = np.ptp(found.v[:, 5]) * np.sqrt(np.trace(BLADE.S0) / BLADE.mass)
        error = found.statistics["measured_error_of_velocities"]
        shares.append(error * points / np.abs(tip).max())
    assert 1 / 3 < np.prod(shares) ** (1 / 3) < 3


def test_bending_beside_a_large_motion_is_as_accurate():
    """What a small sensor sees of a body's vibrations may be all damped, in run and scout alike."""
    made = flexible_pendulum()
    made.add_sensor("bend", "position", of="rod.tip", relative_to="rod.root", axes="rod.root")
    knobs = {"duration": 0.3, "outputs": 60}
    truth = run(made, accuracy=1e-7, method="radau", verify=False, **knobs).vector("bend")
    found = run(made, accuracy=1e-3, **knobs)
    error = np.abs(found.vector("bend") - truth).max() / np.ptp(truth, axis=0).max()
    assert error < 2e-3
    assert error < 3 * found.statistics["measured_error_of_positions"]


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("make", "duration", "accuracy", "most"),
    [
        (four_bar_with_a_beam, 1.2, 1e-4, 3000),
        pytest.param(suddenly_loaded_beam, 0.6, 1e-3, 5000, marks=pytest.mark.slow),
    ],
)
def test_what_only_trembles_is_not_resolved(make, duration, accuracy, most):
    """From rest, and suddenly loaded: with few steps as accurate as asked for."""
    knobs = {"duration": duration, "outputs": 50}
    truth = run(make(), accuracy=accuracy / 30, method="radau", verify=False, **knobs).sensors
    found = run(make(), accuracy=accuracy, **knobs)
    assert found.statistics["steps"] < most
    assert np.abs(found.sensors - truth).max() < 2 * accuracy * np.ptp(truth, axis=0).max()


@pytest.mark.parametrize("method", ["generalized-alpha", "order 5", "explicit-rk", "radau"])
def test_error_and_steps_follow_the_accuracy(method):
    """A hundred times the accuracy: a hundredth of the error, and 100^(1/p) as many steps.

    Not where the longest step that is ever tried is accurate enough.
    """
    asked = (1e-3, 1e-5) if method == "generalized-alpha" else (1e-7, 1e-9)
    scene = SCENES["double pendulum"]
    knobs = {"duration": 2.0, "outputs": OUTPUTS, "verify": False, **METHODS[method]}
    known = functools.partial(truth, "double pendulum", 2.0, OUTPUTS)
    coarse, fine = (
        judged(scene.make(1.0), lambda t: known(), accuracy=accuracy, **knobs) for accuracy in asked
    )
    assert 30 < coarse.achieved / fine.achieved < (600 if method == "radau" else 300)
    order = {"generalized-alpha": 2, "explicit-rk": 8}.get(method, 5)
    # outputs inside a step of Radau are of order 4
    wanted = 100 ** (1 / (4 if method == "radau" else order))
    assert fine.steps / coarse.steps == pytest.approx(wanted, rel=0.35)
    asked_again = coarse.statistics["ten_times_more_accuracy_costs"] ** 2
    assert asked_again == pytest.approx(100 ** (1 / order), rel=1e-12)


def test_outputs_between_steps_are_consistent():
    """Far more outputs than steps: each on the constraints, in position and velocity."""
    found = run(SCENES["double pendulum"].make(1.0), duration=1.0, outputs=2000, accuracy=1e-2)
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


@pytest.mark.parametrize("method", ["explicit-rk", "radau", "generalized-alpha"])
@pytest.mark.parametrize(
    ("pulse", "area"),
    [
        ("1000*exp(-((t - 5)/0.002)**2)", 2.0 * np.sqrt(np.pi)),
        ("500*(step5(t, 4.9777, 0, 4.9797, 1) - step5(t, 4.9817, 0, 4.9837, 1))", 2.0),
    ],
)
def test_a_brief_smooth_pulse_after_rest_is_not_stepped_over(pulse, area, method):
    """5 ms of a run of 8 s, by a function whose changes no corner announces: its momentum."""
    made = Model("hit")
    made.add_body("m", mass=2, inertia=[1, 1, 1])
    made.add_force("hit", "force", at="m", value=[pulse, 0, 0])
    made.add_sensor("m", "velocity", of="m")
    found = run(made, duration=8.0, outputs=4, accuracy=1e-3, method=method)
    assert found["m.x"][-1] == pytest.approx(area / 2, rel=2e-3)


def test_a_driven_model_at_the_origin_sets_off():
    """All stands at one point, at rest: round-off of the driver is no motion to be resolved."""
    scene = SCENES["crane"]
    knobs = {"duration": 0.5, "outputs": 20, "accuracy": 1e-6, **METHODS["order 5"]}
    known = functools.partial(truth, "crane", 0.5, 20)
    found = judged(scene.make(1.0), lambda t: known(), **knobs)
    assert not found.message and found.is_reached(1e-6)
    assert found.steps < 2000  # 14 for each of the 6.4 vibrations are 90


def test_a_vibration_that_only_velocities_see_is_stiff():
    """A ball on a bar of 1e9 N/m: the stretch is 3e-8 of it, 31 600 rad/s beside one swing."""
    made = Model("ball", gravity=[0, -9.81, 0])
    made.add_body("b0", mass=1, inertia=[0.01] * 3, position=[1, 0, 0])
    made.add_force("bar", "spring-damper", between=["ground", "b0"], stiffness=1e9, free_length=1)
    made.add_sensor("b0", "position", of="b0")
    found = run(made, duration=2.0, outputs=OUTPUTS, accuracy=1e-4)
    k2 = 0.5  # let go from the horizontal: sin² of half of the first angle
    sn = ellipj(ellipk(k2) + np.sqrt(9.81) * found.t, k2)[0]
    angle = 2 * np.arcsin(np.sqrt(k2) * sn)
    assert np.abs(found["b0.x"] - np.sin(angle)).max() < 2e-4
    assert found.statistics["steps"] < 3000  # 25 800 by the explicit method, for stability


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


@pytest.mark.parametrize("method", ["auto", "order 5", "radau"])
def test_a_jump_at_a_place_is_met_with_small_steps(method):
    """Nobody knows when it comes: rejections there, and the error is no larger than asked for."""
    made = pushed("6*step(m.x, 0.5, 0, 0.5000001, 1)")
    knobs = {"duration": 1.0, "outputs": 10, "accuracy": 1e-5, **METHODS[method]}
    alone = run(made, verify=False, **knobs)
    assert alone.statistics["rejected_steps"] > 0
    found = run(made, **knobs)
    wanted = {"m.x": found.t + 0.5 * 3.0 * np.maximum(found.t - 0.50000005, 0.0) ** 2}
    error_alone, error = (largest_error({"m.x": one["m.x"]}, wanted)[0] for one in (alone, found))
    assert error_alone < 2e-5
    assert error < 2e-5
    if error > 0.2e-5:
        assert found.statistics["measured_error_of_positions"] > error / 3


@pytest.mark.parametrize(
    "name",
    [
        "swing of 1 µm at 1 m",
        pytest.param("sleeping top", marks=pytest.mark.slow),
        "driven pendulum",
    ],
)
def test_the_floor_of_round_off_is_named_and_true(name):
    """An accuracy that nothing reaches: the run tells its floor, and asked for that all is well."""
    scene = SCENES[name]
    knobs = {"duration": scene.duration, "outputs": scene.outputs}

    def judge(accuracy):
        return judged(scene.make(1.0), lambda t: truth_of(scene, t), accuracy=accuracy, **knobs)

    found = judge(1e-12)
    (sentence,) = [note for note in found.notes if "was asked for" in note]
    assert "steps do not help, so" in sentence and 1 / 3 <= found.share <= 3  # no growth
    floor = float(re.search(r"ask for accuracy = (\S+?)[,;]?$", sentence)[1])
    found = judge(floor)
    assert found.achieved <= floor and not any("was asked for" in note for note in found.notes)
