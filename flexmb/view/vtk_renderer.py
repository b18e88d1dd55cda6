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
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.folders import cache_root, is_writable
from flexmb.view.content import Content, Deformed, Solid
from flexmb.view.plot import COLORMAP, GHOST, INK, JOINT, PAPER
from flexmb.view.shapes import joined, sphere

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

_FEATURE_DEGREES = 35.0  # edges sharper than this are drawn as lines
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
    use(verdict)
    import pyvista

    rows = -(-len(panels) // columns)
    cell = (size[0] // columns, size[1] // rows)
    plotter: Any = pyvista.Plotter(
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


def _draw_panel(plotter: Any, content: Content, size: tuple[int, int]) -> None:
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_depth_peeling(8)
    for solid in content.solids:
        _add_solid(plotter, solid)
    actors = [_add_deformed(plotter, body, content) for body in content.deformed]
    if len(content.joints):
        balls = joined([sphere(content.joint_radius, center) for center in content.joints])
        mesh = _mesh(balls.points, balls.faces)
        plotter.add_mesh(mesh, color=JOINT, smooth_shading=True, **_LIGHT)
    colored = (actor.mapper for actor in actors if actor.mapper.scalar_visibility)
    _add_texts(plotter, content, size, next(colored, None))
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


def _add_deformed(plotter: Any, body: Deformed, content: Content) -> Any:
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
    actor = plotter.add_mesh(
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
    return actor


def _add_edges(plotter: Any, mesh: Any, color: str, opacity: float) -> None:
    edges = mesh.extract_feature_edges(
        feature_angle=_FEATURE_DEGREES, manifold_edges=False, non_manifold_edges=False
    )
    if edges.n_cells:
        plotter.add_mesh(edges, color=color, line_width=1.5, opacity=opacity, lighting=False)


def _add_texts(plotter: Any, content: Content, size: tuple[int, int], mapper: Any) -> None:
    width, height = size
    large, small = (
        min(max(height / share, least), width / (_LETTER * max(len(text), 1)))
        for share, least, text in ((38, 9.0, content.title), (52, 8.0, content.caption))
    )
    place = {"viewport": True, "color": INK}
    first = 1 - 2.1 * large / height  # a line each, also where a panel is low
    second = first - 2.05 * small / height
    plotter.add_text(content.title, position=(0.02, first), font_size=0.72 * large, **place)
    plotter.add_text(content.caption, position=(0.02, second), font_size=0.72 * small, **place)
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
            title_font_size=round(1.15 * max(height / 52, 8)),
            label_font_size=round(1.15 * max(height / 52, 8)),
        )
    plotter.add_axes(color=INK, line_width=2, viewport=(0.0, 0.0, 0.14, 0.2))


def _aim(plotter: Any, content: Content, size: tuple[int, int]) -> None:
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
    center = middle @ axes
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = center
    plotter.camera.position = center + 3 * reach * axes[2]
    plotter.camera.up = tuple(axes[1])
    plotter.camera.parallel_scale = scale
    plotter.camera.clipping_range = (0.5 * reach, 6 * reach)
