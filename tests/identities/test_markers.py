"""Markers and sensors against a second description of the motion, at large modal rotations.

Positions and orientations are written here once more with NumPy; velocities and accelerations are
their differences in time.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, curvature, exponential, rotation, slope
from generators import Mechanism

from flexmb.engine.algebra.forms import bend_of

DIFFERENCES = 1e-9
SECOND_DIFFERENCES = 3e-8
LAST_DIGITS = 1e-13


@pytest.fixture(
    params=[("flexible", 0.3), ("stiffened", 0.3), ("mixed", 1.0), ("mixed", 1e-4), ("mixed", 0.0)]
)
def bench(request):
    bodies, eta = request.param
    made = Bench(Mechanism(7, "loop", bodies).model)
    made.randomise(8, eta)
    return made


def placed(bench, q):
    """Positions (k, 3) and axes (k, 3, 3) of all markers at q."""
    parts = bench.sys.parts
    x, R = [], []
    for mk in parts.markers:
        if mk["body"] < 0:
            x.append(mk["rho"])
            R.append(mk["R"])
            continue
        row = parts.bodies[mk["body"]]
        i, m = int(row["iq"]), int(row["m"])
        A, s, E = rotation(q[i + 3 : i + 7]), mk["rho"] + mk["arm"], np.eye(3)
        if mk["modes"] >= 0:
            shapes = parts.pool[mk["modes"] : mk["modes"] + 6 * m].reshape(6, m)
            eta = q[i + 7 : i + 7 + m]
            moved = shapes @ eta
            if mk["bend"] >= 0:  # second order: half eta^T K_d eta along d, and about d
                K = bend_of(mk, m, parts.pool)
                moved[: K.shape[1]] -= 0.5 * np.einsum("idj,i,j->d", K, eta, eta)
            E = rotation(exponential(moved[3:]))
            s = mk["rho"] + moved[:3] + E @ mk["arm"]
        x.append(q[i : i + 3] + A @ s)
        R.append(A @ E @ mk["R"])
    return np.array(x), np.array(R)


def path(bench):
    """q(s) with velocity v and acceleration v̇ at s = 0."""
    q, v, vd = bench.q.copy(), bench.v.copy(), bench.vd.copy()
    return lambda s: bench.moved(q, s * v + 0.5 * s * s * vd)


def axial(W):
    return 0.5 * np.stack(
        [W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]], axis=1
    )


def test_second_order_rotations_about_one_axis_and_all_occur():
    bench = Bench(Mechanism(7, "loop", "stiffened").model)
    assert {4, 6} <= set(bench.sys.parts.markers["forms"].tolist())


def test_positions_and_axes(bench):
    x, R = placed(bench, bench.q)
    bench.at()
    np.testing.assert_allclose(bench.marker("x"), x, atol=10 * LAST_DIGITS)
    np.testing.assert_allclose(bench.marker("R"), R, atol=10 * LAST_DIGITS)


def test_velocities(bench):
    q = path(bench)
    bench.at()
    xd = slope(lambda s: placed(bench, q(s))[0])
    Rd = slope(lambda s: placed(bench, q(s))[1])
    _, R = placed(bench, bench.q)
    np.testing.assert_allclose(bench.marker("vx"), xd, atol=DIFFERENCES * 10)
    om = axial(Rd @ R.transpose(0, 2, 1))
    np.testing.assert_allclose(bench.marker("om"), om, atol=DIFFERENCES * 10)


def test_accelerations_at_zero_vd(bench):
    bench.vd[:] = 0.0
    q, v = path(bench), bench.v.copy()
    bench.at()
    bx, bom = bench.marker("bx"), bench.marker("bom")
    scale = max(1.0, np.abs(bx).max(), np.abs(bom).max())
    xdd = curvature(lambda s: placed(bench, q(s))[0])
    np.testing.assert_allclose(bx, xdd, atol=SECOND_DIFFERENCES * scale)
    omd = slope(lambda s: bench.at(q=q(s), v=v).marker("om"))
    np.testing.assert_allclose(bom, omd, atol=DIFFERENCES * scale)


def test_sensors_read_the_markers(bench):
    """Three motions of a marker, absolute and relative to another one: sums over their markers."""
    q, table = path(bench), bench.sys.sensors
    found = bench.at().channels

    def sums(s, first):
        x, _ = placed(bench, q(s))
        values = np.zeros(3)
        for channel in table.channels[first : first + 3]:
            for term in table.terms[channel["first"] : channel["first"] + channel["n"]]:
                values[term["a"]] += term["factor"] * x[term["J"], term["a"]]
        return values

    kinds = [lambda f: f(0.0), slope, curvature]
    for k in range(6):
        values = kinds[k // 2](lambda s, k=k: sums(s, 3 * k))
        scale = max(1.0, np.abs(values).max())
        np.testing.assert_allclose(
            found[3 * k : 3 * k + 3], values, atol=SECOND_DIFFERENCES * scale
        )


def test_angle_sensors_follow_more_than_one_turn():
    """Turning a body about the axis of its only joint by steps below half a turn adds up."""
    for seed in range(20):
        made = Mechanism(seed, "chain", "rigid", n=1)
        if made.model.joints["j0"].type in ("revolute", "cylindrical"):
            break
    bench = Bench(made.model)
    bench.at()
    start = bench.channels[-1]
    sensors = bench.sys.sensors
    axis = bench.marker("R")[sensors.terms[sensors.channels[-1]["first"]]["J"]][:, 2]
    r, A = bench.q[:3].copy(), rotation(bench.q[3:7])
    for k in range(1, 8):
        turn = exponential(2.0 * k * A.T @ axis)
        d = np.zeros(6)
        d[3:] = 2.0 * A.T @ axis
        bench.at(q=bench.moved(bench.q, d))
        np.testing.assert_allclose(bench.channels[-1] - start, 2.0 * k, atol=1e-12)
        np.testing.assert_allclose(rotation(bench.q[3:7]), A @ rotation(turn), atol=1e-12)
    np.testing.assert_allclose(bench.q[:3], r)


def test_a_marker_seen_from_another_is_their_difference():
    """Positions, velocities and accelerations, in global axes."""
    made = Mechanism(7, "chain", "rigid")
    names = [made.marker(body, f"seen{body}", [0.1 * body, 0.3, -0.2]) for body in (0, 1)]
    for kind in ("position", "velocity", "acceleration"):
        for k, name in enumerate(names):
            made.model.add_sensor(f"{kind}{k}", kind, of=name)
        made.model.add_sensor(f"apart_{kind}", kind, of=names[0], relative_to=names[1])
    bench = Bench(made.model)
    bench.randomise(8)
    values = dict(zip(bench.layout.channels, bench.at().channels, strict=True))
    for kind in ("position", "velocity", "acceleration"):
        for axis in "xyz":
            one, other = (values[f"{kind}{k}.{axis}"] for k in (0, 1))
            assert abs(other) > 1e-3
            assert values[f"apart_{kind}.{axis}"] == pytest.approx(one - other, rel=1e-9)
