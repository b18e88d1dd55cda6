"""The mode table of a body, as rows of text for whoever prints it.

In: a :class:`FlexBody`. Out: one row per candidate mode under the headings ``MODE_COLUMNS``:
`mostly` names the candidate with the most strain energy in the mode, `interfaces` the share of
strain energy in interface motions, `x/y/z` the shares of kinetic energy along the axes.
"""

from __future__ import annotations

import math

from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.parts import ModeInfo

__all__ = ["MODE_COLUMNS", "mode_table"]

MODE_COLUMNS = (
    "mode",
    "kind",
    "f [Hz]",
    "mostly",
    "interfaces",
    "x/y/z",
    "kept or why dropped",
)


def mode_table(body: FlexBody) -> list[tuple[str, ...]]:
    """Rows of text under ``MODE_COLUMNS``: all candidates in the order of the body."""
    return [_row(mode) for mode in body.modes]


def _row(mode: ModeInfo) -> tuple[str, ...]:
    return (
        str(mode.index) if mode.kept else "-",
        mode.kind,
        f"{mode.frequency:.1f}" if mode.frequency >= 100.0 else f"{mode.frequency:.3g}",
        mode.mostly,
        _share(mode.interface_share),
        _along_axes(mode.kinetic_share),
        f"{'kept' if mode.kept else 'dropped'}{': ' if mode.why else ''}{mode.why}",
    )


def _along_axes(shares: tuple[float, ...]) -> str:
    known = bool(shares) and not any(math.isnan(value) for value in shares)
    return "/".join(f"{round(100 * value):d}" for value in shares) + " %" if known else ""


def _share(value: float) -> str:
    return "" if math.isnan(value) else f"{round(100 * value):d} %"
