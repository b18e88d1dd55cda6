"""What a step leaves behind: estimates beside scalar formulas, motion so far, and the next step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import DOP853
from truthkit import steps

from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import solve_stage
from flexmb.engine.initial_conditions import POSITIONS, RESIDUAL
from flexmb.engine.integrators.explicit_rk import dormand_prince_8, explicit_method, interpolate
from flexmb.engine.integrators.explicit_rk import step as explicit_step
from flexmb.engine.integrators.radau import radau_5
from flexmb.engine.method import NO_CONVERGENCE, REPEAT, SUCCESS
from flexmb.engine.step_control import judge_step, record_step
from flexmb.model import Model

H = 0.1
FREE = {"step": 0.0, "tolerance": 1.0}


def explicit():
    return explicit_method(dormand_prince_8(), explicit_step, interpolate)


def begin(state, layout):
    state.memory[0]["next_step"], state.memory[0]["steps_until_growth"] = H, 1e9


def oscillator(omega):
    made = Model("oscillator", gravity=[0, 0, 0])
    made.add_body("m", mass=1.0, inertia=[1, 1, 1])
    made.add_force("spring", "bushing", between=["ground", "m"], stiffness=[omega**2] * 3,
                   rotational_stiffness=[1.0] * 3)  # fmt: skip
    return made


def test_the_error_of_order_eight_is_that_of_its_authors():
    """h |e5|^2/sqrt(|e5|^2 + 0.01 |e3|^2) (Hairer, Norsett, Wanner, eq. II.10.17), of positions and
    of velocities; slopes of the scalar oscillator by the published tableau."""
    omega = 4.0

    def start(state, layout):
        state.q[0], state.v[0] = 0.1, 0.3
        begin(state, layout)

    _, state, work = steps(oscillator(omega), explicit(), H, 3, 0, start, end=10.0, **FREE)
    y, slopes = np.array([work.trial.before.q[0], work.trial.before.v[0]]), np.zeros((13, 2))
    f = np.array([[0.0, 1.0], [-(omega**2), 0.0]])
    for s, row in enumerate([*DOP853.A[:12], DOP853.B]):
        slopes[s] = f @ (y + H * row[: len(slopes)] @ slopes[: len(row)])
    five, three = np.abs(DOP853.E5 @ slopes), 0.1 * np.abs(DOP853.E3 @ slopes)
    weight = compile_system(oscillator(omega)).system.weights[0]
    scale = weight / np.array([state.q_scale[0], state.v_scale[0]])
    wanted = scale * H * five**2 / np.hypot(five, three)
    np.testing.assert_allclose(work.trial.error, wanted, rtol=1e-4)  # less round-off of forces


def test_noise_is_what_stiff_forces_make_of_last_places():
    """At 1 km the last places, 1e-15 of it, change the acceleration by ω² times as much."""
    made = oscillator(1e4)
    made.add_marker("ground.away", position=[1000.0, 0, 0])
    made.forces["spring"] = made.forces["spring"].model_copy(
        update={"between": ("ground.away", "m")}
    )
    made.bodies["m"] = made.bodies["m"].model_copy(update={"position": (1000.0, 0, 0)})
    made.add_body("mast", mass=1.0, inertia=[1, 1, 1])  # at the origin, so that it stays there
    _, _, work = steps(made, explicit(), 1e-5, 1, 0, begin, end=10.0, **FREE)
    noise = work.trial.vd_round_off / compile_system(made).system.weights
    assert noise[0] == pytest.approx(1e8 * 1e-15 * 1000.0, rel=0.3)  # units of the place are 1e-13
    np.testing.assert_array_less(noise[1:], 1e-7)


def test_a_force_that_jumps_makes_no_noise():
    """A relay at the very angle at which it switches, where last places decide its side."""
    made = Model("relay", gravity=[0, 0, 0])
    made.add_body("m", mass=1.0, inertia=[1, 1, 1])
    made.add_joint("hinge", "revolute", between=["ground", "m"], axis="z")
    made.add_sensor("angle", "angle", joint="hinge")
    made.add_force("relay", "rotational-spring-damper", joint="hinge", value="-sign(angle)")
    _, state, work = steps(made, explicit(), 1e-3, 1, 0, begin, end=10.0, **FREE)
    assert work.trial.vd_round_off.max() < 1e-20


def test_a_turn_counts_by_its_angle():
    made = Model("spin", gravity=[0, 0, 0])
    made.add_body("m", mass=1.0, inertia=[1, 1, 1], angular_velocity=[0, 0, 0.5])
    _, state, _ = steps(made, explicit(), H, 4, 0, begin, end=10.0, **FREE)
    np.testing.assert_allclose(state.q_scale[3:6], 2 * np.sin(0.5 * 0.5 * 4 * H), rtol=1e-6)


CONTROLLED = {
    "step": 0.0, "static_after_step": 0, "tolerance": 1e-3, "rejection_factor": 1.0, "start": 0.0,
    "end": 1.0,
}  # fmt: skip


@pytest.mark.parametrize("ratio", [0.3, 0.05, 1e-9])
def test_the_next_step_follows_from_the_error(ratio):
    """0.9 (tolerance/error)^(1/8) times the last one, five times at most."""
    method = explicit()
    _, state, _ = steps(oscillator(1.0), method, H, 1, 0)
    settings = type("Settings", (), CONTROLLED)
    state.memory[0]["steps_until_growth"] = 0.0
    record_step(method, settings, state, np.array([ratio * 1e-3, 0.0]), H)
    grown = min(0.9 * ratio ** (-1 / 8), 5.0)
    assert state.memory[0]["next_step"] == pytest.approx(H * grown, rel=1e-12)


def test_a_run_whose_steps_hardly_advance_or_fail_on_and_on_ends():
    """A thousand steps within 1e-8 of it, or a hundred failures within 1e-6."""
    method, error = explicit(), np.zeros(2)
    _, state, _ = steps(oscillator(1.0), method, H, 1, 0)
    settings, memory = type("Settings", (), {**CONTROLLED, "accuracy": 1e-3}), state.memory[0]
    for advance, most in ((0.9e-8, 1001), (1.1e-8, 5000)):
        state.t[0] = memory["recent_time"] = memory["steps_since"] = 0.0
        accepted = 0
        while judge_step(method, settings, state, error, SUCCESS, H) == SUCCESS and accepted < 5000:
            accepted += 1
            state.t[0] = accepted * advance / 1000
            record_step(method, settings, state, error, H)
        assert accepted == most
    for advance, most in ((0.9e-6, 100), (1.1e-6, 500)):
        state.t[0] = memory["failing_time"] = memory["failures_since"] = memory["steps_since"] = 0.0
        failures = 0
        while judge_step(method, settings, state, error, NO_CONVERGENCE, H) == REPEAT:
            failures += 1
            state.t[0] = failures * advance / 100
            memory["steps_since"] = 0.0
            record_step(method, settings, state, error, H)
            if failures == most:
                break
        assert failures == most


def test_accelerations_and_reactions_after_a_step_fulfil_the_equations():
    """M a + Cq' lambda = Q to the digits of positions, though solved with the matrix of a step."""
    made = Model("pendulum", gravity=[0, -9.81, 0])
    made.add_body("bar", mass=2.0, center=[0.5, 0.1, 0], inertia=[0.1, 0.2, 0.3])
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made.add_force("coil", "rotational-spring-damper", joint="pin", stiffness=300.0, damping=2.0)
    _, state, _ = steps(made, radau_5(), 0.02, 10, 0)
    system = compile_system(made).system
    work = new_work(system)
    solve_stage(system, state, work, RESIDUAL)
    assert np.abs(state.lam).max() > 1.0
    assert np.abs(work.trial.res).max() < 1e-11 * np.abs(state.lam).max()


def test_one_correction_of_positions_is_no_longer_than_a_third_of_the_model():
    made = Model("far")
    made.add_body("bar", mass=1.0, inertia=[1, 1, 1], position=[9.0, 0, 0])
    made.add_joint("pin", "spherical", between=["ground", "bar"])
    system = compile_system(made).system
    state, work = new_state(system), new_work(system)
    state.q[0] = 9.0
    size = solve_stage(system, state, work, POSITIONS)
    assert size > 0.3
    assert abs(state.q[0] - 9.0) * system.weights[0] == pytest.approx(0.3)


def test_a_gap_closes_as_baumgarte_says():
    """x'' + 2 a x' + b^2 x = 0 of an open joint: x0 (1 + a t) exp(-a t) for a = b."""
    made = Model("gap", gravity=[0, 0, 0])
    made.add_body("m", mass=1.0, inertia=[1, 1, 1])
    made.add_joint("pin", "spherical", between=["ground", "m"])
    method = explicit_method(
        dormand_prince_8(), explicit_step, interpolate, stabilised=1, alpha=5.0, beta=5.0
    )

    def start(state, layout):
        state.q[0] = 1e-3

    _, state, _ = steps(made, method, 0.02, 20, 0, start)
    assert state.q[0] == pytest.approx(
        1e-3 * (1 + 2) * np.exp(-2), rel=0.01
    )  # but for how it begins
