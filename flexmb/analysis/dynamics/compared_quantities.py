"""What of two runs is compared: sensors by what they measure, bodies, and reactions of joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import Compiled, parts_of_model
from flexmb.engine.tables import Layout
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.model.reading import Spec
from flexmb.model.sensor import channels_of, unit_of

Part = tuple[NDArray[np.bool_], NDArray[np.bool_], float]

QUANTITIES = {
    "m": "positions",
    "rad": "positions",
    "m/s": "velocities",
    "rad/s": "velocities",
    "m/s^2": "accelerations",
    "rad/s^2": "accelerations",
    "N": "reactions",
    "N m": "reactions",
}
"""Quantity to which the channels of each unit belong."""
FOR_SCALE = "motion"
"""Quantity of bodies by which their velocities are judged where positions are sensed."""
DEFORMATION = ".deformation"
"""End of the name of what the modes of a body move its points."""


@dataclass(frozen=True)
class Compared:
    """One sensor, body or joint: where its components stand in a table of the rows.

    `reach` is what one unit of each modal coordinate moves a point [m]; of all others it is empty.
    """

    name: str
    quantity: str
    unit: str
    table: str
    columns: tuple[int, ...]
    reach: tuple[float, ...] = ()


def compared(
    layout: Layout, model: Model, reach: Mapping[str, Array] | None = None
) -> list[Compared]:
    """Sensors by what they measure, bodies where nothing is sensed, and joints.

    With the `reach` of their modes, flexible bodies count by their deformation too.
    """
    column = {channel: k for k, channel in enumerate(layout.channels)}
    owners: dict[str, Spec] = {**model.sensors, **model.states, **model.controllers}
    rows = []
    for name, spec in owners.items():
        unit = unit_of(vars(spec)) or ""
        columns = tuple(column[c] for c in channels_of(name, spec) if c in column)
        if columns:
            rows.append(Compared(name, QUANTITIES.get(unit, unit), unit, "sensors", columns))
    sensed = {one.quantity for one in rows}
    for body in layout.bodies:
        own, bend = f"bodies.{body.name}", tuple(map(float, (reach or {}).get(body.name, ())))
        m = len(bend)
        for name, quantity, unit, table, first, n in (
            (own, "positions", "m", "q", body.iq, 3),
            (own, "positions", "rad", "q", body.iq + 3, 4),
            (own, "velocities", "m/s", "v", body.iv, 3),
            (own, "velocities", "rad/s", "v", body.iv + 3, 3),
            (own + DEFORMATION, "positions", "m", "q", body.iq + 7, m),
            (own + DEFORMATION, "velocities", "m/s", "v", body.iv + 6, m),
        ):  # fmt: skip
            what = FOR_SCALE if quantity in sensed else quantity
            if quantity == "positions" and {"positions", "velocities"} <= sensed:
                continue
            columns, sizes = tuple(range(first, first + n)), bend if name != own else ()
            if columns:
                rows.append(Compared(name, what, unit, table, columns, sizes))
    for k, name in enumerate(layout.reactions):
        for unit, first in (("N", 12 * k), ("N m", 12 * k + 3)):
            columns = (first, first + 1, first + 2)
            rows.append(Compared(name, "reactions", unit, "reactions", columns))
    return rows


def groups(keys: Iterable[Any]) -> dict[Any, NDArray[np.intp]]:
    """Places of each key, in the order of their first ones."""
    every = list(keys)
    return {
        key: np.array([k for k, one in enumerate(every) if one == key], np.intp)
        for key in dict.fromkeys(every)
    }


def by_part(rows: Sequence[Compared], compiled: Compiled, model: Model) -> list[Part]:
    """Of each part of a model what is compared, what that is judged by, and its mass [kg].

    What is of none, such as a coupler's reaction, is judged by all.
    """
    bodies, groups = compiled.system.parts.bodies, compiled.system.groups
    of = np.append(parts_of_model(compiled)[bodies["iv"]], -1)  # the ground is of none
    names = [*(f"bodies.{one.name}" for one in compiled.layout.bodies), *compiled.layout.reactions]
    ends = np.maximum(groups["body_I"], groups["body_J"])
    numbers = dict(zip(names, np.append(of[:-1], of[ends]).tolist(), strict=True))
    for name, spec in model.sensors.items():
        at = [f"{key}s.{getattr(spec, key, None)}" for key in ("joint", "driver", "force")]
        numbers[name] = next((numbers[one] for one in at if one in numbers), -1)
    names = [one.name.removesuffix(DEFORMATION) for one in rows]
    own = np.array([numbers.get(name, -1) for name in names], dtype=np.intp)
    return [
        (own == k, (own == k) | (k < 0), float(bodies["mass"][(of[:-1] == k) | (k < 0)].sum()))
        for k in dict.fromkeys(own.tolist())
    ]


def round_off(rows: Sequence[Compared], compiled: Compiled, q: Array) -> Array:
    """Round-off of one step in each (k,), at a pose q: it is not of the motion, but of the place.

    Lengths have that of the distance of their bodies from the origin, angles that of the Euler
    parameters. A number is rounded twice, by the step and by its projection, evenly within an ulp.
    """
    parts, terms = compiled.system.parts, compiled.system.sensors.terms
    sizes, bodies = np.array([1.0 * (one.unit == "rad") for one in rows]), parts.bodies["iq"]
    for k, one in enumerate(rows):
        if one.unit == "m" and not one.reach:
            own = terms[(one.table == "sensors") & np.isin(terms["channel"], one.columns)]
            ends = np.concatenate([own["I"], own["J"]])
            on = parts.markers["body"][ends[ends >= 0]]
            places = one.columns[:1] if one.table == "q" else bodies[on[on >= 0]]
            sizes[k] = max((float(np.linalg.norm(q[iq : iq + 3])) for iq in places), default=0.0)
    return np.asarray(np.finfo(float).eps * np.sqrt(2.0 / 12.0) * sizes)
