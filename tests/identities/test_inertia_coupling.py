"""Inertia of constant and partial coupling, against sums over point masses.

The equations of the two models are written here for a cloud of points, x = s + N η in body axes,
as the module of the engine states them; and partial coupling falls to full coupling with the square
of the deformation.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, rotation
from generators import Mechanism

LAST_DIGITS = 1e-12


def bench_of(coupling, scale=1.0, spin=1.0):
    """Free bodies at a random state, with their points; deformation and its rates are scaled."""
    made = Mechanism(3, "chain", coupling, n=3, acting=False)
    made.model.joints.clear()
    made.model.set_gravity([1.0, -2.0, -9.0])
    bench = Bench(made.model)
    bench.randomise(4)
    for row in bench.sys.parts.bodies:
        i, o, m = int(row["iq"]) + 7, int(row["iv"]) + 6, int(row["m"])
        bench.q[i : i + m] *= scale
        bench.v[o : o + m] *= scale
        bench.vd[o : o + m] *= scale
        bench.vd[o - 3 : o] *= spin
    return made, bench


def forces_of(cloud, bench, row, partial):
    """Force, moment and modal forces of one cloud."""
    i, o, m = int(row["iq"]), int(row["iv"]), int(row["m"])
    q, v, vd, mass = bench.q, bench.v, bench.vd, cloud.mass
    A, om, e = rotation(q[i + 3 : i + 7]), v[o + 3 : o + 6], vd[o + 3 : o + 6]
    eta, rate, second = q[i + 7 : i + 7 + m], v[o + 6 : o + 6 + m], vd[o + 6 : o + 6 + m]
    a = A.T @ (vd[o : o + 3] - bench.sys.parts.gravity)
    s, N = cloud.s, cloud.N
    u, u1, u2 = N @ eta, N @ rate, N @ second
    modal = cloud.K @ eta + cloud.D @ rate
    if not partial:
        at = a + np.cross(e, s) + u2  # what the points feel without velocity terms
        turning = np.cross(om, np.cross(om, s))
        force = mass @ (at + turning)
        moment = mass @ np.cross(s, at + turning)
        return A @ force, moment, modal + np.einsum("k,ka,kam->m", mass, at, N)
    x = s + u
    spun = np.cross(om, np.cross(om, x)) + 2 * np.cross(om, u1)
    force = mass @ (a + np.cross(e, x) + u2 + spun)
    # of first order in the deformation; M_ωη is that of the undeformed body
    first = mass @ (np.cross(s, np.cross(om, np.cross(om, x)) + 2 * np.cross(om, u1)))
    first = first + mass @ np.cross(u, np.cross(om, np.cross(om, s)))
    moment = mass @ np.cross(x, np.broadcast_to(a, x.shape)) + mass @ np.cross(s, u2) + first
    moment = moment + mass @ (np.cross(s, np.cross(e, x)) + np.cross(u, np.cross(e, s)))
    at = a + np.cross(e, s) + u2 + spun
    return A @ force, moment, modal + np.einsum("k,ka,kam->m", mass, at, N)


@pytest.mark.parametrize(
    ("coupling", "turning"),
    [("constant", "xyz"), *(("partial", axes) for axes in ("xyz", "x", "y", "z", "xz", ""))],
)
def test_forces_are_those_of_points(coupling, turning):
    """Turning about all body axes, or about some."""
    made, bench = bench_of(coupling)
    for row in bench.sys.parts.bodies:
        for k, axis in enumerate("xyz"):
            bench.v[int(row["iv"]) + 3 + k] *= axis in turning
    residual = bench.at().residual
    wanted = np.zeros_like(residual)
    for row, cloud in zip(bench.sys.parts.bodies, made.clouds.values(), strict=True):
        o = int(row["iv"])
        parts = forces_of(cloud, bench, row, coupling == "partial")
        wanted[o : o + 6 + int(row["m"])] = np.concatenate(parts)
    np.testing.assert_allclose(residual, wanted, atol=LAST_DIGITS * np.abs(wanted).max())


@pytest.mark.parametrize("off_axis", [1.0, 1e-7])
def test_later_iterations_of_a_step_follow_the_deformation(off_axis):
    """Of small rates about two axes only the product with the change of a step is left out."""
    _, bench = bench_of("partial")
    rng, allowed = np.random.default_rng(5), LAST_DIGITS if off_axis == 1.0 else 1e-9
    bench.work.now.iteration[0] = 0.0
    for row in bench.sys.parts.bodies:
        bench.v[int(row["iv"]) + 3 : int(row["iv"]) + 5] *= off_axis
    first = bench.at().residual
    for row in bench.sys.parts.bodies:
        i, o, m = int(row["iq"]) + 7, int(row["iv"]) + 6, int(row["m"])
        bench.q[i : i + m] += 1e-3 * rng.standard_normal(m)
        bench.v[o : o + m] += 1e-3 * rng.standard_normal(m)
    bench.work.now.iteration[0] = 1.0
    later = bench.at().residual
    bench.work.now.iteration[0] = 0.0
    wanted = bench.at().residual
    size = np.abs(wanted).max()
    assert np.abs(wanted - first).max() > 1e-6 * size
    np.testing.assert_allclose(later, wanted, atol=allowed * size)


def test_partial_coupling_differs_from_full_in_the_second_order():
    """Modal rows not at all, without angular acceleration; the moments with slope 2."""
    errors = []
    for scale in (1e-2, 1e-3):
        full = bench_of("flexible", scale, 0.0)[1].at().residual
        _, bench = bench_of("partial", scale, 0.0)
        difference = np.abs(full - bench.at().residual)
        for row in bench.sys.parts.bodies:
            o = int(row["iv"])
            assert difference[o + 6 : o + 6 + int(row["m"])].max() < 1e-12
        errors.append(difference.max())
    assert errors[0] / errors[1] == pytest.approx(100.0, rel=1e-3)


@pytest.mark.parametrize("coupling", ["constant", "partial"])
def test_kinetic_energy_is_that_of_the_mass_matrix(coupling):
    _, bench = bench_of(coupling)
    M, v = bench.mass_matrix(), bench.v
    np.testing.assert_allclose(M, M.T, atol=LAST_DIGITS)
    assert bench.at().energies[0] == pytest.approx(0.5 * v @ M @ v, rel=LAST_DIGITS)
    np.testing.assert_allclose(bench.mass_product(v), M @ v, atol=LAST_DIGITS * np.abs(v).max())
