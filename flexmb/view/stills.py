"""Pictures of a run: at one time, at several side by side, with ghost poses and paths of points.

In: a :class:`Result`, times, how much to exaggerate deformations. Out: a PNG file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import ViewError
from flexmb.results import Result
from flexmb.view.content import Content, Mechanism
from flexmb.view.motion import add_ghosts, check_points, survey, trace_points
from flexmb.view.picture import check_look, check_size, compose, draw_panels
from flexmb.view.plot import writable_file

_MAX_PANELS, _MAX_GHOSTS = 24, 60
_CELL = (640, 420)  # pixels of a panel where the size is not given


def render(
    result: Result | str | Path,
    time: float | Sequence[float] | None = None,
    *,
    exaggeration: float | str | None = None,
    color: str = "displacement",
    layer: str | None = None,
    direction: tuple[float, float, float] | None = None,
    size: tuple[int, int] | None = None,
    ghosts: int = 0,
    traces: Sequence[str] = (),
    output: str | Path = "picture.png",
) -> Path:
    """Draw the mechanism at a time, or at several side by side.

    What is left out follows the scene's ``[view]``.

    Parameters
    ----------
    result : Result or path
        The run.
    time : float or sequence of float, optional
        Within the run, in the scene's units; the end if the scene does not say. Several have a
        panel each, with the same view and colours.
    exaggeration : float or "auto", optional
        Factor on the deformation of flexible bodies; ``"auto"`` chooses a round one that shows it.
        The factor is written in the picture.
    color : str
        ``"displacement"`` colours flexible bodies by the magnitude of their displacement relative
        to the body frame, ``"von_mises"`` by their stress, ``"body"`` gives every body its own.
    layer : str, optional
        The layer whose stress is shown, such as ``"top"``; by default the largest of all layers.
    direction : three floats, optional
        From the scene towards the eye, global axes; along the joint axes if the scene does not say.
    size : two ints, optional
        Width and height in pixels; 1280 by 720 if the scene does not say.
    ghosts : int
        So many poses of the whole run are shown faintly, at equal times (stroboscope).
    traces : sequence of str
        Points whose paths are shown: bodies, whose centre is meant, or markers.
    output : path
        A file that ends in .png.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ViewError
        An option that cannot be, nothing to draw, or the file cannot be written.
    ResultFileError
        The time lies outside the run, or the file is no result.
    BodyFileError
        A flexible-body file is missing or damaged.
    """
    path = writable_file(output, (".png",))
    run = result if isinstance(result, Result) else Result(result)
    several = time is not None and not isinstance(time, int | float)
    times = [time] if time is None or isinstance(time, int | float) else [*map(float, time)]
    check_numbers(len(times), ghosts)
    mechanisms = [Mechanism(run, times[0])]
    mechanisms += [mechanisms[0].at(t) for t in times[1:] if t is not None]
    for mechanism in mechanisms:
        run.row_at(mechanism.time)
    view = mechanisms[0].model.view
    factor = view.exaggeration if exaggeration is None else exaggeration
    check_look(color, factor, layer)
    columns = 1 if len(times) == 1 else 2 if len(times) in (2, 4) else 3
    rows = -(-len(times) // columns)
    pixels = size or ((_CELL[0] * columns, _CELL[1] * rows) if several else view.size)
    check_size((pixels[0] // columns, pixels[1] // rows))
    points = check_points(mechanisms[0], traces)
    look: dict[str, Any] = {"color": color, "layer": layer, "direction": direction}
    if len(times) == 1 and not ghosts and not points:
        panels = [compose(mechanisms[0], exaggeration=factor, **look)]
    else:
        panels = _panels(mechanisms, factor, look, ghosts, points)
    draw_panels(panels, path, pixels, columns)
    return path


def check_numbers(times: int, ghosts: int) -> None:
    """Refuse more panels or poses than can be told apart."""
    if not 1 <= times <= _MAX_PANELS:
        raise ViewError(f"{times} times make no picture: give 1 to {_MAX_PANELS}, or make a film")
    if not 0 <= ghosts <= _MAX_GHOSTS:
        raise ViewError(f"{ghosts} ghost poses cannot be told apart: give 1 to {_MAX_GHOSTS}")


def _panels(
    mechanisms: list[Mechanism],
    exaggeration: float | str,
    look: dict[str, Any],
    ghosts: int,
    points: list[str],
) -> list[Content]:
    """One for each mechanism, with the same view, colours and exaggeration."""
    run = mechanisms[0].result
    span = (float(run.time[0]), float(run.time[-1]))
    others = np.linspace(*span, ghosts).tolist()
    traces = trace_points(mechanisms[0], points, span)
    times = [*(mechanism.time for mechanism in mechanisms), *others]
    framing = replace(survey(mechanisms[0], times, exaggeration, look, traces=traces), digits=None)
    panels = []
    for mechanism in mechanisms:
        content = replace(compose(mechanism, framing=framing, **look), traces=traces)
        content = replace(content, box=framing.box)
        panels.append(add_ghosts(content, mechanism, others, framing, look))
    return panels
