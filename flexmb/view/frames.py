"""The frames of a film: drawn one after the other by one process, or by several in turn.

In: a :class:`Shot`, which says what each frame shows. Out: pictures (height, width, 3) in order.
No more of them are in memory than there are processes: each draws into a pipe that holds it back
until its frame is wanted, so that a long film needs no more memory than a short one.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, ViewError
from flexmb.view import mpl_renderer, vtk_renderer
from flexmb.view.content import Content

Image = NDArray[np.uint8]

_WORKER = "from flexmb.view.frames import serve; serve()"
_DONE, _FAILED = b"f", b"e"  # what a worker sends: a frame, or an error


class Shot(Protocol):
    """What a film shows, with nothing that a process could not send to another."""

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
    """Draw these frames in several processes, in turn; one of them is this one if that suffices.

    Raises
    ------
    ViewError
        A process ended before its last frame.
    """
    if processes == 1:
        yield from draw_frames(shot, numbers)
        return
    vtk_renderer.probe()  # once, not in each process
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
            with contextlib.suppress(BrokenPipeError):  # its error stream says why
                process.stdin.write(pickle.dumps((shot, list(numbers))))
                process.stdin.close()
            yield process, errors
        finally:
            process.kill()


def serve() -> None:
    """Draw the frames that the standard input asks for into the standard output."""
    shot, numbers = pickle.load(sys.stdin.buffer)
    with os.fdopen(os.dup(1), "wb") as output:
        os.dup2(2, 1)  # what a library prints is no part of a frame
        try:
            for image in draw_frames(shot, numbers):
                output.write(_DONE + np.ascontiguousarray(image).tobytes())
                output.flush()
        except BrokenPipeError:  # nobody wants them any more
            os._exit(0)
        except FlexmbError as error:
            output.write(_FAILED + pickle.dumps(error))
