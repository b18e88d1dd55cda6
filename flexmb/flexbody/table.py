"""The mode table of a body, as rows of text for whoever prints it.

In: a :class:`FlexBody`. Out: one row per candidate mode under the headings ``MODE_COLUMNS``.
"""

from __future__ import annotations

import math

from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.parts import ModeInfo

__all__ = ["MODE_COLUMNS", "mode_table"]

MODE_COLUMNS = (
    "mode",
    "kind",
    "frequency [Hz]",
    "mostly",
    "interface share",
    "moves along x, y, z",
    "kept or why dropped",
)


def mode_table(body: FlexBody) -> list[tuple[str, ...]]:
    """Rows of text under ``MODE_COLUMNS``: all candidates in the order of the body."""
    return [_row(mode) for mode in body.modes]


def _row(mode: ModeInfo) -> tuple[str, ...]:
    return (
        str(mode.index) if mode.kept else "-",
        mode.kind,
        f"{mode.frequency:.6g}",
        mode.mostly,
        _share(mode.interface_share),
        " ".join(_share(value) for value in mode.kinetic_share).strip(),
        f"{'kept' if mode.kept else 'dropped'}: {mode.why}",
    )


def _share(value: float) -> str:
    return "" if math.isnan(value) else f"{100 * value:.0f} %"
