"""The claim to a file: one writer at a time, whatever happened to the lock file before."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from flexmb.results.crash_safe_file import WriteLock

posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows locks by other means")

HOLD = """
import sys
from pathlib import Path
from flexmb.results.crash_safe_file import WriteLock
lock = WriteLock(Path(sys.argv[1]))
sys.stdout.write("locked\\n")
sys.stdout.flush()
sys.stdin.read()
"""


def test_one_writer_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "result.h5"
    first = WriteLock(path)
    with pytest.raises(BlockingIOError, match="another run"):
        WriteLock(path)
    assert not path.exists()
    first.release()
    first.release()
    assert list(tmp_path.iterdir()) == []
    WriteLock(path).release()


def test_a_lock_file_left_by_a_killed_run_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "result.h5.lock").touch()
    WriteLock(tmp_path / "result.h5").release()


@pytest.mark.seconds
def test_another_process_holds_it_until_it_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "result.h5"
    words = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip() == b"locked"
        with pytest.raises(BlockingIOError, match="another run"):
            WriteLock(path)
        process.kill()
    WriteLock(path).release()


@posix
def test_a_lock_file_removed_while_it_is_taken_is_created_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last owner removes it between our opening and our claim: two runs must not both write."""
    import fcntl

    path, claim = tmp_path / "result.h5", fcntl.flock
    removed = []

    def claim_late(descriptor: int, operation: int) -> None:
        if not removed:
            removed.append(True)
            path.with_name("result.h5.lock").unlink()
        claim(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", claim_late)
    first = WriteLock(path)
    assert removed
    with pytest.raises(BlockingIOError):
        WriteLock(path)
    first.release()


@posix
def test_a_network_disk_without_locks_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fcntl

    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    lock = WriteLock(tmp_path / "result.h5")
    lock.release()
