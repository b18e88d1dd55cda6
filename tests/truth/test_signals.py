"""Motions under expressions over channels, states and controllers against closed forms and SciPy.

Besides what can be integrated by hand: the period of the van der Pol oscillator, 6.6632868593 for
mu = 1 (Andersen & Geer, SIAM J. Appl. Math. 42 (1982) 678; Urabe, computed to ten digits), which is
in no other table of these tests.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes.judging import judged
from accuracyscenes.switches import between_switches
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from truthkit import Memory, order, run

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.engine.compile import compile_system
from flexmb.errors import AssemblyError
from flexmb.model import Model

VAN_DER_POL = 6.6632868593


def slider(**fields):
    """A body of 1 kg on a rail along x, with its position and velocity."""
    model = Model("slider")
    model.add_body("mass", mass=1, inertia=[0.1, 0.1, 0.1], **fields)
    model.add_joint("rail", "prismatic", between=["ground", "mass"], axis="x")
    model.add_sensor("x", "position", of="mass")
    model.add_sensor("v", "velocity", of="mass")
    model.add_sensor("s", "stroke", joint="rail")
    return model


def push(model, value):
    model.add_force("push", "force", at="mass", value=[value, 0, 0])
    return model


def test_the_period_of_the_van_der_pol_oscillator():
    """Upward crossings of zero once on the cycle, by cubic interpolation between the outputs."""
    model = push(slider(position=[2, 0, 0]), "(1 - x.x**2)*v.x - x.x")
    found = run(model, duration=30.0, accuracy=1e-5, outputs=3000)
    x, v, t = found["x.x"], found["v.x"], found.t
    k = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    h, times = t[1] - t[0], []
    for i in k:
        a, b, c = x[i], h * v[i], 3 * (x[i + 1] - x[i]) - h * (2 * v[i] + v[i + 1])
        d = 2 * (x[i] - x[i + 1]) + h * (v[i] + v[i + 1])
        roots = np.roots([d, c, b, a])
        share = roots[(np.abs(roots.imag) < 1e-9) & (roots.real >= 0) & (roots.real <= 1)].real[0]
        times.append(t[i] + share * h)
    # phase errors of 1e-5 of the motion, and what is left of the first swing after two cycles
    assert times[-1] - times[-2] == pytest.approx(VAN_DER_POL, abs=2e-4)


@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk"])
def test_a_spring_by_expression_swings_as_a_spring_damper(method):
    """Damped oscillation, closed form; force by expression on the body."""
    model = push(slider(position=[0.4, 0, 0]), "-9*x.x - 0.6*v.x")
    knobs = {"duration": 4.0, "accuracy": 1e-5, "outputs": 40, "method": method}
    found = run(model, **knobs)
    w, decay = np.sqrt(9 - 0.09), 0.3
    wanted = (
        0.4 * np.exp(-decay * found.t) * (np.cos(w * found.t) + decay / w * np.sin(w * found.t))
    )
    np.testing.assert_allclose(found["x.x"], wanted, atol=4e-5)
    assert found.mismatch() < 1e-3 * 0.5 * 9 * 0.16


def test_forces_along_lines_and_on_joints_by_expression():
    """The same oscillator by a line force, which pushes where positive, and by an actuator."""
    knobs = {"duration": 2.0, "step": 5e-3, "outputs": 20}
    plain = run(push(slider(position=[1.4, 0, 0]), "-9*(x.x - 1) - 0.6*v.x"), **knobs)
    line = slider(position=[1.4, 0, 0])
    line.add_sensor("d", "distance", between=["ground", "mass"])
    line.add_sensor("r", "distance", between=["ground", "mass"], derivative=1)
    line.add_force("line", "line-force", between=["ground", "mass"], value="-9*(d - 1) - 0.6*r")
    joint = slider(position=[1.4, 0, 0])
    joint.add_force(
        "motor", "translational-spring-damper", joint="rail", value="-9*(x.x - 1) - 0.6*v.x"
    )
    for model in (line, joint):
        found = run(model, **knobs)
        np.testing.assert_allclose(found["x.x"], plain["x.x"], atol=1e-8)
        applied = [one.stored("applied_work")[-1] for one in (found, plain)]
        assert applied[0] == pytest.approx(applied[1], abs=1e-6)


def wheel():
    """A wheel of 0.5 kg m² on a hinge, its angle sensed; at rest at zero."""
    model = Model("servo")
    model.add_body("wheel", mass=1, inertia=[0.3, 0.3, 0.5])
    model.add_joint("hinge", "revolute", between=["ground", "wheel"], axis="z")
    model.add_sensor("angle", "angle", joint="hinge")
    return model


@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk"])
def test_a_servo_follows_a_step_as_the_linear_system_does(method):
    """J φ'' = u, u = PID(2 − φ): against the closed loop's transfer function; through 2 rad, past
    any wrap of the angle where it is scaled by three."""
    model = wheel()
    kp, ki, kd, T, J = 20.0, 8.0, 6.0, 0.02, 0.5
    model.add_controller("pid", "pid", input="6 - angle", kp=kp, ki=ki, kd=kd, filter=T, unit="N m")
    model.add_force("motor", "rotational-spring-damper", joint="hinge", value="pid")
    found = run(model, duration=4.0, accuracy=1e-5, outputs=80, method=method)
    # The filter starts at the first error: its rate is that of −φ. With E = 6/s − Φ,
    # J s² Φ = kp E + ki E/s − kd s Φ/(1 + T s).
    s = [1.0, 0.0]
    lag = [T, 1.0]
    numerator = np.polymul(np.polymul([kp, ki], lag), [6.0])
    denominator = np.polyadd(
        np.polymul(np.polymul([J, 0, 0, 0], lag), [1.0]),
        np.polyadd(np.polymul([kp, ki], lag), np.polymul([kd, 0], s)),
    )
    _, wanted = signal.step((numerator, denominator), T=found.t)
    np.testing.assert_allclose(found["angle"], wanted, atol=6 * 1e-4)
    assert np.abs(found["pid"][0] - kp * 6) < 1e-9


def test_a_limited_output_does_not_wind_up():
    """Output within its limits, and the overshoot a fraction of that without back-calculation."""
    found = []
    for tracking in (0.05, 1e6):
        model = wheel()
        model.add_controller(
            "pid", "pid", input="6 - angle", kp=8, ki=6, kd=6, filter=0.02, limits=[-1.5, 1.5],
            tracking=tracking, unit="N m",
        )  # fmt: skip
        model.add_force("motor", "rotational-spring-damper", joint="hinge", value="pid")
        made = run(model, duration=20.0, step=5e-3, outputs=200)
        assert np.abs(made["pid"]).max() <= 1.5
        found.append(made["angle"].max() - 6.0)
    assert found[0] < 0.5 * found[1]


@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk"])
def test_transfer_functions_against_scipy(method):
    """First-order lag in closed form; third order with a direct part against lsim."""
    model = push(slider(), "sin(3*t)")
    model.add_controller(
        "lag", "transfer-function", input="1", numerator=[2], denominator=[0.25, 1]
    )
    given = [1, 4, 3, 2], [1, 2, 6, 5]
    model.add_controller(
        "third", "transfer-function", input="x.x", numerator=given[0], denominator=given[1]
    )
    found = run(model, duration=3.0, accuracy=1e-5, outputs=300, method=method)
    np.testing.assert_allclose(found["lag"], 2 * (1 - np.exp(-4 * found.t)), atol=1e-4)
    # x'' = sin 3t from rest
    x = found.t / 3 - np.sin(3 * found.t) / 9
    _, wanted, _ = signal.lsim(given, x, found.t)
    # lsim holds its input straight between the outputs: (0.01)² x''/8 of error
    np.testing.assert_allclose(found["third"], wanted, atol=1e-4)


def test_a_state_converges_at_second_order_and_keeps_its_start():
    """z' = −2 z + x with x = cos t; fixed steps, slope 2; the start is not projected away."""
    runs = []
    for h in (0.04, 0.02, 0.01):
        model = push(slider(position=[1, 0, 0]), "-x.x")
        model.add_state("z", rate="-2*z + x.x", start="0.7", unit="m")
        runs.append(run(model, duration=2.0, step=h, outputs=10))
    assert runs[0]["z"][0] == 0.7
    t = runs[0].t
    wanted = solve_ivp(
        lambda s, y: [-2 * y[0] + np.cos(s)], (0, 2), [0.7], t_eval=t, rtol=1e-11, atol=1e-12
    ).y[0]
    errors = [np.abs(one["z"] - wanted).max() for one in runs]
    assert 1.8 < order([4.0, 2.0, 1.0], errors) < 2.2
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk"])
def test_a_force_that_follows_acceleration_is_a_mass(method):
    """1 kg pushed with 1 N − ½ kg ẍ accelerates as 1.5 kg: an algebraic loop, iterated."""
    model = push(slider(), "1 - 0.5*a.x")
    model.add_sensor("a", "acceleration", of="mass")
    found = run(model, duration=1.0, accuracy=1e-6, outputs=4, method=method)
    np.testing.assert_allclose(found["a.x"], 1 / 1.5, rtol=1e-9)
    np.testing.assert_allclose(found["x.x"], found.t**2 / 3.0, atol=1e-6)


@pytest.mark.parametrize("unit", [1e-12, 1e9])
@pytest.mark.parametrize("method", ["radau", "generalized-alpha"])
def test_a_motor_does_not_depend_on_the_unit_of_its_current(method, unit):
    """One side of the coupling of wheel and current is up to 1e24 times the other.

    With the symmetric part of the matrix corrections were so small that they were taken for noise.
    """
    model = wheel()
    model.add_sensor("w", "angle", joint="hinge", derivative=1)
    model.add_state("i", rate=f"1e4*({unit!r}*(5*sin(3*t) - 0.2*w) - i)")
    model.add_force("motor", "rotational-spring-damper", joint="hinge",
                    value=f"{0.2 / unit!r}*i - 10*angle")  # fmt: skip

    def slope(t, y):
        return [y[1], (0.2 * y[2] - 10 * y[0]) / 0.5, 1e4 * (5 * np.sin(3 * t) - 0.2 * y[1] - y[2])]

    def truth(t):
        tight = {"rtol": 1e-10, "atol": 1e-12}
        return {"angle": solve_ivp(slope, (0, 2), [0, 0, 0], "Radau", t, **tight).y[0]}

    found = judged(model, truth, duration=2, outputs=20, method=method, accuracy=1e-5)
    assert found.is_reached(1e-5), found


def test_a_force_that_follows_a_reaction():
    """Friction without stiction by the rail's own reaction: decelerates at 0.2 g."""
    model = slider(velocity=[3, 0, 0])
    model.set_gravity([0, 0, -10])
    model.add_sensor("n", "reaction", joint="rail", axes="global")
    push(model, "-0.2*n.z*tanh(v.x/1e-3)")
    found = run(model, duration=1.0, accuracy=1e-5, outputs=10)
    np.testing.assert_allclose(found["n.z"], 10.0, rtol=1e-9)
    np.testing.assert_allclose(found["x.x"], 3 * found.t - found.t**2, atol=1e-4)


def test_a_loop_that_amplifies_is_told():
    """1 kg pushed with 1 N − 3 kg ẍ: the force found from an acceleration is three times larger."""
    model = push(slider(), "1 - 3*a.x")
    model.add_sensor("a", "acceleration", of="mass")
    with pytest.raises(AssemblyError, match="the loop amplifies; lower its gain"):
        assemble(compile_system(model), model)


def test_an_expression_that_ends_is_named_with_its_channels():
    model = push(slider(position=[0.01, 0, 0]), "-1 - sqrt(x.x)")
    model.set_dynamics(duration=1.0, step=1e-2, outputs=10)
    outcome = dynamics(compile_system(model), model, Memory())
    assert outcome.status == "failed"
    assert 'forces.push.value[0]: "-1 - sqrt(x.x)" is nan with x.x = -' in outcome.message


def teeth_with_play():
    """Two wheels of one axis, their teeth 836 N m/rad behind a play, by angles that turn on."""
    made, over = Model("play"), "angle_a - angle_b"
    for name, inertia, sign, damping in (("a", 0.0384, "-", 0.00093), ("b", 0.0622, "", 0.0075)):
        made.add_body(name, mass=1.0, inertia=[inertia] * 3)
        made.add_joint(name, "revolute", between=["ground", name], axis="z")
        made.add_sensor(f"angle_{name}", "angle", joint=name)
        tooth = f"{sign}836*(max(0, {over} - 0.0948) + min(0, {over} + 0.0948))"
        made.add_force(f"tooth_{name}", "rotational-spring-damper", joint=name, value=tooth,
                       damping=damping)  # fmt: skip
    made.add_force("motor", "torque", at="a", value=[0, 0, "1.131*sin(1.895*t)"])
    return made


@pytest.mark.parametrize("accuracy", [2e-3, 1e-3, 5e-4])
def test_angles_of_teeth_with_play_do_not_leap_by_a_turn(accuracy):
    """Without mass they ring from step to step, and corrections ended a whole turn away."""

    def rate(t, y, signs):
        over = y[0] - y[1]
        torque = 836 * (over - 0.0948 * (signs[0] > 0) + 0.0948 * (signs[1] < 0))
        torque *= signs[0] > 0 or signs[1] < 0
        motor = 1.131 * np.sin(1.895 * t) - 0.00093 * y[2]
        return [y[2], y[3], (motor - torque) / 0.0384, (torque - 0.0075 * y[3]) / 0.0622]

    knobs = {"method": "generalized-alpha", "verify": False, "accuracy": accuracy}
    found = run(teeth_with_play(), duration=4.75, outputs=20, **knobs)
    switches = lambda t, y: (y[0] - y[1] - 0.0948, y[0] - y[1] + 0.0948)  # noqa: E731
    truth = between_switches(rate, switches, (0.0,) * 4, np.linspace(0, 4.75, 21))
    for name, angle in zip("ab", truth, strict=False):
        assert np.abs(found[f"angle_{name}"] - angle).max() < 5 * accuracy * np.ptp(angle)


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("text", "wave", "kinks"),
    [
        ("asin(sin(7*t))", lambda a: np.arcsin(np.sin(a)), np.pi / 14 * np.arange(1, 27, 2)),
        ("atan2(sin(7*t), cos(7*t))", lambda a: np.arctan2(np.sin(a), np.cos(a)),
         np.pi / 7 * np.arange(1, 13, 2)),
        ("atan(1/tan(7*t))", lambda a: np.arctan(1 / np.tan(a)), np.pi / 7 * np.arange(1, 14)),
        ("atan(tan(7*t)**-1)", lambda a: np.arctan(1 / np.tan(a)), np.pi / 7 * np.arange(1, 14)),
    ],
)  # fmt: skip
def test_waves_by_inverse_functions(text, wave, kinks):
    """Steps passed over their kinks: at 1e-3 radau told an eighth of the error."""

    def truth(t):
        y, begin, out = np.zeros(2), 0.0, np.zeros((2, len(t)))
        for end in (*kinks[kinks < t[-1]], t[-1]):
            first, last = begin + 1e-12, end - 1e-12

            def slope(t, y, first=first, last=last):
                return [y[1], 5 * wave(7 * np.clip(t, first, last)) - 20 * y[0] - 0.5 * y[1]]

            own, knobs = (t >= begin) & (t <= end), {"rtol": 1e-12, "atol": 1e-14}
            found = solve_ivp(slope, (begin, end), y, "DOP853", dense_output=True, **knobs)
            out[:, own], y, begin = found.sol(t[own]), found.y[:, -1], end
        return {"x.x": out[0], "v.x": out[1]}

    for asked in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        model = push(slider(), f"5*{text} - 20*x.x - 0.5*v.x")
        knobs = {"duration": 6.0, "outputs": 100, "accuracy": asked, "method": "radau"}
        found = judged(model, truth, **knobs)
        assert not found.message and not found.notes
        assert found.is_reached(asked)
        assert not found.is_near(asked) or 1 / 3 < found.share < 3


@pytest.mark.parametrize("asked", [1e-6, 1e-7])
def test_a_load_that_rises_from_rest_by_the_fifth_degree(asked):
    """No step ended where the third derivative jumps: radau told a tenth of 0.2 and 0.4 times."""
    begin, end = 1.0, 1.4

    def truth(t):
        def slope(t, y):
            u = min(t - begin, end - begin) / (end - begin)
            load = 0.4 * u**3 * (10 - 15 * u + 6 * u**2) * np.sin(4 * t)
            return [y[1], (load - 0.3 * 9.81 * np.sin(y[0])) / (0.05 + 0.3**2)]

        y, angle = np.zeros(2), np.zeros(len(t))
        for first, last in ((begin, end), (end, t[-1])):
            own, knobs = (t >= first) & (t <= last), {"rtol": 1e-13, "atol": 1e-15}
            found = solve_ivp(slope, (first, last), y, "DOP853", dense_output=True, **knobs)
            angle[own], y = found.sol(t[own])[0], found.y[:, -1]
        return {"angle": angle}

    model = Model("pendulum", gravity=[0, -9.81, 0])
    model.add_body("rod", mass=1, inertia=[0.05] * 3, center=[0, -0.3, 0])
    model.add_joint("pin", "revolute", between=["ground", "rod"], axis="z")
    model.add_force("load", "torque", at="rod", value=[0, 0, "0.4*step5(t, 1, 0, 1.4, 1)*sin(4*t)"])
    model.add_sensor("angle", "angle", joint="pin")
    knobs = {"duration": 6.0, "outputs": 100, "accuracy": asked, "method": "radau"}
    found = judged(model, truth, **knobs)
    assert found.achieved < 0.1 * asked
    assert 1 / 3 < found.share < 3


def test_a_load_of_a_spline_whose_knots_lie_close_in_places():
    """Where they lie apart its third derivative jumps by less: a third of six times the error was
    told."""
    t = np.array([0.0, 0.1, 0.18, 0.87, 1.24, 1.29, 1.43, 1.84, 2.0])
    force = np.array([0.41, -0.06, 0.44, 0.06, -0.06, 0.72, -0.21, 0.23, 0.07]) * 9.81
    load = CubicSpline(t, force, bc_type="natural")

    def truth(times):
        def slope(t, y):
            moment = -9.81 * np.cos(y[0]) - load(t) * np.sin(y[0])
            return [y[1], 0.3 * moment / (0.02 + 0.3**2)]

        y, angle = np.zeros(2), np.zeros(len(times))
        for first, last in zip(t, t[1:], strict=False):
            own, knobs = (times >= first) & (times <= last), {"rtol": 1e-13, "atol": 1e-15}
            found = solve_ivp(slope, (first, last), y, "DOP853", dense_output=True, **knobs)
            angle[own], y = found.sol(times[own])[0], found.y[:, -1]
        return {"tip.x": 0.3 * np.cos(angle), "tip.y": 0.3 * np.sin(angle)}

    model = Model("pendulum", gravity=[0, -9.81, 0])
    model.add_body("rod", mass=1, inertia=[0.02] * 3, center=[0.3, 0, 0])
    model.add_marker("rod.tip", position=[0.3, 0, 0])
    model.add_joint("pin", "revolute", between=["ground", "rod"], axis="z")
    points = np.stack([t, force], axis=1).tolist()
    value = {"type": "spline", "points": points}
    model.add_force("load", "force", at="rod.tip", value=[value, 0, 0])
    model.add_sensor("tip", "position", of="rod.tip")
    found = judged(model, truth, duration=2.0, outputs=500, accuracy=1e-6, method="explicit-rk")
    assert found.achieved < 1e-7
    assert 0.5 < found.share < 3


@pytest.mark.parametrize("asked", [1e-6, 1e-8])
@pytest.mark.parametrize("size", [1.0, 1e-6])
def test_drag_with_the_square_of_the_speed(asked, size):
    """`hypot` of a velocity has a kink where a swing turns round: 1e-8 was missed 24 times, and
    0.017 of that told."""
    drag, inertia = 1.2, 0.02 + 0.3**2  # per kg and length, over its square

    def truth(times):
        def slope(t, y):
            moment = -9.81 * 0.3 * np.cos(y[0]) - drag * 0.3**3 * y[1] * abs(y[1])
            return [y[1], moment / inertia]

        def turn(t, y):
            return y[1]

        turn.terminal, turn.direction = True, 1.0
        y, begin, angle = np.array([0.0, 0.0]), 0.0, np.zeros(len(times))
        while begin < times[-1]:  # from turn to turn
            knobs = {"rtol": 1e-13, "atol": 1e-15, "dense_output": True, "events": turn}
            some = solve_ivp(slope, (begin, times[-1]), y, "DOP853", **knobs)
            own = (times >= begin) & (times <= some.t[-1])
            angle[own] = some.sol(times[own])[0]
            begin, y = some.t[-1], np.array([some.y[0, -1], 0.0])
            turn.direction *= -1.0
        return {"tip.x": 0.3 * size * np.cos(angle), "tip.y": 0.3 * size * np.sin(angle)}

    model = Model("pendulum", gravity=[0, -9.81 * size, 0])
    model.add_body("rod", mass=1, inertia=[0.02 * size**2] * 3, center=[0.3 * size, 0, 0])
    model.add_marker("rod.tip", position=[0.3 * size, 0, 0])
    model.add_joint("pin", "revolute", between=["ground", "rod"], axis="z")
    model.add_sensor("tip", "position", of="rod.tip")
    model.add_sensor("speed", "velocity", of="rod.tip")
    wind = [f"-{drag / size!r}*speed.{axis}*hypot(speed.x, speed.y)" for axis in "xy"]
    model.add_force("drag", "force", at="rod.tip", value=[*wind, 0])
    found = judged(model, truth, duration=6.0, outputs=300, accuracy=asked, method="explicit-rk")
    assert found.is_reached(asked)
    assert 1 / 3 < found.share < 3


@pytest.mark.parametrize("length", ["sqrt(v.x**2 + v.y*v.y)", "(v.x**2)**0.5"])
def test_drag_with_a_root_of_squares(length):
    """Of a vibration whose drag has the speed as a root of squares the error was 1.7e-7: no step
    ended at its turns."""
    drag, stiffness = 1.2, 40.0

    def slope(t, y, sense):
        return [y[1], -stiffness * y[0] - drag * sense * y[1] ** 2]

    def turn(t, y, sense):
        return y[1]

    turn.terminal = True

    def truth(times):
        y, begin, sense, x = np.array([0.0, 1.0]), 0.0, 1.0, np.zeros(len(times))
        while begin < times[-1]:  # from turn to turn
            knobs = {"rtol": 1e-13, "atol": 1e-15, "dense_output": True, "events": turn}
            turn.direction = -sense
            some = solve_ivp(slope, (begin, times[-1]), y, "DOP853", args=(sense,), **knobs)
            own = (times >= begin) & (times <= some.t[-1])
            x[own] = some.sol(times[own])[0]
            begin, y, sense = some.t[-1], np.array([some.y[0, -1], 0.0]), -sense
        return {"x.x": x}

    model = slider(velocity=[1.0, 0, 0])
    model.add_force("spring", "translational-spring-damper", joint="rail", stiffness=stiffness)
    model.add_force("drag", "force", at="mass", value=[f"-{drag}*v.x*{length}", 0, 0])
    scene = {"duration": 1.0, "outputs": 3, "accuracy": 1e-6, "method": "explicit-rk"}
    assert judged(model, truth, **scene).achieved < 5e-9
