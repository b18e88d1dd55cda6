"""Methods that cannot do a scene stop with the reason, and with the method that can."""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes.textbook import integrated
from truthkit import Memory, run

from flexmb.analysis.dynamics import integration as run_module
from flexmb.analysis.dynamics.dynamics import dynamics, prepare_dynamics
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_units import call
from flexmb.engine.integrators.coordinate_partitioning import choose_independent
from flexmb.engine.method import NO_PARTITION, SUCCESS
from flexmb.engine.status_messages import status_message
from flexmb.errors import SceneError
from flexmb.model import Model

EXPLICIT = ("explicit-rk", "baumgarte", "coordinate-partitioning")


def stiff_chain(stiffness=1e8):
    """Two links with a stiff spring that is stretched at first."""
    made = Model("stiff", gravity=[0, -9.81, 0])
    for k in range(2):
        made.add_body(f"b{k}", mass=1, center=[0.5, 0, 0], inertia=[0.01, 0.1, 0.1],
                      position=[k, 0, 0])  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        made.add_joint(f"j{k}", "revolute", between=[f"b{k - 1}.end" if k else "ground", f"b{k}"],
                       axis="z")  # fmt: skip
    made.add_marker("ground.high", position=[2, 2, 0])
    made.add_force("spring", "spring-damper", between=["ground.high", "b1.end"],
                   stiffness=stiffness, free_length=1.999)  # fmt: skip
    made.add_sensor("end", "position", of="b1.end")
    return made


def outcome(model, **knobs):
    model.set_dynamics(**knobs)
    return dynamics(compile_system(model), model, Memory())


@pytest.mark.parametrize("method", EXPLICIT)
def test_fixed_steps_beyond_stability(method):
    ended = outcome(stiff_chain(), duration=1.0, step=1e-2, outputs=10, method=method)
    assert ended.status == "failed"
    assert f"the step of 0.01 s is beyond the limit of stability of {method}" in ended.message
    assert 'method = "radau"' in ended.message
    done = outcome(stiff_chain(), duration=1.0, step=1e-2, outputs=10, method="radau")
    assert done.status == "finished"


@pytest.mark.parametrize("method", EXPLICIT)
def test_error_control_that_would_never_end(method, monkeypatch):
    """Stability of explicit methods allows steps of a microsecond, for an hour."""
    monkeypatch.setattr(run_module, "_CHECK_EVERY", 300)
    ended = outcome(stiff_chain(1e12), duration=3600.0, outputs=10, method=method, accuracy=1e-3)
    assert ended.status == "failed"
    assert "leave" in ended.message and "for the rest of the run" in ended.message
    assert ended.statistics["steps"] < 5000


def test_a_choice_of_coordinates_that_does_not_exist():
    """One more dependent coordinate than the constraints of this pose determine."""
    model = stiff_chain()
    model.set_dynamics(duration=1.0, step=1e-3, method="coordinate-partitioning")
    compiled = compile_system(model)
    run = prepare_dynamics(compiled, model).run
    packed, split = run._run, run.work.partition
    assert run.integrate(1) == SUCCESS
    assert split.free.sum() == split.rank[0] == 10  # of 12 coordinates
    split.rank[0] += 1
    assert call(choose_independent, packed, packed.record.state_point) == NO_PARTITION
    text = status_message(NO_PARTITION, compiled, run.work, 0.5)
    assert text.startswith("at t = 0.5 s no choice of independent coordinates")
    assert "explicit-rk" in text


@pytest.mark.parametrize("value", ["yes", "true", 1, 0, 1.0])
def test_true_and_false_alone_are_true_and_false(value):
    with pytest.raises(SceneError, match="dynamics.verify: true or false is expected"):
        Model("m").set_dynamics(duration=1.0, verify=value)


def parallelogram():
    """Two cranks of 0.5 m and a coupler of 1 m fall through the pose in which all lie flat."""
    made = Model("parallelogram", gravity=[0, -9.81, 0])
    for name, x in (("left", 0.0), ("right", 1.0)):
        made.add_marker(f"ground.{name}", position=[x, 0, 0])
        made.add_body(name, mass=1, center=[0.25, 0, 0], inertia=[0.02] * 3, position=[x, 0, 0],
                      orientation={"axis": "z", "angle": 1.0})  # fmt: skip
        made.add_marker(f"{name}.end", position=[0.5, 0, 0])
        made.add_joint(name, "revolute", between=[f"ground.{name}", name], axis="z")
    end = [0.5 * np.cos(1.0), 0.5 * np.sin(1.0), 0]
    made.add_body("coupler", mass=2, center=[0.5, 0, 0], inertia=[0.1] * 3, position=end)
    made.add_marker("coupler.end", position=[1, 0, 0])
    made.add_joint("pin", "revolute", between=["left.end", "coupler"], axis="z")
    made.add_joint("ball", "in-line", between=["coupler.end", "right.end"], axis="z")
    made.add_sensor("end", "position", of="coupler.end")
    return made


@pytest.mark.slow
def test_a_method_that_stops_at_a_singular_pose_names_one_that_gets_through():
    """m r² ẅ of all by the angle of a crank: the coupler moves along a circle without turning."""
    knobs = {"duration": 1.0, "outputs": 20, "accuracy": 1e-6}
    made = parallelogram()
    made.set_dynamics(method="coordinate-partitioning", **knobs)
    stopped = dynamics(compile_system(made), made, Memory())
    assert stopped.status == "failed" and 'method = "radau" gets through' in stopped.message
    passed = run(parallelogram(), method="radau", **knobs)
    inertia, weight = 2 * (0.02 + 0.25**2) + 2 * 0.5**2, 9.81 * (2 * 0.25 + 2 * 0.5)
    y = integrated(
        lambda _, y: [y[1], -weight * np.cos(y[0]) / inertia], [1.0, 0.0], passed.t
    )[0]  # fmt: skip
    assert y[-1] < -0.5  # far behind the flat pose
    np.testing.assert_allclose(passed["end.y"], 0.5 * np.sin(y), rtol=0, atol=2e-6)
