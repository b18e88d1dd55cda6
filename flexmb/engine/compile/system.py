"""Compile a model: check it, build all tables, order the KKT matrix, name the columns."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import bodies as body_tables
from flexmb.engine.compile.forces import basic as elements
from flexmb.engine.compile.forces import contacts
from flexmb.engine.compile.forces import elements as force_elements
from flexmb.engine.compile.joints import coordinates
from flexmb.engine.compile.joints import joint as joints
from flexmb.engine.compile.joints.curves import Contact
from flexmb.engine.compile.joints.groups import (
    Groups,
    check_ends,
    couples,
    follow_table,
    row_table,
    row_weights,
)
from flexmb.engine.compile.kinks import kink_table
from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.planar import planar_columns
from flexmb.engine.compile.pool import Functions, Pool
from flexmb.engine.compile.sensors import sensor as sensors
from flexmb.engine.compile.sensors import signals
from flexmb.engine.functions import lower
from flexmb.engine.kernels.functions.function import PIECEWISE
from flexmb.engine.layout import ENERGIES, BodyColumns, Layout
from flexmb.engine.symbolic import Blocks, Symbolic, analyse
from flexmb.engine.tables import GROUP, LINES, Parts, System
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.planar import planar_body
from flexmb.model import lookup
from flexmb.model.functions.expression import Expression
from flexmb.model.model import Model
from flexmb.model.plane import normal_in_body
from flexmb.model.sensors.signals import resolved, states_of


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
    starts: tuple[signals.Start, ...] = ()  # of the states
    numbers: tuple[str, ...] = ()  # names of all channels and states by their number


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
    known = dict(flexbodies or {})
    for name in model.bodies:
        held = lookup.flexbody_of(model, name, known)
        if held is not None:
            known[name] = held
    if model.plane is not None:
        known = {
            name: planar_body(body, normal_in_body(model.bodies[name], model.plane))
            for name, body in known.items()
        }
    model.validate(known)
    if not model.bodies:
        raise SceneError("the model has no bodies")
    pool, functions = Pool(), Functions(lambda expression: resolved(model, expression))
    markers = Markers(list(model.bodies), pool)
    table = body_tables.body_table(model, known, pool)
    states = states_of(model)
    scalars = coordinates.scalars(model, functions, states)
    groups = joints.joint_groups(model, known, markers, functions, scalars)
    before, sliders = len(scalars), groups.sliders
    scalars += sliders.scalars()
    _refuse_loops(groups)
    springs = elements.spring_table(model, known, markers)
    touching = contacts.contact_table(model, known, markers)
    kept = 1 + sum(contacts.memory_of(row) for row in _rows(touching))
    frictions = contacts.joint_friction_table(model, groups, kept)
    loads = elements.load_table(model, known, markers, functions)
    held = force_elements.element_tables(
        model, known, markers, functions, [scalar.name for scalar in scalars]
    )
    length, sizes = _length(model, known), 6 + table["m"]
    nq, nv = int((7 + table["m"]).sum()), int(sizes.sum())
    ivs = {s.name: nv + before - len(states) + k for k, s in enumerate(states)}
    starts = signals.starts(states, ivs, functions)
    sensor_tables, numbers = sensors.sensor_tables(
        model, known, markers, groups, ivs, (nq + before, nv + before)
    )
    n_functions = len(functions.programs)
    scalar_table = coordinates.coordinate_table(scalars, nq, nv)
    rows, follows = row_table(groups, sizes, n_functions), follow_table(groups)
    columns = _columns(model, table)
    acting = signals.signal_tables(
        functions, numbers, sensor_tables, loads, scalar_table, markers, held
    )
    blocks = _blocks(columns, groups, before, (springs, touching), markers, frictions)
    blocks.couples.extend(force_elements.couples(held, markers))
    if acting is not None:
        blocks.couples.extend(acting.couples)
    symbolic = analyse(blocks)
    if acting is not None:
        acting.place(symbolic)
    group_table = _place(table, groups, (springs, touching), markers, symbolic)
    _place_coordinates(follows, frictions, group_table, scalar_table, symbolic)
    force_elements.place(held, markers, symbolic.couple_links)
    gravity = np.array(model.gravity or (0.0,) * 3)
    system = System(
        parts=Parts(
            table,
            pool.array(),
            markers.table(),
            gravity,
            scalar_table,
            sliders.table(groups.groups, len(table), symbolic, before),
        ),
        rows=rows,
        follows=follows,
        groups=group_table,
        kkt=symbolic.kkt,
        weights=np.append(
            _weights(model, known, length), [coordinates.unit_weight(s, length) for s in scalars]
        ),
        row_weights=row_weights(groups, length),
        lines=np.zeros(1) if any(row.entry.kind in LINES for row in groups.rows) else None,
        functions=lower(functions.programs, numbers),
        springs=springs,
        loads=loads,
        kinks=kink_table(functions.programs, model.dynamics),
        sensors=sensor_tables,
        further=None if acting is None and sensors.is_basic(sensor_tables) else np.zeros(1),
        signals=None if acting is None else acting.signals,
        contacts=touching,
        frictions=frictions,
        elements=held,
    )
    layout = Layout(
        bodies=tuple(
            BodyColumns(name, int(row["iq"]), int(row["iv"]), int(row["m"]))
            for name, row in zip(model.bodies, table, strict=True)
        ),
        coordinates=tuple(scalar.name for scalar in scalars),
        nq=nq + len(scalars),
        nv=nv + len(scalars),
        nc=len(groups.rows),
        rows=tuple(groups.names),
        reactions=tuple(groups.owners),
        channels=model.channels(),
        energies=ENERGIES,
        fingerprint=fingerprint(system),
    )
    begin = np.append(np.zeros(before), sliders.starts())
    placed = np.append(body_tables.placed_positions(model, table), begin)
    return Compiled(
        system,
        layout,
        placed,
        length,
        known,
        functions=tuple(functions.programs),
        contacts=tuple(sliders.contacts),
        starts=tuple(starts),
        numbers=tuple(numbers),
    )


def fingerprint(system: System) -> str:
    """Hash of all tables of a system that do not depend on how long it runs."""
    functions = system.functions
    # Some piecewise polynomials are made over the length of the run; all are said by the scene.
    places = np.where(functions.ops == PIECEWISE, 0.0, functions.args)
    lasting = system._replace(kinks=None, functions=functions._replace(args=places, data=None))
    digest = hashlib.sha256()
    for part in _flatten(lasting):
        digest.update(b"none" if part is None else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def _flatten(part: object) -> list[object]:
    if isinstance(part, tuple):
        return [leaf for item in part for leaf in _flatten(item)]
    return [part]


def _refuse_loops(groups: Groups) -> None:
    names = check_ends(groups)
    if names:
        raise SceneError.from_problems(
            [Problem(name.split(":")[0], "connects a body with itself") for name in names]
        )


def _columns(model: Model, table: NDArray[np.void]) -> list[list[int]]:
    """Columns of the bodies in their panels, modes first; −1 out of the plane of a planar model."""
    numbers = [int(m) for m in table["m"]]
    if model.plane is None:
        return [[*range(m, m + 6), *range(m)] for m in numbers]
    plane, specs = model.plane, model.bodies.values()
    return [planar_columns(spec, plane, m) for spec, m in zip(specs, numbers, strict=True)]


def _blocks(bodies: list[list[int]], groups, n_scalars, elements, markers, frictions) -> Blocks:
    pairs = couples(groups)
    for found in elements:  # between two markers each
        pairs += [(markers.body(s["I"]), markers.body(s["J"])) for s in _rows(found)]
    follows = [
        {c for row in groups.in_group(k) for c, _ in row.entry.follows}
        for k in range(len(groups.groups))
    ]
    for friction in _rows(frictions):  # acts on its coordinate by the reaction of its joint
        follows[friction["group"]].add(int(friction["coordinate"]))
    sliders, first = groups.sliders, len(bodies) + n_scalars
    pairs += sliders.couples(groups.groups, first)
    return Blocks(
        columns=bodies + [[0]] * (n_scalars + len(sliders.found)),
        group_rows=[n for _, n, _, _ in groups.groups],
        group_bodies=[(i, j) for _, _, i, j in groups.groups],
        group_coordinates=[tuple(len(bodies) + c for c in sorted(found)) for found in follows],
        couples=[(i, j) for i, j in pairs if i != j],
        group_sliders=[
            tuple(first + k for k in sliders.of_group(g)) for g in range(len(groups.groups))
        ],
    )


def _rows(table) -> NDArray[np.void] | tuple[()]:
    return () if table is None else table


def _place(table, groups, elements, markers, symbolic: Symbolic) -> NDArray[np.void]:
    """Tell bodies, groups and elements between markers where their blocks are in the factor."""
    table["panel"] = symbolic.panel_of[: len(table)]
    first = len(symbolic.panel_of) - len(groups.groups)
    rows = np.zeros(len(groups.groups), GROUP)
    for k, (row, count, i, j) in enumerate(groups.groups):
        couple = symbolic.couple_links.get((i, j), -1)
        panel = symbolic.panel_of[first + k]
        turned = k in groups.reversed
        rows[k] = (row, count, i, j, panel, *symbolic.group_links[k], couple, turned)
    for found in elements:
        for row in _rows(found):
            pair = markers.body(row["I"]), markers.body(row["J"])
            row["couple"] = symbolic.couple_links.get(pair, -1)
    return rows


def _place_coordinates(follows, frictions, groups, scalars, symbolic: Symbolic) -> None:
    """Tell scalar coordinates, and the rows that follow them, where they are in the factor."""
    if scalars is None:
        return
    n_bodies = len(symbolic.panel_of) - len(groups) - len(scalars)
    scalars["panel"] = symbolic.panel_of[n_bodies : n_bodies + len(scalars)]
    group_of = np.repeat(np.arange(len(groups)), groups["n"])
    for follow in follows:
        pair = int(group_of[follow["row"]]), n_bodies + int(follow["coordinate"])
        follow["link"] = symbolic.coordinate_links[pair]
    for friction in _rows(frictions):
        pair = int(friction["group"]), n_bodies + int(friction["coordinate"])
        friction["link"] = symbolic.coordinate_links[pair]


def _length(model: Model, flexbodies: Mapping[str, FlexBody]) -> float:
    """Size of the model [m]: spread of all markers and flexible bodies in the placed pose."""
    points = []
    for body in (*model.bodies, "ground"):
        for name in lookup.marker_names(model, body, flexbodies):
            marker = lookup.placed(model, f"{body}.{name}", flexbodies)
            points.append(lookup.global_position(model, marker))
    spread = float(np.linalg.norm(np.ptp(np.array(points), axis=0)))
    gyration = [
        float(np.sqrt(np.trace(spec.mass_properties.inertia) / spec.mass_properties.mass))
        for spec in model.bodies.values()
        if not spec.flexible
    ]
    reach = [body.characteristic_length for body in flexbodies.values()]
    return max([spread, *gyration, *reach]) or 1.0


def _weights(
    model: Model, flexbodies: Mapping[str, FlexBody], length: float
) -> NDArray[np.float64]:
    """Size of one unit of every velocity coordinate: metres over the model size, radians, modal
    coordinates by the largest displacement their mode makes, over the model size."""
    parts = []
    for name in model.bodies:
        parts += [np.full(3, 1.0 / length), np.ones(3)]
        if name in flexbodies:
            parts.append(body_tables.modal_reach(flexbodies[name]) / length)
    return np.concatenate(parts)
