"""Power balance: the energies change by what drivers, dampers and loads do, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import BODIES, TOPOLOGIES, Mechanism

# Accelerations are solved to 1e-12 of forces that nearly cancel in a few stiff directions.
BALANCE = 1e-8


def moving(topology, bodies, seed=5):
    """A mechanism with velocities and accelerations that satisfy its constraints."""
    bench = Bench(Mechanism(seed, topology, bodies).model)
    bench.randomise(seed + 1)
    bench.project()
    np.testing.assert_allclose(bench.at().rate, 0.0, atol=1e-11)
    bench.accelerations()
    np.testing.assert_allclose(bench.at().residual, 0.0, atol=1e-9 * np.abs(bench.lam).max())
    return bench


def energy_at(bench):
    """Total energy along the motion as a function of time, and the unit of that time [s]."""
    t, q, v, vd = bench.state.t[0], bench.q.copy(), bench.v.copy(), bench.vd.copy()

    # A time in which fast modes move as little as slow bodies do in the rule's own step.
    unit = 1.0 / np.sqrt(1.0 + 0.1 * np.abs(vd).max())

    def energy(s):
        s = unit * s
        moved = bench.moved(q, s * v + 0.5 * s * s * vd)
        return bench.at(t=t + s, q=moved, v=v + s * vd).energies.sum()

    return energy, unit


@pytest.mark.parametrize("bodies", (*BODIES, "stiffened", "stretching"))
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_energy_changes_by_the_powers(topology, bodies):
    bench = moving(topology, bodies)
    powers = bench.powers
    assert powers[1] < 0.0
    energy, unit = energy_at(bench)
    found = slope(energy) / unit
    assert found == pytest.approx(powers.sum(), abs=BALANCE * np.abs(powers).max())


def test_modal_damping_is_counted():
    made = Mechanism(5, "chain", "flexible", acting=False)
    bench = Bench(made.model)
    bench.randomise(6)
    wanted = 0.0
    for row, cloud in zip(bench.sys.parts.bodies, made.clouds.values(), strict=True):
        rate = bench.v[row["iv"] + 6 : row["iv"] + 6 + row["m"]]
        wanted -= rate @ cloud.D @ rate
    np.testing.assert_allclose(bench.at().powers, [0.0, wanted, 0.0], rtol=1e-12)
