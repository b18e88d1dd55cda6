"""Common parts of all plots: style, units, files; matplotlib is used without global state.

Colours are those of all pictures.
"""

from __future__ import annotations

from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Final

from flexmb.errors import ViewError
from flexmb.folders import whole_file
from flexmb.units import SI, UnitSystem

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PAPER: Final = "#ffffff"
INK: Final = "#2b2f36"
GHOST: Final = "#6b7280"
GROUND: Final = "#c9c5bb"
JOINT: Final = "#e07b24"
COLORMAP: Final = "viridis"
DIVERGING: Final = "coolwarm"

# Bodies in the order of the scene: muted colours far apart in hue and lightness, none close to the
# ends of the colour map or to the joints. Lines of plots: the Okabe-Ito palette, safe for
# colour-blind readers (M. Okabe and K. Ito, Color Universal Design, 2008), without its yellow.
BODIES: Final = ("#7d93b2", "#b59f86", "#93ab8f", "#b08fa3", "#8aa8a8", "#a8a08a")
LINES: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")

_DPI = 150
_TITLE, _LETTER = 12, 7.0  # points: size of titles, and width of a letter, rarely more
WIDTH = 7.6  # inch: near the width of a page, so that text stays legible there


def new_figure(width: float, height: float, title: str = "") -> Figure:
    """An empty matplotlib figure for plots [inch], without matplotlib's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained")
    if title:
        lines = wrap(title, int(0.96 * width * 72 / _LETTER))
        figure.suptitle("\n".join(lines), color=INK, fontsize=_TITLE, x=0.02, ha="left")
    return figure


def style_axes(axes: Any, **ticks: Any) -> None:
    """White background, light grid, no frame above and right; `ticks` go to the tick labels."""
    axes.set_facecolor("white")
    axes.grid(True, which="major", color="#d9dbe0", lw=0.6)
    axes.tick_params(colors=INK, **ticks)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def writable_file(output: str | Path, endings: tuple[str, ...]) -> Path:
    """The path, with its folder created, if a file with one of these suffixes can be written there.

    Raises
    ------
    ViewError
        Another ending, a folder in its place, or the folder cannot be made or written.
    """
    path = Path(output)
    if path.suffix.lower() not in endings:
        raise ViewError(f"{path}: the file must end in {' or '.join(endings)}")
    if path.is_dir():
        raise ViewError(f"{path}: is a folder; give the name of a file in it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        with path.open("ab"):
            pass
        if new:
            path.unlink()
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path


def save_figure(figure: Figure, output: str | Path) -> Path:
    """Write a figure to a file that ends in .png, .pdf or .svg.

    Raises
    ------
    ViewError
        Another ending, or the file cannot be written.
    """
    path = writable_file(output, (".png", ".pdf", ".svg"))
    try:
        with whole_file(path) as partial:
            figure.savefig(partial)
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path


_PREFIXED = ("m", "m/s", "m/s²", "s", "Pa")
_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def prefixed(largest: float, unit: str, units: UnitSystem) -> tuple[float, str]:
    """Factor and unit that bring `largest` to about 1 to 1000; prefixes for Pa, m, s, m/s in SI."""
    if units is not SI or unit not in _PREFIXED:
        return 1.0, unit
    for factor, prefix in _PREFIXES:
        if largest >= factor and (factor <= 1.0 or unit == "Pa"):
            return factor, prefix + unit
    return 1.0, unit
