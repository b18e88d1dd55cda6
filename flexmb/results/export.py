"""Channels as a table of text (CSV): one row per output time, units in the header.

In: a result and names of channels. Out: a file as spreadsheets and other programs read it: commas,
decimal points, every number with all its digits, in the scene's units.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import OutputError, Problem, ResultFileError, nearest
from flexmb.results.channels import GROUPS, all_channels, channels

if TYPE_CHECKING:
    from flexmb.results.result import Result

__all__ = ["write_csv"]


def write_csv(result: Result, path: str | Path, names: Sequence[str], what: str) -> Path:
    """Write channels to a file; see `Result.to_csv`."""
    target = Path(path)
    chosen = tuple(names) or result.channels(what)
    _refuse_unknown(result, chosen)
    if not chosen:
        lacks = f"has no channels of the kind {what}"
        if what in GROUPS and channels(result.layout, result.model, what):
            lacks = (
                f'kept no channels of the kind {what}; keep = ["{what}"] in [results] keeps them'
            )
        raise ResultFileError(f"{result.path}: {lacks}")
    if not len(result.time):
        raise ResultFileError(f"{result.path}: holds no output rows")
    header = [_titled("time", result.units.label("s"))]
    header += [_titled(name, result.unit(name)) for name in chosen]
    table = np.column_stack([result.time, *(result[name] for name in chosen)])
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(table.tolist())  # the shortest text that reads back as the number
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from error
    return target


def _refuse_unknown(result: Result, names: Sequence[str]) -> None:
    """All names that are none at once; the first one that was not kept."""
    there = all_channels(result.layout, result.model)
    for name in names:
        if name in there and name not in result:
            _ = result[name]  # says what keeps it
    known = [name for kind in ("sensors", "reactions", "energy") for name in result.channels(kind)]
    problems = [
        Problem("", f'the result has no channel "{name}"', tuple(known), nearest(name, known))
        for name in names
        if name not in result
    ]
    if problems:
        raise ResultFileError.from_problems(problems)


def _titled(name: str, unit: str) -> str:
    return f"{name} [{unit.replace('²', '^2')}]" if unit else name
