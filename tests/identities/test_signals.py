"""Functions over channels: tangents against differences, powers, and forces that must be equal."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, slope
from generators import BODIES, Mechanism

from flexmb.analysis.mobility.degrees_of_freedom import mobility_of
from flexmb.engine.compile import compile_system
from flexmb.model import Model

DIFFERENCES = 1e-8
LAST_DIGITS = 1e-12


def ruled(bodies):
    """A random mechanism with forces, forces along lines, joint torques, states and controllers."""
    made = Mechanism(5, "chain", bodies, n=3)
    model = made.model
    tip, base, mid = "b2.f2", "b0.f0", "b1.f1"
    add = model.add_sensor
    add("p", "position", of=tip, relative_to=base, axes=mid)
    add("s", "position", of=tip, seen_from=base)
    add("sv", "velocity", of=tip, seen_from=base)
    add("u", "velocity", of=tip, relative_to=base, axes=mid)
    add("w", "angular_velocity", of=tip, seen_from=base)
    add("d", "distance", between=[base, tip])
    add("dd", "distance", between=[mid, tip], derivative=1)
    add("att", "orientation", of=tip, relative_to=base, sequence="zxz")
    add("turn", "angle", between=[base, tip], axis="z")
    add("spin", "angle", between=[mid, "ground"], axis="z", derivative=1)
    add("reach", "expression", value="hypot(p.x, p.y)", unit="m")
    model.add_state("z", rate="-2*z + d*w.x + c", start=0.3)
    model.add_controller("c", "pid", input="1 - reach", kp=2, ki=1, kd=0.1, filter=0.2)
    model.add_controller(
        "g", "transfer-function", input="d + turn", numerator=[1, 2], denominator=[1, 2, 3]
    )
    value = ["-3*s.x - 2*sv.x*u.y", "c + g", "sin(t)*z + att.beta*att.gamma"]
    model.add_force("rule", "force", at=mid, value=value, axes="body")
    model.add_force("couple", "torque", at=base, value=["att.alpha", "0.3*w.z*p.z", "-spin"])
    model.add_force("line", "line-force", between=[base, tip], value="-10*(d - 1) - 3*dd + w.z")
    angular = [name for name, joint in model.joints.items() if joint.type == "revolute"]
    for name in angular[:1]:
        model.add_force(
            "motor", "rotational-spring-damper", joint=name, value="z - 0.2*u.z", damping=0.1
        )
    return model


@pytest.fixture(scope="module", params=BODIES)
def bench(request):
    made = Bench(ruled(request.param))
    made.randomise(3)
    return made


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, atol=DIFFERENCES * max(1.0, np.abs(wanted).max()))


def test_velocity_and_position_tangents(bench):
    """At random states: signals act with the matrix of a step only, so together with cv."""
    n, q, v = bench.layout.nv, bench.q.copy(), bench.v.copy()
    S, velocity, both = bench.matrix(), bench.matrix(cv=1.0), bench.matrix(cv=1.0, cp=1.0)
    columns = [slope(lambda s, d=d: bench.at(v=v + s * d).residual) for d in np.eye(n)]
    close((velocity - S)[:n, :n], np.array(columns).T)
    bench.at(v=v)
    columns = [
        slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual, 1e-3) for d in np.eye(n)
    ]
    bench.at(q=q)
    close((both - velocity)[:n, :n], np.array(columns).T)


def test_planar_tangents():
    """What is out of the plane is left out of the matrix; the rest stays exact."""
    model = Model("planar", plane="xy")
    model.add_body("a", mass=1, inertia=[1, 1, 1], position=[1, 0, 0])
    model.add_body("b", mass=1, inertia=[1, 1, 1], position=[2, 1, 0])
    model.add_joint("pin", "revolute", between=["ground", "a"], axis="z")
    model.add_sensor("d", "distance", between=["a", "b"])
    model.add_sensor("w", "angular_velocity", of="b")
    model.add_force("f", "force", at="b", value=["-d**2", "w.z*d", 0])
    bench = Bench(model)
    bench.randomise(2)
    bench.q[3:7] = bench.q[10:14] = 1.0, 0.0, 0.0, 0.0
    bench.q[2] = bench.q[9] = 0.0
    inside = [0, 1, 5, 6, 7, 11]
    bench.v[[2, 3, 4, 8, 9, 10]] = 0.0
    q = bench.q.copy()
    velocity, both = bench.matrix(cv=1.0), bench.matrix(cv=1.0, cp=1.0)
    for column in inside:
        d = np.eye(12)[column]
        wanted = slope(lambda s, d=d: bench.at(q=bench.moved(q, s * d)).residual)
        close((both - velocity)[inside, column], wanted[inside])


def test_energy_changes_by_the_powers():
    """Forces of functions over channels count as applied work; states have no energy."""
    moving = Bench(free_of_joints())
    moving.randomise(9)
    moving.accelerations()
    t, q, v, vd = moving.state.t[0], moving.q.copy(), moving.v.copy(), moving.vd.copy()

    def energy(s):
        moved = moving.moved(q, s * v + 0.5 * s * s * vd)
        return moving.at(t=t + s, q=moved, v=v + s * vd).energies.sum()

    wanted = moving.at().powers
    assert abs(wanted[2]) > 1.0
    assert slope(energy, 1e-3) == pytest.approx(wanted.sum(), abs=1e-8 * np.abs(wanted).max())


def free_of_joints():
    """Two free bodies that act on each other by expressions, with a state."""
    model = Model("two bodies", gravity="earth -z")
    for name, x in (("a", 0.0), ("b", 1.0)):
        model.add_body(name, mass=2, inertia=[0.1, 0.2, 0.25], position=[x, 0.3 * x, 0])
    model.add_sensor("d", "distance", between=["a", "b"])
    model.add_sensor("v", "velocity", of="b", seen_from="a")
    model.add_state("z", rate="d - z")
    model.add_force("f", "force", at="b", value=["-9*v.x", "z", "d*t"])
    model.add_force("m", "torque", at="a", value=["v.y*z", 0, "-3*d"], axes="body")
    return model


def test_a_spring_by_expression_is_the_spring_damper():
    """The same residual at any state, but for the coordinate that carries the force."""
    made = []
    for kind in ("spring-damper", "force"):
        model = Model(kind)
        for name, x in (("a", 0.0), ("b", 1.0)):
            model.add_body(name, mass=2, inertia=[0.1, 0.2, 0.3], position=[x, 0.3, 0.1])
        model.add_marker("b.tip", position=[0.3, 0.2, 0.1])
        ends = ["a", "b.tip"]
        if kind == "spring-damper":
            model.add_force("s", kind, between=ends, stiffness=40, damping=3, free_length=0.5)
        else:
            model.add_sensor("d", "distance", between=ends)
            model.add_sensor("r", "distance", between=ends, derivative=1)
            model.add_sensor("h", "position", of="b.tip", relative_to="a")
            pull = [f"(40*(d - 0.5) + 3*r)*h.{axis}/d" for axis in "xyz"]
            model.add_force("on_a", "force", at="a", value=pull)
            model.add_force("on_b", "force", at="b.tip", value=[f"-({x})" for x in pull])
        bench = Bench(model)
        bench.randomise(8)
        made.append(bench.at())
    np.testing.assert_allclose(made[1].residual, made[0].residual, rtol=0, atol=1e-12 * 400)
    # and the same tangents
    S = [bench.matrix(cv=0.3, cp=0.7) for bench in made]
    np.testing.assert_allclose(S[1], S[0], atol=1e-12 * np.abs(S[0]).max())


def test_accelerations_enter_the_matrix_of_a_step():
    """f = −m' ẍ makes the body heavier by m', in the residual and in the matrix of a step."""
    model = Model("virtual mass")
    model.add_body("a", mass=2, inertia=[0.1, 0.1, 0.1])
    model.add_sensor("a", "acceleration", of="a")
    model.add_force("f", "force", at="a", value=["-0.5*a.x", "-0.5*a.y", "-0.5*a.z"])
    bench = Bench(model)
    bench.randomise(5)
    wanted = 2.5 * bench.vd[:3]
    np.testing.assert_allclose(bench.at().residual[:3], wanted, rtol=1e-12)
    np.testing.assert_allclose(bench.matrix(cv=1e-9)[:3, :3], 2.5 * np.eye(3), atol=1e-8)


def servo(units):
    """A body under a PID controller, a transfer function and a state, in SI or in mm, kN and ms."""
    mm, ms, kN = (1.0, 1.0, 1.0) if units == "SI" else (1e3, 1e3, 1e-3)
    model = Model("servo", units=units)
    model.add_body("a", mass=2, inertia=[1e-2 * mm**2] * 3, position=[0.3 * mm, 0, 0])
    model.add_sensor("x", "position", of="a")
    model.add_sensor("v", "velocity", of="a")
    model.add_controller(
        "pid", "pid", input=f"{mm} - x.x", kp=2 * kN / mm, ki=3 * kN / mm / ms,
        kd=4 * kN / mm * ms, filter=0.5 * ms, limits=[-1 * kN, 9 * kN], unit="N",
    )  # fmt: skip
    model.add_controller(
        "g", "transfer-function", input=f"x.x/{mm}*t/{ms}", unit="N",
        numerator=[0.3 * ms * kN, 0.7 * kN], denominator=[0.2 * ms, 1],
    )  # fmt: skip
    model.add_state("z", rate=f"-2/{ms}*z + v.x", start=0.2 * mm, unit="m")
    model.add_force("f", "force", at="a", value=["pid", "g", f"{kN}*sin(z/{mm})"])
    return model


def test_controllers_mean_the_units_of_the_scene():
    """Gains, times and limits told in mm, kN and ms give the forces and rates of SI."""
    found = []
    for units in ("SI", "mm-kg-ms"):
        bench = Bench(servo(units))
        bench.v[:3] = 0.4, 0.1, 0.2
        for start in bench.compiled.starts:
            bench.v[start.iv] = start.value
        names = [start.iv for start in bench.compiled.starts]
        bench.at(t=0.7)
        channels = dict(zip(bench.layout.channels, bench.channels, strict=True))
        z = bench.residual[names[0]]
        found.append([*bench.residual[:3], z, *(channels[name] for name in ("pid", "g", "z"))])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12)
    x, t, v = 0.3, 0.7, 0.4
    kick = 2 * (1 - x) + 4 / 0.5 * (1 - x)  # filter and integral at zero
    wanted = [-kick, -1.5 * x * t, -np.sin(0.2), 2 * 0.2 - v, kick, 1.5 * x * t, 0.2]
    np.testing.assert_allclose(found[0], wanted, rtol=1e-12)


def test_times_in_expressions_over_channels_are_events():
    """The ends of a step of time, beside a channel; what depends on a channel has no known time."""
    model = Model("events")
    model.add_body("a", mass=2, inertia=[0.1, 0.1, 0.1])
    model.add_sensor("x", "position", of="a")
    value = "x.x*step(t, 0.2, 0, 0.4, 1) + step(x.y, 0.1, 0, 0.3, 1)"
    model.add_force("f", "force", at="a", value=[value, "hypot(x.x, t)", 0])
    model.set_dynamics(duration=1.0)
    events = compile_system(model).system.time_events
    np.testing.assert_allclose(events.mean(axis=1), [0.2, 0.4], rtol=1e-12)


def test_states_are_no_freedoms():
    """A slider pushed by a controller has the one freedom of the slider, and no redundant row."""
    model = Model("counts")
    model.add_body("a", mass=2, inertia=[0.1, 0.1, 0.1], position=[1, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "a"], axis="x")
    model.add_sensor("x", "position", of="a")
    model.add_state("z", rate="x.x - z")
    model.add_controller("c", "pid", input="z", kp=1, ki=2, kd=3, filter=0.1)
    model.add_force("line", "line-force", between=["ground", "a"], value="c")
    found = mobility_of(compile_system(model), model)
    assert (found.coordinates, found.rank, found.delta, found.redundant) == (6, 5, 1, 0)
