"""Coefficients of the rotation tangent at every size of angle, against their power series."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from enginekit import exponential, quaternion_product, rotation, slope
from truthkit import run

from flexmb.engine.algebra.vector import tangent_coefficients
from flexmb.engine.bodies.motion import angular_velocity, hermite, rotates_too_far, rotation_rate
from flexmb.model import Model


def series(x):
    """Σ (−x)^k/(2k+2)!, Σ (−x)^k/(2k+3)! and their derivatives; x is an angle squared."""
    k = range(25)
    c1 = math.fsum((-x) ** i / math.factorial(2 * i + 2) for i in k)
    c2 = math.fsum((-x) ** i / math.factorial(2 * i + 3) for i in k)
    d1 = math.fsum(-i * (-x) ** (i - 1) / math.factorial(2 * i + 2) for i in k[1:])
    d2 = math.fsum(-i * (-x) ** (i - 1) / math.factorial(2 * i + 3) for i in k[1:])
    return c1, c2, d1, d2


@pytest.mark.parametrize("x", [0.0, 1e-12, 1e-4, 9.99e-3, 1.001e-2, 0.1, 1.0, 9.0])
def test_tangent_coefficients(x):
    found = tangent_coefficients(x)
    np.testing.assert_allclose(found[:2], series(x)[:2], rtol=1e-12)
    # Beside the switch to the series the derivatives lose digits; they are used times x.
    np.testing.assert_allclose(found[2:], series(x)[2:], rtol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_cubic_is_interpolated_exactly(share):
    """Value and slope within a step of length h, from those at its ends."""
    h, cubic = 0.2, np.polynomial.Polynomial([1.0, -2.0, 3.0, 5.0])
    slope, ends = cubic.deriv(), np.array([0.0, h])
    found = hermite(share, h, *cubic(ends), *slope(ends))
    np.testing.assert_allclose(found, [cubic(share * h), slope(share * h)], rtol=1e-13)


def test_the_angular_velocity_of_a_rotation_vector():
    """Body axes: R' dR/dt of R = exp(theta), at a large angle."""
    theta, rate = np.array([0.7, -1.1, 0.4]), np.array([0.3, 0.5, -0.9])
    R = rotation(exponential(theta))
    spin = R.T @ slope(lambda s: rotation(exponential(theta + s * rate)))
    wanted = [spin[2, 1], spin[0, 2], spin[1, 0]]
    np.testing.assert_allclose(angular_velocity(theta, rate), wanted, atol=1e-9)


@pytest.mark.parametrize("size", [0.02, 0.3, 0.33, 2.5])
def test_the_rate_of_a_rotation_vector_is_that_of_its_angular_velocity(size):
    """Below and above the switch to a series: the way back from the rate to body axes."""
    theta, spin = size * np.array([0.6, -0.64, 0.48]), np.array([0.3, 0.5, -0.9])
    rate = np.array(rotation_rate(theta, spin))
    np.testing.assert_allclose(angular_velocity(theta, rate), spin, atol=1e-12)
    R = rotation(exponential(theta))
    turn = R.T @ slope(lambda s: rotation(exponential(theta + s * rate)))
    np.testing.assert_allclose([turn[2, 1], turn[0, 2], turn[1, 0]], spin, atol=1e-8)


def test_a_tumbling_body_keeps_its_angular_momentum_by_rotation_vectors_of_a_step() -> None:
    """A J ω' of a free body is constant, to order 8 by steps of half a radian about moving axes."""
    J, errors = np.diag([0.2, 0.35, 0.5]), []
    for step in (0.1, 0.05):
        model = Model("tumbler")
        model.add_body(
            "body", mass=1.0, inertia=np.diag(J).tolist(), angular_velocity=[4.0, 3.0, -2.0]
        )
        motion = run(model, method="coordinate-partitioning", step=step, duration=0.5, outputs=5)
        poses = [rotation(q[3:]) for q in motion.q]
        momenta = np.array([A @ J @ v[3:] for A, v in zip(poses, motion.v, strict=True)])
        errors.append(np.abs(momenta - momenta[0]).max())
    assert poses[-1][0, 0] < 0.9  # it has turned far
    assert errors[0] < 1e-8
    assert math.log2(errors[0] / errors[1]) == pytest.approx(8.0, abs=0.5)


@pytest.mark.parametrize(
    ("angle", "rate", "leaps"),
    [(1.4, 0, False), (1.6, 0, True), (2.0, 1.05, False), (2.1, 1.0, True), (3.0, 2.0, False)],
)
def test_a_step_that_turns_a_body_by_more_than_its_speeds_tell(angle, rate, leaps):
    """In one second, about an axis aside: twice the faster of both speeds, or 1.5 radians."""
    bodies = np.zeros(1, dtype=[("iq", int), ("iv", int)])
    axis, before = np.array([0.6, 0.0, 0.8]), np.array([9.0, 9, 9, 0.5, -0.5, 0.5, 0.5])
    after = np.array([9.0, 9, 9, *quaternion_product(before[3:], exponential(angle * axis))])
    states = [
        SimpleNamespace(q=q, v=np.array([7.0, 7, 7, *v * axis]))
        for q, v in ((before, rate), (after, 0.2 * rate))
    ]
    parts = SimpleNamespace(bodies=bodies, coordinates=np.zeros(0))
    run = SimpleNamespace(
        state=states[0],
        work=SimpleNamespace(trial=states[1]),
        system=SimpleNamespace(parts=parts, rows=np.zeros(0), coupled=np.zeros(0)),
    )
    assert rotates_too_far(run, 1.0) == leaps


def leaping(width):
    """A body that a driver turns by two radians in so many seconds."""
    made = Model("leap")
    made.add_body("b", mass=1, inertia=[1, 1, 1], center=[0.3, 0, 0])
    made.add_joint("j", "revolute", between=["ground", "b"], axis="z")
    made.add_driver("w", joint="j", angle=f"2*step(t, 0.505, 0, {0.505 + width!r}, 1)")
    made.add_sensor("a", "angle", joint="j")
    return made


def test_a_driver_may_leap_within_a_fixed_step():
    """Two radians in a ten-millionth of a second, which no step of a hundredth resolves."""
    found = run(leaping(1e-7), duration=1.0, outputs=10, step=0.01, method="radau")
    np.testing.assert_allclose(found["a"], 2.0 * (found.t > 0.505), rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", ["radau", "generalized-alpha"])
def test_controlled_steps_are_as_long_after_a_leap_as_before(method):
    """All steps were as short as the leap asks for: a quarter of a million for 1e-4 s."""
    knobs = {"duration": 1.0, "outputs": 10, "accuracy": 1e-4, "method": method}
    slow, fast = (run(leaping(width), **knobs) for width in (1e-2, 1e-6))
    np.testing.assert_allclose(fast["a"], 2.0 * (fast.t > 0.505), rtol=0, atol=1e-12)
    assert fast.statistics["steps"] < 2 * slow.statistics["steps"]
    assert fast.statistics["energy_balance_error"] < 1e-3  # nothing moves in the rows themselves
