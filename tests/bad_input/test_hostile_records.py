"""The folder of a study, sweep or budget from elsewhere: a sentence, or its runs are done again."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from flexmb.errors import FlexmbError
from flexmb.studies.budgets.error_shares import _stored
from flexmb.studies.record_table import RecordTable, read_rows
from flexmb.studies.study_jobs import _readable
from flexmb.studies.sweeps.parameter_sweep import columns_of
from flexmb.untrusted import note_reading
from flexmb.workflow.comparison_page import study_parts

DEEP = b"[" * 99_999  # more than Python's recursion reaches
JOURNALS = [
    b"\xff\xfe\n",
    b"3\n4\n",
    b'{"a": "b"}\n3\n{"key',
    b'{"a": "b"}\n{"reason": ""}\n' + DEEP,
]


@pytest.mark.parametrize("journal", JOURNALS)
def test_a_damaged_journal_holds_the_rows_that_can_be_read(tmp_path: Path, journal) -> None:
    (tmp_path / "runs.parts").mkdir()
    (tmp_path / "runs.parts" / "journal.jsonl").write_bytes(journal)
    with RecordTable(tmp_path / "runs.parquet", {"a": "b"}) as table:
        table.append({"key": "x", "reason": ""})
        assert table.reasons() == {"x": ""}


def test_strange_numbers_and_texts_of_a_journal_are_rows(tmp_path: Path) -> None:
    (tmp_path / "runs.parts").mkdir()
    rows = b'{"key": 1, "x": %s}\n{"key": 2, "x": "\\ud800"}\n{"key": 3, "x": {"y": [[]]}}\n'
    (tmp_path / "runs.parts" / "journal.jsonl").write_bytes(b"{}\n" + rows % (b"9" * 400))
    assert read_rows(tmp_path / "runs.parquet").column("key").to_pylist() == [1, 2, 3]


def test_columns_that_change_their_kind_between_parts_become_texts(tmp_path: Path) -> None:
    """Such as the axis of a joint: z, then a list of three numbers."""
    (tmp_path / "runs.parts").mkdir()
    for number, axis in enumerate(("z", [1.0, 0.0, 0.0], None, 0.5)):
        table = pa.Table.from_pylist([{"key": number, "axis": axis}])
        part = tmp_path / "runs.parts" / f"{number}.parquet"
        pq.write_table(table, part)
        note_reading(part)
    axes = read_rows(tmp_path / "runs.parquet").column("axis").to_pylist()
    assert axes == ["z", "[1.0, 0.0, 0.0]", None, "0.5"]


def bomb_of_texts() -> pa.Table:
    long = pa.array(["x" * 1_000_000])
    texts = pa.DictionaryArray.from_arrays(np.zeros(5000, np.int32), long)
    return pa.table({"key": np.arange(5000), "reason": texts})


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (bomb_of_texts, "too much time or memory|is no table of runs"),
        (lambda: pa.table({"key": [{"a": 1}]}), "is no table of runs of flexmb"),
        (lambda: pa.table([["a"], ["b"]], ["key", "key"]), "is no table of runs of flexmb"),
        (lambda: pa.table({"reason": ["a"]}), "is no table of runs of flexmb"),
    ],
)
def test_a_table_of_runs_from_elsewhere_takes_no_memory(
    tmp_path: Path, monkeypatch, make, sentence: str
) -> None:
    monkeypatch.setenv("FLEXMB_CACHE_DIR", str(tmp_path / "cache"))
    pq.write_table(make(), tmp_path / "runs.parquet", store_schema=False)
    assert (tmp_path / "runs.parquet").stat().st_size < 300_000
    for use in (read_rows, lambda file: RecordTable(file, {})):
        with pytest.raises(FlexmbError, match=sentence):
            use(tmp_path / "runs.parquet")


def test_rows_of_another_kind_are_a_sentence_or_done_again(tmp_path: Path) -> None:
    rows = pa.table({"key": ["a"], "status": ["finished"], "tip:max": ["far"]})
    with pytest.raises(FlexmbError, match="the column tip:max is not one of a sweep"):
        columns_of(rows, ["a"], ["tip:max"], tmp_path / "runs.parquet")
    row = {"status": "finished", "repeats": 1, "reason": None, "workers": 1, "seconds": [1.0],
           "cpu_seconds": [0.5], "statistics": '{"seconds_compile": 2}'}  # fmt: skip
    assert _readable(row) == {**row, "reason": "", "statistics": {"seconds_compile": 2}}
    for change in ({"repeats": "x"}, {"seconds": []}, {"seconds": 3.0}, {"cpu_seconds": [None]},
                   {"statistics": "[3]"}, {"statistics": '{"seconds_compile": "a"}'}):  # fmt: skip
        assert _readable(row | change) is None
    assert _readable({"status": "finished"}) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
@pytest.mark.parametrize(
    "name", ["runs.parquet", "runs.parts/1.parquet", "runs.parts/journal.jsonl"]
)
def test_a_pipe_is_no_table(tmp_path: Path, name: str) -> None:
    (tmp_path / "runs.parts").mkdir()
    os.mkfifo(tmp_path / name)
    with pytest.raises(FlexmbError, match="is no regular file"):
        RecordTable(tmp_path / "runs.parquet", {})


def test_a_page_embeds_pictures_alone(tmp_path: Path) -> None:
    """The folder of a sweep may hold a link to any file under the name of a picture."""
    (tmp_path / "secret").write_text("hunter2")
    (tmp_path / "a.png").symlink_to(tmp_path / "secret")
    page = {"title": "t", "sentences": [], "tables": [], "pictures": ["a.png"]}
    (tmp_path / "sweep.json").write_text(json.dumps(page))
    with pytest.raises(FlexmbError, match="the picture a is no PNG"):
        study_parts(tmp_path, None)
    (tmp_path / "sweep.json").write_bytes(DEEP)
    with pytest.raises(FlexmbError, match=r"sweep\.json: cannot be read \(lists inside"):
        study_parts(tmp_path, None)


def test_a_damaged_record_of_a_budget_is_a_missing_one(tmp_path: Path) -> None:
    for text in (b"", DEEP, b"[1]", b'{"cpu": 1}', b'{"cpu": "a", "statistics": {}}'):
        (tmp_path / "run.json").write_bytes(text)
        assert _stored(tmp_path / "run.json") is None
    (tmp_path / "run.json").write_bytes(b'{"cpu": 1, "statistics": {"steps": 3}}')
    assert _stored(tmp_path / "run.json") == {"cpu": 1.0, "statistics": {"steps": 3}}
