"""What of two runs is compared: sensors by what they measure, bodies, and reactions of joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.dynamics.run_settings import extents_of_parts
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import Layout
from flexmb.flexbody.arrays import Array
from flexmb.model.control import channel_program
from flexmb.model.model import Model
from flexmb.model.reading import Spec
from flexmb.model.sensor import ExpressionSensorSpec, channels_of, unit_of
from flexmb.results.output_block import OutputBlock


class Part(NamedTuple):
    """Of a part of a model what (k,) is compared, what that is judged by, its mass and size."""

    own: NDArray[np.bool_]
    beside: NDArray[np.bool_]
    mass: float  # kg
    length: float  # m


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
    """The parts of a model, which share no equations.

    What is of none, such as a coupler's reaction, is judged by all.
    """
    bodies, groups = compiled.system.parts.bodies, compiled.system.groups
    of = np.append(compiled.system.part[bodies["iv"]], -1)  # the ground is of none
    names = [*(f"bodies.{one.name}" for one in compiled.layout.bodies), *compiled.layout.reactions]
    ends = np.maximum(groups["body_I"], groups["body_J"])
    numbers = dict(zip(names, np.append(of[:-1], of[ends]).tolist(), strict=True))
    for name, spec in model.sensors.items():
        at = [f"{key}s.{getattr(spec, key, None)}" for key in ("joint", "driver", "force")]
        numbers[name] = next((numbers[one] for one in at if one in numbers), -1)
    names = [one.name.removesuffix(DEFORMATION) for one in rows]
    own = np.array([numbers.get(name, -1) for name in names], dtype=np.intp)
    mass = np.maximum(bodies["mass"], np.finfo(float).tiny)
    gyration = np.sqrt(np.trace(bodies["S0"], axis1=1, axis2=2) / mass)
    sizes = np.maximum(extents_of_parts(compiled, compiled.initial_q)[0][bodies["iv"]], gyration)
    parts = []
    for k in dict.fromkeys(own.tolist()):
        inside = (of[:-1] == k) | (k < 0)
        length = sizes[inside].max() if k >= 0 else compiled.length
        sums = float(bodies["mass"][inside].sum()), min(float(length), compiled.length)
        parts.append(Part(own == k, (own == k) | (k < 0), *sums))
    return parts


class RoundOff:
    """Round-off of one step in each of the rows (k,): it is not of the motion, but of the place.

    Lengths have that of their bodies' distance from the origin, angles that of Euler parameters,
    expressions that of what they read: rounded by a step and its projection, evenly within an ulp.
    """

    def __init__(self, rows: Sequence[Compared], compiled: Compiled, model: Model) -> None:
        parts, terms = compiled.system.parts, compiled.system.sensors.terms
        self._channels, bodies = compiled.layout.channels, parts.bodies["iq"]
        self._angles = np.array([1.0 * (one.unit == "rad") for one in rows])
        self._places, self._computed, self._row_of = [], [], dict[str, int]()
        for k, one in enumerate(rows):
            if one.unit not in ("m", "rad") or one.reach:
                continue
            if one.table == "sensors":
                self._row_of |= {self._channels[column]: k for column in one.columns}
            if isinstance(model.sensors.get(one.name), ExpressionSensorSpec):
                program = channel_program(model, one.name)
                self._computed += [(k, program)] if {*program.channels} <= {*self._channels} else []
            elif one.unit == "m":
                own = terms[(one.table == "sensors") & np.isin(terms["channel"], one.columns)]
                ends = np.concatenate([own["I"], own["J"]])
                on = parts.markers["body"][ends[ends >= 0]]
                places = one.columns[:1] if one.table == "q" else np.unique(bodies[on[on >= 0]])
                self._places += [(k, int(iq)) for iq in places]

    def of(self, block: OutputBlock) -> Array:
        """The largest (k,) in a block of rows; of expressions, by their slopes in its last one."""
        sizes = self._angles.copy()
        for k, iq in self._places:
            sizes[k] = max(sizes[k], np.linalg.norm(block.q[:, iq : iq + 3], axis=1).max())
        now = zip(self._channels, block.sensors[-1].tolist(), strict=True)
        even = {name: (value, 0.0, 0.0) for name, value in now}
        for k, program in self._computed:
            t, names = float(block.t[-1]), [one for one in program.channels if one in self._row_of]
            jets = [program.value(t, even | {one: (even[one][0], 1.0, 0.0)}) for one in names]
            slopes = np.array([jet[1] for jet in jets]) - program.value(t, even)[1]
            own = sizes[[self._row_of[one] for one in names]]
            sizes[k] = np.linalg.norm(np.where(np.isfinite(slopes), slopes, 0.0) * own)
        return np.asarray(np.finfo(float).eps * np.sqrt(2.0 / 12.0) * sizes)
