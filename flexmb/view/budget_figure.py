"""The picture of an error budget: the shares of each sensor as points on a logarithmic axis."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

from flexmb.errors import ViewError
from flexmb.view.plot import GHOST, INK, LINES, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_SMALLEST = 1e-7  # in percent; less is not drawn


def budget_figure(
    sensors: Sequence[str],
    shares: Mapping[str, Mapping[str, float]],
    open_shares: Collection[str],
    *,
    target: float,
    title: str,
) -> Figure:
    """A line for each sensor, a mark for each share, a bar to the sum.

    Parameters
    ----------
    sensors : sequence of str
        From top to bottom.
    shares : mapping
        Name of a share to its value over the peak-to-peak, by sensor.
    open_shares : collection of str
        Shares that are lower bounds: hollow.
    target : float
        Error to be met by each, drawn as a line.
    title : str
        Above the picture.

    Raises
    ------
    ViewError
        There is nothing to draw.
    """
    if not sensors or not shares:
        raise ViewError("no share of the error is known: there is nothing to draw")
    figure = new_figure(8.6, 1.9 + 0.42 * len(sensors) + 0.1 * len(shares), title)
    axes = figure.subplots()
    values = [100 * v for s in shares.values() for v in s.values() if 100 * v > _SMALLEST]
    left = 0.4 * min([*values, 100 * target])
    for k, sensor in enumerate(sensors):
        total = 100 * sum(s.get(sensor, 0.0) for s in shares.values())
        axes.barh(k, max(total, left) - left, left=left, height=0.62, color=GHOST, alpha=0.22,
                  lw=0, label="sum" if k == 0 else None)  # fmt: skip
    for i, (name, share) in enumerate(shares.items()):
        places = [k for k, sensor in enumerate(sensors) if 100 * share.get(sensor, 0.0) > _SMALLEST]
        numbers = [100 * share[sensors[k]] for k in places]
        colour = LINES[i % len(LINES)]
        least = name in open_shares
        axes.plot(
            numbers, [k + 0.22 * (i / max(len(shares) - 1, 1) - 0.5) * 2 for k in places],
            ls="", marker=_MARKERS[i % len(_MARKERS)], ms=7, mec=colour,
            mfc="none" if least else colour,
            label=name + (" (at least)" if least else "" if places else " (round-off)"),
        )  # fmt: skip
    axes.axvline(100 * target, color=INK, lw=0.9, ls="--", label=f"target {100 * target:.2g} %")
    axes.set_xscale("log")
    axes.set_xlim(left=left)
    axes.set_ylim(len(sensors) - 0.4, -0.6)
    axes.set_yticks(range(len(sensors)), list(sensors))
    axes.set_xlabel("share of the error, % of the sensor's peak-to-peak", color=INK, fontsize=9)
    style_axes(axes, labelsize=8)
    figure.legend(loc="outside right upper", frameon=False, labelcolor=INK, fontsize=8)
    return figure
