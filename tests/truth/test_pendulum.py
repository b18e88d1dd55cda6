"""Pendulums: swing in Jacobi elliptic functions, pin forces by Newton, chains of point masses.

With u = K(k) + w0 t, k = sin(amplitude/2), w0² = m g d/J: sin(angle/2) = k sn u, rate = 2 k w0 cn u
(Landau, Lifshitz, Mechanics, section 11; DLMF 22.19.1).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj, ellipk
from truthkit import extrapolated, order, reference, run

from flexmb.model import Model

MASS, LENGTH, G = 2.0, 1.0, 9.81  # kg, m, m/s²: a uniform bar about one end
W0 = np.sqrt(1.5 * G / LENGTH)
AMPLITUDE = np.pi / 2
PERIOD = 4 * ellipk(np.sin(AMPLITUDE / 2) ** 2) / W0
# Relative frequency error of generalized-alpha at spectral radius 0.8 over (w h)²: the constant
# |β + (α_m − α_f)/2 − 1/6| of its local error.
_FREQUENCY_ERROR = 0.0864
KEYS = ("x", "y", "thetadot", "string_force")


def bar():
    """A uniform bar hung at one end, horizontal at first."""
    made = Model("bar", gravity=[0, -G, 0])
    J = MASS * LENGTH**2 / 12
    made.add_body("bar", mass=MASS, center=[LENGTH / 2, 0, 0], inertia=[1e-3, J, J])
    made.add_marker("bar.tip", position=[LENGTH, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    for kind in ("position", "velocity", "acceleration"):
        made.add_sensor(kind, kind, of="bar.tip")
    made.add_sensor("swing", "angle", joint="pin")
    return made


def swing(t, w0=W0, amplitude=AMPLITUDE):
    """Angle from the lowest point [rad], its rate and acceleration."""
    k = np.sin(amplitude / 2)
    sn, cn, _, _ = ellipj(ellipk(k * k) + w0 * t, k * k)
    angle = 2 * np.arcsin(k * sn)
    return angle, 2 * k * w0 * cn, -(w0**2) * np.sin(angle)


def truth(t):
    """Tip position, velocity, acceleration and the pin's force on the bar, (n, 2) each."""
    a, a1, a2 = swing(t)
    e = np.stack([np.sin(a), -np.cos(a)], axis=1)
    n = np.stack([np.cos(a), np.sin(a)], axis=1)
    acceleration = a2[:, None] * n - a1[:, None] ** 2 * e
    force = MASS * (acceleration / 2 * LENGTH + [0, G])
    return LENGTH * e, LENGTH * a1[:, None] * n, LENGTH * acceleration, force


@pytest.fixture(scope="module", params=[1.0, 0.8, 0.4])
def refined(request):
    """Runs over one period with 200, 400, 800 steps."""
    sizes = [200, 400, 800]
    runs = [
        run(
            bar(), duration=PERIOD, step=PERIOD / n, outputs=50,
            spectral_radius=request.param, newton_tolerance=1e-10,
        )
        for n in sizes
    ]  # fmt: skip
    return PERIOD / np.array(sizes), runs


def test_everything_reported_converges_with_order_two(refined):
    h, runs = refined
    wanted = truth(runs[0].t)
    names = ("position", "velocity", "acceleration", "multipliers")
    for name, values in zip(names, wanted, strict=True):
        errors = []
        for one in runs:
            if name == "multipliers":
                got = -one.reaction("joints.pin")[:, :2]
            else:
                got = one.vector(name)[:, :2]
            errors.append(np.abs(got - values).max() / np.abs(values).max())
        assert 1.9 < order(h, errors) < 2.1, (name, errors)


@pytest.mark.parametrize(
    ("p", "knobs", "sizes"),
    [
        (5, {"method": "explicit-rk", "order": 5}, [50, 100, 200]),
        (8, {"method": "explicit-rk", "order": 8}, [16, 24, 32]),
        (5, {"method": "radau", "newton_tolerance": 1e-12}, [24, 48, 96]),
    ],
    ids=["order 5", "order 8", "radau"],
)
def test_everything_reported_converges_with_high_order(p, knobs, sizes):
    outputs = 8 if sizes[0] < 50 else 50
    runs = [run(bar(), duration=PERIOD, step=PERIOD / n, outputs=outputs, **knobs) for n in sizes]
    position, velocity, acceleration, force = truth(runs[0].t)
    for name, wanted, found in (
        ("position", position, [one.vector("position")[:, :2] for one in runs]),
        ("velocity", velocity, [one.vector("velocity")[:, :2] for one in runs]),
        ("acceleration", acceleration, [one.vector("acceleration")[:, :2] for one in runs]),
        ("force", force, [-one.reaction("joints.pin")[:, :2] for one in runs]),
    ):
        errors = [np.abs(one - wanted).max() for one in found]
        assert p - 0.1 < order(1 / np.array(sizes), errors) < p + 1, (name, errors)
        assert errors[-1] < 1e-8 * np.abs(wanted).max() * (10 if p == 5 else 1)


def test_error_is_that_of_the_method():
    """At spectral radius 0.8 the phase lags by at most 0.0864 (w0 h)² w0 t: checked within two."""
    h = PERIOD / 800
    result = run(bar(), duration=PERIOD, step=h, outputs=100, newton_tolerance=1e-10)
    lag = _FREQUENCY_ERROR * (W0 * h) ** 2 * W0 * result.t  # rad of phase
    error = np.abs(result["swing"] + np.pi / 2 - swing(result.t)[0])
    assert np.all(error <= 2 * lag * AMPLITUDE + 1e-12)
    assert error.max() > 0.1 * lag.max()  # the bound is not idle


def test_iftomm_simple_pendulum():
    """Ten seconds, four swings; Richardson's value of two runs leaves O(h⁴), some 1e-9 here.

    A body with its centre at d = 2/3 m and the moment of inertia d (1 m − d) about it swings as the
    point mass at 1 m does; its pin carries d θ̇² along the rod for the point's θ̇².
    """
    table = reference("rigid_bodies", "iftomm_A01_simple_pendulum")
    times = [float(t) for t in table["values"]]
    d = 2 / 3
    made = Model("simple pendulum", gravity=[0, -G, 0])
    made.add_body("mass", mass=1.0, center=[-d, 0, 0], inertia=[0.1, 0.2, d * (1 - d)])
    made.add_marker("mass.point", position=[-1, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "mass"], axis="z")
    made.add_sensor("point", "position", of="mass.point")
    runs = [
        run(made, duration=10.0, step=h, outputs=1000, newton_tolerance=1e-11) for h in (4e-4, 2e-4)
    ]
    rows = runs[0].at(times)
    column = {key: np.array([row[key] for row in table["values"].values()]) for key in KEYS}
    x, y, rate, force = (column[key] for key in KEYS)
    along = [
        np.sum(one.reaction("joints.pin")[rows, :2] * np.stack([x, y], axis=1), axis=1)
        for one in runs
    ]
    for got, wanted, size in (
        ([one["point.x"][rows] for one in runs], x, 1.0),
        ([one["point.y"][rows] for one in runs], y, 1.0),
        ([one.v[rows, 5] for one in runs], rate, 4.4),
        (along, force - (1 - d) * rate**2, 29.4),
    ):
        np.testing.assert_allclose(got[1], wanted, rtol=0, atol=2e-5 * size)
        np.testing.assert_allclose(extrapolated(*got), wanted, rtol=0, atol=1e-8 * size)


@pytest.fixture(scope="module")
def double():
    """Two point masses on massless rods, released from the horizontal; the table's values.

    Angles and rates are those of any two bodies with the same m2 l1 d2, J2 + m2 d2², m2 d2,
    J1 + m1 d1² + m2 l1² and m1 d1 + m2 l1 (d to the centre of mass, J about it, l1 between pins).
    """
    table = reference("rigid_bodies", "double_pendulum_point_masses")["values"]
    made = Model("double pendulum", gravity=[0, -G, 0])
    for k, m, d, J in ((1, 1.0, 0.5, 0.25), (2, 1.5, 2 / 3, 1 / 3)):
        made.add_body(
            f"arm{k}", mass=m, center=[d, 0, 0], inertia=[0.2, 0.2, J], position=[k - 1, 0, 0]
        )
        made.add_marker(f"arm{k}.end", position=[1, 0, 0])
        made.add_sensor(f"end{k}", "position", of=f"arm{k}.end")
    made.add_joint("first", "revolute", between=["ground", "arm1"], axis="z")
    made.add_joint("second", "revolute", between=["arm1.end", "arm2"], axis="z")
    angles = np.array([[v["theta1"], v["theta2"]] for v in table.values()])
    places = np.stack([np.sin(angles), -np.cos(angles)], axis=-1).cumsum(axis=1)
    rates = np.array([[v["omega1"], v["omega2"]] for v in table.values()])
    return made, [float(t) for t in table], (places, rates)


def at_times(result, times):
    """Places of both ends (n, 2, 2) and rates (n, 2)."""
    rows = result.at(times)
    ends = np.stack([result.vector(f"end{k}")[rows, :2] for k in (1, 2)], axis=1)
    return ends, result.v[rows][:, [5, 11]]


@pytest.mark.parametrize(
    ("h", "p", "tolerance", "knobs"),
    [
        # The motion multiplies errors by some hundreds: those of h³ or more to 2e-8, those that
        # Newton's method leaves of round-off, 2e-15/(β'h²) of every acceleration, to 1e-8.
        (4e-4, 2, 1e-7, {"method": "generalized-alpha", "newton_tolerance": 1e-12}),
        # No Newton's method, and O(h⁶) ...
        (5e-3, 5, 1e-12, {"method": "explicit-rk", "order": 5}),
        # ... and O(h⁹), where the slope is that of both.
        (2e-2, 8, 2e-13, {"method": "explicit-rk", "order": 8}),
        (1.25e-2, 5, 1e-8, {"method": "radau", "newton_tolerance": 1e-12}),
    ],
    ids=["generalized-alpha", "order 5", "order 8", "radau"],
)
def test_double_pendulum_with_fixed_steps(double, h, p, tolerance, knobs):
    made, times, wanted = double
    knobs = {"duration": 5.0, "outputs": 50, **knobs}
    steps = np.array([h, h / 2])
    found = [at_times(run(made, step=step, **knobs), times) for step in steps]
    for k in range(2):
        errors = [np.abs(one[k] - wanted[k]).max() for one in found]
        assert p - 0.1 < order(steps, errors) < p + (0.1 if p < 8 else 1.5), errors
        best = extrapolated(*[one[k] for one in found], p)
        size = np.abs(wanted[k]).max()
        np.testing.assert_allclose(best, wanted[k], rtol=0, atol=tolerance * size)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("method", ["auto", "generalized-alpha", "explicit-rk", "radau"])
def test_double_pendulum_under_error_control(double, method, accuracy):
    """What was asked for, although the motion multiplies errors; and the run knows its own."""
    made, times, (places, _) = double
    result = run(made, duration=5.0, outputs=50, accuracy=accuracy, method=method)
    size = np.ptp(result.sensors, axis=0).max()
    error = np.abs(at_times(result, times)[0] - places).max() / size
    assert error < accuracy
    tight = run(made, duration=5.0, outputs=50, accuracy=1e-11, method="explicit-rk")
    assert np.abs(at_times(tight, times)[0] - places).max() < 1e-10
    everywhere = np.abs(result.sensors - tight.sensors).max() / size
    said = result.statistics["measured_error_of_positions"]
    assert everywhere < max(3 * said, 0.2 * accuracy)
    assert said < max(5 * everywhere, 0.2 * accuracy)
