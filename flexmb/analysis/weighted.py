"""The Jacobian of one pose as the mobility report looks at it: weighted, and without what follows.

Rows are counted in radians and in metres over the model size, columns likewise, so that numbers
compare. A scalar coordinate that one row alone follows, such as the angle a joint spring counts, is
left out together with its row: it says what the coordinate is and holds nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.poses import Closed, column_scales
from flexmb.engine.compile import Compiled

__all__ = ["Weighted", "plain_name", "weighted"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Weighted:
    """Weighted rows in one pose.

    A (n, columns); `rows` and `columns` their indices in the system; `owners` the scene path that
    each row belongs to; g (n, 12) gradients with lengths over the model size.
    """

    compiled: Compiled
    pose: Closed
    A: Array
    g: Array
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    owners: tuple[str, ...]

    @cached_property
    def driven(self) -> NDArray[np.bool_]:
        """Which rows are drivers'."""
        return np.array([owner.startswith("drivers.") for owner in self.owners], dtype=bool)

    @cached_property
    def modal(self) -> NDArray[np.bool_]:
        """Which columns are modal coordinates."""
        found = np.zeros(self.compiled.layout.nv, bool)
        for body in self.compiled.layout.bodies:
            found[body.iv + 6 : body.iv + 6 + body.m] = True
        return found[self.columns]

    def of(self, owner: str) -> NDArray[np.bool_]:
        """Which rows belong to a scene path."""
        return np.array([name == owner for name in self.owners], dtype=bool)

    def ends(self, owner: str) -> tuple[Array, Array, Array, Array]:
        """Places over the model size and axes of the two markers of a joint."""
        row = self.compiled.system.rows[self.rows[np.flatnonzero(self.of(owner))[0]]]
        markers, size = self.pose.rows.markers, self.compiled.length
        i, j = int(row["I"]), int(row["J"])
        return markers.x[i] / size, markers.R[i], markers.x[j] / size, markers.R[j]


def weighted(compiled: Compiled, pose: Closed) -> Weighted:
    """The weighted rows of a system in a pose."""
    system = compiled.system
    scales = column_scales(compiled)
    rows = np.ones(compiled.layout.nc, bool)
    columns = scales > 0
    scalars: Any = system.parts.coordinates
    followed = system.follows["coordinate"]
    for k in range(len(compiled.layout.coordinates)):
        if np.sum(followed == k) == 1:
            rows[system.follows["row"][followed == k]] = False
            columns[scalars[k]["iv"]] = False
    weights = system.row_weights[rows, None]
    reach = np.tile(np.repeat([compiled.length, 1.0], 3), 2)
    groups = np.repeat(np.arange(len(system.groups)), system.groups["n"])
    owners = tuple(compiled.layout.reactions[groups[k]] for k in np.flatnonzero(rows))
    A = weights * pose.rows.Cq[rows][:, columns] * scales[columns]
    g = weights * pose.rows.g[rows] * reach
    return Weighted(compiled, pose, A, g, np.flatnonzero(rows), np.flatnonzero(columns), owners)


def plain_name(path: str) -> str:
    """The name of a joint without its section, of anything else with it."""
    return path.removeprefix("joints.")
