"""One picture of a mechanism at a time of a run.

In: a :class:`Result`, a time, how much to exaggerate deformations. Out: a PNG file, drawn by VTK
where it renders, else by matplotlib, which then says so in the picture and names what to install.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flexmb.errors import Problem, ViewError, nearest
from flexmb.results import Result
from flexmb.view import backend
from flexmb.view.content import Content
from flexmb.view.files import writable_file

__all__ = ["COLORS", "check_exaggeration", "check_size", "draw_panels", "render"]

COLORS = ("displacement", "von_mises", "body")
_LEAST_PIXELS = 64


def render(
    result: Result | str | Path,
    time: float | None = None,
    *,
    exaggeration: float | str | None = None,
    color: str = "displacement",
    layer: str | None = None,
    direction: tuple[float, float, float] | None = None,
    size: tuple[int, int] | None = None,
    output: str | Path = "picture.png",
) -> Path:
    """Draw the mechanism at a time; what is left out follows the scene's ``[view]``.

    Parameters
    ----------
    result : Result or path
        The run.
    time : float, optional
        Within the run, in the scene's units; the end if the scene does not say.
    exaggeration : float or "auto", optional
        Factor on the deformation of flexible bodies; ``"auto"`` chooses a round one that shows it.
        The factor is written in the picture.
    color : str
        ``"displacement"`` colours flexible bodies by the magnitude of their displacement relative
        to the body frame, ``"von_mises"`` by their stress, ``"body"`` gives every body its own.
    layer : str, optional
        The layer whose stress is shown, such as ``"top"``; by default the largest of all layers.
    direction : three floats, optional
        From the scene towards the eye, global axes; along the joint axes if the scene does not say.
    size : two ints, optional
        Width and height in pixels; 1280 by 720 if the scene does not say.
    output : path
        A file that ends in .png.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ViewError
        An option that cannot be, nothing to draw, or the file cannot be written.
    ResultFileError
        The time lies outside the run, or the file is no result.
    BodyFileError
        A flexible-body file is missing or damaged.
    """
    from flexmb.view.compose import compose
    from flexmb.view.mechanism import Mechanism

    path = writable_file(output, (".png",))
    run = result if isinstance(result, Result) else Result(result)
    mechanism = Mechanism(run, time)
    view = mechanism.model.view
    pixels = size or view.size
    _check(color, exaggeration, layer)
    check_size(pixels)
    content = compose(
        mechanism,
        exaggeration=view.exaggeration if exaggeration is None else exaggeration,
        color=color,
        layer=layer,
        direction=direction,
    )
    draw_panels([content], path, pixels)
    return path


def draw_panels(
    panels: Sequence[Content], path: Path, size: tuple[int, int], columns: int = 1
) -> None:
    """Draw panels, row by row, with VTK where it renders, else with matplotlib."""
    verdict = backend.probe()
    if verdict.works:
        backend.use(verdict)
        from flexmb.view import vtk_picture

        vtk_picture.draw(panels, path, size, columns)
    else:
        from flexmb.view import mpl_picture

        mpl_picture.draw(panels, path, size, f"{verdict.how}; {verdict.advice}", columns)


def _check(color: str, exaggeration: float | str | None, layer: str | None) -> None:
    if color not in COLORS:
        raise ViewError.from_problems(
            [Problem("", f'unknown color "{color}"', COLORS, nearest(color, COLORS))]
        )
    if layer is not None and color != "von_mises":
        raise ViewError(f'the layer "{layer}" is of stress; give color "von_mises" with it')
    check_exaggeration(exaggeration)


def check_exaggeration(exaggeration: float | str | None) -> None:
    """Refuse factors that cannot be.

    Raises
    ------
    ViewError
        Neither a number of at least 0 nor ``"auto"``.
    """
    if isinstance(exaggeration, str) and exaggeration != "auto":
        raise ViewError(f'exaggeration "{exaggeration}" is neither a number nor "auto"')
    if isinstance(exaggeration, int | float) and not 0 <= exaggeration < float("inf"):
        raise ViewError(f"exaggeration {exaggeration} must be a number of at least 0")


def check_size(size: tuple[int, int]) -> None:
    """Refuse pictures that show nothing.

    Raises
    ------
    ViewError
        Fewer than 64 pixels either way.
    """
    if min(size) < _LEAST_PIXELS:
        raise ViewError(f"a picture of {size[0]} x {size[1]} pixels is too small to show anything")
