"""Friction in joints: slopes over its coordinate, normal force from the reaction, power."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import Mechanism

from flexmb.engine.compiled_units import call
from flexmb.engine.forces.friction import BRISTLE, FREE, FULL, SMOOTH, line_friction
from flexmb.engine.forces.joint_friction import limit_growth, load_rate
from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES

RUBBING = ("revolute", "prismatic", "cylindrical")
FRICTIONS = {
    "sticks": (BRISTLE, 50.0), "slides": (BRISTLE, 0.3), "turns back": (BRISTLE, 0.3),
    "smooth": (SMOOTH, 0.3),
}  # fmt: skip


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
    places = bench.sys.kinds["joint_frictions"].rows["history"]
    bench.work.now.history[places] = 0.1 * rng.standard_normal(n)
    if friction == "turns back":  # a full bristle, whose limit falls faster than it is let go
        bench.v[-n:] = -0.01 * np.sign(bench.q[-n:])
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
    force = line_friction({**LAW, "model": SMOOTH}, N, 0.0, v, FREE)[0]
    assert force == pytest.approx(mu * N * 0.7 / np.hypot(0.7, 0.2), rel=1e-12)


@pytest.mark.parametrize("mode", [FREE, FULL])
@pytest.mark.parametrize("stretch", [0.9, -0.9])
def test_a_bristle_that_slides_is_as_long_as_its_limit(stretch, mode):
    """Then k times its length is the friction; what is let go is longer, by its damping."""
    force, s, *_ = line_friction({**LAW, "model": BRISTLE, "c": 0.0}, 20.0, stretch, 0.0, mode)
    assert force == pytest.approx(-np.sign(stretch) * 0.4 * 20)
    assert s == pytest.approx(np.sign(stretch) * 0.4 * 20 / 100.0)
    law = {**LAW, "model": BRISTLE, "c": 2.0}
    force, s, *_ = line_friction(law, 20.0, stretch, -0.01 * np.sign(stretch), mode)
    limit = (0.3 + 0.1 * np.exp(-((0.01 / 0.5) ** 2)) + 0.1 * 0.01) * 20
    assert force == pytest.approx(-np.sign(stretch) * limit)
    assert abs(s) == pytest.approx((limit + 2.0 * 0.01) / 100.0)


def test_the_rate_of_a_bearing_load():
    """That of |R1| + |R2| + |T/w|, all parts parabolas in time; at the first steps of lines."""
    rng = np.random.default_rng(3)
    coefficients = rng.standard_normal((3, 5))

    def parts(t):
        return coefficients[0] + t * coefficients[1] + t * t * coefficients[2]

    def load(t):
        a = parts(t)
        return np.hypot(*a[:2]) + np.hypot(*a[2:4]) + abs(a[4])

    # anchor, mode, rate, time between both steps, and the parts at both
    history = np.array([9.9, 0.0, 0.0, 7.0, 0.3, *parts(0.0), *parts(-0.3)])
    found = load_rate(history, 1, 0.2, parts(0.2))
    assert found == pytest.approx(slope(lambda s: load(0.2 + s), 1e-4), rel=1e-8)
    coefficients[2], history[4] = 0.0, 0.0
    found = load_rate(history, 1, 0.2, parts(0.2))
    assert found == pytest.approx(slope(lambda s: load(0.2 + s), 1e-4), rel=1e-8)
    assert load_rate(np.array([9.9, 0.0, 0.0, 7.0, -1.0, *np.zeros(10)]), 1, 0.2, parts(0.2)) == 7.0


@pytest.mark.parametrize("v", [0.3, -0.3])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_how_the_limit_of_a_bristle_grows(side, v):
    """Limits of the law itself, over time: load, speed and what is let go by the damper."""
    law, N, rate, change = {**LAW, "model": BRISTLE, "c": 2.0}, 20.0, -7.0, 1.3

    def longest(t):
        return side * line_friction(law, N + t * rate, 9.0 * side, v + t * change, FULL)[1]

    found = limit_growth(law, N, rate, v, change, side)
    assert found == pytest.approx(slope(longest, 1e-4), rel=1e-7)


@pytest.mark.parametrize("velocity", [0.02, -0.02])
def test_the_event_of_sliding_knows_how_the_preload_grows(velocity):
    """d(|T| - mu N)/dt along a motion of constant speed, by differences of position and time."""
    model = Model("brake")
    model.add_body("cart", mass=2.0, inertia=[1, 1, 1])
    model.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    model.add_force("brake", "joint-friction", joint="rail", dynamic=0.3, stiffness=1e4, damping=50,
                    preload="40 + 30*sin(2*t)")  # fmt: skip
    bench = Bench(model)
    first = bench.sys.kinds["joint_frictions"].first_event
    bench.work.now.history[:] = 0.0
    bench.work.now.history[1] = FREE

    def event(t):
        bench.q[0] = bench.q[-1] = 5e-4 + velocity * t
        bench.v[0] = bench.v[-1] = velocity
        bench.at(t=t)
        run, at = bench._handed()
        stage = run.record.stages.events
        for unit, tables in zip(stage.units, stage.tables, strict=True):
            call(unit, run, tables, at)
        return bench.work.events.now[first].copy()

    wanted = slope(lambda t: event(t)["value"], 1e-4)
    assert abs(wanted) > 100.0
    assert event(0.0)["rate"] == pytest.approx(wanted, rel=1e-6)
