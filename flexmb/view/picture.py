"""One picture of a mechanism at a time of a run.

In: a :class:`Result`, a time, how much to exaggerate deformations. Out: a PNG file, drawn by VTK
where it renders, else by matplotlib, which then says so in the picture and names what to install.
"""

from __future__ import annotations

from pathlib import Path

from flexmb.errors import ViewError
from flexmb.results import Result
from flexmb.view import backend
from flexmb.view.files import writable_file

__all__ = ["COLORS", "render"]

COLORS = ("displacement", "body")
_LEAST_PIXELS = 64


def render(
    result: Result | str | Path,
    time: float | None = None,
    *,
    exaggeration: float | str | None = None,
    color: str = "displacement",
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
        to the body frame; ``"body"`` gives every body its own colour.
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
    _check(color, exaggeration, pixels)
    content = compose(
        mechanism,
        exaggeration=view.exaggeration if exaggeration is None else exaggeration,
        color=color,
        direction=direction,
    )
    verdict = backend.probe()
    if verdict.works:
        backend.use(verdict)
        from flexmb.view import vtk_picture

        vtk_picture.draw(content, path, pixels)
    else:
        from flexmb.view import mpl_picture

        mpl_picture.draw(content, path, pixels, f"{verdict.how}; {verdict.advice}")
    return path


def _check(color: str, exaggeration: float | str | None, size: tuple[int, int]) -> None:
    if color not in COLORS:
        raise ViewError(f'unknown color "{color}"; allowed: {", ".join(COLORS)}')
    if isinstance(exaggeration, str) and exaggeration != "auto":
        raise ViewError(f'exaggeration "{exaggeration}" is neither a number nor "auto"')
    if isinstance(exaggeration, int | float) and not 0 <= exaggeration < float("inf"):
        raise ViewError(f"exaggeration {exaggeration} must be a number of at least 0")
    if min(size) < _LEAST_PIXELS:
        raise ViewError(f"a picture of {size[0]} x {size[1]} pixels is too small to show anything")
