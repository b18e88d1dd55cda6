"""The order of the equations: blocks of the KKT matrix, and where every table stands in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.forces import elements
from flexmb.engine.compile.gather import Gathered
from flexmb.engine.compile.joints.groups import Groups, couples, follow_table
from flexmb.engine.compile.planar import planar_columns
from flexmb.engine.symbolic import Blocks, Symbolic, analyse
from flexmb.engine.tables import GROUP, Kkt
from flexmb.model.model import Model

__all__ = ["Ordered", "put_in_order"]


@dataclass(frozen=True)
class Ordered:
    """The factorisation, and the tables that only then are known."""

    kkt: Kkt
    groups: NDArray[np.void]
    follows: NDArray[np.void]
    sliders: NDArray[np.void] | None


def put_in_order(of: Gathered) -> Ordered:
    """Order the equations; tells all tables where their blocks are."""
    symbolic = analyse(_blocks(of))
    groups, follows = _place_groups(of, symbolic), follow_table(of.groups)
    _place_coordinates(follows, of.forces.frictions, groups, of.coordinates, symbolic)
    sliders = of.groups.sliders.table(of.groups.groups, len(of.bodies), symbolic, of.before)
    return Ordered(symbolic.kkt, groups, follows, sliders)


def _columns(model: Model, table: NDArray[np.void]) -> list[list[int]]:
    """Columns of the bodies in their panels, modes first; −1 out of the plane of a planar model."""
    numbers = [int(m) for m in table["m"]]
    if model.plane is None:
        return [[*range(m, m + 6), *range(m)] for m in numbers]
    plane, specs = model.plane, model.bodies.values()
    return [planar_columns(spec, plane, m) for spec, m in zip(specs, numbers, strict=True)]


def _blocks(of: Gathered) -> Blocks:
    groups, bodies = of.groups, _columns(of.model, of.bodies)
    pairs = couples(groups)
    for found in of.forces.between_markers:
        pairs += [(of.markers.body(s["I"]), of.markers.body(s["J"])) for s in found]
    follows = [
        {c for row in groups.in_group(k) for c, _ in row.entry.follows}
        for k in range(len(groups.groups))
    ]
    for friction in _rows(of.forces.frictions):  # acts by the reaction of its joint
        follows[friction["group"]].add(int(friction["coordinate"]))
    sliders, first = groups.sliders, len(bodies) + of.before
    pairs += sliders.couples(groups.groups, first)
    pairs += elements.couples(of.forces.elements, of.markers)
    pairs += [] if of.measured.acting is None else of.measured.acting.couples
    return Blocks(
        columns=bodies + [[0]] * len(of.scalars),
        group_rows=[n for _, n, _, _ in groups.groups],
        group_bodies=[(i, j) for _, _, i, j in groups.groups],
        group_coordinates=[tuple(len(bodies) + c for c in sorted(found)) for found in follows],
        couples=[(i, j) for i, j in pairs if i != j],
        group_sliders=_group_sliders(groups, first),
    )


def _group_sliders(groups: Groups, first: int) -> list[tuple[int, ...]]:
    """Blocks of the curve markers of each group; `first` is that of the first of all."""
    blocks: list[tuple[int, ...]] = [()] * len(groups.groups)
    for k, slider in enumerate(groups.sliders.found):
        blocks[slider.group] += (first + k,)
    return blocks


def _rows(table: NDArray[np.void] | None) -> NDArray[np.void] | tuple[()]:
    return () if table is None else table


def _place_groups(of: Gathered, symbolic: Symbolic) -> NDArray[np.void]:
    """GROUP rows; tells bodies and elements between markers where their blocks are."""
    groups = of.groups
    of.bodies["panel"] = symbolic.panel_of[: len(of.bodies)]
    first = len(symbolic.panel_of) - len(groups.groups)
    rows = []
    for k, (row, count, i, j) in enumerate(groups.groups):
        couple = symbolic.couple_links.get((i, j), -1)
        panel = symbolic.panel_of[first + k]
        turned = k in groups.reversed
        rows.append((row, count, i, j, panel, *symbolic.group_links[k], couple, turned))
    for found in of.forces.between_markers:
        for row in found:
            pair = of.markers.body(row["I"]), of.markers.body(row["J"])
            row["couple"] = symbolic.couple_links.get(pair, -1)
    elements.place(of.forces.elements, of.markers, symbolic.couple_links)
    if of.measured.acting is not None:
        of.measured.acting.place(symbolic)
    return np.array(rows, GROUP)


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
