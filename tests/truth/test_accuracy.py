"""One number for the user: the error of position sensors over their peak-to-peak.

Eight scenes at the default accuracy, judged by closed forms where there are any, else by a run of
the other method or, where stiff modes forbid that, of fixed steps far smaller.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import line
from scipy.integrate import solve_ivp
from truthkit import run

from flexmb.fe import rectangle, reduce
from flexmb.model import Model

ACCURACY = 1e-4
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


FIXED = {"step": 2e-6, "newton_tolerance": 1e-8}
OTHER_METHOD = {"accuracy": 1e-8, "method": "explicit-rk"}
SCENES = {
    "pendulum": (lambda: links(1), 3.0, OTHER_METHOD),
    "double pendulum": (lambda: links(2), 2.0, OTHER_METHOD),
    "oscillator": (oscillator, 5.0, None),
    "top": (top, 1.5, OTHER_METHOD),
    "tumbling body": (tumbling, 5.0, OTHER_METHOD),
    "spatial chain": (thrown, 1.0, OTHER_METHOD),
    "flexible pendulum": (flexible_pendulum, 0.6, {"accuracy": 1e-7, "method": "explicit-rk"}),
    "flexible slider-crank": (flexible_crank, 0.05, FIXED),
}


def oscillator_truth(t):
    found = solve_ivp(
        lambda _, y: [y[1], -100 * (y[0] - 0.9) - 0.2 * y[1]], (0, t[-1]), [1.0, 0.0],
        t_eval=t, rtol=1e-11, atol=1e-13, method="DOP853",
    )  # fmt: skip
    return found.y[0]


def worst(found, judge):
    """Largest error over the peak-to-peak, of the channels that move."""
    errors = []
    spans = np.ptp(judge, axis=0)
    for k in np.flatnonzero(spans > 1e-6 * spans.max()):
        errors.append(np.abs(found[:, k] - judge[:, k]).max() / spans[k])
    return max(errors)


@pytest.mark.parametrize("name", SCENES)
def test_the_accuracy_asked_for_is_achieved(name):
    """Within a factor of 10 either way: not missed, and no more paid for than asked."""
    make, duration, judge = SCENES[name]
    found = run(make(), duration=duration, outputs=OUTPUTS, accuracy=ACCURACY)
    if judge is None:
        truth = found.sensors.copy()
        truth[:, 0] = oscillator_truth(found.t)
    else:
        truth = run(make(), duration=duration, outputs=OUTPUTS, **judge).sensors
    error = worst(found.sensors, truth)
    assert 0.1 * ACCURACY < error < 10 * ACCURACY
    # what the run itself says of its error is no less; more where stiff modes still ring
    assert 0.03 < error / found.statistics["estimated_error"] < 3


@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk"])
def test_error_and_steps_follow_the_accuracy(method):
    """A hundred times the accuracy: a hundredth of the error, and 100^(1/p) as many steps."""
    knobs = {"duration": 2.0, "outputs": OUTPUTS, "method": method}
    truth = run(links(2), duration=2.0, outputs=OUTPUTS, **OTHER_METHOD).sensors
    coarse, fine = (run(links(2), accuracy=a, **knobs) for a in (1e-3, 1e-5))
    ratio = worst(coarse.sensors, truth) / worst(fine.sensors, truth)
    assert 30 < ratio < 300
    order = 2 if method == "generalized-alpha" else 3
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


def test_a_kink_is_met_with_small_steps():
    """A force that jumps: rejections there, the motion as by hand."""
    made = Model("pushed")
    made.add_body("m", mass=2, inertia=[1, 1, 1])
    made.add_force("push", "force", at="m", value=["6*step(t, 0.5, 0, 0.5000001, 1)", 0, 0])
    made.add_sensor("m", "position", of="m")
    found = run(made, duration=1.0, outputs=10, accuracy=1e-5)
    assert found.statistics["rejected_steps"] > 0
    assert found["m.x"][-1] == pytest.approx(0.5 * 3.0 * 0.5**2, rel=1e-5)
