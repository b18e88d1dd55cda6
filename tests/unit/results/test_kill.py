"""A result file is readable after a kill at any moment, and holds what was appended until then."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from resultfiles import block, writer

from flexmb import untrusted
from flexmb.errors import ResultFileError
from flexmb.results import Result, crash_safe_file, result_file
from flexmb.results.channels import TABLES
from flexmb.results.crash_safe_file import DiskFile

WRITE = """
import sys
import numpy as np
from resultfiles import block, writer
out = writer(sys.argv[1], n_outputs=int(sys.argv[2]))
out.save_state({"v": np.zeros(500), "step": np.array(0)})
for i in range(100_000):
    out.append(block(5 * i, 5))
    out.save_state({"v": np.full(500, float(i)), "step": np.array(i)})
    sys.stdout.write(f"{5 * (i + 1)}\\n")
    sys.stdout.flush()
"""


def _kill_and_read(path: Path, seconds: float, n_outputs: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE, str(path), str(n_outputs)],
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    process.stdout.readline()  # the run has begun
    time.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    told = [int(line) for line in process.stdout.read().split("\n")[:-1]]
    process.wait()
    process.stdout.close()
    result = Result(path)
    rows = len(result.time)
    assert rows >= max(told, default=5)
    assert result.status == "running"
    np.testing.assert_array_equal(result.q, block(0, rows).q)
    np.testing.assert_array_equal(result.lam, block(0, rows).lam)
    rows_then, state = result.last_state()
    assert rows - 5 <= rows_then <= rows
    np.testing.assert_array_equal(state["v"], np.full(500, float(state["step"])))


def _kill_many(tmp_path: Path, kills: int) -> None:
    moments = random.Random(5)
    for kill in range(kills):
        n_outputs = 500_000 if kill % 2 else 100  # reserved whole, or growing
        _kill_and_read(tmp_path / f"{kill}.h5", moments.uniform(0.0, 0.1), n_outputs)


@pytest.mark.seconds
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is a POSIX signal")
def test_readable_after_some_kills(tmp_path: Path) -> None:
    _kill_many(tmp_path, 2)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is a POSIX signal")
def test_readable_after_many_kills(tmp_path: Path) -> None:
    _kill_many(tmp_path, 40)


@pytest.mark.slow
def test_a_kill_while_a_file_grows_costs_no_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kill leaves what the disk has then: the file is looked at before every write.

    A file that grew in place was damaged where its indices of many chunks grew as well.
    """
    monkeypatch.setattr(result_file, "_CHUNK_BYTES", 1 << 10)
    path, moments, now = tmp_path / "r.h5", [], DiskFile._write_all

    def write(*arguments: Any) -> None:
        if path.exists() and (not moments or moments[-1] != path.read_bytes()):
            moments.append(path.read_bytes())
        now(*arguments)

    with writer(path, n_outputs=50) as out:
        out.save_state({"v": np.zeros(3)})
        for start in range(0, 400, 50):
            out.append(block(start, 50))
        with monkeypatch.context() as patch:
            patch.setattr(DiskFile, "_write_all", write)
            for start in (400, 420, 790):
                out.append(block(start, 790 - start if start == 420 else 20))
    np.testing.assert_array_equal(Result(path).q, block(0, 810).q)
    assert len(moments) > 10
    monkeypatch.setattr(untrusted, "_first_reading", lambda *_: None)  # here, to be fast
    rows, killed = [], tmp_path / "killed.h5"
    for moment in moments:
        killed.write_bytes(moment)
        result = Result(killed)
        rows.append(len(result.time))
        np.testing.assert_array_equal(result.q, block(0, rows[-1]).q)
    assert rows == sorted(rows)
    assert {400, 420, 790} <= set(rows)


@pytest.mark.slow
def test_flipped_bits_of_a_killed_run_are_noticed_or_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crash_safe_file, "_PAUSE", 0.0)
    monkeypatch.setattr(untrusted, "_first_reading", lambda *_: None)  # here, to be fast
    with writer(tmp_path / "run.h5", texts={"scene": "a" * 500}) as out:
        out.save_state({"v": np.zeros(500)})
        for k in range(4):
            out.append(block(5 * k, 5))
            out.save_state({"v": np.full(500, float(k + 1))})
        whole = out.path.read_bytes()
    path, rng, outcomes = tmp_path / "killed.h5", random.Random(2), []
    for n in range(150):
        damaged = bytearray(whole)
        place = rng.randrange(untrusted.USER_BLOCK, len(whole)) if n else 0
        damaged[place] ^= 1 << rng.randrange(8) if n else 0
        path.write_bytes(damaged)
        try:
            result = Result(path)
            read = [result.table(name).tobytes() for name in TABLES]
            rows, state = result.last_state()
            outcomes.append((read, result.texts, result.model, rows, state["v"].tolist()))
        except ResultFileError:
            outcomes.append(None)
    true = outcomes[0]
    assert true is not None
    earlier = (*true[:3], 15, [3.0] * 500)  # the state before, where the newest is damaged
    assert all(outcome in (None, true, earlier) for outcome in outcomes)
    assert None in outcomes and earlier in outcomes
