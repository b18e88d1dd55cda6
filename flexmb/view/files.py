"""The files that pictures and plots go to, checked before any work is done."""

from __future__ import annotations

from pathlib import Path

from flexmb.errors import ViewError

__all__ = ["writable_file"]


def writable_file(output: str | Path, endings: tuple[str, ...]) -> Path:
    """The path, its folder made, if a file with one of these endings can be written there.

    Raises
    ------
    ViewError
        Another ending, a folder in its place, or the folder cannot be made or written.
    """
    path = Path(output)
    if path.suffix.lower() not in endings:
        raise ViewError(f"{path}: the file must end in {' or '.join(endings)}")
    if path.is_dir():
        raise ViewError(f"{path}: is a folder; give the name of a file in it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        with path.open("ab"):
            pass
        if new:
            path.unlink()
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path
