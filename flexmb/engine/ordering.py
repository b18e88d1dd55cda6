"""The tables of a model, and the elimination order of its equations, block by block."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.flexible_body import modal_block, put_flags
from flexmb.engine.bodies.marker import MarkerTable
from flexmb.engine.bodies.membrane_forces import membrane_block, tabulate_membrane_forces
from flexmb.engine.bodies.rigid_body import second_moments
from flexmb.engine.bodies.static_mode_tables import StaticModes, tabulate_static_modes
from flexmb.engine.geometry import Geometry, coordinate_origin, model_length, reference_points
from flexmb.engine.joints.constraint_groups import (
    Groups,
    coupled_bodies,
    coupled_coordinate_table,
    groups_within_bodies,
    joint_groups,
    scalar_coordinates,
)
from flexmb.engine.joints.coordinate import coordinate_table
from flexmb.engine.joints.joint import measured_coordinate
from flexmb.engine.kind_registry import KINDS
from flexmb.engine.lowering import Lowering, Placement
from flexmb.engine.sensors import CHANNEL_KINDS, SENSOR_KINDS, feedback
from flexmb.engine.sensors.sensor import WRENCH, Channels, sensor_tables
from flexmb.engine.symbolic import Blocks, Symbolic, analyse
from flexmb.engine.tables import BODY, GROUP, Functions, Kkt, Pool, Sensors, deformation_room
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.effects import about_point, without_modal_inertia
from flexmb.model.body import BodySpec, RigidBodySpec
from flexmb.model.control import channel_program, resolved, states_of
from flexmb.model.excitation import cutoff_frequency
from flexmb.model.flexible_body import COUPLINGS, FlexibleBodySpec, stretches
from flexmb.model.model import Model
from flexmb.model.plane import normal_in_body, plane_axes

Table = NDArray[np.void]


@dataclass(frozen=True)
class ModelTables:
    """All tables of a model; places in the factor are filled in later.

    The scalar coordinates of curve markers are the last ones, from number `before` on. `kinds` are
    the tables of the kinds that the model has, by name. `ground` (n, 3) are the points of the
    ground to which joints and forces are attached. `numbers` are the numbers of channels and states
    by name.
    """

    lowering: Lowering
    bodies: Table
    before: int
    coordinates: Table
    kinds: dict[str, Any]
    length: float
    sensors: Sensors
    numbers: Mapping[str, int]
    starts: tuple[feedback.Start, ...]  # initial values of the states
    feedback: feedback.FeedbackTables | None  # functions of measured channels that act


def build_tables(model: Model, flexbodies: Mapping[str, FlexBody]) -> ModelTables:
    """All tables of a validated model.

    Raises
    ------
    SceneError
        A joint or driver between two markers of one body, or a fault that only geometry shows.
    """
    functions = Functions(lambda expression: resolved(model, expression))
    references = reference_points(model, flexbodies)
    markers = MarkerTable(list(model.bodies), Pool(), references=references)
    bodies = body_table(model, flexbodies, markers.pool, references)
    states = states_of(model)
    scalars = scalar_coordinates(model, functions, states)
    groups = joint_groups(model, flexbodies, markers, functions, scalars)
    if names := groups_within_bodies(groups):
        raise SceneError.from_problems(
            [Problem(name.split(":")[0], "connects a body with itself") for name in names]
        )
    before = len(scalars)
    scalars = scalars + groups.curve_points.scalars()
    nq, nv = int((7 + bodies["m"]).sum()), int((6 + bodies["m"]).sum())
    table = coordinate_table(scalars, nq, nv)
    lowering = Lowering(Geometry(model, flexbodies), markers, functions, groups, scalars)
    kinds = {kind.name: lowering.lower(kind) for kind in KINDS if kind.lower is not None}
    kinds["static_modes"] = _static_modes(model, flexbodies, lowering)
    kinds["membrane_forces"] = tabulate_membrane_forces(bodies)
    kinds = {name: tables for name, tables in kinds.items() if tables is not None}
    length = model_length(model, flexbodies, markers.on_ground(), references)
    markers.origin = coordinate_origin(model, length, references)
    ivs = {s.name: nv + before - len(states) + k for k, s in enumerate(states)}
    starts = tuple(feedback.starts(states, ivs, functions))
    reading = [k.name for k in KINDS if "wrenches" in k.units and (k.name in kinds or k.core)]
    channels = Channels(
        lowering,
        SENSOR_KINDS,
        reading,
        (nq + before, nv + before),
        lambda spec: measured_coordinate(lowering.geometry, spec),
        lambda name: channel_program(model, name),
    )
    sensors, numbers = sensor_tables(channels, ivs)
    acting = [k.name for k in KINDS if "unit_force" in k.units and k.name in kinds]
    signals = feedback.feedback_tables(lowering, acting, numbers, sensors, table)
    if signals is not None:
        _frame_reactions(lowering, sensors, signals.feedback, reading.index("joints"))
    return ModelTables(
        lowering, bodies, before, table, kinds, length, sensors, numbers, starts, signals
    )


def body_table(
    model: Model, flexbodies: Mapping[str, FlexBody], pool: Pool, references: NDArray[np.float64]
) -> NDArray[np.void]:
    """BODY rows in the order of the model, about points (n, 3); panels are filled in later."""
    table = np.zeros(len(model.bodies), BODY)
    flexible = {k: flexbodies[name] for k, name in enumerate(model.bodies) if name in flexbodies}
    rigid = [k for k in range(len(table)) if k not in flexible]
    specs = [*model.bodies.values()]
    table["mass"][rigid], table["S1"][rigid], table["S0"][rigid] = second_moments(
        [spec for spec in specs if isinstance(spec, RigidBodySpec)], references[rigid]
    )
    for k, own in flexible.items():
        row, spec = table[k], specs[k]
        body = about_point(own, references[k]) if references[k].any() else own
        row["m"], row["mass"], row["S1"], row["S0"] = body.m, body.mass, body.S1, body.S0
        coupling = spec.inertia_coupling if isinstance(spec, FlexibleBodySpec) else "full"
        row["coupling"] = COUPLINGS.index(coupling)
        static = quasi_static(spec, body, model)
        Mab = without_modal_inertia(body, static) if static else None
        row["flex"] = pool.add(modal_block(body, coupling, Mab))
        membrane = body.membrane_stiffness if stretches(spec) else None
        if membrane is not None:
            row["shapes"], row["membrane"] = (
                len(membrane.shapes),
                pool.add(membrane_block(membrane)),
            )
        put_flags(row, body, bool(static))
    for name, n in (("iq", 7 + table["m"]), ("iv", 6 + table["m"]), ("z", deformation_room(table))):
        table[name] = np.cumsum(n) - n
    return table


def quasi_static(spec: BodySpec, body: FlexBody, model: Model) -> tuple[int, ...]:
    """Numbers of the quasi-static modes of a body."""
    if not isinstance(spec, FlexibleBodySpec) or body.m == 0:
        return ()
    automatic = spec.deformation == "automatic"
    return spec.static_modes(body, cutoff_frequency(model) if automatic else math.inf)


def _static_modes(
    model: Model, flexbodies: Mapping[str, FlexBody], lowering: Lowering
) -> StaticModes | None:
    """Tables of the quasi-static modes of all bodies."""
    rows = [
        (number, flexbodies[name], np.array(modes), spec.deformation == "quasi-static")
        for number, (name, spec) in enumerate(model.bodies.items())
        if isinstance(spec, FlexibleBodySpec) and name in flexbodies
        if (modes := quasi_static(spec, flexbodies[name], model))
    ]
    return tabulate_static_modes(rows, lowering.add_history) if rows else None


def _frame_reactions(
    lowering: Lowering, sensors: Sensors, acting: feedback.Feedback, joints: int
) -> None:
    """Mark the markers of joints whose reactions are fed back as markers with axes.

    Such reactions are read in the axes of the joint during the motion.
    """
    for channel in sensors.channels[acting.channels]:
        if CHANNEL_KINDS[channel["what"]] is WRENCH and channel["kind"] == joints:
            for row in lowering.groups.in_group(int(channel["first"])):
                lowering.markers.framed |= {row.I, row.J}


@dataclass(frozen=True)
class EquationOrder:
    """The symbolic factorisation, and the tables that depend on it."""

    kkt: Kkt
    groups: NDArray[np.void]
    coupled: NDArray[np.void]
    curve_markers: NDArray[np.void]


def order_equations(of: ModelTables) -> EquationOrder:
    """Order the equations, and fill in the places of blocks in all tables."""
    symbolic = analyse(_blocks(of))
    groups, coupled = _place_groups(of, symbolic), coupled_coordinate_table(of.lowering.groups)
    _place_coordinates(coupled, groups, of.coordinates, symbolic)
    _place_kinds(of, symbolic)
    curve_points = of.lowering.groups.curve_points
    event = of.lowering.add_events(curve_points.events)
    curve_markers = curve_points.table(
        of.lowering.groups.groups, symbolic, len(of.bodies), of.before, event
    )
    return EquationOrder(symbolic.kkt, groups, coupled, curve_markers)


def normal_axis(spec: BodySpec, plane: str) -> int:
    """The axis of a body that points along the normal of the plane, or against it."""
    return int(np.argmax(np.abs(normal_in_body(spec, plane))))


def planar_columns(spec: BodySpec, plane: str, m: int) -> list[int]:
    """Column in its panel of each velocity coordinate of a body with m modes.

    Modes come first; coordinates out of the plane have −1.
    """
    first, second, _ = plane_axes(plane)
    about = normal_axis(spec, plane)
    columns = [-1] * 6
    for k, coordinate in enumerate((first, second, 3 + about)):
        columns[coordinate] = m + k
    return [*columns, *range(m)]


def _body_columns(model: Model, table: NDArray[np.void]) -> list[list[int]]:
    """Columns of the bodies in their panels, modes first; −1 out of the plane of a planar model."""
    numbers = [int(m) for m in table["m"]]
    if model.plane is None:
        return [[*range(m, m + 6), *range(m)] for m in numbers]
    plane, specs = model.plane, model.bodies.values()
    return [planar_columns(spec, plane, m) for spec, m in zip(specs, numbers, strict=True)]


def _coupled_rows(of: ModelTables) -> list[tuple[Any, str, int, int]]:
    """Every table row that couples two bodies: the row, the field for its LINK, both markers."""
    return [
        (row, field, int(row[i]), int(row[j]))
        for kind in KINDS
        if kind.name in of.kinds
        for field, i, j in kind.couples
        for row in of.kinds[kind.name].rows
        if row[i] >= 0 and row[j] >= 0
    ]


def _blocks(of: ModelTables) -> Blocks:
    groups, bodies, markers = (
        of.lowering.groups,
        _body_columns(of.lowering.model, of.bodies),
        of.lowering.markers,
    )
    pairs = coupled_bodies(groups)
    pairs += [(markers.body(i), markers.body(j)) for _, _, i, j in _coupled_rows(of)]
    coupled = [
        {c for row in groups.in_group(k) for c, _ in row.coupled} for k in range(len(groups.groups))
    ]
    for group, coordinate in of.lowering.reaction_loads:
        coupled[group].add(coordinate)
    curve_points, first = groups.curve_points, len(bodies) + of.before
    pairs += curve_points.couples(groups.groups, first)
    pairs += [] if of.feedback is None else of.feedback.couples
    return Blocks(
        columns=bodies + [[0]] * len(of.lowering.scalars),
        group_rows=[n for _, n, _, _ in groups.groups],
        group_bodies=[(i, j) for _, _, i, j in groups.groups],
        group_coordinates=[tuple(len(bodies) + c for c in sorted(row)) for row in coupled],
        couples=[(i, j) for i, j in pairs if i != j],
        group_curve_coordinates=_group_curve_points(groups, first),
    )


def _group_curve_points(groups: Groups, first: int) -> list[tuple[int, ...]]:
    """Blocks of the curve markers of each group; `first`: block of the first curve marker."""
    blocks: list[tuple[int, ...]] = [()] * len(groups.groups)
    for k, point in enumerate(groups.curve_points.points):
        blocks[point.group] += (first + k,)
    return blocks


def _place_groups(of: ModelTables, symbolic: Symbolic) -> NDArray[np.void]:
    """GROUP rows; also fills in the panels of the bodies."""
    groups = of.lowering.groups
    of.bodies["panel"] = symbolic.panel_of[: len(of.bodies)]
    first = len(symbolic.panel_of) - len(groups.groups)
    rows = []
    for k, (row, count, i, j) in enumerate(groups.groups):
        couple = symbolic.couple_links.get((i, j), -1)
        panel = symbolic.panel_of[first + k]
        turned = k in groups.reversed
        rows.append((row, count, i, j, panel, *symbolic.group_links[k], couple, turned))
    return np.array(rows, GROUP)


def _place_coordinates(coupled, groups, scalars, symbolic: Symbolic) -> None:
    """Fill in the panels of scalar coordinates and the links of the rows that follow them."""
    n_bodies = len(symbolic.panel_of) - len(groups) - len(scalars)
    scalars["panel"] = symbolic.panel_of[n_bodies : n_bodies + len(scalars)]
    group_of = np.repeat(np.arange(len(groups)), groups["n"])
    for entry in coupled:
        pair = int(group_of[entry["row"]]), n_bodies + int(entry["coordinate"])
        entry["link"] = symbolic.coordinate_links[pair]


def _place_kinds(of: ModelTables, symbolic: Symbolic) -> None:
    """Fill in the links of all kinds and of feedback."""
    placement = Placement(symbolic, of.lowering.markers, len(of.bodies))
    for row, field, i, j in _coupled_rows(of):
        row[field] = placement.link(i, j)
    for kind in KINDS:
        if kind.place is not None and kind.name in of.kinds:
            kind.place(of.kinds[kind.name], placement)
    if of.feedback is not None:
        of.feedback.place(symbolic)
