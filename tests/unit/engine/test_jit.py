"""The decorator of compiled code: never stale, never called by mistake, never allocating."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from enginekit import STAGES, Bench, interpreted
from generators import Mechanism
from numba.core.errors import NumbaError

from flexmb.engine.jit import entry, kernel, source_hash
from flexmb.engine.kernels.algebra.rotation import cross

CALLER = """
import numpy as np
from flexmb.engine.jit import entry
from flexmb.engine.kernels.algebra.rotation import transform

@entry
def first(A):
    return transform(A, 1.0, 2.0, 3.0)[0]

print(first(np.eye(3)))
"""
SUM = "A[0, 0] * x + A[0, 1] * y + A[0, 2] * z"


def test_an_edited_kernel_is_never_served_from_the_cache(tmp_path, project):
    """The caller's file stays as it is; only the kernel that it calls, in another file, changes."""
    shutil.copytree(
        project / "flexmb", tmp_path / "flexmb", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "caller.py").write_text(CALLER)
    env = {**os.environ, "FLEXMB_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}

    def result():
        command = [sys.executable, str(tmp_path / "caller.py")]
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return float(done.stdout)

    assert result() == 1.0
    kernel_file = tmp_path / "flexmb/engine/kernels/algebra/rotation.py"
    text = kernel_file.read_text()
    assert SUM in text
    kernel_file.write_text(text.replace(SUM, SUM + " + 10.0"))
    assert result() == 11.0
    assert len(list((tmp_path / "cache" / "kernels").iterdir())) == 2


def test_hash_knows_names_and_contents(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\n")
    first = source_hash(tmp_path)
    (tmp_path / "a.py").write_text("x = 2\n")
    second = source_hash(tmp_path)
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({first, second, source_hash(tmp_path)}) == 3


def test_kernels_refuse_calls_from_python():
    with pytest.raises(TypeError, match="kernel cross is called by compiled code only"):
        cross(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@kernel
def _greedy(n):
    return np.empty(n)[0]


@entry
def _calls_greedy(n):
    return _greedy(n)


def test_code_that_allocates_does_not_compile():
    with pytest.raises(NumbaError):
        _calls_greedy(3)


@entry
def _is_finite(x):
    return np.isfinite(x)


def test_nan_stays_visible():
    assert not _is_finite(np.nan) and not _is_finite(np.inf) and _is_finite(1.0)


WITHOUT = """
import numba
from enginekit import STAGES, Bench
from generators import Mechanism

assert numba.config.DISABLE_JIT
for acting in (True, False):
    bench = Bench(Mechanism(3, "loop", "mixed", acting=acting).model, as_compiled=True)
    bench.randomise(4)
    bench.run(STAGES)
    found[f"residual{acting}"] = bench.residual
    found[f"gamma{acting}"] = bench.gamma
    found[f"Cq{acting}"] = bench.Cq
    found[f"out{acting}"] = bench.out
    found[f"S{acting}"] = bench.matrix(0.3, 0.02)
    found[f"x{acting}"] = bench.solve(np.ones(len(found[f"S{acting}"])), 2)
"""


def test_interpreted_and_compiled_code_agree(tmp_path):
    """Every kernel of the residual and of the iteration matrix, and with all features left out."""
    found = interpreted(WITHOUT, tmp_path)
    for acting in (True, False):
        bench = Bench(Mechanism(3, "loop", "mixed", acting=acting).model)
        bench.randomise(4)
        bench.run(STAGES)
        S = bench.matrix(0.3, 0.02)
        x = bench.solve(np.ones(len(S)), 2)
        wanted = {"residual": bench.residual, "S": S}
        bench.run(STAGES)
        wanted |= {"gamma": bench.gamma, "Cq": bench.Cq, "out": bench.out}
        # Sums in another order: the last digits of the largest number.
        for name, value in wanted.items():
            other = found[f"{name}{acting}"]
            np.testing.assert_allclose(other, value, atol=1e-13 * np.nanmax(np.abs(value)))
        np.testing.assert_allclose(found[f"x{acting}"], x, atol=1e-8 * np.abs(x).max())
