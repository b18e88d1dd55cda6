"""A file that is opened again goes on after its newest whole state, as if never closed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from resultfiles import block, writer

import flexmb
from flexmb.errors import OutputError, ResultFileError
from flexmb.results import Result
from flexmb.results import writer as result_writer
from flexmb.results.crash_safe_file import uninterrupted
from flexmb.results.writer import ResultWriter, extend_file, store_text


def state(i: int) -> dict[str, np.ndarray]:
    return {"v": np.full(4, float(i)), "step": np.array(i)}


def cut_off(path: Path, blocks: int, spare: int = 0) -> Path:
    """A file as a kill leaves it: a state after every block of five rows, and `spare` rows more."""
    with writer(path) as out:
        out.save_state(state(0))
        for i in range(blocks):
            out.append(block(5 * i, 5))
            out.save_state(state(i + 1))
        if spare:
            out.append(block(5 * blocks, spare))
    return path


def test_rows_after_the_state_are_dropped_and_made_again(tmp_path: Path) -> None:
    path = cut_off(tmp_path / "r.h5", 3, spare=4)
    with ResultWriter.reopen(path) as out:
        assert out.rows_written == 15
        assert len(Result(path).time) == 15
        for i in range(3, 9):  # beyond the space that was reserved, too
            out.append(block(5 * i, 5))
            out.save_state(state(i + 1))
        out.finish({"steps": 9}, "finished")
    whole = cut_off(tmp_path / "whole.h5", 9)
    result = Result(path)
    np.testing.assert_array_equal(result.q, Result(whole).q)
    assert result.last_state()[0] == 45
    with h5py.File(path) as a, h5py.File(whole) as b:
        assert list(a["state/saves"][:]) == list(b["state/saves"][:])
        assert list(a["state/rows"][:]) == list(b["state/rows"][:])
    assert result.status == "finished"


def test_it_stays_the_same_run_for_those_who_opened_it_before(tmp_path: Path) -> None:
    path = cut_off(tmp_path / "r.h5", 2, spare=1)
    seen = Result(path)
    with ResultWriter.reopen(path) as out:
        out.append(block(10, 5))
    np.testing.assert_array_equal(seen.v, block(0, 11).v)
    seen.refresh()
    np.testing.assert_array_equal(seen.v, block(0, 15).v)


def test_a_longer_duration_is_kept_beside_the_scene(tmp_path: Path) -> None:
    scene = {"title": "x", "dynamics": {"duration": 0.1, "outputs": 10, "step": 1e-3}}
    texts, bodies = {"scene": "of old"}, {"rod": "rod.flexbody.h5"}
    with writer(
        tmp_path / "r.h5", n_outputs=11, scene=scene, texts=texts, flexbodies=bodies
    ) as out:
        out.save_state(state(0))
        out.append(block(0, 11))
        out.save_state(state(1))
        out.finish({"steps": 1}, "finished")
    before = Result(out.path)
    assert not before.extended
    extend_file(out.path, 0.2, 20)
    result = Result(out.path)
    assert result.extended
    for name in ("q", "sensors", "time"):
        np.testing.assert_array_equal(result.table(name), before.table(name))  # the same run
    assert (result.texts, result.statistics) == (texts, {"steps": 1})
    assert result.flexbodies == before.flexbodies
    assert result.last_state()[1]["step"] == 1
    with h5py.File(out.path) as file:
        assert len(file["q"]) == 21  # room for all rows, taken in advance
    assert [path.name for path in tmp_path.iterdir()] == ["r.h5"]
    assert result.model["dynamics"] == {"duration": 0.2, "outputs": 20, "step": 1e-3}


@pytest.mark.parametrize(
    "change",
    [lambda path: store_text(path, "audit", "a table"), lambda path: extend_file(path, 0.2, 20)],
)
def test_a_change_that_breaks_off_leaves_the_file_as_it_was(tmp_path, monkeypatch, change):
    path = cut_off(tmp_path / "r.h5", 1)
    before = path.read_bytes()

    def broken(*_):
        raise OSError("the machine stops here")

    monkeypatch.setattr(result_writer, "content_digest", broken)
    with pytest.raises(OutputError, match="stops here"):
        change(path)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["r.h5"]
    monkeypatch.undo()
    change(path)
    assert len(Result(path).time) == 5


def test_only_one_writes_at_a_time(tmp_path: Path) -> None:
    path = cut_off(tmp_path / "r.h5", 1)
    with (
        ResultWriter.reopen(path) as out,
        pytest.raises(OutputError, match="another run is writing it"),
    ):
        ResultWriter.reopen(path)
    out.close()
    ResultWriter.reopen(path).close()


def test_a_file_without_a_state_cannot_go_on(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        out.append(block(0, 5))
    with pytest.raises(ResultFileError, match="cut off before its first state"):
        ResultWriter.reopen(out.path)
    with pytest.raises(ResultFileError, match="no such file"):
        ResultWriter.reopen(tmp_path / "x.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["r.h5"]  # no lock is left behind


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C as at a terminal; what was started in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interruption_waits_for_the_end_of_the_block() -> None:
    done = False
    with pytest.raises(KeyboardInterrupt), uninterrupted():
        signal.raise_signal(signal.SIGINT)
        done = True
    assert done
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_of_a_large_table_only_what_is_wanted_is_read(tmp_path, monkeypatch) -> None:
    from flexmb.results import reader

    with writer(tmp_path / "r.h5") as out:
        out.append(block(0, 20))
    whole = Result(out.path)
    expected = {name: whole.part(name, [1, 0]) for name in ("q", "sensors", "energy")}
    monkeypatch.setattr(reader, "_MAX_TABLE", 100)
    monkeypatch.setattr(reader, "_BLOCK_BYTES", 500)
    large = Result(out.path)
    for name, values in expected.items():
        np.testing.assert_array_equal(large.part(name, [1, 0]), values)
        np.testing.assert_array_equal(large.part(name), whole.part(name))
    assert not {"q", "sensors", "energy"} & {*large._tables}


def test_a_table_that_results_do_not_have_is_named(tmp_path):
    made = flexmb.Model("stone")
    made.add_body("stone", mass=1, inertia=[1, 1, 1])
    run = flexmb.simulate(made, duration=0.1, outputs=1, output=tmp_path)
    with pytest.raises(ResultFileError, match='unknown table "enrgy"; nearest: energy'):
        run.table("enrgy")
