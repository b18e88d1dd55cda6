"""Where a scene's output goes when nothing else is said, and whether it can go there."""

from __future__ import annotations

import tempfile
from pathlib import Path

from flexmb.errors import OutputError

__all__ = ["output_folder", "writable_folder"]


def output_folder(scene: str | Path) -> Path:
    """``out/<name>``, the name being that of the scene's folder for a file ``scene.toml``."""
    path = Path(scene)
    return Path("out") / (path.resolve().parent.name if path.stem == "scene" else path.stem)


def writable_folder(folder: Path) -> Path:
    """The folder, made if it is missing.

    Raises
    ------
    OutputError
        It cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        files = [path for path in (folder, *folder.parents) if path.is_file()]
        why = f"{files[0]} is a file" if files else error.strerror
        raise OutputError(f"cannot write to the output folder {folder}: {why}") from None
