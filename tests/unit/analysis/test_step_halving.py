"""The error of fixed steps, measured by half steps, beside the true one of known motions."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from accuracyscenes import AWAY, SCENES, beside_a_large_motion, moved, truth_of
from accuracyscenes.judging import judged
from truthkit import Memory

import flexmb
from flexmb.analysis.dynamics import step_halving
from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.engine.compile import compile_system
from flexmb.model import Model
from flexmb.results.run_summary import summary_sentence, work_rows

METHODS = {  # steps that leave more than round-off, options
    "generalized-alpha": (1000, {}),
    "hht": (1000, {}),
    "trapezoidal": (1000, {}),
    "newmark of order 1": (4000, {"method": "newmark", "gamma": 0.6}),
    "radau": (200, {}),
    "explicit-rk": (100, {}),
    "order 5": (200, {"method": "explicit-rk", "order": 5}),
    "baumgarte": (100, {}),
    "coordinate-partitioning": (100, {}),
}
VARIANTS = {
    "plain": (lambda scene: scene.make(1.0), {}),
    "moved": (lambda scene: moved(scene.make(1.0)), {"away": AWAY}),
    "um": (lambda scene: scene.make(1e-6), {"size": 1e-6}),
    "beside": (lambda scene: beside_a_large_motion(scene.make(1.0)), {}),
}


@functools.cache
def truth(name, duration, outputs, size=1.0, away=(0.0, 0.0, 0.0)):
    """Channels (outputs + 1,) of a scene, by name."""
    return truth_of(SCENES[name], np.linspace(0.0, duration, outputs + 1), size, away)


def of_steps(name, n, variant="plain", **knobs):
    """A scene judged with n fixed steps and half steps beside them."""
    scene, (make, changes) = SCENES[name], VARIANTS[variant]
    knobs = {"outputs": scene.outputs, "step": scene.duration / n, "verify": True} | knobs
    known = lambda t: truth(name, scene.duration, len(t) - 1, **changes)  # noqa: E731
    found = judged(make(scene), known, duration=scene.duration, **knobs)
    assert not found.message
    return found


@pytest.mark.parametrize("scene", ["double pendulum", "spatial slider-crank", "top", "oscillator"])
@pytest.mark.parametrize("method", METHODS)
def test_the_error_of_smooth_motions_is_known_to_a_tenth(scene, method):
    """By the order of the method, of errors of 7 % to 6e-11."""
    steps, options = METHODS[method]
    found = of_steps(scene, steps, **{"method": method, **options})
    assert found.share == pytest.approx(1.0, abs=0.1)
    assert found.statistics["comparison_steps"] == 2 * found.statistics["steps"]


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(
    "scene", ["pendulum", "spatial slider-crank", "free top", "pendulum hit from rest"]
)
def test_the_error_does_not_depend_on_where_and_how_large_a_scene_is(scene, variant):
    found = of_steps(scene, 1000, variant)
    assert found.share == pytest.approx(1.0, abs=0.1)


EVENTFUL = (
    "mass between stops", "pendulum against a stop", "backlash", "bouncing ball", "limited rate",
    "shaken against dry drag",
)  # fmt: skip


@pytest.mark.parametrize("scene", EVENTFUL)
def test_events_within_steps_leave_the_first_order(scene):
    """How far an error falls depends on where events are in a step: it is told rather too large."""
    assert 0.8 < of_steps(scene, 2000).share < 3


@pytest.mark.parametrize("outputs", [1, 7, 997])
def test_rows_are_those_of_the_steps_asked_for(outputs):
    """To the last bit, however many there are."""

    def rows(**knobs):
        model, sink = SCENES["double pendulum"].make(1.0), Memory()
        model.set_dynamics(duration=2.0, outputs=outputs, step=0.002, **knobs)
        outcome = dynamics(compile_system(model), model, sink)
        return sink.tables(), outcome.statistics

    (alone, without), (compared, with_half) = rows(), rows(verify=True)
    for one, other in zip(alone, compared, strict=True):
        np.testing.assert_array_equal(one, other)
    assert without["steps"] == with_half["steps"] == with_half["comparison_steps"] / 2
    assert not [name for name in without if name.startswith("measured")]


@pytest.mark.parametrize("outputs", [1, 2, [0.37, 1.3, 2.0], 997])
def test_few_and_odd_outputs_are_compared_too(outputs):
    """Over the peak-to-peak of the whole motion, which one row at the end does not show."""
    scene = SCENES["oscillator"]
    size = np.ptp(truth("oscillator", scene.duration, 1000)["p0.x"])

    def ran(step, **knobs):
        model, sink = scene.make(1.0), Memory()
        model.set_dynamics(duration=2.0, outputs=outputs, step=step, **knobs)
        made = compile_system(model)
        outcome = dynamics(made, model, sink)
        at = made.layout.channels.index("p0.x")
        return sink.tables()[-3][:, at], outcome.statistics.get("measured_error_of_positions")

    (rows, told), (known, _) = ran(0.004, verify=True), ran(4e-5)
    whole = np.ptp(ran(4e-5)[0]) if outputs == 997 else size
    assert told == pytest.approx(np.abs(rows - known).max() / whole, rel=0.35)


def test_steps_that_fail_leave_the_error_unknown():
    """Both runs divide them until they are the same: their difference would say nothing."""
    found = of_steps("long pendulum", 100, method="radau")
    assert found.achieved > 0.5 and np.isnan(found.told)
    assert found.statistics["failed_steps"] == 100
    (note,) = [note for note in found.notes if "no error is measured" in note]
    assert note.startswith("100 steps of ") and "shorten dynamics.step" in note
    ((_, value, why),) = [row for row in work_rows(found.statistics) if "error of" in row[0]]
    assert value == "not measured" and "are those of the run" in why


def test_half_steps_that_fail_are_told(monkeypatch):
    """The run itself is not lost; its error is not known, least of all 0."""
    integrate = step_halving.Integration.integrate

    def fails(self, steps):
        status = integrate(self, steps)
        halved = self.settings.step < 0.0015
        return 1 if halved and self.state.t[0] > 1.0 else status

    monkeypatch.setattr(step_halving.Integration, "integrate", fails)
    model, sink = SCENES["pendulum"].make(1.0), Memory()
    model.set_dynamics(duration=2.0, outputs=100, step=0.002, verify=True)
    outcome = dynamics(compile_system(model), model, sink)
    assert outcome.status == "finished" and len(sink.tables()[0]) == 101
    assert any("half steps, which measure the error, failed at t = " in n for n in outcome.notes)
    assert not [name for name in outcome.statistics if name.startswith("measured")]


def test_the_summary_says_whether_the_error_is_known():
    model = Model("swing", gravity=[0, -9.81, 0])
    model.add_body("b", mass=1, center=[0.5, 0, 0], inertia=[0.01, 0.1, 0.1])
    model.add_joint("pin", "revolute", between=["ground", "b"], axis="z")
    model.set_dynamics(duration=1.0, step=0.01, outputs=100)
    plain = flexmb.simulate(model)
    assert "error not measured" in summary_sentence(plain.statistics)
    ((_, value, how),) = [r for r in work_rows(plain.statistics) if r[0] == "error of positions"]
    assert value == "not measured" and "verify = true measures it" in how
    model.set_dynamics(duration=1.0, step=0.01, outputs=100, verify=True)
    measured = flexmb.simulate(model)
    assert "measured error" in summary_sentence(measured.statistics)
    names = [row[0] for row in work_rows(measured.statistics)]
    assert {"error of positions", "error of velocities", "error of reactions"} <= {*names}
