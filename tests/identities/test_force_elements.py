"""Force elements between two markers on random mechanisms at random states.

Bushings, beams, stops, springs by laws, actuators, loads in foreign axes and with reactions, on
rigid and flexible bodies: tangents against differences of the residual, power balance, no momentum
of a pair, nothing new in a turned world.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import BODIES, Mechanism, random_rotation

# The difference rules leave 1e-12 of the size of the numbers here.
DIFFERENCES = 1e-8
LAST_DIGITS = 1e-11
KINDS = ("six_component_forces", "force_characteristics", "loads")


def matrix(rng, size=6):
    """A symmetric positive matrix."""
    L = rng.standard_normal((size, size))
    return (20.0 * L @ L.T).tolist()


def mechanism(bodies, seed=3, **world):
    """Three bodies in a tree with one of every element, in pairs of bodies and with ground."""
    made = Mechanism(seed, "tree", bodies, n=3, acting=False, **world)
    rng, model = np.random.default_rng(seed), made.model

    def ends(name, first, second):
        return [
            made.marker(body, f"{name}{end}", rng.standard_normal(3), random_rotation(rng))
            for end, body in zip("ij", (first, second), strict=True)
        ]

    full = {"matrix": matrix(rng), "damping_matrix": matrix(rng)}
    model.add_force("bush", "bushing", between=ends("bush", 0, 2), **full,
                    preload=[1, 2, 3], preload_torque=[-2, 1, 1])  # fmt: skip
    model.add_force("mount", "bushing", between=ends("mount", -1, 1), stiffness=50, free="together",
                    rotational_stiffness=[5, 6, 7], rotational_damping=matrix(rng, 3))  # fmt: skip
    model.add_force("beam", "beam", between=ends("beam", 1, 2), E=100, G=40, A=0.3, Iy=0.02,
                    Iz=0.05, J=0.03, ky=0.8, damping=0.1,
                    orientation=made.turn @ [0.3, 1, 0.2])  # fmt: skip
    law = {"spring_force": "20*x + 30*x**3", "damper_force": "3*v + v*abs(v)"}
    model.add_sensor("gap", "distance", between=ends("seen", 0, 2))
    seen = ends("speed", 1, 2)
    model.add_sensor("speed", "velocity", of=seen[0], axes=seen[1])
    model.add_force("law", "spring-damper", between=ends("law", 0, 1), **law,
                    value="5*cos(2*t) - 7*gap*speed.y")  # fmt: skip
    points = [[-1, -20], [0.1, 0], [0.7, 4], [9, 60]]  # no state here is near one
    speeds = [[-9, -4], [0, 0], [9, 8]]
    model.add_force("table", "spring-damper", between=ends("table", 2, -1), free_length=1.0,
                    spring_force={"points": points, "interpolation": "akima"},
                    damper_force={"points": speeds, "interpolation": "cubic"})  # fmt: skip
    model.add_force("gap", "stop", between=ends("gap", 0, 2), upper=0.2, stiffness=40, exponent=1.5,
                    damping=6, depth=5)  # fmt: skip
    model.add_force("slide", "stop", between=ends("slide", 1, 0), axis=made.turn @ [0, 0.6, 0.8],
                    lower=8, stiffness=2, exponent=2, damping=0.5, depth=1)  # fmt: skip
    at, other = ends("push", 1, 2)
    third = ends("axes", 0, 1)
    value = ["3*cos(t)", "2 + t", "-1"]
    for kind in ("force", "torque"):
        model.add_force(f"{kind}_own", kind, at=at, value=value, axes="body", reaction=other)
        model.add_force(f"{kind}_third", kind, at=at, value=value, axes=third[0], reaction=other)
        model.add_force(f"{kind}_other", kind, at=at, value=value, axes=other, reaction=other)
        model.add_force(f"{kind}_same", kind, at=at, value=value, axes=third[1])
        live = ["3*gap**2", "2 + t*speed.x", "-speed.z"]
        model.add_force(f"{kind}_live", kind, at=at, value=live, axes=third[1], reaction=other)
    hinge = next(n for n, j in model.joints.items() if j.type in ("revolute", "cylindrical"))
    model.add_force("coil", "rotational-spring-damper", joint=hinge, free=0.3, value="sin(t)",
                    spring_force="4*x + 3*x**3", damper_force="0.2*v + 0.1*v**3")  # fmt: skip
    model.add_force("buffer", "rotational-stop", joint=hinge, lower=-9, upper=-5, stiffness=3,
                    exponent=1.3, damping=0.4, depth=20)  # fmt: skip
    return made


def bench_of(bodies):
    made = Bench(mechanism(bodies).model)
    made.randomise(7)
    for name, place, speed in (("coil", 0.8, 0.7), ("buffer", 1.1, -0.6)):
        k = made.layout.coordinates.index(f"forces.{name}")
        row = made.sys.parts.coordinates[k]
        made.q[row["iq"]], made.v[row["iv"]] = place, speed
    return made


@pytest.fixture(params=BODIES)
def bench(request):
    return bench_of(request.param)


def close(found, wanted, tolerance=DIFFERENCES):
    np.testing.assert_allclose(found, wanted, atol=tolerance * max(1.0, np.abs(wanted).max()))


def with_rows(system, rows):
    """The system with other rows of some kinds."""
    tables = {name: system.kinds[name]._replace(rows=left) for name, left in rows.items()}
    return system._replace(kinds={**system.kinds, **tables})


def test_every_element_acts(bench):
    """Else the tests here would pass without them: each changes the residual."""
    whole, system = bench.at().residual, bench.sys
    for name in KINDS:
        rows = system.kinds[name].rows
        for k in range(len(rows)):
            bench.sys = with_rows(system, {name: np.delete(rows, k)})
            assert np.abs(bench.at().residual - whole).max() > 1e-2, (name, k)


def test_position_tangent(bench):
    n, q = bench.layout.nv, bench.q.copy()
    tangent = (bench.matrix(cp=1.0, cv=1.0) - bench.matrix(cv=1.0))[:n, :n]
    columns = [slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual) for d in np.eye(n)]
    close(tangent, np.array(columns).T)


def test_velocity_tangent(bench):
    n, v = bench.layout.nv, bench.v.copy()
    tangent = (bench.matrix(cv=1.0) - bench.matrix())[:n, :n]
    columns = [slope(lambda s, d=d: bench.at(v=v + s * d).residual) for d in np.eye(n)]
    close(tangent, np.array(columns).T)


def test_stored_energy_dissipation_and_applied_power_add_up(bench):
    """−Qᵀ v of the elements alone is what they store less what goes in and out."""
    q, v, t = bench.q.copy(), bench.v.copy(), bench.state.t[0]
    with_them = bench.at().residual
    rate = slope(lambda s: bench.at(q=bench.moved(q, s * v), t=t).energies[3])
    powers = bench.at(q=q).powers
    bench.sys = with_rows(bench.sys, {name: bench.sys.kinds[name].rows[:0] for name in KINDS})
    without = bench.at(q=q)
    stored = slope(lambda s: bench.at(q=bench.moved(q, s * v), t=t).energies[3])
    bench.at(q=q)
    given = powers - bench.powers
    assert given[1] < 0.0
    taken = (with_them - without.residual) @ v
    close(taken, rate - stored - given.sum())


def test_pairs_have_no_momentum(bench):
    """Seen as one rigid whole, what acts between two bodies does no work in any motion."""
    layout, system = bench.layout, bench.sys
    bodies = system.parts.markers["body"]
    six, laws, pairs = (system.kinds[name].rows for name in KINDS)
    inner = (
        six[(bodies[six["I"]] >= 0) & (bodies[six["J"]] >= 0)],
        laws[(laws["I"] >= 0) & (bodies[laws["I"]] >= 0) & (bodies[laws["J"]] >= 0)],
        pairs[pairs["other"] >= 0],
    )
    found = []
    for rows in (inner, (six[:0], laws[:0], pairs[:0])):
        bench.sys = with_rows(system, dict(zip(KINDS, rows, strict=True)))
        found.append(bench.at().residual)
    force = found[0] - found[1]
    assert np.abs(force).max() > 1.0
    for axis in range(3):
        move, turn = np.zeros((2, layout.nv))
        e = np.eye(3)[axis]
        for b, row in enumerate(bench.sys.parts.bodies):
            o, A = bench.columns(b).start, bench.work.now.body["A"][b]
            move[o + axis] = 1.0
            turn[o : o + 3] = np.cross(e, bench.q[row["iq"] : row["iq"] + 3])
            turn[o + 3 : o + 6] = A.T @ e
        close(np.array([force @ move, force @ turn]), 0.0, LAST_DIGITS * np.abs(force).max())


@pytest.mark.parametrize("bodies", BODIES)
def test_a_turned_world_changes_nothing(bodies):
    """The same deflections and speeds, the world turned and shifted: forces turn along."""
    rng = np.random.default_rng(11)
    turn, shift = random_rotation(rng), rng.standard_normal(3)
    plain = Bench(mechanism(bodies).model)
    turned = Bench(mechanism(bodies, turn=turn, shift=shift).model)
    v, d = rng.standard_normal((2, plain.layout.nv))
    found = []
    for bench, R in ((plain, np.eye(3)), (turned, turn)):
        bench.v[:], move = v, 0.5 * d
        for k in range(len(bench.sys.parts.bodies)):
            o = bench.columns(k).start
            bench.v[o : o + 3], move[o : o + 3] = R @ v[o : o + 3], R @ move[o : o + 3]
        bench.q[:] = bench.moved(bench.q, move)
        bench.state.t[0] = 0.4
        force = bench.at().residual
        for k in range(len(bench.sys.parts.bodies)):
            o = bench.columns(k).start
            force[o : o + 3] = R.T @ force[o : o + 3]
        found.append(force)
        found.append(bench.energies[3:])
        found.append(bench.powers)
    for one, other in zip(found[:3], found[3:], strict=True):
        close(one, other, LAST_DIGITS)
