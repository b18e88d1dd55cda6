"""Film files: mp4 by ffmpeg, GIF and single PNG pictures by Pillow, written frame by frame.

A film is written under a temporary name and renamed when it is complete, so that an interruption
leaves nothing. The interval of GIF frames is a whole number of hundredths of a second (GIF89a,
1990).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ViewError
from flexmb.folders import partial_path, whole_file

Image = NDArray[np.uint8]

FRAME = "frame_{:05d}.png"
_FRAMES = "frame_*.png"
ENDINGS = (".mp4", ".gif")
MISSING = (
    "mp4 needs the encoder ffmpeg, which is not on this machine: pip install imageio-ffmpeg "
    "(or flexmb[film]), or write a .gif or a folder of pictures"
)
_QUALITY = "20"  # constant rate factor of H.264; 18 is visually lossless
_COLORS = 255  # colours of a GIF; one more is transparent
_PALETTE_WIDTH = 640  # width [pixels] of the pictures from which the colours are determined
_LOOP = b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"


def find_ffmpeg() -> str | None:
    """The ffmpeg program for mp4: from the package imageio-ffmpeg, else of the system."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return shutil.which("ffmpeg")


def real_rate(path: Path, rate: float) -> float:
    """The nearest frame rate [1/s] that the file's format can have."""
    return 100.0 / max(2, round(100.0 / rate)) if path.suffix.lower() == ".gif" else rate


def check_output(output: str | Path, force: bool) -> Path:
    """The path of a film, with its folder created, if it can be written there.

    Raises
    ------
    ViewError
        Another ending than .mp4 or .gif (without one it is a folder of pictures), a file or
        pictures in its place without `force`, no encoder, or the folder cannot be written.
    """
    path = Path(output)
    if path.suffix and path.suffix.lower() not in ENDINGS:
        raise ViewError(
            f"{path}: a film ends in .mp4 or .gif; a name without ending is a folder of PNG files"
        )
    if path.suffix and path.is_dir():
        raise ViewError(f"{path}: is a folder; give the name of a file in it")
    if not path.suffix and path.is_file():
        raise ViewError(f"{path}: is a file; pictures go into a folder")
    exists = any(path.glob(_FRAMES)) if not path.suffix else path.exists()
    if exists and not force:
        raise ViewError(f"{path}: exists; --force (force=True) replaces it")
    if path.suffix.lower() == ".mp4" and find_ffmpeg() is None:
        raise ViewError(f"{path}: {MISSING}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            return path
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error


def write_film(frames: Iterable[Image], path: Path, rate: float, samples: int = 0) -> None:
    """Write frames (height, width, 3) into the file, or as PNG files into a folder.

    Parameters
    ----------
    frames : iterable of array
        The first `samples` are not part of the film; they show which colours it has.
    path : Path
        Ends in .mp4 or .gif; a folder if it has no ending.
    rate : float
        Frames per second.

    Raises
    ------
    ViewError
        The file cannot be written, or the encoder failed.
    """
    frames = iter(frames)
    first = [next(frames) for _ in range(samples)]
    try:
        if not path.suffix:
            with _whole_folder(path) as folder:
                _write_pictures(frames, folder)
            return
        with whole_file(path) as partial:
            if path.suffix.lower() == ".gif":
                _write_gif(first, frames, partial, rate)
            else:
                _write_mp4(frames, partial, rate)
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error


@contextmanager
def _whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder next to `path`, whose pictures replace older ones there at the end."""
    folder = partial_path(path)
    try:
        folder.mkdir()
        yield folder
        path.mkdir(exist_ok=True)
        for old in path.glob(_FRAMES):
            old.unlink()
        for new in sorted(folder.iterdir()):
            os.replace(new, path / new.name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _write_pictures(frames: Iterator[Image], folder: Path) -> None:
    from PIL import Image as Pillow

    for k, frame in enumerate(frames):
        Pillow.fromarray(frame).save(folder / FRAME.format(k + 1), compress_level=3)


def _write_mp4(frames: Iterator[Image], path: Path, rate: float) -> None:
    program = find_ffmpeg()
    if program is None:
        raise ViewError(f"{path}: {MISSING}")
    first = next(frames)
    height, width = first.shape[:2]
    command = [
        program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
        "-s", f"{width}x{height}", "-r", f"{rate:.6g}", "-i", "-", "-an", "-c:v", "libx264",
        "-preset", "veryfast", "-crf", _QUALITY, "-pix_fmt", "yuv420p",
        "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-movflags", "+faststart", "-f", "mp4", str(path),
    ]  # fmt: skip
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stderr=errors, start_new_session=True
        ) as process,
    ):
        assert process.stdin is not None
        try:
            for frame in chain([first], frames):
                process.stdin.write(np.ascontiguousarray(frame).data)
            process.stdin.close()
            failed = process.wait() != 0
        except BrokenPipeError:
            process.wait()
            failed = True
        finally:
            process.kill()
        if failed:
            errors.seek(0)
            messages = errors.read().decode(errors="replace").strip().splitlines()
            why = messages[-1] if messages else "it ended; is the disk full?"
            raise ViewError(f"ffmpeg could not write the film: {why}")


def _write_gif(samples: list[Image], frames: Iterator[Image], path: Path, rate: float) -> None:
    """One palette for all frames; of each frame the box that changed, unchanged pixels
    transparent."""
    from PIL import GifImagePlugin
    from PIL import Image as Pillow

    step = 1 + samples[0].shape[1] // _PALETTE_WIDTH
    some = Pillow.fromarray(np.vstack([sample[::step, ::step] for sample in samples]))
    colors = some.quantize(_COLORS, method=Pillow.Quantize.MAXCOVERAGE, kmeans=2)
    palette = bytes(colors.getpalette() or ()).ljust(768, b"\0")
    height, width = samples[0].shape[:2]
    size = width.to_bytes(2, "little") + height.to_bytes(2, "little")
    delay = round(100.0 / rate).to_bytes(2, "little")
    before: Any = None
    with path.open("wb") as file:
        file.write(b"GIF89a" + size + b"\xf7\x00\x00" + palette + _LOOP)
        for frame in frames:
            shown = Pillow.fromarray(frame).quantize(palette=colors, dither=Pillow.Dither.NONE)
            now = np.asarray(shown)
            box, part = (0, 0), now
            if before is not None:
                changed = now != before
                rows, columns = np.flatnonzero(changed.any(1)), np.flatnonzero(changed.any(0))
                top, left = (int(rows[0]), int(columns[0])) if len(rows) else (0, 0)
                end = (int(rows[-1]) + 1, int(columns[-1]) + 1) if len(rows) else (1, 1)
                box, inside = (left, top), np.s_[top : end[0], left : end[1]]
                part = np.where(changed[inside], now[inside], _COLORS).astype(np.uint8)
            before = now
            # graphic control extension: keep the previous frame; colour 255 is transparent
            file.write(b"\x21\xf9\x04\x05" + delay + bytes([_COLORS]) + b"\x00")
            cut = Pillow.fromarray(part)
            file.write(b"".join(GifImagePlugin.getdata(cut, box)))
        file.write(b";")
