"""Tables of nonlinear spring–dampers, actuators and stops."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.forces.spring_damper import line_ends
from flexmb.engine.functions import lower
from flexmb.engine.kernels.forces.characteristic import (
    COMPONENT_OF,
    COORDINATE_OF,
    DISTANCE_OF,
    FORCE_CHARACTERISTIC,
)
from flexmb.engine.kernels.forces.force_characteristic import (
    FORCE_CHARACTERISTICS,
    ForceCharacteristics,
)
from flexmb.engine.lowering import Action, Element, Lowering
from flexmb.model import lookup
from flexmb.model.forces.spring_damper import JointSpringSpec, SpringDamperSpec
from flexmb.model.forces.stops import AnyStop, JointStopSpec, StopSpec
from flexmb.model.functions.expression import Expression

__all__ = ["lower_force_characteristics"]

Row = dict[str, float]
_NONE = dict.fromkeys(("I", "J", "coordinate", "couple", "fun", "spring", "stored", "damper"), -1)


def lower_force_characteristics(lowering: Lowering) -> ForceCharacteristics | None:
    """FORCE_CHARACTERISTIC rows with their programs; None if the model has none."""
    made = _Rows(lowering)
    for name, spec in lowering.model.forces.items():
        if isinstance(spec, AnyStop):
            made.add(name, made.stop(name, spec))
        elif isinstance(spec, SpringDamperSpec) and not spec.linear:
            made.add(name, made.line(spec))
        elif isinstance(spec, JointSpringSpec) and not (
            spec.spring_force is None and spec.damper_force is None
        ):
            made.add(name, made.joint_spring(name, spec))
    if not made.rows:
        return None
    rows, programs = made.table(), lower(made.programs)
    stops = np.flatnonzero(rows["stop"])
    lowering.program_depth = max(lowering.program_depth, programs.depth)
    return ForceCharacteristics(rows, programs, stops, lowering.watch(2 * len(stops)))


@dataclass
class _Rows:
    """Rows and programs in the making."""

    lowering: Lowering
    rows: list[Row] = field(default_factory=list)
    programs: list[Expression] = field(default_factory=list)

    def add(self, name: str, row: Row) -> None:
        """Take a row of a force; what has a function of time between markers acts on both."""
        kind, k, row = FORCE_CHARACTERISTICS.name, len(self.rows), _NONE | row
        self.rows.append(row)
        self.lowering.elements[f"forces.{name}"] = Element(kind, k)
        if row["fun"] >= 0:
            self.lowering.actions += [
                Action(int(row["fun"]), kind, k, on, 0, int(row[end]))
                for on, end in enumerate("JI")
            ]

    def line(self, spec: SpringDamperSpec) -> Row:
        """A spring-damper along a line that is more than linear."""
        i, j, length = line_ends(self.lowering, spec)
        row: Row = {"measure": DISTANCE_OF, "I": i, "J": j, "free": length}
        row |= {"k": spec.stiffness, "c": spec.damping}
        if spec.value is not None:
            row["fun"] = self.lowering.functions.add(spec.value.expression)
        return row | self._characteristic(spec)

    def joint_spring(self, name: str, spec: JointSpringSpec) -> Row:
        """The characteristic of a spring on a joint, whose numbers stand with its coordinate."""
        coordinate = self.lowering.coordinate(f"forces.{name}")
        row: Row = {"measure": COORDINATE_OF, "coordinate": coordinate, "free": spec.free}
        return row | self._characteristic(spec)

    def stop(self, name: str, spec: AnyStop) -> Row:
        """A stop, its force at unit penetration in SI: units of length to the exponent."""
        model, flexbodies = self.lowering.model, self.lowering.flexbodies
        row: Row = {"stop": 1, "exponent": spec.exponent, "c": spec.damping}
        row["lower"], row["upper"] = spec.bounds
        row["depth"] = math.inf if spec.depth is None else spec.depth
        unit = model.units.scale("m")
        if isinstance(spec, JointStopSpec):
            row["measure"] = COORDINATE_OF
            row["coordinate"] = self.lowering.coordinate(f"forces.{name}")
            unit = unit if spec.coordinate == "stroke" else 1.0
        elif isinstance(spec, StopSpec):
            row["measure"] = DISTANCE_OF if spec.axis is None else COMPONENT_OF
            ends = lookup.frames(model, spec.between, spec.axis, flexbodies)
            row["I"], row["J"] = (self.lowering.markers.add(marker) for marker in ends)
        row["k"] = spec.stiffness * unit ** (1.0 - spec.exponent)
        return row

    def _characteristic(self, spec: SpringDamperSpec | JointSpringSpec) -> Row:
        """Programs of the characteristic of a force."""
        row: Row = {}
        spring, damper = spec.spring_force, spec.damper_force
        parts = {
            "spring": None if spring is None else spring.expression,
            "stored": None if spring is None else spring.stored,
            "damper": None if damper is None else damper.expression,
        }
        for word, expression in parts.items():
            if expression is not None:
                row[word] = len(self.programs)
                self.programs.append(expression)
        return row

    def table(self) -> NDArray[np.void]:
        """FORCE_CHARACTERISTIC rows; links are filled in later."""
        table = np.zeros(len(self.rows), FORCE_CHARACTERISTIC)
        for k, row in enumerate(self.rows):
            for name, value in row.items():
                table[name][k] = value
        return table
