"""Stops are events of the step control: a step ends where one begins to push, and where it ends.

A body of 1 kg flies at 1 m/s into a stop of stiffness k at 0.1 m: it touches at t = 0.1 s, stays
for π/√k and leaves with the speed it came with.
"""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import interpreted

K = 4e4
CODE = f"""
from truthkit import Memory
from flexmb.analysis.dynamics.analysis import dynamics
from flexmb.engine import march
from flexmb.engine.compile import compile_system
from flexmb.model import Model

times = []
accepted = march._accept
def keep(sys, settings, st, wk, h):
    times.append(wk.trial.t[0])
    accepted(sys, settings, st, wk, h)
march._accept = keep

for name, force, fields in (
    ("line", "stop", dict(between=["ground", "b.eye"], axis="x")),
    ("joint", "translational-stop", dict(joint="rail")),
):
    model = Model(name)
    model.add_body("b", mass=1, inertia=[1, 1, 1], velocity=[1, 0, 0])
    model.add_marker("b.eye", position=[0, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    model.add_force("buffer", force, upper=0.1, stiffness={K}, **fields)
    model.set_dynamics(duration=0.2, accuracy=1e-4, outputs=10)
    times.clear()
    memory, made = Memory(), compile_system(model)
    outcome = dynamics(made, model, memory)
    assert outcome.status == "finished", outcome.message
    found[name] = np.array(times)
    found[name + ".events"] = outcome.statistics["events"]
    found[name + ".speed"] = memory.tables()[2][-1, 0]
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return interpreted(CODE, tmp_path_factory.mktemp("stops"))


@pytest.mark.parametrize("name", ["line", "joint"])
def test_steps_end_where_a_stop_begins_and_ends_to_push(found, name):
    """Aimed at 1 % beyond the crossing of a step that is cut: 1e-3 of the time until then."""
    assert found[name + ".events"] == 2
    for moment in (0.1, 0.1 + np.pi / np.sqrt(K)):
        assert np.abs(found[name] - moment).min() < 1e-4
    assert found[name + ".speed"] == pytest.approx(-1.0, abs=1e-3)
