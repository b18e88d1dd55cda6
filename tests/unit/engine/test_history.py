"""History of the elements: written at accepted steps only, part of the state, free where unused."""

from __future__ import annotations

import numpy as np
from enginekit import Bench

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.run_settings import loop_settings
from flexmb.engine.allocation import new_state
from flexmb.engine.compile import compile_system
from flexmb.engine.forces.bristle import FREE
from flexmb.engine.method import SUCCESS
from flexmb.engine.method_selection import make_integrator
from flexmb.engine.state import State
from flexmb.model import Model


def scene():
    """A ball that falls onto a floor with friction, beside a block on a guide that rubs."""
    model = Model("ball", gravity=[1.0, 0, -9.81])
    model.add_body("ball", mass=1, inertia=[4e-3] * 3, position=[0, 0, 0.102])
    model.add_body("block", mass=1, inertia=[4e-3] * 3)
    model.add_force(
        "floor", "contact", between=["ball", "ground"], stiffness=1e6, restitution=0.6,
        shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}],
        friction={"static": 0.4, "dynamic": 0.3, "stiffness": 1e5},
    )  # fmt: skip
    model.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    model.add_force("rub", "joint-friction", joint="guide", dynamic=0.05, stiffness=1e5)
    model.set_dynamics(duration=0.05, outputs=10, accuracy=1e-3)
    return model


def test_a_resumed_run_goes_on_to_the_bit():
    """Chunk by chunk from copies of the saved state, and without a break.

    The ball hits the floor at 20 ms; at least one border lies in the contact.
    """
    model = scene()
    compiled, spec = compile_system(model), model.dynamics
    settings = loop_settings(compiled, spec, make_integrator(spec), False)

    def fresh(state):
        copy = State(*(np.array(part) for part in state))
        return Integration(compiled, make_integrator(spec), settings, copy)

    first = assemble(compiled, model).state
    whole, part = fresh(first), fresh(first)
    history = []
    while not whole.finished:
        assert whole.integrate(25) == SUCCESS
        assert part.integrate(25) == SUCCESS
        part = fresh(part.state)
        history.append(np.array(whole.state.history))
    for name, value in whole.state._asdict().items():
        np.testing.assert_array_equal(value, getattr(part.state, name), err_msg=name)
    history = np.array(history)
    assert set(history[:, 2]) > {0.0}  # open at some borders, sticking or sliding at others
    assert np.ptp(history[:, 1]) > 0.0


def test_without_contact_and_friction_there_is_no_history():
    model = Model("free")
    model.add_body("body", mass=1, inertia=[1, 1, 1])
    system = compile_system(model).system
    assert not {"contacts", "joint_frictions"} & set(system.kinds)
    assert new_state(system).history.size == 0


def test_evaluation_leaves_the_history_alone():
    model = Model("touching")
    model.add_body("body", mass=1, inertia=[1, 1, 1], position=[0, 0, 0.99])
    model.add_force(
        "floor", "contact", between=["body", "ground"], stiffness=1e3,
        shapes=[{"type": "sphere", "radius": 1.0}, {"type": "plane"}],
        friction={"dynamic": 0.3, "stiffness": 1e3},
    )  # fmt: skip
    bench = Bench(model)
    bench.v[:3] = 1.0, 2.0, -3.0
    history, row = bench.work.now.history, bench.sys.kinds["contacts"].rows[0]
    history[:] = 0.0
    history[0], history[row["history"]] = -0.1, 3.0
    history[row["bristle"] : row["bristle"] + 2] = FREE, 1e-3
    bench.state.history[:] = history
    first = bench.at().residual
    assert np.abs(first).max() > 1.0
    np.testing.assert_array_equal(bench.at().residual, first)
    np.testing.assert_array_equal(bench.work.now.history, bench.state.history)
