"""Drivers against closed forms: inverse kinematics, a cylinder, speeds and accelerations.

All models run once, with compilation off: they are small, and no kernels are compiled for them.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import interpreted

pytestmark = pytest.mark.slow

CODE = '''
import numpy as np
from generators import cloud, interface
from truthkit import run
from flexmb.model import Model

L1, L2 = 1.0, 0.8

def keep(name, result):
    found[name + ".t"] = result.t
    for channel in result.layout.channels:
        found[f"{name}.{channel}"] = result[channel]
    for row, values in zip(result.layout.rows, result.lam.T):
        found[f"{name}.{row}"] = values
    found[name + ".mismatch"] = result.mismatch() / np.abs(result.energy).max()

def arm(elbow, plane, flexible=False):
    """Two links whose tip is led along an ellipse; the elbow bends to the left or to the right."""
    tip = np.array([1.3, 0.5])
    c2 = (tip @ tip - L1**2 - L2**2)/(2*L1*L2)
    bend = elbow*np.arccos(c2)
    first = np.arctan2(tip[1], tip[0]) - np.arctan2(L2*np.sin(bend), L1 + L2*np.cos(bend))
    model = Model("arm", plane=plane, gravity=[0, -9.81, 0])
    x = L1*np.cos(first), L1*np.sin(first)
    for name, angle, place, length in (
        ("upper", first, (0, 0), L1), ("lower", first + bend, x, L2)
    ):
        model.add_body(name, mass=2, center=[length/2, 0, 0], inertia=[0.1, 0.2, 0.2],
            position=[*place, 0], orientation={"axis": "z", "angle": angle},
            markers={"tip": {"position": [length, 0, 0]}})
    model.add_joint("shoulder", "revolute", between=["ground", "upper.origin"])
    model.add_joint("elbow", "revolute", between=["upper.tip", "lower"])
    model.add_sensor("shoulder", "angle", joint="shoulder")
    model.add_sensor("elbow", "angle", joint="elbow")
    path = ["1.3 + 0.2*sin(3*t)", "0.3 + 0.2*cos(3*t)"]
    if plane:
        model.add_driver("tip", marker="lower.tip", position=path)
    else:
        model.add_driver("tip", marker="lower.tip", x=path[0], y=path[1])
    return model

for elbow in (1, -1):
    for plane in ("xy", None):
        result = run(arm(elbow, plane), duration=1.0, step=0.05, outputs=10)
        keep(f"arm {elbow} {plane}", result)

crane = Model("crane", plane="xy", gravity=[0, -9.81, 0])
crane.add_body("boom", mass=100, center=[1, 0, 0], inertia=[20, 30, 40],
    markers={"eye": {"position": [1.5, 0, 0]}})
crane.add_marker("ground.foot", position=[0, -1, 0])
crane.add_joint("pivot", "revolute", between=["ground", "boom"], axis="z")
crane.add_driver("cylinder", between=["ground.foot", "boom.eye"],
    distance="sqrt(3.25) + step5(t, 0, 0, 1, 0.4)")
crane.add_sensor("boom", "angle", joint="pivot")
keep("crane", run(crane, duration=1.2, step=0.03, outputs=20))

def wheel(flexible=False, **driver):
    model = Model("wheel")
    if flexible:
        rng = np.random.default_rng(5)
        made = cloud(rng, 3)
        model.add_body("wheel", made.flexbody("wheel", [interface(rng, "hub", 3)]))
        at = "wheel.hub"
    else:
        model.add_body("wheel", mass=3, center=[0.1, 0, 0], inertia=[0.4, 0.5, 0.7])
        at = "wheel.origin"
    model.add_joint("axle", "revolute", between=["ground", at], axis="z")
    model.add_driver("motor", joint="axle", **driver)
    model.add_sensor("angle", "angle", joint="axle")
    return model

for name, fields in {
    "speed": {"angle": "40 + 5*sin(7*t)", "prescribes": "velocity", "start": 0.3},
    "spin-up": {"angle": {"type": "step5", "t1": 0.5, "y1": 60}, "prescribes": "velocity"},
    "acceleration": {"angle": "20*cos(4*t) + abs(t - 0.3)", "prescribes": "acceleration",
        "start": 0.3, "start_velocity": -2.0},
}.items():
    keep(name, run(wheel(**fields), duration=1.0, step=0.02, outputs=10))
    if name == "speed":
        keep("flexible", run(wheel(True, **fields), duration=0.1, step=0.0025, outputs=10))

hexapod = Model("platform", gravity="earth -z")
hexapod.add_body("plate", mass=20, inertia=[1, 1, 2], position=[0, 0, 1.0])
goal = {"x": "0.1*sin(t)", "y": "0.1*t", "z": "1 + 0.2*t**2"}
hexapod.add_driver("place", marker="plate.origin", **goal)
hexapod.add_joint("level", "orientation", between=["ground", "plate"])
keep("platform", run(hexapod, duration=1.0, step=0.05, outputs=10))
'''


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return interpreted(CODE, tmp_path_factory.mktemp("drivers"))


CLOSED = 1e-9  # of the constraints that outputs are put back on, through the lever of the arm


@pytest.mark.parametrize("plane", ["xy", None])
@pytest.mark.parametrize("elbow", [1, -1])
def test_a_led_tip_solves_the_inverse_kinematics(found, elbow, plane):
    """Both branches of the two-link arm (law of cosines); the one of the placed pose is kept."""
    name, a, b = f"arm {elbow} {plane}", 1.0, 0.8
    t = found[f"{name}.t"]
    x, y = 1.3 + 0.2 * np.sin(3 * t), 0.3 + 0.2 * np.cos(3 * t)
    bend = elbow * np.arccos((x**2 + y**2 - a**2 - b**2) / (2 * a * b))
    first = np.arctan2(y, x) - np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
    np.testing.assert_allclose(found[f"{name}.elbow"], bend, atol=CLOSED)
    np.testing.assert_allclose(found[f"{name}.shoulder"], first, atol=CLOSED)


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


def test_a_distance_is_the_stroke_of_a_cylinder_and_its_multiplier_the_force(found):
    t = found["crane.t"]
    angle, _, acceleration, d = boom(t)
    np.testing.assert_allclose(found["crane.boom"], angle, atol=CLOSED)
    # moment about the pivot: force times its lever a b cos θ / d
    moment = (40.0 + 100.0) * acceleration + 100.0 * 9.81 * np.cos(angle)
    force = moment * d / (1.5 * np.cos(angle))
    np.testing.assert_allclose(-found["crane.drivers.cylinder: driven distance"], force, rtol=1e-8)


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
def test_rates_are_integrated_and_the_multiplier_is_the_torque(found, name, angle, acceleration):
    t = found[f"{name}.t"]
    np.testing.assert_allclose(found[f"{name}.angle"], angle(t), atol=1e-9)
    torque = 0.7 + 3 * 0.1**2  # about the axle, per rad/s²
    found_torque = -found[f"{name}.drivers.motor: driven"]
    np.testing.assert_allclose(found_torque, torque * acceleration(t), rtol=1e-8, atol=1e-7)


def test_a_wheel_spun_up_has_turned_by_the_area_of_its_speed(found):
    t = found["spin-up.t"]
    late = t >= 0.5
    wanted = 60.0 * (t[late] - 0.25)
    assert wanted[-1] > 14 * np.pi
    np.testing.assert_allclose(found["spin-up.angle"][late], wanted, atol=1e-9)


def test_a_flexible_body_is_driven_at_its_interface(found):
    t = found["flexible.t"]
    wanted = 0.3 + 40 * t + 5 / 7 * (1 - np.cos(7 * t))
    np.testing.assert_allclose(found["flexible.angle"] - wanted, 0.0, atol=1e-8)


def test_a_plate_led_in_space_needs_its_weight_and_inertia(found):
    t = found["platform.t"]
    for axis, force in (
        ("x", -20 * 0.1 * np.sin(t)),
        ("y", 0 * t),
        ("z", 20 * (9.80665 + 0.4) + 0 * t),
    ):
        given = -found[f"platform.drivers.place: driven {axis}"]
        np.testing.assert_allclose(given, force, atol=1e-7)


@pytest.mark.parametrize("name", ["arm 1 xy", "arm -1 None", "crane", "speed", "spin-up"])
def test_the_drivers_do_the_work(found, name):
    """Their power is summed by the trapezoidal rule over steps of 0.02 to 0.05 s: (w h)²/12."""
    assert found[f"{name}.mismatch"] < 1e-2
