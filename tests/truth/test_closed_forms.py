"""Textbook closed forms: a pendulum's period, a slider on a turning arm, a rotor, Hooke's joint.

Of the chaotic pendulum of Mitiguy & Kane the equations are known in closed form, not the motion.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from truthkit import extrapolated, order, run

from flexmb.model import Model

G = 9.81


# --- the period of a physical pendulum by the arithmetic-geometric mean ---


def mean(a, b):
    """Gauss's arithmetic-geometric mean."""
    while abs(a - b) > 1e-15 * a:
        a, b = 0.5 * (a + b), np.sqrt(a * b)
    return a


def pendulum(amplitude, d, radius):
    """A body whose centre hangs d below a hinge, with this radius of gyration about the centre."""
    made = Model("pendulum", gravity=[0, -G, 0])
    made.add_body(
        "body", mass=1.7, center=[0, -d, 0], inertia=[0.3, 0.3, 1.7 * radius**2],
        orientation={"axis": "z", "angle": float(amplitude)},
    )  # fmt: skip
    made.add_joint("hinge", "revolute", between=["ground", "body"], axis="z")
    made.add_sensor("angle", "angle", joint="hinge")
    return made


@pytest.mark.parametrize(
    ("amplitude", "d", "radius"), [(0.1, 0.5, 0.05), (2.0, 0.3, 0.4), (3.1, 0.4, 0.2)]
)
def test_the_period_of_a_pendulum(amplitude, d, radius):
    """T = 2π √(J/(m g d)) / agm(1, c), c = cos(amplitude/2): lowest after a quarter.

    Falling from near the top multiplies errors by some 1/c.
    """
    period = 2 * np.pi * np.sqrt((radius**2 + d**2) / (G * d)) / mean(1.0, np.cos(amplitude / 2))
    wanted = np.array([0, -amplitude, -2 * amplitude, -amplitude, 0])
    made, sizes = pendulum(amplitude, d, radius), np.array([4000, 8000])
    runs = [
        run(made, duration=period, step=period / n, outputs=4, newton_tolerance=1e-11)
        for n in sizes
    ]
    angles = [one["angle"] for one in runs]
    errors = [np.abs(angle - wanted).max() for angle in angles]
    assert 1.85 < order(1 / sizes, errors) < 2.15, errors
    np.testing.assert_allclose(extrapolated(*angles), wanted, rtol=0, atol=2e-6 * amplitude)
    found = run(made, duration=period, outputs=4, accuracy=1e-5)
    error = np.abs(found["angle"] - wanted).max() / (2 * amplitude)
    assert error < 1e-5 / np.cos(amplitude / 2)


# --- a slider on an arm that turns at constant speed ---


@pytest.mark.parametrize("stiffness", [0.0, 40.0, 250.0])
def test_a_slider_on_a_turning_arm(stiffness):
    """r̈ = Ω² r − k/m (r − free); Coriolis' force 2 m Ω ṙ on the guide, its moment from the motor.

    Driven out without a spring or with a weak one (k/m < Ω²), swinging with a stronger one.
    """
    m, speed, first, free = 2.0, 6.0, 0.3, 0.25
    made = Model("slider")
    made.add_body("arm", mass=1.0, inertia=[0.1, 0.1, 0.1])
    made.add_body("slider", mass=m, inertia=[0.02, 0.03, 0.04], position=[first, 0, 0])
    made.add_joint("axle", "revolute", between=["ground", "arm"], axis="z")
    made.add_joint("guide", "prismatic", between=["arm", "slider"], axis="x")
    made.add_driver("motor", joint="axle", angle=f"{speed}*t")
    made.add_force("spring", "translational-spring-damper", joint="guide", free=free,
                   stiffness=stiffness, value="0*t")  # fmt: skip
    made.add_sensor("slider", "position", of="slider")
    steps = np.array([1e-3, 5e-4])
    runs = [run(made, duration=0.5, step=h, outputs=50, newton_tolerance=1e-11) for h in steps]
    t = runs[0].t
    root = np.emath.sqrt(speed**2 - stiffness / m)  # real: cosh, imaginary: cos
    rest = -stiffness / m * free / root**2
    r = (rest + (first - rest) * np.cosh(root * t)).real
    rate = ((first - rest) * root * np.sinh(root * t)).real
    angle = speed * t
    turn = np.stack([np.cos(angle), np.sin(angle), 0 * t], axis=1)
    across = 2 * m * speed * rate

    def axis(one, path, column):
        return one.reactions[:, 12 * one.layout.reactions.index(path) + column]

    for name, read, wanted in (
        ("place", lambda one: one.vector("slider"), r[:, None] * turn),
        # The slide's axes are z along the arm, so the force across is found by its length.
        ("motor", lambda one: axis(one, "drivers.motor", 5), r * across),
        ("guide", lambda one: np.hypot(*(axis(one, "joints.guide", k) for k in (0, 1))),
         np.abs(across)),
    ):  # fmt: skip
        found = [read(one) for one in runs]
        size = np.abs(wanted).max()
        errors = [np.abs(value - wanted).max() for value in found]
        assert 1.85 < order(steps, errors) < 2.15, (name, errors)
        np.testing.assert_allclose(extrapolated(*found), wanted, rtol=0, atol=1e-6 * size)


# --- a rotor on a platform ---


def test_gyroscopic_moment():
    """H = C s e + A Ω k on a platform that turns at Ω; its change is what the bearing must give.

    dH/dt = C ṡ e + C s Ω k×e + A Ω̇ k in the platform's axes e, k×e, k: the first from the rotor's
    motor, the second gyroscopic, the third from the platform's motor. All by constraints alone,
    hence to round-off.
    """
    along, across = 0.05, 0.03
    made = Model("rotor")
    made.add_body("platform", mass=1.0, inertia=[0.2, 0.2, 0.2])
    made.add_body("rotor", mass=3.0, inertia=[along, across, across], position=[0, 0, 0])
    made.add_joint("pivot", "revolute", between=["ground", "platform"], axis="z")
    # Marker axes of the shaft: z along e, x along k×e, y along k.
    shaft = {"orientation": [[0, 0, 1], [1, 0, 0], [0, 1, 0]]}
    made.add_marker("platform.shaft", **shaft)
    made.add_marker("rotor.shaft", **shaft)
    made.add_joint("shaft", "revolute", between=["platform.shaft", "rotor.shaft"])
    made.add_driver("turn", joint="pivot", angle="2*t + 1.5*t**2")
    made.add_driver("spin", joint="shaft", angle="50*t + 3*sin(4*t)")
    found = run(made, duration=0.6, step=2e-3, outputs=30, newton_tolerance=1e-12)
    t = found.t
    rate, faster = 2 + 3 * t, np.full_like(t, 3.0)
    spin, change = 50 + 12 * np.cos(4 * t), -48 * np.sin(4 * t)
    tables = found.reactions.reshape(len(t), -1, 4, 3)
    at = {path: tables[:, k] for k, path in enumerate(found.layout.reactions)}
    wanted = np.stack([along * spin * rate, across * faster, 0 * t], axis=1)
    size = np.abs(wanted).max()
    on_platform = at["joints.shaft"][:, 3]
    np.testing.assert_allclose(on_platform, -wanted, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(
        at["drivers.spin"][:, 1, 2], along * change, rtol=0, atol=1e-9 * size
    )
    np.testing.assert_allclose(
        at["drivers.turn"][:, 1, 2], (0.2 + across) * faster, rtol=0, atol=1e-9 * size
    )
    # On the rotor the same moment, in axes that have turned with it.
    turned = Rotation.from_rotvec(np.outer(50 * t + 3 * np.sin(4 * t), [0, 0, 1]))
    on_rotor = turned.apply(at["joints.shaft"][:, 1])
    np.testing.assert_allclose(on_rotor, wanted, rtol=0, atol=1e-9 * size)


# --- Hooke's joint ---


@pytest.mark.parametrize("bend", [0.0, 0.4, 0.8])
def test_hookes_joint(bend):
    """Shafts at an angle δ: tan β = tan α cos δ from arms that start in and across their plane.

    Turned so slowly that inertia is nothing (5e-6 of the load), the motor gives the load's torque
    times dβ/dα = cos δ/(1 − sin²δ sin²α).
    """
    load, slow = 20.0, 0.01
    out = np.array([0, np.sin(bend), np.cos(bend)])  # the driven shaft; z is the driving one
    pin = np.cross(out, [1.0, 0, 0])
    made = Model("Hooke's joint")
    for name in ("input", "cross", "output"):
        made.add_body(name, mass=1.0, inertia=[0.1] * 3)
    made.add_joint("driving", "revolute", between=["ground", "input"], axis="z")
    made.add_joint("first", "revolute", between=["input", "cross"], axis="x")
    made.add_joint("second", "revolute", between=["cross", "output"], axis=list(pin))
    made.add_joint("driven", "revolute", between=["ground", "output"], axis=list(out))
    made.add_driver("motor", joint="driving", angle=f"{slow}*t")
    made.add_force("load", "torque", at="output", value=list(-load * out))
    made.add_sensor("angle", "angle", joint="driven")
    found = run(made, duration=7.0 / slow, outputs=70, step=0.2)
    a = slow * found.t
    wanted = np.unwrap(np.arctan2(np.sin(a) * np.cos(bend), np.cos(a)))
    np.testing.assert_allclose(found["angle"], wanted, rtol=0, atol=1e-9)
    ratio = np.cos(bend) / (1 - np.sin(bend) ** 2 * np.sin(a) ** 2)
    speeds = found.v[:, 15:18] @ out / slow
    np.testing.assert_allclose(speeds, ratio, rtol=0, atol=1e-9)
    at = 12 * found.layout.reactions.index("drivers.motor")
    np.testing.assert_allclose(found.reactions[:, at + 5], load * ratio, rtol=0, atol=5e-6 * load)


# --- the chaotic pendulum: a plate that may turn about the rod it hangs on ---


def chaotic(theta, phi):
    """Mitiguy, Kane, Int. J. Robotics Research 15 (1996) 522; values of PyDy's chaos pendulum."""
    lA, mA, lB, mB = 0.075, 0.01, 0.2, 0.1
    made = Model("chaotic pendulum", gravity=[0, 0, G])
    rod = Rotation.from_rotvec([0, theta, 0])
    plate = rod * Rotation.from_rotvec([0, 0, phi])
    made.add_body(
        "rod", mass=mA, center=[0, 0, lA], inertia=[5e-6, 5e-6, 1e-9],
        orientation=rod.as_matrix().tolist(),
    )  # fmt: skip
    made.add_body(
        "plate", mass=mB, inertia=[50e-6, 250e-6, 200e-6], position=list(rod.apply([0, 0, lB])),
        orientation=plate.as_matrix().tolist(),
    )  # fmt: skip
    made.add_marker("rod.tip", position=[0, 0, lB])
    made.add_joint("hinge", "revolute", between=["ground", "rod"], axis="y")
    made.add_joint(
        "turn", "revolute", between=["rod.tip", "plate"], axis=list(rod.apply([0, 0, 1]))
    )
    made.add_sensor("theta", "angle", joint="hinge")
    made.add_sensor("phi", "angle", joint="turn")

    def rates(_, y):
        theta, phi, w, a = y
        s, c = np.sin(phi), np.cos(phi)
        push = 2 * (250e-6 - 50e-6) * a * w * s * c - G * (lA * mA + lB * mB) * np.sin(theta)
        w_rate = push / (5e-6 + 50e-6 * s**2 + 250e-6 * c**2 + lA**2 * mA + lB**2 * mB)
        return [w, a, w_rate, (50e-6 - 250e-6) * w**2 * s * c / 200e-6]

    return made, rates


@pytest.mark.parametrize(
    ("angles", "duration", "tolerance"),
    [((45.0, 0.5), 5.0, 1e-6), ((90.0, 1.0), 3.0, 1e-6)],
    ids=["stable", "chaotic"],
)
def test_chaotic_pendulum_of_mitiguy_and_kane(angles, duration, tolerance):
    """Against its two equations of motion, solved to 1e-12.

    Their signs depend on the axis each inertia is about: from 90° the plate, pushed off by 1°,
    turns over; from 45° it does not.
    """
    theta, phi = np.radians(angles)
    made, rates = chaotic(theta, phi)
    steps = np.array([4e-4, 2e-4])
    runs = [run(made, duration=duration, step=h, outputs=50, newton_tolerance=1e-11) for h in steps]
    truth = solve_ivp(
        rates, (0, duration), [theta, phi, 0, 0], t_eval=runs[0].t, rtol=1e-12, atol=1e-13,
        method="DOP853",
    ).y[:2].T  # fmt: skip
    found = [np.stack([one["theta"] + theta, one["phi"] + phi], axis=1) for one in runs]
    errors = [np.abs(value - truth).max() for value in found]
    assert 1.8 < order(steps, errors) < 2.2, errors
    np.testing.assert_allclose(extrapolated(*found), truth, rtol=0, atol=tolerance)
    assert (np.abs(truth[:, 1]).max() > 1) == (angles[0] == 90)
