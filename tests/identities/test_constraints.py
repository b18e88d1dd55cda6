"""Constraint rows on random mechanisms at random states, far from where they are satisfied.

The Jacobian against differences of C along motions q ∘ exp(s d), rates against differences of C in
time, γ against differences of the rates, J^T w against the rows of J.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import MARKER, Bench, slope
from generators import BODIES, TOPOLOGIES, Mechanism

from flexmb.engine.joints import ANGLE, DISTANCE, DOT1, DOT2, MOMENT, POINT, RADIAL, TWIST

# The difference rules leave 1e-12 of the size of the numbers here, which are below 100.
DIFFERENCES = 2e-9
LAST_DIGITS = 1e-12


def benches():
    for k, topology in enumerate(TOPOLOGIES):
        for bodies in BODIES:
            yield pytest.param((10 + k, topology, bodies), id=f"{topology}-{bodies}")


@pytest.fixture(params=benches())
def bench(request):
    seed, topology, bodies = request.param
    made = Bench(Mechanism(seed, topology, bodies).model)
    rows = made.sys.rows  # joints here hold no distances and lines: turn some rows into them
    points = np.flatnonzero(rows["kind"] == POINT)
    rows["kind"][points] = np.resize([POINT, DISTANCE, POINT, TWIST, RADIAL, MOMENT], len(points))
    rows["offset"] = np.random.default_rng(seed).uniform(-1, 1, len(rows))
    driven = np.flatnonzero(rows["fun"] >= 0)
    rows["kind"][driven[1:2]] = DISTANCE
    made.use_rows()
    made.randomise(seed + 100)
    return made


def close(found, wanted, tolerance=DIFFERENCES):
    scale = max(1.0, np.abs(wanted).max(initial=0.0))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * scale)


def test_every_kind_of_row_occurs():
    kinds = set()
    for k, topology in enumerate(TOPOLOGIES):
        kinds |= set(Bench(Mechanism(10 + k, topology).model).sys.rows["kind"])
    assert kinds == {POINT, DOT1, DOT2, ANGLE}


def test_jacobian_is_the_derivative_along_virtual_motions(bench):
    q, Cq = bench.q.copy(), bench.at().Cq
    for j in range(bench.layout.nv):
        d = np.zeros(bench.layout.nv)
        d[j] = 1.0
        column = slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).C)
        close(Cq[:, j], column)


def test_rates_are_the_time_derivative(bench):
    q, v, t = bench.q.copy(), bench.v.copy(), bench.state.t[0]
    rate = bench.at().rate
    time = slope(lambda s: bench.at(t=t + s, q=bench.moved(q, s * v)).C)
    close(rate, time)
    ahead = slope(lambda s: bench.at(t=t + s, q=q).C)
    close(rate, bench.at(t=t).Cq @ v + ahead)


def test_gamma_is_what_the_rates_lose_at_zero_acceleration(bench):
    q, v, t = bench.q.copy(), bench.v.copy(), bench.state.t[0]
    gamma = bench.at().gamma
    change = slope(lambda s: bench.at(t=t + s, q=bench.moved(q, s * v)).rate)
    close(-gamma, change)


def test_second_derivative_of_every_row_with_acceleration(bench):
    q, v, vd, t = bench.q.copy(), bench.v.copy(), bench.vd.copy(), bench.state.t[0]
    wanted = bench.at().Cq @ vd - bench.gamma
    move = lambda s: bench.moved(q, s * v + 0.5 * s * s * vd)  # noqa: E731
    close(wanted, slope(lambda s: bench.at(t=t + s, q=move(s), v=v + s * vd).rate), 1e-8)


def test_wrenches_pull_back_by_the_transposed_jacobian(bench):
    bench.at()
    rng = np.random.default_rng(0)
    for k, mk in enumerate(bench.sys.parts.markers):
        if mk["body"] < 0:
            continue
        w = rng.standard_normal(6)
        n = 6 + int(bench.sys.parts.bodies["m"][mk["body"]])
        bench.out[:6], bench.out[6 : 6 + n] = w, 0.0
        bench.run(MARKER, k=k)
        J = bench.work.dense.J[0, :, :n]
        close(bench.out[6 : 6 + n], J.T @ w, LAST_DIGITS)


def test_reactions_are_the_transposed_jacobian_times_the_multipliers(bench):
    with_lam = bench.at().residual
    lam = bench.lam.copy()
    close(with_lam - bench.at(lam=0.0).residual, bench.Cq.T @ lam, LAST_DIGITS)


def test_action_and_reaction_cancel_on_the_two_markers(bench):
    """Forces cancel; with the moment of the lever so do moments: seen as one rigid whole moving."""
    Cq, rows = bench.at().Cq, bench.sys.rows
    for axis in range(3):
        move, turn = np.zeros((2, bench.layout.nv))
        e = np.eye(3)[axis]
        for b in range(len(bench.sys.parts.bodies)):
            o = bench.columns(b).start
            i = int(bench.sys.parts.bodies["iq"][b])
            A = bench.work.now.body["A"][b]
            move[o + axis] = 1.0
            turn[o : o + 3] = np.cross(e, bench.q[i : i + 3])
            turn[o + 3 : o + 6] = A.T @ e
        inner = (rows["jac_I"] >= 0) & (rows["jac_J"] >= 0)
        close(Cq[inner] @ move, 0.0, LAST_DIGITS)
        free = inner & (rows["kind"] != POINT)  # coincidence is told along fixed axes
        close(Cq[free] @ turn, 0.0, LAST_DIGITS)
