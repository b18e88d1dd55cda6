"""The groups of constraint rows of a model: joints, drivers, couplers, forces on joints.

A joint is a list of elementary rows between its two triads (`joints.joint`). A driver adds rows on
the same triads, or on markers of its own.

Some elements have scalar coordinates (`joints.coordinate`), which a row keeps equal to a measured
quantity. A force on a joint has a massless coordinate equal to the angle or stroke of the joint: so
the angle counts turns, and spring and damper are linear in the coordinate. A force along a line has
one equal to the distance. Couplers have those that make their joints move together. Each state has
one of mass one, whose velocity is the state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from flexmb.engine.bodies.marker import MarkerTable
from flexmb.engine.joints import DISTANCE, POINT, ROW_KINDS
from flexmb.engine.joints.coordinate import (
    CoupledRow,
    CurvePoints,
    Scalar,
    coupled_rows,
    coupled_scalars,
    screw_rows,
)
from flexmb.engine.joints.curve import JointContext, curve_joint
from flexmb.engine.joints.joint import (
    JOINT_ROWS,
    SECOND_TURN,
    STROKE,
    Ends,
    Row,
    composite_rows,
    driver_functions,
    driver_row,
    marker_rows,
    planar_joint,
    row_constant,
)
from flexmb.engine.tables import COUPLED_COORDINATE, ROW, Functions
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.control import State
from flexmb.model.forces.force_characteristic import JointStopSpec
from flexmb.model.forces.friction import JointFrictionSpec, friction_coordinate
from flexmb.model.forces.load import LineForceSpec
from flexmb.model.forces.spring_damper import JointSpringSpec
from flexmb.model.model import Model


class Entry(NamedTuple):
    """One row between markers I and J, as `tables.ROW` says."""

    kind: int
    a: int
    b: int
    offset: float = 0.0
    fun: int = -1
    coupled: tuple[tuple[int, float], ...] = ()  # scalar coordinates and their factors
    I: int = -1  # noqa: E741
    J: int = -1


def _row_label(row: Entry) -> str:
    """What a row constrains, in words."""
    if row.fun >= 0:
        return "driven"
    if row.coupled:
        return "coordinate"
    return ROW_KINDS[row.kind].word.format(a="xyz"[row.a], b="xyz"[row.b])


@dataclass
class Groups:
    """The constraint rows of a model, group by group."""

    rows: list[Entry] = field(default_factory=list)
    # first row, number of rows, bodies of I and J (-1: ground)
    groups: list[tuple[int, int, int, int]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)  # of the rows
    owners: list[str] = field(default_factory=list)  # scene path of each group
    numbers: dict[str, int] = field(default_factory=dict)  # first group of a scene path
    reversed: set[int] = field(default_factory=set)  # groups whose I is the joint's J
    curve_points: CurvePoints = field(default_factory=CurvePoints)

    def add(
        self,
        name: str,
        markers: MarkerTable,
        I: int,  # noqa: E741
        J: int,
        rows: list[Entry],
        words: Sequence[str] = (),
    ) -> None:
        """Append a group of rows between I and J; `words` label them, else `_row_label` does."""
        self.numbers.setdefault(name, len(self.groups))
        self.groups.append((len(self.rows), len(rows), markers.body(I), markers.body(J)))
        self.owners.append(name)
        self.rows += [row._replace(I=I, J=J) for row in rows]
        self.names += [f"{name}: {what}" for what in words or map(_row_label, rows)]

    def in_group(self, k: int) -> list[Entry]:
        """The rows of a group."""
        row, n, _, _ = self.groups[k]
        return self.rows[row : row + n]


def coupled_bodies(groups: Groups) -> list[tuple[int, int]]:
    """Pairs of bodies whose tangents a group couples: all but mere coincidence."""
    pairs = []
    for k, (_, _, i, j) in enumerate(groups.groups):
        curved = any(ROW_KINDS[row.kind].tangent for row in groups.in_group(k))
        if curved and i >= 0 and j >= 0:
            pairs.append((i, j))
    return pairs


def groups_within_bodies(groups: Groups) -> list[str]:
    """Names of groups whose two markers are on the same body."""
    return [groups.names[row] for row, _, i, j in groups.groups if i == j]


def row_weights(groups: Groups, length: float) -> np.ndarray:
    """(nc,) weights that make the rows dimensionless: 1 per radian, 1/`length` per metre."""
    angular = [ROW_KINDS[row.kind].angular for row in groups.rows]
    return np.where(np.array(angular, bool), 1.0, 1.0 / length)


def row_table(groups: Groups, sizes: np.ndarray, n_functions: int) -> np.ndarray:
    """ROW rows with the places of their Jacobian rows; `sizes`: 6 + m of each body.

    A row that follows scalar coordinates has a slot for their sum, after those of the functions of
    time.
    """
    entries = []
    size = sizes.tolist()
    at, slot = 0, n_functions
    for row, n, i, j in groups.groups:
        for r in range(n):
            kind, a, b, offset, fun, coupled, I, J = groups.rows[row + r]  # noqa: E741
            jac = []
            for body in (i, j):
                jac.append(at if body >= 0 else -1)
                at += size[body] if body >= 0 else 0
            if coupled:
                fun, slot = slot, slot + 1
            entries.append((kind, I, J, a, b, fun, *jac, r, len(coupled), offset))
    return np.array(entries, ROW)


def coupled_coordinate_table(groups: Groups) -> np.ndarray:
    """COUPLED_COORDINATE rows in the order of the rows; links are filled in later."""
    entries = [
        (k, coordinate, -1, n == 0, factor)
        for k, row in enumerate(groups.rows)
        for n, (coordinate, factor) in enumerate(row.coupled)
    ]
    return np.array(entries, COUPLED_COORDINATE)


ForceOnJoint = JointSpringSpec | JointStopSpec | JointFrictionSpec
"""Forces on a coordinate of a joint."""


def forces_on_joints(model: Model) -> dict[str, ForceOnJoint]:
    """Forces on joint coordinates by name, in the order of their scalar coordinates."""
    kinds = (JointSpringSpec, JointStopSpec, JointFrictionSpec)
    forces = model.forces.items()
    return {name: spec for kind in kinds for name, spec in forces if isinstance(spec, kind)}


def joint_coordinate(model: Model, spec: ForceOnJoint) -> str:
    """The coordinate of its joint that a force acts on."""
    if isinstance(spec, JointFrictionSpec):
        return friction_coordinate(model, spec)
    return spec.coordinate


def line_forces(model: Model) -> dict[str, LineForceSpec]:
    """The forces along lines, by name."""
    return {n: spec for n, spec in model.forces.items() if isinstance(spec, LineForceSpec)}


def scalar_coordinates(
    model: Model, functions: Functions, states: tuple[State, ...]
) -> list[Scalar]:
    """The scalar coordinates of a model: of forces on joints, line forces, couplers, states.

    They carry linear springs, dampers and actuators. Nonlinear characteristics, stops and friction
    on joints are elements of their own, which act on these coordinates.
    """
    joints = [
        _scalar_of_force(model, name, spec, functions)
        for name, spec in forces_on_joints(model).items()
    ]
    lines = [
        Scalar(f"forces.{name}", function=functions.add(spec.value.expression), angular=False)
        for name, spec in line_forces(model).items()
    ]
    coupled = [Scalar(name, angular=angular) for name, angular in coupled_scalars(model)]
    own = [
        Scalar(f"states.{s.name}", 1.0, function=functions.put(s.rate), size=s.scale)
        for s in states
    ]
    return [*joints, *lines, *coupled, *own]


def _scalar_of_force(model: Model, name: str, spec: ForceOnJoint, functions: Functions) -> Scalar:
    angular = joint_coordinate(model, spec) != "stroke"
    if isinstance(spec, JointFrictionSpec | JointStopSpec):
        return Scalar(f"forces.{name}", angular=angular)
    return Scalar(
        f"forces.{name}",
        damping=spec.damping,
        stiffness=spec.stiffness,
        free=spec.free,
        function=-1 if spec.value is None else functions.add(spec.value.expression),
        angular=angular,
    )


_ENTRIES = {row: Entry(*row[:3]) for rows in JOINT_ROWS.values() for row in rows if not row[3]}
"""Entries of rows without a measured constant, which joints share."""


def joint_groups(
    model: Model,
    flexbodies: Mapping[str, FlexBody],
    markers: MarkerTable,
    functions: Functions,
    scalars: list[Scalar],
) -> Groups:
    """Groups of all joints, all drivers, then of elements with scalar coordinates of their own."""
    place = {scalar.name: k for k, scalar in enumerate(scalars)}
    rows = _GroupBuilder(model, flexbodies, markers, place)
    for name in model.joints:
        rows.add_joint(name)
    for name in model.drivers:
        rows.add_driver(name, functions)
    for name, force in forces_on_joints(model).items():
        coordinate = joint_coordinate(model, force)
        rows.add_force_on_joint(f"forces.{name}", force.joint, coordinate)
    for name, line in line_forces(model).items():
        rows.add_line_force(f"forces.{name}", line.between)
    for coupled in coupled_rows(model, flexbodies):
        entry, between = rows.coupled_entry(coupled)
        rows.mark_side(coupled.coordinate)
        rows.add(coupled.owner, between, [entry])
    return rows.groups


@dataclass
class _GroupBuilder:
    """Adds the groups of a model, one after the other."""

    model: Model
    flexbodies: Mapping[str, FlexBody]
    markers: MarkerTable
    place: Mapping[str, int]  # scalar coordinates by name
    groups: Groups = field(default_factory=Groups)
    ends: dict[str, Ends] = field(default_factory=dict)  # triads of the joints

    def add(self, owner: str, between: Ends, rows: list[Entry], words: Sequence[str] = ()) -> None:
        points = all(row.kind == POINT for row in rows)
        I, J = (self.markers.add(marker, points) for marker in between)  # noqa: E741
        self.groups.add(owner, self.markers, I, J, rows, words)

    def mark_side(self, coordinate: str) -> None:
        """Mark the next group as reversed if it acts on a second angle, which is seen from J."""
        if coordinate == "second_angle":
            self.groups.reversed.add(len(self.groups.groups))

    def add_joint(self, name: str) -> None:
        model, joint = self.model, self.model.joints[name]
        I, J = lookup.joint_frames(model, name, self.flexbodies)  # noqa: E741
        if joint.curves:
            self._add_curve_joint(name, (I, J))
            return
        if model.plane is not None:
            I, J, types = planar_joint(model, joint, I, J)  # noqa: E741
        else:
            types = JOINT_ROWS.get(joint.type) or composite_rows(model, name, I, J)
        self.ends[name] = I, J
        rows = [_ENTRIES.get(row) or _entry(model, name, row, (I, J)) for row in types]
        rows += [self.coupled_entry(thread)[0] for thread in screw_rows(model, name)]
        self.add(f"joints.{name}", (I, J), rows)

    def _add_curve_joint(self, name: str, frames: Ends) -> None:
        groups = self.groups
        at = len(groups.groups), len(groups.rows)
        context = JointContext(self.model, name, frames, self.markers, groups.curve_points, *at)
        joint = curve_joint(context)
        if joint.reversed:
            groups.reversed.add(at[0])
        rows = [Entry(*row) for row in joint.rows]
        groups.add(f"joints.{name}", self.markers, joint.I, joint.J, rows)

    def add_driver(self, name: str, functions: Functions) -> None:
        driver = self.model.drivers[name]
        if driver.joint is not None:
            row, (I, J) = self._measuring_row(driver.joint, driver.coordinate)  # noqa: E741
            kinds, words = [row], ["driven"]
            self.mark_side(driver.coordinate)
        else:
            I, J, kinds = marker_rows(self.model, driver, self.flexbodies)  # noqa: E741
            words = [f"driven {motion.coordinate}" for motion in driver.motions(self.model.plane)]
        programs = driver_functions(self.model, name, (I, J), kinds)
        pairs = zip(kinds, programs, strict=True)
        rows = [Entry(*kind, fun=functions.add(program)) for kind, program in pairs]
        self.add(f"drivers.{name}", (I, J), rows, words)

    def add_force_on_joint(self, owner: str, joint: str, coordinate: str) -> None:
        """Add a row that keeps the scalar coordinate of this name equal to a joint coordinate."""
        row, between = self._measuring_row(joint, coordinate)
        self.mark_side(coordinate)
        self.add(owner, between, [Entry(*row, coupled=((self.place[owner], 1.0),))])

    def add_line_force(self, owner: str, between: tuple[str, str]) -> None:
        """Add a row that keeps the scalar coordinate of this name equal to a distance."""
        I, J = (lookup.place_marker(self.model, end, self.flexbodies) for end in between)  # noqa: E741
        self.add(owner, (I, J), [Entry(DISTANCE, 0, 0, coupled=((self.place[owner], 1.0),))])

    def coupled_entry(self, coupled: CoupledRow) -> tuple[Entry, Ends]:
        """The row: joint coordinate = offset + Σ factor · scalar coordinate; and its markers."""
        row, between = self._measuring_row(coupled.joint, coupled.coordinate)
        offset = coupled.offset
        if coupled.relative:
            offset += row_constant(self.model, (*row, True), *between)
        factors = tuple((self.place[name], factor) for name, factor in coupled.factors)
        return Entry(*row, offset, coupled=factors), between

    def _measuring_row(self, joint: str, coordinate: str) -> tuple[tuple[int, int, int], Ends]:
        """Kind and axes of the row that measures a joint coordinate, and its markers."""
        I, J = self.ends[joint]  # noqa: E741
        if self.model.plane is not None and coordinate == "stroke":
            return STROKE, (I, J)
        row = driver_row(self.model.joints[joint].type, coordinate)
        if coordinate == "second_angle":
            return row, (replace(J, R=J.R @ SECOND_TURN), I)
        return row, (I, J)


def _entry(model: Model, name: str, row: Row, between: Ends) -> Entry:
    """A row of a joint with its constant from the initial pose.

    Raises
    ------
    SceneError
        The row is a link of zero length.
    """
    length = model.joints[name].length
    if row[0] == DISTANCE and length is not None:
        return Entry(*row[:3], length)
    try:
        return Entry(*row[:3], row_constant(model, row, *between))
    except ZeroDivisionError:
        what = "the link has no length in the initial pose, so its direction is undefined"
        cure = "place the markers apart, or use a joint that holds them together"
        raise SceneError.from_problems([Problem(f"joints.{name}", f"{what}; {cure}")]) from None
