"""Compile a model: check it, gather its tables, put its equations in order, name the columns."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import bodies as body_tables
from flexmb.engine.compile.core import core_tables
from flexmb.engine.compile.gather import Gathered, gather
from flexmb.engine.compile.ordering import Ordered, normal_axis, put_in_order
from flexmb.engine.functions.function import PIECEWISE, lower
from flexmb.engine.geometry import body_weights, model_length
from flexmb.engine.joints.constraint_groups import row_table, row_weights
from flexmb.engine.joints.coordinate import unit_weight
from flexmb.engine.joints.curve_marker import Contact
from flexmb.engine.layout import ENERGIES, BodyColumns, Layout
from flexmb.engine.lowering import Element
from flexmb.engine.sensors.feedback import Start
from flexmb.engine.tables import Parts, System
from flexmb.engine.time_events import time_event_table
from flexmb.errors import SceneError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.planar_body import planar_body
from flexmb.model import lookup
from flexmb.model.functions.expression import Expression
from flexmb.model.functions.kinks import kinks_of
from flexmb.model.model import Model
from flexmb.model.plane import normal_in_body, plane_axes

__all__ = ["Compiled", "compile_system", "fingerprint"]


@dataclass(frozen=True)
class Compiled:
    """A system ready to run: tables, names, placed pose, size of the model [m], reduced bodies.

    `functions` are the functions of time as expressions, by the index that the tables use.
    `contacts` are the joints that can only push, cams with their followers.
    """

    system: System
    layout: Layout
    placed: NDArray[np.float64]
    length: float
    flexbodies: Mapping[str, FlexBody]
    functions: tuple[Expression, ...] = ()
    contacts: tuple[Contact, ...] = ()
    starts: tuple[Start, ...] = ()  # of the states
    numbers: tuple[str, ...] = ()  # names of all channels and states by their number
    elements: Mapping[str, Element] = field(default_factory=dict)  # rows of forces by scene path


def compile_system(model: Model, flexbodies: Mapping[str, FlexBody] | None = None) -> Compiled:
    """Compile a model.

    Parameters
    ----------
    model : Model
        The model; validated here, all problems at once.
    flexbodies : mapping of str to FlexBody, optional
        The reduced body of every flexible body that is not given in the model itself.

    Raises
    ------
    SceneError
        Everything that does not fit together.
    """
    known = _known_bodies(model, dict(flexbodies or {}))
    model.validate(known)
    if not model.bodies:
        raise SceneError("the model has no bodies")
    found = gather(model, known)
    length = model_length(model, known, found.ground)
    system = _system(found, put_in_order(found), length)
    curve_points = found.groups.curve_points
    begin = np.append(np.zeros(found.before), curve_points.starts())
    return Compiled(
        system,
        _layout(found, system),
        np.append(body_tables.placed_positions(model, found.bodies), begin),
        length,
        known,
        functions=tuple(found.functions.programs),
        contacts=tuple(curve_points.contacts),
        starts=found.measured.starts,
        numbers=tuple(found.measured.numbers),
        elements=found.lowering.elements,
    )


def _known_bodies(model: Model, known: dict[str, FlexBody]) -> dict[str, FlexBody]:
    """All flexible bodies that are known, in a plane those of their motions in it."""
    for name in model.bodies:
        held = lookup.flexbody_of(model, name, known)
        if held is not None:
            known[name] = held
    if model.plane is None:
        return known
    return {
        name: planar_body(body, normal_in_body(model.bodies[name], model.plane))
        for name, body in known.items()
    }


def _system(of: Gathered, order: Ordered, length: float) -> System:
    model, lowering, measured = of.model, of.lowering, of.measured
    n_functions, signals = len(of.functions.programs), measured.feedback
    scalar_weights = [unit_weight(scalar, length) for scalar in lowering.scalars]
    gravity = np.array(model.gravity or (0.0,) * 3)
    of.markers.frame_together([(row.I, row.J) for row in of.groups.rows])
    markers, pool = of.markers.table(), of.markers.pool.array()
    parts = Parts(of.bodies, pool, markers, gravity, of.coordinates, order.curve_markers)
    rows = row_table(of.groups, 6 + of.bodies["m"], n_functions)
    functions = lower(of.functions.programs, measured.numbers)
    core = core_tables(parts, rows, order.groups, functions, measured.sensors, _plane(model))
    kinds = core | of.kinds
    if signals is not None:
        kinds["feedback"] = signals.feedback
    return System(
        parts=parts,
        rows=rows,
        follows=order.follows,
        groups=order.groups,
        kkt=order.kkt,
        weights=np.append(body_weights(model, of.flexbodies, length), scalar_weights),
        row_weights=row_weights(of.groups, length),
        functions=functions,
        time_events=_time_events(of),
        sensors=measured.sensors,
        implicit_feedback=0 if signals is None else signals.feedback.implicit,
        history=lowering.history if lowering.history > 1 else 0,
        events=lowering.events,
        program_depth=lowering.program_depth,
        kinds=kinds,
    )


def _time_events(of: Gathered) -> np.ndarray:
    """Jumps of functions of time; none with fixed steps, which fall where they fall."""
    spec = of.model.dynamics
    if spec is None or spec.step is not None:
        return np.zeros((0, 2))
    end = spec.duration
    programs = of.functions.programs
    jumps = {t for program in programs for t in kinks_of(program.ops, end)}
    return time_event_table(jumps, end)


def _plane(model: Model) -> tuple[np.ndarray, np.ndarray] | None:
    """Axes of the plane and its normal (3,), and of each body the axis along it; None in space."""
    if model.plane is None:
        return None
    about = [normal_axis(spec, model.plane) for spec in model.bodies.values()]
    return np.array(plane_axes(model.plane), np.int64), np.array(about, np.int64)


def _layout(of: Gathered, system: System) -> Layout:
    columns = zip(of.model.bodies, of.bodies, strict=True)
    return Layout(
        bodies=tuple(
            BodyColumns(name, int(row["iq"]), int(row["iv"]), int(row["m"]))
            for name, row in columns
        ),
        coordinates=tuple(scalar.name for scalar in of.lowering.scalars),
        nq=of.nq + len(of.lowering.scalars),
        nv=of.nv + len(of.lowering.scalars),
        nc=len(of.groups.rows),
        rows=tuple(of.groups.names),
        reactions=tuple(of.groups.owners),
        channels=of.model.channels(),
        energies=ENERGIES,
        fingerprint=fingerprint(system),
    )


def fingerprint(system: System) -> str:
    """Hash of all tables of a system that do not depend on how long it runs."""
    functions = system.functions
    # Some piecewise polynomials are made over the length of the run; all are said by the scene.
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
