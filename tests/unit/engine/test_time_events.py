"""Jumps of functions of time as events: steps end at them, and begin again on the far side."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.lib.recfunctions import structured_to_unstructured

from flexmb.analysis.dynamics.dynamics import prepare_dynamics
from flexmb.analysis.dynamics.integration import Integration
from flexmb.engine.allocation import new_state
from flexmb.engine.compile import compile_system, kinks_of_functions
from flexmb.engine.equations_of_motion import work_of_step
from flexmb.engine.method import SUCCESS
from flexmb.model import Model

PULSE = {
    "type": "table",
    "points": [[0, 0], [1, 0], [1.001, 1000], [1.002, 0], [1.4, 0]],
    "beyond": "hold",
}
SAW = {"type": "table", "points": [[0, 0], [0.2, 50]], "beyond": "repeat"}
LED = {"type": "table", "points": [[0, 0], [0.5, 0.2], [1, 0.1], [1.5, 0.5]]}


def cart(force=None, stroke=None):
    """A cart of 1 kg on a spring, pushed; or led."""
    model = Model("cart")
    model.add_body("cart", mass=1.0, inertia=[1, 1, 1])
    model.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    if stroke is not None:
        model.add_driver("lead", joint="rail", stroke=stroke)
    else:
        model.add_force("push", "force", at="cart.origin", value=[force, 0, 0])
        model.add_force("spring", "translational-spring-damper", joint="rail", stiffness=40.0)
    model.add_sensor("place", "position", of="cart.origin")
    return model


def ready(model, events=True, **dynamics):
    """A run alone, without a scout."""
    model.set_dynamics(**dynamics, verify=False)
    made = compile_system(model)
    if not events:
        none = made.system.time_events[:0].copy()
        made = replace(made, system=made.system._replace(time_events=none))
    return prepare_dynamics(made, model).run


def whole(run):
    """All times and places of the cart of a run, and the balance of its energy."""
    rows = []
    while not run.finished:
        assert run.integrate(40) == SUCCESS
        rows.append(run.rows.read())
    t, x = (np.concatenate([getattr(b, name) for b in rows]) for name in ("t", "sensors"))
    return t, x[:, 0], run.rows.balance.relative


def stepped(n):
    """All times and the last state of a run in chunks of n steps, each from a copied state."""
    run, times = saw(), []
    while not run.finished:
        before = [part.copy() for part in run.state]
        run = Integration(run.compiled, run.method, run.settings, new_state(run.compiled.system, 3))
        for part, value in zip(run.state, before, strict=True):
            part[:] = value
        assert run.integrate(n) == SUCCESS
        times.append(run.state.t[0])
    return times, flat(run.state)


def saw():
    return ready(cart(SAW), duration=0.5, outputs=10, accuracy=1e-2)


def flat(state):
    """All numbers of a state (n,); records in their order of fields."""
    parts = [structured_to_unstructured(part) if part.dtype.names else part for part in state]
    return np.concatenate([part.ravel() for part in parts])


def pulse_answer(t):
    """Spring and mass under a triangle of force: Duhamel's integral over its corners."""
    w, top, rise = np.sqrt(40.0), 1000.0, 0.001

    def ramp(s):  # answer to a force that grows by 1 N/s from s = 0 on
        s = np.maximum(s, 0.0)
        return (s - np.sin(w * s) / w) / w**2

    return top / rise * (ramp(t - 1) - 2 * ramp(t - 1.001) + ramp(t - 1.002))


@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk", "radau"])
def test_a_pulse_is_met_however_short(method):
    """Without its jumps as events the steps of a scene at rest pass over it."""
    asked = {"duration": 1.4, "outputs": 28, "accuracy": 1e-2, "method": method}
    t, x, _ = whole(ready(cart(PULSE), **asked))
    wanted = pulse_answer(t)
    assert np.abs(x - wanted).max() < 1e-2 * np.ptp(wanted)
    asked["method"] = "generalized-alpha"
    assert not whole(ready(cart(PULSE), events=False, **asked))[1].any()


def test_a_step_ends_just_before_each_jump_and_the_next_begins_after_it():
    times, events = stepped(1)[0], saw().compiled.system.time_events
    np.testing.assert_allclose(events.mean(axis=1), [0.2, 0.4], rtol=1e-14)
    lengths = np.diff(np.concatenate([[0.0], times]))
    for before, after in events:
        assert before in times and before < after
        k = int(np.flatnonzero(times == before)[0])
        assert lengths[k + 1] < 0.5 * lengths[: k + 1].max()


def test_a_run_in_pieces_is_the_same_to_the_bit():
    run = saw()
    while not run.finished:
        run.integrate(7)
    np.testing.assert_array_equal(stepped(7)[1], flat(run.state))


def test_a_jump_of_a_prescribed_speed_is_an_impulse_that_does_work():
    t, x, balance = whole(ready(cart(stroke=LED), duration=1.5, outputs=10, accuracy=1e-2))
    wanted = np.interp(t, [0, 0.5, 1, 1.5], [0, 0.2, 0.1, 0.5])
    np.testing.assert_allclose(x, wanted, atol=1e-12)
    assert balance < 1e-10


def pushed(value, **dynamics):
    model = Model("box")
    model.add_body("b", mass=1.0, inertia=[1, 1, 1])
    model.add_force("push", "force", at="b.origin", value=[value, 0, 0])
    model.set_dynamics(duration=2.0, **dynamics)
    return compile_system(model)


def test_only_error_control_and_functions_that_jump_have_the_table():
    assert len(pushed("sin(t)").system.time_events) == 0
    assert len(pushed("step(t, 0, 0, 1, 1)", step=1e-3).system.time_events) == 0
    events = pushed("step(t, 0, 0, 1, 1)").system.time_events
    assert events.shape == (1, 2) and events[0, 0] < 1.0 < events[0, 1]


def test_jumps_at_one_time_are_one_event_and_none_at_the_start():
    text = "step(t, 0, 0, 0.7, 1) + step(t, 0.7*(1 + 1e-13), 0, 2, 1)"
    events = pushed(text).system.time_events
    np.testing.assert_allclose(events.mean(axis=1), [0.7, 2.0], rtol=1e-12)


@pytest.mark.parametrize("method", ["explicit-rk", "radau", "generalized-alpha"])
@pytest.mark.parametrize(
    "value", ["2*sign(t - 1)", "2*sign(sin(pi*(t - 1)))", "step(t, 0, 0, 1, 2) - 2"]
)
def test_a_row_at_a_jump_is_of_the_time_before_it_at_the_end_too(value, method):
    """By t − 1 < 0: F = −2 N, or of the rise that ends at t = 1 its value 0, curvature −12."""
    rise = value.startswith("step")
    found = []
    for duration in (1.0, 1.5):
        made = cart(stroke=value) if rise else cart(value)
        run = ready(made, duration=duration, outputs=round(10 * duration), accuracy=1e-3,
                    method=method)  # fmt: skip
        rows = []
        while not run.finished:
            assert run.integrate(40) == SUCCESS
            rows.append(run.rows.read())
        (at,) = [row.part(k, k + 1) for row in rows for k in np.flatnonzero(row.t == 1.0)]
        found.append(at.vd[0, 0] if rise else at.vd[0, 0] + 40.0 * at.sensors[0, 0])
    np.testing.assert_allclose(found, -12.0 if rise else -2.0, rtol=1e-6)


def test_how_long_a_run_is_does_not_change_the_fingerprint_of_its_tables():
    long, short = pushed("step(t, 0, 0, 1, 1)"), pushed("step(t, 0, 0, 1, 1)", step=1e-3)
    assert long.layout.fingerprint == short.layout.fingerprint


def test_a_speed_integrated_over_the_run_leaves_the_fingerprint_for_a_longer_one():
    def spun(duration):
        model = Model("wheel")
        model.add_body("b", mass=1.0, inertia=[1, 1, 1])
        model.add_joint("axle", "revolute", between=["ground", "b"], axis="z")
        model.add_driver("motor", joint="axle", angle="9*sin(t**2)", prescribes="velocity")
        model.set_dynamics(duration=duration)
        return compile_system(model)

    short, long = spun(2.0), spun(7.0)
    assert len(short.system.functions.data) < len(long.system.functions.data)
    assert short.layout.fingerprint == long.layout.fingerprint


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_work_of_a_step_is_that_of_a_polynomial_of_the_power(degree):
    """Straight from one step, a parabola from two, a cubic from three, of unequal steps."""
    power = np.polynomial.Polynomial([3.0, -2.0, 1.5, 0.7][: degree + 1])
    earlier, before, now, end = 0.2, 0.5, 0.9, 1.2
    unknown = [[power(before)], [power(earlier)]]
    for k in range(degree - 1, 2):
        unknown[k][0] = np.nan
    state = SimpleNamespace(
        power=np.array([power(now)]), power_before=np.array(unknown),
        memory=[{"last_step": now - before, "earlier_step": before - earlier}],
    )  # fmt: skip
    whole = power.integ()
    found = work_of_step(SimpleNamespace(order=5), state, 0, power(end), end - now)
    assert found == pytest.approx(whole(end) - whole(now), rel=1e-12)


@pytest.mark.parametrize("begin", [0.0, 0.1])
def test_a_square_wave_leaves_no_error_at_its_jumps(begin):
    """Its first sign may be that of zero; a short step behind a jump has the force there."""
    model = Model("box")
    model.add_body("b", mass=1.0, inertia=[1, 1, 1])
    turn = (np.pi - begin) / 3
    near = [f"step(t, {turn + a!r}, 0, {turn + b!r}, 1)" for a, b in ((-2e-5, -1e-5), (1e-6, 2e-6))]
    force = f"2*cos(t) - sign(sin(3*t + {begin})) + 1e-9*({' + '.join(near)})"
    model.add_force("push", "force", at="b.origin", value=[force, 0, 0])
    model.add_sensor("place", "position", of="b.origin")
    t, x, _ = whole(ready(model, duration=1.9, outputs=10, accuracy=1e-2, method="explicit-rk"))
    wanted = 2 - 2 * np.cos(t) - t**2 / 2 + np.maximum(t - turn, 0.0) ** 2
    np.testing.assert_allclose(x, wanted, rtol=0, atol=1e-9)


WAVE = [[0, 0], [0.1, 0.03], [0.22, -0.01], [0.4, 0.02], [0.55, -0.04], [0.7, 0], [1, 0]]
WAVE = {"type": "spline", "points": WAVE, "ends": "periodic", "beyond": "repeat"}


def carried(stroke, **dynamics):
    """A cart on a spring, on another one that is led; a run to its end, and times of its steps."""
    model = Model("carried")
    for name in ("base", "cart"):
        model.add_body(name, mass=1.0, inertia=[1, 1, 1])
    model.add_joint("rail", "prismatic", between=["ground", "base"], axis="x")
    model.add_joint("deck", "prismatic", between=["base", "cart"], axis="x")
    model.add_driver("lead", joint="rail", stroke=stroke)
    model.add_force("spring", "translational-spring-damper", joint="deck", stiffness=60.0)
    model.add_sensor("place", "position", of="cart.origin")
    run, times = ready(model, duration=10.0, outputs=40, **dynamics), [0.0]
    while not run.finished:
        assert run.integrate(1) == SUCCESS
        times.append(float(run.state.t[0]))
    return run, np.array(times)


def test_steps_of_explicit_methods_end_where_the_acceleration_of_a_driver_has_a_kink():
    knots = np.concatenate([np.array(WAVE["points"])[1:, 0] + turn for turn in range(10)])

    def beside(times):
        return np.abs(times[:, None] - knots).min(axis=0) < 1e-9

    run, times = carried(WAVE, method="explicit-rk")
    assert beside(times).all()
    count = run.state.count[0]
    assert count["steps"] < 250  # of 1050, and 140 rejected, over the knots
    assert count["rejected"] < 10
    _, times = carried(WAVE, method="radau")  # loses no order there
    assert beside(times).sum() < 5


def test_steps_do_not_end_at_the_points_of_a_smooth_curve_or_of_digits():
    t = np.arange(1001) / 1000
    for digits in (16, 9):
        y = np.round(0.05 * np.sin(2 * np.pi * t), digits)
        y[-1] = y[0]
        points = np.stack([t, y], axis=1).tolist()
        spline = {"type": "spline", "points": points, "ends": "periodic", "beyond": "repeat"}
        run, _ = carried(spline, method="explicit-rk")
        assert len(run.time_events) == len(run.compiled.system.time_events)
        assert run.state.count[0]["steps"] < 8000  # over 10 000 points


def test_a_mechanism_that_only_drivers_move_does_not_end_its_steps_at_kinks():
    run = ready(cart(stroke=WAVE), method="explicit-rk", duration=10.0, outputs=40)
    assert len(kinks_of_functions(run.compiled, 10.0, 1e-6, explicit=True))
    assert len(run.time_events) == len(run.compiled.system.time_events)
