"""Scene files: TOML in, a model out. The file is data and never executed."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.model.model import Model, Source
from flexmb.model.scenes.conversion import build
from flexmb.model.scenes.study import override

_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")


def load_scene(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Model:
    """Read a scene file.

    Parameters
    ----------
    path : path
        The TOML file; paths in it are relative to its folder.
    overrides : mapping, optional
        New values by name: a parameter (``"speed"``) or a path (``"dynamics.step"``); texts are
        read as in the file, so that expressions work.

    Returns
    -------
    Model
        The validated model.

    Raises
    ------
    SceneError
        The file cannot be read, or all mistakes of the scene at once.
    """
    path = Path(path)
    text = _text(path)
    scene = _parse(path, text)
    if overrides:
        scene, problems = override(scene, overrides)
        if problems:
            raise SceneError.from_problems(problems)
    model = build(Model, scene, path.parent)
    model.source = Source(path.resolve(), text, dict(overrides or {}))
    return model


def raw_scene(path: str | Path) -> dict[str, Any]:
    """The tables of a scene file as they stand, not checked.

    Raises
    ------
    SceneError
        The file cannot be read or is no TOML.
    """
    path = Path(path)
    return _parse(path, _text(path))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SceneError.from_problems([_not_there(path)]) from None
    except UnicodeDecodeError as error:
        what = f"is no text in UTF-8 (byte {error.start}); a scene is a TOML file"
        raise SceneError.from_problems([Problem(str(path), what)]) from None
    except (OSError, ValueError) as error:
        if os.path.isdir(path):  # of which Windows says that it may not be read
            inside = " (it holds scene.toml: name that)" if (path / "scene.toml").is_file() else ""
            raise SceneError(f"{path}: is a folder, not a scene file{inside}") from None
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read ({reason})") from None


def _not_there(path: Path) -> Problem:
    if path.parent.is_dir():
        return Problem(str(path), "no such file", (), nearest(path.name, _listing(path.parent)))
    return Problem(str(path), f"no such file: the folder {path.parent} does not exist")


def _listing(folder: Path) -> list[str]:
    try:
        return sorted(entry.name for entry in folder.iterdir())
    except OSError:
        return []


def _parse(path: Path, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        match = _PLACE.search(message)
        reason = message[: match.start()] if match else message
        lines = text.splitlines() or [""]
        if match and match[1]:
            line, column = int(match[1]), int(match[2])
        else:
            line, column = len(lines), len(lines[-1]) + 1
        shown = lines[min(line, len(lines)) - 1].replace("\t", " ")
        what = f"not TOML: {reason} at line {line}, column {column}"
        caret = f"\n    {shown}\n    {' ' * (column - 1)}^"
        raise SceneError.from_problems([Problem(str(path), what + caret)]) from None
    except RecursionError:
        raise SceneError(f"{path}: not TOML: nested too deeply") from None
