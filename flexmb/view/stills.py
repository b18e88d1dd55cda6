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
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.motion import add_ghosts, check_points, trace_points
from flexmb.view.picture import check_size, columns_of, draw_panels, view_of
from flexmb.view.plot import writable_file

_MAX_PANELS, _MAX_GHOSTS = 24, 60
_CELL = (640, 420)  # pixels of a panel where the size is not given


def render(
    result: Result | str | Path,
    time: float | Sequence[float] | None = None,
    *,
    ghosts: int = 0,
    traces: Sequence[str] = (),
    output: str | Path = "picture.png",
    **view: Any,
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
    ghosts : int
        So many poses of the whole run are shown faintly, at equal times (stroboscope).
    traces : sequence of str
        Points whose paths are shown: bodies, whose centre is meant, or markers.
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
    """Refuse more panels or poses than can be told apart."""
    if not 1 <= times <= _MAX_PANELS:
        raise ViewError(f"{times} times make no picture: give 1 to {_MAX_PANELS}, or make a film")
    if not 0 <= ghosts <= _MAX_GHOSTS:
        raise ViewError(f"{ghosts} ghost poses cannot be told apart: give 1 to {_MAX_GHOSTS}")
