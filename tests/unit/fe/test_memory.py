"""Free memory: read, limited, and refused."""

from __future__ import annotations

import pytest
from femeshes import block

from flexmb.errors import ReductionError
from flexmb.fe import assemble, resolve
from flexmb.fe.solver import memory
from flexmb.fe.solver.memory import available_memory, require_memory


def test_a_machine_has_some_memory():
    free = available_memory()
    assert free is None or 1e6 < free < 1e16
    require_memory(1.0, "a byte")


@pytest.mark.parametrize("text", ["3 GB", "3gb", "3e9", "3000MB", "0.003 TB"])
def test_the_limit_may_be_lowered(monkeypatch, text):
    monkeypatch.setenv("FLEXMB_MEMORY", text)
    monkeypatch.setattr(memory, "available_memory", lambda: 64e9)
    require_memory(2.9e9, "the work")
    with pytest.raises(ReductionError, match=r"the work needs about 3.1 GB, FLEXMB_MEMORY allows"):
        require_memory(3.1e9, "the work")


def test_the_machine_limits_too(monkeypatch):
    monkeypatch.delenv("FLEXMB_MEMORY", raising=False)
    monkeypatch.setattr(memory, "available_memory", lambda: 8e9)
    with pytest.raises(ReductionError, match=r"about 2\.1 TB, this machine has free 8 GB"):
        require_memory(2.1e12, "the work")
    monkeypatch.setattr(memory, "available_memory", lambda: None)
    require_memory(1e15, "the work")  # nothing known, nothing refused


@pytest.mark.parametrize("text", ["much", "3 GiB", "-1", "1.2.3 GB", "nan"])
def test_a_limit_that_is_no_size_is_refused(monkeypatch, text):
    monkeypatch.setenv("FLEXMB_MEMORY", text)
    with pytest.raises(ReductionError, match=f'FLEXMB_MEMORY: must be a size .* given "{text}"'):
        require_memory(1.0, "the work")


def group(folder, limit, used, stat, names):
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in zip((*names, "memory.stat"), (limit, used, stat), strict=True):
        (folder / name).write_text(str(text))


def test_control_groups_of_version_2_count_with_all_above(tmp_path):
    names = "memory.max", "memory.current"
    group(tmp_path / "a", 5_000, 1_000, "anon 3\ninactive_file 200\n", names)
    group(tmp_path / "a" / "b", "max", 1_000, "inactive_file 0\n", names)
    found = memory._left(tmp_path, "/a/b", *names, "inactive_file")
    assert found == [4_200.0]


def test_where_there_are_no_control_groups_nothing_is_said(tmp_path):
    assert memory._left(tmp_path, "/x", "memory.max", "memory.current", "inactive_file") == []


def test_matrices_that_do_not_fit_are_not_assembled(monkeypatch):
    """Six tetrahedra of 30 x 30 entries in a block: 97 kB at 18 bytes an entry."""
    monkeypatch.setenv("FLEXMB_MEMORY", "90 KB")
    with pytest.raises(
        ReductionError, match=r"the assembly of 81 degrees .* needs about 0\.097 MB"
    ):
        assemble(block((1, 1, 1)), resolve("steel"))
    monkeypatch.setenv("FLEXMB_MEMORY", "100 KB")
    assemble(block((1, 1, 1)), resolve("steel"))
