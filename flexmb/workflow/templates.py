"""Scenes to start from, which come with the package.

In: the name of a template and a folder. Out: the folder with ``scene.toml`` and the meshes it
needs: a scene that runs as it stands. Nothing that exists is overwritten.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from flexmb.errors import FlexmbError, OutputError, Problem, nearest

__all__ = ["new_scene", "templates"]

_SIMPLEST = "pendulum"
_HOME = Path(__file__).parents[1] / "templates"
_SCENE = "scene.toml"


def templates() -> dict[str, str]:
    """The title of each template by its name."""
    found = sorted(_HOME.glob(f"*/{_SCENE}"))
    return {path.parent.name: _title(path) for path in found}


def new_scene(folder: str | Path, template: str | None = None) -> Path:
    """Write a template into a new folder; returns the path of its scene.

    Parameters
    ----------
    folder : path
        Made if it is missing.
    template : str, optional
        A name of :func:`templates`; the simplest one by default.

    Raises
    ------
    FlexmbError
        No such template; lists those there are, nearest first.
    OutputError
        A file of the template is there already, or the folder cannot be written.
    """
    names, template = tuple(templates()), template or _SIMPLEST
    if template not in names:
        what = f'unknown template "{template}"'
        raise FlexmbError.from_problems([Problem("", what, names, nearest(template, names))])
    target = Path(folder)
    sources = sorted(path for path in (_HOME / template).iterdir() if path.is_file())
    taken = [str(target / path.name) for path in sources if (target / path.name).exists()]
    if taken:
        what = f"{', '.join(taken)}: there already, and never overwritten; choose another name"
        raise OutputError(what)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for path in sources:
            with (target / path.name).open("xb") as file:
                file.write(path.read_bytes())
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from None
    return target / _SCENE


def _title(path: Path) -> str:
    return str(tomllib.loads(path.read_text(encoding="utf-8"))["title"])
