"""A film of a run: the mechanism over a range of time, all frames with the same view and colours.

In: a :class:`Result`, frames per second, and the speed relative to the simulated time. Out: a file
.mp4 or .gif, or a folder of PNG pictures. View, colour scale, exaggeration and the size of glyphs
are those of the whole motion; each frame is interpolated from the rows of the result around its
time.
"""

from __future__ import annotations

import contextlib
import math
import os
import pickle
import subprocess
import sys
import tempfile
import time as clock
import warnings
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, FlexmbWarning, ViewError
from flexmb.model.scenes.parameters import Time, read_quantity
from flexmb.progress import Progress, silent
from flexmb.results import Result
from flexmb.view import mpl_renderer, vtk_renderer
from flexmb.view.content import Content, Scale, Trace
from flexmb.view.drawing import Drawing, some_times
from flexmb.view.encoder import check_output, find_ffmpeg, real_rate, write_film
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import check_points, columns_of, trace_points, view_of

RATE = 25.0  # frames per second
_MAX_RATE = 240.0
_MAX_FRAMES = 20_000
# limits on the seconds of a film in real time, unless a speed is given
_MIN_SECONDS, _MAX_SECONDS = 2.0, 20.0
_DEFAULT_SECONDS = 6.0  # seconds of a film that is slower or faster than real time
_TURN_SAMPLES = 200  # frames at which rotations are checked
_COLOR_SAMPLES = 8  # frames from which a GIF takes its colours
_SERIAL_FRAMES = 24  # fewer frames are drawn faster by a single process
_TURN = math.radians(120.0)  # rotation between two frames above which it looks like another motion


Image = NDArray[np.uint8]
_WORKER = "from flexmb.view.film import serve; serve()"
_DONE, _FAILED = b"f", b"e"  # what a worker sends: a frame, or an error


@dataclass(frozen=True)
class Schedule:
    """The times of the frames of a film.

    Parameters
    ----------
    times : tuple of float
        Times of the frames [scene's unit].
    rate : float
        Frames per second.
    speed : float
        Simulated seconds per second of the film.
    """

    times: tuple[float, ...]
    rate: float
    speed: float

    @property
    def words(self) -> str:
        """The speed in words."""
        if math.isclose(self.speed, 1.0):
            return "real time"
        if self.speed > 1.0:
            return f"{self.speed:.4g} times faster"
        return f"{1.0 / self.speed:.4g} times slower"


@dataclass(eq=False)
class MotionShot:
    """The frames of a run."""

    path: Path
    schedule: Schedule
    view: dict[str, Any]  # options of [view], with the exaggeration as a number
    size: tuple[int, int]
    scale: Scale | None = None
    traces: tuple[Trace, ...] = ()
    columns: int = 1
    _drawing: Drawing | None = field(default=None, repr=False)

    def panels(self, number: int) -> Sequence[Content]:
        """The mechanism at the time of a frame, a panel for each camera."""
        if self._drawing is None:
            mechanism = Mechanism(Result(self.path))
            view = view_of(mechanism, self.view)
            self._drawing = Drawing(mechanism, view, self.schedule.times, self.scale)
        contents = self._drawing.contents(self.schedule.times[number])
        caption = f"{contents[0].caption}, {self.schedule.words}"
        return [replace(content, caption=caption, traces=self.traces) for content in contents]


def film(
    result: Result | str | Path,
    output: str | Path | None = None,
    *,
    fps: float = RATE,
    speed: float | None = None,
    start: Time | None = None,
    end: Time | None = None,
    traces: Sequence[str] = (),
    processes: int | None = None,
    force: bool = False,
    progress: Progress = silent,
    **view: Any,
) -> Path:
    """Make a film of a run.

    Parameters
    ----------
    result : Result or path
        The run.
    output : path, optional
        A file that ends in .mp4 or .gif, or a folder for pictures ``frame_00001.png``; ``film.mp4``
        beside the result, or ``film.gif`` where there is no encoder for mp4.
    fps : float
        Frames per second.
    speed : float, optional
        Simulated seconds in a second of the film: 0.1 is ten times slower. By default real time
        for what takes 2 to 20 s, else what makes a film of some 6 s.
    start, end : float or str, optional
        Range of time, in the scene's units or with their own, ``"30 ms"``; the whole run.
    traces : sequence of str
        Points whose paths are shown: markers, or bodies, which stand for their centre.
    processes : int, optional
        Number of processes that draw; by default the number of cores.
    force : bool
        Replace what exists.
    progress : callable
        Called for each frame.
    **view
        Any word of the scene's ``[view]``, as for `render`: ``follow="car"``, ``color="body"``, ...

    Returns
    -------
    Path
        The file or folder.

    Raises
    ------
    ViewError
        A wrong option, no encoder, or the file cannot be written.
    ResultFileError
        A time outside the run, no such body, or the file is no result.
    """
    run = result if isinstance(result, Result) else Result(result)
    path = check_output(default_output(run) if output is None else output, force)
    check_processes(processes)
    shot = shoot(run, real_rate(path, check_rate(fps)), speed, start, end, traces, view)
    _warn_of_turns(run, shot.schedule)
    make_film(shot, len(shot.schedule.times), path, shot.schedule.rate, processes, progress)
    return path


def shoot(
    run: Result,
    rate: float,
    speed: float | None,
    start: Time | None,
    end: Time | None,
    traces: Sequence[str],
    view: dict[str, Any],
) -> MotionShot:
    """The frames of a film; parameters and errors as for `film`."""
    mechanism = Mechanism(run)
    spec = view_of(mechanism, view)
    points = check_points(mechanism, traces)
    schedule = plan(run, rate, speed, start, end)
    paths = trace_points(mechanism, points, schedule.times)
    drawing = Drawing(mechanism, spec, schedule.times)
    words = {**view, "exaggeration": drawing.factor}
    columns = columns_of(len(drawing.cameras))
    return MotionShot(run.path, schedule, words, spec.size, drawing.scale, paths, columns)


def default_output(run: Result) -> Path:
    """The default file of a run's film."""
    return run.path.parent / ("film.mp4" if find_ffmpeg() is not None else "film.gif")


def make_film(
    shot: Shot, count: int, path: Path, rate: float, processes: int | None, progress: Progress
) -> None:
    """Draw all frames of a shot and write them."""
    numbers = list(range(count))
    spread = np.linspace(0, count - 1, _COLOR_SAMPLES).astype(int).tolist()
    samples = spread if path.suffix.lower() == ".gif" else []
    workers = processes or (1 if count < _SERIAL_FRAMES else min(os.cpu_count() or 1, count // 12))
    started = clock.monotonic()

    def reported(frames: Iterator[Any]) -> Iterator[Any]:
        progress("film", 0.0, f"{count} frames")
        for k, frame in enumerate(frames):
            yield frame
            done = k + 1 - len(samples)
            left = (clock.monotonic() - started) * (count - done) / max(done, 1)
            if 0 < done < count:
                progress("film", done / count, f"{done} of {count} frames, {left:.0f} s left")
        progress("film", 1.0)

    drawn = draw_frames_in_parallel(shot, samples + numbers, workers)
    try:
        write_film(reported(drawn), path, rate, len(samples))
    finally:
        drawn.close()


def plan(
    run: Result, rate: float, speed: float | None, start: Time | None, end: Time | None
) -> Schedule:
    """The times of the frames; see `film`.

    Raises
    ------
    ViewError
        No rows, an empty range, a speed that is not above 0, or too many frames.
    ResultFileError
        A time outside the run.
    """
    if not len(run.time):
        raise ViewError(f"{run.path}: the result holds no rows to draw")
    first = float(run.time[0]) if start is None else read_quantity(run.model, start, "start", "s")
    last = float(run.time[-1]) if end is None else read_quantity(run.model, end, "end", "s")
    for time in (first, last):
        run.row_at(time)
    unit = run.units.label("s")
    if last <= first:
        raise ViewError(f"the film would go from {first:g} to {last:g} {unit}: nothing moves")
    span = (last - first) * run.units.scale("s")
    if speed is None:
        speed = 1.0 if _MIN_SECONDS <= span <= _MAX_SECONDS else _round(span / _DEFAULT_SECONDS)
    if not 0.0 < speed < math.inf:
        raise ViewError(f"a film at the speed {speed:g} does not move on: give a number above 0")
    count = math.floor(span / speed * rate * (1 + 1e-9)) + 1
    if count > _MAX_FRAMES:
        raise ViewError(
            f"the film would have {count} frames and last {_duration(count / rate)}, at most "
            f"{_MAX_FRAMES} are made: give a higher speed than {speed:.3g}, a lower fps than "
            f"{rate:g}, or a part of the time (start, end)"
        )
    if count < 2:
        raise ViewError(
            f"the film would last {span / speed:.2g} s, less than a frame: give a lower speed than "
            f"{speed:.3g}"
        )
    step = (last - first) * speed / (rate * span)
    times = np.minimum(first + step * np.arange(count), last)
    return Schedule(tuple(times.tolist()), rate, speed)


def check_rate(rate: float) -> float:
    """Refuse a frame rate that no screen can show."""
    if not 1.0 <= rate <= _MAX_RATE:
        raise ViewError(f"{rate:g} frames per second cannot be shown: give 1 to {_MAX_RATE:g}")
    return rate


def check_processes(processes: int | None) -> None:
    """Refuse zero processes, and more than the machine could run."""
    most = 4 * (os.cpu_count() or 1)
    if processes is not None and not 1 <= processes <= most:
        raise ViewError(f"{processes} processes cannot draw: give 1 to {most}")


def _warn_of_turns(run: Result, schedule: Schedule) -> None:
    """Warn if a body rotates so far between two frames, or rows, that it appears to move otherwise.

    A rotation sampled less than twice per revolution appears reversed (stroboscopic effect).
    """
    second = run.units.scale("s")
    frames, rows = [(0.0, "")], [(0.0, "")]
    for time in some_times(schedule.times, _TURN_SAMPLES):
        i, _ = run.row_at(time)
        row = second * float(np.diff(run.time[i : i + 2]).sum())
        for columns in run.layout.bodies:
            own = slice(columns.iv + 3, columns.iv + 6)
            if run.has_columns("v", own):
                rate = float(np.linalg.norm(run.two_rows("v", i, own), axis=1).max())
                rows.append((rate * row, columns.name))
                frames.append((rate * schedule.speed / schedule.rate, columns.name))
    (turn, body), what = max(rows), "rows of the result"
    cure = "store more outputs"
    if turn <= _TURN:
        (turn, body), what = max(frames), "frames"
        cure = f"speed = {_round(schedule.speed * _TURN / max(turn, _TURN)):g} shows it as it is"
    if turn > _TURN:
        warnings.warn(
            f"{body} turns by up to {math.degrees(turn):.0f} degrees between two {what}: it seems "
            f"to move in another way than it does; {cure}",
            FlexmbWarning,
            stacklevel=3,
        )


def _round(ratio: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above the ratio."""
    power = 10.0 ** math.floor(math.log10(ratio * (1 + 1e-9)))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= ratio * (1 + 1e-9))


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


class Shot(Protocol):
    """What a film shows; data that can be sent to another process."""

    size: tuple[int, int]
    columns: int

    def panels(self, number: int) -> Sequence[Content]:
        """The panels of a frame, row by row."""


def draw_frames(shot: Shot, numbers: Sequence[int]) -> Generator[Image]:
    """Draw these frames in this process."""
    verdict = vtk_renderer.probe()
    if not verdict.works:
        note = f"{verdict.how}; {verdict.advice}"
        for number in numbers:
            yield mpl_renderer.image(shot.panels(number), shot.size, note, shot.columns)
        return
    count = len(shot.panels(numbers[0])) if numbers else 1
    with vtk_renderer.open_scene(count, shot.size, shot.columns, verdict) as scene:
        for number in numbers:
            vtk_renderer.show(scene, shot.panels(number), shot.size)
            yield scene.image()


def draw_frames_in_parallel(shot: Shot, numbers: Sequence[int], processes: int) -> Generator[Image]:
    """Draw these frames in several processes alternately; in this one if one process suffices.

    Raises
    ------
    ViewError
        A process ended before its last frame.
    """
    if processes == 1:
        yield from draw_frames(shot, numbers)
        return
    vtk_renderer.probe()  # once, instead of in each process
    width, height = shot.size
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(_worker(shot, numbers[k::processes])) for k in range(processes)
        ]
        for k in range(len(numbers)):
            process, errors = workers[k % processes]
            head = process.stdout.read(1)
            if head == _FAILED:
                raise pickle.loads(process.stdout.read())
            data = process.stdout.read(3 * width * height) if head == _DONE else b""
            if len(data) < 3 * width * height:
                errors.seek(0)
                last = errors.read().decode(errors="replace").strip().splitlines()[-1:]
                why = last[0][:200] if last else "no reason given"
                what = f"a process that draws ended at frame {k + 1} of {len(numbers)} ({why})"
                raise ViewError(f"{what}; try again with processes = 1")
            yield np.frombuffer(data, np.uint8).reshape(height, width, 3)


@contextlib.contextmanager
def _worker(shot: Shot, numbers: Sequence[int]) -> Iterator[tuple[Any, IO[bytes]]]:
    package = str(Path(__file__).parents[2])
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    environment.setdefault("LP_NUM_THREADS", "0")  # Mesa's threads would only wait for each other
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            [sys.executable, "-P", "-c", _WORKER],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
            env=environment, start_new_session=True,
        ) as process,
    ):  # fmt: skip
        try:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):  # its error stream gives the reason
                process.stdin.write(pickle.dumps((shot, list(numbers))))
                process.stdin.close()
            yield process, errors
        finally:
            process.kill()


def serve() -> None:
    """Draw the frames requested on the standard input, and write them to the standard output."""
    shot, numbers = pickle.load(sys.stdin.buffer)
    with os.fdopen(os.dup(1), "wb") as output:
        os.dup2(2, 1)  # keep prints of libraries out of the frames
        try:
            for image in draw_frames(shot, numbers):
                output.write(_DONE + np.ascontiguousarray(image).tobytes())
                output.flush()
        except BrokenPipeError:  # the reader has ended
            os._exit(0)
        except FlexmbError as error:
            output.write(_FAILED + pickle.dumps(error))
