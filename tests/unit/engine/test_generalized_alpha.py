"""Constants of generalized-alpha: its estimates of local errors, and steps that change."""

from __future__ import annotations

import numpy as np
import pytest
from truthkit import steps

import flexmb
from flexmb.engine.allocation import new_run, new_work
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_units import call, packed_record
from flexmb.engine.integrators.generalized_alpha import (
    generalized_alpha,
    hilber_hughes_taylor,
    newmark,
    step,
)
from flexmb.engine.method import Settings
from flexmb.model import Model
from tests.hard.stiffness import governor

OMEGA, COUNT, H = 10.0, 60, 2e-3
AMPLITUDE = 0.1
SETTINGS = Settings(0.0, 1.0, 1.0, H, 1e-6, 1e-6, 1.0, 1.0, 0.0, 1e-6, 1e-10, 15, 1, 1, 0, 0)


def oscillator():
    made = Model("oscillator", gravity=[0, 0, 0])
    made.add_body("m", mass=1.0, inertia=[1, 1, 1])
    made.add_force("spring", "bushing", between=["ground", "m"], stiffness=[OMEGA**2] * 3,
                   rotational_stiffness=[1.0] * 3)  # fmt: skip
    return made


def swing(radius):
    """COUNT steps of x = a cos(omega t), their errors estimated; its method, state and scratch."""
    chosen = generalized_alpha(radius)

    def start(state, layout):
        state.q[0] = AMPLITUDE
        state.memory[0]["next_step"], state.memory[0]["steps_until_growth"] = H, np.inf

    _, state, work = steps(
        oscillator(), chosen, H, COUNT, 0, start, step=0.0, tolerance=1.0, end=2 * COUNT * H
    )
    assert state.t[0] == pytest.approx(COUNT * H)
    return chosen.coefficients[0], chosen, state, work


def derivative(k, t):
    """The k-th one of the motion."""
    return AMPLITUDE * OMEGA**k * np.cos(OMEGA * t + k * np.pi / 2)


@pytest.mark.parametrize("radius", [0.0, 0.6, 0.8])
def test_estimated_errors_are_those_of_one_step_from_the_exact_motion(radius):
    """Algorithmic accelerations belong to t + (alpha_m - alpha_f) h: what Newmark's formulas leave
    with those of the exact motion."""
    alpha, _, state, work = swing(radius)
    h, t = H, state.t[0] - H
    early, late = (derivative(2, t + (alpha.alpha_m - alpha.alpha_f + k) * h) for k in (0, 1))
    place = derivative(0, t) + h * derivative(1, t)
    place += h * h * ((0.5 - alpha.beta) * early + alpha.beta * late)
    speed = derivative(1, t) + h * ((1 - alpha.gamma) * early + alpha.gamma * late)
    assert abs(np.cos(OMEGA * t)) > 0.2 < abs(np.sin(OMEGA * t))  # both are felt
    weight = compile_system(oscillator()).system.weights[0]
    scale = weight / np.array([state.q_scale[0], state.v_scale[0]])
    wanted = scale * np.abs([place - derivative(0, t + h), speed - derivative(1, t + h)])
    np.testing.assert_allclose(work.trial.error, wanted, rtol=0.08)


@pytest.mark.parametrize("ratio", [0.4, 2.5])
def test_algorithmic_accelerations_move_with_the_step(ratio):
    """After a change of the step they belong to t + (alpha_m - alpha_f) times the new one."""
    alpha, chosen, state, work = swing(0.6)
    system = compile_system(oscillator()).system
    h, t = ratio * H, float(state.t[0])
    work = new_work(system, 0, chosen)
    call(step, packed_record(new_run(system, state, work, chosen, SETTINGS)), alpha, h)
    shift = alpha.alpha_m - alpha.alpha_f
    wanted = derivative(2, t + shift * h)
    left = abs(derivative(2, t + shift * H) - wanted)
    assert abs(work.trial.aa_start[0] - wanted) < 0.1 * left


@pytest.mark.parametrize("alpha", [0.0, -0.1, -0.3])
def test_hht_has_its_constants(alpha):
    """beta = (1 - alpha)^2/4, gamma = 1/2 - alpha; forces at t + (1 + alpha) h (Hughes, The Finite
    Element Method, 9.3)."""
    (one,) = hilber_hughes_taylor(alpha).coefficients
    assert (one.alpha_m, one.alpha_f) == (0.0, -alpha)
    assert one.beta == pytest.approx((1 - alpha) ** 2 / 4)
    assert one.gamma == pytest.approx(0.5 - alpha)


@pytest.mark.parametrize(("gamma", "project"), [(0.5, 1), (0.51, 1), (0.6, 0), (0.9, 0)])
def test_newmark_is_projected_where_joints_would_ring(gamma, project):
    """Its spectral radius at infinity is (3/2 - gamma)/(1/2 + gamma): 1, 0.98, 0.82, 0.43."""
    (one,) = newmark(0.25 * (gamma + 0.5) ** 2, gamma).coefficients
    assert one.project == project


@pytest.mark.parametrize("accuracy", [1e-4, 1e-5])
def test_stiff_dampers_leave_no_reactions_that_symmetry_forbids(accuracy):
    """Two arms alike load their shaft along its axis alone, to 1e-6 of the force in a hinge."""
    made = governor()
    made.add_sensor("bearing", "reaction", joint="bearing")
    made.set_dynamics(method="generalized-alpha", duration=1.0, outputs=100, accuracy=accuracy)
    result = flexmb.simulate(made)
    across = np.hypot(result["bearing.x"], result["bearing.y"]).max()
    hinge = np.linalg.norm([result[f"hinge.{axis}"] for axis in "xyz"], axis=0)
    assert across < 1e-6 * hinge.max()
    assert result.statistics["measured_error_of_reactions"] < 0.1
