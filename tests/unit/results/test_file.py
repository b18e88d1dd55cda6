"""A result file gives back what was written, refuses what is not finite, and names what failed."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from resultfiles import SCENE, block, writer

from flexmb.errors import OutputError
from flexmb.results import Result


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "result.h5"
    with writer(path, texts={"scene": "title = 'x'"}, flexbodies={"rod": "rod.flexbody.h5"}) as out:
        out.append(block(0, 4))
        out.append(block(4, 3))
        out.finish({"steps": np.int64(70), "seconds": 0.5, "method": "x"}, "stopped", "by the user")
    result = Result(path)
    rows = block(0, 7)
    for name in ("q", "v", "vd", "lam", "drift"):
        np.testing.assert_array_equal(getattr(result, name), getattr(rows, name))
    np.testing.assert_array_equal(result.time, rows.t)
    np.testing.assert_array_equal(result["slider.x"], rows.sensors[:, 0])
    np.testing.assert_array_equal(result.energy["strain"], rows.energy[:, 1])
    assert (result.status, result.message) == ("stopped", "by the user")
    assert result.statistics == {"steps": 70, "seconds": 0.5, "method": "x"}
    assert result.model == SCENE
    assert result.texts == {"scene": "title = 'x'"}
    assert result.flexbodies == {"rod": path.parent / "rod.flexbody.h5"}
    assert result.layout.fingerprint == "f00d"
    assert [body.m for body in result.layout.bodies] == [0, 2]


def test_a_file_being_written_can_be_read(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        assert not out.path.exists()
        out.append(block(0, 5))
        result = Result(out.path)
        assert result.status == "running"
        assert len(result.time) == len(result.q) == 5


def test_an_older_result_stays_until_the_new_one_has_rows(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    with writer(path) as out:
        out.append(block(0, 5))
        out.finish({}, "finished")
    with pytest.raises(KeyboardInterrupt), writer(path) as out:
        out.save_state({"v": np.zeros(3)})
        raise KeyboardInterrupt
    assert (Result(path).status, len(Result(path).time)) == ("finished", 5)
    assert [one.name for one in tmp_path.iterdir()] == ["r.h5"]
    with writer(path) as out:
        out.append(block(0, 2))
        assert len(Result(path).time) == 2


def test_more_rows_than_planned_are_taken(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5", n_outputs=3) as out:
        for start in range(0, 40, 4):
            out.append(block(start, 4))
    np.testing.assert_array_equal(Result(out.path).v, block(0, 40).v)


def test_a_first_block_may_be_larger_than_planned(tmp_path: Path) -> None:
    """The older file of that name stays until there are rows, and what a kill left is removed."""
    path, left = tmp_path / "r.h5", tmp_path / "r.h5.next"
    left.write_bytes(b"of a run that was killed")
    with writer(path) as out:
        assert not left.exists()
        out.append(block(0, 2))
    with writer(path, n_outputs=1) as out:
        assert len(Result(path).time) == 2
        out.append(block(0, 7))
        assert len(Result(path).time) == 7
        with pytest.raises(OutputError, match="another run is writing it"):
            writer(path)
    assert [one.name for one in tmp_path.iterdir()] == ["r.h5"]
    writer(path).close()


def test_rows_that_are_not_finite_are_refused_and_those_before_kept(tmp_path: Path) -> None:
    rows = block(0, 5)
    rows.vd[3, 8] = np.nan
    rows.sensors[3, 3] = np.inf
    with writer(tmp_path / "r.h5") as out, pytest.raises(OutputError) as caught:
        out.append(rows)
    assert "t = 0.03 s (body rod, sensor turn)" in str(caught.value)
    assert len(Result(out.path).time) == 3
    with h5py.File(out.path) as file:
        assert np.isfinite(file["vd"][:]).all()


def test_the_newest_whole_state_is_kept(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        for i in range(3):
            out.save_state({"v": np.full(4, float(i)), "step": np.array(i)})
            out.append(block(5 * i, 5))
        rows, state = Result(out.path).last_state()
        assert rows == 10
        assert state["step"] == 2
        np.testing.assert_array_equal(state["v"], np.full(4, 2.0))
        with h5py.File(out.path) as file:  # the one before is whole as well
            assert list(file["state/saves"][:]) == [3, 2]


def test_a_state_of_other_names_or_a_block_of_other_shape_is_a_mistake_of_the_caller(
    tmp_path: Path,
) -> None:
    with writer(tmp_path / "r.h5") as out:
        out.save_state({"v": np.zeros(4)})
        with pytest.raises(KeyError):
            out.save_state({"w": np.zeros(4)})
        with pytest.raises(ValueError, match="block.q has shape"):
            out.append(dataclasses.replace(block(0, 2), q=np.zeros((2, 5))))


def test_a_long_message_is_cut_not_lost(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        out.finish({"steps": 3}, "failed", "x" * 100_000)
    result = Result(out.path)
    assert result.message.startswith("xxx")
    assert result.message.endswith("...")
    assert result.statistics == {"steps": 3}


@pytest.mark.parametrize("where", ["", "file/result.h5"])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, where: str) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(OutputError, match="is a folder|cannot be written"):
        writer(tmp_path / where)


def test_a_file_that_another_run_is_writing_is_left_alone(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        out.append(block(0, 5))
        with pytest.raises(OutputError, match="another run is writing it"):
            writer(tmp_path / "r.h5")
        out.append(block(5, 5))
    np.testing.assert_array_equal(Result(out.path).q, block(0, 10).q)
    writer(tmp_path / "r.h5").close()
    assert [path.name for path in tmp_path.iterdir()] == ["r.h5"]


DISK_FULL = """
import resource, sys
from resultfiles import block, writer
from flexmb.errors import OutputError
if sys.argv[2] == "before":
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
try:
    out = writer(sys.argv[1], n_outputs=70 if sys.argv[2] == "growing" else 20_000)
    for i in range(2000):
        if i == 7:
            resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
        out.append(block(10 * i, 10))
except OutputError as error:
    print(error)
else:
    print("no error")
"""


@pytest.mark.seconds
@pytest.mark.skipif(sys.platform == "win32", reason="file-size limits are a POSIX means")
@pytest.mark.parametrize(("when", "rows"), [("before", None), ("while", 70), ("growing", 70)])
def test_a_full_disk_is_one_sentence_and_keeps_the_rows(
    tmp_path: Path, when: str, rows: int | None
) -> None:
    path = tmp_path / "r.h5"
    tests = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", DISK_FULL, str(path), when],
        cwd=tests,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "the disk" in done.stdout
    if rows is not None:
        assert f"the {rows} rows until then are kept" in done.stdout
        np.testing.assert_array_equal(Result(path).q, block(0, rows).q)
