"""Compile a model: validate it, build its tables, order its equations and name the columns."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.flexible_body import FLEXIBLE_BODIES
from flexmb.engine.bodies.inertia_coupling import CONSTANT_BODIES, PARTIAL_BODIES
from flexmb.engine.bodies.marker import Markers
from flexmb.engine.bodies.rigid_body import Bodies, PlanarBodies
from flexmb.engine.bodies.static_mode_tables import StaticModes
from flexmb.engine.bodies.static_modes import STATIC_MODES, of_their_parts
from flexmb.engine.function import PIECEWISE, TimeFunctions, lower
from flexmb.engine.geometry import body_weights, extents_of_parts, initial_positions
from flexmb.engine.joints import POINT
from flexmb.engine.joints.constraint import ConstraintRows, Joints
from flexmb.engine.joints.constraint_groups import row_table, row_weights
from flexmb.engine.joints.coordinate import Contact, Coordinates, unit_weight
from flexmb.engine.joints.curve_marker import CurveMarkers
from flexmb.engine.joints.point_joint import PointJoints
from flexmb.engine.lowering import Element
from flexmb.engine.method_selection import NONSTIFF_METHOD
from flexmb.engine.ordering import (
    EquationOrder,
    ModelTables,
    build_tables,
    normal_axis,
    order_equations,
)
from flexmb.engine.sensors import CHANNEL_KINDS
from flexmb.engine.sensors.feedback import Start
from flexmb.engine.sensors.joint_coordinate import JOINT_ANGLE, JointAngles
from flexmb.engine.sensors.marker_motion import TURNING_CHANNEL, TurningAngles
from flexmb.engine.tables import (
    ENERGIES,
    BodyColumns,
    FunctionTable,
    Kkt,
    Layout,
    Parts,
    Sensors,
    System,
)
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.effects import about_point
from flexmb.model import lookup
from flexmb.model.functions.discontinuities import brief_changes, derivative_jumps, switch_times
from flexmb.model.functions.expression import Expression
from flexmb.model.model import Model
from flexmb.model.plane import plane_axes, simulated_body
from flexmb.model.scenes.dynamics import DynamicsSpec
from flexmb.model.scenes.effects import active_model

_NOT_REDUCED = (
    "is flexible, and its reduced body is not there; give it to compile_system by name: "
    "bodies, _, _ = flexmb.workflow.flexible_bodies.flexible_bodies(model, folder) reduces meshes "
    "and reads body files. flexmb.simulate(model) and the other analyses do so themselves"
)


@dataclass(frozen=True)
class Compiled:
    """A system ready to run: tables, names, initial pose, size of the model [m], reduced bodies.

    `flexbodies` are as they are given. `functions` are the functions of time as expressions, by the
    index that the tables use. `contacts` are the joints that can only push: those of cams with
    their followers.
    """

    system: System
    layout: Layout
    initial_q: NDArray[np.float64]
    length: float
    flexbodies: Mapping[str, FlexBody]
    functions: tuple[Expression, ...] = ()
    contacts: tuple[Contact, ...] = ()
    starts: tuple[Start, ...] = ()  # initial values of the states
    numbers: tuple[str, ...] = ()  # names of all channels and states by their number
    elements: Mapping[str, Element] = field(default_factory=dict)  # rows of forces by scene path
    is_damped: bool = False  # whether flexible bodies have the damping of modes of the mechanism

    @cached_property
    def bodies(self) -> Mapping[str, FlexBody]:
        """The reduced bodies about their reference points, as the equations describe them."""
        points = zip(self.layout.bodies, self.layout.references, strict=False)
        moved = {one.name: np.array(point) for one, point in points if any(point)}
        return {
            name: about_point(body, moved[name]) if name in moved else body
            for name, body in self.flexbodies.items()
        }


def compile_system(model: Model, flexbodies: Mapping[str, FlexBody] | None = None) -> Compiled:
    """Compile a model.

    Parameters
    ----------
    model : Model
        The model; validated here, all problems at once.
    flexbodies : mapping of str to FlexBody, optional
        The reduced body of every flexible body that is not given in the model itself, as
        `flexmb.workflow.flexible_bodies.flexible_bodies` makes them.

    Raises
    ------
    SceneError
        The model is inconsistent (all problems at once), or a flexible body is not reduced.
    """
    model.validate(flexbodies)
    model = active_model(model)
    bodies = _flexible_bodies(model, dict(flexbodies or {}))
    if not model.bodies:
        raise SceneError("the model has no bodies")
    tables = build_tables(model, bodies)
    length, system = tables.length, _system(tables, order_equations(tables))
    layout = _layout(tables, system)
    curve_points = tables.lowering.groups.curve_points
    places = np.append(np.zeros(tables.before), [point.start for point in curve_points.points])
    (initial_q,) = layout.of_equations(np.append(initial_positions(model, tables.bodies), places))
    system = of_their_parts(system, length, extents_of_parts(system, initial_q)[0])
    layout = replace(layout, fingerprint=fingerprint(system))
    return Compiled(
        system,
        layout,
        initial_q,
        length,
        bodies,
        functions=tuple(tables.lowering.functions.programs),
        contacts=tuple(curve_points.contacts),
        starts=tables.starts,
        numbers=tuple(tables.numbers),
        elements=tables.lowering.elements,
    )


def _parts_of_model(kkt: Kkt, nv: int) -> NDArray[np.int64]:
    """Number of the part of each velocity coordinate (nv,): parts share no equations.

    A later panel of the factor that is coupled with a panel belongs to the same part.
    """
    part = np.arange(int(kkt.panels["nc"].sum()) + 1)  # the last: coordinates not in the matrix
    for panel in kkt.panels[::-1]:
        own = slice(panel["col"], panel["col"] + panel["nc"])
        part[own] = part[kkt.rows[panel["rows"]]] if panel["nr"] else panel["col"]
    return np.unique(part[kkt.place[:nv]], return_inverse=True)[1].astype(np.int64)


def _flexible_bodies(model: Model, bodies: dict[str, FlexBody]) -> dict[str, FlexBody]:
    """All flexible bodies, as they are simulated; an error if one is not reduced."""
    problems: list[Problem] = []
    for name, spec in model.bodies.items():
        body = lookup.flexbody_of(model, name, bodies)
        if body is not None:
            bodies[name] = simulated_body(model, name, body)
        elif spec.flexible:
            problems.append(Problem(f"bodies.{name}", _NOT_REDUCED))
    if problems:
        raise SceneError.from_problems(problems)
    return bodies


def _system(of: ModelTables, order: EquationOrder) -> System:
    lowering, groups, markers = of.lowering, of.lowering.groups, of.lowering.markers
    model, programs, length = lowering.model, lowering.functions.programs, of.length
    scalar_weights = [unit_weight(scalar, length) for scalar in lowering.scalars]
    gravity = np.array(model.gravity or (0.0,) * 3, dtype=float)
    markers.frame_together([(row.I, row.J) for row in groups.rows])
    parts = Parts(
        of.bodies, markers.pool.array(), markers.table(), gravity, markers.origin, of.coordinates,
        order.curve_markers,
    )  # fmt: skip
    rows = row_table(groups, 6 + of.bodies["m"], len(programs))
    functions = lower(programs, of.numbers)
    core = core_tables(parts, rows, order.groups, functions, of.sensors, _plane(model))
    kinds = core | of.kinds
    if of.feedback is not None:
        kinds["feedback"] = of.feedback.feedback
    weights = np.append(body_weights(model, lowering.flexbodies, length), scalar_weights)
    follows = _follows(kinds, parts, model)
    return System(
        parts=parts,
        rows=rows,
        coupled=order.coupled,
        groups=order.groups,
        kkt=order.kkt,
        weights=weights,
        row_weights=row_weights(groups, length),
        part=_parts_of_model(order.kkt, len(weights)),
        driven=np.zeros(len(weights), np.int64),
        functions=functions,
        time_events=time_event_table(
            programs, model.dynamics, set(rows["fun"].tolist()) if follows else set()
        ),
        sensors=of.sensors,
        implicit_feedback=0 if of.feedback is None else of.feedback.feedback.implicit,
        history=lowering.history if lowering.history > 1 else 0,
        events=lowering.events,
        program_depth=lowering.program_depth,
        kinds=kinds,
    )


def core_tables(
    parts: Parts,
    rows: np.ndarray,
    groups: np.ndarray,
    functions: FunctionTable,
    sensors: Sensors,
    plane: tuple[np.ndarray, np.ndarray] | None = None,
) -> dict[str, Any]:
    """Tables of all kinds other than forces that the model has, by the name of the kind.

    `plane`: for a planar model the axes in the plane and its normal (3,), and for each body its
    axis along the normal (bodies,).
    """
    rigid = parts.bodies["m"] == 0
    flexible = {
        kind.name: np.flatnonzero(~rigid & (parts.bodies["coupling"] == k))
        for k, kind in enumerate((CONSTANT_BODIES, PARTIAL_BODIES, FLEXIBLE_BODIES))
    }
    modal = parts.markers["modes"] >= 0
    point = parts.markers["point"] == 1
    driven = np.flatnonzero((rows["fun"] >= 0) & (rows["coupled"] == 0))
    points = _is_point_joint(parts, rows, groups)
    coincident = rows["kind"] == POINT
    others = coincident & ~np.repeat(points, groups["n"])
    channels = sensors.channels
    angles = np.flatnonzero(channels["what"] == CHANNEL_KINDS.index(JOINT_ANGLE))
    turning = channels["what"] == CHANNEL_KINDS.index(TURNING_CHANNEL)
    turning = np.flatnonzero(turning & (channels["a"] == 0))
    tables = {
        "time_functions": (TimeFunctions(), np.any(functions.live == 0)),
        "coordinates": (Coordinates(), len(parts.coordinates)),
        "rigid_bodies": (Bodies(np.flatnonzero(rigid)), rigid.any() and plane is None),
        **{name: (Bodies(rows), len(rows)) for name, rows in flexible.items()},
        "point_markers": (Markers(np.flatnonzero(point)), point.any()),
        "rigid_markers": (Markers(np.flatnonzero(~modal & ~point)), np.any(~modal & ~point)),
        "flexible_markers": (Markers(np.flatnonzero(modal)), modal.any()),
        "curve_markers": (CurveMarkers(), len(parts.curve_markers)),
        "joints": (Joints(np.flatnonzero(~points), driven), True),
        "constraint_rows": (ConstraintRows(np.flatnonzero(~coincident)), not coincident.all()),
        "point_joints": (
            PointJoints(np.flatnonzero(coincident), np.flatnonzero(others), np.flatnonzero(points)),
            coincident.any(),
        ),
        "joint_angles": (JointAngles(angles), len(angles)),
        "turning_angles": (TurningAngles(turning), len(turning)),
    }
    if plane is not None:
        about = plane[1][rigid]
        tables["planar_bodies"] = PlanarBodies(np.flatnonzero(rigid), about, plane[0]), rigid.any()
    return {name: table for name, (table, present) in tables.items() if present}


def _is_point_joint(parts: Parts, rows: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """(groups,) whether all rows of a group are POINT rows between markers used only as points."""
    if not len(groups):
        return np.zeros(0, bool)
    point = parts.markers["point"] == 1
    plain = (rows["kind"] == POINT) & point[rows["I"]] & point[rows["J"]]
    return np.logical_and.reduceat(plain, groups["row"])


def with_markers(system: System, markers: np.ndarray, pool: np.ndarray) -> System:
    """The same system with another table of markers and their pool."""
    parts = system.parts._replace(markers=markers, pool=pool)
    core = core_tables(parts, system.rows, system.groups, system.functions, system.sensors)
    markers_of = ("point_markers", "rigid_markers", "flexible_markers")
    words = (*markers_of, "joints", "constraint_rows", "point_joints")
    kinds = {name: tables for name, tables in system.kinds.items() if name not in words}
    return system._replace(
        parts=parts, kinds=kinds | {name: core[name] for name in words if name in core}
    )


def _plane(model: Model) -> tuple[np.ndarray, np.ndarray] | None:
    """Axes of the plane and its normal (3,), and each body's axis along it; None in space."""
    if model.plane is None:
        return None
    about = [normal_axis(spec, model.plane) for spec in model.bodies.values()]
    return np.array(plane_axes(model.plane), np.int64), np.array(about, np.int64)


def _layout(of: ModelTables, system: System) -> Layout:
    model, groups, scalars = of.lowering.model, of.lowering.groups, of.lowering.scalars
    columns = zip(model.bodies, of.bodies, strict=True)
    points = np.array(of.lowering.markers.references)
    return Layout(
        bodies=tuple(
            BodyColumns(name, int(row["iq"]), int(row["iv"]), int(row["m"]))
            for name, row in columns
        ),
        coordinates=tuple(scalar.name for scalar in scalars),
        nq=int((7 + of.bodies["m"]).sum()) + len(scalars),
        nv=int((6 + of.bodies["m"]).sum()) + len(scalars),
        nc=len(groups.rows),
        rows=tuple(groups.names),
        reactions=tuple(groups.owners),
        channels=model.channels(),
        energies=ENERGIES,
        fingerprint="",
        origin=tuple(of.lowering.markers.origin.tolist()),
        references=tuple(map(tuple, points.tolist())) if points.any() else (),
    )


# Functions are evaluated by this relative distance before and after a jump: some round-offs of t,
# so that both are certainly on their side of it.
_TIME_ROUND_OFF = 4e-15

# A jump of the third derivative of a function that changes its value by less than this share of its
# range until the next knot is left to the steps, which skip several knots at loose accuracies. So
# is one of a load whose impulse until then is below the accuracy, as of many points that scatter.
_LEAST_CHANGE = 5e-7

# Jumps that are closer than this fraction of the run count as one.
_MIN_TIME_DISTANCE = 1e-10


def _follows(kinds: Mapping[str, Any], parts: Parts, model: Model) -> bool:
    """Whether there are kinetostatic modes, whose rates jump with those of the loads.

    Beside other modes they are so by explicit methods only.
    """
    static: StaticModes | None = kinds.get(STATIC_MODES.name)
    if static is None or model.dynamics is None:
        return False
    alone = bool(static.kinetostatic.all()) and len(static.modes) == parts.bodies["m"].sum()
    return alone or model.dynamics.method == NONSTIFF_METHOD


def time_event_table(
    programs: Sequence[Expression], spec: DynamicsSpec | None, drivers: Set[int] = frozenset()
) -> NDArray[np.float64]:
    """(n, 2) times [s] just before and just after every jump of a function, and in brief changes.

    Of the functions with a number in `drivers`, which kinetostatic modes follow by their second
    derivative, also jumps of the third one, and those at the start. A jump at the end of the run is
    included: the run ends just before it. The table is empty for fixed steps, which do not stop at
    jumps.
    """
    if spec is None or spec.step is not None:
        return np.zeros((0, 2))
    end = spec.duration
    events: list[float] = []
    beyond, jumps = end * (1.0 + 2.0 * _MIN_TIME_DISTANCE), set[float]()
    for k, program in enumerate(programs):
        order, begins = (3, True) if k in drivers else (2, False)
        jumps.update(derivative_jumps(program.ops, beyond, at_begin=begins, derivatives=order))
        jumps.update(switch_times(program.ops, beyond))
        jumps.update(brief_changes(program.ops, end))  # found by samples over the run
    for t in sorted(end if abs(end - t) <= _MIN_TIME_DISTANCE * end else t for t in jumps):
        last = events[-1] if events else 0.0
        if (t == 0.0 or t - last > _MIN_TIME_DISTANCE * end) and t <= end:
            events.append(t)
    return _both_sides(np.array(events), end)


def kinks_of_functions(
    compiled: Compiled, end: float, accuracy: float, *, explicit: bool
) -> NDArray[np.float64]:
    """(n, 2) times [s] just before and just after jumps of the third derivative of functions of
    time, apart from the events of the system. Accelerations have kinks there if they are drivers,
    their second derivatives if they are loads, behind which methods of high order lose it. Those
    at the ends of rises hardly show in the error of a step from rest: they count for implicit
    methods, which pass over knots."""
    times, drivers = set[float](), set(compiled.system.rows["fun"].tolist())
    for k, program in enumerate(compiled.functions):
        least = (_LEAST_CHANGE if k in drivers else accuracy) if explicit else np.inf
        order, load = {"derivatives": 3, "least_change": least}, k not in drivers
        times.update(derivative_jumps(program.ops, end, **order, of_integral=load))
    kinks = np.array(sorted(times))
    edges = np.concatenate([[0.0], compiled.system.time_events[:, 0], [end]])
    after = np.searchsorted(edges, kinks)
    apart = np.minimum(kinks - edges[after - 1], edges[np.minimum(after, len(edges) - 1)] - kinks)
    kinks = kinks[apart > _MIN_TIME_DISTANCE * end]
    return _both_sides(kinks[np.diff(kinks, prepend=0.0) > _MIN_TIME_DISTANCE * end], end)


def _both_sides(times: NDArray[np.float64], end: float) -> NDArray[np.float64]:
    after = np.where(times == 0.0, _TIME_ROUND_OFF * end, times * (1.0 + _TIME_ROUND_OFF))
    return np.column_stack([times * (1.0 - _TIME_ROUND_OFF), after])


def fingerprint(system: System) -> str:
    """Hash of all tables of a system that do not depend on the duration of the run."""
    functions = system.functions
    # Some piecewise polynomials depend on the duration of the run; all follow from the scene.
    places = np.where(functions.ops == PIECEWISE, 0.0, functions.args)
    lasting = system._replace(
        time_events=None,
        functions=functions._replace(args=places, data=None),
        kinds=tuple(part for name in sorted(system.kinds) for part in (name, system.kinds[name])),
    )
    digest = hashlib.sha256()
    for part in _flatten(lasting):
        data = part.encode() if isinstance(part, str) else part
        digest.update(b"none" if data is None else np.ascontiguousarray(data).tobytes())
    return digest.hexdigest()


def _flatten(part: object) -> list[object]:
    if isinstance(part, tuple):
        return [leaf for item in part for leaf in _flatten(item)]
    return [part]
