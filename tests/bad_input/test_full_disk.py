"""A full disk: one sentence, no crash at any size, rows until then kept, and the run goes on later.

A limit on the size of files stands in for a disk without room; it is raised again afterwards.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from resultfiles import block

import flexmb
from flexmb.results import Result

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits are a POSIX means")
TESTS = Path(__file__).parents[1]

LIMITS = """
import resource, sys
from pathlib import Path
from resultfiles import block, writer
from flexmb.errors import OutputError
from flexmb.results import Result
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
texts = {"scene": "x" * 100_000, "more": "y"}
for limit in range(0, 700_000, 23_456):
    path = Path(sys.argv[1]) / f"{limit}.h5"
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    said = ""
    try:
        with writer(path, n_outputs=50, texts=texts) as out:
            out.save_state({"v": block(0, 1000).q})
            for i in range(300):  # beyond what was reserved
                out.append(block(10 * i, 10))
                out.save_state({"v": block(i, 1000).q})
            out.finish({}, "finished")
    except OutputError as error:
        said = str(error)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    rows = len(Result(path).time) if "are kept" in said else -1
    sys.stdout.write(f"{limit} {rows} {said}\\n")
"""

RUN = """
import resource, sys
import flexmb
from flexmb.analysis.dynamics import integration
integration._CHUNK_WORK = 18 * 100
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
def told(phase, share, detail=""):
    if phase == "integrate" and share > 0.5:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
model = flexmb.load_scene(sys.argv[1])
try:
    flexmb.simulate(model, output=sys.argv[2], progress=told)
except flexmb.FlexmbError as error:
    sys.stdout.write(str(error))
"""


def run_python(code: str, *words: str | Path) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code, *map(str, words)],
        cwd=TESTS,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.slow
def test_no_limit_crashes_the_writer(tmp_path: Path) -> None:
    lines = [line.split(" ", 2) for line in run_python(LIMITS, tmp_path).splitlines()]
    assert len(lines) == 30
    for limit, rows, said in lines:
        assert "the disk" in said, limit
        if "are kept" in said:
            result = Result(tmp_path / f"{limit}.h5")
            assert f"the {rows} rows until then are kept" in said
            np.testing.assert_array_equal(result.q, block(0, int(rows)).q)
    assert {rows == "-1" for _, rows, _ in lines} == {True, False}  # before the run, and in it


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")
def test_a_run_on_a_full_disk_goes_on_when_there_is_room(project: Path, tmp_path: Path) -> None:
    scene = project / "cases" / "rigid_slider_crank" / "scene.toml"
    said = run_python(RUN, scene, tmp_path / "out")
    assert "the disk takes no more of this file" in said
    assert "rows until then are kept" in said
    part = Result(tmp_path / "out")
    assert 100 < len(part.time) < 201
    done = flexmb.resume(part)
    assert (done.status, len(done.time)) == ("finished", 201)
