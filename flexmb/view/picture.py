"""Pictures of a run: at one time, at several side by side, with ghost poses and paths of points.

In: a :class:`Result`, times, options of a ``[view]``. Out: a PNG file, drawn by VTK if it can
render, else by matplotlib; then a text in the picture says what to install.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import Problem, ViewError
from flexmb.flexbody.arrays import Array
from flexmb.model.lookup import Scope
from flexmb.model.scenes.consistency import view_problems
from flexmb.model.scenes.parameters import Time, read_times
from flexmb.model.scenes.sections import ViewSpec
from flexmb.results import Result
from flexmb.view import mpl_renderer, vtk_renderer
from flexmb.view.content import Content, Solid, Trace
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.plot import LINES, writable_file
from flexmb.view.shapes import Triangles

_MIN_PIXELS = 64


_PATH_POINTS = 400
_FAINT, _CLEAR = 0.07, 0.22  # opacity of the first and of the last pose
_APART = 2e-3  # distance over the machine's size, about a pixel, above which poses are different
_MAX_PANELS, _MAX_GHOSTS = 24, 60
_CELL = (640, 420)  # pixels of a panel if no size is given


def view_of(mechanism: Mechanism, words: dict[str, Any]) -> ViewSpec:
    """The scene's ``[view]`` with some options replaced.

    Raises
    ------
    ViewError
        Unknown options or wrong values; all at once.
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
    """Draw panels, row by row, with VTK if it can render, else with matplotlib."""
    verdict = vtk_renderer.probe()
    if verdict.works:
        vtk_renderer.draw(panels, path, size, columns, verdict)
    else:
        mpl_renderer.draw(panels, path, size, f"{verdict.how}; {verdict.advice}", columns)


def check_exaggeration(exaggeration: float | str | None) -> None:
    """Refuse anything but a number of at least 0 or ``"auto"``."""
    if isinstance(exaggeration, str) and exaggeration != "auto":
        raise ViewError(f'exaggeration "{exaggeration}" is neither a number nor "auto"')
    if isinstance(exaggeration, int | float) and not 0 <= exaggeration < float("inf"):
        raise ViewError(f"exaggeration {exaggeration} must be a number of at least 0")


def check_size(size: tuple[int, int]) -> None:
    """Refuse less than 64 pixels in width or height."""
    if min(size) < _MIN_PIXELS:
        raise ViewError(f"a picture of {size[0]} x {size[1]} pixels is too small to show anything")


def check_points(mechanism: Mechanism, names: Sequence[str]) -> list[str]:
    """Markers by names of markers, or of bodies, which stand for their centre.

    Raises
    ------
    ViewError
        No such body or marker.
    """
    bodies = mechanism.model.bodies
    for name in names:
        body = name.partition(".")[0]
        if body not in bodies:
            raise ViewError.unknown_name("body", body, bodies)
    center = {name: "origin" if body.flexible else "center" for name, body in bodies.items()}
    markers = [name if "." in name else f"{name}.{center[name]}" for name in names]
    for marker in markers:
        mechanism.point(marker)
    return markers


def trace_points(
    mechanism: Mechanism, markers: Sequence[str], times: Sequence[float]
) -> tuple[Trace, ...]:
    """The paths of markers over the times."""
    path = np.linspace(times[0], times[-1], _PATH_POINTS)
    poses = [mechanism.at(float(time)) for time in path] if markers else []
    return tuple(
        Trace(name, np.array([pose.point(name) for pose in poses]), LINES[k % len(LINES)])
        for k, name in enumerate(markers)
    )


def add_ghosts(content: Content, drawing: Drawing, times: Sequence[float]) -> Content:
    """The content plus the moving bodies at other times as faint shapes, later ones clearer.

    A body at nearly the drawn pose gets no ghost, since its faces would show through.
    """
    ghosts: list[Solid] = []
    bodies = [solid for solid in content.solids if solid.role == "body"]
    clouds = [*(one.points for one in bodies), *(one.points for one in content.deformed)]
    everything = np.vstack([np.zeros((0, 3)), *clouds])
    least = _APART * float(np.ptp(everything, axis=0).max()) if len(everything) else 0.0
    for k, time in enumerate(times):
        opacity = _FAINT + (_CLEAR - _FAINT) * (k + 1) / len(times)
        other = drawing.content(time)
        moved = [solid for solid in other.solids if solid.role == "body"]
        ghosts += [
            replace(solid, opacity=opacity * solid.opacity)
            for solid, here in zip(moved, bodies, strict=True)
            if _is_apart(solid.points, here.points, least)
        ]
        ghosts += [
            Solid(body.name, Triangles(body.points, body.faces), body.color, opacity)
            for body, here in zip(other.deformed, content.deformed, strict=True)
            if _is_apart(body.points, here.points, least)
        ]
    return replace(content, solids=(*content.solids, *ghosts))


def _is_apart(points: Array, others: Array, least: float) -> bool:
    return points.shape != others.shape or bool(np.abs(points - others).max(initial=0.0) > least)


def render(
    result: Result | str | Path,
    time: Time | Sequence[Time] | None = None,
    *,
    ghosts: int = 0,
    traces: Sequence[str] = (),
    output: str | Path = "picture.png",
    **view: Any,
) -> Path:
    """Draw the mechanism at a time, or at several side by side.

    Options that are not given are those of the scene's ``[view]``.

    Parameters
    ----------
    result : Result or path
        The run.
    time : float, str or sequence of them, optional
        Within the run, in the scene's units or with its own, ``"30 ms"``; by default the end.
        Several times, also in one text with commas, have a panel each, with the same view and
        colours.
    ghosts : int
        Number of faint poses at equal times over the whole run (stroboscope).
    traces : sequence of str
        Points whose paths are shown: markers, or bodies, which stand for their centre.
    output : path
        A file that ends in .png.
    **view
        Any word of the scene's ``[view]``: ``color="von_mises"``, ``camera=["front", "top"]``,
        ``exaggeration=50``, ``reference="rod.big_end"``, ``forces="reactions"``,
        ``labels="bodies"``, ``follow="car"``, ``zoom=2``, ``size=(1920, 1080)``, ...

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ViewError
        A wrong option, nothing to draw, or the file cannot be written.
    ResultFileError
        The time is outside the run, or the file is not a result.
    BodyFileError
        A flexible-body file is missing or damaged.
    """
    path = writable_file(output, (".png",))
    run = result if isinstance(result, Result) else Result(result)
    times = [None] if time is None else read_times(run.model, time)
    several = len(times) > 1 or not isinstance(time, int | float | str | None)
    check_numbers(len(times), ghosts)
    mechanisms = [Mechanism(run, times[0])]
    mechanisms += [mechanisms[0].at(t) for t in times[1:] if t is not None]
    for mechanism in mechanisms:
        run.row_at(mechanism.time)
    spec = view_of(mechanisms[0], view)
    points = check_points(mechanisms[0], traces)
    span = float(run.time[0]), float(run.time[-1])
    others = np.linspace(*span, ghosts).tolist()
    drawn = [*(mechanism.time for mechanism in mechanisms), *others]
    drawing = Drawing(mechanisms[0], spec, sorted(drawn) if len(drawn) > 1 else None, film=False)
    paths = trace_points(mechanisms[0], points, span)
    panels = [
        add_ghosts(replace(content, traces=paths), drawing, others)
        for mechanism in mechanisms
        for content in drawing.contents(mechanism.time)
    ]
    columns = columns_of(len(panels))
    rows = -(-len(panels) // columns)
    pixels = spec.size
    if several and "size" not in view:
        pixels = _CELL[0] * columns, _CELL[1] * rows
    check_size((pixels[0] // columns, pixels[1] // rows))
    draw_panels(panels, path, pixels, columns)
    return path


def check_numbers(times: int, ghosts: int) -> None:
    """Refuse more panels or poses than can be distinguished."""
    if not 1 <= times <= _MAX_PANELS:
        raise ViewError(f"{times} times make no picture: give 1 to {_MAX_PANELS}, or make a film")
    if not 0 <= ghosts <= _MAX_GHOSTS:
        raise ViewError(f"{ghosts} ghost poses cannot be told apart: give 1 to {_MAX_GHOSTS}")
