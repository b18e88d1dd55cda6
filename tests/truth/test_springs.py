"""A mass on a spring and a damper, pushed harmonically: closed form of the forced oscillator."""

from __future__ import annotations

import numpy as np
import pytest
from truthkit import order, run

from flexmb.model import Model

M, C, K, G = 2.0, 1.5, 300.0, 9.81  # kg, N s/m, N/m, m/s^2
FREE, FIRST = 0.5, 0.7  # unstretched length and length at the start, m
FORCE, DRIVE = 4.0, 9.0  # N, rad/s


def oscillator():
    """The mass hangs below the ground in a vertical guide; y is up."""
    made = Model("oscillator", gravity=[0, -G, 0])
    made.add_body("mass", mass=M, inertia=[0.1] * 3, position=[0, -FIRST, 0])
    made.add_joint("guide", "prismatic", between=["ground", "mass"], axis="y")
    made.add_force(
        "spring", "spring-damper", between=["ground", "mass"],
        stiffness=K, damping=C, free_length=FREE,
    )  # fmt: skip
    made.add_force("push", "force", at="mass", value=[0, f"{FORCE}*sin({DRIVE}*t)", 0])
    for kind in ("position", "velocity", "acceleration"):
        made.add_sensor(kind, kind, of="mass")
    return made


def closed_form(t):
    """y and two derivatives: m ÿ + c ẏ + k (y − y0) = F sin Ωt with y0 = −free − m g/k."""
    rest = -FREE - M * G / K
    response = FORCE / (K - M * DRIVE**2 + 1j * C * DRIVE)
    forced = [(response * (1j * DRIVE) ** n * np.exp(1j * DRIVE * t)).imag for n in range(3)]
    root = -C / (2 * M) + 1j * np.sqrt(K / M - (C / (2 * M)) ** 2)
    # The free part Re(a exp(root t)) meets y(0) and rest at the start.
    y0, v0 = -FIRST - rest - response.imag, -(response * 1j * DRIVE).imag
    a = y0 + 1j * (root.real * y0 - v0) / root.imag
    free = [(a * root**n * np.exp(root * t)).real for n in range(3)]
    return [rest + forced[0] + free[0], forced[1] + free[1], forced[2] + free[2]]


@pytest.fixture(scope="module")
def refined():
    steps = np.array([8e-3, 4e-3, 2e-3])
    return steps, [run(oscillator(), duration=2.0, step=h, outputs=50) for h in steps]


def test_motion_converges_to_the_closed_form(refined):
    steps, runs = refined
    for name, wanted in zip(
        ("position", "velocity", "acceleration"), closed_form(runs[0].t), strict=True
    ):
        errors = [np.abs(one[f"{name}.y"] - wanted).max() / np.ptp(wanted) for one in runs]
        assert 1.9 < order(steps, errors) < 2.1, (name, errors)
        # A phase error of 0.0864 (w h)² w t, w = 12.2 rad/s, while the free part decays.
        assert errors[-1] < 1e-3


def test_works_and_energies_balance(refined):
    """Spring and gravity store, the damper takes, the push gives; all of order h²."""
    steps, runs = refined
    errors = [one.mismatch() for one in runs]
    assert 1.8 < order(steps, errors) < 2.2, errors
    fine = runs[-1]
    y, v, _ = closed_form(fine.t)
    spring = 0.5 * K * (-y - FREE) ** 2
    np.testing.assert_allclose(fine.stored("spring"), spring, atol=2e-3 * spring.max())
    np.testing.assert_allclose(fine.stored("gravity"), M * G * y, atol=1e-3 * M * G)
    t = np.linspace(0, 2.0, 20001)
    _, rate, _ = closed_form(t)
    taken = np.trapezoid(-C * rate**2, t)
    given = np.trapezoid(FORCE * np.sin(DRIVE * t) * rate, t)
    assert -fine.stored("damper_work")[-1] == pytest.approx(-taken, rel=3e-3)
    assert fine.stored("applied_work")[-1] == pytest.approx(given, rel=3e-3)
    np.testing.assert_allclose(fine.stored("kinetic"), 0.5 * M * v**2, atol=2e-3 * M)


def follower_errors(omega, damping, **knobs):
    """Errors of position, velocity, acceleration of a mass whose stiff spring holds it to sin t.

    1 kg on ω² N/m, pushed by ω² sin t N: the complex response is 1/(1 − 1/ω² + 2 i ζ/ω).
    """
    made = Model("follower")
    response = 1.0 / (1 - 1 / omega**2 + 2j * damping / omega)
    made.add_body(
        "b", mass=1, inertia=[1, 1, 1], position=[1 + response.imag, 0, 0],
        velocity=[response.real, 0, 0],
    )  # fmt: skip
    made.add_joint("guide", "prismatic", between=["ground", "b"], axis="x")
    made.add_force(
        "spring", "spring-damper", between=["ground", "b"], free_length=1.0,
        stiffness=omega**2, damping=2 * damping * omega,
    )  # fmt: skip
    made.add_force("push", "force", at="b", value=[f"{omega**2}*sin(t)", 0, 0])
    for kind in ("position", "velocity", "acceleration"):
        made.add_sensor(kind, kind, of="b")
    found = run(made, duration=2.0, **knobs)
    late, wave = found.t > 0.5, response * np.exp(1j * found.t)
    return [
        np.abs(found[f"{kind}.x"] - (kind == "position") - (1j**n * wave).imag)[late].max()
        for n, kind in enumerate(("position", "velocity", "acceleration"))
    ]


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.5])
@pytest.mark.parametrize(("method", "step"), [("radau", 0.1), ("generalized-alpha", 0.01)])
def test_accelerations_of_what_follows_a_stiff_spring_are_of_order_2(method, step, damping):
    """Steps of 100 to 1000 times the vibration: a filter alone would leave nothing of them."""
    coarse, fine = (
        follower_errors(1e4, damping, method=method, step=h, outputs=round(2 / h))[2]
        for h in (step, step / 2)
    )
    assert coarse < 2e-3
    assert coarse / fine > 3.5


@pytest.mark.parametrize("omega", [10.0, 30.0, 100.0, 1000.0, 1e5])
def test_accelerations_under_error_control_and_between_steps(omega):
    """From stiffness that the steps resolve to such that they do not; rows between the steps."""
    assert follower_errors(omega, 0.02, method="radau", accuracy=1e-4, outputs=173)[2] < 2e-3
    fixed = {"method": "generalized-alpha", "step": 0.01, "outputs": 173}
    assert follower_errors(omega, 0.02, **fixed)[2] < 1e-3
