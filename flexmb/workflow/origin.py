"""Where a result comes from, kept with it: what a resumed run must find unchanged.

In: the model, its flexible bodies, the folder of the result. Out: one text of JSON: version, hash
of the compiled code, the scene file with what was changed of it, a hash of every flexible body.
Read back, it tells what has changed since.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbError

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = ["body_hash", "made_by", "origin", "origin_text", "scene_changes"]

ORIGIN = "origin"  # name of the text in the result
_MOST = 8  # changes told; a scene rewritten from scratch has too many to read
_EXTENDED = ("dynamics.duration", "dynamics.outputs")


def made_by() -> dict[str, str]:
    """This version of flexmb and the hash of its compiled code."""
    from flexmb import __version__
    from flexmb.engine.unit_cache import engine_hash

    return {"flexmb": __version__, "engine": engine_hash()}


def origin_text(
    model: Model, folder: Path, bodies: Mapping[str, FlexBody], begun_from: Path | None = None
) -> str:
    """The text to keep with a result in `folder`."""
    known: dict[str, Any] = made_by()
    known["bodies"] = {
        name: {"hash": body_hash(body), "key": body.provenance.get("key", "")}
        for name, body in bodies.items()
    }
    if model.source is not None:
        known["scene_file"] = _relative(model.source.path, folder)
        known["overrides"] = dict(model.source.overrides)
    if begun_from is not None:
        known["from"] = str(begun_from)
    return json.dumps(known, default=str)


def origin(result: Result) -> dict[str, Any]:
    """What the result knows of where it comes from; empty if nothing."""
    known: dict[str, Any] = json.loads(result.texts.get(ORIGIN, "{}"))
    return known


def body_hash(body: FlexBody) -> str:
    """Hash of all that a flexible body is, but for its provenance."""
    from flexmb.flexbody.body_file import to_datasets

    digest = hashlib.sha256(repr((body.name, body.mass)).encode())
    for path, value in sorted(to_datasets(body).items()):
        if not path.startswith("provenance/"):
            digest.update(path.encode())
            data = repr(value).encode() if isinstance(value, list) else np.asarray(value).tobytes()
            digest.update(data)
    return digest.hexdigest()


def scene_changes(result: Result) -> tuple[Path, list[str]] | None:
    """The scene file of a result and what has changed in it since; None where it is not found."""
    from flexmb.model import load_scene

    known = origin(result)
    path = Path(os.path.normpath(result.path.parent / known.get("scene_file", "")))
    if "scene_file" not in known or not path.is_file():
        return None
    names = {name: file.name for name, file in result.flexbodies.items()}
    try:
        model = load_scene(path, known.get("overrides", {}))
        now = model.to_scene_dict(result.path.parent, names)
    except FlexmbError as error:
        return path, [f"it has mistakes now: {str(error).splitlines()[0]}"]
    now = json.loads(json.dumps(now))
    changes = [
        change
        for where, change in _differences("", result.model, now)
        if not (result.extended and where in _EXTENDED)
    ]
    more = len(changes) - _MOST
    return path, changes[:_MOST] + ([f"and {more} more"] if more > 0 else [])


def _differences(where: str, old: Any, new: Any) -> Iterator[tuple[str, str]]:
    """Places in a scene, and what changed there."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys((*old, *new)):
            place = f"{where}.{key}" if where else str(key)
            if key not in new:
                yield place, f"{place} is gone"
            elif key not in old:
                yield place, f"{place} is new"
            else:
                yield from _differences(place, old[key], new[key])
    elif old != new:
        yield where, f"{where} was {_short(old)}, is {_short(new)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.as_posix()
