"""A canvas on which VTK draws panels of content, once for a picture, again and again for a film.

Light background, parallel projection, view fitted to the content's extent, one colour scale for all
flexible bodies of a panel. At another time rigid shapes are moved, surfaces of flexible bodies get
new points and values, texts new words; nothing else is made again.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.view.content import Content, Deformed, Solid
from flexmb.view.plot import COLORMAP, DIVERGING, GHOST, INK, PAPER
from flexmb.view.shapes import sharp_edges

Array = NDArray[np.float64]

_FEATURE_DEGREES = 35.0  # edges sharper than this split the shading
_MARGIN = 1.04  # of the fitted view
_ROOM = 0.92  # of the width that is left free beside the colour bar
_BAR = 0.13  # of the width that the colour bar takes
_TITLE, _TEXT, _SMALL = 28, 19, 17  # sizes of texts in pixels of a picture 720 high
_LEAST = 10  # pixels
_LETTER = 0.56  # mean width of a letter over the size of the text
_LIGHT = {"ambient": 0.32, "diffuse": 0.78, "specular": 0.08}  # colours stay those of the scale
_LINE_BODY = 6.0  # width of a beam that has no section


class Canvas:
    """Panels of a picture or film; see the module.

    Parameters
    ----------
    panels : sequence of Content
        Row by row.
    size : (int, int)
        Width and height in pixels.
    columns : int
        Panels side by side.
    smoothing : str
        Of edges: ``"ssaa"``, the finest, or ``"fxaa"``, four times as fast, or ``""``.
    window : bool
        Whether a window opens on the desktop.
    """

    def __init__(
        self,
        panels: Sequence[Content],
        size: tuple[int, int],
        columns: int = 1,
        smoothing: Any = "ssaa",
        window: bool = False,
    ) -> None:
        import pyvista

        rows = -(-len(panels) // columns)
        self.plotter: Any = pyvista.Plotter(
            off_screen=not window,
            window_size=list(size),
            lighting="light kit",
            shape=(rows, columns),
            border=False,
        )
        self.plotter.background_color = PAPER
        cell = (size[0] // columns, size[1] // rows)
        self._panels = []
        for k, content in enumerate(panels):
            self.plotter.subplot(*divmod(k, columns))
            if smoothing:
                self.plotter.enable_anti_aliasing(smoothing)
            self._panels.append(_Panel(self.plotter, content, cell))

    def update(self, panels: Sequence[Content]) -> None:
        """Draw the panels at another time."""
        for panel, content in zip(self._panels, panels, strict=True):
            panel.update(content)

    def image(self) -> NDArray[np.uint8]:
        """The picture (height, width, 3)."""
        return np.asarray(self.plotter.screenshot(None, return_img=True))

    def save(self, path: Path) -> None:
        """Write the picture to a PNG file."""
        from PIL import Image

        Image.fromarray(self.image()).save(path, optimize=True)

    def close(self) -> None:
        """Release the window."""
        self.plotter.close()


class _Panel:
    def __init__(self, plotter: Any, content: Content, size: tuple[int, int]) -> None:
        self.plotter, self.size = plotter, size
        self.renderer = plotter.renderer
        self._moving: list[tuple[Solid, list[Any]]] = []
        self._arrows: list[Any] = []
        if (
            any(part.opacity < 1 for part in (*content.solids, *content.deformed))
            or content.deformed
        ):
            plotter.enable_depth_peeling(6)
        self._bodies = [_Surface(self, body, content) for body in content.deformed]
        self._texts = _Texts(self, content)
        self.update(content)

    def update(self, content: Content) -> None:
        """Move what is drawn."""
        lasting = [solid for solid in content.solids if solid.role != "arrow"]
        if len(lasting) != len(self._moving):
            for solid in lasting[len(self._moving) :]:
                self._moving.append((solid, self._add_solid(solid)))
        for solid, (first, actors) in zip(lasting, self._moving, strict=True):
            assert solid.triangles is first.triangles
            for actor in actors:
                actor.user_matrix = solid.matrix
        for actor in self._arrows:
            self.renderer.remove_actor(actor, render=False)
        self._arrows = []
        for solid in content.solids:
            if solid.role == "arrow":
                actors = self._add_solid(solid)
                for actor in actors:
                    actor.user_matrix = solid.matrix
                self._arrows += actors
        for surface, body in zip(self._bodies, content.deformed, strict=True):
            surface.update(body, content)
        self._texts.update(content)
        self._aim(content)

    def add(self, mesh: Any, **look: Any) -> Any:
        """An actor of this panel."""
        return self.renderer.add_actor(_actor(mesh, look), reset_camera=False, render=False)[0]

    def _add_solid(self, solid: Solid) -> list[Any]:
        shape = solid.triangles
        if solid.role == "grid":
            lines = _mesh(shape.points, (), shape.faces[:, :2])
            return [self.add(lines, color=solid.color, lighting=False, line_width=1.0)]
        mesh = _mesh(shape.points, shape.faces).compute_normals(
            split_vertices=True, feature_angle=_FEATURE_DEGREES
        )
        actors = [self.add(mesh, color=solid.color, opacity=solid.opacity, **_LIGHT)]
        if solid.role == "body":
            edges = sharp_edges(shape.points, shape.faces)
            if len(edges):
                lines = _mesh(shape.points, (), edges)
                actors.append(
                    self.add(lines, color=INK, opacity=0.5, line_width=1.5, lighting=False)
                )
        return actors

    def _aim(self, content: Content) -> None:
        """Look along the direction, fit width and height to what is drawn."""
        axes, size = content.camera.axes, self.size
        spans = content.fitted_points() @ axes.T
        low, high = spans.min(axis=0), spans.max(axis=0)
        width, height, depth = high - low
        everything = content.all_points() @ axes.T
        reach = max(width + height + depth, float(np.ptp(everything, axis=0).sum()), 1e-9)
        bar = _BAR if content.bar else 0.0
        free = self._texts.free
        needed = max(height / free, width * size[1] / size[0] / (_ROOM - bar), 0.02 * reach)
        scale = 0.5 * _MARGIN * needed / content.zoom  # half of the height shown
        middle = 0.5 * (low + high)
        middle[0] += bar * scale * size[0] / size[1]
        middle[1] += (0.94 - free) * scale
        center = middle @ axes
        camera = self.renderer.camera
        camera.parallel_projection = True
        camera.focal_point = center
        camera.position = center + 3 * reach * axes[2]
        camera.up = tuple(axes[1])
        camera.parallel_scale = scale
        camera.clipping_range = (0.05 * reach, 8 * reach)


class _Surface:
    """A flexible body whose points and values change."""

    def __init__(self, panel: _Panel, body: Deformed, content: Content) -> None:
        mesh = _mesh(body.undeformed, body.faces, body.lines if not len(body.faces) else None)
        if len(body.faces):
            mesh.point_data["origin"] = np.arange(mesh.n_points)
            mesh = mesh.compute_normals(split_vertices=True, feature_angle=_FEATURE_DEGREES)
        self.mesh, self.faces = mesh, body.faces
        self.points_of = np.asarray(mesh.point_data.get("origin", np.arange(mesh.n_points)))
        look: dict[str, Any] = {"color": body.color, "opacity": body.opacity}
        if content.scale is not None and body.values is not None:
            mesh.point_data["values"] = body.values[self.points_of] * content.scale.factor
            look |= {"scalars": "values", "clim": content.scale.limits}
            look["cmap"] = DIVERGING if content.scale.least < 0 else COLORMAP
        width = 2.0 if len(body.faces) else _LINE_BODY
        self.actor = panel.add(mesh, line_width=width, **_LIGHT, **look)
        self.edges = sharp_edges(body.undeformed, body.faces) if len(body.faces) else body.lines
        self.outline = self.ghost = None
        if len(body.faces):
            self.outline = _mesh(body.points, (), self.edges)
            panel.add(self.outline, color=INK, opacity=0.35, line_width=1.2, lighting=False)
        if content.outline and len(self.edges):
            self.ghost = _mesh(body.undeformed, (), self.edges)
            panel.add(self.ghost, color=GHOST, line_width=1.4, lighting=False)
        if len(body.faces):
            self._normals = _Normals(np.asarray(mesh.faces).reshape(-1, 4)[:, 1:], mesh.n_points)

    def update(self, body: Deformed, content: Content) -> None:
        points = body.points[self.points_of]
        self.mesh.points = points
        if len(self.faces):
            self.mesh.point_data.active_normals = self._normals.of(points)
        if content.scale is not None and body.values is not None:
            self.mesh.point_data["values"] = body.values[self.points_of] * content.scale.factor
        if self.outline is not None:
            self.outline.points = body.points
        if self.ghost is not None:
            self.ghost.points = body.undeformed


class _Normals:
    """Normals at the points of a surface, of any shape that it takes."""

    def __init__(self, faces: Any, count: int) -> None:
        from scipy.sparse import csr_matrix

        self.faces = faces
        rows, columns = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
        ones = np.ones(len(rows), dtype=np.float32)
        self.sum = csr_matrix((ones, (rows, columns)), shape=(count, len(faces)))

    def of(self, points: Array) -> Any:
        """(n, 3) of unit length."""
        a, b, c = (points[self.faces[:, k]] for k in range(3))
        normals = self.sum @ np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return (normals / np.maximum(length, 1e-300)).astype(np.float32)


class _Texts:
    """Title, caption, colour bar, axes and names."""

    def __init__(self, panel: _Panel, content: Content) -> None:
        width, height = panel.size
        self.panel = panel
        unit = content.font_scale * min(height / 720, width / 1000)
        self.title_size, self.size, self.small = (
            max(round(size * unit), _LEAST) for size in (_TITLE, _TEXT, _SMALL)
        )
        self.title_size = min(
            self.title_size, max(int(0.96 * width / (_LETTER * max(len(content.title), 1))), _LEAST)
        )
        self.title, self.caption = self._text(self.title_size), self._text(self.size)
        self.words, self.free = "", 1.0
        self.labels: list[Any] = []
        if content.scale is not None and content.bar:
            self._add_bar(content)
        size = 0.17 * min(1.0, 1.5 * content.font_scale)
        panel.plotter.add_axes(
            color=INK, line_width=3, viewport=(0.0, 0.0, size * height / width, size)
        )

    def update(self, content: Content) -> None:
        width, height = self.panel.size
        columns = max(int(0.96 * width / (_LETTER * self.size)), 20)
        if content.title + content.caption != self.words:
            self.words = content.title + content.caption
            lines = textwrap.wrap(content.caption, columns)
            top = height - round(0.35 * self.title_size)
            self.title.SetInput(content.title)
            self.title.SetPosition(0.02 * width, top)
            below = top - (round(1.45 * self.title_size) if content.title else 0)
            self.caption.SetInput("\n".join(lines))
            self.caption.SetPosition(0.02 * width, below)
            rest = below - 1.35 * self.size * max(len(lines), 1)
            self.free = max(rest / height, 0.4) - 0.04
        for k, label in enumerate(content.labels):
            if k == len(self.labels):
                self.labels.append(self._label(label.text, label.color))
            self.labels[k].SetPosition(*label.point)

    def _text(self, size: int) -> Any:
        from vtkmodules.vtkRenderingCore import vtkTextActor

        actor = vtkTextActor()
        actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        _style(actor.GetTextProperty(), size, INK)
        actor.GetTextProperty().SetVerticalJustificationToTop()
        self.panel.renderer.AddViewProp(actor)
        return actor

    def _label(self, text: str, color: str) -> Any:
        from vtkmodules.vtkRenderingCore import vtkBillboardTextActor3D

        actor = vtkBillboardTextActor3D()
        actor.SetInput(text)
        style = actor.GetTextProperty()
        _style(style, self.small, color)
        style.SetBackgroundColor(1, 1, 1)
        style.SetBackgroundOpacity(0.75)
        style.SetJustificationToCentered()
        style.SetVerticalJustificationToCentered()
        actor.ForceOpaqueOff()
        actor.SetDisplayOffset(0, round(1.1 * self.small) if color != INK else 0)
        self.panel.renderer.AddViewProp(actor)
        return actor

    def _add_bar(self, content: Content) -> None:
        from vtkmodules.vtkRenderingAnnotation import vtkScalarBarActor

        assert content.scale is not None
        colored = (b.actor for b in self.panel._bodies if b.actor.mapper.scalar_visibility)
        bar = vtkScalarBarActor()
        bar.SetLookupTable(next(colored).mapper.lookup_table)
        bar.SetNumberOfLabels(5)
        bar.SetLabelFormat("%.3g")
        bar.SetUnconstrainedFontSize(True)
        bar.SetWidth(0.055)
        bar.SetHeight(0.56)
        bar.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
        bar.SetPosition(0.895, 0.17)
        _style(bar.GetLabelTextProperty(), self.small, INK)
        self.panel.renderer.AddViewProp(bar)
        title = self._text(self.small)
        words = content.scale.label.replace(" [", "\n[")
        title.SetInput(words)
        title.GetTextProperty().SetJustificationToRight()
        title.GetTextProperty().SetVerticalJustificationToBottom()
        width, height = self.panel.size
        title.SetPosition(0.985 * width, 0.745 * height)


def _style(style: Any, size: int, color: str) -> None:
    """Letters that hold Greek and superscripts, of a size in pixels."""
    from matplotlib import get_data_path
    from pyvista import Color
    from vtkmodules.vtkCommonCore import VTK_FONT_FILE

    style.SetFontFamily(VTK_FONT_FILE)
    style.SetFontFile(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf")
    style.SetFontSize(size)
    style.SetColor(*Color(color).float_rgb)
    style.ShadowOff()
    style.ItalicOff()
    style.BoldOff()


def _actor(mesh: Any, look: dict[str, Any]) -> Any:
    import pyvista

    mapper = pyvista.DataSetMapper(mesh)
    mapper.scalar_visibility = "scalars" in look
    if "scalars" in look:
        table = pyvista.LookupTable(look.pop("cmap"), scalar_range=look["clim"])
        table.SetNanColor(*pyvista.Color(look["color"]).float_rgba)
        mapper.SetScalarModeToUsePointFieldData()
        mapper.SelectColorArray(look.pop("scalars"))
        mapper.lookup_table = table
        mapper.scalar_range = look.pop("clim")
        mapper.interpolate_before_map = True
    property_ = pyvista.Property(interpolation="Phong", **look)
    return pyvista.Actor(mapper=mapper, prop=property_)


def _mesh(points: Any, faces: Any, lines: Any = None) -> Any:
    import pyvista

    def cells(rows: Any) -> Any:
        rows = np.asarray(rows)
        return np.hstack([np.full((len(rows), 1), rows.shape[1]), rows]).ravel()

    has_lines = lines is not None and len(lines) > 0
    return pyvista.PolyData(
        np.asarray(points, dtype=np.float32),
        faces=cells(faces) if len(faces) else None,
        lines=cells(lines) if has_lines else None,
    )
