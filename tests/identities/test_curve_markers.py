"""Joints on curves against joints without: the same freedoms, accelerations and reactions.

A straight slot is an in-line joint and a round one a link; between rigid and flexible bodies, in
space and in the plane. Rows and tangents of all types are tried in `test_every_joint`.
"""

from __future__ import annotations

import numpy as np
import pytest
from curvekit import CARRIERS, TYPES, joined, pair
from enginekit import Bench, slope
from scipy.linalg import null_space

from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES

# Curvature of the pieces is exact to 1e-9 of it, multipliers are of the order of 10.
EXACT = 1e-7


def settled(model):
    """A bench with a closed pose near the placed one, and random velocities."""
    bench = Bench(model)
    rng = np.random.default_rng(5)
    bench.v[:] = rng.standard_normal(bench.layout.nv)
    bench.v[bench.sys.kkt.column < 0] = 0.0
    for _ in range(30):
        bench.matrix(symmetric=True)
        gap = bench.at().C
        d = bench.solve(np.concatenate([0.0 * bench.v, -gap]), 2)[: bench.layout.nv]
        bench.q[:] = bench.moved(bench.q, d)
    bench.at()
    np.testing.assert_allclose(bench.C, 0.0, atol=1e-12)
    return bench


def bodies(bench):
    """Columns of the bodies that may move."""
    kept = np.flatnonzero(bench.sys.kkt.column >= 0)
    last = sum(6 + int(m) for m in bench.sys.parts.bodies["m"])
    return kept[kept < last]


def motions(bench):
    """Projector (n, n) on the motions of the bodies that the rows allow."""
    kept = np.flatnonzero(bench.sys.kkt.column >= 0)
    N = null_space(bench.at().Cq[:, kept], rcond=1e-9)[: len(bodies(bench))]
    Q, _ = np.linalg.qr(N)
    return Q @ Q.T


def twins(kind, fields, twin, twin_fields, curve, carriers, planar):
    """The same pair of bodies with a joint on a curve and with its twin, in the same state."""
    made = []
    for name, words in ((kind, fields), (twin, twin_fields)):
        model = pair(carriers, planar)
        model.add_curve("c", **curve)
        model.add_joint("joint", name, between=["a.end", "b.end"], **words)
        made.append(model)
    one, two = settled(made[0]), Bench(made[1])
    n = sum(7 + int(m) for m in one.sys.parts.bodies["m"])
    two.q[:] = one.q[:n]
    two.at()
    np.testing.assert_allclose(two.C, 0.0, atol=1e-12)
    np.testing.assert_allclose(motions(one), motions(two), atol=1e-9)
    one.project()
    two.v[:] = one.v[: two.layout.nv]
    np.testing.assert_allclose(two.at().rate, 0.0, atol=1e-9)
    return one, two


def same_forces(one, two):
    a, b = one.accelerations()[0], two.accelerations()[0]
    n = two.layout.nv
    np.testing.assert_allclose(a[:n], b, atol=EXACT * np.abs(b).max())
    forces = [bench.at(vd=0.0).Cq[:, :n].T @ bench.lam for bench in (one, two)]
    np.testing.assert_allclose(*forces, atol=EXACT * np.abs(b).max())


LINE = {"points": [[-9, 0, 0], [9, 0, 0]]}
FLAT_LINE = {"points": [[-9, 0], [9, 0]]}


@pytest.mark.parametrize("carriers", CARRIERS)
def test_a_point_on_a_straight_curve_is_in_line(carriers):
    """The axis of the in-line joint is x of marker I, which the placed pose tells."""
    model = pair(carriers)
    axis = np.array(model.bodies["a"].orientation)
    e, v = axis[0], axis[1:]
    x = np.eye(3)[0]
    x = x + 2 * e * np.cross(v, x) + 2 * np.cross(v, np.cross(v, x))
    same_forces(*twins("point-on-curve", {"curve": "c"}, "in-line", {"axis": x.tolist()}, LINE,
                       carriers, False))  # fmt: skip


def test_a_pin_in_a_straight_slot_is_in_line_in_the_plane():
    for kind in ("pin-in-slot", "point-on-curve", "cam-knife"):
        same_forces(*twins(kind, {"curve": "c"}, "in-line", {"axis": "x"}, FLAT_LINE,
                           "rigid-rigid", True))  # fmt: skip


def test_a_pin_in_a_round_slot_is_a_link_in_the_plane():
    """And a roller of radius r on a disk of radius R is one of length R + r."""
    for kind, fields, length in (("pin-in-slot", {}, 0.8), ("cam-roller", {"radius": 0.3}, 1.1)):
        same_forces(*twins(kind, {"curve": "c", **fields}, "distance", {"length": length},
                           {"circle": 0.8}, "rigid-rigid", True))  # fmt: skip


@pytest.mark.parametrize("planar", [False, True], ids=["space", "plane"])
@pytest.mark.parametrize("kind", TYPES)
def test_rows_less_places_are_the_equations(kind, planar):
    """Rows are independent, places along the curves too: what is left holds the bodies."""
    bench = Bench(joined(kind, "rigid-rigid", planar))
    row = JOINT_TYPES[kind]
    for seed in range(5):
        bench.randomise(seed)
        Cq = bench.at().Cq[:, bench.sys.kkt.column >= 0]
        n = len(bodies(bench))
        assert np.linalg.matrix_rank(Cq, tol=1e-6) == bench.layout.nc
        places = np.linalg.matrix_rank(Cq[:, n:], tol=1e-6)
        assert places == len(bench.sys.parts.curve_markers) == row.curves
        held = null_space(Cq[:, n:].T).T @ Cq[:, :n]
        assert len(held) == (row.planar_equations if planar else row.equations)
        assert np.linalg.matrix_rank(held, tol=1e-6) == len(held)


@pytest.mark.parametrize("carriers", CARRIERS)
@pytest.mark.parametrize("kind", TYPES)
def test_joints_on_curves_do_no_work(kind, carriers):
    model = joined(kind, carriers)
    model.set_gravity([1.0, -2.0, -9.0])
    bench = Bench(model)
    bench.randomise(3)
    bench.project()
    np.testing.assert_allclose(bench.at().rate, 0.0, atol=1e-10)
    bench.accelerations()
    q, v, vd = bench.q.copy(), bench.v.copy(), bench.vd.copy()
    unit = 1.0 / np.sqrt(1.0 + 0.1 * np.abs(vd).max())

    def energy(s):
        s = unit * s
        moved = bench.moved(q, s * v + 0.5 * s * s * vd)
        return bench.at(q=moved, v=v + s * vd).energies.sum()

    kinetic = bench.at(q=q, v=v).energies[0]
    damping = bench.powers[1]
    assert slope(energy) / unit == pytest.approx(damping, abs=1e-6 * (kinetic + abs(damping)))


def test_a_driven_cam_needs_no_replaced_pivots():
    """Its driver is eliminated last: before it the two rows of the cam would hold one freedom."""
    model = Model("cam", plane="xy")
    model.add_curve("disk", circle=0.05, center=[0.02, 0])
    model.add_body("cam", mass=1, inertia=[1, 1, 1e-3])
    model.add_body("follower", mass=1, inertia=[1, 1, 1], position=[0, 0.05, 0])
    model.add_joint("pivot", "revolute", between=["ground", "cam"], axis="z")
    model.add_joint("guide", "prismatic", between=["ground", "follower"], axis="y")
    model.add_joint("contact", "cam-roller", between=["cam", "follower"], curve="disk", radius=0.01)
    model.add_driver("motor", joint="pivot", angle="t")
    bench = settled(model)
    for symmetric in (False, True):
        S = bench.matrix(cv=10.0, cp=0.01, symmetric=symmetric)
        kept = np.append(bench.sys.kkt.column >= 0, np.ones(bench.layout.nc, bool))
        b = np.where(kept, np.arange(len(S)) + 1.0, 0.0)
        x = bench.solve(b, 0)  # not refined: the factor itself has the digits
        assert bench.replaced == 0
        np.testing.assert_allclose((S @ x)[kept], b[kept], atol=1e-5 * np.abs(b).max())
