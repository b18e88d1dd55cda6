"""Tables of force elements between two markers or on a coordinate; None where a model has none."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.forces.basic import line_ends
from flexmb.engine.compile.forces.frames import beam_numbers, bushing_numbers
from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.pool import Functions, Pool
from flexmb.engine.element_tables import (
    COMPONENT_OF,
    COORDINATE_OF,
    DISTANCE_OF,
    FRAME,
    LAW,
    MUTUAL,
    Elements,
)
from flexmb.engine.functions import lower
from flexmb.engine.sensor_tables import (
    FRAME_WRENCH,
    LAW_WRENCH,
    LOAD_WRENCH,
    MUTUAL_WRENCH,
    SPRING_WRENCH,
)
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.forces.elements import BeamForceSpec, BushingSpec
from flexmb.model.forces.force import JointSpringSpec, LoadSpec, SpringDamperSpec
from flexmb.model.forces.stops import AnyStop, JointStopSpec, StopSpec
from flexmb.model.functions.expression import Expression
from flexmb.model.model import Model
from flexmb.model.values.reading import Spec

__all__ = [
    "couples",
    "element_tables",
    "names_of",
    "place",
    "row_of",
    "stop_rows",
    "table_of",
]

Pair = tuple[int, int]
# Fields with the LINK of a pair, and the markers that it couples, by table.
_LINKS = {
    "frames": (("couple", "I", "J"),),
    "laws": (("couple", "I", "J"),),
    "mutual": (
        ("couple", "other", "marker"),
        ("couple_marker", "marker", "axes"),
        ("couple_other", "other", "axes"),
    ),
}


@dataclass
class _Builder:
    """Gathers the rows of all tables; `scalars` are the names of the scalar coordinates."""

    model: Model
    flexbodies: Mapping[str, FlexBody]
    markers: Markers
    functions: Functions
    scalars: Sequence[str]
    pool: Pool = field(default_factory=Pool)
    programs: list[Expression] = field(default_factory=list)
    frames: list[tuple[object, ...]] = field(default_factory=list)
    laws: list[dict[str, float]] = field(default_factory=list)
    mutual: list[tuple[object, ...]] = field(default_factory=list)

    def frame(self, name: str, spec: BushingSpec | BeamForceSpec) -> None:
        """A bushing or a beam."""
        made = beam_numbers if isinstance(spec, BeamForceSpec) else bushing_numbers
        ends, numbers, damped = made(self.model, name, self.flexbodies)
        i, j = (self.markers.add(marker) for marker in ends)
        self.frames.append((i, j, -1, self.pool.add(numbers), damped))

    def line(self, spec: SpringDamperSpec) -> None:
        """A spring-damper along a line that is more than linear."""
        i, j, length = line_ends(self.model, spec, self.flexbodies, self.markers)
        row = {"measure": DISTANCE_OF, "I": i, "J": j, "free": length, "fun": -1}
        row |= {"k": spec.stiffness, "c": spec.damping}
        if spec.value is not None:
            row["fun"] = self.functions.add(spec.value.expression)
        self.laws.append(row | self._laws_of(spec))

    def joint_spring(self, name: str, spec: JointSpringSpec) -> None:
        """The laws of a spring on a joint, whose numbers stand with its coordinate."""
        row = {"measure": COORDINATE_OF, "coordinate": self.scalars.index(f"forces.{name}")}
        self.laws.append(row | {"free": spec.free} | self._laws_of(spec))

    def stop(self, name: str, spec: AnyStop) -> None:
        """A stop, its force at unit penetration in SI: units of length to the exponent."""
        row: dict[str, float] = {"stop": 1, "exponent": spec.exponent, "c": spec.damping}
        row["lower"], row["upper"] = spec.bounds
        row["depth"] = math.inf if spec.depth is None else spec.depth
        unit = self.model.units.scale("m")
        if isinstance(spec, JointStopSpec):
            row |= {"measure": COORDINATE_OF, "coordinate": self.scalars.index(f"forces.{name}")}
            unit = unit if spec.coordinate == "stroke" else 1.0
        elif isinstance(spec, StopSpec):
            row["measure"] = DISTANCE_OF if spec.axis is None else COMPONENT_OF
            ends = lookup.frames(self.model, spec.between, spec.axis, self.flexbodies)
            row["I"], row["J"] = (self.markers.add(marker) for marker in ends)
        row["k"] = spec.stiffness * unit ** (1.0 - spec.exponent)
        self.laws.append(row)

    def load(self, spec: LoadSpec) -> None:
        """A load in foreign axes, or with its opposite on another body."""
        axes = spec.at if spec.axes == "body" else spec.axes_marker
        found = [
            -1
            if reference is None
            else self.markers.add(lookup.placed(self.model, reference, self.flexbodies))
            for reference in (spec.at, spec.reaction, axes)
        ]
        programs = tuple(self.functions.add(f.expression) for f in spec.value)
        self.mutual.append((*found, spec.type == "torque", programs, -1, -1, -1))

    def _laws_of(self, spec: SpringDamperSpec | JointSpringSpec) -> dict[str, float]:
        """Programs of the laws of a force."""
        row: dict[str, float] = {}
        spring, damper = spec.spring_force, spec.damper_force
        parts = {
            "spring": spring and spring.expression,
            "stored": spring and spring.stored,
            "damper": damper and damper.expression,
        }
        for word, expression in parts.items():
            if expression is not None:
                row[word] = len(self.programs)
                self.programs.append(expression)
        return row

    def tables(self) -> Elements | None:
        """All tables; links are filled in later."""
        if not (self.frames or self.laws or self.mutual):
            return None
        return Elements(
            frames=np.array(self.frames, FRAME) if self.frames else None,
            laws=_law_table(self.laws) if self.laws else None,
            mutual=np.array(self.mutual, MUTUAL) if self.mutual else None,
            pool=self.pool.array(),
            programs=lower(self.programs),
        )


def element_tables(
    model: Model,
    flexbodies: Mapping[str, FlexBody],
    markers: Markers,
    functions: Functions,
    scalars: Sequence[str],
) -> Elements | None:
    """The tables of a model; None if it needs none of them.

    Parameters
    ----------
    model, flexbodies : Model, mapping
        The model and its flexible bodies.
    markers, functions : Markers, Functions
        What grows while tables are built.
    scalars : sequence of str
        Names of the scalar coordinates, in their order.
    """
    builder = _Builder(model, flexbodies, markers, functions, scalars)
    for name, spec in model.forces.items():
        if isinstance(spec, BushingSpec | BeamForceSpec):
            builder.frame(name, spec)
        elif isinstance(spec, AnyStop):
            builder.stop(name, spec)
        elif isinstance(spec, SpringDamperSpec) and table_of(spec) == LAW_WRENCH:
            builder.line(spec)
        elif isinstance(spec, JointSpringSpec) and table_of(spec) == LAW_WRENCH:
            builder.joint_spring(name, spec)
        elif isinstance(spec, LoadSpec) and table_of(spec) == MUTUAL_WRENCH:
            builder.load(spec)
    return builder.tables()


def table_of(spec: Spec) -> int:
    """Which table a force has its row in: by the kind of its wrench; −1: none."""
    if isinstance(spec, BushingSpec | BeamForceSpec):
        return FRAME_WRENCH
    if isinstance(spec, LoadSpec):
        alone = spec.reaction is None and spec.axes_marker is None
        return LOAD_WRENCH if alone else MUTUAL_WRENCH
    if isinstance(spec, SpringDamperSpec):
        return SPRING_WRENCH if spec.linear else LAW_WRENCH
    if isinstance(spec, JointSpringSpec):
        return -1 if spec.spring_force is None and spec.damper_force is None else LAW_WRENCH
    return LAW_WRENCH if isinstance(spec, AnyStop) else -1


def stop_rows(elements: Elements | None) -> NDArray[np.int64] | None:
    """The laws that are stops; None where there are none."""
    laws = None if elements is None else elements.laws
    rows = np.flatnonzero(laws["stop"]) if isinstance(laws, np.ndarray) else ()
    return np.array(rows, np.int64) if len(rows) else None


def names_of(model: Model, table: int) -> tuple[str, ...]:
    """Scene paths of the rows of a table of forces, in their order."""
    return tuple(f"forces.{name}" for name, s in model.forces.items() if table_of(s) == table)


def row_of(model: Model, name: str) -> tuple[int, int]:
    """Kind of wrench and row of a force, as channels that read it have them."""
    table = table_of(model.forces[name])
    return table, names_of(model, table).index(f"forces.{name}")


def _law_table(rows: list[dict[str, float]]) -> NDArray[np.void]:
    table = np.zeros(len(rows), LAW)
    for name in ("I", "J", "coordinate", "couple", "fun", "spring", "stored", "damper"):
        table[name] = -1
    for k, row in enumerate(rows):
        for name, value in row.items():
            table[name][k] = value
    return table


def _pairs(elements: Elements | None) -> list[tuple[NDArray[np.void], str, str, str]]:
    """Every row with the field of a link and the fields of the two markers that it couples."""
    if elements is None:
        return []
    tables = elements._asdict()
    return [
        (row, *fields)
        for name, links in _LINKS.items()
        if tables[name] is not None
        for row in tables[name]
        for fields in links
        if row[fields[1]] >= 0 and row[fields[2]] >= 0
    ]


def couples(elements: Elements | None, markers: Markers) -> list[Pair]:
    """Pairs of different bodies that elements couple, −1 being ground."""
    pairs = [(markers.body(row[i]), markers.body(row[j])) for row, _, i, j in _pairs(elements)]
    return [(i, j) for i, j in pairs if i != j]


def place(elements: Elements | None, markers: Markers, links: Mapping[Pair, int]) -> None:
    """Tell all elements where the coupling of their bodies is in the factor."""
    for row, link, i, j in _pairs(elements):
        row[link] = links.get((markers.body(row[i]), markers.body(row[j])), -1)
