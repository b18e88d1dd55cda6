"""Contact and friction as forces: tangents, power, action and reaction at random states.

Every kind of surface, frictionless, sticking, sliding and smooth, between rigid and flexible
bodies. Radii are set so that the shapes overlap wherever the random state has put them.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import Mechanism
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation

from flexmb.engine.compiled_units import call
from flexmb.engine.forces.bristle import FREE, FULL, limit_growth, slip_since
from flexmb.engine.forces.contact_pair import (
    BALL,
    BORE,
    CYLINDER,
    PLANE,
    normal_change,
    normal_force,
    penetration,
    relative_velocity,
)
from flexmb.engine.forces.friction import BRISTLE, NO_FRICTION, SMOOTH, friction_coefficient

DIFFERENCES = 1e-8  # forces have fifth derivatives of some hundred times their size
KINDS = {"ball": BALL, "plane": PLANE, "cylinder": CYLINDER, "bore": BORE, "point": BORE}
EXPONENTS = {"ball": 1.5, "plane": 2.2, "cylinder": 1.0, "bore": 3.0, "point": 3.0}
# model, static, dynamic coefficient
FRICTIONS = {
    "none": (NO_FRICTION, 0.0, 0.0),
    "sticks": (BRISTLE, 50.0, 50.0),
    "slides": (BRISTLE, 0.3, 0.2),
    "follows": (BRISTLE, 0.3, 0.2),
    "smooth": (SMOOTH, 0.3, 0.2),
}
DEPTH = 0.3


def touching(kind, friction, bodies, ground=False):
    """Two bodies, or one and ground, that overlap by DEPTH, with a bristle from 0.1 s before."""
    made = Mechanism(len(kind) + 7, "star", bodies, n=2, acting=False)
    rng = made.rng
    ends = [made.marker(b, f"c{k}", rng.standard_normal(3)) for k, b in enumerate((1, -ground))]
    made.model.add_force(
        "touch", "contact", between=ends, restitution=0.6, stiffness=40.0,
        shapes=[{"type": "sphere", "radius": 1e-9}] * 2,
        friction={"static": 0.3, "dynamic": 0.2, "stiffness": 30.0, "damping": 2.0},
    )  # fmt: skip
    bench = Bench(made.model)
    bench.randomise(3)
    row = bench.sys.kinds["contacts"].rows[0]
    row["kind"], row["half"], row["slow"], row["n"] = KINDS[kind], 1e3, 1e-3, EXPONENTS[kind]
    row["model"], row["static"], row["dynamic"] = FRICTIONS[friction]
    row["stribeck"], row["viscous"], row["creep"] = 1.5, 0.1, 0.4
    row["ri"] = 0.0 if kind == "point" else 0.4
    overlap(bench, row)
    history = bench.work.now.history
    history[0], history[row["history"]] = bench.state.t[0] - 0.1, 20.0
    before = history[row["bristle"] :]
    before[:4] = FULL if friction == "follows" else FREE, 0.2, -0.1, 0.15
    before[4:7] = place_of(bench, row) - [1.2, 0.6, -2.4]
    normal = rng.standard_normal(3)
    before[7:10] = normal / np.linalg.norm(normal)
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix() @ axes_of(bench, row)
    before[10:13] = rng.standard_normal(3)  # rate of the normal
    before[13:16] = 0.2, 1.5, 0.7  # depth and its rate, lengths
    before[16:25] = turned.T.ravel()  # by columns
    before[25:28] = rng.standard_normal(3)  # spin
    return bench


def place_of(bench, row):
    """Where I is in axes of J."""
    u = bench.marker("x")[row["I"]] - bench.marker("x")[row["J"]]
    return bench.marker("R")[row["J"]].T @ u


def axes_of(bench, row):
    """Axes of I in those of J."""
    R = bench.marker("R")
    return R[row["J"]].T @ R[row["I"]]


def overlap(bench, row):
    """Radii with which the depth is DEPTH here."""
    bench.at()
    u = bench.marker("x")[row["I"]] - bench.marker("x")[row["J"]]
    a = bench.marker("R")[row["J"]][:, 2]
    across = np.linalg.norm(u - (a @ u) * a)
    if row["kind"] == PLANE:
        row["ri"] = a @ u + DEPTH
    elif row["kind"] == BORE:
        row["rj"] = across + row["ri"] - DEPTH
    else:
        distance = np.linalg.norm(u) if row["kind"] == BALL else across
        row["rj"] = distance + DEPTH - row["ri"]


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, atol=DIFFERENCES * max(1.0, np.abs(wanted).max()))


# All frictions between flexible bodies, the one with most terms between rigid ones and mixed.
CASES = [(friction, "flexible") for friction in FRICTIONS]
CASES += [("slides", "rigid"), ("slides", "mixed")]


@pytest.mark.parametrize(("friction", "bodies"), CASES)
@pytest.mark.parametrize("kind", KINDS)
def test_tangents(kind, friction, bodies):
    bench = touching(kind, friction, bodies, ground=bodies == "rigid" and kind == "ball")
    n, q, v = bench.layout.nv, bench.q.copy(), bench.v.copy()
    S = bench.matrix()
    position = (bench.matrix(cp=1.0) - S)[:n, :n]
    velocity = (bench.matrix(cv=1.0) - S)[:n, :n]
    columns = [
        slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual, 1e-3) for d in np.eye(n)
    ]
    close(position, np.array(columns).T)
    bench.at(q=q)
    columns = [slope(lambda s, d=d: bench.at(v=v + s * d).residual, 1e-3) for d in np.eye(n)]
    close(velocity, np.array(columns).T)


def wrench(bench):
    """Total force and moment about the global origin of all markers' wrenches (no reactions)."""
    loaded = bench.sys.parts.markers["point"] == 0  # no force acts on the others
    W, x = bench.marker("W")[loaded], bench.marker("x")[loaded]
    moments = W[:, 3:] + np.cross(x, W[:, :3])
    return W[:, :3].sum(axis=0), moments.sum(axis=0), np.abs(W).max()


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_action_is_reaction_at_one_point(kind, friction):
    bench = touching(kind, friction, "mixed")
    bench.lam[:] = 0.0
    force, moment, size = wrench(bench.at())
    assert size > 1.0
    np.testing.assert_allclose(force, 0.0, atol=1e-13 * size)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12 * size)


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_power_balance(kind, friction):
    """dE/dt is the power of damping and friction; bristles count as friction here."""
    bench = touching(kind, friction, "mixed")
    bench.project()
    bench.accelerations()
    powers = bench.at().powers
    t, q, v, vd = bench.state.t[0], bench.q.copy(), bench.v.copy(), bench.vd.copy()
    unit = 1.0 / np.sqrt(1.0 + 0.1 * np.abs(vd).max())

    def energy(s):
        moved = bench.moved(q, s * unit * v + 0.5 * (s * unit) ** 2 * vd)
        return bench.at(t=t + s * unit, q=moved, v=v + s * unit * vd).energies.sum()

    size = np.abs(powers).max() + abs(bench.at(q=q, v=v).energies[3])
    assert slope(energy) / unit == pytest.approx(powers.sum(), abs=1e-7 * size)


@pytest.mark.parametrize(("friction", "slides"), [("sticks", False), ("slides", True)])
def test_sticking_and_sliding_occur(friction, slides):
    """The bristles of these tests do what their names say: |T| = μ(v) N or less."""
    bench = touching("plane", friction, "rigid")
    bench.lam[:] = 0.0
    bench.at()
    row = bench.sys.kinds["contacts"].rows[0]
    i, j = row["I"], row["J"]
    n, x = bench.marker("R")[j][:, 2], bench.marker("x")
    arm = x[i] - row["ri"] * n
    rate = [bench.marker("vx")[k] + np.cross(bench.marker("om")[k], arm - x[k]) for k in (i, j)]
    sliding = (rate[0] - rate[1]) - n * (n @ (rate[0] - rate[1]))
    speed = np.linalg.norm(sliding)
    mu = row["dynamic"] + (row["static"] - row["dynamic"]) * np.exp(-((speed / 1.5) ** 2))
    W = bench.marker("W")[i][:3]
    T = np.linalg.norm(W - (W @ n) * n)
    limit = (mu + 0.1 * speed) * (W @ n)
    assert T == pytest.approx(limit, rel=1e-9) if slides else 0.0 < T < limit


def test_contact_never_pulls():
    """However fast the shapes part, the normal force is not negative."""
    bench = touching("plane", "none", "rigid", ground=True)
    bench.lam[:] = 0.0
    row = bench.sys.kinds["contacts"].rows[0]
    for speed in (-50.0, -1.0, 0.0, 1.0, 50.0):
        n = bench.marker("R")[row["J"]][:, 2]
        bench.v[:] = 0.0
        body = bench.body_of(row["I"])
        bench.v[bench.columns(body)][:3] = -speed * n
        bench.at(v=bench.v)
        along = bench.marker("W")[row["I"]][:3] @ n
        expected = 40.0 * DEPTH ** EXPONENTS["plane"] * (1 + row["damping"] * speed / 20.0)
        assert along == pytest.approx(max(0.0, expected), rel=1e-9)


def test_what_a_contact_remembers():
    """The bristle in axes of J, that of a step before carried along; the speed of an onset."""
    bench = touching("plane", "sticks", "rigid")
    bench.lam[:] = 0.0
    bench.at()
    now, row = bench.work.now, bench.sys.kinds["contacts"].rows[0]
    i, j = row["I"], row["J"]
    R, x = bench.marker("R")[j], bench.marker("x")
    n, o, k = R[:, 2], row["history"], row["bristle"]
    arm = x[i] - row["ri"] * n
    rate = [bench.marker("vx")[k] + np.cross(bench.marker("om")[k], arm - x[k]) for k in (i, j)]
    g = rate[0] - rate[1]
    # a ball that has turned about one axis, and gone a way, over the plane
    turn, way, e = np.array([0.3, -0.5, 0.2]), np.array([0.02, 0.05, 0.01]), np.array([0, 0, 1.0])
    before = now.history[k : k + 28]
    before[4:7], before[7:10] = place_of(bench, row) - way, e
    before[10:15] = 0.0, 0.0, 0.0, DEPTH, 0.0
    before[16:25] = (Rotation.from_rotvec(-turn).as_matrix() @ axes_of(bench, row)).T.ravel()
    before[25:28] = 10.0 * turn
    slid = before[1:4] + way - row["ri"] * np.cross(turn, e)
    after = remembered(bench, 0.1)[k : k + 28]
    assert after[1:4] == pytest.approx(slid - e * (e @ slid), abs=1e-12)
    assert after[4:7] == pytest.approx(place_of(bench, row), abs=1e-14)
    assert after[16:25].reshape(3, 3).T == pytest.approx(axes_of(bench, row), abs=1e-14)
    # They approach: the speed at the onset lies between those of both ends, or stays as it was.
    bench.at(v=-bench.v)
    speed = n @ g
    for share, before, wanted in ((0.04, 0.5, 0.98), (0.5, 0.9, 0.98), (0.5, 0.9995, 0.99975)):
        now.history[o] = before * speed
        after = remembered(bench, DEPTH / (share * speed))
        assert after[o] == pytest.approx(wanted * speed, rel=1e-12)


def test_the_bristle_of_a_point_follows_its_way():
    """By its places in axes of J, whatever the length of the step."""
    bench = touching("point", "sticks", "rigid")
    bench.lam[:] = 0.0
    bench.at()
    now, row = bench.work.now, bench.sys.kinds["contacts"].rows[0]
    x, R, o = bench.marker("x"), bench.marker("R")[row["J"]], row["bristle"]
    u, a = x[row["I"]] - x[row["J"]], R[:, 2]
    out = (u - a * (a @ u)) / np.linalg.norm(u - a * (a @ u))
    place = place_of(bench, row)
    now.history[o + 4 : o + 7] = place - [0.1, 0.05, -0.2]  # so near that it sticks
    now.history[o + 7 : o + 10] = -R.T @ out  # it slides along
    now.history[o + 10 : o + 15] = 0.0, 0.0, 0.0, DEPTH, 0.0
    way = R @ (now.history[o + 1 : o + 4] + place - now.history[o + 4 : o + 7])
    wanted = R.T @ (way - out * (out @ way))
    for span in (1e-6, 0.1):
        after = remembered(bench, span)
        assert after[o + 1 : o + 4] == pytest.approx(wanted, abs=1e-12)
        assert after[o + 4 : o + 7] == pytest.approx(place, abs=1e-14)


ON_A_BALL = {"model": BRISTLE, "bristle": 0, "ri": 0.1, "rj": 0.2, "kind": BALL, "half": 0.0}


def sides(t):
    """Markers of a ball that moves about another, turns and spins."""
    sides = np.zeros(2, [("x", "f8", 3), ("R", "f8", (3, 3)), ("vx", "f8", 3), ("om", "f8", 3)])
    a, b, r = [0.3, 2.0, 30.0], [0.2, -1.0, 9.0], [0.3, -0.2, 40.0]  # angles, distance
    (a, da), (b, db), (r, dr) = ((p + q * t + w * t * t, q + 2 * w * t) for p, q, w in (a, b, r))
    e = np.array([np.sin(a) * np.cos(b), np.sin(b), np.cos(a) * np.cos(b)])
    de = da * np.array([e[2], 0, -e[0]])
    de += db * np.array([-np.sin(a) * np.sin(b), np.cos(b), -np.cos(a) * np.sin(b)])
    first, turn = Rotation.from_rotvec([5 * t, 0, 0]), 7 * t + 90 * t * t
    sides["x"][0], sides["vx"][0] = r * e, dr * e + r * de
    sides["R"][0] = (first * Rotation.from_rotvec([0, 0, turn])).as_matrix()
    sides["om"][0] = first.apply([5, 0, 7 + 180 * t])
    sides["R"][1] = np.eye(3)
    return sides


def test_the_way_of_a_ball_is_that_of_its_sliding():
    """On a ball, to third order in the step: beside the integral of the speed, turned along."""
    c = ON_A_BALL

    def slides(t, end=None):
        mi, mj = sides(t)
        _, n, _ = penetration(c, mi, mj)
        g, n = np.array(relative_velocity(c, n, mi, mj)), np.array(n)
        g -= n * (n @ g)
        return g if end is None else g - (end @ g) / (1 + n @ end) * (n + end)

    def error(h):
        before, (mi, mj) = np.zeros(28), sides(0.0)
        d, n, rho = penetration(c, mi, mj)
        rate = -np.dot(n, relative_velocity(c, n, mi, mj))
        _, tilt = normal_change(c, n, rho, mi, mj, tuple(mi["vx"]), (0.0, 0.0, 0.0))
        before[:13] = FREE, 0, 0, 0, *mi["x"], *n, *tilt
        before[13:] = d, rate, 0.0, *mi["R"].T.ravel(), *mi["om"]
        mi, mj = sides(h)
        d, n, _ = penetration(c, mi, mj)
        way, end = np.array(slip_since(c, before, h, n, d, mi, mj)), np.array(n)
        wanted = quad_vec(lambda t: slides(t, end), 0.0, h, epsrel=1e-12)[0]
        return np.abs(way - end * (end @ way) - wanted).max()

    errors = [error(h) for h in (4e-3, 2e-3)]
    assert errors[0] < 1e-7  # of a way of 3 mm
    assert errors[0] > 7.0 * errors[1]


def test_how_the_limit_of_a_bristle_grows():
    """Beside differences along a motion, with damping and Stribeck's curve."""
    c = {**ON_A_BALL, "K": 1e4, "n": 1.5, "damping": 0.8, "slow": 1e-3, "history": 0, "k": 50.0,
         "static": 0.4, "dynamic": 0.2, "stribeck": 1.0, "viscous": 0.1, "ri": 0.12}  # fmt: skip

    def moving(t):
        d, n, _ = penetration(c, *sides(t))
        return d, np.array(n), np.array(relative_velocity(c, n, *sides(t)))

    def limit(t):
        d, n, g = moving(t)
        N, _, _ = normal_force(c, [0.3], d, -n @ g)
        return friction_coefficient(c, np.linalg.norm(g - n * (n @ g)))[0] * N / c["k"]

    d, n, g = moving(0.002)
    tilt, acceleration = (slope(lambda s, k=k: moving(0.002 + s)[k], 1e-4) for k in (1, 2))
    found = limit_growth(c, [0.3], n, d, g, tilt, acceleration)
    assert found == pytest.approx(slope(lambda s: limit(0.002 + s), 1e-4), rel=1e-7)


def remembered(bench, span):
    """The history after a step of this length."""
    bench.work.now.span[0] = span
    run, at = bench._handed()
    stage = run.record.stages.update_history
    for unit, table in zip(stage.units, stage.tables, strict=True):
        call(unit, run, table, at)
    return bench.state.history.copy()
