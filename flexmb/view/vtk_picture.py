"""Drawing a picture's content with VTK, off-screen.

In: a :class:`Content`, or several for a grid, a size in pixels, a file. Out: the PNG. Light
background, parallel projection, view fitted to what is drawn, one colour scale for all flexible
bodies of a panel.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.view.content import Content, Deformed, Solid
from flexmb.view.geometry import joined, sphere
from flexmb.view.style import COLORMAP, GHOST, INK, JOINT, PAPER

__all__ = ["draw"]

_FEATURE_DEGREES = 35.0  # edges sharper than this are drawn as lines
_MARGIN = 1.04  # of the fitted view
_ROOM = (0.90, 0.74)  # of width and height that the captions leave free
_BAR = 0.10  # of the width that the colour bar takes
_LIGHT = {"ambient": 0.32, "diffuse": 0.78, "specular": 0.08}  # colours stay those of the scale


def draw(panels: Sequence[Content], path: Path, size: tuple[int, int], columns: int = 1) -> None:
    """Render panels, row by row, into a PNG file of `size` (width, height) pixels."""
    import pyvista

    rows = -(-len(panels) // columns)
    cell = (size[0] // columns, size[1] // rows)
    plotter = pyvista.Plotter(
        off_screen=True,
        window_size=list(size),
        lighting="light kit",
        shape=(rows, columns),
        border=False,
    )
    try:
        plotter.set_background(PAPER)
        for k, content in enumerate(panels):
            plotter.subplot(*divmod(k, columns))
            _draw_panel(plotter, content, cell)
        plotter.screenshot(str(path))
    finally:
        plotter.close()


def _draw_panel(plotter: Any, content: Content, size: tuple[int, int]) -> None:
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_depth_peeling(8)
    for solid in content.solids:
        _add_solid(plotter, solid)
    for body in content.deformed:
        _add_deformed(plotter, body, content)
    if len(content.joints):
        _add_joints(plotter, content)
    _add_texts(plotter, content, size)
    _aim(plotter, content, size)


def _mesh(points: Any, faces: Any, lines: Any = None) -> Any:
    import pyvista

    def cells(rows: Any) -> Any:
        return np.hstack([np.full((len(rows), 1), rows.shape[1]), rows]).ravel()

    has_lines = lines is not None and len(lines) > 0
    return pyvista.PolyData(
        np.asarray(points, dtype=np.float32),
        faces=cells(faces) if len(faces) else None,
        lines=cells(lines) if has_lines else None,
    )


def _add_solid(plotter: Any, solid: Solid) -> None:
    mesh = _mesh(solid.triangles.points, solid.triangles.faces)
    plotter.add_mesh(
        mesh,
        color=solid.color,
        opacity=solid.opacity,
        smooth_shading=True,
        split_sharp_edges=True,
        feature_angle=_FEATURE_DEGREES,
        **_LIGHT,
    )
    _add_edges(plotter, mesh, INK, 0.5)


def _add_deformed(plotter: Any, body: Deformed, content: Content) -> None:
    mesh = _mesh(body.points, body.faces, body.lines)
    look: dict[str, Any] = {"color": body.color}
    if content.scale is not None and body.values is not None:
        mesh["values"] = body.values * content.scale.factor
        look = {
            "scalars": "values",
            "cmap": COLORMAP,
            "nan_color": body.color,
            "clim": (0.0, content.scale.top or 1.0),
            "show_scalar_bar": False,
        }
    plotter.add_mesh(
        mesh,
        smooth_shading=True,
        split_sharp_edges=len(body.faces) > 0,
        feature_angle=_FEATURE_DEGREES,
        line_width=2 if len(body.faces) else 6,
        **_LIGHT,
        **look,
    )
    ghost = _mesh(body.undeformed, body.faces, body.lines)
    if len(body.faces):
        plotter.add_mesh(ghost, color=GHOST, opacity=0.10, lighting=False)
        _add_edges(plotter, ghost, GHOST, 1.0)
    else:
        plotter.add_mesh(ghost, color=GHOST, line_width=2)


def _add_edges(plotter: Any, mesh: Any, color: str, opacity: float) -> None:
    edges = mesh.extract_feature_edges(
        feature_angle=_FEATURE_DEGREES, manifold_edges=False, non_manifold_edges=False
    )
    if edges.n_cells:
        plotter.add_mesh(edges, color=color, line_width=1.5, opacity=opacity, lighting=False)


def _add_joints(plotter: Any, content: Content) -> None:
    balls = joined([sphere(content.joint_radius, center) for center in content.joints])
    plotter.add_mesh(_mesh(balls.points, balls.faces), color=JOINT, smooth_shading=True, **_LIGHT)


def _add_texts(plotter: Any, content: Content, size: tuple[int, int]) -> None:
    height = size[1]
    large, small = max(round(height / 38), 9), max(round(height / 52), 8)
    place = {"viewport": True, "color": INK}
    first = 1 - 2.1 * large / height  # a line each, also where a panel is low
    second = first - 2.05 * small / height
    plotter.add_text(content.title, position=(0.02, first), font_size=0.72 * large, **place)
    plotter.add_text(content.caption, position=(0.02, second), font_size=0.72 * small, **place)
    if content.notes:
        text = "\n".join(content.notes)
        plotter.add_text(text, position=(0.02, 0.02), font_size=0.72 * small, **place)
    if content.scale is not None and content.bar:
        plotter.add_scalar_bar(
            title=f"{content.scale.label}\n",
            mapper=_colored_mapper(plotter),
            vertical=True,
            position_x=0.885,
            position_y=0.2,
            width=0.05,
            height=0.6,
            n_labels=5,
            fmt="%.3g",
            color=INK,
            title_font_size=round(1.15 * small),
            label_font_size=round(1.15 * small),
        )
    plotter.add_axes(color=INK, line_width=2, viewport=(0.0, 0.0, 0.14, 0.2))


def _colored_mapper(plotter: Any) -> Any:
    for actor in plotter.actors.values():
        mapper = getattr(actor, "mapper", None)
        if mapper is not None and getattr(mapper, "scalar_visibility", False):
            return mapper
    return plotter.mapper


def _aim(plotter: Any, content: Content, size: tuple[int, int]) -> None:
    """Look along the direction, fit width and height to what is drawn."""
    towards = np.array(content.camera.direction)
    up = np.array(content.camera.up)
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    above = np.cross(towards, right)
    points = content.all_points()
    spans = [points @ axis for axis in (right, above, towards)]
    low, high = np.array([s.min() for s in spans]), np.array([s.max() for s in spans])
    width, height, depth = high - low
    reach = max(width + height + depth, 1e-9)
    bar = _BAR if content.bar else 0.0
    needed = max(height / _ROOM[1], width * size[1] / size[0] / (_ROOM[0] - bar), 0.02 * reach)
    scale = 0.5 * _MARGIN * needed  # half of the height shown
    middle = 0.5 * (low + high)
    middle[0] += bar * scale * size[0] / size[1]
    center = middle[0] * right + middle[1] * above + middle[2] * towards
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = center
    plotter.camera.position = center + 3 * reach * towards
    plotter.camera.up = tuple(above)
    plotter.camera.parallel_scale = scale
    plotter.camera.clipping_range = (0.5 * reach, 6 * reach)
