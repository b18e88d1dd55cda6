"""The claim to a file, as POSIX and Windows keep it."""

from __future__ import annotations

import errno
import os
import sys
import types
from pathlib import Path

import pytest

from flexmb.results import lock
from flexmb.results.lock import WriteLock


class FakeWindows(types.ModuleType):
    """Stands in for msvcrt: locks a byte of a file, by its place on the disk."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        super().__init__("msvcrt")
        self.owners: dict[int, int] = {}

    def locking(self, descriptor: int, mode: int, count: int) -> None:
        place = os.fstat(descriptor).st_ino
        if self.owners.get(place, descriptor) != descriptor:
            raise OSError(errno.EACCES, "Permission denied")
        self.owners[place] = descriptor


@pytest.fixture(params=[sys.platform, "win32"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param != sys.platform:
        monkeypatch.setitem(sys.modules, "msvcrt", FakeWindows())
        monkeypatch.setattr(lock.sys, "platform", request.param)
    return request.param


def test_one_writer_at_a_time(system: str, tmp_path: Path) -> None:
    path = tmp_path / "result.h5"
    first = WriteLock(path)
    with pytest.raises(BlockingIOError, match="another run"):
        WriteLock(path)
    assert not path.exists()
    first.release()
    first.release()
    assert list(tmp_path.iterdir()) == []
    WriteLock(path).release()


def test_a_lock_file_left_by_a_killed_run_does_no_harm(system: str, tmp_path: Path) -> None:
    (tmp_path / "result.h5.lock").touch()
    WriteLock(tmp_path / "result.h5").release()


@pytest.mark.skipif(sys.platform == "win32", reason="no open file can be removed there")
def test_a_lock_file_removed_while_it_is_taken_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last owner removes it between our opening and our claim: two runs must not both write."""
    path, claim = tmp_path / "result.h5", lock._claim
    removed = []

    def claim_late(descriptor: int) -> None:
        if not removed:
            removed.append(True)
            path.with_name("result.h5.lock").unlink()
        claim(descriptor)

    monkeypatch.setattr(lock, "_claim", claim_late)
    first = WriteLock(path)
    with pytest.raises(BlockingIOError):
        WriteLock(path)
    first.release()
