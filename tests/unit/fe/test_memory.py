"""Free memory: read, limited, and refused."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import psutil
import pytest
from femeshes import block

from flexmb.errors import ReductionError
from flexmb.fe import assemble, linear_solver, resolve
from flexmb.fe.linear_solver import available_memory, require_memory


def test_a_machine_has_some_memory():
    free = available_memory()
    assert 1e6 < free < 1e16
    require_memory(1.0, "a byte")


@pytest.mark.parametrize("text", ["3 GB", "3gb", "3e9", "3000MB", "0.003 TB"])
def test_the_limit_may_be_lowered(monkeypatch, text):
    monkeypatch.setenv("FLEXMB_MEMORY", text)
    monkeypatch.setattr(linear_solver, "available_memory", lambda: 64e9)
    require_memory(2.9e9, "the work")
    with pytest.raises(ReductionError, match=r"the work needs about 3.1 GB, FLEXMB_MEMORY allows"):
        require_memory(3.1e9, "the work")


def test_the_machine_limits_too(monkeypatch):
    monkeypatch.delenv("FLEXMB_MEMORY", raising=False)
    monkeypatch.setattr(linear_solver, "available_memory", lambda: 8e9)
    with pytest.raises(ReductionError, match=r"about 2\.1 TB, this machine has free 8 GB"):
        require_memory(2.1e12, "the work")
    monkeypatch.setattr(linear_solver, "available_memory", lambda: float("inf"))
    require_memory(1e15, "the work")  # nothing known, nothing refused


@pytest.mark.parametrize("text", ["much", "3 GiB", "-1", "1.2.3 GB", "nan"])
def test_a_limit_that_is_no_size_is_refused(monkeypatch, text):
    monkeypatch.setenv("FLEXMB_MEMORY", text)
    with pytest.raises(ReductionError, match=f'FLEXMB_MEMORY: must be a size .* given "{text}"'):
        require_memory(1.0, "the work")


def group(folder, limit, used, stat, names):
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in zip((*names, "memory.stat"), (limit, used, stat), strict=True):
        (folder / name).write_text(str(text), encoding="utf-8")


V2 = "memory.max", "memory.current"
V1 = "memory.limit_in_bytes", "memory.usage_in_bytes"


def test_control_groups_of_version_2_count_with_all_above(tmp_path):
    group(tmp_path / "a", 5_000, 1_000, "anon 3\ninactive_file 200\n", V2)
    group(tmp_path / "a" / "b", "max", 1_000, "inactive_file 0\n", V2)
    mine = tmp_path / "cgroup"
    mine.write_text("0::/a/b\n", encoding="utf-8")
    assert linear_solver._cgroups(mine, tmp_path) == [4_200.0]


def test_control_groups_of_version_1_have_a_folder_for_memory(tmp_path):
    group(tmp_path / "memory" / "a", 9_000, 2_000, "total_inactive_file 50\n", V1)
    mine = tmp_path / "cgroup"
    mine.write_text("3:cpu,cpuacct:/a\n2:memory:/a\n", encoding="utf-8")
    assert linear_solver._cgroups(mine, tmp_path) == [7_050.0]


def test_the_free_memory_is_the_least_of_machine_and_control_groups(monkeypatch):
    monkeypatch.setattr(linear_solver, "_cgroups", lambda path, root: [3e9])
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=4096))
    assert linear_solver.available_memory() == 4096.0
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=5e9))
    assert linear_solver.available_memory() == (3e9 if sys.platform == "linux" else 5e9)


def test_where_there_are_no_control_groups_nothing_is_said(tmp_path):
    assert linear_solver._cgroups(tmp_path / "absent", tmp_path) == []
    mine = tmp_path / "cgroup"
    mine.write_text("0::/x\n", encoding="utf-8")
    assert linear_solver._cgroups(mine, tmp_path) == []


def test_matrices_that_do_not_fit_are_not_assembled(monkeypatch):
    """Six tetrahedra of 30 x 30 entries in a block: 97 kB at 18 bytes an entry."""
    monkeypatch.setenv("FLEXMB_MEMORY", "90 KB")
    with pytest.raises(
        ReductionError, match=r"the assembly of 81 degrees .* needs about 0\.097 MB"
    ):
        assemble(block((1, 1, 1)), resolve("steel"))
    monkeypatch.setenv("FLEXMB_MEMORY", "100 KB")
    assemble(block((1, 1, 1)), resolve("steel"))
