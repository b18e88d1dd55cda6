"""Joints and drivers as groups of constraint rows.

Each joint type is a list of primitives between its two triads (`joint_rows`); a driver is one more
row on the same triads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from flexmb.engine.compile import coordinates
from flexmb.engine.compile.joint_rows import (
    JOINT_ROWS,
    Row,
    composite_rows,
    driver_row,
    measured,
)
from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.planar import STROKE, planar_joint
from flexmb.engine.compile.pool import Functions
from flexmb.engine.tables import (
    ANGLE,
    DISTANCE,
    DOT1,
    DOT2,
    MOMENT,
    POINT,
    RADIAL,
    TWIST,
)
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.markers import PlacedMarker
from flexmb.model.model import Model

ANGULAR = (DOT1, ANGLE, TWIST)
"""Kinds of rows that measure no length."""

Entry = tuple[int, int, int, float, int, int]
_ROW_WORDS = {
    POINT: "place {a}",
    DOT1: "axes {a} and {b}",
    DOT2: "offset {a}",
    DISTANCE: "length",
    ANGLE: "angle",
    TWIST: "twist",
    RADIAL: "distance from the axis",
    MOMENT: "distance of the axes",
}


@dataclass
class Groups:
    """Constraint rows, group by group."""

    rows: list[tuple[int, int, int, int, int, float, int, int]] = field(default_factory=list)
    groups: list[tuple[int, int, int, int]] = field(default_factory=list)  # row, n, body I, J
    names: list[str] = field(default_factory=list)  # of the rows
    owners: list[str] = field(default_factory=list)  # scene path of each group

    def add(self, name: str, markers: Markers, I: int, J: int, rows: list[Entry]) -> None:  # noqa: E741
        """Append a group of rows (kind, a, b, constant, function, coordinate) between I and J."""
        self.groups.append((len(self.rows), len(rows), markers.body(I), markers.body(J)))
        self.owners.append(name)
        for kind, a, b, offset, fun, coordinate in rows:
            self.rows.append((kind, I, J, a, b, offset, fun, coordinate))
            what = _ROW_WORDS[kind].format(a="xyz"[a], b="xyz"[b]) if fun < 0 else "driven"
            self.names.append(f"{name}: {what if coordinate < 0 else 'coordinate'}")


def joint_groups(
    model: Model, flexbodies: Mapping[str, FlexBody], markers: Markers, functions: Functions
) -> Groups:
    """All joints, all drivers, then what follows a joint with a coordinate of its own."""
    groups = Groups()
    ends: dict[str, tuple[int, int]] = {}
    for name, joint in model.joints.items():
        I, J = lookup.joint_frames(model, name, flexbodies)  # noqa: E741
        if model.plane is not None:
            I, J, kept = planar_joint(model, joint, I, J)  # noqa: E741
        else:
            kept = JOINT_ROWS.get(joint.type) or composite_rows(model, name, I, J)
        ends[name] = markers.add(I), markers.add(J)
        rows = [(*row[:3], _constant(model, name, row, I, J), -1, -1) for row in kept]
        groups.add(f"joints.{name}", markers, *ends[name], rows)
    for name, driver in model.drivers.items():
        row = _driven(model, driver.joint, driver.coordinate)
        fun = functions.add(driver.function.expression)
        groups.add(f"drivers.{name}", markers, *ends[driver.joint], [(*row, 0.0, fun, -1)])
    for k, (name, force) in enumerate(coordinates.joint_springs(model).items()):
        row = _driven(model, force.joint, force.coordinate)
        groups.add(f"forces.{name}", markers, *ends[force.joint], [(*row, 0.0, -1, k)])
    return groups


def _driven(model: Model, joint: str, coordinate: str) -> tuple[int, int, int]:
    """Kind and axes of the row that measures a coordinate of a joint."""
    if model.plane is not None and coordinate == "stroke":
        return STROKE
    return driver_row(model.joints[joint].type, coordinate)


def _constant(
    model: Model,
    name: str,
    row: Row,
    I: PlacedMarker,  # noqa: E741
    J: PlacedMarker,
) -> float:
    """The constant of a row of a joint.

    Raises
    ------
    SceneError
        A link without length.
    """
    length = model.joints[name].length
    if row[0] == DISTANCE and length is not None:
        return length
    try:
        return measured(model, row, I, J)
    except ZeroDivisionError:
        what = "the link has no length in the placed pose, so its direction is not known"
        cure = "place the markers apart, or use a joint that holds them together"
        raise SceneError.from_problems([Problem(f"joints.{name}", f"{what}; {cure}")]) from None


def couples(groups: Groups) -> list[tuple[int, int]]:
    """Pairs of bodies whose tangents a group couples: all but mere coincidence."""
    pairs = []
    for row, n, i, j in groups.groups:
        curved = any(r[0] != POINT for r in groups.rows[row : row + n])
        if curved and i >= 0 and j >= 0:
            pairs.append((i, j))
    return pairs


def check_ends(groups: Groups) -> list[str]:
    """Names of groups whose two markers are on the same body."""
    return [groups.names[row] for row, _, i, j in groups.groups if i == j]


def row_weights(groups: Groups, length: float) -> np.ndarray:
    """(nc,) size of one unit of every row: metres over the model size, radians."""
    return np.array([1.0 if row[0] in ANGULAR else 1.0 / length for row in groups.rows])


def row_table(groups: Groups, sizes: np.ndarray, n_functions: int) -> np.ndarray:
    """ROW rows with the places of their Jacobian rows; `sizes` is 6 + m of each body.

    What follows a coordinate takes its value from behind the functions of time.
    """
    from flexmb.engine.tables import ROW

    table = np.zeros(len(groups.rows), ROW)
    at = 0
    for row, n, i, j in groups.groups:
        for k in range(row, row + n):
            kind, I, J, a, b, offset, fun, coordinate = groups.rows[k]  # noqa: E741
            jac = []
            for body in (i, j):
                jac.append(at if body >= 0 else -1)
                at += int(sizes[body]) if body >= 0 else 0
            slot = fun if coordinate < 0 else n_functions + coordinate
            table[k] = (kind, I, J, a, b, slot, *jac, coordinate, -1, offset)
    return table
