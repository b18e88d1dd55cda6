"""Drawing pictures with VTK, off-screen, and whether it can render on this machine.

If a shared library is missing, VTK does not raise an exception but crashes the process at the first
picture. So `probe` renders a tiny scene in a separate process; its :class:`Verdict` is kept in the
cache folder until Python, VTK, the display or the installed libraries change. `draw` takes the
:class:`Content` of a picture, or several for a grid: light background, parallel projection, the
view fitted to the extent of the content.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.folders import cache_root, is_writable
from flexmb.view.content import Content, Deformed, Solid
from flexmb.view.plot import COLORMAP, DIVERGING, GHOST, INK, PAPER
from flexmb.view.vtk_scene import VtkScene, style_text

_WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
_EGL = "vtkEGLRenderWindow"
_OSMESA = "vtkOSOpenGLRenderWindow"
_PROBE_SECONDS = 120.0  # the first import of VTK from a cold network disk can take a minute

_WINDOWS_CRASH = 0xC0000000  # exit codes from here on: the operating system ended the process

_DRAW_TINY_SCENE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.set_background("white")
plotter.add_mesh(pyvista.Sphere(), color="black")
image = plotter.screenshot(None, return_img=True)
assert image.min() < 100 < 200 < image.max(), "the picture is blank"
print("window:" + plotter.render_window.GetClassName())
"""

_HOW = {
    _EGL: "VTK off-screen through EGL",
    _OSMESA: "VTK off-screen in software (OSMesa)",
    "vtkXOpenGLRenderWindow": "VTK through the X display",
    "vtkWin32OpenGLRenderWindow": "VTK through the Windows desktop",
    "vtkCocoaRenderWindow": "VTK through the macOS desktop",
}


_MARGIN = 1.04  # margin of the fitted view
_ROOM = 0.92  # fraction of the width that is left beside the colour bar
_BAR = 0.13  # fraction of the width that the colour bar takes
# such that colours stay those of the scale
_LIGHT = {"ambient": 0.32, "diffuse": 0.78, "specular": 0.08}
_TITLE, _TEXT, _SMALL = 28, 19, 17  # text sizes in pixels of a picture 1280 x 720
_LEAST, _TINY = 16, 8  # least text size in pixels: normally, and in very low pictures
_LETTER = 0.58  # mean width of a character over the text size
_NO_FACES = np.zeros((0, 3), dtype=np.int64)


@dataclass(frozen=True)
class Verdict:
    """The outcome of a probe.

    Attributes
    ----------
    works : bool
        Whether VTK renders here.
    window : str
        The working render window class, such as ``"vtkEGLRenderWindow"``; empty if none.
    how : str
        A text: how VTK renders, or why it does not.
    advice : str
        What to install; empty if it works.
    """

    works: bool
    window: str
    how: str
    advice: str


def probe(fresh: bool = False) -> Verdict:
    """Whether VTK renders here; from the cache or, if `fresh`, by a trial picture (2 to 4 s)."""
    path = cache_root() / f"renderer-{_fingerprint()}.json"
    with contextlib.suppress(OSError, ValueError, TypeError):  # a damaged file is replaced
        if not fresh:
            return Verdict(**json.loads(path.read_text(encoding="utf-8")))
    verdict = _try_windows()
    if is_writable(path.parent):
        path.write_text(json.dumps(asdict(verdict)), encoding="utf-8")
    return verdict


def is_off_screen(verdict: Verdict) -> bool:
    """Whether the working window class opens no window on a desktop."""
    return verdict.window in (_EGL, _OSMESA)


def use(verdict: Verdict) -> None:
    """Make VTK use the working window class; must be called before pyvista is imported."""
    if is_off_screen(verdict):
        os.environ.setdefault(_WINDOW_VARIABLE, verdict.window)


def draw(
    panels: Sequence[Content], path: Path, size: tuple[int, int], columns: int, verdict: Verdict
) -> None:
    """Render panels, row by row, into a PNG file of `size` (width, height) pixels."""
    with open_scene(len(panels), size, columns, verdict) as scene:
        show(scene, panels, size)
        scene.save(path)


@contextlib.contextmanager
def open_scene(
    panels: int, size: tuple[int, int], columns: int, verdict: Verdict, window: bool = False
) -> Iterator[VtkScene]:
    """A scene with `panels` panels, row by row, which `show` fills, once or for every frame."""
    use(verdict)
    scene = VtkScene(size, (-(-panels // columns), columns), PAPER, window)
    try:
        yield scene
    finally:
        scene.close()


def show(scene: VtkScene, panels: Sequence[Content], size: tuple[int, int]) -> None:
    """Let the scene of `size` (width, height) pixels show the panels."""
    rows, columns = scene.plotter.shape
    for k, content in enumerate(panels):
        draw_panel(scene, k, content, (size[0] // columns, size[1] // rows))


def _try_windows() -> Verdict:
    """Try window classes in order; the empty one is VTK's own choice."""
    windows: tuple[str, ...] = ("",)
    if platform.system() == "Linux" and not os.environ.get(_WINDOW_VARIABLE):
        windows = ("", _EGL, _OSMESA) if os.environ.get("DISPLAY") else (_EGL, _OSMESA)
    reason = ""
    for window in windows:
        working, reason = _draw_in_subprocess(window)
        if working:
            return Verdict(True, working, _HOW.get(working, f"VTK through {working}"), "")
    return Verdict(False, "", f"VTK cannot render here: {reason}", _advice())


def _draw_in_subprocess(window: str) -> tuple[str, str]:
    """Render a tiny scene: the window class that VTK used, or an empty string and the reason."""
    environment = dict(os.environ)
    if window:
        environment[_WINDOW_VARIABLE] = window
    try:
        done = subprocess.run(
            [sys.executable, "-c", _DRAW_TINY_SCENE],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_PROBE_SECONDS,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return "", f"the trial picture could not be made ({type(error).__name__})"
    for line in done.stdout.splitlines():
        if done.returncode == 0 and line.startswith("window:"):
            return line.removeprefix("window:"), ""
    if done.returncode < 0 or done.returncode >= _WINDOWS_CRASH:
        return "", "it crashes at the first picture, a rendering library is missing"
    last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    return "", last[:200]


def _advice() -> str:
    if platform.system() != "Linux":
        return "install a graphics driver with OpenGL 3.2 or newer"
    return (
        "install the rendering libraries: on Debian and Ubuntu "
        "apt install libegl1 libegl-mesa0 libgl1-mesa-dri libx11-6 (or libosmesa6 alone)"
    )


def _fingerprint() -> str:
    """A text that changes with anything that may change the verdict: versions, display,
    libraries."""
    libraries = Path("/etc/ld.so.cache")  # replaced whenever a shared library is installed
    stamp = libraries.stat().st_mtime_ns if libraries.exists() else 0
    facts = [platform.node(), platform.platform(), sys.executable, platform.python_version()]
    facts += [_version(package) for package in ("vtk", "pyvista")]
    names = ("DISPLAY", _WINDOW_VARIABLE, "LD_LIBRARY_PATH")
    facts += [*(os.environ.get(name, "") for name in names), str(stamp)]
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:16]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def draw_panel(scene: VtkScene, number: int, content: Content, size: tuple[int, int]) -> None:
    """Let a panel of `size` (width, height) pixels show the content."""
    first = scene.begin(number, content.fitted_points().mean(axis=0))
    size = scene.sampling * size[0], scene.sampling * size[1]
    actors = [_add_deformed(scene, body, content) for body in content.deformed]
    for solid in content.solids:
        _add_solid(scene, solid)
    for trace in content.traces:
        look = {"color": trace.color, "line_width": 2.5, "lighting": False}
        scene.add_lines(trace.points, look=look)
    sizes = _sizes(content, size, scene.sampling)
    free = _add_texts(scene, content, size, sizes)
    if first:
        colored = (actor.mapper for actor in actors if actor.mapper.scalar_visibility)
        _add_legend(scene, content, size, sizes[2], next(colored, None))
    pixel = _aim(scene, content, size, free, moves=first or not scene.is_window)
    _add_names(scene, content, pixel, sizes[2])
    scene.end()


def _add_solid(scene: VtkScene, solid: Solid) -> None:
    shape = solid.triangles
    if solid.role == "grid":
        look: dict[str, Any] = {"color": solid.color, "line_width": 1.0, "lighting": False}
        scene.add_mesh(shape.points, _NO_FACES, shape.faces[:, :2], look=look, matrix=solid.matrix)
        return
    look = {"color": solid.color, "opacity": solid.opacity, **_LIGHT}
    edges = _line(INK, 0.5 * solid.opacity) if solid.role == "body" else None
    actor = scene.add_mesh(shape.points, shape.faces, look=look, edges=edges, matrix=solid.matrix)
    if solid.role == "arrow":  # in front of the bodies on which it acts
        actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, -1e6)


def _add_deformed(scene: VtkScene, body: Deformed, content: Content) -> Any:
    look: dict[str, Any] = {"color": body.color, "opacity": body.opacity}
    values = None
    if content.scale is not None and body.values is not None:
        values = body.values * content.scale.factor
        look = {
            "cmap": DIVERGING if content.scale.least < 0 else COLORMAP,
            "nan_color": body.color,
            "clim": content.scale.limits,
            "opacity": body.opacity,
        }
    solid = len(body.faces) > 0
    look |= {"line_width": 2 if solid else 6, **_LIGHT}
    lines = None if solid else body.lines
    actor = scene.add_mesh(body.points, body.faces, lines, look=look, values=values)
    if solid:
        look = {**_line(INK, 0.35), "lighting": False}
        scene.add_mesh(body.points, _NO_FACES, body.edges, look=look)
    if content.outline:
        look = {**_line(GHOST, 1.0), "lighting": False}
        scene.add_mesh(body.undeformed, _NO_FACES, body.edges if solid else lines, look=look)
    return actor


def _line(color: str, opacity: float) -> dict[str, Any]:
    """The style of edges."""
    return {"color": color, "line_width": 1.5, "opacity": opacity}


def _sizes(content: Content, size: tuple[int, int], sampling: int) -> tuple[int, int, int]:
    """Text sizes [pixels] of the title, of the caption, of numbers and names."""
    unit = content.font_scale * min((size[1] / 720 * size[0] / 1280) ** 0.5, size[0] / 700)
    least = min(_LEAST * sampling, max(size[1] // 22, _TINY * sampling))
    title, text, small = (max(round(pixels * unit), least) for pixels in (_TITLE, _TEXT, _SMALL))
    fitting = int(0.96 * size[0] / (_LETTER * max(len(content.title), 1)))
    return max(min(title, fitting), least), text, small


def _add_texts(
    scene: VtkScene, content: Content, size: tuple[int, int], sizes: tuple[int, int, int]
) -> float:
    """Add title and caption; returns the fraction of the height that they leave free."""
    width, height = size
    title, text, _ = sizes
    lines = textwrap.wrap(content.caption, max(int(0.96 * width / (_LETTER * text)), 20))
    top = height - 0.35 * title
    below = top - (1.45 * title if content.title else 0.0)
    scene.add_text(content.title, (0.02 * width, top), title, INK)
    scene.add_text("\n".join(lines), (0.02 * width, below), text, INK)
    return max((below - 1.35 * text * max(len(lines), 1)) / height, 0.4) - 0.04


def _add_names(scene: VtkScene, content: Content, pixel: float, letters: int) -> None:
    """Add names at their points, in front of everything and without overlap."""
    axes, places = content.camera.axes, list[tuple[float, float, float]]()
    for label in content.labels:
        x, y = axes[:2] @ label.point
        half, high = 0.5 * _LETTER * letters * len(label.text) * pixel, 1.25 * letters * pixel
        while any(abs(x - a) < half + b and abs(y - c) < high for a, b, c in places):
            y -= 0.3 * high
        places.append((x, half, y))
        point = label.point + (y - axes[1] @ label.point) * axes[1]
        scene.add_text(label.text, point, letters, label.color, "center center", at_point=True)


def _add_legend(
    scene: VtkScene, content: Content, size: tuple[int, int], letters: int, mapper: Any
) -> None:
    """Add the colour bar and the axes."""
    if content.scale is not None and content.bar:
        from vtkmodules.vtkRenderingAnnotation import vtkScalarBarActor
        from vtkmodules.vtkRenderingCore import vtkTextActor

        bar, title = vtkScalarBarActor(), vtkTextActor()
        bar.SetLookupTable(mapper.lookup_table)
        bar.SetNumberOfLabels(5)
        bar.SetLabelFormat("%.3g")
        bar.SetUnconstrainedFontSize(True)
        bar.SetWidth(0.055)
        bar.SetHeight(0.56)
        bar.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
        bar.SetPosition(0.895, 0.17)
        style_text(bar.GetLabelTextProperty(), letters, INK)
        style_text(title.GetTextProperty(), letters, INK)
        title.SetInput(content.scale.label.replace(" [", "\n["))
        title.GetTextProperty().SetJustificationToRight()
        title.GetPositionCoordinate().SetCoordinateSystemToViewport()
        title.SetPosition(0.985 * size[0], 0.745 * size[1])
        scene.plotter.renderer.AddViewProp(bar)
        scene.plotter.renderer.AddViewProp(title)
    high = 0.17 * min(1.0, 1.5 * content.font_scale)
    viewport = (0.0, 0.0, high * size[1] / size[0], high)
    scene.plotter.add_axes(color=INK, line_width=3 * scene.sampling, viewport=viewport)


def _aim(
    scene: VtkScene, content: Content, size: tuple[int, int], free: float, moves: bool
) -> float:
    """Point the camera and fit width and height to what is drawn; returns the size of a pixel [m].

    Without `moves` the camera is not changed.
    """
    axes = content.camera.axes
    spans = content.fitted_points() @ axes.T
    low, high = spans.min(axis=0), spans.max(axis=0)
    width, height, depth = high - low
    everything = content.all_points() @ axes.T
    reach = max(width + height + depth, float(np.ptp(everything, axis=0).sum()), 1e-9)
    bar = _BAR if content.bar else 0.0
    needed = max(height / free, width * size[1] / size[0] / (_ROOM - bar), 0.02 * reach)
    scale = 0.5 * _MARGIN * needed / content.zoom  # half of the visible height
    middle = 0.5 * (low + high)
    middle[0] += bar * scale * size[0] / size[1]
    middle[1] += (0.94 - free) * scale
    center = middle @ axes - scene.origin
    if not moves:
        return float(2 * scale / size[1])
    camera = scene.plotter.camera
    camera.parallel_projection = True
    camera.focal_point = center
    camera.position = center + 3 * reach * axes[2]
    camera.up = tuple(axes[1])
    camera.parallel_scale = scale
    camera.clipping_range = (0.05 * reach, 8 * reach)
    return float(2 * scale / size[1])
