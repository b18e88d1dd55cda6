"""The table of runs: what pandas reads of it, what a killed process leaves, what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from flexmb.errors import FlexmbError, OutputError
from flexmb.studies import record_table
from flexmb.studies.record_table import RecordTable, read_rows

ABOUT = {"scene": "one"}


def test_rows_of_several_parts_become_one_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Columns may come later, and hold numbers in one part and texts in another."""
    monkeypatch.setattr(record_table, "_PART_ROWS", 4)
    file = tmp_path / "out" / "runs.parquet"
    with RecordTable(file, ABOUT) as table:
        for i in range(10):
            step: object = "auto" if i > 7 else i
            more = {"history": np.arange(3) + i, "all": {"a": i}} if i > 5 else {}
            table.append({"key": i, "status": "finished", "reason": "", "step": step, **more})
        assert not file.exists()
        assert read_rows(file, ["key"]).column("key").to_pylist() == list(range(10))
    assert not file.with_suffix(".parts").exists()
    rows = pq.read_table(file).to_pylist()
    assert [row["step"] for row in rows[-3:]] == ["7", "auto", "auto"]
    assert rows[9]["history"] == [9.0, 10.0, 11.0] and rows[9]["all"] == '{"a": 9}'
    assert rows[0]["history"] is None


def test_a_killed_process_loses_no_row_that_was_appended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_table, "_PART_ROWS", 4)
    file = tmp_path / "runs.parquet"
    killed = RecordTable(file, ABOUT)
    with pytest.raises(FlexmbError, match="another command is writing it"):
        RecordTable(file, ABOUT)
    for i in range(7):
        killed.append({"key": i, "reason": "" if i else "too long"})
    with (file.with_suffix(".parts") / "journal.jsonl").open("a", encoding="utf-8") as journal:
        journal.write('{"key": 7, "rea')  # cut off while it was written
    killed._lock.release()  # as the system does
    with RecordTable(file, ABOUT) as table:
        assert table.reasons() == {0: "too long", **dict.fromkeys(range(1, 7), "")}
        table.append({"key": 0, "reason": ""})  # done again
    assert sorted(read_rows(file).column("key").to_pylist()) == list(range(7))
    with RecordTable(file, ABOUT) as table:
        assert set(table.reasons().values()) == {""}


def test_runs_of_another_scene_are_kept_apart(tmp_path: Path) -> None:
    file = tmp_path / "runs.parquet"
    with RecordTable(file, ABOUT) as table:
        table.append({"key": "a", "reason": ""})
    with pytest.raises(FlexmbError, match=r"holds runs of another scene: .* --fresh"):
        RecordTable(file, {"scene": "two"})
    with RecordTable(file, {"scene": "two"}, fresh=True) as table:
        assert table.reasons() == {}
    (tmp_path / "other.parquet").write_bytes(b"nothing of ours")
    with pytest.raises(FlexmbError, match="no table of runs"):
        RecordTable(tmp_path / "other.parquet", ABOUT)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_named(tmp_path: Path) -> None:
    table = RecordTable(tmp_path / "runs.parquet", ABOUT)
    table._journal.close()
    table._journal = Path("/dev/full").open("wb", buffering=0)  # noqa: SIM115  closed below
    with pytest.raises(OutputError, match=r"runs.parquet cannot be written \(No space left"):
        table.append({"key": 1})
    table._journal.close()
