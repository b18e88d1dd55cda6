"""Several times of a motion in one picture: paths of points, ghost poses.

In: a :class:`Mechanism` or a :class:`Drawing`, times. Out: paths, and a :class:`Content` with the
poses before and after in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexmb.errors import ViewError
from flexmb.view.content import Content, Solid, Trace
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.plot import LINES
from flexmb.view.shapes import Triangles

_PATH_POINTS = 400
_FAINT, _CLEAR = 0.07, 0.22  # opacity of the first and of the last pose


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


def add_ghosts(content: Content, drawing: Drawing, times: Sequence[float]) -> Content:
    """The content with the moving bodies at other times as faint shapes, later ones clearer."""
    ghosts: list[Solid] = []
    for k, time in enumerate(times):
        opacity = _FAINT + (_CLEAR - _FAINT) * (k + 1) / len(times)
        other = drawing.content(time)
        ghosts += [
            replace(solid, opacity=opacity * solid.opacity)
            for solid in other.solids
            if solid.role == "body"
        ]
        ghosts += [
            Solid(body.name, Triangles(body.points, body.faces), body.color, opacity)
            for body in other.deformed
        ]
    return replace(content, solids=(*content.solids, *ghosts))
