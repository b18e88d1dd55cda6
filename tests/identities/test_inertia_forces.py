"""Inertia of bodies that are clouds of point masses, against the sum over their points.

The points' motion is differentiated numerically and pulled back by their own Jacobians, so nothing
of the second-moment integrals enters the other route.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from enginekit import Bench, curvature, rotation, slope
from generators import Mechanism
from generators import cloud as random_cloud

from flexmb.model import Model

LAST_DIGITS = 1e-12
DIFFERENCES = 1e-9
SECOND_DIFFERENCES = 3e-8


@pytest.fixture(params=["rigid", "flexible", "mixed"])
def free(request):
    """Bodies without joints or forces, but with gravity; and the mechanism they come from."""
    made = Mechanism(3, "chain", request.param, n=3, acting=False)
    made.model.joints.clear()
    made.model.set_gravity([1.0, -2.0, -9.0])
    bench = Bench(made.model)
    bench.randomise(4)
    return made, bench


def points(made, bench, q):
    """Global positions of all points of all bodies at q, body after body."""
    found = []
    for row, cloud in zip(bench.sys.parts.bodies, made.clouds.values(), strict=True):
        i, m = int(row["iq"]), int(row["m"])
        x = cloud.s + cloud.N @ q[i + 7 : i + 7 + m]
        found.append(q[i : i + 3] + x @ rotation(q[i + 3 : i + 7]).T)
    return np.concatenate(found)


def masses(made):
    return np.concatenate([cloud.mass for cloud in made.clouds.values()])


def forces_by_points(made, bench, q, v, vd):
    """Σ m_k J_kᵀ (a_k − g) + K η + D η̇."""
    total = np.zeros_like(v)
    where = lambda s: bench.moved(q, s * v + 0.5 * s * s * vd)  # noqa: E731
    a = curvature(lambda s: points(made, bench, where(s))) - bench.sys.parts.gravity
    for j in range(len(v)):
        d = np.zeros_like(v)
        d[j] = 1.0
        J = slope(lambda s, d=d: points(made, bench, bench.moved(q, s * d)))
        total[j] = masses(made) @ (J * a).sum(axis=1)
    for row, cloud in zip(bench.sys.parts.bodies, made.clouds.values(), strict=True):
        i, o, m = int(row["iq"]) + 7, int(row["iv"]) + 6, int(row["m"])
        total[o : o + m] += cloud.K @ q[i : i + m] + cloud.D @ v[o : o + m]
    return total


def test_inertia_elastic_and_weight_forces(free):
    made, bench = free
    q, v, vd = bench.q.copy(), bench.v.copy(), bench.vd.copy()
    wanted = forces_by_points(made, bench, q, v, vd)
    found = bench.at(q=q, v=v, vd=vd).residual
    np.testing.assert_allclose(found, wanted, atol=SECOND_DIFFERENCES * np.abs(wanted).max())


def test_kinetic_and_gravity_energy(free):
    made, bench = free
    q, v = bench.q.copy(), bench.v.copy()
    u = slope(lambda s: points(made, bench, bench.moved(q, s * v)))
    m, g = masses(made), bench.sys.parts.gravity
    kinetic, strain, gravity, spring = bench.at(q=q).energies
    assert kinetic == pytest.approx(0.5 * m @ (u * u).sum(axis=1), rel=DIFFERENCES)
    assert gravity == pytest.approx(-m @ points(made, bench, q) @ g, rel=LAST_DIGITS)
    wanted = 0.0
    for row, cloud in zip(bench.sys.parts.bodies, made.clouds.values(), strict=True):
        eta = q[row["iq"] + 7 : row["iq"] + 7 + row["m"]]
        wanted += 0.5 * eta @ cloud.K @ eta
    assert strain == pytest.approx(wanted, rel=LAST_DIGITS)
    assert spring == 0.0


def test_mass_matrix_gives_the_energy_and_the_inertia_forces(free):
    _, bench = free
    M = bench.mass_matrix()
    v, vd = bench.v.copy(), bench.vd.copy()
    np.testing.assert_allclose(M, M.T, atol=LAST_DIGITS)
    assert np.linalg.eigvalsh(M)[0] > 0.0
    assert bench.at().energies[0] == pytest.approx(0.5 * v @ M @ v, rel=LAST_DIGITS)
    with_vd = bench.residual
    difference = with_vd - bench.at(vd=0.0).residual
    np.testing.assert_allclose(difference, M @ vd, atol=LAST_DIGITS * np.abs(with_vd).max())
    product = bench.mass_product(vd)
    np.testing.assert_allclose(product, M @ vd, atol=LAST_DIGITS * np.abs(with_vd).max())


def test_damping_of_single_modes_is_that_of_their_matrix():
    """A diagonal D is a product of numbers: D rate in the modal rows, and its power."""
    points, made = random_cloud(np.random.default_rng(7), 4), Model("body")
    D = np.array([0.3, 0.0, 1.2, 0.7])
    made.add_body("b", replace(points, D=np.diag(D)).flexbody("b"))
    bench = Bench(made)
    bench.randomise(8)
    v, rate = bench.v.copy(), bench.v[6:].copy()
    assert bench.sys.parts.bodies["damped"][0] == 2
    damped = bench.at(v=v).residual
    power = bench.powers[1]
    bench.sys.parts.bodies["damped"][:] = 0
    force = damped - bench.at(v=v).residual
    np.testing.assert_allclose(force, [0.0] * 6 + list(D * rate), atol=1e-12 * np.abs(damped).max())
    assert power == pytest.approx(-D @ rate**2, rel=LAST_DIGITS)


def test_stress_of_a_spin_stiffens():
    """A field that pulls along x by Omega^2 adds Omega^2 K^xx to the stiffness of modes."""
    points, made = random_cloud(np.random.default_rng(9), 3), Model("body")
    C = np.zeros((3, 3, 3, 3))
    C[0, 0] = np.diag([2.0, 3.0, 5.0])
    plain = points.flexbody("b")
    made.add_body("b", plain)
    stiff = Model("body")
    stiff.add_body("b", replace(plain, centrifugal_stiffness=C))
    residuals = []
    for model in (made, stiff):
        bench = Bench(model)
        bench.q[7:] = 0.1, -0.2, 0.3
        v = np.array([0, 0, 0, 0, 0, 4.0, 0, 0, 0])
        residuals.append(bench.at(q=bench.q, v=v, vd=0.0).residual)
    wanted = 16.0 * np.array([2.0, 3.0, 5.0]) * [0.1, -0.2, 0.3]
    np.testing.assert_allclose((residuals[1] - residuals[0])[6:], wanted, rtol=1e-9)


@pytest.mark.parametrize("plane", ["xy", "yz", "zx"])
def test_planar_equations_are_those_of_space(plane):
    """Inertia and weight of a body with its centre aside, and their tangents, for any motion."""
    normal = ({"x", "y", "z"} - set(plane)).pop()
    n, across = "xyz".index(normal), ["xyz".index(a) for a in plane]
    center, gravity, found, tangents = np.zeros(3), np.zeros(3), [], []
    own = np.ix_([*across, 3 + n], [*across, 3 + n])
    center[across], gravity[across] = (0.3, -0.2), (2.0, -9.0)
    for word in (plane, None):
        made = Model("body", plane=word, gravity=list(gravity))
        made.add_body("b", mass=2.0, inertia=[0.7, 0.9, 1.1], center=list(center))
        bench, q = Bench(made), np.zeros(7)
        q[3], q[4 + n], q[across] = np.cos(0.4), np.sin(0.4), (0.5, 0.1)
        v, vd = np.zeros(6), np.zeros(6)
        v[across], v[3 + n] = (0.2, -0.7), 3.0
        vd[across], vd[3 + n] = (1.0, 2.0), -5.0
        found.append(bench.at(q=q, v=v, vd=vd).residual)
        tangents.append([bench.matrix(cv=cv, cp=cp)[own] for cv, cp in ((0, 0), (0.3, 0.2))])
    np.testing.assert_allclose(*found, atol=1e-13 * np.abs(found[1]).max())
    np.testing.assert_allclose(*tangents, atol=1e-13 * np.abs(tangents[1]).max())


def test_lagrange_equations_in_quasi_velocities(free):
    """d/dt ∂T/∂v − ∂T/∂q + Boltzmann–Hamel terms of (A ṙ', ω') = M v̇ + velocity forces.

    The frame moves with a global velocity and a body angular velocity p = ∂T/∂v; the momentum of
    the angular velocity obeys ṗ_ω + ω × p_ω − ∂T/∂θ = moment.
    """
    _, bench = free
    bench.sys.parts.gravity[:] = 0.0
    q, v, vd = bench.q.copy(), bench.v.copy(), bench.vd.copy()
    found = bench.at().residual
    quiet = bench.at(v=0.0, vd=0.0).residual  # elastic forces
    damping = np.zeros_like(v)
    for row in bench.sys.parts.bodies:
        m, o = int(row["m"]), int(row["iv"]) + 6
        at = int(row["flex"]) + 12 * m + 2 * m * m
        D = bench.sys.parts.pool[at : at + m * m].reshape(m, m)
        damping[o : o + m] = D @ v[o : o + m]

    def momentum(s):
        bench.q[:] = bench.moved(q, s * v + 0.5 * s * s * vd)
        return bench.mass_matrix() @ (v + s * vd)

    wanted = slope(momentum)
    for j in range(len(v)):
        d = np.zeros_like(v)
        d[j] = 1.0
        wanted[j] -= slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d), v=v).energies[0])
    bench.q[:] = q
    p = bench.mass_matrix() @ v
    for row in bench.sys.parts.bodies:
        o = int(row["iv"])
        wanted[o + 3 : o + 6] += np.cross(v[o + 3 : o + 6], p[o + 3 : o + 6])
    # ω turns with the body while r_dot is told in global axes, so no further terms arise.
    np.testing.assert_allclose(
        found - quiet - damping, wanted, atol=20 * DIFFERENCES * np.abs(wanted).max()
    )


def test_velocity_tangent_is_exact(free):
    _, bench = free
    q, v, vd = bench.q.copy(), bench.v.copy(), bench.vd.copy()
    tangent = bench.matrix(cv=1.0) - bench.mass_matrix()
    for j in range(len(v)):
        d = np.zeros_like(v)
        d[j] = 1.0
        column = slope(lambda s, d=d: bench.at(v=v + s * d).residual)
        np.testing.assert_allclose(
            tangent[: len(v), j], column, atol=DIFFERENCES * np.abs(tangent).max()
        )
    np.testing.assert_array_equal(bench.q, q)
    np.testing.assert_array_equal(bench.vd, vd)


def test_position_tangent_is_exact(free):
    _, bench = free
    q, n = bench.q.copy(), bench.layout.nv
    tangent = bench.matrix(cp=1.0) - bench.mass_matrix()
    for j in range(n):
        d = np.zeros(n)
        d[j] = 1.0
        column = slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual)
        np.testing.assert_allclose(tangent[:, j], column, atol=DIFFERENCES * np.abs(tangent).max())
