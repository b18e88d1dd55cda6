"""Tables of the units that a system calls: by stage and kind, by kind of row, for sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexmb.engine.jit import CompiledUnit, units_in
from flexmb.engine.joints import ROW_KINDS
from flexmb.engine.kind_registry import KINDS
from flexmb.engine.sensors import CHANNEL_KINDS, MEASURES
from flexmb.engine.state import RowUnits, SensorUnits, Stage, Stages
from flexmb.engine.tables import System


def kinds_of(system: System) -> list:
    """The kinds of elements that a system has, in the order in which stages call them."""
    return [kind for kind in KINDS if kind.name in system.kinds]


def stages_of(system: System, scratch: Mapping[str, Any]) -> Stages:
    """For every stage the units of the kinds that act in it, and their tables with scratch."""
    kinds, called = kinds_of(system), _called_by_number(system)
    tables = dict(system.kinds)
    for name in scratch.keys() & tables.keys():  # the system may have fewer kinds than the scratch
        tables[name] = tables[name]._replace(scratch=scratch[name])

    def stage(name: str) -> Stage:
        acting = [kind for kind in kinds if name in kind.units]
        used = called.get(name, range(len(acting)))
        units = tuple(kind.units[name] if k in used else None for k, kind in enumerate(acting))
        return Stage(units, tuple(tables[kind.name] for kind in acting))

    stages = {name: stage(name) for name in Stages._fields}
    if system.events == 0:
        stages["events"] = Stage((), ())
    if any(kind.uses_velocity for kind in kinds):
        stages["force_velocity"] = stages["velocity"]
    return Stages(**stages)


def _called_by_number(system: System) -> dict[str, set[int]]:
    """For stages called by the number of a kind: the numbers that sensors and feedback use."""
    channels, feedback = system.sensors.channels, system.kinds.get("feedback")
    read = set(channels["kind"].tolist())
    acting = set() if feedback is None else set(feedback.tangents["kind"].tolist())
    return {"wrenches": read, "unit_force": acting}


def row_units(system: System) -> RowUnits:
    """Units of the kinds of rows that a system has as constraints or uses in its sensors."""
    in_joints = np.flatnonzero(np.bincount(system.rows["kind"])).tolist()
    used = {word: set(in_joints) for word in _ROW_UNIT_NAMES}
    every, acting = _terms(system)
    for number, kind in every:
        for word in MEASURES[number].of_row:
            used[word].add(kind)
    for number, kind in acting:
        for word in MEASURES[number].gradient_of_row:
            used[word].add(kind)
    units = {
        word: tuple(
            getattr(kind, word) if k in used[word] else None for k, kind in enumerate(ROW_KINDS)
        )
        for word in _ROW_UNIT_NAMES
    }
    curved = np.array([kind.tangent is not None for kind in ROW_KINDS], np.int64)
    return RowUnits(**units, curved=curved, period=np.array([kind.period for kind in ROW_KINDS]))


_ROW_UNIT_NAMES = ("value", "gradient", "curvature", "tangent")


def sensor_units(system: System) -> SensorUnits:
    """Units of the kinds of channels and measures that a system has."""
    channels = set(system.sensors.channels["what"].tolist())
    measures, acting = ({number for number, _ in terms} for terms in _terms(system))
    return SensorUnits(
        channel=tuple(of.value if k in channels else None for k, of in enumerate(CHANNEL_KINDS)),
        turns=np.array([of.counts_turns for of in CHANNEL_KINDS], np.int64),
        computed=np.array([of.reads == "channels" for of in CHANNEL_KINDS], np.int64),
        measure=tuple(of.value if k in measures else None for k, of in enumerate(MEASURES)),
        gradient=tuple(of.gradient if k in acting else None for k, of in enumerate(MEASURES)),
        level=np.array([of.level for of in MEASURES], np.int64),
    )


def _terms(system: System) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """(measure, kind of row) of all terms, and of those whose gradients feedback needs."""
    terms, feedback = system.sensors.terms, system.kinds.get("feedback")
    every = list(zip(terms["measure"].tolist(), terms["kind"].tolist(), strict=True))
    acting = set() if feedback is None else set(feedback.tangents["term"].tolist()) - {-1}
    return set(every), {every[t] for t in acting}


def units_of(system: System) -> list[CompiledUnit]:
    """All units in the tables of a system."""
    tables = stages_of(system, {}), row_units(system), sensor_units(system)
    return [unit for table in tables for unit in units_in(table)]
