"""Copying a result with all that belongs to it.

In: a result, a folder or file. Out: the same bytes there, with the files of the flexible bodies
beside them, so that the copy can be read, drawn and resumed by itself.
"""

from __future__ import annotations

import filecmp
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from flexmb.errors import OutputError
from flexmb.results.lock import WriteLock

if TYPE_CHECKING:
    from flexmb.results.stored import Stored

__all__ = ["copy_result"]


def copy_result(result: Stored, place: Path) -> Path:
    """Copy a result; see `Result.save`. Returns the path of the new result file."""
    target = place if place.suffix == ".h5" else place / "result.h5"
    bodies = {file: target.parent / file.name for file in result.flexbodies.values()}
    with ExitStack() as stack:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            _lock(stack, result.path, target)
            for source, copy in bodies.items():
                _refuse_another(source, copy)
            for source, copy in {result.path: target, **bodies}.items():
                if not _same(source, copy):
                    shutil.copyfile(source, copy)
        except BlockingIOError as error:
            what = "a run is writing it; save the result when it has ended"
            raise OutputError(f"{result.path}: {what}") from error
        except OSError as error:
            why = error.strerror or error
            what = f"the result cannot be saved at {target} ({why})"
            raise OutputError(f"{error.filename or target}: {what}") from error
    return target


def _lock(stack: ExitStack, source: Path, target: Path) -> None:
    """Keep runs off both files; a folder that cannot be written has no run in it."""
    with suppress(PermissionError):
        stack.callback(WriteLock(source).release)
    if not _same(source, target):
        stack.callback(WriteLock(target).release)


def _same(one: Path, other: Path) -> bool:
    return other.exists() and other.samefile(one)


def _refuse_another(source: Path, copy: Path) -> None:
    """A body's file of another run must not be replaced: that run's result would be lost."""
    if copy.exists() and not filecmp.cmp(source, copy, shallow=False):
        raise OutputError(
            f"{copy}: belongs to another result; save this one in a folder of its own"
        )
