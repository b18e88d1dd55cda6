"""The loop over chunks: exact output times, states handed over whole, nothing lost at the end."""

from __future__ import annotations

import functools
import warnings
from pathlib import Path

import numpy as np
import pytest

import flexmb
from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.dynamics import integration as module
from flexmb.analysis.dynamics.dynamics import dynamics
from flexmb.analysis.dynamics.run_settings import loop_settings, time_grid
from flexmb.engine import compiled_units
from flexmb.engine.allocation import new_output, new_run, new_work
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import integrate, prepare_integration, solve_stage
from flexmb.engine.initial_conditions import VELOCITIES
from flexmb.engine.method import SUCCESS
from flexmb.engine.method_selection import make_integrator
from flexmb.engine.state import State
from flexmb.model import Model, load_scene
from flexmb.model.scenes.dynamics import DynamicsSpec

SCENE = Path(__file__).parents[3] / "cases" / "rigid_slider_crank" / "scene.toml"


class Kept:
    """A sink that remembers; it may interrupt the run at a chosen append."""

    def __init__(self, interrupt_at: int | None = None) -> None:
        self.blocks, self.states, self.interrupt_at = [], [], interrupt_at

    def append(self, block) -> None:
        self.blocks.append(block)
        if len(self.blocks) == self.interrupt_at:
            raise KeyboardInterrupt

    def save_state(self, state) -> None:
        self.states.append({name: array.copy() for name, array in state.items()})

    def restart(self) -> None:
        self.blocks.clear()

    def column(self, name: str) -> np.ndarray:
        return np.concatenate([getattr(block, name) for block in self.blocks])


@pytest.fixture(scope="module")
def model():
    return load_scene(SCENE, {"dynamics.outputs": "40"})


@pytest.fixture(scope="module")
def compiled(model):
    return compile_system(model)


def one_output(model, compiled) -> int:
    """Work of a chunk that makes it one output long."""
    grid = time_grid(model.dynamics)
    return round(grid.interval / grid.step) * compiled.layout.nv


def test_outputs_fall_on_steps_not_longer_than_asked():
    spec = DynamicsSpec(duration=1.0, step=0.03, outputs=10)
    grid = time_grid(spec)
    assert grid.interval == 0.1
    assert grid.step <= spec.step
    assert grid.step == pytest.approx(grid.interval / 4, rel=1e-15)


def test_a_step_that_fits_is_kept():
    grid = time_grid(DynamicsSpec(duration=0.3, step=0.1, outputs=1))
    assert (grid.interval, grid.step) == (0.3, pytest.approx(0.1, rel=1e-15))


def test_a_run_reports_all_outputs_and_a_state_per_chunk(model, compiled, monkeypatch):
    monkeypatch.setattr(module, "_CHUNK_WORK", one_output(model, compiled))
    prepare_integration(compiled.system, make_integrator(model.dynamics))
    loader = functools.cache(compiled_units._Loader)
    monkeypatch.setattr(compiled_units, "_loader", loader)  # nothing is loaded
    sink = Kept()
    phases = []
    outcome = dynamics(compiled, model, sink, progress=lambda *told: phases.append(told))
    assert outcome.status == "finished"
    times = sink.column("t")
    np.testing.assert_allclose(times, np.linspace(0, model.dynamics.duration, 41), atol=1e-12)
    assert len(sink.states) == 41
    assert [phase for phase, share, *_ in phases if share == 1.0] == [
        "load",
        "assemble",
        "integrate",
    ]


def test_a_state_is_complete(model, compiled, monkeypatch):
    """A run continued from a saved state repeats the uninterrupted one to the last bit."""
    monkeypatch.setattr(module, "_CHUNK_WORK", one_output(model, compiled))
    sink = Kept()
    dynamics(compiled, model, sink)
    grid = time_grid(model.dynamics)
    saved = sink.states[20]
    state = State(*(saved[name].copy() for name in State._fields))
    method = make_integrator(model.dynamics)
    work = new_work(compiled.system, len(compiled.layout.channels), method)
    output = new_output(compiled.system, 4, len(compiled.layout.channels))
    every = round(grid.interval / grid.step)
    settings = loop_settings(compiled, model.dynamics, method, determinate=True)
    run = new_run(compiled.system, state, work, method, settings, output=output)
    for chunk in range(20, 40):
        assert integrate(run, every) == SUCCESS
        block = sink.blocks[chunk + 1]
        for name in ("t", "q", "v", "vd", "lam", "sensors", "energy"):
            assert getattr(output, name)[:1].tobytes() == getattr(block, name).tobytes(), name
    for name, array in state._asdict().items():
        assert sink.states[40][name].tobytes() == array.tobytes(), name
    for name in State._fields:  # the start, for a run that is repeated more accurately
        assert sink.states[40][f"first_{name}"].tobytes() == sink.states[0][name].tobytes(), name


def test_chunks_do_not_wait_for_outputs(model, compiled, monkeypatch):
    """Progress, Ctrl-C and saved states come also within a long interval between outputs."""
    monkeypatch.setattr(module, "_CHUNK_WORK", one_output(model, compiled) // 5)
    sink = Kept()
    assert dynamics(compiled, model, sink).status == "finished"
    assert len(sink.states) == 5 * 40 + 1
    assert len(sink.column("t")) == 41


def test_an_interruption_keeps_what_there_is(model, compiled, monkeypatch):
    monkeypatch.setattr(module, "_CHUNK_WORK", one_output(model, compiled))
    outcome = dynamics(compiled, model, Kept(interrupt_at=5))
    assert outcome.status == "stopped"
    assert "stopped by the user at t = " in outcome.message


def test_a_first_state_satisfies_the_constraints(model, compiled):
    first = assemble(compiled, model)
    assert np.abs(first.work.con.C).max() < 1e-13 * compiled.length
    solve_stage(compiled.system, first.state, first.work, VELOCITIES)  # keeps how far v was off
    assert first.work.con.drift[0] < 1e-12 * np.abs(first.state.v).max()
    assert np.isfinite(first.state.lam).all()


@pytest.mark.parametrize("rows", [400, 8])
@pytest.mark.parametrize(
    "load",
    [{"type": "step", "t0": t, "t1": t + 1e-4, "y0": 0.0, "y1": 100.0} for t in (0.1, 0.0983)]
    + [f"1000*exp(-((t - {t})/0.0008)**2)" for t in (0.1, 0.0967)],
)
def test_a_load_that_jumps_or_strikes_does_not_alternate(rows, load):
    """At outputs at every step the second differences about it were taken for ringing."""
    made = Model("three rods", gravity=[0, -9.81, 0])
    for k, before in enumerate(("ground", "b0.out", "b1.out")):
        made.add_body(f"b{k}", mass=1, inertia=[0.02] * 3, position=[0.5 * k + 0.25, 0, 0])
        made.add_marker(f"b{k}.in", position=[-0.25, 0, 0])
        made.add_marker(f"b{k}.out", position=[0.25, 0, 0])
        made.add_joint(f"pin{k}", "revolute", between=[before, f"b{k}.in"], axis="z")
    made.add_force("blow", "force", at="b1", value=[0, load, 0])
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        flexmb.simulate(made, duration=0.4, outputs=rows, method="generalized-alpha",
                        accuracy=None, step=1e-3)  # fmt: skip
    assert not [str(one.message) for one in messages if "alternates" in str(one.message)]
