"""The driven rigid slider-crank: motion in closed form, reactions by Newton and Euler by hand."""

from __future__ import annotations

import numpy as np
import pytest
from truthkit import run

from flexmb.model import Model

R, L, G = 0.15, 0.45, 9.81  # m, m, m/s^2
CRANK, ROD, SLIDER = (3.0, 0.02), (2.0, 0.04), 1.5  # kg and kg m^2 about the centre; kg
_OFF = 0.06, 0.18  # centres of mass from the crank's axis and from the crank pin, m
# Round-off, not truncation: a determined motion comes from its constraints alone.
_TOLERANCE = 1e-9


def model():
    """Crank, rod and slider with gravity across the guide; joints without a redundant row."""
    made = Model("slider-crank", gravity=[0, -G, 0])
    made.add_body("crank", mass=CRANK[0], center=[_OFF[0], 0, 0], inertia=[CRANK[1]] * 3)
    made.add_marker("crank.pin", position=[R, 0, 0])
    made.add_body(
        "rod", mass=ROD[0], center=[_OFF[1], 0, 0], inertia=[ROD[1]] * 3, position=[R, 0, 0]
    )
    made.add_marker("rod.wrist", position=[L, 0, 0])
    made.add_body("slider", mass=SLIDER, inertia=[0.01] * 3, position=[R + L, 0, 0])
    made.add_joint("bearing", "revolute", between=["ground", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod"])
    made.add_joint("wrist", "cylindrical", between=["rod.wrist", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle="60*t + 0.4*sin(70*t)")
    for body in ("slider", "rod.center"):
        for kind in ("position", "velocity", "acceleration"):
            made.add_sensor(f"{body.split('.')[0]}_{kind}", kind, of=body)
    made.add_sensor("angle", "angle", joint="bearing")
    return made


def direction(angle, rate, acceleration):
    """Unit vector at an angle, with its first and second derivative; (n, 2) each."""
    e = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    n = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    first = rate[:, None] * n
    return e, first, acceleration[:, None] * n - rate[:, None] ** 2 * e


@pytest.fixture(scope="module")
def closed_form():
    """Times, then angles and points with two derivatives."""
    t = np.linspace(0.0, 0.2, 101)
    a, a1, a2 = 60 * t + 0.4 * np.sin(70 * t), 60 + 28 * np.cos(70 * t), -1960 * np.sin(70 * t)
    b = -np.arcsin(R * np.sin(a) / L)
    b1 = -R * np.cos(a) * a1 / (L * np.cos(b))
    b2 = (-R * (np.cos(a) * a2 - np.sin(a) * a1**2) + L * np.sin(b) * b1**2) / (L * np.cos(b))
    u, w = direction(a, a1, a2), direction(b, b1, b2)
    slider = [R * x + L * y for x, y in zip(u, w, strict=True)]
    rod = [R * x + _OFF[1] * y for x, y in zip(u, w, strict=True)]
    return t, (a, a1, a2), (b, b1, b2), u, w, slider, rod


@pytest.fixture(scope="module")
def result():
    return run(model(), duration=0.2, step=5e-5, outputs=100, newton_tolerance=1e-12)


def test_motion_is_the_closed_form(result, closed_form):
    t, (a, _, _), _, _, _, slider, rod = closed_form
    np.testing.assert_allclose(result.t, t, atol=1e-15)
    np.testing.assert_allclose(result["angle"], a, atol=_TOLERANCE)
    for name, truth in (("slider", slider), ("rod", rod)):
        for kind, values in zip(("position", "velocity", "acceleration"), truth, strict=True):
            got = result.vector(f"{name}_{kind}")
            size = np.abs(values).max()
            np.testing.assert_allclose(got[:, :2], values, rtol=0, atol=_TOLERANCE * size)
            np.testing.assert_allclose(got[:, 2], 0.0, atol=_TOLERANCE * size)


def test_reactions_are_those_of_newton_and_euler(result, closed_form):
    """From the slider back to the crank; a multiplier acts as −λ on J, the second of `between`."""
    _, (_, _, a2), (_, _, b2), u, w, slider, rod = closed_form
    g = np.array([0.0, -G])
    wrist_x = -SLIDER * slider[2][:, 0]  # on the rod
    # Moments about the crank pin give the wrist force across the guide.
    about_pin = ROD[1] * b2 + _OFF[1] * cross(w[0], ROD[0] * (rod[2] - g))
    wrist_y = (about_pin / L + w[0][:, 1] * wrist_x) / w[0][:, 0]
    wrist = np.stack([wrist_x, wrist_y], axis=1)
    pin = ROD[0] * (rod[2] - g) - wrist  # on the rod
    crank = CRANK[0] * (_OFF[0] * u[2] - g)
    bearing = crank + pin  # on the crank
    torque = CRANK[1] * a2 + _OFF[0] * cross(u[0], crank) + R * cross(u[0], pin)
    guide = wrist_y + SLIDER * G  # up, on the slider: against −wrist_y and the weight
    size = np.abs(bearing).max()
    close(result.reaction("joints.bearing")[:, :2], -bearing, size)
    close(result.reaction("joints.pin")[:, :2], -pin, size)
    close(np.linalg.norm(result.reaction("joints.wrist")[:, 2:], axis=1), norm(wrist), size)
    close(np.linalg.norm(result.reaction("joints.guide")[:, 3:], axis=1), np.abs(guide), size)
    close(result.reaction("drivers.motor")[:, 0], -torque, np.abs(torque).max())


def test_drift_and_energy_balance(result):
    """Positions to Newton's remainder; velocities before their projection (of 16 m/s and 90 rad/s)
    to the h² of the method, some 1e-6 of them.

    The work is added up by the trapezoidal rule: its error h² ΔP'/12 is some 1e-5 of the energy.
    """
    assert result.drift[:, 0].max() < 1e-11
    assert result.drift[:, 1].max() < 1e-4
    assert result.mismatch() < 2e-5 * np.ptp(result.stored("kinetic"))


def cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def norm(vectors):
    return np.linalg.norm(vectors, axis=1)


def close(got, wanted, size):
    np.testing.assert_allclose(got, wanted, rtol=0, atol=_TOLERANCE * size)
