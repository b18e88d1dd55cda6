"""Stops are events of the step control: a step ends where one begins to push, and where it ends.

A body of 1 kg flies at 1 m/s into a stop of stiffness k at 0.1 m: it touches at t = 0.1 s, stays
for π/√k and leaves with the speed it came with.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from truthkit import Memory

from flexmb.analysis.dynamics.dynamics import dynamics, prepare_dynamics
from flexmb.engine.compile import compile_system
from flexmb.engine.method import SUCCESS
from flexmb.model import Model

K = 4e4


@pytest.mark.parametrize(
    "force, fields",
    [
        ("stop", {"between": ["ground", "b.eye"], "axis": "x"}),
        ("translational-stop", {"joint": "rail"}),
    ],
    ids=["line", "joint"],
)
def test_steps_end_where_a_stop_begins_and_ends_to_push(force, fields):
    """Aimed at 1 % beyond the crossing of a step that is cut: 1e-3 of the time until then."""
    model = Model("buffer")
    model.add_body("b", mass=1, inertia=[1, 1, 1], velocity=[1, 0, 0])
    model.add_marker("b.eye", position=[0, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    model.add_force("buffer", force, upper=0.1, stiffness=K, **fields)
    model.set_dynamics(duration=0.2, accuracy=1e-4, outputs=10)
    made, memory = compile_system(model), Memory()
    outcome = dynamics(made, model, memory)
    assert outcome.status == "finished", outcome.message
    assert outcome.statistics["events"] == 2
    assert memory.tables()[2][-1, 0] == pytest.approx(-1.0, abs=1e-3)
    model.set_dynamics(duration=0.2, accuracy=1e-4, outputs=10, verify=False)
    run, times = prepare_dynamics(made, model).run, []
    while not run.finished:
        assert run.integrate(1) == SUCCESS
        times.append(run.state.t[0])
    for moment in (0.1, 0.1 + np.pi / np.sqrt(K)):
        assert np.abs(np.array(times) - moment).min() < 1e-4


def test_steps_end_where_a_stop_is_fully_damped_and_where_it_would_pull():
    """Both ways through the depth where the damping is full, and the force that falls to zero.

    In contact x" = -k p - c s(p/d) p', by SciPy from change to change.
    """
    c, depth = 150.0, 2e-3
    model = Model("buffer")
    model.add_body("b", mass=1, inertia=[1, 1, 1], velocity=[1, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    model.add_force("buffer", "translational-stop", joint="rail", upper=0.1, stiffness=K,
                    damping=c, depth=depth)  # fmt: skip
    model.set_dynamics(duration=0.2, accuracy=1e-4, outputs=10, verify=False)
    run, times = prepare_dynamics(compile_system(model), model).run, []
    while not run.finished:
        assert run.integrate(1) == SUCCESS
        times.append(run.state.t[0])

    def force(t, y):
        p, share = y[0] - 0.1, min((y[0] - 0.1) / depth, 1.0)
        return K * p + c * share**2 * (3 - 2 * share) * y[1]

    def deep(t, y):
        return y[0] - 0.1 - depth

    pressed = solve_ivp(lambda t, y: [y[1], -force(t, y)], (0.1, 0.15), [0.1, 1.0], rtol=1e-11,
                        atol=1e-13, events=[deep, force], max_step=1e-4)  # fmt: skip
    found = [*pressed.t_events[0][:2], pressed.t_events[1][pressed.t_events[1] > 0.1001][0]]
    assert len(found) == 3
    for moment in found:
        assert np.abs(np.array(times) - moment).min() < 2e-5


@pytest.mark.parametrize("method", ["auto", "radau"])
def test_a_law_that_changes_at_rest_costs_no_steps(method):
    """A swing with quadratic drag has died down after 10 of 500 s, and crosses zero on and on.

    Each crossing was located: 4450 steps by `auto`, 6750 by `radau`, for 620 and 350 without drag.
    """
    steps = []
    for law in ({}, {"value": "-0.1*w*abs(w)"}):
        model = Model("dies down")
        model.add_body("b", mass=1, inertia=[0.1] * 3, angular_velocity=[0, 0, 1])
        model.add_joint("pin", "revolute", between=["ground", "b"], axis="z")
        model.add_sensor("w", "angle", joint="pin", derivative=1)
        model.add_force("spring", "rotational-spring-damper", joint="pin", stiffness=1.0,
                        damping=0.2, **law)  # fmt: skip
        model.set_dynamics(duration=500.0, accuracy=1e-4, outputs=20, method=method, verify=False)
        run = prepare_dynamics(compile_system(model), model).run
        assert run.integrate(10**5) == SUCCESS and run.finished
        steps.append(int(run.state.count[0]["steps"]))
    assert steps[1] < 3 * steps[0], steps


def rocker(origin):
    """A beam that swings, with a driven slider on it and one that hits stops."""
    model = Model("rocker", gravity=[0, -9.81, 0])
    model.add_marker("ground.pivot", position=origin)
    model.add_body("beam", mass=2, inertia=[0.1, 0.5, 0.5], position=origin)
    model.add_joint("pivot", "revolute", between=["ground.pivot", "beam"], axis="z")
    model.add_force("coil", "rotational-spring-damper", joint="pivot", stiffness=60, free=0.0)
    for name, x in (("driven", -0.5), ("loose", 0.5)):
        at = [origin[0] + x, *origin[1:]]
        model.add_body(name, mass=1, inertia=[0.01] * 3, position=at)
        model.add_marker(f"beam.{name}", position=[x, 0, 0])
        model.add_joint(name, "prismatic", between=[f"beam.{name}", name], axis="x")
    model.add_driver("stroke", joint="driven", stroke="0.3*sin(3*t)")
    model.add_force(
        "stop", "translational-stop", joint="loose", lower=-0.05, upper=0.05, stiffness=2e4,
        damping=20, depth=1e-3,
    )  # fmt: skip
    return model


@pytest.mark.parametrize("method", ["generalized-alpha", "radau", "explicit-rk"])
@pytest.mark.parametrize("origin", [[0, 0, 0], [1000, -300, 500]], ids=["near", "1 km away"])
def test_short_steps_at_a_stop_leave_no_noise_in_the_work_of_drivers(method, origin):
    """What a long step leaves of the constraints is not divided by a short one and its square.

    It made 16 to 88 % of the energy by generalized-alpha, with a note that effects make energy.
    """
    model = rocker(origin)
    model.set_dynamics(duration=3.0, accuracy=1e-3, outputs=300, method=method)
    outcome = dynamics(compile_system(model), model, Memory())
    assert outcome.statistics["events"] == 16
    assert outcome.statistics["energy_balance_error"] < 1e-3
    assert not [note for note in outcome.notes if "energy" in note]
