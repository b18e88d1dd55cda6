"""Compiled units: never stale, never compiled for a combination, compiled by one of many."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from coldcache import MOVE, SOLVE, empty_cache  # noqa: F401  a fixture
from enginekit import STAGES, Bench, interpreted
from generators import Mechanism

from flexmb.engine import compiled_units, compiler_pool, function, unit_cache
from flexmb.engine.algebra import ldl, vector
from flexmb.engine.allocation import new_run, new_state, new_work
from flexmb.engine.bodies import motion
from flexmb.engine.compiled_calls import all_units
from flexmb.engine.compiled_units import call, missing_units, prepare_units
from flexmb.engine.jit import UNITS
from flexmb.engine.stage_tables import units_of

SMALL = (SOLVE, MOVE, ldl.multiply.name)


def run_python(code, path, **environment):
    """Run code in a process of its own; what it prints."""
    env = {**os.environ, "PYTHONPATH": str(path), **environment}
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, cwd=path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


# --- nothing is compiled for a combination ------------------------------------------------------


def test_types_of_all_units_are_the_same_for_all_scenes():
    """A signature holds classes of records, arrays and numbers, nothing of a scene."""
    for unit in all_units():
        hints = {name: str(hint) for name, hint in unit.function.__annotations__.items()}
        assert "return" in hints, unit
        assert not any("None" in hint or "object" in hint for hint in hints.values()), unit


@pytest.mark.parametrize("topology", ["chain", "loop", "star"])
def test_a_new_combination_of_known_kinds_compiles_nothing(topology):
    """All units once, then mechanisms of any kind: only what is loaded changes."""
    prepare_units(all_units())
    for bodies in ("rigid", "mixed", "flexible"):
        system = Bench(Mechanism(5, topology, bodies).model).sys
        run = new_run(system, new_state(system), new_work(system))
        assert prepare_units(units_of(system)) == 0
        assert not missing_units(compiled_units.units_in(run))


# --- keys ---------------------------------------------------------------------------------------

NAMES = """
import json
from flexmb.engine.compiled_calls import all_units
from flexmb.engine.unit_cache import sources_of, unit_file
print(json.dumps({u.name: [unit_file(u.name), [p.name for p in sources_of(u.module)]]
                  for u in all_units()}))
"""


@pytest.mark.slow
def test_an_edit_concerns_only_the_units_that_reach_the_file(tmp_path, project):
    """An edited kernel of one kind leaves all others in the cache; one of vectors does not."""
    shutil.copytree(
        project / "flexmb", tmp_path / "flexmb", ignore=shutil.ignore_patterns("__pycache__")
    )

    def changed(file, before):
        path = tmp_path / "flexmb/engine" / file
        path.write_text(path.read_text() + "\n# edited\n")
        after = json.loads(run_python(NAMES, tmp_path))
        edited = {name for name in before if before[name][0] != after[name][0]}
        assert edited == {name for name in before if path.name in before[name][1]}
        return edited, after

    names = json.loads(run_python(NAMES, tmp_path))
    bushing, after = changed("forces/bushing.py", names)
    count = len(names)
    assert 3 <= len(bushing) <= 8 < count
    assert all("bushing" in name for name in bushing)
    vectors, _ = changed("algebra/vector.py", after)
    assert len(bushing) < len(vectors) < count


@pytest.mark.seconds
def test_an_edited_kernel_is_never_served_from_the_cache(tmp_path, project, cache):
    """The unit's file stays as it is; only a kernel that it calls, in another file, changes."""
    shutil.copytree(
        project / "flexmb", tmp_path / "flexmb", ignore=shutil.ignore_patterns("__pycache__")
    )
    code = """
import numpy as np
from flexmb.engine.algebra import ldl, vector
from flexmb.engine.tables import PANEL, UPDATE, LINK, Kkt
from flexmb.engine.state import Factor
from flexmb.engine.compiled_units import call
panels = np.zeros(1, PANEL); panels["nc"] = 7; panels["sign"] = 1.0
low = np.eye(7).ravel(); low[42] = 0.5
kkt = Kkt(panels, np.zeros(0, np.int64), np.zeros(0, UPDATE), np.zeros(0, LINK),
          np.arange(7), np.arange(7))
z = lambda n=8: np.zeros(n)
fac = Factor(low, low, low, low, z(), z(), np.ones(8), z(), z(), np.ones(1, np.int64),
             np.zeros(1, np.int64), z(), z(), z())
b = np.eye(8)[0]
call(ldl.solve, kkt, fac, b)
print(b[6])
"""
    assert float(run_python(code, tmp_path)) == -0.5
    path = tmp_path / "flexmb/engine/algebra/vector.py"
    text = path.read_text()
    assert text.count("s += a[i + k] * b[j + k]") == 1
    path.write_text(text.replace("s += a[i + k] * b[j + k]", "s += 3.0 * a[i + k] * b[j + k]"))
    assert float(run_python(code, tmp_path)) == -1.5
    folder = next((cache / "units").iterdir())
    assert len(list(folder.glob("*ldl.solve-*.unit"))) == 2


# --- processes ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_killed_compilation_leaves_a_usable_cache(cache, project):
    """Killed at several moments; then everything is there, and nothing broken."""
    code = f"""
from flexmb.engine.compiler_pool import compile_units
from flexmb.engine.compiled_calls import all_units
compile_units({list(SMALL)!r})
"""
    env = {**os.environ, "PYTHONPATH": str(project)}
    for seconds in (1.0, 2.5):
        process = subprocess.Popen([sys.executable, "-c", code], env=env)
        time.sleep(seconds)
        process.kill()
        process.wait()
    compiler_pool.compile_units(SMALL)
    assert all(unit_cache.read_stored(name) is not None for name in SMALL)
    folder = unit_cache.cache_folders()[0]
    assert sum(1 for _ in folder.glob("*.unit")) == len(SMALL)


@pytest.mark.seconds
def test_what_lies_in_the_present_folder_is_not_compiled(cache, tmp_path, monkeypatch):
    """Another version of flexmb there would be cached under the name of this one."""
    for name in ("flexmb/__init__.py", "numba.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("raise ImportError('from here')")
    monkeypatch.chdir(tmp_path)
    assert compiler_pool.compile_units([MOVE]) == 1


@pytest.mark.slow
def test_two_processes_on_a_cold_cache_share_the_work(cache, project):
    code = f"""
from flexmb.engine.compiler_pool import compile_units
import flexmb.engine.compiled_calls
print(compile_units({list(SMALL)!r}))
"""
    env = {**os.environ, "PYTHONPATH": str(project)}
    processes = [
        subprocess.Popen([sys.executable, "-c", code], env=env, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    counts = [int(process.communicate()[0]) for process in processes]
    assert sum(counts) == len(SMALL)
    assert all(unit_cache.read_stored(name) is not None for name in SMALL)


@pytest.mark.seconds
def test_an_import_leaves_numba_alone(project):
    """Neither the modules of Numba nor its settings, such as the user's own cache, are touched."""
    code = """
import sys, flexmb, flexmb.engine.compiled_calls, flexmb.analysis.dynamics.dynamics
assert not any(name.split(".")[0] == "numba" for name in sys.modules)
import numba
print(numba.config.CACHE_DIR)
"""
    assert run_python(code, project, NUMBA_CACHE_DIR="/mine").strip() == "/mine"


# --- indices --------------------------------------------------------------------------------------

ONE_FUNCTION = """
import sys
import numpy as np
from flexmb.engine.function import lower, run_program
from flexmb.engine.compiled_units import call
from flexmb.model.functions.expression import parse
table = lower([parse("2*t")])
print(call(run_program, table, int(sys.argv[1]), 1.5, np.zeros((1, 3)), np.zeros((table.depth, 3))))
"""


@pytest.mark.slow
def test_checked_kernels_stop_at_an_index_outside_its_array(cache, tmp_path):
    """Below the first and behind the last; inside, they do what they always do."""

    def run(number):
        env = {**os.environ, "FLEXMB_CHECK_INDICES": "1"}
        command = [sys.executable, "-c", ONE_FUNCTION, str(number)]
        return subprocess.run(command, env=env, capture_output=True, text=True, check=False)

    assert run(0).stdout.strip() == "3.0"
    assert [run(number).returncode for number in (-1, 1000)] == [-signal.SIGILL] * 2


@pytest.mark.slow
def test_kernels_index_within_their_arrays(cache, project):
    """Pendulums, contacts, friction, flexible bodies and every method, all indices looked at."""
    rooms = [
        "convergence",
        "identities",
        "truth/test_contact.py",
        "truth/test_friction.py",
        "truth/test_effects.py",
        "truth/test_couplers.py",
        "truth/test_drivers.py",
    ]
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-n", "1"]
    done = subprocess.run(
        [*command, "-m", "not slow", *(str(project / "tests" / room) for room in rooms)],
        env={**os.environ, "FLEXMB_CHECK_INDICES": "1"}, cwd=project, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:]


# --- what the code does ---------------------------------------------------------------------------


def test_units_in_the_registry_are_found_by_their_names():
    assert UNITS[SOLVE] is ldl.solve
    assert UNITS[function.evaluate_functions.name] is function.evaluate_functions
    assert len({unit.symbol for unit in UNITS.values()}) == len(UNITS)


def test_nan_stays_visible():
    """The compiler may not assume that there is none."""
    bench = Bench(Mechanism(3, "chain", "rigid").model)
    bench.randomise(1)
    bench.q[0] = np.nan
    bench.run(STAGES)
    assert np.isnan(bench.C).any()


def test_nan_counts_as_largest_wherever_it_stands():
    """Newton's method took stages that are not finite for settled, as later numbers hid them."""
    one = np.ones(3)
    for k in range(3):
        x = np.array([1.0, -4.0, 2.0])
        x[k] = np.nan
        sizes = [vector.largest(x), vector.weighted_max(x, one), vector.scaled_max(x, one, one)]
        sizes.append(vector.scaled_max_above(x, one, one, 0.0, one))
        sizes.append(vector.larger(x[0], vector.larger(x[1], x[2])))
        assert np.isnan(sizes).all()
    assert vector.largest(np.array([1.0, -4.0, 2.0])) == vector.larger(4.0, -5.0) == 4.0


ALLOCATES = """
import numpy as np
from numba.core.errors import NumbaError
from flexmb.engine import compiler, jit

jit.compile_with(compiler._mark_kernel, compiler._mark_unit)

@jit.kernel
def first(n, made):
    return made[n]

@jit.unit
def allocates(n: int) -> float:
    return first(n, np.empty(n + 1))

@jit.unit
def does_not(n: int) -> float:
    return 2.0 * n

for name, unit in jit.UNITS.items():
    try:
        print(name, len(compiler.compile_unit(unit)[0]) > 100)
    except NumbaError:
        print(name, "refused")
"""


@pytest.mark.seconds
def test_code_that_allocates_does_not_compile(project):
    lines = run_python(ALLOCATES, project).splitlines()
    assert lines == ["__main__.allocates refused", "__main__.does_not True"]


WITHOUT = """
from enginekit import STAGES, Bench
from generators import Mechanism
from flexmb.engine.compiled_units import interpreted

assert interpreted()
for acting in (True, False):
    bench = Bench(Mechanism(3, "loop", "mixed", acting=acting).model)
    bench.randomise(4)
    bench.run(STAGES)
    found[f"residual{acting}"] = bench.residual
    found[f"gamma{acting}"] = bench.gamma
    found[f"Cq{acting}"] = bench.Cq
    found[f"out{acting}"] = bench.out
    found[f"S{acting}"] = bench.matrix(0.3, 0.02)
    found[f"x{acting}"] = bench.solve(np.ones(len(found[f"S{acting}"])), 2)
"""


@pytest.mark.seconds
def test_interpreted_and_compiled_code_agree(tmp_path):
    """Every kernel of the residual and of the iteration matrix, and with all features left out."""
    found = interpreted(WITHOUT, tmp_path)
    for acting in (True, False):
        bench = Bench(Mechanism(3, "loop", "mixed", acting=acting).model)
        bench.randomise(4)
        bench.run(STAGES)
        S = bench.matrix(0.3, 0.02)
        compiled = {
            "residual": bench.residual,
            "gamma": bench.gamma,
            "Cq": bench.Cq,
            "out": bench.out,
            "S": S,
            "x": bench.solve(np.ones(len(S)), 2),
        }
        for name, value in compiled.items():
            wanted = found[f"{name}{acting}"]
            # Sums in another order: the last digits of the largest number.
            atol = (1e-8 if name == "x" else 1e-13) * np.nanmax(np.abs(value))
            np.testing.assert_allclose(wanted, value, atol=atol, err_msg=name)


def test_calls_take_arrays_as_they_are():
    """An array is handed over in place, whatever its place in memory."""
    bench = Bench(Mechanism(3, "chain", "rigid").model)
    q, dq = bench.q.copy(), np.linspace(-0.1, 0.1, bench.layout.nv)
    moved = np.full_like(q, np.nan)
    call(motion.move, bench.sys.parts, q, dq, moved)
    np.testing.assert_allclose(moved, bench.moved(q, dq), rtol=0, atol=1e-14)
    again = np.full_like(q, np.nan)
    motion.move(bench.sys.parts, q, dq, again)  # in Python it is a plain function
    np.testing.assert_allclose(again, moved, rtol=0, atol=1e-15)


def test_arrays_of_another_kind_are_refused():
    """Compiled code would read them as what they are not."""
    bench = Bench(Mechanism(3, "chain", "rigid").model)
    q, n = bench.q.copy(), bench.layout.nv
    for dq in (np.zeros(2 * n)[::2], np.zeros(n, np.int64), np.zeros((1, n))):
        with pytest.raises(TypeError, match="must be a contiguous"):
            call(motion.move, bench.sys.parts, q, dq, q)


def test_folder_of_tests_is_not_the_users(project):
    assert Path(os.environ["FLEXMB_CACHE_DIR"]).resolve() != Path.home() / ".cache" / "flexmb"
