"""Rows that are no longer finite numbers: how many are good, and what went wrong where.

In: the tables of a block of rows. Out: the number of good rows before the first bad one, and the
sentence that names time, bodies, joints and channels of the bad one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.results.layout import Columns
from flexmb.results.schema import DRIFT

__all__ = ["finite_rows", "not_finite"]

Tables = dict[str, NDArray[np.float64]]


def finite_rows(tables: Tables) -> int:
    """Number of leading rows that hold finite numbers only."""
    k = len(tables["time"])
    finite = np.ones(k, dtype=bool)
    for values in tables.values():
        finite &= np.isfinite(values.reshape(k, -1)).all(axis=1)
    return k if finite.all() else int(np.argmin(finite))


def not_finite(columns: Columns, tables: Tables, row: int) -> str:
    """The sentence for a row that is not finite."""
    known = np.isfinite(tables["time"][row])
    time = f"at t = {tables['time'][row]:g} s" if known else "in time"
    where = ", ".join(_bad_columns(columns, tables, row))
    return f"the solution is no longer a finite number {time} ({where})"


def _bad_columns(columns: Columns, tables: Tables, row: int) -> list[str]:
    """Bodies, joints and channels that are not finite in this row, at most five of them."""
    names: list[str] = []
    for key, start in (("q", "iq"), ("v", "iv"), ("vd", "iv")):
        bad = np.flatnonzero(~np.isfinite(tables[key][row]))
        starts = [getattr(body, start) for body in columns.bodies]
        owners = np.unique(np.searchsorted(starts, bad, side="right") - 1)
        names += [f"body {columns.bodies[k].name}" for k in owners]
    labels = {
        "lam": [f"constraint {name}" for name in columns.rows],
        "reactions": [f"reaction {name}" for name in columns.reactions for _ in range(12)],
        "sensors": [f"sensor {name}" for name in columns.channels],
        "energy": [f"energy {name}" for name in columns.energies],
        "drift": [f"{name} drift" for name in DRIFT],
    }
    for key, label in labels.items():
        names += [label[i] for i in np.flatnonzero(~np.isfinite(tables[key][row]))]
    return list(dict.fromkeys(names))[:5] or ["time"]
