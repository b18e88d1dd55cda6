"""Tables and columns of a result: their names and widths, and which rows are valid.

A result file holds one table for each kind of quantity and one column for each number of it. The
names of the columns are those of the compiled system's layout.

=============  ==================  ==========================================================
dataset        shape               meaning
=============  ==================  ==========================================================
/time          (n,)                time [s]
/q             (n, nq)             positions, per body r [m], p [-], eta [m kg^1/2 or as scaled]
/v             (n, nv)             velocities, per body r_dot [m/s], w [rad/s, body axes], eta_dot
/vd            (n, nv)             accelerations
/lam           (n, nc)             constraint multipliers [N or N m]
/reactions     (n, 12 reactions)   of each joint and driver: force [N] and moment [N m] on marker J
                                   in its axes, then on marker I in its axes
/sensors       (n, channels)       sensor channels, SI
/energy        (n, energies)       energies and works [J]
/drift         (n, 2)              largest constraint violation: position, velocity
=============  ==================  ==========================================================

`result_file` describes the other datasets. Of q, v, vd, lam, reactions, sensors and energy only the
columns are stored that the scene requests (`output_request`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import BodyColumns, Layout
from flexmb.errors import ResultFileError

DRIFT: Final = ("position", "velocity")
_WIDTHS: Final[Mapping[str, Callable[[Layout], int]]] = {
    "time": lambda layout: 1,  # without a second axis
    "q": lambda layout: layout.nq,
    "v": lambda layout: layout.nv,
    "vd": lambda layout: layout.nv,
    "lam": lambda layout: layout.nc,
    "reactions": lambda layout: 12 * len(layout.reactions),
    "sensors": lambda layout: len(layout.channels),
    "energy": lambda layout: len(layout.energies),
    "drift": lambda layout: len(DRIFT),
}
TABLES: Final = tuple(_WIDTHS)


@dataclass(frozen=True)
class Columns(Layout):
    """Names and offsets of all columns of a result."""

    @classmethod
    def of(cls, layout: Layout) -> Columns:
        """The columns of a compiled system's layout."""
        return cls(**vars(layout))

    def body(self, name: str) -> BodyColumns:
        """The columns of the body of that name.

        Raises
        ------
        ResultFileError
            No such body; lists those there are, nearest first.
        """
        bodies = {body.name: body for body in self.bodies}
        if name not in bodies:
            raise ResultFileError.unknown(f'the result has no body "{name}"', name, bodies)
        return bodies[name]


def widths(layout: Layout) -> dict[str, int]:
    """Number of columns of every table."""
    return {name: width(layout) for name, width in _WIDTHS.items()}


def count_finite_rows(tables: dict[str, NDArray[np.float64]]) -> int:
    """Number of leading rows that hold finite numbers only."""
    k = len(tables["time"])
    finite = np.ones(k, dtype=bool)
    for values in tables.values():
        finite &= np.isfinite(values.reshape(k, -1)).all(axis=1)
    return k if finite.all() else int(np.argmin(finite))


def describe_bad_row(columns: Columns, tables: dict[str, NDArray[np.float64]], row: int) -> str:
    """The sentence for a row that is not finite: its time, and at most five of its names."""
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
    where = ", ".join(list(dict.fromkeys(names))[:5] or ["time"])
    t = tables["time"][row]
    time = f"at t = {t:g} s" if np.isfinite(t) else "in time"
    return f"the solution is no longer a finite number {time} ({where})"
