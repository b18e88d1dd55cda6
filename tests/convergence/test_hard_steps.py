"""Where a step is hard: bodies of hardly any inertia, singular poses, jumps, sub-steps."""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import AWAY, SCENES, moved, truth_of
from accuracyscenes.control import staircase, staircase_truth
from accuracyscenes.judging import judged
from truthkit import run

from flexmb.engine.compiled_units import interpretation
from flexmb.model import Model


def pendulums(inertia):
    """Two links with all their mass in points; without inertia of their own the motion exists."""
    made = Model("double pendulum", gravity=[0, -9.81, 0])
    for k in range(2):
        made.add_body(f"b{k}", mass=1, center=[1, 0, 0], inertia=[inertia] * 3, position=[k, 0, 0])
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "revolute", between=ends, axis="z")
        made.add_sensor(f"end{k}", "position", of=f"b{k}.end")
    return made


@pytest.mark.parametrize("inertia", [1e-4, 1e-8, 1e-12])
@pytest.mark.parametrize(
    "knobs",
    [pytest.param({"step": 1e-3}, id="fixed", marks=pytest.mark.slow),
     pytest.param({"accuracy": 1e-4}, id="controlled")],
)  # fmt: skip
def test_bodies_of_hardly_any_inertia(inertia, knobs):
    """Energy is kept, and the motion is that of point masses."""
    found = run(pendulums(inertia), duration=1.0, outputs=20, **knobs)
    energy = found.energy[:, :3].sum(axis=1)
    assert np.abs(energy - energy[0]).max() < 2e-3 * np.ptp(found.energy[:, 0])
    exact = run(pendulums(1e-12), duration=1.0, outputs=20, accuracy=1e-7, method="explicit-rk")
    assert np.abs(found.sensors - exact.sensors).max() < 5e-3 + 2 * inertia


def four_bar():
    """A parallelogram that turns through its flat pose, where it could fold; redundant in space."""
    made = Model("four-bar")
    for name, at, end, center in (
        ("a", [0, 0, 0], [0, 1, 0], [0, 0.5, 0]),
        ("b", [0, 1, 0], [2, 0, 0], [1, 0, 0]),
        ("c", [2, 0, 0], [0, 1, 0], [0, 0.5, 0]),
    ):
        spin = {"angular_velocity": [0, 0, 3.0]} if name == "a" else {}
        made.add_body(name, mass=1, inertia=[0.1] * 3, center=center, position=at,
                      markers={"end": {"position": end}}, **spin)  # fmt: skip
    made.add_marker("ground.right", position=[2, 0, 0])
    for name, ends in (
        ("left", ["ground", "a"]),
        ("top", ["a.end", "b"]),
        ("corner", ["c.end", "b.end"]),
        ("right", ["ground.right", "c"]),
    ):
        made.add_joint(name, "revolute", between=ends, axis="z")
    made.add_sensor("end", "position", of="a.end")
    return made


@pytest.mark.parametrize(
    "knobs",
    [{"step": 1e-3}, {"step": 7e-3}, {"step": 1e-3, "newton_tolerance": 1e-6}, {"accuracy": 1e-4}],
)
def test_a_loop_runs_through_its_flat_pose(knobs):
    """Two turns of constant kinetic energy: nothing acts on the linkage."""
    found = run(four_bar(), duration=5.0, outputs=100, **knobs)
    kinetic = found.energy[:, 0]
    assert np.ptp(kinetic) < 1e-3 * kinetic[0]
    assert found.drift[:, 0].max() < 1e-9
    turn = np.unwrap(np.arctan2(found["end.y"], found["end.x"]))
    assert turn[-1] - turn[0] > 4 * np.pi


def test_a_failed_fixed_step_is_made_in_parts():
    """Far too long a step: Newton's method fails, smaller ones lead on to the next grid point."""
    found = run(pendulums(1e-4), duration=2.0, outputs=10, step=0.2)
    assert found.statistics["failed_steps"] > 0
    assert found.statistics["steps"] > 10  # on a grid of 10
    np.testing.assert_allclose(found.t, np.linspace(0, 2, 11), rtol=0, atol=1e-14)
    assert found.drift[:, 0].max() < 1e-7


def error_of(name, method, steps, away=AWAY):
    """Over the peak-to-peak, with so many fixed steps, a kilometre from the origin."""
    scene = SCENES[name]
    model = moved(scene.make(1.0), away)
    knobs = {"duration": scene.duration, "outputs": scene.outputs, "method": method}
    found = judged(model, lambda t: truth_of(scene, t, away=away),
                   step=scene.duration / steps, **knobs)  # fmt: skip
    assert not found.message
    return found.achieved


SKEW = ("skew body on a cross", "skew body on a spring")


@pytest.mark.seconds
@pytest.mark.parametrize("name", [pytest.param(SKEW[0], marks=pytest.mark.slow), SKEW[1]])
def test_what_newton_leaves_in_short_steps_does_not_add_up(name):
    """Below the last places of positions too: that was 2e-5 to 4e-5 here, more with each step."""
    assert error_of(name, "radau", 40_000) < 1e-7


@pytest.mark.parametrize("name", SKEW)
def test_the_order_of_generalized_alpha_holds_for_short_steps(name):
    coarse, fine = (error_of(name, "generalized-alpha", n) for n in (20_000, 160_000))
    assert fine < coarse / 40, (coarse, fine)  # a hundred: 64 less round-off


def test_stages_are_predicted_as_rotation_vectors():
    """One correction is enough in short steps, as of a body that does not turn."""
    scene = SCENES["skew body on a spring"]
    knobs = {"duration": 0.02, "step": 5e-4, "outputs": 2, "method": "radau"}
    with interpretation():
        found = run(scene.make(1.0), **knobs)
    assert found.statistics["residual_evaluations"] <= 3 * 1.5 * found.statistics["steps"]


@pytest.mark.parametrize("within", [1e-10, 1e-8, 1e-7, 1e-6])
@pytest.mark.parametrize("asked", [1e-3, 1e-5, 1e-7])
def test_a_reference_that_is_held_and_changes_however_fast(within, asked):
    """Polynomials of the step across the change are not extended over the next ones."""
    knobs = {"duration": 5.0, "outputs": 50, "accuracy": asked, "method": "radau"}
    found = judged(staircase(within)(1.0), staircase_truth, **knobs)
    assert not found.message
    assert found.achieved < 2 * asked + 5 * within  # each change comes half that time later
