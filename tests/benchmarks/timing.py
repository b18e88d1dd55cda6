"""Time of the compiled loop per step, and of whole runs in fresh processes."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.dynamics.dynamics import prepare_dynamics
from flexmb.engine import method
from flexmb.engine.allocation import new_output, new_run, new_work, output_run
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import integrate, prepare_integration
from flexmb.engine.compiled_units import packed_record
from flexmb.engine.integrators.generalized_alpha import generalized_alpha
from flexmb.results.writer import ResultWriter
from tests.benchmarks.models import chain_model

_ROOT = Path(__file__).parents[2]
_REPEATS = 5
_RUN = """
import sys, time
started = time.perf_counter()
from flexmb.workflow.simulate import run_scene
first = {}
def progress(phase, fraction, detail=""):
    first.setdefault(phase, time.perf_counter() - started)
report = run_scene(sys.argv[1], output=sys.argv[2], progress=progress)
print("total", time.perf_counter() - started)
print("start_of_the_loop", first["integrate"])
for name, value in report.statistics.items():
    if name.startswith("seconds_"):
        print(name, value)
"""


def per_step(model, compiled, h, count):
    """Median CPU time of a step [s] over several runs of `count` steps without output; Newton
    iterations and factorisations of a step."""
    chosen = generalized_alpha(0.8)
    first = assemble(compiled, model, start=model.dynamics.start).state
    tolerance = model.dynamics.newton_tolerance or 1e-8
    settings = method.Settings(
        0.0, count * h, count * h, h, 0.0, 0.0, 1.0, 1.0, 0.0, 1e-6, tolerance, 15, 1, 1, 0, 0
    )
    seconds, state = [], first
    for k in range(_REPEATS + 1):
        state = type(first)(*(array.copy() for array in first))
        channels = len(compiled.layout.channels)
        work = new_work(compiled.system, channels, chosen)
        out = new_output(compiled.system, 4, channels)
        run = new_run(compiled.system, state, work, chosen, settings, output=out)
        run, aside = packed_record(run), packed_record(output_run(run))
        begin = time.thread_time()  # without threads of BLAS, which wait for work in a loop
        status = integrate(run, 1 if k == 0 else count, aside)
        if k:  # the first loads or compiles the loop
            seconds.append((time.thread_time() - begin) / count)
        assert status == method.SUCCESS, (model, status, state.t)
    done = state.count[0]
    return median(seconds), done["residuals"] / count, done["factorisations"] / count


def set_up(n, joint="spherical", **fields):
    """CPU time [s] of all that comes before the time loop of a chain, by stage; kernels are there
    already."""
    stages, begin = {}, time.process_time()

    def lap(stage):
        nonlocal begin
        now = time.process_time()
        stages[stage], begin = now - begin, now

    model = chain_model(n, joint, **fields)
    lap("model")
    compiled = compile_system(model)
    lap("tables")
    prepare_integration(compiled.system, generalized_alpha(0.8))
    begin = time.process_time()
    prepare_dynamics(compiled, model)
    lap("first state")
    with tempfile.TemporaryDirectory() as folder:
        file, rows = Path(folder) / "result.h5", model.dynamics.outputs + 1
        with ResultWriter(file, compiled.layout, rows, scene=model.to_scene_dict()):
            lap("file")
    return stages


def control_overhead(model, compiled, accuracy):
    """CPU time of a step with error control, rejected ones included, over that of as many fixed
    steps with about as many iterations of Newton's method; steps, rejected ones, and iterations of
    a step in both."""
    chosen = generalized_alpha(0.8)
    first = assemble(compiled, model, start=model.dynamics.start).state
    duration, stiff = model.dynamics.duration, int(np.any(compiled.system.parts.bodies["m"] > 0))
    controlled = method.Settings(
        0.0,
        duration,
        duration,
        0.0,
        0.2 * accuracy**1.5,
        accuracy,
        1.0,
        1.0,
        0.0,
        1e-6,
        0.0,
        15,
        1,
        stiff,
        0,
        0,
    )
    ratios, iterations = [], np.zeros(2)
    for _ in range(_REPEATS + 1):
        seconds, state = _integrate(compiled, chosen, controlled, first)
        steps = int(state.count[0]["steps"])
        fixed = controlled._replace(
            step=duration / steps, tolerance=0.0, accuracy=0.0, newton_tolerance=1e-8
        )
        other, last = _integrate(compiled, chosen, fixed, first)
        ratios.append(seconds / other)
        iterations[:] = state.count[0]["residuals"], last.count[0]["residuals"]
    return median(ratios[1:]), steps, int(state.count[0]["rejected"]), iterations / steps


def _integrate(compiled, chosen, settings, first):
    """CPU time of a whole run from the first state, and the last one."""
    state = type(first)(*(array.copy() for array in first))
    channels = len(compiled.layout.channels)
    work = new_work(compiled.system, channels, chosen)
    out = new_output(compiled.system, 4, channels)
    run = new_run(compiled.system, state, work, chosen, settings, output=out)
    begin = time.process_time()
    status = integrate(run, 10**9)
    assert status == method.SUCCESS, (status, state.t)
    return time.process_time() - begin, state


def import_time():
    """Median wall time of `import flexmb` in a new interpreter, less that of an empty one [s]."""
    return median(_python("-c", "import flexmb") for _ in range(_REPEATS)) - median(
        _python("-c", "pass") for _ in range(_REPEATS)
    )


def whole_runs():
    """Phases [s] of the slider-crank case in new processes: fresh cache, then warm."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "FLEXMB_CACHE_DIR": f"{folder}/cache"}
        scene = _ROOT / "cases" / "slider_crank" / "scene.toml"
        return [_phases(scene, f"{folder}/out", environment) for _ in range(2)]


def _python(*arguments):
    begin = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, cwd=_ROOT)
    return time.perf_counter() - begin


def _phases(scene, output, environment):
    done = subprocess.run(
        [sys.executable, "-c", _RUN, str(scene), output],
        check=True, cwd=_ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    return {name: float(value) for name, value in map(str.split, done.stdout.splitlines())}
