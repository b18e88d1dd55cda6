"""Single solves of the engine against what the benches of tests find."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench
from generators import Mechanism

from flexmb.engine.compiled_calls import solve_stage
from flexmb.engine.initial_conditions import ACCELERATIONS, BEGIN, POSITIONS, RESIDUAL, VELOCITIES
from flexmb.engine.method import SUCCESS, ZERO_LENGTH

SOLVED = 1e-8


def solve(bench, level):
    return solve_stage(bench.sys, bench.state, bench.work, level)


@pytest.fixture(scope="module")
def found():
    found = {}
    for topology in ("tree", "loop"):
        bench = Bench(Mechanism(31, topology, "mixed", n=3).model)
        bench.randomise(32)
        solve(bench, VELOCITIES)
        found[f"v {topology}"] = bench.v.copy()
        assert solve(bench, ACCELERATIONS) == SUCCESS
        found[f"vd {topology}"], found[f"lam {topology}"] = bench.vd.copy(), bench.lam.copy()
        assert solve(bench, RESIDUAL) == SUCCESS
        found[f"residual {topology}"] = bench.residual
        solve(bench, BEGIN)
        found[f"power {topology}"] = bench.state.power.copy()

        # assembly: from the placed pose, bodies pushed a little
        bench.q[:] = bench.compiled.initial_q
        bench.state.t[0] = 0.0
        rng = np.random.default_rng(33)
        bench.q[:] = bench.moved(bench.q, 0.03 * rng.standard_normal(bench.layout.nv))
        found[f"sizes {topology}"] = [solve(bench, POSITIONS) for _ in range(8)]
        solve(bench, RESIDUAL)
        found[f"C {topology}"] = bench.C
        p = np.array([bench.q[i + 3 : i + 7] for i in bench.sys.parts.bodies["iq"]])
        found[f"lengths {topology}"] = (p * p).sum(axis=1)

    springs = bench.sys.kinds["springs"].rows
    springs["J"][1] = springs["I"][1]
    found["no length"] = []
    for level in (ACCELERATIONS, RESIDUAL):
        bench.work.failed_element[0] = -1
        found["no length"].append((solve(bench, level), bench.work.failed_element[0]))
    return found


@pytest.fixture(params=["tree", "loop"])
def topology(request):
    return request.param


def test_velocities_and_accelerations(found, topology):
    bench = Bench(Mechanism(31, topology, "mixed", n=3).model)
    bench.randomise(32)
    bench.project()
    np.testing.assert_allclose(found[f"v {topology}"], bench.v, atol=SOLVED)
    bench.accelerations()
    for name, wanted in (("vd", bench.vd), ("lam", bench.lam)):
        scale = np.abs(wanted).max()
        np.testing.assert_allclose(found[f"{name} {topology}"], wanted, atol=SOLVED * scale)
    largest = np.abs(bench.lam).max()
    np.testing.assert_allclose(found[f"residual {topology}"], 0.0, atol=SOLVED * largest)
    np.testing.assert_allclose(found[f"power {topology}"], bench.at().powers, atol=SOLVED * largest)


def test_positions_converge_onto_the_constraints(found, topology):
    np.testing.assert_allclose(found[f"C {topology}"], 0.0, atol=1e-13)
    np.testing.assert_allclose(found[f"lengths {topology}"], 1.0, rtol=1e-14)
    sizes = found[f"sizes {topology}"]
    assert sizes[-1] < 1e-13
    quadratic = [b <= 20.0 * a * a + 1e-13 for a, b in zip(sizes, sizes[1:], strict=False)]
    assert all(quadratic[1:])


def test_a_spring_of_no_length_is_told(found):
    """The status, and the row of the spring."""
    assert found["no length"] == [(ZERO_LENGTH, 1), (ZERO_LENGTH, 1)]
