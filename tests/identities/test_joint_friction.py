"""Friction in joints: slopes over its coordinate, normal force from the reaction, power."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import Mechanism

from flexmb.engine.forces.friction import BRISTLE, SMOOTH, line_friction
from flexmb.model.joints.joint import JOINT_TYPES

RUBBING = ("revolute", "prismatic", "cylindrical")
FRICTIONS = {"sticks": (BRISTLE, 50.0), "slides": (BRISTLE, 0.3), "smooth": (SMOOTH, 0.3)}


def rubbing(bodies="mixed", seed=3):
    """A random tree with friction on every coordinate of every joint that may have it."""
    made = Mechanism(seed, "tree", bodies, n=4, acting=False)
    for name, joint in made.model.joints.items():
        if joint.type in RUBBING:
            for coordinate in JOINT_TYPES[joint.type].coordinates:
                made.model.add_force(
                    f"{coordinate}_{name}", "joint-friction", joint=name, coordinate=coordinate,
                    radius=0.3 if coordinate == "angle" else None, length=0.5,
                    width=0.4 if joint.type == "prismatic" else None, preload=2.0,
                    dynamic=0.3, static=0.4, stribeck_speed=0.8, viscous=0.2,
                    stiffness=50.0, damping=3.0,
                )  # fmt: skip
    return made


def bench_of(friction="slides", bodies="mixed"):
    bench = Bench(rubbing(bodies).model)
    rng = bench.randomise(4)
    for row in bench.sys.kinds["joint_frictions"].rows:
        row["model"], row["static"] = FRICTIONS[friction]
        row["dynamic"], row["creep"] = 0.7 * row["static"], 0.5
    n = len(bench.sys.parts.coordinates)
    bench.q[-n:] = rng.standard_normal(n)
    history = bench.work.now.history
    history[1::2] = 0.1 * rng.standard_normal(n)
    return bench


@pytest.mark.parametrize("friction", FRICTIONS)
def test_slopes(friction):
    bench = bench_of(friction)
    n, count = bench.layout.nv, len(bench.sys.parts.coordinates)
    bench.at()
    tangent = bench.matrix(cv=1.0, cp=1.0)[:n, :n] - bench.matrix()[:n, :n]
    q, v = bench.q.copy(), bench.v.copy()
    for k in range(count):
        d, e = np.zeros_like(q), np.zeros_like(v)
        d[-count + k] = e[-count + k] = 1.0

        def moved(s, d=d, e=e):
            return bench.at(q=q + s * d, v=v + s * e).residual[-count:]

        found = tangent[-count:, n - count + k]
        np.testing.assert_allclose(found, slope(moved, 1e-3), atol=1e-8 * np.abs(found).max())
        assert np.abs(found).max() > 0.0


def test_normal_force_is_that_of_two_bearings():
    """R₁ + R₂ carry the lateral force, (L/2) z × (R₁ − R₂) the moment, computed here by vectors."""
    bench = bench_of()
    bench.at()
    for k, row in enumerate(bench.sys.kinds["joint_frictions"].rows):
        group = bench.sys.groups[row["group"]]
        first = bench.sys.rows[group["row"]]
        F, M = reaction(bench, group)
        z = bench.marker("R")[first["I"]][:, row["axis"]]
        lateral, bending = F - (F @ z) * z, M - (M @ z) * z
        apart = 2.0 / row["length"] * np.cross(bending, z)
        ends = [0.5 * (lateral + sign * apart) for sign in (1, -1)]
        np.testing.assert_allclose(
            0.5 * row["length"] * np.cross(z, ends[0] - ends[1]), bending, atol=1e-12
        )
        wanted = sum(np.linalg.norm(R) for R in ends) + row["preload"]
        if row["width"] > 0.0:
            wanted += abs(M @ z) / row["width"]
        assert bench.work.kinds["joint_frictions"].load[k, 0] == pytest.approx(wanted, rel=1e-12)


def reaction(bench, group):
    """Force and moment that a joint puts on marker J, from virtual work of its rows."""
    first = bench.sys.rows[group["row"]]
    before = bench.marker("W")[first["J"]]
    lam = bench.lam.copy()
    bench.lam[group["row"] : group["row"] + group["n"]] = 0.0
    without = bench.at().marker("W")[first["J"]]
    bench.at(lam=lam)
    return (before - without)[:3], (before - without)[3:]


@pytest.mark.parametrize("friction", FRICTIONS)
def test_power_of_friction_is_torque_times_rate(friction):
    bench = bench_of(friction)
    bench.at()
    wanted = 0.0
    for k, row in enumerate(bench.sys.kinds["joint_frictions"].rows):
        rate = bench.v[bench.sys.parts.coordinates[row["coordinate"]]["iv"]]
        wanted += bench.work.kinds["joint_frictions"].load[k, 1] * row["radius"] * rate
    damping = modal_damping(bench)
    assert bench.powers[1] == pytest.approx(wanted + damping, rel=1e-12)


def modal_damping(bench):
    """Power of the flexible bodies' own damping, which friction stands beside."""
    frictions = bench.sys.kinds["joint_frictions"].rows.copy()
    for row in bench.sys.kinds["joint_frictions"].rows:
        row["model"], row["static"], row["dynamic"] = SMOOTH, 0.0, 0.0
        row["viscous"] = 0.0
    found = bench.at().powers[1]
    bench.sys.kinds["joint_frictions"].rows[:] = frictions
    bench.at()
    return found


@pytest.mark.parametrize("friction", FRICTIONS)
def test_coupling_with_the_reactions(friction):
    """Row of each coordinate over the multipliers: −f of what follows it, and friction's slope."""
    bench = bench_of(friction)
    n, count, lam = bench.layout.nv, len(bench.sys.parts.coordinates), bench.lam.copy()
    bench.at()
    S = bench.matrix(cv=1.0, cp=1.0)
    for k in range(bench.layout.nc):
        d = np.zeros_like(lam)
        d[k] = 1.0
        found = S[n - count : n, n + k]
        wanted = slope(lambda s, d=d: bench.at(lam=lam + s * d).residual[-count:], 1e-3)
        np.testing.assert_allclose(found, wanted, atol=1e-8)
    # the other way round there is none
    np.testing.assert_array_equal(S[n:, n - count : n], bench.matrix()[n:, n - count : n])


@pytest.mark.parametrize("friction", FRICTIONS)
def test_friction_acts_on_its_coordinate_with_its_lever(friction):
    """Radius times the force on the surface, against the motion."""
    bench = bench_of(friction)
    bench.at()
    rows, acting = bench.sys.kinds["joint_frictions"].rows, bench.residual
    wanted = np.zeros_like(acting)
    for k, row in enumerate(rows):
        iv = bench.sys.parts.coordinates[row["coordinate"]]["iv"]
        wanted[iv] -= row["radius"] * bench.work.kinds["joint_frictions"].load[k, 1]
    rows["static"], rows["dynamic"], rows["viscous"], rows["model"] = 0.0, 0.0, 0.0, SMOOTH
    np.testing.assert_allclose(acting - bench.at().residual, wanted, atol=1e-11)
    assert np.abs(wanted).max() > 1e-3


LAW = {"static": 0.4, "dynamic": 0.3, "stribeck": 0.5, "viscous": 0.1, "creep": 0.2, "k": 100.0}


def test_smooth_friction_is_that_of_its_law():
    """mu(v) N v/sqrt(v^2 + v_c^2), mu by Stribeck's curve and the viscous part."""
    v, N = -0.7, 20.0
    mu = 0.3 + 0.1 * np.exp(-((v / 0.5) ** 2)) + 0.1 * abs(v)
    force = line_friction({**LAW, "model": SMOOTH}, N, 0.0, v, 0.0)[0]
    assert force == pytest.approx(mu * N * 0.7 / np.hypot(0.7, 0.2), rel=1e-12)


def test_a_bristle_that_slides_stays_stretched_by_the_limit():
    """Its anchor follows so that k times its stretch is the friction."""
    force, anchor, *_ = line_friction({**LAW, "model": BRISTLE, "c": 0.0}, 20.0, 0.9, 0.0, 0.1)
    assert force == pytest.approx(-0.4 * 20)
    assert 0.9 - anchor == pytest.approx(0.4 * 20 / 100.0)
