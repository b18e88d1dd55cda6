"""What is wrong with a model is told before anything is compiled for it."""

from __future__ import annotations

import pytest
from coldcache import WouldCompile, cold_cache  # noqa: F401  a fixture
from mechanisms import crank_slider, four_bar, quick_return

import flexmb
from flexmb.analysis import chunked_run
from flexmb.analysis.dynamics.dynamics import prepare_dynamics
from flexmb.analysis.kinematics import prepare_kinematics
from flexmb.engine.compile import compile_system
from flexmb.engine.jit import UNITS
from flexmb.errors import AssemblyError

pytestmark = pytest.mark.usefixtures("cold_cache")


def out_of_reach():
    model = quick_return("B")
    model.add_driver("push", joint="ram_guide", stroke="2 + t")
    return model


WRONG = {
    "locked": (lambda: four_bar(tilt=0.2, driven=True), "the mechanism is locked"),
    "not closed": (out_of_reach, "it is out of reach"),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("analysis", ["dynamics", "kinematics"])
def test_a_model_that_cannot_move_is_refused_before_compiling(name, analysis):
    make, sentence = WRONG[name]
    model = make()
    start = {"dynamics": prepare_dynamics, "kinematics": prepare_kinematics}[analysis]
    getattr(model, f"set_{analysis}")(duration=1.0)
    with pytest.raises(AssemblyError, match=sentence):
        start(compile_system(model), model)


def test_simulate_tells_it_too(tmp_path):
    with pytest.raises(AssemblyError, match="the mechanism is locked"):
        flexmb.simulate(four_bar(tilt=0.2, driven=True), output=tmp_path, duration=1.0)


def test_motions_that_nothing_drives_are_told_before_compiling():
    model = crank_slider("RSUT")
    model.set_kinematics(duration=1.0)
    with pytest.raises(AssemblyError, match="leave 1 motion free"):
        prepare_kinematics(compile_system(model), model)


def test_a_good_model_is_compiled():
    model = crank_slider("RSUT", driven=True)
    model.set_dynamics(duration=1.0)
    with pytest.raises(WouldCompile):
        prepare_dynamics(compile_system(model), model)


@pytest.mark.parametrize("limit", ["_MAX_COORDINATES", "_MAX_MODES_SQUARED"])
def test_a_large_model_is_compiled_at_once(monkeypatch, limit):
    monkeypatch.setattr(chunked_run, limit, -1)
    model = out_of_reach()
    model.set_dynamics(duration=1.0)
    with pytest.raises(WouldCompile):
        prepare_dynamics(compile_system(model), model)


def test_what_fails_in_python_only_is_left_to_compiled_code():
    """A division by zero raises in Python; machine code goes on with what is infinite."""

    def fails():
        return 1.0 / 0.0

    model = crank_slider("RSUT")
    chunked_run.precheck(compile_system(model), UNITS.values(), fails)


def test_nothing_is_tried_where_all_units_are_there():
    model = crank_slider("RSUT")
    chunked_run.precheck(compile_system(model), [], pytest.fail)


def test_mobility_needs_nothing_compiled():
    assert flexmb.mobility(crank_slider("RSUT")).delta == 1
