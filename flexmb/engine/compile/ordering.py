"""The order of the equations: blocks of the KKT matrix, and where every table stands in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.gather import Gathered
from flexmb.engine.joints.constraint_groups import Groups, coupled_bodies, follow_table
from flexmb.engine.kinds import KINDS
from flexmb.engine.lowering import Placement
from flexmb.engine.symbolic import Blocks, Symbolic, analyse
from flexmb.engine.tables import GROUP, Kkt
from flexmb.model.bodies.body import BodySpec
from flexmb.model.model import Model
from flexmb.model.plane import normal_in_body, plane_axes


def normal_axis(spec: BodySpec, plane: str) -> int:
    """The axis of a body that points along the normal of the plane, or against it."""
    return int(np.argmax(np.abs(normal_in_body(spec, plane))))


def planar_columns(spec: BodySpec, plane: str, m: int) -> list[int]:
    """Column of each velocity coordinate of a body with m modes, −1 out of the plane."""
    first, second, _ = plane_axes(plane)
    about = normal_axis(spec, plane)
    columns = [-1] * 6
    for k, coordinate in enumerate((first, second, 3 + about)):
        columns[coordinate] = m + k
    return [*columns, *range(m)]


@dataclass(frozen=True)
class Ordered:
    """The factorisation, and the tables that only then are known."""

    kkt: Kkt
    groups: NDArray[np.void]
    follows: NDArray[np.void]
    curve_markers: NDArray[np.void]


def put_in_order(of: Gathered) -> Ordered:
    """Order the equations; tells all tables where their blocks are."""
    symbolic = analyse(_blocks(of))
    groups, follows = _place_groups(of, symbolic), follow_table(of.groups)
    _place_coordinates(follows, groups, of.coordinates, symbolic)
    _place_kinds(of, symbolic)
    curve_markers = of.groups.curve_points.table(
        of.groups.groups, len(of.bodies), symbolic, of.before
    )
    return Ordered(symbolic.kkt, groups, follows, curve_markers)


def _columns(model: Model, table: NDArray[np.void]) -> list[list[int]]:
    """Columns of the bodies in their panels, modes first; −1 out of the plane of a planar model."""
    numbers = [int(m) for m in table["m"]]
    if model.plane is None:
        return [[*range(m, m + 6), *range(m)] for m in numbers]
    plane, specs = model.plane, model.bodies.values()
    return [planar_columns(spec, plane, m) for spec, m in zip(specs, numbers, strict=True)]


def _coupled_rows(of: Gathered) -> list[tuple[Any, str, int, int]]:
    """Every row of a kind that couples two bodies: the row, its field, the two markers."""
    return [
        (row, field, int(row[i]), int(row[j]))
        for kind in KINDS
        if kind.name in of.kinds
        for field, i, j in kind.couples
        for row in of.kinds[kind.name].rows
        if row[i] >= 0 and row[j] >= 0
    ]


def _blocks(of: Gathered) -> Blocks:
    groups, bodies, markers = of.groups, _columns(of.model, of.bodies), of.markers
    pairs = coupled_bodies(groups)
    pairs += [(markers.body(i), markers.body(j)) for _, _, i, j in _coupled_rows(of)]
    follows = [
        {c for row in groups.in_group(k) for c, _ in row.entry.follows}
        for k in range(len(groups.groups))
    ]
    for group, coordinate in of.lowering.reaction_loads:
        follows[group].add(coordinate)
    curve_points, first = groups.curve_points, len(bodies) + of.before
    pairs += curve_points.couples(groups.groups, first)
    pairs += [] if of.measured.feedback is None else of.measured.feedback.couples
    return Blocks(
        columns=bodies + [[0]] * len(of.lowering.scalars),
        group_rows=[n for _, n, _, _ in groups.groups],
        group_bodies=[(i, j) for _, _, i, j in groups.groups],
        group_coordinates=[tuple(len(bodies) + c for c in sorted(found)) for found in follows],
        couples=[(i, j) for i, j in pairs if i != j],
        group_sliders=_group_sliders(groups, first),
    )


def _group_sliders(groups: Groups, first: int) -> list[tuple[int, ...]]:
    """Blocks of the curve markers of each group; `first` is that of the first of all."""
    blocks: list[tuple[int, ...]] = [()] * len(groups.groups)
    for k, slider in enumerate(groups.curve_points.points):
        blocks[slider.group] += (first + k,)
    return blocks


def _place_groups(of: Gathered, symbolic: Symbolic) -> NDArray[np.void]:
    """GROUP rows; tells bodies where their blocks are."""
    groups = of.groups
    of.bodies["panel"] = symbolic.panel_of[: len(of.bodies)]
    first = len(symbolic.panel_of) - len(groups.groups)
    rows = []
    for k, (row, count, i, j) in enumerate(groups.groups):
        couple = symbolic.couple_links.get((i, j), -1)
        panel = symbolic.panel_of[first + k]
        turned = k in groups.reversed
        rows.append((row, count, i, j, panel, *symbolic.group_links[k], couple, turned))
    return np.array(rows, GROUP)


def _place_coordinates(follows, groups, scalars, symbolic: Symbolic) -> None:
    """Tell scalar coordinates, and the rows that follow them, where they are in the factor."""
    n_bodies = len(symbolic.panel_of) - len(groups) - len(scalars)
    scalars["panel"] = symbolic.panel_of[n_bodies : n_bodies + len(scalars)]
    group_of = np.repeat(np.arange(len(groups)), groups["n"])
    for follow in follows:
        pair = int(group_of[follow["row"]]), n_bodies + int(follow["coordinate"])
        follow["link"] = symbolic.coordinate_links[pair]


def _place_kinds(of: Gathered, symbolic: Symbolic) -> None:
    """Tell all kinds where their blocks are."""
    placement = Placement(symbolic, of.markers, len(of.bodies))
    for row, field, i, j in _coupled_rows(of):
        row[field] = placement.link(i, j)
    for kind in KINDS:
        if kind.place is not None and kind.name in of.kinds:
            kind.place(of.kinds[kind.name], placement)
    if of.measured.feedback is not None:
        of.measured.feedback.place(symbolic)
