"""Drawing pictures with VTK, off-screen, and whether it can render on this machine.

Where a shared library is missing VTK does not raise, it crashes the process at the first picture.
`probe` therefore renders a tiny scene in a process of its own; its :class:`Verdict` stays in the
cache folder until Python, VTK, the display or the installed libraries change. `draw` takes the
:class:`Content` of a picture, or several for a grid.
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

from flexmb.folders import cache_root, is_writable
from flexmb.view.content import Content
from flexmb.view.plot import PAPER
from flexmb.view.vtk_panel import draw_panel
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


def is_off_screen(verdict: Verdict) -> bool:
    """Whether the window class that works has no window on a desktop."""
    return verdict.window in (_EGL, _OSMESA)


def use(verdict: Verdict) -> None:
    """Make VTK take the window class that works; call it before pyvista is imported."""
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
    """A scene for so many panels, row by row, that `show` fills, once or for every frame."""
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
