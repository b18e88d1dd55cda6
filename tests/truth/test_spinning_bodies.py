"""Rotation in space: the free asymmetric body in Jacobi elliptic functions, and the heavy top.

For I1 < I2 < I3 and L² > 2 T I2: w1 = a cn u, w2 = b sn u, w3 = c dn u (Landau, Lifshitz,
Mechanics, section 37).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj, ellipkinc
from truthkit import extrapolated, order, reference, run

from flexmb.model import Model


def free_body(inertia, spin):
    made = Model("free body")
    made.add_body("body", mass=1.0, inertia=list(inertia), angular_velocity=list(spin))
    return made


def euler_solution(t, inertia, spin):
    """Angular velocity in body axes (n, 3) by elliptic functions."""
    I, w = np.array(inertia), np.array(spin)  # noqa: E741
    twice_energy, square = I @ w**2, (I**2) @ w**2
    assert square > twice_energy * I[1]
    a = np.sqrt((twice_energy * I[2] - square) / (I[0] * (I[2] - I[0])))
    b = np.sqrt((twice_energy * I[2] - square) / (I[1] * (I[2] - I[1])))
    c = np.sqrt((square - twice_energy * I[0]) / (I[2] * (I[2] - I[0])))
    rate = np.sqrt((I[2] - I[1]) * (square - twice_energy * I[0]) / I.prod())
    k2 = (I[1] - I[0]) * (twice_energy * I[2] - square)
    k2 /= (I[2] - I[1]) * (square - twice_energy * I[0])
    # With w1, w3 > 0 the sign of dw1/dt = (I2 − I3)/I1 w2 w3 makes u run backwards in sn.
    start = ellipkinc(np.arctan2(w[1] / b, w[0] / a), k2)
    sn, cn, dn, _ = ellipj(start + rate * t, k2)
    return np.stack([a * cn, b * sn, c * dn], axis=1)


@pytest.mark.parametrize("name", ["free_body_generic", "dzhanibekov_1_2_3"])
def test_elliptic_functions_are_the_reference(name):
    table = reference("rigid_bodies", name)
    times = np.array([float(t) for t in table["values"]])
    spin = euler_solution(times, table["params"]["I"], table["params"]["Omega0"])
    wanted = [row["Omega_body"] for row in table["values"].values()]
    np.testing.assert_allclose(spin, wanted, atol=1e-9)


def test_free_body_converges_to_elliptic_functions():
    table = reference("rigid_bodies", "free_body_generic")["params"]
    steps = np.array([0.02, 0.01, 0.005])
    runs = [
        run(free_body(table["I"], table["Omega0"]), duration=10.0, step=h, outputs=100)
        for h in steps
    ]
    wanted = euler_solution(runs[0].t, table["I"], table["Omega0"])
    errors = [np.abs(one.v[:, 3:6] - wanted).max() for one in runs]
    assert 1.9 < order(steps, errors) < 2.1, errors
    I = np.array(table["I"])  # noqa: E741
    # Euler's equations give the accelerations.
    wanted = (np.roll(I, -1) - np.roll(I, 1)) * np.roll(wanted, -1, 1) * np.roll(wanted, 1, 1) / I
    errors = [np.abs(one.vd[:, 3:6] - wanted).max() for one in runs]
    assert 1.9 < order(steps, errors) < 2.1, errors


@pytest.mark.parametrize(
    ("name", "h", "tolerance"),
    [
        # Richardson's value leaves O(h⁴) over ten seconds, (w h)⁴ w t = 1e-11 · 10, ...
        ("free_body_generic", 1e-3, 2e-9),
        # ... and here the unstable middle axis multiplies it by e^(lam t) up to each flip.
        ("dzhanibekov_1_2_3", 2e-4, 2e-6),
    ],
)
def test_free_body_ends_where_the_reference_does(name, h, tolerance):
    table = reference("rigid_bodies", name)
    params = table["params"]
    runs = [
        run(
            free_body(params["I"], params["Omega0"]),
            duration=10.0, step=step, outputs=20, newton_tolerance=1e-11,
        )
        for step in (h, h / 2)
    ]  # fmt: skip
    rows = runs[0].at([float(t) for t in table["values"]])
    spin = [one.v[rows, 3:6] for one in runs]
    turn = [one.q[rows, 3:7] for one in runs]
    wanted = np.array([row["Omega_body"] for row in table["values"].values()])
    quaternion = np.array([row["quaternion_wxyz_ODE"] for row in table["values"].values()])
    np.testing.assert_allclose(extrapolated(*spin), wanted, rtol=0, atol=tolerance * 5)
    got = extrapolated(*turn)
    sign = np.sign(np.sum(got * quaternion, axis=1, keepdims=True))
    np.testing.assert_allclose(sign * got, quaternion, rtol=0, atol=tolerance)


@pytest.fixture(scope="module")
def top():
    """The heavy top of the reference, spun at 150 rad/s, and its table of values."""
    table = reference("rigid_bodies", "heavy_top_lie_group")
    params = table["params"]
    made = Model("heavy top", gravity=params["g"])
    made.add_body(
        "top", mass=params["m"], center=params["X_com_body"], inertia=params["J_com_body"],
        angular_velocity=params["Omega0_body"], velocity=[0, 0, 0],
    )  # fmt: skip
    made.add_joint("pin", "spherical", between=["ground", "top"])
    made.add_sensor("centre", "position", of="top.center")
    return made, table


def seen(result, table):
    """Centres (n, 3) and Euler parameters (n, 4), in the reference's sign, and those wanted."""
    rows = result.at([float(t) for t in table["values"]])
    centers = np.array([row["com"] for row in table["values"].values()])
    wanted = np.array([row["quaternion_wxyz"] for row in table["values"].values()])
    turns = result.q[rows, 3:7]
    turns = turns * np.sign(np.sum(turns * wanted, axis=1, keepdims=True))
    return (result.vector("centre")[rows], turns), (centers, wanted)


@pytest.mark.parametrize(
    ("h", "p", "tolerance", "knobs"),
    [
        # A step of 4e-5 s turns it by 0.006 rad. Richardson's value leaves O(h³) of order 2 ...
        (4e-5, 2, 5e-6, {"method": "generalized-alpha", "newton_tolerance": 1e-11}),
        # ... and one order more than theirs of all others: 1e-3 s is 0.15 rad.
        (1e-3, 5, 5e-8, {"method": "explicit-rk", "order": 5}),
        (1e-3, 5, 5e-9, {"method": "radau", "newton_tolerance": 1e-12}),
        (2e-3, 8, 1e-12, {"method": "explicit-rk", "order": 8}),
    ],
    ids=["generalized-alpha", "order 5", "radau", "order 8"],
)
def test_heavy_top_with_fixed_steps(top, h, p, tolerance, knobs):
    made, table = top
    knobs = {"duration": 2.0, "outputs": 20, **knobs}
    steps = np.array([h, h / 2])
    found = [seen(run(made, step=step, **knobs), table) for step in steps]
    for k in range(2):
        values, wanted = [one[0][k] for one in found], found[0][1][k]
        errors = [np.abs(value - wanted).max() for value in values]
        assert p - 0.2 < order(steps, errors) < p + (0.2 if p < 8 else 1.0), errors
        np.testing.assert_allclose(extrapolated(*values, p), wanted, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("knobs", "accuracies"),
    [
        ({"method": "auto"}, (1e-3, 1e-5, 1e-7)),
        ({"method": "generalized-alpha"}, (1e-3,)),
        ({"method": "explicit-rk", "order": 5}, (1e-3, 1e-5, 1e-7)),
        ({"method": "radau"}, (1e-3, 1e-5)),
    ],
    ids=["auto", "generalized-alpha", "order 5", "radau"],
)
def test_heavy_top_under_error_control(top, knobs, accuracies):
    """What was asked for is reached after 48 turns of the spin, and the run knows its own error.

    It measures that at more times than the table has, at which a finer run that agrees with the
    table stands for it.
    """
    made, table = top
    exact = run(made, duration=2.0, outputs=60, accuracy=1e-10, method="explicit-rk")
    (centers, _), (wanted, _) = seen(exact, table)
    span = np.ptp(exact.vector("centre"), axis=0).max()
    assert np.abs(centers - wanted).max() < 1e-9 * span
    for accuracy in accuracies:
        result = run(made, duration=2.0, outputs=60, accuracy=accuracy, **knobs)
        error = np.abs(result.vector("centre") - exact.vector("centre")).max() / span
        said = result.statistics["measured_error_of_positions"]
        assert error < 2 * accuracy, (accuracy, error, said)
        assert 1 / 3 < said / error < 3, (accuracy, error, said)
