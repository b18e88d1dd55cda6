"""Drawing pictures with VTK, off-screen, and whether it can render on this machine.

Where a shared library is missing VTK does not raise, it crashes the process at the first picture.
`probe` therefore renders a tiny scene in a process of its own; its :class:`Verdict` stays in the
cache folder until Python, VTK, the display or the installed libraries change. `draw` takes the
:class:`Content` of a picture, or several for a grid: light background, parallel projection, view
fitted to what is drawn, one colour scale for all flexible bodies of a panel.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from flexmb.folders import cache_root, is_writable
from flexmb.view.content import Content, Deformed, Solid
from flexmb.view.plot import COLORMAP, GHOST, INK, JOINT, PAPER
from flexmb.view.shapes import joined, sphere
from flexmb.view.vtk_scene import VtkScene

_WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
_EGL = "vtkEGLRenderWindow"
_OSMESA = "vtkOSOpenGLRenderWindow"
_PROBE_SECONDS = 120.0  # the first import of VTK from a cold network disk can take a minute

_WINDOWS_CRASH = 0xC0000000  # exit codes from here on: the system ended the process

_DRAW_TINY_SCENE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.set_background("white")
plotter.add_mesh(pyvista.Sphere(), color="black")
image = plotter.screenshot(None, return_img=True)
assert image.min() < 100 < 200 < image.max(), "the picture is blank"
print("window:" + plotter.render_window.GetClassName())
"""

_MARGIN = 1.04  # of the fitted view
_LETTER = 0.76  # width of a letter over the size of the text, with some room at the end
_ROOM = (0.90, 0.74)  # of width and height that the captions leave free
_BAR = 0.10  # of the width that the colour bar takes
_LIGHT = {"ambient": 0.32, "diffuse": 0.78, "specular": 0.08}  # colours stay those of the scale

_HOW = {
    _EGL: "VTK off-screen through EGL",
    _OSMESA: "VTK off-screen in software (OSMesa)",
    "vtkXOpenGLRenderWindow": "VTK through the X display",
    "vtkWin32OpenGLRenderWindow": "VTK through the Windows desktop",
    "vtkCocoaRenderWindow": "VTK through the macOS desktop",
}


@dataclass(frozen=True)
class Verdict:
    """The outcome of a probe.

    Attributes
    ----------
    works : bool
        Whether VTK renders here.
    window : str
        The render window class that did, such as ``"vtkEGLRenderWindow"``; empty if none.
    how : str
        The same in words, or why it does not work.
    advice : str
        What to install; empty if it works.
    """

    works: bool
    window: str
    how: str
    advice: str


def probe(fresh: bool = False) -> Verdict:
    """Whether VTK renders here, from the cache or, if `fresh`, by a trial picture (2 to 4 s)."""
    path = cache_root() / f"renderer-{_fingerprint()}.json"
    with contextlib.suppress(OSError, ValueError, TypeError):  # a damaged file is written again
        if not fresh:
            return Verdict(**json.loads(path.read_text(encoding="utf-8")))
    verdict = _try_windows()
    if is_writable(path.parent):
        path.write_text(json.dumps(asdict(verdict)), encoding="utf-8")
    return verdict


def use(verdict: Verdict) -> None:
    """Make VTK take the window class that works; call it before pyvista is imported."""
    if verdict.window in (_EGL, _OSMESA):
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
    panels: int, size: tuple[int, int], columns: int, verdict: Verdict
) -> Iterator[VtkScene]:
    """A scene for so many panels, row by row, that `show` fills, once or for every frame."""
    use(verdict)
    scene = VtkScene(size, (-(-panels // columns), columns), PAPER)
    try:
        yield scene
    finally:
        scene.close()


def show(scene: VtkScene, panels: Sequence[Content], size: tuple[int, int]) -> None:
    """Let the scene of `size` (width, height) pixels show the panels."""
    rows, columns = scene.plotter.shape
    for k, content in enumerate(panels):
        _draw_panel(scene, k, content, (size[0] // columns, size[1] // rows))


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
    """Render a tiny scene: the window class that VTK took, or an empty string and the reason."""
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
    """Changes with whatever may change the verdict: machine, versions, display, libraries."""
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


def _draw_panel(scene: VtkScene, panel: int, content: Content, size: tuple[int, int]) -> None:
    first = scene.begin(panel, content.all_points().mean(axis=0))
    if first:
        scene.plotter.enable_anti_aliasing("ssaa")
        scene.plotter.enable_depth_peeling(8)
    for solid in content.solids:
        _add_solid(scene, solid)
    actors = [_add_deformed(scene, body, content) for body in content.deformed]
    if len(content.joints):
        balls = joined([sphere(content.joint_radius, center) for center in content.joints])
        scene.add_mesh(balls.points, balls.faces, look={"color": JOINT, **_LIGHT})
    colored = (actor.mapper for actor in actors if actor.mapper.scalar_visibility)
    _add_texts(scene, content, size)
    if first:
        _add_legend(scene.plotter, content, size, next(colored, None))
    scene.end()
    _aim(scene, content, size)


def _add_solid(scene: VtkScene, solid: Solid) -> None:
    shape = solid.triangles
    look = {"color": solid.color, "opacity": solid.opacity, **_LIGHT}
    scene.add_mesh(shape.points, shape.faces, look=look, edges=_edges(INK, 0.5))


def _add_deformed(scene: VtkScene, body: Deformed, content: Content) -> Any:
    look: dict[str, Any] = {"color": body.color}
    values = None
    if content.scale is not None and body.values is not None:
        values = body.values * content.scale.factor
        look = {
            "cmap": COLORMAP,
            "nan_color": body.color,
            "clim": (0.0, content.scale.top or 1.0),
        }
    actor = scene.add_mesh(
        body.points,
        body.faces,
        body.lines,
        look={"line_width": 2 if len(body.faces) else 6, **_LIGHT, **look},
        values=values,
    )
    look, edges = {"color": GHOST, "line_width": 2}, None
    if len(body.faces):
        look, edges = {"color": GHOST, "opacity": 0.10, "lighting": False}, _edges(GHOST, 1.0)
    scene.add_mesh(body.undeformed, body.faces, body.lines, look=look, edges=edges)
    return actor


def _edges(color: str, opacity: float) -> dict[str, Any]:
    """The look of sharp edges."""
    return {"color": color, "line_width": 1.5, "opacity": opacity}


def _add_texts(scene: VtkScene, content: Content, size: tuple[int, int]) -> None:
    width, height = size
    large, small = (
        min(max(height / share, least), width / (_LETTER * max(len(text), 1)))
        for share, least, text in ((38, 9.0, content.title), (52, 8.0, content.caption))
    )
    first = 1 - 2.1 * large / height  # a line each, also where a panel is low
    second = first - 2.05 * small / height
    scene.add_text(content.title, (0.02, first), 0.72 * large, INK)
    scene.add_text(content.caption, (0.02, second), 0.72 * small, INK)


def _add_legend(plotter: Any, content: Content, size: tuple[int, int], mapper: Any) -> None:
    """The colour bar and the axes."""
    if content.scale is not None and content.bar:
        plotter.add_scalar_bar(
            title=f"{content.scale.label}\n",
            mapper=mapper,
            vertical=True,
            position_x=0.885,
            position_y=0.2,
            width=0.05,
            height=0.6,
            n_labels=5,
            fmt="%.3g",
            color=INK,
            title_font_size=round(1.15 * max(size[1] / 52, 8)),
            label_font_size=round(1.15 * max(size[1] / 52, 8)),
        )
    plotter.add_axes(color=INK, line_width=2, viewport=(0.0, 0.0, 0.14, 0.2))


def _aim(scene: VtkScene, content: Content, size: tuple[int, int]) -> None:
    """Look along the direction, fit width and height to what is drawn."""
    axes = content.camera.axes
    spans = content.all_points() @ axes.T
    low, high = spans.min(axis=0), spans.max(axis=0)
    width, height, depth = high - low
    reach = max(width + height + depth, 1e-9)
    bar = _BAR if content.bar else 0.0
    needed = max(height / _ROOM[1], width * size[1] / size[0] / (_ROOM[0] - bar), 0.02 * reach)
    scale = 0.5 * _MARGIN * needed  # half of the height shown
    middle = 0.5 * (low + high)
    middle[0] += bar * scale * size[0] / size[1]
    center = middle @ axes - scene.origin
    camera = scene.plotter.camera
    camera.parallel_projection = True
    camera.focal_point = center
    camera.position = center + 3 * reach * axes[2]
    camera.up = tuple(axes[1])
    camera.parallel_scale = scale
    camera.clipping_range = (0.5 * reach, 6 * reach)
