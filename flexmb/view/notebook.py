"""Pictures, films and pages as values that notebooks show where they are the last line of a cell.

In: a result, a time, words of the view. Out: a :class:`Picture`, a :class:`Film` or a
:class:`Page`; none leaves files behind that were not asked for.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from flexmb.folders import scratch_folder, write_text_file
from flexmb.results import Result
from flexmb.view.encoder import find_ffmpeg
from flexmb.view.film import film
from flexmb.view.stills import render


@dataclass(frozen=True)
class Picture:
    """A picture of a run.

    Parameters
    ----------
    png : bytes
        As a file would hold it.
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
        As a file would hold it.
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
    """A web page of one file that needs nothing else; a notebook shows it in a frame.

    Parameters
    ----------
    html : str
        Its text.
    file : Path
        Where it is saved by default.
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
    result: Result | str | Path, time: float | Sequence[float] | None = None, **options: Any
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
