"""Couplers and screws: rows against differences, ranks at random poses, rolling without slip.

A gear, told by radii alone, must make the two wheels' points in contact move with one velocity,
wherever the carrier moves: the null space of Cq is tried against that, so that signs are not taken
from the code that sets them. A coupler takes exactly one freedom.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, rotation, slope
from generators import cloud, interface, random_rotation
from scipy.spatial.transform import Rotation

from flexmb.model import Model
from flexmb.model.joints.joint import count

DIFFERENCES = 1e-9  # of numbers below 1000; the difference rules leave 1e-12 of them
RANK = 1e-9

SPUR = {"radii": [0.2, 0.1]}
BEVEL = {"teeth": [20, 30]}
UP, OUT = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])

# name: (place and axis of wheel 1, of wheel 2, contact point, fields of the gear)
GEARS = {
    "outer": ((0, 0, 0), UP, (0.3, 0, 0), UP, (0.2, 0, 0), SPUR),
    "outer, opposite axes": ((0, 0, 0), UP, (0.3, 0, 0), -UP, (0.2, 0, 0), SPUR),
    "inner": ((0, 0, 0), UP, (0.1, 0, 0.05), UP, (0.2, 0, 0), {**SPUR, "internal": True}),
    "bevel": ((0, 0, 0.3), UP, (0.3, 0, 0), OUT, (0.2, 0, 0.3), BEVEL),
    "bevel, axis to the apex": ((0, 0, 0.3), -UP, (0.3, 0, 0), OUT, (0.2, 0, 0.3), BEVEL),
    "bevel, behind": ((0, 0, 0.3), UP, (-0.3, 0, 0), OUT, (-0.2, 0, 0.3), BEVEL),
    "bevel, at the apex": ((0, 0, 0), UP, (0, 0, 0), OUT, (0.2, 0, 0.3), BEVEL),
}


def carried(model, name, at, axis, swapped=False, kind="revolute"):
    """A body on the carrier by a joint of that name; swapped: the carrier is marker J."""
    model.add_body(name, mass=1.0, inertia=[1.0, 1.0, 1.0], position=list(map(float, at)))
    model.add_marker(f"carrier.{name}", position=list(map(float, at)))
    ends = [f"carrier.{name}", name]
    ends = ends[::-1] if swapped else ends
    model.add_joint(name, kind, between=ends, axis=list(map(float, axis)))


def geared(case, swapped, planar=False):
    """A free carrier, in its placed pose at the global origin, with two wheels in mesh."""
    first, u1, second, u2, _, fields = GEARS[case]
    model = Model(case, plane="xy" if planar else None)
    model.add_body("carrier", mass=1.0, inertia=[1.0, 1.0, 1.0])
    carried(model, "one", first, u1, swapped[0])
    carried(model, "two", second if not planar else (*second[:2], 0), u2, swapped[1])
    model.add_coupler("mesh", "gear", joints=["one", "two"], **fields)
    return model


def motions(bench):
    """Velocities (nv, k) that the constraints allow, out-of-plane coordinates left out."""
    columns = bench.sys.kkt.column >= 0
    Cq = bench.Cq[:, columns]
    _, size, Vt = np.linalg.svd(Cq)
    rank = int(np.sum(size > RANK * size[0]))
    free = np.zeros((len(columns), Cq.shape[1] - rank))
    free[columns] = Vt[rank:].T
    return free


def point_velocity(bench, body, x, v):
    """Global velocity (3,) of the material point of a body at the global place x."""
    row = bench.layout.bodies[body]
    A = rotation(bench.q[row.iq + 3 : row.iq + 7])
    w = A @ v[row.iv + 3 : row.iv + 6]
    return v[row.iv : row.iv + 3] + np.cross(w, x - bench.q[row.iq : row.iq + 3])


@pytest.mark.parametrize("swapped", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("case", GEARS)
def test_wheels_roll_without_slip_and_keep_one_freedom(case, swapped):
    bench = Bench(geared(case, swapped))
    bench.at(v=0.0)
    np.testing.assert_allclose(bench.C, 0, atol=1e-15)
    allowed = motions(bench)
    assert allowed.shape[1] == 6 + 1
    contact = np.array(GEARS[case][4])
    for v in allowed.T:
        one, two = (point_velocity(bench, body, contact, v) for body in (1, 2))
        np.testing.assert_allclose(one, two, atol=1e-12)
    turning = allowed[bench.layout.bodies[1].iv + 5]  # the wheels do turn
    assert np.abs(turning).max() > 0.1


@pytest.mark.parametrize("case", ["outer", "outer, opposite axes", "inner"])
def test_planar_gears_are_one_equation(case):
    model = geared(case, (False, True), planar=True)
    counted = count(model)
    assert (counted.rigid_coordinates, counted.equations, counted.mobility) == (9, 2 + 2 + 1, 4)
    bench = Bench(model)
    bench.at(v=0.0)
    allowed = motions(bench)
    assert allowed.shape[1] == 4
    contact = np.array(GEARS[case][4])
    for v in allowed.T:
        one, two = (point_velocity(bench, body, contact, v) for body in (1, 2))
        np.testing.assert_allclose(one, two, atol=1e-12)


def racked(planar=False, swapped=(False, False), below=1.0):
    model = Model("rack", plane="xy" if planar else None)
    model.add_body("carrier", mass=1.0, inertia=[1.0, 1.0, 1.0])
    carried(model, "pinion", (0.1, 0.2, 0), UP, swapped[0])
    carried(model, "rack", (0.3, 0.2 - below * 0.15, 0), OUT, swapped[1], "prismatic")
    model.add_coupler("mesh", "rack-and-pinion", joints=["pinion", "rack"], radius=0.15)
    return model


@pytest.mark.parametrize("below", [1.0, -1.0])
@pytest.mark.parametrize("swapped", [(False, False), (True, True)])
@pytest.mark.parametrize("planar", [False, True])
def test_a_pinion_rolls_on_its_rack(planar, swapped, below):
    model = racked(planar, swapped, below)
    bench = Bench(model)
    bench.at(v=0.0)
    np.testing.assert_allclose(bench.C, 0, atol=1e-15)
    allowed = motions(bench)
    assert allowed.shape[1] == count(model).mobility == (4 if planar else 7)
    contact = np.array([0.1, 0.2 - below * 0.15, 0.0])
    for v in allowed.T:
        one, two = (point_velocity(bench, body, contact, v) for body in (1, 2))
        np.testing.assert_allclose(one, two, atol=1e-12)


def turned(place, axis, through, angle):
    """Pose (r, R) after a turn about a line; place is such a pair."""
    r, R = place
    Q = Rotation.from_rotvec(angle * np.asarray(axis))
    return through + Q.apply(r - through), Q * R


def pose(place):
    return np.concatenate([place[0], np.roll(place[1].as_quat(), 1)])


@pytest.mark.parametrize("case", ["outer", "inner", "bevel, behind"])
def test_rows_vanish_and_keep_their_rank_at_poses_of_many_turns(case):
    """Wheels turned in their ratio, through several turns, on a carrier that stands anywhere."""
    bench, rng = Bench(geared(case, (False, True))), np.random.default_rng(5)
    first, u1, second, u2, _, fields = GEARS[case]
    sizes = fields.get("radii") or fields["teeth"]
    outward = -1.0 if "behind" in case else 1.0
    ratio = -outward * sizes[0] / sizes[1] * (-1.0 if fields.get("internal") else 1.0)
    for _ in range(4):
        angle = rng.uniform(-20, 20)
        frame = rng.standard_normal(3), Rotation.from_matrix(random_rotation(rng))
        unit = Rotation.identity()
        places = [(np.zeros(3), unit)]
        for at, axis, by in ((first, u1, angle), (second, u2, ratio * angle)):
            places.append(turned((np.array(at, float), unit), axis, np.array(at, float), by))
        moved = [(frame[0] + frame[1].apply(r), frame[1] * R) for r, R in places]
        bench.at(q=np.concatenate([*map(pose, moved), [angle]]), v=0.0)
        np.testing.assert_allclose(bench.C, 0, atol=1e-12)
        assert motions(bench).shape[1] == 7


@pytest.mark.parametrize("planar", [False, True])
def test_a_rack_keeps_its_rank_at_poses_of_many_turns(planar):
    """The lowest point of the pinion turns forward, and takes the rack with it by R θ."""
    bench, rng = Bench(racked(planar)), np.random.default_rng(6)
    for _ in range(4):
        angle = rng.uniform(-20, 20)
        frame = rng.standard_normal(3), Rotation.from_matrix(random_rotation(rng))
        if planar:
            frame = frame[0] * [1, 1, 0], Rotation.from_rotvec([0, 0, rng.uniform(-3, 3)])
        unit, pin = Rotation.identity(), np.array([0.1, 0.2, 0.0])
        places = [
            (np.zeros(3), unit),
            turned((pin, unit), UP, pin, angle),
            (np.array([0.3 + 0.15 * angle, 0.05, 0.0]), unit),
        ]
        moved = [(frame[0] + frame[1].apply(r), frame[1] * R) for r, R in places]
        bench.at(q=np.concatenate([*map(pose, moved), [angle]]), v=0.0)
        np.testing.assert_allclose(bench.C, 0, atol=1e-12)
        assert motions(bench).shape[1] == (4 if planar else 7)


def screwed(pitch=0.7):
    model = Model("screw")
    model.add_marker("ground.I", position=[0.3, -0.2, 0.5])
    model.add_marker("ground.far", position=[0.0, 0.0, 1.0])
    model.add_body("nut", mass=1.0, inertia=[1.0, 1.0, 1.0], position=[0.3, 0.6, 0.5])
    model.add_joint("thread", "screw", between=["ground.I", "nut"], axis="y", pitch=pitch)
    return model


@pytest.mark.parametrize("pitch", [0.7, -0.2])
def test_a_screw_moves_by_its_pitch_for_every_turn(pitch):
    """From where it stands placed, 0.8 m along its axis, on."""
    model = screwed(pitch)
    bench = Bench(model)
    assert count(model).mobility == 1
    for angle in (0.0, 1.3, -25.0):
        y = 0.6 + pitch * angle / (2 * np.pi)
        R = Rotation.from_rotvec([0, angle, 0])
        bench.at(q=np.concatenate([pose((np.array([0.3, y, 0.5]), R)), [angle]]), v=0.0)
        np.testing.assert_allclose(bench.C, 0, atol=1e-12)
        (v,) = motions(bench).T
        np.testing.assert_allclose(v[1], v[4] * pitch / (2 * np.pi), atol=1e-14)
        assert bench.layout.nc == 6 and abs(v[4]) > 0.1


def hooked(first, second):
    """A body that has turned in a universal joint, by given angles about its two axes."""
    a, b = np.array([0.6, 0.8, 0.0]), UP
    model = Model("hook")
    model.add_body("b", mass=1.0, inertia=[1.0, 1.0, 1.0])
    axes = {"axis": list(a), "second_axis": list(b)}
    model.add_joint("hook", "universal", between=["ground", "b"], **axes)
    model.add_driver("one", joint="hook", angle="t")
    model.add_driver("two", joint="hook", second_angle="3*t")
    bench = Bench(model)
    R = Rotation.from_rotvec(first * a) * Rotation.from_rotvec(second * b)
    bench.at(q=pose((np.zeros(3), R)), v=0.0)
    return bench


def test_both_angles_of_a_universal_joint():
    """The cross turns about the first axis, the body in it about the second; both count alike."""
    rng = np.random.default_rng(2)
    for _ in range(5):
        t = rng.uniform(-0.9, 0.9)
        bench = hooked(t, 3 * t)
        bench.at(t=t, v=0.0)
        np.testing.assert_allclose(bench.C, 0, atol=1e-14)
        assert np.linalg.matrix_rank(bench.Cq) == 6
    off = hooked(0.2, 0.5)
    off.at(t=0.0)
    np.testing.assert_allclose(off.C[-2:], [0.2, 0.5], atol=1e-14)


def test_gears_count_from_the_placed_pose():
    """Markers whose own axes tell angles that are not zero, and a second axis of a universal."""
    model = Model("placed")
    model.add_body("carrier", mass=1.0, inertia=[1.0, 1.0, 1.0])
    for k, name in enumerate(("one", "two")):
        turned = {"axis": "z", "angle": 0.7 + 1.9 * k}
        model.add_body(name, mass=1.0, inertia=[1.0, 1.0, 1.0], orientation=turned)
        model.add_joint(name, "revolute", between=["carrier", name])
    model.add_coupler("mesh", "gear", joints=["one", "two"], ratio=-3)
    bench = Bench(model)
    bench.at(v=0.0)
    np.testing.assert_allclose(bench.C, 0, atol=1e-15)
    assert motions(bench).shape[1] == 7


def test_a_spring_on_the_second_angle_of_a_universal_joint():
    model = Model("hook")
    model.add_body("b", mass=1.0, inertia=[0.2, 0.3, 0.4])
    axes = {"axis": [0, 1, 0], "second_axis": [0, 0, 1]}
    model.add_joint("hook", "universal", between=["ground", "b"], **axes)
    model.add_force(
        "coil", "rotational-spring-damper", joint="hook", stiffness=5, about="second_axis"
    )
    bench = Bench(model)
    R = Rotation.from_rotvec([0, 0.4, 0]) * Rotation.from_rotvec([0, 0, 0.3])
    bench.q[:] = np.concatenate([pose((np.zeros(3), R)), [0.3]])
    bench.accelerations()
    # About its own axis z the body feels the spring alone.
    np.testing.assert_allclose(bench.vd[5], -5 * 0.3 / 0.4, rtol=1e-10)
    np.testing.assert_allclose(bench.vd[:5], 0, atol=1e-10)


def everything(flexible):
    """A carrier with wheels, rack, screw and universal joint, coupled in all ways at once."""
    rng = np.random.default_rng(11)
    model = Model("all couplers")
    if flexible:
        made = cloud(rng, 3)
        model.add_body("carrier", made.flexbody("carrier", [interface(rng, "node", 3)]))
    else:
        model.add_body("carrier", mass=1.0, inertia=[1.0, 2.0, 3.0])
    held = {"interface": "node"} if flexible else {}
    joints = {
        "a": ("revolute", {"axis": "z"}), "b": ("revolute", {"axis": "z"}),
        "c": ("cylindrical", {"axis": "x"}), "d": ("screw", {"axis": "y", "pitch": 0.3}),
        "e": ("universal", {"axis": "x", "second_axis": "z"}),
        "f": ("prismatic", {"axis": "x"}),
    }  # fmt: skip
    for k, (name, (kind, fields)) in enumerate(joints.items()):
        at = [0.3 * k, 0.1 * k, 0.0]
        model.add_marker(f"carrier.{name}", position=at, **held)
        if flexible and k % 2:
            shape = cloud(rng, 3)
            model.add_body(name, shape.flexbody(name, [interface(rng, "node", 3)]))
            model.add_marker(f"{name}.end", position=at, interface="node")
        else:
            model.add_body(name, mass=1.0, inertia=[1.0, 2.0, 3.0])
            model.add_marker(f"{name}.end", position=at)
        model.add_joint(name, kind, between=[f"carrier.{name}", f"{name}.end"], **fields)
    model.add_coupler("gear", "gear", joints=["a", "b"], ratio=-1.7)
    model.add_coupler("second", "gear", joints=["b", "d"], ratio=0.6)
    model.add_coupler("rack", "rack-and-pinion", joints=["b", "f"], radius=0.4)
    three = [("c", "stroke", 2.0), ("c", "angle", -0.7), ("e", "second_angle", 1.3)]
    terms = [dict(zip(("joint", "coordinate", "factor"), term, strict=True)) for term in three]
    model.add_coupler("sum", "linear", terms=terms, constant=0.4)
    terms = [{"joint": "e", "coordinate": "angle", "factor": 1}, {**terms[2], "factor": 2}]
    model.add_coupler("hook", "linear", terms=terms)
    return model


def close(found, wanted):
    scale = max(1.0, np.abs(wanted).max(initial=0.0))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=DIFFERENCES * scale)


@pytest.fixture(params=[False, True], ids=["rigid", "flexible"])
def bench(request):
    made = Bench(everything(request.param))
    made.randomise(3)
    return made


def test_a_coupler_is_as_many_rows_as_joints_and_one_scalar_less(bench):
    assert bench.layout.coordinates == (
        "couplers.gear.a", "couplers.second.b", "couplers.rack.b", "couplers.sum.c.stroke",
        "couplers.sum.c.angle", "couplers.hook.e.angle", "joints.d",
    )  # fmt: skip
    assert bench.layout.reactions[6:] == (
        "couplers.gear.a", "couplers.gear.b", "couplers.second.b", "couplers.second.d",
        "couplers.rack.b", "couplers.rack.f", "couplers.sum.c.stroke", "couplers.sum.c.angle",
        "couplers.sum.e.second_angle", "couplers.hook.e.angle", "couplers.hook.e.second_angle",
    )  # fmt: skip
    assert bench.layout.nc - len(bench.layout.coordinates) == 5 + 5 + 4 + 5 + 4 + 5 + 5
    bench.at()
    assert np.linalg.matrix_rank(bench.Cq, tol=1e-9) == bench.layout.nc


def test_rows_rates_and_right_side(bench):
    q, v, n = bench.q.copy(), bench.v.copy(), bench.layout.nv
    Cq, gamma, rate = bench.at().Cq, bench.gamma, bench.rate
    for d in np.eye(n):
        close(Cq @ d, slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).C))
    close(rate, Cq @ v)
    close(-gamma, slope(lambda s: bench.at(q=bench.moved(q, s * v)).rate))


def test_reactions_and_their_tangents(bench):
    n, q = bench.layout.nv, bench.q.copy()
    with_lam, lam = bench.at().residual, bench.lam.copy()
    close(with_lam - bench.at(lam=0.0).residual, bench.Cq.T @ lam)
    bench.at(lam=lam)
    tangent = (bench.matrix(cp=1.0) - bench.matrix())[:n, :n]
    change = [slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual) for d in np.eye(n)]
    close(tangent, np.array(change).T)


def test_couplers_do_no_work_in_motions_that_they_allow(bench):
    """−λᵀ Cq v over all their rows is nothing: what one joint gives, the others take."""
    bench.at()
    first = bench.layout.rows.index("couplers.gear.a: coordinate")
    Cq, lam = bench.Cq, bench.lam.copy()
    scalar = len(bench.layout.coordinates)
    # λ in proportion: the residual of every massless coordinate vanishes.
    rows = Cq[first:, -scalar:][:, : scalar - 1]
    lam[first:] -= rows @ np.linalg.lstsq(rows, lam[first:], rcond=None)[0]
    for v in motions(bench).T:
        bodies = Cq[first:, :-scalar].T @ lam[first:]
        assert abs(bodies @ v[:-scalar]) < 1e-11
