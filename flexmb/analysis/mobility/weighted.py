"""The Jacobian of one pose as the mobility report looks at it: weighted, rows with their owners.

Rows are counted in radians and in metres over the model size, columns likewise, so that numbers
compare. Scalar coordinates that rows follow, such as the angle a spring counts, and places along
curves are unknowns beside those of the bodies; each takes one equation for itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.mobility.dependence import Dependence, dependence
from flexmb.analysis.mobility.poses import Closed, column_scales
from flexmb.engine.compile import Compiled

__all__ = ["Weighted", "element", "elements", "plain_name", "weighted"]

Array = NDArray[np.float64]
Ends = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class Weighted:
    """Weighted rows in one pose.

    A (nc, columns); `columns` their indices in the system; `owners` the path that the reaction of
    each row has; g (nc, 12) gradients with lengths over the model size.
    """

    compiled: Compiled
    pose: Closed
    A: Array
    g: Array
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

    @cached_property
    def scalar(self) -> NDArray[np.bool_]:
        """Which columns are scalar coordinates beside the bodies."""
        found: NDArray[np.bool_] = self.columns >= self.compiled.layout.nv - len(
            self.compiled.layout.coordinates
        )
        return found

    @cached_property
    def norm(self) -> float:
        """Largest singular value of A."""
        return float(np.linalg.norm(self.A, 2)) if self.A.size else 1.0

    @cached_property
    def dependence(self) -> Dependence:
        """Dependence of all rows."""
        return dependence(self.A)

    @cached_property
    def joint_dependence(self) -> Dependence:
        """Dependence of all rows but the drivers'; circuits on all rows."""
        if not np.any(self.driven):
            return self.dependence
        joints = dependence(self.A[~self.driven])
        circuits = np.zeros((len(joints.circuits), len(self.A)))
        circuits[:, ~self.driven] = joints.circuits
        return replace(joints, circuits=circuits)

    def of(self, owner: str) -> NDArray[np.bool_]:
        """Which rows belong to a scene path."""
        return np.array([name == owner for name in self.owners], dtype=bool)

    def ends(self, owner: str) -> Ends:
        """Places over the model size and axes of the two markers of a joint, I and J."""
        group = self.compiled.system.groups[self.compiled.layout.reactions.index(owner)]
        row = self.compiled.system.rows[group["row"]]
        rows, size = self.pose.rows, self.compiled.length
        i, j = (int(row[side]) for side in ("JI" if group["reversed"] else "IJ"))
        return rows.x[i] / size, rows.R[i], rows.x[j] / size, rows.R[j]

    def on_J(self, owner: str) -> Array:
        """Gradients (n, 6) of the rows of a joint for motions of its marker J."""
        group = self.compiled.system.groups[self.compiled.layout.reactions.index(owner)]
        side = slice(0, 6) if group["reversed"] else slice(6, 12)
        return self.g[self.of(owner), side]


def weighted(compiled: Compiled, pose: Closed) -> Weighted:
    """The weighted rows of a system in a pose."""
    system = compiled.system
    scales = column_scales(compiled)
    columns = np.flatnonzero(scales > 0)
    weights = system.row_weights[:, None]
    reach = np.tile(np.repeat([compiled.length, 1.0], 3), 2)
    groups = np.repeat(np.arange(len(system.groups)), system.groups["n"])
    owners = tuple(compiled.layout.reactions[k] for k in groups)
    A = weights * pose.rows.Cq[:, columns] * scales[columns]
    return Weighted(compiled, pose, A, weights * pose.rows.g * reach, columns, owners)


def element(path: str) -> str:
    """The section and name of what a path is of: couplers have a reaction for each joint."""
    return ".".join(path.split(".")[:2])


def elements(paths: Iterable[str]) -> tuple[str, ...]:
    """The elements of paths, each once."""
    return tuple(dict.fromkeys(element(path) for path in paths))


def plain_name(path: str) -> str:
    """The name of a joint without its section, of anything else with it."""
    return path.removeprefix("joints.")
