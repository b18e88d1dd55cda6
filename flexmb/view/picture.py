"""What a picture is asked to show, and its drawing.

In: words of a ``[view]``; contents. Out: a checked :class:`ViewSpec`; a PNG file, drawn by VTK
where it renders, else by matplotlib, which then says so in the picture and names what to install.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexmb.errors import Problem, ViewError
from flexmb.model.lookup import Scope
from flexmb.model.scenes.consistency import view_problems
from flexmb.model.scenes.sections import ViewSpec
from flexmb.view import mpl_renderer, vtk_renderer
from flexmb.view.content import Content
from flexmb.view.mechanism import Mechanism

_MIN_PIXELS = 64


def view_of(mechanism: Mechanism, words: dict[str, Any]) -> ViewSpec:
    """What the scene's ``[view]`` says, and these words of it in their place.

    Raises
    ------
    ViewError
        Words or values that it does not know; all at once.
    """
    model = mechanism.model
    words = {key: value for key, value in words.items() if value is not None}
    scene_words = dict(mechanism.result.model.get("view", {}))
    if {"camera", "direction"} & {*words}:
        scene_words.pop("direction", None)
        scene_words.pop("camera", None)
    try:
        view = model.set_view(**{**scene_words, **words})
        problems = list(view_problems(Scope(model, mechanism.flexbodies, {})))
    except Exception as error:
        problems = list(getattr(error, "problems", ()))
        if not problems:
            raise
    if problems:
        raise ViewError.from_problems(
            [Problem(p.where.removeprefix("view."), p.what, p.allowed, p.nearest) for p in problems]
        )
    return view


def columns_of(count: int) -> int:
    """Columns of a grid of pictures."""
    return 1 if count == 1 else 2 if count in (2, 4) else 3


def draw_panels(
    panels: Sequence[Content], path: Path, size: tuple[int, int], columns: int = 1
) -> None:
    """Draw panels, row by row, with VTK where it renders, else with matplotlib."""
    verdict = vtk_renderer.probe()
    if verdict.works:
        vtk_renderer.draw(panels, path, size, columns, verdict)
    else:
        mpl_renderer.draw(panels, path, size, f"{verdict.how}; {verdict.advice}", columns)


def check_exaggeration(exaggeration: float | str | None) -> None:
    """Refuse what is neither a number of at least 0 nor ``"auto"``."""
    if isinstance(exaggeration, str) and exaggeration != "auto":
        raise ViewError(f'exaggeration "{exaggeration}" is neither a number nor "auto"')
    if isinstance(exaggeration, int | float) and not 0 <= exaggeration < float("inf"):
        raise ViewError(f"exaggeration {exaggeration} must be a number of at least 0")


def check_size(size: tuple[int, int]) -> None:
    """Refuse fewer than 64 pixels either way."""
    if min(size) < _MIN_PIXELS:
        raise ViewError(f"a picture of {size[0]} x {size[1]} pixels is too small to show anything")
