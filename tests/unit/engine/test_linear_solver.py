"""The factorisation of the KKT matrix against dense solves, and its guards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from enginekit import Bench
from generators import BODIES, TOPOLOGIES, Mechanism

from flexmb.flexbody import Interface, rigid_body
from flexmb.model import Model

EPS = 1e-9  # regularisation of the rows
CASES = [(topology, bodies) for topology in TOPOLOGIES for bodies in BODIES]


@pytest.fixture(params=CASES, ids=["-".join(case) for case in CASES])
def bench(request):
    made = Bench(Mechanism(21, *request.param).model)
    made.randomise(22)
    return made


@pytest.mark.parametrize("symmetric", [True, False])
def test_solves_agree_with_a_dense_solver(bench, symmetric):
    # a step size at which no stiffness outweighs the mass
    S = bench.matrix(cv=1e-4, cp=1e-6, symmetric=symmetric)
    assert bench.replaced == 0
    b = np.random.default_rng(0).standard_normal(len(S))
    wanted = np.linalg.solve(S, b)
    # A condition number up to 1e7 takes that much of 1e-16, and each refinement gains eight digits
    # of what ε = 1e-9 left.
    for rounds, tolerance in ((2, 1e-8), (0, 1e-1)):
        found = bench.solve(b, rounds)
        np.testing.assert_allclose(found, wanted, atol=tolerance * np.abs(wanted).max())


def test_refinement_meets_the_equations(bench):
    S = bench.matrix(symmetric=True)
    b = np.random.default_rng(1).standard_normal(len(S))
    x = bench.solve(b, 2)
    gap = np.abs(S @ x - b).max() / (np.abs(S).max() * np.abs(x).max())
    assert gap < 1e-12


def test_both_factorisations_agree_on_a_symmetric_matrix(bench):
    b = np.random.default_rng(2).standard_normal(bench.layout.nv + bench.layout.nc)
    bench.matrix(symmetric=True)
    wanted = bench.solve(b, 2)
    bench.matrix(symmetric=False)
    np.testing.assert_allclose(bench.solve(b, 2), wanted, atol=1e-9 * np.abs(wanted).max())


def test_regularisation_is_relative_to_each_row(bench):
    nv, place = bench.layout.nv, bench.sys.kkt.place
    S = bench.matrix(symmetric=True)
    Cq = S[nv:, :nv]
    wanted = EPS * (Cq**2 / np.diag(S)[:nv]).sum(axis=1)
    np.testing.assert_allclose(bench.work.factor.eps[place[nv:]], wanted, rtol=1e-12)


def four_bar(redundant):
    """A planar four-bar linkage of revolute joints: three redundant rows, or none."""
    model = Model("four-bar", gravity=[0, -9.81, 0])
    corners = [[0, 0, 0], [0, 1, 0], [2, 1.5, 0], [2, 0, 0]]
    for name, at, to in (("a", 0, 1), ("b", 1, 2), ("c", 2, 3)):
        model.add_body(name, mass=1.0, inertia=[0.1, 0.1, 0.1], position=corners[at])
        end = np.subtract(corners[to], corners[at]).tolist()
        model.add_marker(f"{name}.end", position=end)
    model.add_marker("ground.right", position=corners[3])
    kinds = ["revolute"] * 4 if redundant else ["revolute", "spherical", "cylindrical", "revolute"]
    pairs = [("ground", "a"), ("a.end", "b"), ("b.end", "c"), ("c.end", "ground.right")]
    for k, (kind, between) in enumerate(zip(kinds, pairs, strict=True)):
        axis = {} if kind == "spherical" else {"axis": "z"}
        model.add_joint(f"j{k}", kind, between=between, **axis)
    bench = Bench(model)
    bench.v[5] = 2.0
    bench.project()
    return bench


def test_redundant_rows_change_no_acceleration():
    wanted, _ = four_bar(False).accelerations()
    bench = four_bar(True)
    found, lam = bench.accelerations()
    assert np.linalg.matrix_rank(bench.Cq) == bench.layout.nc - 3
    np.testing.assert_allclose(found, wanted, atol=1e-8 * np.abs(wanted).max())
    np.testing.assert_allclose(bench.Cq @ found, bench.gamma, atol=1e-8 * np.abs(found).max())
    np.testing.assert_allclose(bench.v[5::6], four_bar(False).v[5::6], atol=1e-10)
    assert np.isfinite(lam).all()


def test_redundant_multipliers_have_least_weighted_norm():
    """No part of λ / √ε lies along self-stress: each null direction of Cqᵀ carries nothing."""
    bench = four_bar(True)
    _, lam = bench.accelerations()
    nv, place = bench.layout.nv, bench.sys.kkt.place
    weight = np.sqrt(bench.work.factor.eps[place[nv:]] / EPS)
    # λ = W⁻¹ μ with W = diag(weight): ε-regularisation picks the least |W λ|
    null = np.linalg.svd((bench.Cq / weight[:, None]).T)[2][-3:]
    np.testing.assert_allclose(null @ (weight * lam), 0.0, atol=1e-6 * np.abs(lam).max())


def test_a_joint_told_twice_shares_its_load_evenly():
    made = Mechanism(23, "chain", "rigid", n=3)
    single = Bench(made.model)
    joint = made.model.joints["j1"]
    made.model.add_joint("again", joint.type, between=list(joint.between))
    double = Bench(made.model)
    for bench in (single, double):
        bench.randomise(24)
        bench.lam[:] = 0.0
    wanted, lam = single.accelerations()
    found, shared = double.accelerations()
    np.testing.assert_allclose(found, wanted, atol=1e-7 * np.abs(wanted).max())

    def rows(bench, name):
        return [k for k, row in enumerate(bench.layout.rows) if row.startswith(name + ":")]

    total = lam[rows(single, "joints.j1")]
    for name in ("joints.j1", "joints.again"):
        half = shared[rows(double, name)]
        np.testing.assert_allclose(half, 0.5 * total, atol=1e-6 * np.abs(total).max())


@pytest.mark.parametrize("inertia", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("twice", [False, True])
def test_a_point_on_an_arm_swings_as_a_pendulum(inertia, twice):
    """A joint turns it 1/inertia times as easily as it moves it, and is as stiff along the arm."""
    model = Model("point", gravity=[0, -9.81, 0])
    model.add_body("point", mass=1, inertia=[inertia] * 3, position=[0.6, -0.8, 0])
    model.add_marker("point.pin", position=[-0.6, 0.8, 0])
    for name in ("pin", "again")[: 1 + twice]:
        model.add_joint(name, "revolute", between=["ground", "point.pin"], axis="z")
    found, _ = Bench(model).accelerations()
    swing = -9.81 * 0.6 / (1 + inertia)
    wanted = [-0.8 * -swing, 0.6 * swing, 0, 0, 0, swing]
    np.testing.assert_allclose(found, wanted, atol=1e-5 if twice else 1e-9)


def test_a_light_rotor_between_heavy_ones_gives_no_way():
    model = Model("rotors")
    for k, inertia in enumerate((10.0, 1e-8, 10.0)):
        model.add_body(f"b{k}", mass=1, inertia=[inertia] * 3)
        model.add_joint(f"j{k}", "revolute", between=["ground", f"b{k}"], axis="z")
    for k in range(2):
        model.add_coupler(f"g{k}", "gear", joints=[f"j{k}", f"j{k + 1}"], ratio=1)
    model.add_force("push", "torque", at="b0", value=[0, 0, 5])
    found, _ = Bench(model).accelerations()
    np.testing.assert_allclose(found[5::6], 0.25, rtol=1e-8)


def test_a_flywheel_far_off_does_not_change_how_rows_near_a_singular_pose_yield():
    def flat(flywheel):
        model = Model("parallelogram", plane="xy")
        tilt = {"axis": "z", "angle": 2e-5}
        for name, x in (("left", 0.0), ("right", 0.8)):
            model.add_body(name, mass=1, inertia=[0.1] * 3, position=[x, 0, 0], orientation=tilt)
            model.add_marker(f"{name}.end", position=[0.3, 0, 0])
            model.add_marker(f"ground.{name}", position=[x, 0, 0])
            model.add_joint(name, "revolute", between=[f"ground.{name}", name], axis="z")
        model.add_body("rod", mass=1, inertia=[0.02] * 3, position=[0.3, 6e-6, 0])
        model.add_marker("rod.end", position=[0.8, 0, 0])
        model.add_joint("near", "revolute", between=["left.end", "rod"], axis="z")
        model.add_joint("far", "revolute", between=["rod.end", "right.end"], axis="z")
        if flywheel:
            model.add_body("flywheel", mass=1e4, inertia=[1e9] * 3)
            model.add_joint("shaft", "revolute", between=["ground", "flywheel"], axis="z")
        bench = Bench(model)
        bench.matrix(symmetric=True)
        return bench.work.factor.eps[bench.sys.kkt.place[bench.layout.nv :]][:8]

    np.testing.assert_array_equal(flat(True), flat(False))


def test_pivots_of_the_other_sign_stay():
    """Reactions may make a body unstable that joints hold: the equations are solved as they are."""
    bench = Bench(Mechanism(25, "chain", "rigid", n=2, acting=False).model)
    bench.randomise(26)
    bench.sys.parts.bodies["mass"][1] = -1.0
    S = bench.matrix(symmetric=True)
    assert bench.replaced == 0
    assert np.sum(bench.work.factor.d[bench.sys.kkt.place[: bench.layout.nv]] < 0) >= 3
    b = np.random.default_rng(0).standard_normal(len(S))
    wanted = np.linalg.solve(S, b)
    np.testing.assert_allclose(bench.solve(b, 2), wanted, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("center", [[0.0, 0.0, -0.7], [0.0, 0.0, 0.0]])
def test_a_point_mass_on_a_hinge_is_a_pendulum(center):
    """Its mass matrix is singular, the pendulum is not; a point mass on the hinge's axis rests."""
    none = np.zeros((3, 0))
    point = replace(rigid_body(2.0, center), interfaces=[Interface("pin", np.zeros(3), none, none)])
    model = Model("pendulum", gravity=[9.81, 0, 0])
    model.add_body("bob", point)
    model.add_joint("hinge", "revolute", between=["ground", "bob.pin"], axis="y")
    bench = Bench(model)
    found, lam = bench.accelerations()
    assert bench.replaced > 0
    wanted = -9.81 / 0.7 if center[2] else 0.0
    np.testing.assert_allclose(found, [0, 0, 0, 0, wanted, 0], atol=1e-9)
    np.testing.assert_allclose(lam[:3], [0 if center[2] else 2 * 9.81, 0, 0], atol=1e-9)


def test_massless_coordinates_leave_no_nan_behind():
    bench = Bench(Mechanism(25, "chain", "rigid", n=2, acting=False).model)
    bench.randomise(26)
    for field in ("mass", "S1", "S0"):
        bench.sys.parts.bodies[field][1] = 0.0
    for symmetric in (True, False):
        bench.matrix(symmetric=symmetric)
        assert bench.replaced > 0
        assert np.isfinite(bench.work.factor.d).all()


def test_storage_is_linear_in_the_number_of_bodies():
    def stored(topology, n):
        return Bench(Mechanism(27, topology, "rigid", n=n).model).work.factor.low.size

    for topology in ("chain", "star"):
        # whole rounds of the joint types, so that equal pieces are added
        a, b, c = (stored(topology, n) for n in (10, 20, 30))
        assert c - b <= 1.2 * (b - a)
