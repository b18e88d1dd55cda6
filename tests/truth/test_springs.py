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
