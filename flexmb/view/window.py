"""A run that plays while the user turns and zooms it: in a window, a web page or a notebook.

In: a :class:`Result`, options of the view. Out: nothing from the window, whose function returns
when it is closed; the path of the page; an object that a notebook shows if it is the last line of a
cell. In the window the space key plays and stops, the arrow keys go to the next and the previous
frame.
"""

from __future__ import annotations

import base64
import os
import platform
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from flexmb.errors import ViewError
from flexmb.folders import scratch_folder, whole_file, write_text_file
from flexmb.model.scenes.parameters import Time
from flexmb.progress import Progress, silent
from flexmb.results import Result
from flexmb.view import vtk_renderer
from flexmb.view.encoder import find_ffmpeg
from flexmb.view.film import RATE, MotionShot, film, shoot
from flexmb.view.html_page import tag, write_page
from flexmb.view.page_motion import moving_scene
from flexmb.view.picture import render
from flexmb.view.plot import writable_file
from flexmb.view.vtk_scene import VtkScene

_TICK = 20  # ms between two timer events
_FOREVER = 10**8  # timer events


def has_desktop() -> bool:
    """Whether a window can be opened: there is a display, and VTK can draw to it."""
    verdict = vtk_renderer.probe()
    return has_display() and verdict.works and not vtk_renderer.is_off_screen(verdict)


def open_window(result: Result | str | Path, speed: float | None = None, **view: Any) -> None:
    """Show a run in a window until it is closed.

    Parameters
    ----------
    result : Result or path
        The run.
    speed : float, optional
        Simulated seconds per second, as for `film`.
    **view
        Any option of the scene's ``[view]``, as for `render`.

    Raises
    ------
    ViewError
        There is no desktop, or a wrong option.
    ResultFileError
        The file is no result.
    """
    run = result if isinstance(result, Result) else Result(result)
    if not has_desktop():
        raise ViewError(
            "there is no desktop to open a window on; flexmb view writes a web page there"
        )
    shot = shoot(run, RATE, speed, None, None, (), view)
    count = len(shot.panels(0))
    verdict = vtk_renderer.probe()
    with vtk_renderer.open_scene(count, shot.size, shot.columns, verdict, window=True) as scene:
        Player(shot, scene).run()


def write_page_of_motion(
    result: Result | str | Path, output: str | Path | None = None, progress: Progress = silent
) -> Path:
    """Write a self-contained web page in which a run plays.

    Parameters
    ----------
    result : Result or path
        The run.
    output : path, optional
        A file that ends in .html; ``view.html`` beside the result.
    progress : callable
        Is called for each frame.

    Raises
    ------
    ViewError
        The library plotly is missing, there is nothing to show, or the file cannot be written.
    """
    run = result if isinstance(result, Result) else Result(result)
    path = writable_file(output or run.path.parent / "view.html", (".html", ".htm"))
    scene = moving_scene(run, progress)
    title = run.title or run.path.parent.name
    text = write_page(
        title, [tag("h1", title), scene.player()], {"charts": [], "motion": scene.data}
    )
    try:
        with whole_file(path) as partial:
            partial.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path


def has_display() -> bool:
    """Whether there is a screen on which programs can open windows."""
    if platform.system() != "Linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class Player:
    """The frames of a shot in a scene: shows one, and the following ones while it plays."""

    def __init__(self, shot: MotionShot, scene: VtkScene) -> None:
        self.shot, self.scene = shot, scene
        self.count = len(shot.schedule.times)
        self.number, self.is_playing = 0, False
        self._began = 0.0  # time at which the first frame would have been shown in this playing
        self._slider: Any = None
        self.go_to(0)

    def go_to(self, number: float) -> None:
        """Show a frame."""
        self.number = round(number) % self.count
        vtk_renderer.show(self.scene, self.shot.panels(self.number), self.shot.size)
        self.scene.plotter.render_window.Render()

    def toggle(self) -> None:
        """Play, or stop."""
        self.is_playing = not self.is_playing
        self._began = clock.monotonic() - self.number / self.shot.schedule.rate

    def tick(self) -> None:
        """While it plays, show the frame of this moment; a slow machine skips frames."""
        if self.is_playing:
            number = int((clock.monotonic() - self._began) * self.shot.schedule.rate) % self.count
            if number != self.number:
                self._move(number)

    def _move(self, number: int) -> None:
        self.go_to(number)
        if self._slider is not None:
            self._slider.GetRepresentation().SetValue(self.number)

    def run(self) -> None:
        """Open the window; returns when it is closed."""
        plotter = self.scene.plotter
        self._slider = plotter.add_slider_widget(
            self.go_to, rng=(0, self.count - 1), value=0, pointa=(0.3, 0.06), pointb=(0.85, 0.06),
            fmt="%.0f", title="", style="modern", interaction_event="always",
        )  # fmt: skip
        plotter.add_key_event("space", self.toggle)
        plotter.add_key_event("Right", lambda: self._move(self.number + 1))
        plotter.add_key_event("Left", lambda: self._move(self.number - 1))
        plotter.add_timer_event(_FOREVER, _TICK, lambda _: self.tick())
        self.toggle()
        plotter.suppress_rendering = False
        plotter.show(title=f"{self.shot.panels(0)[0].title} - space plays and stops")


@dataclass(frozen=True)
class Picture:
    """A picture of a run.

    Parameters
    ----------
    png : bytes
        The content of a PNG file.
    """

    png: bytes = field(repr=False)

    def _repr_png_(self) -> bytes:
        return self.png


@dataclass(frozen=True)
class Film:
    """A film of a run that repeats itself.

    Parameters
    ----------
    data : bytes
        The content of a film file.
    kind : str
        ``"mp4"``, or ``"gif"``.
    """

    data: bytes = field(repr=False)
    kind: str

    def _repr_html_(self) -> str:
        text = base64.b64encode(self.data).decode("ascii")
        style = 'style="max-width: 100%"'
        if self.kind == "gif":
            return f'<img {style} alt="film" src="data:image/gif;base64,{text}">'
        return f'<video {style} controls loop autoplay muted src="data:video/mp4;base64,{text}">'


@dataclass(frozen=True)
class Page:
    """A self-contained web page; a notebook shows it in a frame.

    Parameters
    ----------
    html : str
        Its text.
    file : Path
        Its default file.
    """

    html: str = field(repr=False)
    file: Path

    def save(self, file: str | Path | None = None) -> Path:
        """Write the page, whole or not at all.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        path = Path(file) if file is not None else self.file
        write_text_file(path, self.html)
        return path

    def _repr_html_(self) -> str:
        style = "width: 100%; height: 640px; border: 0"
        return f'<iframe srcdoc="{escape(self.html)}" style="{style}"></iframe>'


def snapshot(
    result: Result | str | Path, time: Time | Sequence[Time] | None = None, **options: Any
) -> Picture:
    """Draw the mechanism for a notebook; options and errors as for `render`."""
    with scratch_folder() as folder:
        return Picture(render(result, time, output=Path(folder) / "a.png", **options).read_bytes())


def animation(result: Result | str | Path, **options: Any) -> Film:
    """Make a film for a notebook, 960 x 540 by default; options and errors as for `film`."""
    kind = "gif" if find_ffmpeg() is None else "mp4"
    options = {"size": (960, 540), **options}
    with scratch_folder() as folder:
        return Film(film(result, Path(folder) / f"a.{kind}", **options).read_bytes(), kind)
