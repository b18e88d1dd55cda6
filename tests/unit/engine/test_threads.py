"""One compiled model in the hands of several threads: what a run writes belongs to that run."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from flexiblescenes import rod
from truthkit import Memory

from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.engine.compile import compile_system, fingerprint
from flexmb.engine.kind_registry import KINDS
from flexmb.flexbody import MembraneStiffness
from flexmb.model import Model


def scene():
    """All that needs scratch: bushing, law, contact, friction in a joint, a quasi-static body, and
    one with membrane forces."""
    made = Model("shared", gravity=[0.3, 0.1, -9.81])
    for k, name in enumerate("abc"):
        made.add_body(
            name, mass=1.0 + k, inertia=[0.02, 0.03, 0.04], position=[0.5 * k, 0.0, 0.0],
            angular_velocity=[0.2, 1.0, 0.1 * k] if k else None,
        )  # fmt: skip
    made.add_marker("ground.floor", position=[0, 0, -0.15])
    made.add_joint("pin", "revolute", between=["ground", "a"], axis="y")
    made.add_force("rub", "joint-friction", joint="pin", radius=0.05, length=0.1, dynamic=0.2,
                   stiffness=1e4)  # fmt: skip
    made.add_force("bush", "bushing", between=["a", "b"], stiffness=2e3, rotational_stiffness=20.0,
                   damping=3.0, rotational_damping=0.1, free="placed")  # fmt: skip
    made.add_force("law", "spring-damper", between=["b", "c"], spring_force="800*(x - 0.5)",
                   damping=5.0)  # fmt: skip
    for name in "bc":
        made.add_force(
            f"touch_{name}", "contact", between=["ground.floor", name], stiffness=1e5,
            shapes=[{"type": "plane"}, {"type": "sphere", "radius": 0.1}], restitution=0.4,
            friction={"dynamic": 0.3, "stiffness": 1e4},
        )  # fmt: skip
    made.add_body("rod", rod(0.01, modes=2), position=[0, 2.0, 0], deformation="quasi-static")
    made.add_marker("ground.hinge", position=[0, 2.0, 0])
    made.add_joint("hinge", "revolute", between=["ground.hinge", "rod.root"], axis="y")
    leaf = rod(0.01, modes=2)
    stretching = MembraneStiffness(np.eye(2, leaf.m), np.zeros((leaf.m, 3)), np.eye(3))
    leaf = replace(leaf, membrane_stiffness=stretching)
    made.add_body("leaf", leaf, position=[0, 4.0, 0], membrane_forces="full")
    made.add_marker("ground.leaf", position=[0, 4.0, 0])
    made.add_joint("leaf", "revolute", between=["ground.leaf", "leaf.root"], axis="y")
    made.set_dynamics(duration=0.2, step=2e-4, outputs=20, method="generalized-alpha")
    return made


def rows(compiled, model):
    memory = Memory()
    outcome = dynamics(compiled, model, memory)
    assert outcome.status == "finished", outcome.message
    return memory.tables()


@pytest.fixture(scope="module")
def shared():
    model = scene()
    return compile_system(model), model


def test_the_scene_holds_all_kinds_with_scratch(shared):
    compiled, _ = shared
    assert {kind.name for kind in KINDS if kind.scratch is not None} <= set(compiled.system.kinds)


@pytest.mark.seconds
def test_two_threads_run_one_system_at_the_same_time(shared):
    compiled, model = shared
    alone = rows(compiled, model)
    assert np.ptp(alone[1], axis=0).max() > 0.05  # it moves
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda _: rows(compiled, model), range(4)))
    for found in together:
        for mine, wanted in zip(found, alone, strict=True):
            np.testing.assert_array_equal(mine, wanted)


def test_a_run_leaves_the_tables_as_they_are(shared):
    compiled, model = shared
    rows(compiled, model)
    assert fingerprint(compiled.system) == compiled.layout.fingerprint
