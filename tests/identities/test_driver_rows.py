"""Rows of drivers between rigid and flexible bodies, in space and in the plane, at random states.

Each row measures its coordinate as written down here anew; Cq against differences of C, C_t and γ
against differences in time, tangents against differences of the residual, and the work of the
drivers closes the balance of energy.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import cloud, interface, random_rotation

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.engine.compile import compile_system
from flexmb.model import Model

DIFFERENCES = 5e-9  # the difference rules leave 1e-12 of numbers below 1000
AXIS = np.array([2.0, -1.0, 2.0]) / 3
F = "0.4 + 0.3*sin(2*t) + 0.1*t**2"
DRIVERS = {
    "x, y, z": {"marker": "b.end", "x": F, "y": "sin(t)", "z": "0.2*t"},
    "position": {"marker": "b.end", "position": [F, "cos(t)", "t"]},
    "relative": {"marker": "b.end", "relative_to": "a.end", "x": F, "z": "t**2", "y": "1"},
    "angle": {"marker": "b.end", "angle": "3*t + sin(t)"},
    "angle about": {"marker": "b.end", "relative_to": "a.end", "axis": list(AXIS), "angle": F},
    "all": {"marker": "b.end", "relative_to": "a.end", "x": "t", "y": F, "angle": "t**2"},
    "distance": {"between": ["a.end", "b.end"], "distance": F},
    "velocity": {"marker": "b.end", "position": [F, "1", "t"], "prescribes": "velocity"},
    "acceleration": {"between": ["a.end", "b.end"], "distance": F, "prescribes": "acceleration"},
}
PLANAR = {
    "position": {"marker": "b.end", "position": [F, "cos(t)"]},
    "relative": {"marker": "b.end", "relative_to": "a.end", "x": F, "angle": "t**2"},
    "distance": {"between": ["a.end", "b.end"], "distance": F},
    "velocity": {"marker": "b.end", "angle": F, "x": "t", "prescribes": "velocity"},
}


MODES = {"rigid-rigid": (0, 0), "rigid-flexible": (0, 3), "flexible-flexible": (3, 4)}


def carrier(model, name, rng, m, planar):
    """A body with a marker `end`."""
    made = cloud(rng, m)
    turn = np.eye(3) if planar else random_rotation(rng)
    place = {"position": [*rng.standard_normal(2), 0.0], "orientation": turn.tolist()}
    if m:
        model.add_body(name, made.flexbody(name, [interface(rng, "node", m)]), **place)
        model.add_marker(f"{name}.end", interface="node", position=[0.1, -0.2, 0.3])
    else:
        flat = {"center": [0.1, 0.2, 0.0], "inertia": [1.0, 2.0, 3.0]} if planar else {}
        model.add_body(name, **made.rigid_fields() | flat, **place)
        model.add_marker(f"{name}.end", position=[*rng.standard_normal(2), 0.0])


def driven(case, carriers, planar=False):
    """Two bodies and a driver."""
    rng = np.random.default_rng(sum(map(ord, case + carriers)))
    model = Model(case, plane="xy" if planar else None)
    for name, m in zip("ab", MODES[carriers], strict=True):
        carrier(model, name, rng, m, planar)
    model.add_driver("d", **(PLANAR if planar else DRIVERS)[case])
    return model


def benches():
    for planar, cases in ((False, DRIVERS), (True, PLANAR)):
        carriers = "rigid-rigid" if planar else "rigid-flexible"
        for case in cases:
            yield pytest.param((case, carriers, planar), id=f"{case}{', planar' * planar}")
    yield pytest.param(("all", "flexible-flexible", False), id="all, flexible")


@pytest.fixture(params=benches())
def bench(request):
    made = Bench(driven(*request.param))
    made.randomise(7)
    if request.param[2]:
        flatten(made)
    return made


def flatten(bench):
    """Put a random state into the plane xy."""
    for row in bench.sys.parts.bodies:
        q, v = bench.q[row["iq"] :], bench.v[row["iv"] :]
        q[2], v[2:5] = 0.0, 0.0
        q[3:7] = np.array([q[3], 0.0, 0.0, q[6]]) / np.hypot(q[3], q[6])


def close(found, wanted, tolerance=DIFFERENCES):
    scale = max(1.0, np.abs(wanted).max(initial=0.0))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * scale)


def test_rows_are_differentiated_rightly(bench):
    q, v, t = bench.q.copy(), bench.v.copy(), bench.state.t[0]
    found = bench.at()
    Cq, rate, gamma = found.Cq, found.rate, found.gamma
    for j in range(bench.layout.nv):
        d = np.zeros(bench.layout.nv)
        d[j] = 1.0
        close(Cq[:, j], slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).C))
    close(rate, Cq @ v + slope(lambda s: bench.at(t=t + s, q=q).C))
    close(-gamma, slope(lambda s: bench.at(t=t + s, q=bench.moved(q, s * v)).rate))


def test_drivers_do_the_work_that_becomes_energy(bench):
    bench.project()
    bench.accelerations()
    t, q, v, vd = bench.state.t[0], bench.q.copy(), bench.v.copy(), bench.vd.copy()
    power = bench.at().powers.sum()
    unit = 1.0 / np.sqrt(1.0 + 0.1 * np.abs(vd).max())  # fast modes move no more than the rest

    def energy(s):
        s = unit * s
        moved = bench.moved(q, s * v + 0.5 * s * s * vd)
        return bench.at(t=t + s, q=moved, v=v + s * vd).energies.sum()

    # accelerations are solved to 1e-12 of forces that nearly cancel in a few stiff directions
    assert slope(energy) / unit == pytest.approx(power, abs=1e-8 * max(1.0, abs(power)))


def at_random(case, **fields):
    bench = Bench(driven(case, "rigid-rigid", **fields))
    rng = bench.randomise(3)
    return bench.at(), rng


def ends(bench):
    """Positions and axes of the markers of the first row."""
    row = bench.sys.rows[0]
    x, R = bench.marker("x"), bench.marker("R")
    return x[row["I"]], R[row["I"]], x[row["J"]], R[row["J"]]


def test_coordinates_are_what_they_are_called():
    bench, _ = at_random("x, y, z")
    t = bench.state.t[0]
    f = 0.4 + 0.3 * np.sin(2 * t) + 0.1 * t**2
    close(bench.C, ends(bench)[2] - [f, np.sin(t), 0.2 * t], 1e-13)
    bench, _ = at_random("relative")
    xi, Ri, xj, _ = ends(bench)
    close(bench.C, (Ri.T @ (xj - xi)) - [f, 1.0, t**2], 1e-13)
    bench, _ = at_random("distance")
    xi, _, xj, _ = ends(bench)
    close(bench.C, [np.linalg.norm(xj - xi) - f], 1e-13)
    bench, _ = at_random("angle")
    Rj = ends(bench)[3]
    wanted = np.arctan2(Rj[1, 0], Rj[0, 0]) - (3 * t + np.sin(t))
    close(np.exp(1j * bench.C), np.exp(1j * np.array([wanted])), 1e-13)


@pytest.mark.parametrize("plane", ["xy", "yz", "zx"])
def test_in_a_plane_coordinates_are_its_two_axes_and_the_angle_from_the_first(plane):
    model = Model("plane", plane=plane)
    axes = ["xyz".index(c) for c in plane]
    tip = np.eye(3)[axes[0]]
    markers = {"tip": {"position": tip.tolist()}}
    model.add_body("b", mass=1.0, inertia=[1.0, 1.0, 1.0], markers=markers)
    model.add_driver("turn", marker="b.origin", angle="t")
    model.add_driver("point", marker="b.tip", position=["2*t", "3*t"])
    bench = Bench(model)
    angle, normal = 0.7, np.cross(tip, np.eye(3)[axes[1]])
    turned = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * normal])
    place = np.eye(3)[axes[0]] * 0.3 - np.eye(3)[axes[1]] * 0.2
    bench.at(t=0.5, q=np.concatenate([place, turned]), v=np.zeros(6))
    wanted = [angle - 0.5, 0.3 + np.cos(angle) - 1.0, -0.2 + np.sin(angle) - 1.5]
    close(bench.C, wanted, 1e-13)
    assert bench.layout.rows == (
        "drivers.turn: driven angle",
        f"drivers.point: driven {plane[0]}",
        f"drivers.point: driven {plane[1]}",
    )


@pytest.mark.parametrize("case", ["velocity", "acceleration"])
def test_integrated_drivers_start_in_the_placed_pose(case):
    bench = Bench(driven(case, "rigid-flexible"))
    bench.at(t=0.0, q=bench.compiled.initial_q, v=np.zeros(bench.layout.nv))
    close(bench.C, 0.0, 1e-14)
    begin = {"velocity": [-0.4, -1.0, 0.0], "acceleration": [0.0]}[case]
    close(bench.rate, begin, 1e-14)


@pytest.mark.parametrize("turns", [0.4, 3.3, 5000.7])
def test_angles_go_on_over_any_number_of_turns(turns):
    """The row wraps, the function does not: it is closed at the same pose whatever the turn."""
    model = Model("wheel")
    model.add_body("b", mass=1.0, inertia=[1.0, 1.0, 1.0])
    model.add_joint("axle", "revolute", between=["ground", "b"], axis="z")
    model.add_driver("motor", joint="axle", angle="4*pi", prescribes="velocity", start="30 deg")
    bench = Bench(model)
    angle = np.pi / 6 + 2 * np.pi * turns
    q = np.array([0.0, 0, 0, np.cos(angle / 2), 0, 0, np.sin(angle / 2)])
    bench.at(t=turns / 2, q=q, v=np.array([0, 0, 0, 0, 0, 4 * np.pi]))
    close(bench.C, 0.0, 1e-15 * max(10.0, angle))  # the last digits of the angle
    close(bench.rate, 0.0, 1e-13)


def test_an_integrated_driver_begins_with_its_speed():
    """start + speed t + a t^2/2 of a driven angle, and its rate."""
    model = Model("wheel")
    model.add_body("b", mass=1.0, inertia=[1.0, 1.0, 1.0])
    model.add_joint("axle", "revolute", between=["ground", "b"], axis="z")
    model.add_driver("motor", joint="axle", angle="6", prescribes="acceleration", start=0.1,
                     start_velocity=2.0)  # fmt: skip
    bench, t = Bench(model), 0.2
    angle, rate = 0.1 + 2.0 * t + 3.0 * t * t, 2.0 + 6.0 * t
    q = np.array([0.0, 0, 0, np.cos(angle / 2), 0, 0, np.sin(angle / 2)])
    bench.at(t=t, q=q, v=np.array([0, 0, 0, 0, 0, rate]))
    close(bench.C, 0.0, 1e-14)
    close(bench.rate, 0.0, 1e-14)


def test_a_spring_on_an_angle_stores_half_its_stiffness_times_the_turn_squared():
    """From where it is free, and a coupler holds the sum of angles at its constant."""
    model = Model("two wheels")
    for k, name in enumerate("ab"):
        model.add_body(name, mass=1.0, inertia=[1.0, 1.0, 1.0])
        model.add_joint(f"axle_{name}", "revolute", between=["ground", name], axis="z")
        model.add_force(f"coil_{name}", "rotational-spring-damper", joint=f"axle_{name}",
                        stiffness=3.0 + k, free=0.3)  # fmt: skip
    terms = [{"joint": f"axle_{name}", "coordinate": "angle", "factor": 1.0 + k}
             for k, name in enumerate("ab")]  # fmt: skip
    model.add_coupler("link", "linear", terms=terms, constant=0.6)
    compiled = compile_system(model)
    state = assemble(compiled, model).state
    turned = [2 * np.arctan2(state.q[b.iq + 6], state.q[b.iq + 3]) for b in compiled.layout.bodies]
    assert turned[0] + 2 * turned[1] == pytest.approx(0.6, abs=1e-9)
    bench = Bench(model)
    stored = bench.at(q=state.q).energies[3]
    wanted = 0.5 * 3.0 * (turned[0] - 0.3) ** 2 + 0.5 * 4.0 * (turned[1] - 0.3) ** 2
    assert stored == pytest.approx(wanted, rel=1e-9)
