"""Whether VTK can render on this machine, found out without risking the process that asks.

In: the machine. Out: a :class:`Verdict`, and for Linux without a display the name of the render
window class that works there. Where a shared library is missing VTK does not raise, it crashes the
process at the first picture, so a tiny scene is rendered in a process of its own; the verdict is
kept in the cache folder until Python, VTK, the display or the installed libraries change.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from flexmb.folders import cache_root, is_writable

__all__ = ["Verdict", "probe", "use"]

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
    """What the probe found.

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
    """Find out whether VTK renders here, from the cache or, if `fresh`, anew (2 to 4 s)."""
    path = cache_root() / f"renderer-{_fingerprint()}.json"
    known = None if fresh else _read(path)
    if known is not None:
        return known
    verdict = _try_windows()
    _write(path, verdict)
    return verdict


def use(verdict: Verdict) -> None:
    """Make VTK take the window class that works; call it before pyvista is imported."""
    if verdict.window in (_EGL, _OSMESA):
        os.environ.setdefault(_WINDOW_VARIABLE, verdict.window)


def _try_windows() -> Verdict:
    reason = ""
    for window in _candidates():
        found, reason = _draw_in_subprocess(window)
        if found:
            return Verdict(True, found, _HOW.get(found, f"VTK through {found}"), "")
    return Verdict(False, "", f"VTK cannot render here: {reason}", _advice())


def _candidates() -> tuple[str, ...]:
    """Window classes to try in order; the empty one is VTK's own choice."""
    if os.environ.get(_WINDOW_VARIABLE) or platform.system() != "Linux":
        return ("",)
    if os.environ.get("DISPLAY"):
        return ("", _EGL, _OSMESA)
    return (_EGL, _OSMESA)


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
    libraries = Path("/etc/ld.so.cache")  # written anew whenever a shared library is installed
    stamp = libraries.stat().st_mtime_ns if libraries.exists() else 0
    facts = [
        platform.node(),
        platform.platform(),
        sys.executable,
        platform.python_version(),
        _version("vtk"),
        _version("pyvista"),
        os.environ.get("DISPLAY", ""),
        os.environ.get(_WINDOW_VARIABLE, ""),
        os.environ.get("LD_LIBRARY_PATH", ""),
        str(stamp),
    ]
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:16]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _read(path: Path) -> Verdict | None:
    try:
        return Verdict(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def _write(path: Path, verdict: Verdict) -> None:
    if is_writable(path.parent):
        path.write_text(json.dumps(asdict(verdict)), encoding="utf-8")
