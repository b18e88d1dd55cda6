"""The cache of compiled units: whose it is, what of it is read, and what is done without it."""

from __future__ import annotations

import os
import shutil

import pytest
from coldcache import MOVE, SOLVE, empty_cache, stored_unit  # noqa: F401  fixtures

from flexmb.engine import compiler_pool, unit_cache
from flexmb.errors import CompilationError, FlexmbWarning


def test_other_processors_and_versions_have_folders_of_their_own(cache, monkeypatch):
    """Machines that share a home folder do not share machine code."""
    import llvmlite.binding as llvm

    here = unit_cache.cache_folders()[0]
    monkeypatch.setattr(llvm, "get_host_cpu_name", lambda: "another-processor")
    unit_cache._machine.cache_clear()
    unit_cache._shared_folders.cache_clear()
    there = unit_cache.cache_folders()[0]
    monkeypatch.undo()
    unit_cache._machine.cache_clear()
    assert here != there and here.parent == there.parent
    assert unit_cache.version("numba") in here.name and unit_cache.version("llvmlite") in here.name


def test_the_cache_of_another_version_is_not_read(cache, solve_file, monkeypatch):
    """It stays as it is, beside the one of this version."""
    name, whole = solve_file
    folder = unit_cache.cache_folders()[0]
    (folder / name).write_bytes(whole)
    assert unit_cache.read_stored(SOLVE) is not None
    monkeypatch.setattr(unit_cache, "version", lambda package: "99.0")
    for known in (unit_cache._machine, unit_cache._shared_folders):
        known.cache_clear()
    other = unit_cache.cache_folders()[0]
    assert other != folder and "numba99.0" in other.name
    assert unit_cache.read_stored(SOLVE) is None
    monkeypatch.undo()
    unit_cache._machine.cache_clear()
    assert (folder / name).read_bytes() == whole


@pytest.mark.parametrize(
    ("package", "present", "told"),
    [
        ("numba", "0.60.0", 'numba 0.60.0 is too old: flexmb compiles with 0.61 or newer; '
         'python -m pip install "numba>=0.61"'),
        ("llvmlite", "0.43.0rc1", 'llvmlite 0.43.0rc1 is too old: flexmb compiles with 0.44 or '
         'newer; python -m pip install "llvmlite>=0.44"'),
        ("numba", None, "numba none is too old"),
    ],
)  # fmt: skip
def test_a_compiler_that_is_too_old_is_one_sentence(cache, monkeypatch, package, present, told):
    def version(name):
        if name != package:
            return "1.0.0"
        if present is None:
            raise compiler_pool.PackageNotFoundError(name)
        return present

    monkeypatch.setattr(compiler_pool, "version", version)
    with pytest.raises(CompilationError) as error:
        compiler_pool.compile_units([SOLVE])
    assert str(error.value).startswith(told) and "\n" not in str(error.value)


def test_hash_of_the_engine_knows_names_and_contents(tmp_path, monkeypatch):
    monkeypatch.setattr(unit_cache, "_ENGINE", tmp_path)
    engine_hash = unit_cache.engine_hash.__wrapped__
    (tmp_path / "a.py").write_text("x = 1\n")
    first = engine_hash()
    (tmp_path / "a.py").write_text("x = 2\n")
    second = engine_hash()
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({first, second, engine_hash()}) == 3


@pytest.mark.seconds
def test_damaged_files_are_compiled_again(cache, solve_file):
    name, whole = solve_file
    file = unit_cache.cache_folders()[0] / name
    file.write_bytes(whole)
    assert unit_cache.read_stored(SOLVE) is not None
    for damaged in (b"", whole[:100], whole[:-50], whole[:-1] + b"x", b"{}\n", b"\0" * 400):
        file.write_bytes(damaged)
        assert unit_cache.read_stored(SOLVE) is None
    assert compiler_pool.compile_units([SOLVE]) == 1
    assert unit_cache.read_stored(SOLVE) is not None
    assert compiler_pool.compile_units([SOLVE]) == 0


@pytest.mark.seconds
def test_a_read_only_cache_is_read_and_new_units_are_kept_for_the_run(
    cache, solve_file, monkeypatch
):
    name, whole = solve_file
    folder = unit_cache.cache_folders()[0]
    (folder / name).write_bytes(whole)
    unit_cache._shared_folders.cache_clear()
    monkeypatch.setattr(unit_cache, "is_writable", lambda path: False)  # tests may run as root
    with pytest.warns(FlexmbWarning, match="read-only or full"):
        folders = unit_cache.cache_folders()
    assert folders[1] == folder != folders[0]
    assert unit_cache.read_stored(SOLVE) is not None
    assert compiler_pool.compile_units([MOVE]) == 1
    assert (folders[0] / unit_cache.unit_file(MOVE)).is_file()
    assert not (folder / unit_cache.unit_file(MOVE)).exists()


@pytest.mark.seconds
def test_a_full_disk_is_told_and_the_run_goes_on(cache, monkeypatch):
    folder = unit_cache.cache_folders()[0]
    shutil.rmtree(folder)
    folder.parent.mkdir(exist_ok=True)
    folder.write_text("a file where the folder was: nothing can be written into it")
    with pytest.warns(FlexmbWarning, match="cannot be written"):
        assert compiler_pool.compile_units([SOLVE]) == 1
    assert unit_cache.read_stored(SOLVE) is not None


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no rights of groups and others here")
def test_a_cache_that_others_may_write_to_is_not_used(cache):
    folder = unit_cache.cache_folders()[0]
    folder.chmod(0o777)
    unit_cache._shared_folders.cache_clear()
    with pytest.warns(FlexmbWarning, match="other users may write to it"):
        assert folder not in unit_cache.cache_folders()
