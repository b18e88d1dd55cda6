"""Joints and drivers as groups of constraint rows.

Each joint type is a list of primitives between its two triads, axes x, y, z = 0, 1, 2, with z the
joint axis; a driver is one more row on the same triads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from flexmb.engine.compile import coordinates
from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.planar import STROKE, planar_joint
from flexmb.engine.compile.pool import Functions
from flexmb.engine.tables import ANGLE, DOT1, DOT2, POINT
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.markers import PlacedMarker
from flexmb.model.model import Model

X, Y, Z = 0, 1, 2
_TOGETHER = ((POINT, X, X), (POINT, Y, Y), (POINT, Z, Z))
_SAME_AXIS = ((DOT1, X, Z), (DOT1, Y, Z))
_SAME_AXES = ((DOT1, X, Y), (DOT1, Y, Z), (DOT1, Z, X))
_ON_AXIS = ((DOT2, X, X), (DOT2, Y, Y))

# Primitives of every joint type: kind, axis of I, axis of J.
JOINT_ROWS = {
    "fixed": _TOGETHER + _SAME_AXES,
    "revolute": _TOGETHER + _SAME_AXIS,
    "prismatic": _SAME_AXES + _ON_AXIS,
    "cylindrical": _SAME_AXIS + _ON_AXIS,
    "spherical": _TOGETHER,
}
DRIVER_ROWS = {"angle": (ANGLE, X, X), "stroke": (DOT2, Z, Z)}
_ROW_WORDS = {POINT: "place {a}", DOT1: "axes {a} and {b}", DOT2: "offset {a}", ANGLE: "angle"}


@dataclass
class Groups:
    """Constraint rows, group by group."""

    rows: list[tuple[int, int, int, int, int, int, int]] = field(default_factory=list)
    groups: list[tuple[int, int, int, int]] = field(default_factory=list)  # row, n, body I, J
    names: list[str] = field(default_factory=list)  # of the rows
    owners: list[str] = field(default_factory=list)  # scene path of each group

    def add(self, name: str, markers: Markers, I: int, J: int, rows: list[tuple[int, ...]]) -> None:  # noqa: E741
        """Append a group of rows (kind, a, b, function, coordinate) between markers I and J."""
        self.groups.append((len(self.rows), len(rows), markers.body(I), markers.body(J)))
        self.owners.append(name)
        for kind, a, b, fun, coordinate in rows:
            self.rows.append((kind, I, J, a, b, fun, coordinate))
            what = _ROW_WORDS[kind].format(a="xyz"[a], b="xyz"[b]) if fun < 0 else "driven"
            self.names.append(f"{name}: {what if coordinate < 0 else 'coordinate'}")


def joint_groups(
    model: Model, flexbodies: Mapping[str, FlexBody], markers: Markers, functions: Functions
) -> Groups:
    """All joints, all drivers, then what follows a joint with a coordinate of its own."""
    groups = Groups()
    ends: dict[str, tuple[int, int]] = {}
    for name, joint in model.joints.items():
        I, J = lookup.frames(model, joint.between, joint.axis, flexbodies)  # noqa: E741
        kept = JOINT_ROWS[joint.type]
        if model.plane is not None:
            I, J, kept = planar_joint(model, joint, I, J)  # noqa: E741
        ends[name] = markers.add(I), markers.add(J)
        rows = [(kind, a, b, -1, -1) for kind, a, b in kept]
        groups.add(f"joints.{name}", markers, *ends[name], rows)
    driven = DRIVER_ROWS if model.plane is None else {**DRIVER_ROWS, "stroke": STROKE}
    for name, driver in model.drivers.items():
        kind, a, b = driven[driver.coordinate]
        fun = functions.add(driver.function.expression)
        groups.add(f"drivers.{name}", markers, *ends[driver.joint], [(kind, a, b, fun, -1)])
    for k, (name, force) in enumerate(coordinates.joint_springs(model).items()):
        kind, a, b = driven[force.coordinate]
        groups.add(f"forces.{name}", markers, *ends[force.joint], [(kind, a, b, -1, k)])
    return groups


def joint_frames(
    model: Model, flexbodies: Mapping[str, FlexBody], joint: str
) -> tuple[PlacedMarker, PlacedMarker]:
    """Triads of one joint."""
    spec = model.joints[joint]
    return lookup.frames(model, spec.between, spec.axis, flexbodies)


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


def signs_of_axes(kind: str) -> tuple[int, ...]:
    """Axes of the two triads that must point the same way, not opposite, in a joint of a type."""
    return {"fixed": (X, Y, Z), "prismatic": (X, Y, Z), "revolute": (Z,), "cylindrical": (Z,)}.get(
        kind, ()
    )


def row_weights(groups: Groups, length: float) -> np.ndarray:
    """(nc,) size of one unit of every row: metres over the model size, radians."""
    return np.array([1.0 if row[0] in (DOT1, ANGLE) else 1.0 / length for row in groups.rows])


def row_table(groups: Groups, sizes: np.ndarray, n_functions: int) -> np.ndarray:
    """ROW rows with the places of their Jacobian rows; `sizes` is 6 + m of each body.

    What follows a coordinate takes its value from behind the functions of time.
    """
    from flexmb.engine.tables import ROW

    table = np.zeros(len(groups.rows), ROW)
    at = 0
    for row, n, i, j in groups.groups:
        for k in range(row, row + n):
            kind, I, J, a, b, fun, coordinate = groups.rows[k]  # noqa: E741
            jac = []
            for body in (i, j):
                jac.append(at if body >= 0 else -1)
                at += int(sizes[body]) if body >= 0 else 0
            slot = fun if coordinate < 0 else n_functions + coordinate
            table[k] = (kind, I, J, a, b, slot, *jac, coordinate, -1)
    return table
