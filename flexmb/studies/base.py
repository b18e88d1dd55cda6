"""What a study starts from: a scene file, or a model made in Python, as one kind of data."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flexmb.model import Model
from flexmb.model.bodies.body import FlexbodySpec
from flexmb.model.scenes.scene import load_scene, raw_scene
from flexmb.workflow import output_folder

__all__ = ["Base", "base_of_model", "base_of_scene"]


@dataclass(frozen=True)
class Base:
    """A scene before its knobs are turned.

    Attributes
    ----------
    model : Model
        The model as it stands.
    scene : dict
        Its scene as plain data.
    folder : Path
        What relative paths of the scene are relative to.
    output : Path
        Folder of the study.
    changes : dict
        What is changed for all settings.
    source : str
        The scene file, empty for a model from Python.
    """

    model: Model
    scene: dict[str, Any]
    folder: Path
    output: Path
    changes: dict[str, Any] = field(default_factory=dict)
    source: str = ""

    @property
    def resolved(self) -> bool:
        """Whether all numbers are worked out, so that parameters have no effect any more."""
        return not self.source


def base_of_scene(
    path: str | Path, changes: Mapping[str, Any] | None, output: str | Path | None
) -> Base:
    """The base that a scene file is, some values of which may be changed for all settings.

    Raises
    ------
    SceneError
        All that is wrong with the scene.
    """
    model = load_scene(path, changes)
    folder = output_folder(path) / "study" if output is None else Path(output)
    scene = raw_scene(path)
    return Base(model, scene, Path(path).resolve().parent, folder, dict(changes or {}), str(path))


def base_of_model(model: Model, output: str | Path | None) -> Base:
    """The base that a model is; bodies that are objects in memory are written to the folder."""
    from flexmb.flexbody import save

    model.validate()
    name = re.sub(r"\W+", "_", model.title.lower()).strip("_") or "model"
    folder = (Path("out") / name / "study" if output is None else Path(output)).resolve()
    files: dict[str, Path] = {}
    for body, spec in model.bodies.items():
        if isinstance(spec, FlexbodySpec) and not isinstance(spec.flexbody, str):
            files[body] = Path("given") / f"{body}.flexbody.h5"
            (folder / "given").mkdir(parents=True, exist_ok=True)
            save(spec.flexbody, folder / files[body])
    return Base(model, model.to_scene_dict(folder, files), folder, folder)
