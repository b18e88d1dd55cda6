"""The groups of constraint rows of a model: joints, drivers, couplers, springs on joints.

Each joint type is a list of primitives between its two triads (`joint_rows`); a driver is more
rows, on the same triads or on markers of its own; what follows a joint coordinate measures it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from flexmb.engine.compile.joints import coordinates, couplers, drivers
from flexmb.engine.compile.joints.curve_joints import Site, curve_joint
from flexmb.engine.compile.joints.groups import Entry, Groups
from flexmb.engine.compile.joints.joint_rows import (
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
from flexmb.engine.row_kinds import DISTANCE, POINT
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.bodies.markers import PlacedMarker
from flexmb.model.model import Model

__all__ = ["joint_groups"]

Ends = tuple[PlacedMarker, PlacedMarker]
"""Markers I and J."""

_ENTRIES = {row: Entry(*row[:3]) for rows in JOINT_ROWS.values() for row in rows if not row[3]}
"""Rows without a constant, which joints share."""


def joint_groups(
    model: Model,
    flexbodies: Mapping[str, FlexBody],
    markers: Markers,
    functions: Functions,
    scalars: list[coordinates.Scalar],
) -> Groups:
    """All joints, all drivers, then what follows joints with coordinates of its own."""
    place = {scalar.name: k for k, scalar in enumerate(scalars)}
    rows = _Rows(model, flexbodies, markers, place)
    for name in model.joints:
        rows.joint(name)
    for name in model.drivers:
        rows.driver(name, functions)
    for name, force in coordinates.followers(model).items():
        coordinate = coordinates.joint_coordinate(model, force)
        rows.follower(f"forces.{name}", force.joint, coordinate)
    for name, line in coordinates.line_forces(model).items():
        rows.line(f"forces.{name}", line.between)
    for coupled in couplers.coupled_rows(model, flexbodies):
        entry, between = rows.coupled(coupled)
        rows.begin(coupled.coordinate)
        rows.add(coupled.owner, between, [entry])
    return rows.groups


@dataclass
class _Rows:
    """Adds the rows of what the model says, one after the other."""

    model: Model
    flexbodies: Mapping[str, FlexBody]
    markers: Markers
    place: Mapping[str, int]  # scalar coordinates by name
    groups: Groups = field(default_factory=Groups)
    ends: dict[str, Ends] = field(default_factory=dict)  # triads of the joints

    def add(self, owner: str, between: Ends, rows: list[Entry], words: Sequence[str] = ()) -> None:
        points = all(row.kind == POINT for row in rows)
        I, J = (self.markers.add(marker, points) for marker in between)  # noqa: E741
        self.groups.add(owner, self.markers, I, J, rows, words)

    def begin(self, coordinate: str) -> None:
        """The next group acts on this coordinate; on a second angle from marker J of the joint."""
        if coordinate == "second_angle":
            self.groups.reversed.add(len(self.groups.groups))

    def joint(self, name: str) -> None:
        model, joint = self.model, self.model.joints[name]
        I, J = lookup.joint_frames(model, name, self.flexbodies)  # noqa: E741
        if joint.curves:
            self._on_curve(name, (I, J))
            return
        if model.plane is not None:
            I, J, kept = planar_joint(model, joint, I, J)  # noqa: E741
        else:
            kept = JOINT_ROWS.get(joint.type) or composite_rows(model, name, I, J)
        self.ends[name] = I, J
        rows = [_ENTRIES.get(row) or _entry(model, name, row, (I, J)) for row in kept]
        rows += [self.coupled(thread)[0] for thread in couplers.screw_rows(model, name)]
        self.add(f"joints.{name}", (I, J), rows)

    def _on_curve(self, name: str, frames: Ends) -> None:
        groups = self.groups
        at = len(groups.groups), len(groups.rows)
        site = Site(self.model, name, frames, self.markers, groups.sliders, *at)
        made = curve_joint(site)
        if made.reversed:
            groups.reversed.add(at[0])
        rows = [Entry(*row) for row in made.rows]
        groups.add(f"joints.{name}", self.markers, made.I, made.J, rows)

    def driver(self, name: str, functions: Functions) -> None:
        driver = self.model.drivers[name]
        if driver.joint is not None:
            row, (I, J) = self._measured(driver.joint, driver.coordinate)  # noqa: E741
            kinds, words = [row], ["driven"]
            self.begin(driver.coordinate)
        else:
            I, J, kinds = drivers.marker_rows(self.model, driver, self.flexbodies)  # noqa: E741
            words = [f"driven {motion.coordinate}" for motion in driver.motions(self.model.plane)]
        programs = drivers.driver_functions(self.model, name, (I, J), kinds)
        pairs = zip(kinds, programs, strict=True)
        rows = [Entry(*kind, fun=functions.add(program)) for kind, program in pairs]
        self.add(f"drivers.{name}", (I, J), rows, words)

    def follower(self, owner: str, joint: str, coordinate: str) -> None:
        """A row by which the scalar coordinate of that name follows a joint coordinate."""
        row, between = self._measured(joint, coordinate)
        self.begin(coordinate)
        self.add(owner, between, [Entry(*row, follows=((self.place[owner], 1.0),))])

    def line(self, owner: str, between: tuple[str, str]) -> None:
        """A row by which the scalar coordinate of that name follows a distance."""
        I, J = (lookup.place_marker(self.model, end, self.flexbodies) for end in between)  # noqa: E741
        self.add(owner, (I, J), [Entry(DISTANCE, 0, 0, follows=((self.place[owner], 1.0),))])

    def coupled(self, coupled: couplers.CoupledRow) -> tuple[Entry, Ends]:
        """A row that follows scalar coordinates, and its markers."""
        row, between = self._measured(coupled.joint, coupled.coordinate)
        offset = coupled.offset
        if coupled.relative:
            offset += measured(self.model, (*row, True), *between)
        follows = tuple((self.place[name], factor) for name, factor in coupled.follows)
        return Entry(*row, offset, follows=follows), between

    def _measured(self, joint: str, coordinate: str) -> tuple[tuple[int, int, int], Ends]:
        """Kind and axes of the row that measures a coordinate of a joint, and its markers."""
        I, J = self.ends[joint]  # noqa: E741
        if self.model.plane is not None and coordinate == "stroke":
            return STROKE, (I, J)
        row = driver_row(self.model.joints[joint].type, coordinate)
        if coordinate == "second_angle":
            return row, (replace(J, R=J.R @ SECOND_TURN), I)
        return row, (I, J)


def _entry(model: Model, name: str, row: Row, between: Ends) -> Entry:
    """A row of a joint with its constant.

    Raises
    ------
    SceneError
        A link without length.
    """
    length = model.joints[name].length
    if row[0] == DISTANCE and length is not None:
        return Entry(*row[:3], length)
    try:
        return Entry(*row[:3], measured(model, row, *between))
    except ZeroDivisionError:
        what = "the link has no length in the placed pose, so its direction is not known"
        cure = "place the markers apart, or use a joint that holds them together"
        raise SceneError.from_problems([Problem(f"joints.{name}", f"{what}; {cure}")]) from None
