"""A VTK scene that is reused from one picture of a motion to the next.

Every picture is described by the same sequence of calls, `begin` for a panel, then `add_mesh` and
`add_text` for everything in it. The first time these create actors; from then on the n-th call for
a panel moves the n-th actor: by its user matrix if the points moved as a rigid body, else by new
points and normals in place. An actor is created again only if its triangles or its look changed.
Points are in global axes [m].
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.flexbody.arrays import Array

OVERSAMPLING = 2  # drawn pixels per pixel of the picture, in each direction
FEATURE_DEGREES = 35.0  # edges with a larger angle are drawn as lines, and not smoothed


def _offset_by_mappers_alone() -> None:
    """Let mappers decide what is in front of what; VTK keeps this setting for the whole process."""
    from vtkmodules.vtkRenderingCore import vtkMapper

    vtkMapper.SetResolveCoincidentTopologyToPolygonOffset()
    vtkMapper.SetResolveCoincidentTopologyPolygonOffsetParameters(0.0, 0.0)
    vtkMapper.SetResolveCoincidentTopologyLineOffsetParameters(0.0, 0.0)
    vtkMapper.SetResolveCoincidentTopologyPointOffsetParameter(0.0)


class VtkScene:
    """An off-screen window with panels in rows and columns.

    It is drawn larger than it is shown, which smooths edges and text in half the time of VTK's own
    supersampling. Line widths are those of the picture, text sizes those of the drawing.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels.
    shape : (int, int)
        Rows and columns of panels.
    background : str
        Background colour.
    window : bool
        Whether it is a window on the desktop, whose camera the user moves.
    """

    def __init__(
        self, size: tuple[int, int], shape: tuple[int, int], background: str, window: bool = False
    ) -> None:
        import pyvista

        _offset_by_mappers_alone()
        self.is_window = window
        self.sampling = 1 if window else OVERSAMPLING

        plotter: Any = pyvista.Plotter(
            off_screen=not window,
            window_size=[self.sampling * pixels for pixels in size],
            lighting="light kit",
            shape=shape,
            border=False,
        )
        plotter.set_background(background)
        if not window:
            plotter.disable_anti_aliasing()
        plotter.suppress_rendering = True  # except when a picture is requested
        self.plotter = plotter
        self._parts: dict[tuple[int, int], _Part] = {}  # by panel and number of the call
        self._texts: dict[tuple[int, int], Any] = {}
        self._origins: dict[int, Array] = {}
        self._ready: set[int] = set()
        self.origin, self._panel = np.zeros(3), 0
        self._columns = shape[1]
        self._part_count = self._text_count = 0

    def begin(self, panel: int, origin: Array) -> bool:
        """Begin the description of a panel; returns whether it is the first one.

        The first `origin` (3,) is kept: single precision is relative to it.
        """
        self.origin = self._origins.setdefault(panel, origin)
        self._panel, self._part_count, self._text_count = panel, 0, 0
        self.plotter.subplot(*divmod(panel, self._columns))
        first = panel not in self._ready
        self._ready.add(panel)
        return first

    def end(self) -> None:
        """Remove what the panel showed before and does not show any more."""
        for key in [k for k in self._parts if k[0] == self._panel and k[1] >= self._part_count]:
            self._parts.pop(key).remove(self.plotter)
        for key in [k for k in self._texts if k[0] == self._panel and k[1] >= self._text_count]:
            self.plotter.renderer.RemoveViewProp(self._texts.pop(key))

    def add_mesh(
        self,
        points: ArrayLike,
        faces: NDArray[np.int64],
        lines: NDArray[np.int64] | None = None,
        *,
        look: Mapping[str, Any],
        values: Array | None = None,
        edges: Mapping[str, Any] | None = None,
        matrix: Array | None = None,
    ) -> Any:
        """Add a surface or lines, and its sharp edges if `edges` is given; returns the actor.

        Parameters
        ----------
        points : (n, 3)
            Points.
        faces, lines : (t, 3) and (l, 2)
            Rows of indices into them.
        look : mapping
            Options of ``pyvista.Plotter.add_mesh``.
        values : (n,), optional
            Values for colours.
        edges : mapping, optional
            The look of its sharp edges.
        matrix : (4, 4), optional
            Transform of the points to global axes; they are global without it.
        """
        key = self._panel, self._part_count
        self._part_count += 1
        points = np.asarray(points, dtype=float)
        if matrix is None:
            points = points - self.origin
        look = {**look, "line_width": self.sampling * look.get("line_width", 1.0)}
        if edges is not None:
            edges = {**edges, "line_width": self.sampling * edges.get("line_width", 1.0)}
        part = self._parts.get(key)
        is_like = part is not None and part.is_like(faces, lines, values, edges, look)
        if is_like and matrix is not None:
            is_like = part is not None and np.array_equal(points, part.points)
        if part is not None and not is_like:
            part.remove(self.plotter)
            part = None
        if part is None:
            part = _Part(self.plotter, points, faces, lines, values, edges, look)
            self._parts[key] = part
        elif matrix is None:
            part.move(points, values)
        if matrix is not None:
            relative = matrix.copy()
            relative[:3, 3] -= self.origin
            part.place(relative)
        return part.actor

    def add_lines(self, points: ArrayLike, look: Mapping[str, Any]) -> Any:
        """Add a line through points (n, 3); returns the actor."""
        number = np.arange(len(np.asarray(points)))
        none = np.zeros((0, 3), dtype=np.int64)
        return self.add_mesh(points, none, np.stack([number[:-1], number[1:]], axis=1), look=look)

    def add_text(
        self,
        text: str,
        place: ArrayLike,
        size: int,
        color: str,
        anchor: str = "left top",
        at_point: bool = False,
    ) -> None:
        """Add a text of the given size.

        Parameters
        ----------
        text : str
            One or several lines.
        place : (2,) or (3,)
            Pixels from the lower left of the panel; with `at_point` a global point.
        size : int
            Pixels.
        color : str
            Colour of the text.
        anchor : str
            The point of the text at `place`: ``left``, ``center`` or ``right``, and ``top``,
            ``center`` or ``bottom``.
        at_point : bool
            Whether the text is at a point of the scene, in front of everything.
        """
        key = self._panel, self._text_count
        self._text_count += 1
        if key not in self._texts:
            self._texts[key] = _text_actor(size, color, anchor, at_point)
            self.plotter.renderer.AddViewProp(self._texts[key])
        actor = self._texts[key]
        if actor.GetInput() != text:
            actor.SetInput(text)
        if at_point:
            actor.GetPositionCoordinate().SetValue(*(np.asarray(place) - self.origin))
        else:
            x, y = np.asarray(place)
            actor.SetPosition(x, y)

    def image(self) -> NDArray[np.uint8]:
        """The picture (height, width, 3)."""
        from PIL import Image
        from pyvista import convert_array as to_numpy
        from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

        window = self.plotter.render_window
        window.Render()
        reader = vtkWindowToImageFilter()
        reader.SetInput(window)
        reader.ReadFrontBufferOff()
        reader.ShouldRerenderOff()
        reader.Update()
        picture = reader.GetOutput()
        width, height, _ = picture.GetDimensions()
        pixels: NDArray[np.uint8] = to_numpy(picture.GetPointData().GetScalars())
        picture = Image.fromarray(pixels.reshape(height, width, -1)[::-1, :, :3].copy())
        return np.asarray(picture.reduce(self.sampling))

    def save(self, path: Path) -> None:
        """Write the picture into a PNG file."""
        from PIL import Image

        from flexmb.folders import whole_file

        with whole_file(path) as partial:
            Image.fromarray(self.image()).save(partial, optimize=True)

    def close(self) -> None:
        """Release the window."""
        self.plotter.close()


class _Part:
    """A surface with its actor and that of its edges."""

    def __init__(
        self,
        plotter: Any,
        points: Array,
        faces: NDArray[np.int64],
        lines: NDArray[np.int64] | None,
        values: Array | None,
        edges: Mapping[str, Any] | None,
        look: Mapping[str, Any],
    ) -> None:
        self._description = faces, lines, values is None, edges, look
        self._last = points
        mesh = _polydata(points, faces, lines)
        mesh["point"] = np.arange(len(points))
        self._shading: _Shading | None = None
        if len(faces):
            mesh = mesh.compute_normals(
                cell_normals=False,
                split_vertices=True,
                feature_angle=FEATURE_DEGREES,
                consistent_normals=False,
            )
            self._shading = _Shading(mesh)
        self._numbers = np.asarray(mesh["point"])
        self._mesh = mesh
        if values is not None:
            mesh["values"] = values[self._numbers]
            look = {**look, "scalars": "values"}
        self.actor = plotter.add_mesh(mesh, show_scalar_bar=False, **look)
        if self._shading is not None and look.get("lighting", True):
            self.actor.prop.interpolation = "Phong"
        self._edges, self._edge_actor = None, None
        if edges is not None and len(faces):
            self._add_edges(plotter, points, faces, edges)

    def _add_edges(
        self, plotter: Any, points: Array, faces: NDArray[np.int64], look: Mapping[str, Any]
    ) -> None:
        mesh = _polydata(points, faces, None)
        mesh["point"] = np.arange(len(points))
        edges = mesh.extract_feature_edges(
            feature_angle=FEATURE_DEGREES, manifold_edges=False, non_manifold_edges=False
        )
        if edges.n_cells:
            self._edges = edges
            self._edge_actor = plotter.add_mesh(edges, lighting=False, **look)

    def is_like(
        self,
        faces: NDArray[np.int64],
        lines: NDArray[np.int64] | None,
        values: Array | None,
        edges: Mapping[str, Any] | None,
        look: Mapping[str, Any],
    ) -> bool:
        """Whether only points and values differ."""
        own = self._description
        return (
            _equal(own[0], faces)
            and _equal(own[1], lines)
            and own[2:] == (values is None, edges, look)
        )

    def move(self, points: Array, values: Array | None) -> None:
        """Show it at other points and with other values."""
        if values is not None:
            self._mesh["values"][:] = values[self._numbers]
            self._mesh.GetPointData().Modified()
            self._mesh.Modified()
        if np.array_equal(points, self._last):
            return
        self._last = points
        self._mesh.points[:] = points[self._numbers]
        if self._shading is not None:
            self._mesh.point_data.active_normals[:] = self._shading.normals(points[self._numbers])
        _mark_changed(self._mesh)
        if self._edges is not None:
            self._edges.points[:] = points[np.asarray(self._edges["point"])]
            _mark_changed(self._edges)

    @property
    def points(self) -> Array:
        """Its points before any matrix."""
        return self._last

    def place(self, motion: Array) -> None:
        """Move it by a matrix (4, 4)."""
        for actor in (self.actor, self._edge_actor):
            if actor is not None:
                actor.user_matrix = motion

    def remove(self, plotter: Any) -> None:
        """Take it out of the scene."""
        for actor in (self.actor, self._edge_actor):
            if actor is not None:
                plotter.remove_actor(actor, render=False)


class _Shading:
    """Normals of a surface at its points: area-weighted means of those of its triangles."""

    def __init__(self, mesh: Any) -> None:
        from scipy.sparse import csr_array

        self._faces = np.asarray(mesh.faces).reshape(-1, 4)[:, 1:]
        rows = self._faces.ravel()
        columns = np.repeat(np.arange(len(self._faces)), 3)
        ones = np.ones(len(rows), dtype=np.float32)
        self._sum = csr_array((ones, (rows, columns)), shape=(mesh.n_points, len(self._faces)))

    def normals(self, points: Array) -> Array:
        """(n, 3) of unit length."""
        a, b, c = points[self._faces.T]
        normals = self._sum @ np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.maximum(length, 1e-300))


def _text_actor(size: int, color: str, anchor: str, at_point: bool) -> Any:
    from vtkmodules.vtkRenderingCore import vtkTextActor

    actor = vtkTextActor()
    style = actor.GetTextProperty()
    style_text(style, size, color)
    across, along = anchor.split()
    getattr(style, f"SetJustificationTo{across.replace('center', 'centered').capitalize()}")()
    getattr(
        style, f"SetVerticalJustificationTo{along.replace('center', 'centered').capitalize()}"
    )()
    if at_point:
        style.SetBackgroundColor(1, 1, 1)
        style.SetBackgroundOpacity(0.7)
        actor.GetPositionCoordinate().SetCoordinateSystemToWorld()
    else:
        actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
    return actor


def style_text(style: Any, size: int, color: str) -> None:
    """Set a font with Greek letters and superscripts, of a size in pixels."""
    from matplotlib import get_data_path
    from pyvista import Color
    from vtkmodules.vtkCommonCore import VTK_FONT_FILE

    style.SetFontFamily(VTK_FONT_FILE)
    style.SetFontFile(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf")
    style.SetFontSize(size)
    style.SetColor(*Color(color).float_rgb)


def _mark_changed(mesh: Any) -> None:
    mesh.GetPoints().Modified()
    mesh.Modified()


def _equal(first: Any, second: Any) -> bool:
    if first is None or second is None:
        return first is second
    return first is second or np.array_equal(first, second)


def _polydata(points: Array, faces: Any, lines: Any) -> Any:
    import pyvista

    def cells(rows: Any) -> Any:
        return np.hstack([np.full((len(rows), 1), rows.shape[1]), rows]).ravel()

    return pyvista.PolyData(
        points.astype(np.float32),
        faces=cells(faces) if len(faces) else None,
        lines=cells(lines) if lines is not None and len(lines) else None,
    )
