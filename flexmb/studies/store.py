"""What a study keeps on disk: one folder per run, under a key of everything the run depends on.

In: scenes as data, the files they name, the sources of flexmb itself. Out: keys, and records that
are there again after an interruption. A record is written last and in one piece: a run without one
was not finished.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import OutputError

if TYPE_CHECKING:
    from flexmb.model import Model

__all__ = [
    "Store",
    "content_key",
    "has_result",
    "read_record",
    "result_of",
    "run_key",
    "write_record",
]

_FORMAT = 1
_RECORD = "run.json"
_COMPUTING = ("analysis", "engine", "fe", "flexbody", "model", "results", "workflow")
_DIGITS = 16


def content_key(data: Any) -> str:
    """Hash of plain data; the order of tables' keys does not matter."""
    text = json.dumps(data, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


@functools.cache
def _source_key() -> str:
    """Hash of the sources that a run goes through: another version runs anew."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for room in _COMPUTING:
        for path in sorted((root / room).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:_DIGITS]


def _file_key(path: Path) -> str:
    """Hash of a file's content; empty if it cannot be read, which the run itself will tell."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:_DIGITS]
    except OSError:
        return ""


@dataclass(frozen=True)
class Store:
    """The folder of a study."""

    folder: Path

    def make(self) -> None:
        """Make the folder.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                return
        except OSError as error:
            why = error.strerror or error
            raise OutputError(f"cannot write to the folder {self.folder}: {why}") from None

    def run_folder(self, key: str) -> Path:
        """Where a run keeps its result and its record."""
        return self.folder / "runs" / key

    def bodies_folder(self, key: str) -> Path:
        """Where the reduced bodies of a model and the record of their reduction are kept."""
        return self.folder / "bodies" / key


def run_key(model: Model, scene: Mapping[str, Any]) -> str:
    """Key of a run: its scene as resolved, the files that it reads, the code that runs it."""
    contents = {}
    for name, spec in model.bodies.items():
        for source in ("mesh", "flexbody", "modes"):
            given = getattr(spec, source, None)
            if isinstance(given, str):
                contents[f"{name}.{source}"] = _file_key(model.path(given))
    return content_key([_FORMAT, _source_key(), scene, contents])


def read_record(folder: Path) -> dict[str, Any] | None:
    """The record of a run that ended, if there is one."""
    try:
        record = json.loads((folder / _RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and record.get("format") == _FORMAT else None


def result_of(folder: Path) -> Path:
    """The result file of a run."""
    return folder / "result.h5"


def has_result(folder: Path) -> bool:
    """Whether the result of a run is still there."""
    return result_of(folder).is_file()


def write_record(folder: Path, record: Mapping[str, Any]) -> None:
    """Write the record of a run in one piece."""
    draft = folder / f"{_RECORD}.new"
    draft.write_text(json.dumps({"format": _FORMAT, **record}, indent=1), encoding="utf-8")
    os.replace(draft, folder / _RECORD)
