"""What touches for a fraction of a step is felt: stops at both bounds, joint friction at a turn."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from truthkit import Memory

from flexmb.analysis.dynamics.dynamics import dynamics, prepare_dynamics
from flexmb.engine.compile import compile_system
from flexmb.engine.events import _peak_share
from flexmb.engine.method import SUCCESS
from flexmb.model import Model

METHODS = ("explicit-rk", "radau", "generalized-alpha")


def thrown(bound, **stop):
    """A body thrown up at 1 m/s under 1 m/s²: it peaks at 0.5 m at t = 1 s."""
    model = Model("throw", gravity=[-1, 0, 0])
    model.add_body("b", mass=1, inertia=[1, 1, 1], velocity=[1, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    model.add_sensor("height", "position", of="b")
    model.add_force("limit", "translational-stop", joint="rail", **{bound: 0.5 - 1e-5}, **stop)
    return model


@pytest.mark.parametrize("method", METHODS)
def test_a_stop_is_felt_that_is_touched_for_a_hundredth_of_the_time_between_steps(method):
    """Polynomials of degree 2 are exact by every method: without an event no step would be short.

    It would be beyond the bound for 9 ms. The stop, of ω = 1000/s, sends it back with the speed u
    that it came with after (π − 2 atan(1/(ω u)))/ω = 2.7 ms, so that it falls earlier.
    """
    model = thrown("upper", stiffness=1e6)
    model.set_dynamics(duration=2.0, accuracy=1e-4, outputs=20, method=method)
    made, memory = compile_system(model), Memory()
    outcome = dynamics(made, model, memory)
    assert outcome.status == "finished", outcome.message
    assert outcome.statistics["events"] == 2
    u = np.sqrt(2e-5)
    early = 2 * u - (np.pi - 2 * np.arctan(1e-3 / u)) / 1e3
    assert memory.tables()[1][-1, 0] == pytest.approx(-early - early**2 / 2, abs=1e-4)
    assert outcome.statistics["steps"] < 1000


def swing(gap):
    """Ten swings of 0.5 m below a stop that is a gap beyond them, by the explicit method."""
    model = Model("swing")
    model.add_body("b", mass=1, inertia=[1, 1, 1], velocity=[0.5, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    model.add_sensor("x", "position", of="b")
    model.add_force("spring", "translational-spring-damper", joint="rail", stiffness=1.0)
    model.add_force("limit", "translational-stop", joint="rail", upper=0.5 + gap, stiffness=1e6)
    model.set_dynamics(
        duration=20 * np.pi, accuracy=1e-4, outputs=20, method="explicit-rk", verify=False
    )
    outcome = dynamics(compile_system(model), model, Memory())
    assert outcome.status == "finished" and "events" not in outcome.statistics
    return outcome.statistics["steps"]


@pytest.mark.parametrize("gap", [1e-7, 1e-5, 1e-4])
def test_what_nearly_touches_a_stop_costs_few_steps_a_time(gap):
    """An event that was to come and does not leaves no small steps behind."""
    assert swing(gap) < swing(1.0) + 10 * 8


@pytest.mark.parametrize("bound", ["upper", "lower"])
def test_both_bounds_are_watched(bound):
    """A swing from one bound to the other and back within a step, whichever is touched."""
    sign = 1.0 if bound == "upper" else -1.0
    model = Model("throw", gravity=[-sign, 0, 0])
    model.add_body("b", mass=1, inertia=[1, 1, 1], velocity=[sign, 0, 0])
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    bounds = {"upper": 0.6, "lower": -0.6, bound: sign * (0.5 - 1e-4)}
    model.add_force("limit", "translational-stop", joint="rail", stiffness=1e4, **bounds)
    model.set_dynamics(duration=2.0, accuracy=1e-4, outputs=20, verify=False)
    run = prepare_dynamics(compile_system(model), model).run
    assert run.integrate(10**6) == SUCCESS
    assert run.state.count[0]["events"] == 2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("model_of_friction", ["bristle", "smooth"])
def test_friction_is_felt_that_turns_within_a_step(method, model_of_friction):
    """A slider slows down, goes back for a moment and on again: its friction turns with it.

    The driver makes the speed (t − 1)² − 1e-4 m/s, below zero for 20 ms. The friction of 1 N does
    the work of −1 N over the way there and back.
    """
    smooth = {"model": "smooth", "creep_speed": 1e-5}
    fields = smooth if model_of_friction == "smooth" else {"stiffness": 1e7}
    model = Model("reversal")
    model.add_body("b", mass=1, inertia=[1, 1, 1])
    model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
    model.add_force("rub", "joint-friction", joint="rail", dynamic=1.0, preload=1.0, **fields)
    model.add_driver("pull", joint="rail", stroke="((t-1)**3 + 1)/3 - 1e-4*t")
    model.set_dynamics(duration=2.0, accuracy=1e-4, outputs=4, method=method, verify=False)
    run = prepare_dynamics(compile_system(model), model).run
    times = []
    while not run.finished:
        assert run.integrate(1) == SUCCESS
        times.append(run.state.t[0])
    assert np.abs(np.array(times) - 1.0).min() < 0.02
    way = 2 / 3 - 2e-4 + 4 * (4 / 3 * 1e-6)
    assert -run.state.work_done[1] == pytest.approx(way, rel=2e-3)


def test_smooth_friction_that_creeps_to_and_fro_asks_for_no_more_steps():
    """A block that swings more slowly than its friction creeps is nearly damped by μ N/v₀.

    Each turn of its speed was taken for a graze, which no shorter step gets rid of.
    """
    steps = []
    for damping, preload in ((2.0, 0.0), (0.0, 1.0)):
        model = Model("creep")
        model.add_body("b", mass=1, inertia=[1, 1, 1], position=[1e-3, 0, 0])
        model.add_joint("rail", "prismatic", between=["ground", "b"], axis="x")
        model.add_force("spring", "translational-spring-damper", joint="rail", stiffness=100,
                        damping=damping)  # fmt: skip
        if preload:
            model.add_force("rub", "joint-friction", joint="rail", dynamic=1.0, preload=preload,
                            model="smooth", creep_speed=0.5)  # fmt: skip
        model.set_dynamics(duration=5.0, accuracy=1e-4, outputs=10, verify=False)
        run = prepare_dynamics(compile_system(model), model).run
        assert run.integrate(10**5) == SUCCESS and run.finished
        steps.append(int(run.state.count[0]["steps"]))
    assert steps[1] < 1.5 * steps[0], steps


@pytest.mark.parametrize("accuracy", [1e-3, 1e-4, 1e-5])
def test_a_contact_that_opens_for_a_moment_is_felt_anew(accuracy):
    """A ball of coefficient 0.05 leaves the floor by 6 µm for 4 ms, and falls on it slowly.

    Within one step, pressed at both ends, it kept the damping of the first, a hundred times less.
    """
    model = Model("dead ball", gravity=[0, 0, -9.81])
    model.add_body("ball", mass=1, inertia=[4e-3] * 3, position=[0, 0, 0.5])
    model.add_force("floor", "contact", between=["ball", "ground"], stiffness=1e6, restitution=0.05,
                    shapes=[{"type": "sphere", "radius": 0.1}, {"type": "plane"}])  # fmt: skip
    model.set_dynamics(duration=0.4, accuracy=accuracy, outputs=10, verify=False)
    run = prepare_dynamics(compile_system(model), model).run
    assert run.integrate(10**5) == SUCCESS
    assert run.state.count[0]["events"] == 3


def test_the_peak_of_a_cubic_is_found():
    """s^3 - 1.8 s^2 + 0.81 s - 0.1 is above zero about its peak at 0.3, and below at both ends."""
    ends = [{"value": -0.1, "rate": 0.81}], [{"value": -0.09, "rate": 0.21}]
    events = SimpleNamespace(before=ends[0], now=ends[1])
    assert _peak_share(events, 0, 1.0) == pytest.approx(0.3)


def test_the_dip_of_a_cubic_is_found():
    """The same upside down; tangents alone, which most contacts at rest have, are none."""
    ends = [{"value": 0.1, "rate": -0.81}], [{"value": 0.09, "rate": -0.21}]
    events = SimpleNamespace(before=ends[0], now=ends[1])
    assert _peak_share(events, 0, 1.0) == pytest.approx(0.3)
    ends[0][0]["rate"], ends[1][0]["rate"] = -0.25, 0.25  # which meet below zero, the cubic not
    assert _peak_share(events, 0, 1.0) == 1.0
