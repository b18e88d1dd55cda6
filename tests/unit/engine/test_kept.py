"""Memory of the elements: written at accepted steps only, part of the state, free where unused."""

from __future__ import annotations

import numpy as np
from enginekit import Bench, interpreted

from flexmb.engine.compile import compile_system
from flexmb.engine.work import new_state
from flexmb.model import Model

SCENE = """
from flexmb.model import Model
from flexmb.analysis.assembly.analysis import assemble
from flexmb.analysis.dynamics.settings import chosen_method, loop_settings, time_grid
from flexmb.analysis.dynamics.run import Run
from flexmb.engine.compile import compile_system
from flexmb.engine.state import State

model = Model("ball", gravity=[1.0, 0, -9.81])
model.add_body("ball", mass=1, inertia=[4e-3] * 3, position=[0, 0, 0.102])
model.add_body("block", mass=1, inertia=[4e-3] * 3)
model.add_force(
    "floor", "contact", between=["ball", "ground"], stiffness=1e6, restitution=0.6,
    shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}],
    friction={"static": 0.4, "dynamic": 0.3, "stiffness": 1e5},
)
model.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
model.add_force("rub", "joint-friction", joint="guide", dynamic=0.05, stiffness=1e5)
model.set_dynamics(duration=0.05, outputs=10, accuracy=1e-3)
compiled = compile_system(model)
"""


def test_a_resumed_run_goes_on_to_the_bit(tmp_path):
    """Chunk by chunk from copies of the saved state, and without a break.

    The ball hits the floor at 20 ms; at least one border lies in the contact.
    """
    code = SCENE + (
        "spec = model.dynamics\n"
        "settings = loop_settings(compiled, spec, time_grid(spec), False)\n"
        "def fresh(state):\n"
        "    return Run(compiled, chosen_method(spec), settings, state)\n"
        "def copy(state):\n"
        "    return State(*(np.array(part) for part in state))\n"
        "first = assemble(compiled, model).state\n"
        "whole, part = fresh(copy(first)), fresh(copy(first))\n"
        "modes = []\n"
        "while not whole.finished:\n"
        "    assert whole.march(25) == 0\n"
        "    assert part.march(25) == 0\n"
        "    part = fresh(copy(part.state))\n"
        "    modes.append(np.array(whole.state.kept))\n"
        "for name, value in whole.state._asdict().items():\n"
        "    found['a_' + name], found['b_' + name] = value, getattr(part.state, name)\n"
        "found['kept'] = np.array(modes)\n"
    )
    found = interpreted(code, tmp_path)
    for name in found:
        if name.startswith("a_"):
            np.testing.assert_array_equal(found[name], found["b_" + name[2:]], err_msg=name)
    kept = found["kept"]
    assert set(kept[:, 2]) > {0.0}  # open at some borders, sticking or sliding at others
    assert np.ptp(kept[:, 1]) > 0.0


def test_without_contact_and_friction_there_is_no_memory():
    model = Model("free")
    model.add_body("body", mass=1, inertia=[1, 1, 1])
    system = compile_system(model).system
    assert system.contacts is None
    assert system.frictions is None
    assert new_state(system).kept.size == 0


def test_evaluation_leaves_the_memory_alone():
    model = Model("touching")
    model.add_body("body", mass=1, inertia=[1, 1, 1], position=[0, 0, 0.99])
    model.add_force(
        "floor", "contact", between=["body", "ground"], stiffness=1e3,
        shapes=[{"type": "sphere", "radius": 1.0}, {"type": "plane"}],
        friction={"dynamic": 0.3, "stiffness": 1e3},
    )  # fmt: skip
    bench = Bench(model)
    bench.v[:3] = 1.0, 2.0, -3.0
    bench.work.now.kept[:] = bench.state.kept[:] = -0.1, 3.0, 1.0, 1e-3, 0.0, 0.0
    first = bench.at().residual
    assert np.abs(first).max() > 1.0
    np.testing.assert_array_equal(bench.at().residual, first)
    np.testing.assert_array_equal(bench.work.now.kept, [-0.1, 3.0, 1.0, 1e-3, 0.0, 0.0])
