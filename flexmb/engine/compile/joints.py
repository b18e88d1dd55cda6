"""Joints, drivers and couplers as groups of constraint rows.

Each joint type is a list of primitives between its two triads (`joint_rows`); a driver is one more
row on the same triads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from flexmb.engine.compile import coordinates, couplers
from flexmb.engine.compile.curve_joints import curve_joint
from flexmb.engine.compile.curves import Sliders
from flexmb.engine.compile.joint_rows import (
    JOINT_ROWS,
    SECOND_TURN,
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
    FOLLOW,
    MOMENT,
    POINT,
    RADIAL,
    ROW,
    TWIST,
)
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.markers import PlacedMarker
from flexmb.model.model import Model

ANGULAR = (DOT1, ANGLE, TWIST)
"""Kinds of rows that measure no length."""

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


Ends = tuple[PlacedMarker, PlacedMarker]
"""Markers I and J."""


class Entry(NamedTuple):
    """One row on two markers, as `tables.ROW` says."""

    kind: int
    a: int
    b: int
    offset: float = 0.0
    fun: int = -1
    follows: tuple[tuple[int, float], ...] = ()  # scalar coordinates and their factors


class PlacedEntry(NamedTuple):
    """A row with its markers."""

    entry: Entry
    I: int  # noqa: E741
    J: int


@dataclass
class Groups:
    """Constraint rows, group by group."""

    rows: list[PlacedEntry] = field(default_factory=list)
    groups: list[tuple[int, int, int, int]] = field(default_factory=list)  # row, n, body I, J
    names: list[str] = field(default_factory=list)  # of the rows
    owners: list[str] = field(default_factory=list)  # scene path of each group
    reversed: set[int] = field(default_factory=set)  # groups whose I is the joint's J
    sliders: Sliders = field(default_factory=Sliders)

    def add(self, name: str, markers: Markers, I: int, J: int, rows: list[Entry]) -> None:  # noqa: E741
        """Append a group of rows between I and J."""
        self.groups.append((len(self.rows), len(rows), markers.body(I), markers.body(J)))
        self.owners.append(name)
        for row in rows:
            self.rows.append(PlacedEntry(row, I, J))
            what = _ROW_WORDS[row.kind].format(a="xyz"[row.a], b="xyz"[row.b])
            what = "driven" if row.fun >= 0 else "coordinate" if row.follows else what
            self.names.append(f"{name}: {what}")

    def in_group(self, k: int) -> list[PlacedEntry]:
        """The rows of a group."""
        row, n, _, _ = self.groups[k]
        return self.rows[row : row + n]


def joint_groups(
    model: Model,
    flexbodies: Mapping[str, FlexBody],
    markers: Markers,
    functions: Functions,
    scalars: list[coordinates.Scalar],
) -> Groups:
    """All joints, all drivers, then what follows joints with coordinates of its own."""
    groups = Groups()
    ends: dict[str, Ends] = {}
    place = {scalar.name: k for k, scalar in enumerate(scalars)}
    for name, joint in model.joints.items():
        I, J = lookup.joint_frames(model, name, flexbodies)  # noqa: E741
        if joint.curves:
            _add_on_curve(model, name, (I, J), markers, groups)
            continue
        if model.plane is not None:
            I, J, kept = planar_joint(model, joint, I, J)  # noqa: E741
        else:
            kept = JOINT_ROWS.get(joint.type) or composite_rows(model, name, I, J)
        ends[name] = I, J
        rows = [Entry(*row[:3], _constant(model, name, row, I, J)) for row in kept]
        for thread in couplers.screw_rows(model, name):
            rows.append(_coupled(model, thread, ends, place)[0])
        groups.add(f"joints.{name}", markers, markers.add(I), markers.add(J), rows)

    def add(owner: str, entry: Entry, between: Ends) -> None:
        groups.add(owner, markers, *(markers.add(marker) for marker in between), [entry])

    for name, driver in model.drivers.items():
        row, between = _driven(model, driver.joint, driver.coordinate, ends)
        add(f"drivers.{name}", Entry(*row, fun=functions.add(driver.function.expression)), between)
    for name, force in coordinates.joint_springs(model).items():
        row, between = _driven(model, force.joint, force.coordinate, ends)
        add(f"forces.{name}", Entry(*row, follows=((place[f"forces.{name}"], 1.0),)), between)
    for coupled in couplers.coupled_rows(model, flexbodies):
        add(coupled.owner, *_coupled(model, coupled, ends, place))
    return groups


def _add_on_curve(
    model: Model,
    name: str,
    frames: tuple[PlacedMarker, PlacedMarker],
    markers: Markers,
    groups: Groups,
) -> None:
    group = len(groups.groups)
    made = curve_joint(model, name, frames, markers, groups.sliders, (group, len(groups.rows)))
    if made.reversed:
        groups.reversed.add(group)
    groups.add(f"joints.{name}", markers, made.I, made.J, [Entry(*row) for row in made.rows])


def _driven(
    model: Model, joint: str, coordinate: str, ends: Mapping[str, Ends]
) -> tuple[tuple[int, int, int], Ends]:
    """Kind and axes of the row that measures a coordinate of a joint, and its markers."""
    I, J = ends[joint]  # noqa: E741
    if model.plane is not None and coordinate == "stroke":
        return STROKE, (I, J)
    row = driver_row(model.joints[joint].type, coordinate)
    if coordinate == "second_angle":
        return row, (replace(J, R=J.R @ SECOND_TURN), I)
    return row, (I, J)


def _coupled(
    model: Model, coupled: couplers.CoupledRow, ends: Mapping[str, Ends], place: Mapping[str, int]
) -> tuple[Entry, Ends]:
    """A row that follows scalar coordinates, and its markers."""
    row, between = _driven(model, coupled.joint, coupled.coordinate, ends)
    offset = coupled.offset
    if coupled.relative:
        offset += measured(model, (*row, True), *between)
    follows = tuple((place[name], factor) for name, factor in coupled.follows)
    return Entry(*row, offset, follows=follows), between


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
    for k, (_, _, i, j) in enumerate(groups.groups):
        curved = any(row.entry.kind != POINT for row in groups.in_group(k))
        if curved and i >= 0 and j >= 0:
            pairs.append((i, j))
    return pairs


def check_ends(groups: Groups) -> list[str]:
    """Names of groups whose two markers are on the same body."""
    return [groups.names[row] for row, _, i, j in groups.groups if i == j]


def row_weights(groups: Groups, length: float) -> np.ndarray:
    """(nc,) size of one unit of every row: metres over the model size, radians."""
    return np.array([1.0 if row.entry.kind in ANGULAR else 1.0 / length for row in groups.rows])


def row_table(groups: Groups, sizes: np.ndarray, n_functions: int) -> np.ndarray:
    """ROW rows with the places of their Jacobian rows; `sizes` is 6 + m of each body.

    What a row follows stands behind the functions of time, a slot for each such row.
    """
    table = np.zeros(len(groups.rows), ROW)
    at, slot = 0, n_functions
    for row, n, i, j in groups.groups:
        for r in range(n):
            (kind, a, b, offset, fun, follows), I, J = groups.rows[row + r]  # noqa: E741
            jac = []
            for body in (i, j):
                jac.append(at if body >= 0 else -1)
                at += int(sizes[body]) if body >= 0 else 0
            if follows:
                fun, slot = slot, slot + 1
            table[row + r] = (kind, I, J, a, b, fun, *jac, r, len(follows), offset)
    return table


def follow_table(groups: Groups) -> np.ndarray:
    """FOLLOW rows in the order of the rows; links are filled in later."""
    entries = [
        (k, coordinate, -1, n == 0, factor)
        for k, row in enumerate(groups.rows)
        for n, (coordinate, factor) in enumerate(row.entry.follows)
    ]
    return np.array(entries, FOLLOW)
