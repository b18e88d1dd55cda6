"""Several times of a motion: what their pictures have in common, paths of points, ghost poses.

In: a :class:`Mechanism`, times, the options of `compose`. Out: a :class:`Framing` for all pictures
of the motion, paths, and a :class:`Content` with the poses before and after in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexmb.errors import ViewError
from flexmb.model.reading import GROUND
from flexmb.view.content import Content, Mechanism, Solid, Trace, Triangles
from flexmb.view.framing import Framing, common_box, largest_scale
from flexmb.view.picture import color_scale, compose, exaggeration_factor
from flexmb.view.plot import LINES

_SAMPLES = 24  # pictures that the view is fitted to
_COLOR_SAMPLES = 240  # times at which the greatest value of the colours is looked for
_PATH_POINTS = 400
_FAINT, _CLEAR = 0.07, 0.22  # opacity of the first and of the last pose


def survey(
    mechanism: Mechanism,
    times: Sequence[float],
    exaggeration: float | str,
    look: dict[str, Any],
    follow: str | None = None,
    traces: tuple[Trace, ...] = (),
) -> Framing:
    """What pictures at these times have in common.

    Parameters
    ----------
    mechanism : Mechanism
        At any time.
    times : sequence of float
        In the scene's units; some of them are looked at.
    exaggeration : float or "auto"
        Of deformations.
    look : dict
        Options of `compose`.
    follow : str, optional
        A body in the middle of the view.
    traces : tuple of Trace
        To be in the view.
    """
    poses = [mechanism.at(time) for time in some_times(times, _SAMPLES)]
    factor = exaggeration_factor(poses, exaggeration)
    contents = [compose(one, exaggeration=factor, **look) for one in poses]
    first = Framing(max(content.size for content in contents), factor, contents[0].camera)
    contents = [replace(compose(one, framing=first, **look), traces=traces) for one in poses]
    centers = [np.zeros(3) if follow is None else one.pose(follow).r for one in poses]
    colored = some_times(times, _COLOR_SAMPLES) if contents[0].deformed else []
    step = float(np.min(np.diff(times))) if len(times) > 1 else 0.0
    return replace(
        first,
        box=common_box(contents, centers),
        scale=largest_scale(color_scale(mechanism.at(t), **look) for t in colored),
        digits=max(0, 1 - math.floor(math.log10(step))) if step > 0.0 else None,
    )


def some_times(times: Sequence[float], count: int) -> list[float]:
    """So many of the times, the first and the last among them."""
    return [times[k] for k in np.linspace(0, len(times) - 1, min(count, len(times))).astype(int)]


def check_points(mechanism: Mechanism, names: Sequence[str]) -> list[str]:
    """Markers by the names of bodies, whose centre is meant, or of markers.

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
    """The paths of markers from the first to the last time."""
    path = np.linspace(times[0], times[-1], _PATH_POINTS)
    poses = [mechanism.at(float(time)) for time in path] if markers else []
    return tuple(
        Trace(name, np.array([pose.point(name) for pose in poses]), LINES[k % len(LINES)])
        for k, name in enumerate(markers)
    )


def add_ghosts(
    content: Content,
    mechanism: Mechanism,
    times: Sequence[float],
    framing: Framing,
    look: dict[str, Any],
) -> Content:
    """The content with the moving bodies at other times as faint shapes, later ones clearer."""
    ghosts: list[Solid] = []
    for k, time in enumerate(times):
        opacity = _FAINT + (_CLEAR - _FAINT) * (k + 1) / len(times)
        other = compose(mechanism.at(time), framing=framing, **look)
        ghosts += [
            replace(solid, opacity=opacity * solid.opacity)
            for solid in other.solids
            if solid.name not in (GROUND, "")
        ]
        ghosts += [
            Solid(body.name, Triangles(body.points, body.faces), body.color, opacity)
            for body in other.deformed
        ]
    return replace(content, solids=(*content.solids, *ghosts))
