"""Drawing pictures with matplotlib, where VTK cannot render.

In: a :class:`Content`, or several for a grid, a size in pixels, a file. Out: a PNG of the same
content, with shaded triangles sorted by depth; a text in the picture says what to install for the
better renderer.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.flexbody.arrays import Array
from flexmb.folders import whole_file
from flexmb.view.content import Content
from flexmb.view.plot import COLORMAP, DIVERGING, GHOST, INK, PAPER

_DPI = 100
_LETTERS = 1.25  # characters of size 1 per pixel of the width, with some margin
_AMBIENT = 0.45  # brightness of a face turned away from the light
# direction of the light, over the shoulder of the eye: right, above, towards
_LAMP = (-0.3, 0.5, 0.8)
_WARNING = "#a33a00"


def draw(
    panels: Sequence[Content], path: Path, size: tuple[int, int], reason: str, columns: int = 1
) -> None:
    """Draw panels, row by row, into a PNG file of `size` pixels; `reason` is shown in it."""
    with whole_file(path) as partial:
        _figure(panels, size, reason, columns).savefig(partial, dpi=_DPI, facecolor=PAPER)


def image(
    panels: Sequence[Content], size: tuple[int, int], reason: str, columns: int = 1
) -> NDArray[np.uint8]:
    """The picture as an array (height, width, 3)."""
    canvas = _figure(panels, size, reason, columns).canvas
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3]


def _figure(panels: Sequence[Content], size: tuple[int, int], reason: str, columns: int) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    rows = -(-len(panels) // columns)
    cells = figure.subfigures(rows, columns, squeeze=False, wspace=0, hspace=0).flat
    for content, cell in zip(panels, cells, strict=False):
        _draw_panel(cell, content, rows)
    note = "\n".join(textwrap.wrap(f"Simple picture: {reason}", 150))
    figure.text(0.02, 0.02, note, fontsize=8.5, color=_WARNING, va="bottom")
    return figure


def _draw_panel(cell: Any, content: Content, rows: int) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import Normalize

    cell.set_facecolor("none")
    axes = cell.add_axes((0.03, 0.13, 0.84 if content.bar else 0.94, 0.74))
    axes.set_aspect("equal")
    axes.set_axis_off()
    view = content.camera.axes
    polygons, colors = _shaded(content, view)
    axes.add_collection(PolyCollection(polygons, facecolors=colors, edgecolors="face", lw=0.2))
    for segments, color, width in _segments(content, view):
        axes.add_collection(LineCollection(segments, colors=color, linewidths=width))
    flat = content.fitted_points() @ view.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    pad = 0.06 * max((high - low)[:2]) / content.zoom
    axes.set_xlim(low[0] - pad, high[0] + pad)
    axes.set_ylim(low[1] - pad, high[1] + pad)
    for label in content.labels:
        axes.text(
            *(view @ label.point)[:2], label.text, fontsize=11, color=label.color, ha="center"
        )
    for text, y, size in ((content.title, 0.955, 16), (content.caption, 0.905, 12)):
        font = min(max(size * rows**-0.5, 7.0), _LETTERS * cell.bbox.width / max(len(text), 1))
        cell.text(0.02, y, text, fontsize=font, color=INK, va="center")
    if content.scale is not None and content.bar:
        mapped = ScalarMappable(Normalize(*content.scale.limits), _colors(content))
        bar = cell.colorbar(mapped, cax=cell.add_axes((0.9, 0.2, 0.018, 0.6)))
        bar.set_label(content.scale.label, color=INK)
        bar.outline.set_visible(False)


def _shaded(content: Content, view: Array) -> tuple[Any, Array]:
    """Triangles in the picture plane, far ones first: corners (t, 3, 2) and RGBA (t, 4)."""
    from matplotlib import colormaps
    from matplotlib.colors import to_rgba

    corners, colors = [np.zeros((0, 3, 3))], [np.zeros((0, 4))]

    def add(points: Array, faces: NDArray[np.int64], rgba: Any) -> None:
        corners.append(points[faces])
        colors.append(np.broadcast_to(rgba, (len(faces), 4)))

    for solid in content.solids:
        add(solid.points, solid.triangles.faces, to_rgba(solid.color, solid.opacity))
    for body in content.deformed:
        color: Any = to_rgba(body.color)
        if content.scale is not None and body.values is not None and len(body.faces):
            share = content.scale.shares(body.values[body.faces].mean(axis=1))
            color = colormaps[_colors(content)].with_extremes(bad=color)(share)
        add(body.points, body.faces, color)
    seen = np.concatenate(corners) @ view.T
    rgba = np.concatenate(colors).copy()
    lit = np.abs(_normals(*seen.transpose(1, 0, 2)) @ (np.array(_LAMP) / np.linalg.norm(_LAMP)))
    rgba[:, :3] *= _AMBIENT + (1.0 - _AMBIENT) * lit[:, None]
    order = np.argsort(seen[:, :, 2].mean(axis=1))
    return seen[order, :, :2], np.clip(rgba[order], 0.0, 1.0)


def _segments(content: Content, view: Array) -> list[tuple[Any, Any, float]]:
    """Line segments (l, 2, 2) in the picture plane with colours and widths: beams and outlines."""
    from matplotlib import colormaps

    drawn: list[tuple[Any, Any, float]] = [
        ((trace.points @ view.T)[None, :, :2], trace.color, 1.5) for trace in content.traces
    ]
    for body in content.deformed:
        edges = body.edges if len(body.faces) else body.lines
        if content.outline:
            drawn.append(((body.undeformed @ view.T)[edges][:, :, :2], GHOST, 0.7))
        if len(body.lines) and not len(body.faces):  # else they are inside what is drawn
            color: Any = body.color
            if content.scale is not None and body.values is not None:
                color = colormaps[_colors(content)](
                    content.scale.shares(body.values[body.lines].mean(axis=1))
                )
            drawn.append(((body.points @ view.T)[body.lines][:, :, :2], color, 4.0))
    return drawn


def _colors(content: Content) -> str:
    """The colour map of the scale."""
    return DIVERGING if content.scale is not None and content.scale.least < 0 else COLORMAP


def _normals(a: Array, b: Array, c: Array) -> Array:
    """Unit normals (t, 3) of triangles with these corners (t, 3)."""
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))
