"""The iteration matrix of whole mechanisms against differences of the residual.

At random states far from equilibrium and off the constraints, at fixed v̇ and λ: S = M + cv ∂F/∂v +
cp ∂F/∂q bordered by C_q, with joints, drivers, springs, dampers, follower and global loads on rigid
and flexible bodies, with geometric stiffening too.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import BODIES, TOPOLOGIES, Mechanism

from flexmb.engine.joints import ANGLE, DISTANCE, DOT1, DOT2, MOMENT, POINT, RADIAL, TWIST

DIFFERENCES = 1e-9
LAST_DIGITS = 1e-12
EVERY = (*BODIES, "stiffened", "constant", "partial", "stretching")
CASES = [(topology, bodies) for topology in TOPOLOGIES for bodies in EVERY]


@pytest.fixture(params=CASES, ids=["-".join(case) for case in CASES])
def bench(request):
    return make(*request.param)


def make(topology, bodies):
    made = Bench(Mechanism(len(topology) + 31, topology, bodies, n=3).model)
    rows = made.sys.rows  # joints here hold no distances and lines: turn some rows into them
    kinds = itertools.cycle((DISTANCE, TWIST, RADIAL, MOMENT))
    for group in made.sys.groups:
        if group["couple"] >= 0 or -1 in (group["body_I"], group["body_J"]):
            for row in rows[int(group["row"]) : int(group["row"] + group["n"])]:
                row["kind"] = next(kinds) if row["kind"] == POINT else row["kind"]
    made.use_rows()
    made.randomise(2)
    return made


def directions(n):
    return np.eye(n)


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, atol=DIFFERENCES * max(1.0, np.abs(wanted).max()))


def test_position_tangent(bench):
    n, q = bench.layout.nv, bench.q.copy()
    tangent = (bench.matrix(cp=1.0) - bench.matrix())[:n, :n]
    columns = [
        slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual) for d in directions(n)
    ]
    close(tangent, np.array(columns).T)


@pytest.mark.seconds
def test_rows_of_all_kinds_occur():
    """Over all mechanisms of these tests."""
    kinds = set()
    for topology, bodies in CASES:
        kinds |= set(make(topology, bodies).sys.rows["kind"])
    assert kinds >= {DOT1, DOT2, DISTANCE, ANGLE, TWIST, RADIAL, MOMENT}


def test_velocity_tangent(bench):
    n, v = bench.layout.nv, bench.v.copy()
    tangent = (bench.matrix(cv=1.0) - bench.matrix())[:n, :n]
    columns = [slope(lambda s, d=d: bench.at(v=v + s * d).residual) for d in directions(n)]
    close(tangent, np.array(columns).T)


def test_both_add_up_with_their_factors(bench):
    S, position, velocity = bench.matrix(), bench.matrix(cp=1.0), bench.matrix(cv=1.0)
    both = bench.matrix(cv=0.3, cp=0.02)
    np.testing.assert_allclose(
        both,
        S + 0.02 * (position - S) + 0.3 * (velocity - S),
        atol=LAST_DIGITS * np.abs(position).max(),
    )


def test_border_is_the_jacobian_and_its_transpose(bench):
    n = bench.layout.nv
    S = bench.matrix(cv=0.3, cp=0.02)
    Cq = bench.at().Cq
    np.testing.assert_array_equal(S[n:, :n], Cq)
    np.testing.assert_array_equal(S[:n, n:], Cq.T)
    # the regularisation is taken out again up to the last digits of itself
    assert np.abs(S[n:, n:]).max() <= 1e-9 * LAST_DIGITS * np.abs(Cq).max() ** 2


def test_symmetric_matrix_is_the_symmetric_part(bench):
    S = bench.matrix(cv=0.3, cp=0.02)
    symmetric = bench.matrix(cv=0.3, cp=0.02, symmetric=True)
    np.testing.assert_allclose(symmetric, 0.5 * (S + S.T), atol=LAST_DIGITS * np.abs(S).max())
