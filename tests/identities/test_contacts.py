"""Contact and friction as forces: tangents, power, action and reaction at random states.

Every kind of surface, frictionless, sticking, sliding and smooth, between rigid and flexible
bodies. Radii are set so that the shapes overlap wherever the random state has put them.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import Mechanism

from flexmb.engine.forces.contact_pair import BALL, BORE, CYLINDER, PLANE
from flexmb.engine.forces.friction import BRISTLE, NO_FRICTION, SMOOTH, STICKS
from flexmb.engine.units import call

DIFFERENCES = 1e-8  # forces have fifth derivatives of some hundred times their size
KINDS = {"ball": BALL, "plane": PLANE, "cylinder": CYLINDER, "bore": BORE, "point": BORE}
EXPONENTS = {"ball": 1.5, "plane": 2.2, "cylinder": 1.0, "bore": 3.0, "point": 3.0}
# model, static, dynamic coefficient
FRICTIONS = {
    "none": (NO_FRICTION, 0.0, 0.0),
    "sticks": (BRISTLE, 50.0, 50.0),
    "slides": (BRISTLE, 0.3, 0.2),
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
    history[:6] = bench.state.t[0] - 0.1, 3.0, STICKS, 0.2, -0.1, 0.15
    history[6:9] = place_of(bench, row) - [1.2, 0.6, -2.4]
    return bench


def place_of(bench, row):
    """Where I is in axes of J."""
    u = bench.marker("x")[row["I"]] - bench.marker("x")[row["J"]]
    return bench.marker("R")[row["J"]].T @ u


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
        expected = 40.0 * DEPTH ** EXPONENTS["plane"] * (1 + row["damping"] * speed / 3.0)
        assert along == pytest.approx(max(0.0, expected), rel=1e-9)


def test_what_a_contact_remembers():
    """The bristle in axes of J, that of a step before carried along; the speed of an onset."""
    bench = touching("plane", "sticks", "rigid")
    bench.lam[:] = 0.0
    bench.at()
    now, row = bench.work.now, bench.sys.kinds["contacts"].rows[0]
    i, j = row["I"], row["J"]
    R, x = bench.marker("R")[j], bench.marker("x")
    n, o = R[:, 2], row["history"]
    before = now.history[o + 2 : o + 5].copy()
    arm = x[i] - row["ri"] * n
    rate = [bench.marker("vx")[k] + np.cross(bench.marker("om")[k], arm - x[k]) for k in (i, j)]
    g, across = rate[0] - rate[1], np.eye(3) - np.outer(n, n)
    assert remembered(bench, 0.1)[o + 2 : o + 5] == pytest.approx(
        R.T @ across @ (R @ before + 0.1 * g), abs=1e-12
    )
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
    x, R, o = bench.marker("x"), bench.marker("R")[row["J"]], row["history"]
    u, a = x[row["I"]] - x[row["J"]], R[:, 2]
    out = (u - a * (a @ u)) / np.linalg.norm(u - a * (a @ u))
    place = place_of(bench, row)
    now.history[o + 5 : o + 8] = place - [0.1, 0.05, -0.2]  # so near that it sticks
    way = R @ (now.history[o + 2 : o + 5] + place - now.history[o + 5 : o + 8])
    wanted = R.T @ (way - out * (out @ way))
    for span in (1e-6, 0.1):
        after = remembered(bench, span)
        assert after[o + 2 : o + 5] == pytest.approx(wanted, abs=1e-12)
        assert after[o + 5 : o + 8] == pytest.approx(place, abs=1e-14)


def remembered(bench, span):
    """The history after a step of this length."""
    bench.work.now.span[0] = span
    run, at = bench._handed()
    stage = run.record.stages.remember
    for unit, table in zip(stage.units, stage.tables, strict=True):
        call(unit, run, table, at)
    return bench.state.history.copy()
