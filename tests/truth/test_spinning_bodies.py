"""Rotation in space: the free asymmetric body in Jacobi elliptic functions, and the heavy top.

For I1 < I2 < I3 and L² > 2 T I2: w1 = a cn u, w2 = b sn u, w3 = c dn u (Landau, Lifshitz,
Mechanics, section 37).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipkinc
from truthkit import Memory, extrapolated, order, reference, run

from flexmb.analysis.kinematics import kinematics
from flexmb.engine.compile import compile_system
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


def spin_by_series(t, inertia, spin, step=0.02, terms=28):
    """Angular velocity in body axes (n, 3) by Taylor's series with 64 bits of mantissa.

    About the middle axis the elliptic functions lose what their modulus 1 - 1e-6 does.
    """
    J, w = (np.array(a, np.longdouble) for a in (inertia, spin))
    share = (np.roll(J, -1) - np.roll(J, -2)) / J
    now, found = np.longdouble(0), []
    for end in t:
        while now < end:
            h = min(np.longdouble(step), end - now)
            row = np.zeros((terms + 1, 3), np.longdouble)
            row[0] = w
            for n in range(terms):
                a, b = np.roll(row[: n + 1], -1, axis=1), np.roll(row[n::-1], -2, axis=1)
                row[n + 1] = share * (a * b).sum(axis=0) / (n + 1)
            w, now = (row * h ** np.arange(terms + 1)[:, None]).sum(axis=0), now + h
        found.append(w)
    return np.array(found, float)


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("method", "accuracy", "third"),
    [("radau", 1e-7, 1e-3), ("auto", 1e-8, 1e-3), ("radau", 1e-8, 3e-3)],
)
def test_round_off_is_told_of_a_body_that_turns_over_and_over(method, accuracy, third):
    """Spun about the middle axis: 0.16, 0.16 and 0.04 of 0.8 to 1.06 accuracies were told."""
    inertia, spin = [1.0, 2.0, 3.0], [1e-3, 3.0, third]
    made = free_body(inertia, spin)
    made.add_marker("body.end", position=[0, 1, 0])
    made.add_sensor("end", "position", of="body.end")
    found = run(made, duration=40.0, outputs=100, accuracy=accuracy, method=method)
    momentum = np.array(inertia) * spin
    momentum /= np.linalg.norm(momentum)  # in space, as the body stands in its axes at first
    known = spin_by_series(found.t, inertia, spin)
    known = known[:, 1] * inertia[1] / np.linalg.norm(np.array(inertia) * spin)
    error = np.abs(found.vector("end") @ momentum - known).max() / np.ptp(known)
    told = found.statistics["measured_error_of_positions"]
    assert 1 / 3 < told / error < 12


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


CARDAN = ("xyz", "yzx", "zxy", "xzy", "yxz", "zyx")
EULER = ("xyx", "xzx", "yxy", "yzy", "zxz", "zyz")


def followed_angles(t, pose, sequence):
    """(3, n) angles at t of the rotations pose(t), by steps that are short beside the distances.

    Axis k of the body never points along axis i of ground exactly, so the middle angle stays in its
    range; the others are unwrapped.
    """
    i, j, k = ("xyz".index(axis) for axis in sequence)
    m, s = 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0
    fine = np.union1d(t, np.linspace(0.0, t[-1], 4001))
    for _ in range(25):
        R = pose(fine).as_matrix()
        off = np.sqrt(1.0 - np.minimum(R[:, i, k] ** 2, 1.0))
        long = 10.0 * np.diff(fine) > 0.5 * np.minimum(off[1:], off[:-1]) + 1e-9
        fine = np.union1d(fine, (fine[1:] + fine[:-1])[long] / 2.0)
    if i == k:
        table = np.arctan2(R[:, j, i], -s * R[:, m, i]), np.arctan2(R[:, i, j], s * R[:, i, m])
        middle = np.arctan2(np.hypot(R[:, i, j], R[:, i, m]), R[:, i, i])
    else:
        table = np.arctan2(-s * R[:, j, k], R[:, k, k]), np.arctan2(-s * R[:, i, j], R[:, i, i])
        middle = np.arctan2(s * R[:, i, k], np.hypot(R[:, j, k], R[:, k, k]))
    first, third = np.unwrap(table)
    return np.stack([first, middle, third])[:, np.searchsorted(fine, t)]


def leaning_door(lean, driven=False, place=(0.0, 0.0, 0.0)):
    """A door that turns by 2 rad/s about y but for `lean`: its z goes by x, the pole of xyz."""
    axis = np.array([np.sin(lean), np.cos(lean), 0.0])
    made = Model("door")
    made.add_marker("ground.hinge", position=list(place))
    made.add_body("door", mass=1.0, inertia=[0.1] * 3, position=list(place),
                  angular_velocity=[0.0] * 3 if driven else (2.0 * axis).tolist())  # fmt: skip
    made.add_joint("hinge", "revolute", between=["ground.hinge", "door"], axis=axis.tolist())
    if driven:
        made.add_driver("motor", joint="hinge", angle="2*t")
    made.add_sensor("o", "orientation", of="door", sequence="xyz")
    return made, lambda t: Rotation.from_rotvec(2.0 * np.outer(t, axis))


@pytest.mark.parametrize("lean", [1e-1, 1e-3, 1e-6])
@pytest.mark.parametrize("method", ["explicit-rk", "radau", "generalized-alpha"])
@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1000.0, -500.0, 800.0)])
def test_angles_are_followed_past_a_singular_pose(lean, method, place):
    """By steps and rows that see nothing of how it is passed."""
    for knobs in ({"accuracy": 1e-3}, {"step": 0.05}):
        for outputs in (3, 60):
            made, pose = leaning_door(lean, place=place)
            found = run(made, duration=6.0, outputs=outputs, method=method, **knobs)
            truth = followed_angles(found.t, pose, "xyz")
            np.testing.assert_allclose(found.sensors.T, truth, rtol=0, atol=1e-7)


@pytest.mark.parametrize("lean", [1e-1, 1e-6])
@pytest.mark.parametrize("outputs", [3, 60])
def test_kinematics_follows_them_too(lean, outputs):
    made, pose = leaning_door(lean, driven=True)
    made.set_kinematics(duration=6.0, outputs=outputs)
    memory = Memory()
    kinematics(compile_system(made), made, memory)
    t, *_, sensors, _, _ = memory.tables()
    np.testing.assert_allclose(sensors.T, followed_angles(t, pose, "xyz"), rtol=0, atol=1e-7)


@pytest.mark.seconds
@pytest.mark.parametrize("outputs", [4, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", ["explicit-rk", "radau"])
def test_twelve_sequences_of_angles_of_a_free_top(method, outputs):
    """Torque-free: it turns about its moment of momentum and about its own axis, both uniformly."""
    axis, angle, (A, C) = [0.48, 0.6, 0.64], 0.9, (0.2, 0.3)
    start = Rotation.from_rotvec(angle * np.array(axis))
    w = np.array([2.5, -1.8, 2.0])
    about = start.apply(np.array([A, A, C]) * w) / A
    own = np.array([0.0, 0.0, (1.0 - C / A) * w[2]])

    def pose(t):
        precession = Rotation.from_rotvec(np.outer(t, about))
        return precession * start * Rotation.from_rotvec(np.outer(t, own))

    made = Model("top")
    made.add_body("top", mass=1.0, inertia=[A, A, C], angular_velocity=start.apply(w).tolist(),
                  orientation={"axis": axis, "angle": angle})  # fmt: skip
    for sequence in (*CARDAN, *EULER):
        made.add_sensor(sequence, "orientation", of="top", sequence=sequence)
    found = run(made, duration=20.0, outputs=outputs, accuracy=1e-4, method=method)
    for sequence in (*CARDAN, *EULER):
        truth = followed_angles(found.t, pose, sequence)
        said = np.stack([found[f"{sequence}.{name}"] for name in ("alpha", "beta", "gamma")])
        turns = 2.0 * np.pi * np.rint((said - truth)[:, :1] / (2.0 * np.pi))
        np.testing.assert_allclose(said - turns, truth, rtol=0, atol=0.1, err_msg=sequence)
